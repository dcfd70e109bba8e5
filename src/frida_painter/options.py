"""Command line options that several commands share: numbers, output paths, brush, robot, camera, workspace."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer
from typer.models import OptionInfo

from frida_painter import registry, storage
from frida_painter.hardware.kinds import CameraKind

_Number = TypeVar("_Number", int, float)


def whole_number_within(least: int, most: int) -> Callable[[str], int]:
    """Returns a parser of integers from `least` to `most`. The parser raises typer.BadParameter."""
    return _within(whole_number, least, most)


def number_within(least: float, most: float) -> Callable[[str], float]:
    """Returns a parser of numbers from `least` to `most`. The parser raises typer.BadParameter."""
    return _within(any_number, least, most)


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


def out_file(text: str | Path) -> Path:
    """Reads the path of an output file. Raises StorageError, or typer.BadParameter for an empty path."""
    return _place(text, folder=False)


def out_folder(text: str | Path) -> Path:
    """Reads the path of an output folder. Raises the same errors as `out_file`."""
    return _place(text, folder=True)


def _place(text: str | Path, *, folder: bool) -> Path:
    if not str(text):
        raise typer.BadParameter("it is empty; give a path")
    path = Path(text)
    storage.require_place(path, folder=folder)
    return path


class ListingOption(OptionInfo):
    """Option for the name of a part; its help lists the parts that are registered at that moment."""

    def __init__(self, *declared: str, groups: tuple[str, ...], says: str, **more: Any) -> None:
        super().__init__(default=..., param_decls=declared, **more)
        self._groups, self._says = groups, says

    def __getattribute__(self, name: str) -> Any:
        if name == "help":
            known = [part for group in self._groups for part in registry.parts(group)]
            return f"{self._says} {', '.join(known)}."
        return super().__getattribute__(name)


def camera_name(text: str) -> str:
    """Returns the name of a camera with an absolute path if the name contains a path. Raises PluginError."""
    name, _, where = text.partition(":")
    known = registry.parts(registry.CAMERAS).get(name)
    if known is None or not where or not known.load(CameraKind).is_path:
        return text
    return f"{name}:{storage.in_home(where).absolute()}"


BrushOption = Annotated[
    str,
    ListingOption("--brush", metavar="NAME", groups=(registry.STROKE_MODELS,), says="The brush. Available:"),
]
RobotOption = Annotated[
    str,
    ListingOption(
        "--robot",
        metavar="NAME",
        groups=(registry.EASELS, registry.ROBOTS),
        says="The robot that paints, like virtual or xarm:192.168.1.10. `doctor` shows how to write each "
        "name. sawyer-sim is a physical simulation of the paper's arm. Available:",
    ),
]
CameraOption = Annotated[
    str,
    ListingOption(
        "--camera",
        parser=camera_name,
        metavar="NAME",
        groups=(registry.CAMERAS,),
        says="The camera of a real easel, like opencv:0 or folder:PATH. `doctor` shows how to write each "
        "name. Available:",
    ),
]
WorkspaceOption = Annotated[
    Path | None,
    typer.Option(
        "--workspace",
        metavar="FILE",
        help="The workspace file of a real robot (TOML): where canvas, wells, water and rag stand.",
    ),
]
PaceOption = Annotated[
    float,
    typer.Option(
        "--pace",
        parser=any_number,
        metavar="X",
        help="Seconds that a second of the virtual robot takes. 1 is real time, 0.1 ten times as fast, 0 as fast as "
        "possible.",
    ),
]
PlacementErrorOption = Annotated[
    str | None,
    typer.Option(
        "--placement-error",
        metavar="X,Y,TURN",
        help="Calibration error of the virtual studio: the offset and rotation between its canvas and where "
        "its robot expects the canvas, like 4mm,2deg or 3mm,-2mm,1.5deg. [dim]about 2mm and 0.4deg, by the seed[/]",
    ),
]
