"""The options of `paint` and `plan`, made from RunSpec and the kinds of goals, and what they say read back into one."""

from collections.abc import Callable, Mapping
from functools import wraps
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import Annotated, Any, get_args

import typer
from pydantic.fields import FieldInfo

from frida_painter.cli import goal_options
from frida_painter.cli.wells import PaletteOption
from frida_painter.errors import ConfigError
from frida_painter.options import (
    CameraOption,
    PaceOption,
    PlacementErrorOption,
    RobotOption,
    WorkspaceOption,
    number,
    out_folder,
    whole_number,
)
from frida_painter.runs.spec import RunSpec

TAKEN = frozenset(RunSpec.model_fields) - {"goal", "clip", "pictures"} | {
    "photo",
    "settings",
    "out",
    "ask",
    "yes",
    "candidates",
    "brush",
}
"""Names of options that no kind of goal can have."""
_PLAN = (
    *("strokes", "layers", "colors", "canvas", "fit", "ground", "brushes", "new_paints", "darkest", "focus"),
    *("sharpness", "render_height", "effort", "seed"),
)
_PAINT = ("minutes", "replans", "replan_policy", "drying", "timelapse_frames")

Photo = Annotated[
    Path | None,
    typer.Argument(
        metavar="[PHOTO]", help="The picture to paint: a JPEG, PNG, WebP, TIFF, BMP or GIF file.", show_default=False
    ),
]
SettingsFile = Annotated[
    Path | None,
    typer.Option("--settings", metavar="FILE", help="A TOML file with these settings, for example: strokes = 300"),
]
Out = Annotated[
    Path | None,
    typer.Option(parser=out_folder, metavar="FOLDER", help="The output folder. [dim]paintings/NAME-DATE-TIME[/]"),
]
CalibrationFile = Annotated[
    Path | None,
    typer.Option(
        "--calibration", metavar="FILE", help="The calibration record of the easel. [dim]the virtual studio's own[/]"
    ),
]
ArmMeshes = Annotated[
    Path | None,
    typer.Option(
        "--arm-meshes",
        metavar="FOLDER",
        help="A folder with meshes of the Sawyer arm (OBJ or STL), for the film of the arm. [dim]built-in capsules[/]",
    ),
]
Film = Annotated[bool, typer.Option("--film/--no-film", help="Make a timelapse film of the painting.")]
OnCanvas = Annotated[
    bool,
    typer.Option(
        "--on-canvas",
        help="Begin on what is on the canvas: a toned ground, an old painting, or what you have painted. The light is "
        "known from the canvas calibration, which saw a bare canvas.",
    ),
]
StudioCanvas = Annotated[
    Path | None,
    typer.Option(
        "--studio-canvas",
        metavar="FILE",
        help="A picture of what is on the canvas of the virtual studio at first. [dim]a bare canvas[/]",
    ),
]
_EASEL: Mapping[str, tuple[Any, Any]] = {
    "robot": (RobotOption, RunSpec.model_fields["robot"].default),
    "camera": (CameraOption, ""),
    "workspace": (WorkspaceOption, None),
    "calibration": (CalibrationFile, None),
    "placement_error": (PlacementErrorOption, None),
    "pace": (PaceOption, RunSpec.model_fields["pace"].default),
    "arm_meshes": (ArmMeshes, None),
    "on_canvas": (OnCanvas, False),
    "studio_canvas": (StudioCanvas, None),
    "film": (Film, RunSpec.model_fields["film"].default),
}


def planning_options() -> list[Parameter]:
    """What a plan can be asked for."""
    return [
        *goal_options.free_goal_options(TAKEN),
        *(_keyword(name, _option(RunSpec.model_fields[name])) for name in _PLAN),
        _keyword("palette", PaletteOption),
        _keyword("settings", SettingsFile),
        _keyword("out", Out),
    ]


def painting_options() -> list[Parameter]:
    """What a painting can be asked for: all of a plan's, and where and how it is painted."""
    return [
        *planning_options(),
        *(_keyword(name, _option(RunSpec.model_fields[name])) for name in _PAINT),
        *(_keyword(name, option, default) for name, (option, default) in _EASEL.items()),
    ]


def taking(options: list[Parameter], command: Callable[..., None]) -> Callable[..., None]:
    """The command as one that takes these options, by name, beside those that it declares itself."""
    own = [one for one in signature(command, eval_str=True).parameters.values() if one.kind is Parameter.KEYWORD_ONLY]
    every = [*options, *own]

    @wraps(command)
    def with_options(**given: Any) -> None:
        command(**given)

    with_options.__signature__ = Signature(every)  # type: ignore[attr-defined]
    with_options.__annotations__ = {one.name: one.annotation for one in every}
    del with_options.__wrapped__
    return with_options


def spec_of(photo: Path | None, given: Mapping[str, Any]) -> RunSpec:
    """The painting of PHOTO and the options, which go before the TOML file of --settings. Raises ConfigError."""
    defaults = {name: default for name, (_, default) in _EASEL.items()}
    said = {
        name: value
        for name, value in given.items()
        if name in RunSpec.model_fields and value is not None and name != "goal" and value != defaults.get(name)
    }
    asked = goal_options.goal_given(photo, given)
    if asked["goal"] or given["settings"] is None:
        said |= asked
    return RunSpec.from_toml(given["settings"], **said) if given["settings"] else RunSpec.of(**said)


def require_person(spec: RunSpec, *, asked: bool) -> None:
    """Raises ConfigError where a person is to paint and not to be `asked` anything."""
    if spec.by_hand and not asked:
        raise ConfigError("--yes is for scripts, and a person who paints is asked for every stroke; leave it out.")


def _keyword(name: str, annotation: Any, default: Any = None) -> Parameter:
    return Parameter(name, Parameter.KEYWORD_ONLY, default=default, annotation=annotation)


def _option(field: FieldInfo) -> Any:
    """A command-line option for a field of RunSpec; where it is not given, the field's own default holds."""
    more = field.json_schema_extra if isinstance(field.json_schema_extra, dict) else {}
    default = more.get("default", field.default)
    text = f"{field.description} [dim]{default}[/]"
    if field.annotation in (int, int | None):
        return Annotated[int | None, typer.Option(parser=whole_number, metavar="N", help=text)]
    if field.annotation in (float, float | None):
        metavar = str(more.get("metavar", "X"))
        return Annotated[float | None, typer.Option(parser=number, metavar=metavar, help=text)]
    if field.annotation in (bool, bool | None):
        return Annotated[bool | None, typer.Option(help=field.description)]
    choices, names = "|".join(map(str, get_args(field.annotation))), more.get("names")
    written = [str(name) for name in names] if isinstance(names, list) else []
    metavar = str(more.get("metavar", choices))
    return Annotated[str | None, typer.Option(*written, metavar=metavar, help=text)]
