"""How goals are given on the command line: an option for each kind of goal that there is."""

import inspect
import sys
from collections.abc import Collection
from pathlib import Path
from typing import Annotated, Any

import typer

from frida_painter.objectives.kind import Gives, GoalKind, goal_kinds
from frida_painter.options import number

_PANEL = "What to paint"

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


def goal_options() -> list[inspect.Parameter]:
    """The options by which a command takes goals, as keyword parameters for Typer, in the order of its help.

    For every kind NAME its values and weights, NAME and NAME_weight; what is begun with, init_NAME; then goal, a
    file, and clip. `runs.goals.read_goal` reads what they were given.
    """
    kinds = list(goal_kinds().by_name.values())
    options = [parameter for kind in kinds for parameter in _options(kind)]
    options += [_repeated(f"init_{kind.name}", kind, kind.initial_help) for kind in kinds if kind.initial_help]
    return [*options, _parameter("goal", GoalFile), _parameter("clip", ClipSource)]


def free_goal_options(taken: Collection[str]) -> list[inspect.Parameter]:
    """The goal options whose names a command has not `taken` for other options."""
    return [option for option in goal_options() if option.name not in taken]


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
