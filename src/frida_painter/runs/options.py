"""Command line options that several commands share: numbers, output paths, brush, robot, camera, workspace."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer

from frida_painter import registry
from frida_painter.hardware.kinds import CameraKind
from frida_painter.planning.settings import about, help_of
from frida_painter.runs.spec import RunSpec
from frida_painter.system import storage

_Number = TypeVar("_Number", int, float)


def whole_number_within(least: int, most: int) -> Callable[[str], int]:
    """Returns a parser of integers from `least` to `most`. The parser raises typer.BadParameter."""
    return _within(whole_number, least, most)


def number_within(least: float, most: float) -> Callable[[str], float]:
    """Returns a parser of numbers from `least` to `most`. The parser raises typer.BadParameter."""
    return _within(any_number, least, most)


def whole_number_option(least: int, most: int, says: str) -> Any:
    """Returns the option for an integer from `least` to `most`.

    says: its help
    """
    return typer.Option(parser=whole_number_within(least, most), metavar="N", help=says)


def _within(read: Callable[[str], _Number], least: _Number, most: _Number) -> Callable[[str], _Number]:
    def checked(text: str) -> _Number:
        value = read(text)
        if not least <= value <= most:
            raise typer.BadParameter(f"{text[:40]} is not from {least} to {most}")
        return value

    return checked


def whole_number(text: str) -> int:
    """Converts "300" to 300. Raises typer.BadParameter."""
    try:
        return int(text)
    except ValueError as error:
        raise typer.BadParameter(f"{str(text)[:40]!r} is not a whole number, like 300") from error


def any_number(text: str) -> float:
    """Converts "0.5" to 0.5. Raises typer.BadParameter."""
    try:
        return float(text)
    except ValueError as error:
        raise typer.BadParameter(f"{str(text)[:40]!r} is not a number, like 0.5") from error


def out_file(text: str | Path, *, folder: bool = False) -> Path:
    """Reads the path of an output file. Raises StorageError, or typer.BadParameter for an empty path."""
    if not str(text):
        raise typer.BadParameter("it is empty; give a path")
    storage.require_place(Path(text), folder=folder)
    return Path(text)


def out_folder(text: str | Path) -> Path:
    """Reads the path of an output folder. Raises the same errors as `out_file`."""
    return out_file(text, folder=True)


def picture_file(text: str | Path) -> Path:
    """Reads the path of a picture to write. Raises StorageError, or typer.BadParameter for another ending."""
    path = out_file(text)
    if path.suffix.lower() not in (".png", ".jpg", ".jpeg"):
        raise typer.BadParameter(f"{str(path)[-60:]!r} was given; the picture ends in .png or .jpg")
    return path


def listing_option(*declared: str, groups: tuple[str, ...], says: str, **more: Any) -> Any:
    """Returns an option for the name of a part; its help lists the registered parts."""
    known = [part for group in groups for part in registry.parts(group)]
    return typer.Option(*declared, help=f"{says} {', '.join(known)}.", **more)


def setting_option(name: str, parser: Callable[[str], Any] | None = None) -> Any:
    """Returns an option for a setting of a painting, with its help and its default in words."""
    more = about(field := RunSpec.model_fields[name])
    return typer.Option(
        f"--{name.replace('_', '-')}",
        parser=parser,
        help=help_of(field),
        metavar=more["value"] or "X",
        show_default=more["usual"] or True,
    )


def camera_name(text: str) -> str:
    """Returns the name of a camera with an absolute path if the name contains a path. Raises PluginError."""
    name, _, where = text.partition(":")
    known = registry.parts(registry.CAMERAS).get(name)
    if known is None or not where or not known.load(CameraKind).is_path:
        return text
    return f"{name}:{storage.in_home(where).absolute()}"


BrushOption = Annotated[
    str, listing_option("--brush", metavar="NAME", groups=(registry.STROKE_MODELS,), says="The brush. Available:")
]
SeedOption = Annotated[int, typer.Option(parser=whole_number_within(0, 2**31 - 1), metavar="N", help="Random seed.")]
PlanFile = Annotated[
    Path, typer.Argument(metavar="PLAN", help="A plan.json, or the folder of a painting.", show_default=False)
]
PictureOut = Annotated[
    Path, typer.Option(parser=picture_file, metavar="FILE", help="The picture to write, .png or .jpg.")
]
RobotOption = Annotated[str, setting_option("robot")]
CameraOption = Annotated[str, setting_option("camera", parser=camera_name)]
WorkspaceOption = Annotated[Path | None, setting_option("workspace")]
PaceOption = Annotated[float, setting_option("pace", parser=any_number)]
PlacementErrorOption = Annotated[str | None, setting_option("placement_error")]
