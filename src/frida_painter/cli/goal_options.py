"""How goals are given on the command line: an option for each kind of goal that there is."""

import inspect
import sys
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from frida_painter.errors import ConfigError
from frida_painter.objectives.kind import Gives, GoalKind, goal_kinds
from frida_painter.options import number

_PANEL = "What to paint"
_PHOTO = "image"  # the kind of goal that PHOTO is

GoalFile = Annotated[
    Path | None,
    typer.Option("--goal", metavar="FILE", help="A TOML file with goals and their weights.", rich_help_panel=_PANEL),
]
ClipSource = Annotated[
    str | None,
    typer.Option(
        "--clip",
        metavar="NAME|FOLDER",
        help="The CLIP model for text and meaning: a name on the hub, a folder, or a safetensors file of a "
        "CLIP ResNet. [dim]clip-vit-b-32 if it was downloaded, else smaller networks[/]",
        rich_help_panel=_PANEL,
    ),
]
Pictures = Annotated[
    Path | None,
    typer.Option(
        "--pictures",
        metavar="FOLDER",
        help="A folder with your own pictures of things, named by what they show (red-fox.png, or a text beside each). "
        "Text prompts use them first. [dim]the libraries that were downloaded[/]",
        rich_help_panel=_PANEL,
    ),
]


def goal_options() -> list[inspect.Parameter]:
    """The options by which a command takes goals, as keyword parameters for Typer, in the order of its help.

    For every kind NAME its values and weights, NAME and NAME_weight; what is begun with, init_NAME; then goal, a
    file, clip, and pictures. `goal_given` reads what they were given.
    """
    kinds = list(goal_kinds().by_name.values())
    options = [parameter for kind in kinds for parameter in _options(kind)]
    options += [_repeated(f"init_{kind.name}", kind, kind.initial_help) for kind in kinds if kind.initial_help]
    return [*options, _parameter("goal", GoalFile), _parameter("clip", ClipSource), _parameter("pictures", Pictures)]


def free_goal_options(taken: Collection[str]) -> list[inspect.Parameter]:
    """The goal options whose names a command has not `taken` for other options."""
    return [option for option in goal_options() if option.name not in taken]


def goal_given(photo: Path | None, given: Mapping[str, Any]) -> dict[str, list[Any]]:
    """What PHOTO, which counts as the first --image, the options and the goal file ask for, in the words of RunSpec.

    Raises ConfigError where weights do not fit, and for a goal file that cannot be read.
    """
    from frida_painter.runs.goal_item import read_goal_file

    kinds = goal_kinds().by_name.values()
    goal = [item for kind in kinds for item in _items(kind, photo if kind.name == _PHOTO else None, given)]
    initial = [{kind.name: str(value)} for kind in kinds for value in given.get(f"init_{kind.name}") or []]
    filed = {} if given.get("goal") is None else read_goal_file(given["goal"])
    return {"goal": goal + filed.get("goal", []), "initial": initial + filed.get("initial", [])}


def _items(kind: GoalKind, photo: Path | None, given: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The values of a kind's option, with the weight of each."""
    values = [*([] if photo is None else [photo]), *(given.get(kind.name) or [])]
    weights = given.get(f"{kind.name}_weight") or [1.0] * len(values)
    if len(weights) != len(values):
        photo_too = ", PHOTO among them" if photo is not None else ""
        raise ConfigError(
            f"{kind.option}-weight was given {len(weights)} times for {len(values)} goals{photo_too}; "
            "give one weight for each, or none at all."
        )
    return [{kind.name: str(value), "weight": float(weight)} for value, weight in zip(values, weights, strict=True)]


def tell_left_out(taken: Collection[str]) -> None:
    """Says on stderr which kinds of goals of other packages cannot be used, or have no option, and why."""
    for complaint in goal_kinds().complaints:
        print(complaint, file=sys.stderr)
    for option in goal_options():
        if option.name in taken:
            said = f"--{option.name} is another option already; give that kind of goal in a file, with --goal."
            print(said, file=sys.stderr)


def _options(kind: GoalKind) -> list[inspect.Parameter]:
    """The option of a kind's values, and that of their weights."""
    text = f"The weight of each {kind.option}, in the same order. [dim]1[/]"
    weight = typer.Option(parser=number, metavar="X", help=text, rich_help_panel=_PANEL)
    return [
        _repeated(kind.name, kind, kind.help),
        _parameter(f"{kind.name}_weight", Annotated[list[float] | None, weight]),
    ]


def _repeated(name: str, kind: GoalKind, text: str) -> inspect.Parameter:
    """An option that may be given more than once."""
    option = typer.Option(metavar=kind.gives.value, help=f"{text} May be repeated.", rich_help_panel=_PANEL)
    if kind.gives is Gives.WORDS:
        return _parameter(name, Annotated[list[str] | None, option])
    return _parameter(name, Annotated[list[Path] | None, option])


def _parameter(name: str, annotation: Any) -> inspect.Parameter:
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=annotation)
