"""Options of the command line: how a command takes them, and those that several share: numbers, paths, the easel."""

import math
from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass
from functools import wraps
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer

from frida_painter import registry
from frida_painter.hardware.kinds import CameraKind
from frida_painter.planning.settings import about, help_of
from frida_painter.runs.spec import RunSpec
from frida_painter.system import storage

_Number = TypeVar("_Number", int, float)


def with_fields(command: Callable[..., None], *more: Parameter) -> Callable[..., None]:
    """Returns the command for Typer: `more` options, then its own; a dataclass that it takes is an option per field."""
    groups, every = dict[str, Any](), [*more]
    for one in signature(command, eval_str=True).parameters.values():
        if is_dataclass(one.annotation):
            groups[one.name] = one.annotation
            every += signature(groups[one.name], eval_str=True).parameters.values()
        elif one.kind is not Parameter.VAR_KEYWORD:
            every.append(one)

    @wraps(command)
    def spread(**given: Any) -> None:
        said = {name: kind(**{one.name: given.pop(one.name) for one in fields(kind)}) for name, kind in groups.items()}
        command(**said, **given)

    spread.__signature__ = Signature([one.replace(kind=Parameter.KEYWORD_ONLY) for one in every])  # type: ignore[attr-defined]
    spread.__annotations__ = {one.name: one.annotation for one in every}
    del spread.__wrapped__
    return spread


def whole_number_within(least: float, most: float) -> Callable[[str], int]:
    """Returns a parser of integers from `least` to `most`. The parser raises typer.BadParameter."""
    return _reader(int, "a whole number, like 300", least, most)


def number_within(least: float, most: float) -> Callable[[str], float]:
    """Returns a parser of numbers from `least` to `most`. The parser raises typer.BadParameter."""
    return _reader(float, "a number, like 0.5", least, most)


def _reader(kind: Callable[[str], _Number], like: str, least: float, most: float) -> Callable[[str], _Number]:
    def read(text: str) -> _Number:
        try:
            value = kind(text)
        except ValueError as error:
            raise typer.BadParameter(f"{str(text)[:40]!r} is not {like}") from error
        if least > -math.inf and not least <= value <= most:  # without limits, the setting itself refuses NaN
            raise typer.BadParameter(f"{text[:40]} is not from {least} to {most}")
        return value

    return read


whole_number, any_number = whole_number_within(-math.inf, math.inf), number_within(-math.inf, math.inf)


def taking(value: str, says: str, *names: str, **more: Any) -> Any:
    """Returns an option by the word for its value and its help; without names it is named after its parameter."""
    return typer.Option(*names, metavar=value, help=says, **more)


def whole_number_option(least: int, most: int, says: str) -> Any:
    """Returns the option for an integer from `least` to `most`; `says` is its help."""
    return taking("N", says, parser=whole_number_within(least, most))


def out_file(text: str | Path, *, folder: bool = False) -> Path:
    """Reads the path of an output file. Raises StorageError, or typer.BadParameter for an empty path."""
    if not str(text):
        raise typer.BadParameter("it is empty; give a path")
    storage.require_place(Path(text), folder=folder)
    return Path(text)


def out_folder(text: str | Path) -> Path:
    """Reads the path of an output folder. Raises the same errors as `out_file`."""
    return out_file(text, folder=True)


def setting_option(name: str, parser: Callable[[str], Any] | None = None) -> Any:
    """Returns an option for a setting of a painting, with its help and its default in words."""
    more = about(field := RunSpec.model_fields[name])
    return taking(more["value"] or "X", help_of(field), parser=parser, show_default=more["usual"] or True)


def camera_name(text: str) -> str:
    """Returns the name of a camera with an absolute path if the name contains a path. Raises PluginError."""
    name, _, where = text.partition(":")
    known = registry.parts(registry.CAMERAS).get(name)
    if known is None or not where or not known.load(CameraKind).is_path:
        return text
    return f"{name}:{storage.in_home(where).absolute()}"


RobotOption = Annotated[str, setting_option("robot")]
CameraOption = Annotated[str, setting_option("camera", parser=camera_name)]
WorkspaceOption = Annotated[Path | None, setting_option("workspace")]
PaceOption = Annotated[float, setting_option("pace", parser=any_number)]


@dataclass(frozen=True)
class MachineOptions:
    """Machine that paints, and the pace of a simulated one."""

    robot: RobotOption = "virtual"
    camera: CameraOption = ""
    workspace: WorkspaceOption = None
    pace: PaceOption = 0.0
