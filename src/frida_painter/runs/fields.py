"""Fields of a painting's description as a person writes them: a canvas, a colour, a file, a replan policy."""

import math
import re
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, PlainSerializer

from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import ConfigError, ImageError
from frida_painter.palette_file import is_palette_file, read_colors
from frida_painter.session.replan_policy import replan_policy_named

MOST_LAYERS = 8
AUTO = "auto"
"""Leaves a ground or brushes to the planner."""
OF_SCENE = "scene"
"""A ground that nobody names: the colour around the things of a scene."""
_FURTHEST, _MOST_TURNED = 0.05, 15.0
_LIGHTEST_DARK = 0.4  # of sRGB, that a band of the darkest paint may have


def millimetres_and_degrees(text: str | None) -> tuple[float, float, float] | None:
    """ "4mm,2deg" as 4 mm to the right and 2 degrees counter-clockwise, "3mm,-2mm,1deg" as right, up and turn.

    Returns metres right, metres up and radians; None where nothing was given. Raises ConfigError.
    """
    if text is None:
        return None
    number = r"\s*([+-]?(?:\d+(?:\.\d+)?|\.\d+))\s*"
    match = re.fullmatch(rf"{number}mm\s*(?:,{number}mm\s*)?,{number}deg\s*", str(text).lower())
    if match is None:
        raise ConfigError(
            f"--placement-error was given {str(text)[:40]!r}; it is millimetres to the right, millimetres up and "
            "degrees, like 4mm,2deg or 3mm,-2mm,1.5deg."
        )
    x, y, turn = float(match[1]) / 1000, float(match[2] or 0) / 1000, float(match[3])
    if not (math.hypot(x, y) <= _FURTHEST and abs(turn) <= _MOST_TURNED):
        raise ConfigError(
            f"--placement-error was given {text[:40]!r}; at most {_FURTHEST * 1000:g} mm and {_MOST_TURNED:g} degrees "
            "can be corrected."
        )
    return x, y, math.radians(turn)


def _canvas(value: Any) -> CanvasSize:
    if isinstance(value, CanvasSize):
        return value
    try:
        return CanvasSize.parse(str(value))
    except ConfigError as error:
        raise ValueError(str(error)) from error


def _millimetres(size: CanvasSize) -> str:
    return f"{size.width * 1000:g}x{size.height * 1000:g}mm"


def _path(value: Any) -> Any:
    return Path(value) if isinstance(value, str) and value else value


def _whole_path(path: Path | None) -> str | None:
    return None if path is None else str(path.resolve())


def _placement(text: str | None) -> str | None:
    try:
        millimetres_and_degrees(text)
    except ConfigError as error:
        raise ValueError(str(error)) from error
    return text


def ground_color(ground: str) -> tuple[float, float, float] | None:
    """The colour of "white" or "#c8a878", sRGB in [0, 1]; None for one that the planner chooses."""
    if ground in (AUTO, OF_SCENE):
        return None
    return (1.0, 1.0, 1.0) if ground == "white" else rgb(ground)


def rgb(color: str) -> tuple[float, float, float]:
    """ "#c8a878" as sRGB in [0, 1]."""
    red, green, blue = (int(color[at : at + 2], 16) / 255 for at in (1, 3, 5))
    return red, green, blue


def _ground(text: str | None) -> str | None:
    if text is None:
        return None
    ground = text.strip().lower()
    if ground not in (AUTO, "white") and not _is_color(ground):
        raise ValueError(f"{text[:40]!r} is not a ground; give auto, white, or a colour such as #c8a878")
    return ground


def _darkest(text: str | None) -> str | None:
    if text is None:
        return None
    color = text.strip().lower()
    if not _is_color(color):
        raise ValueError(f"{text[:40]!r} is not a colour; give one such as #202020")
    if max(rgb(color)) > _LIGHTEST_DARK:
        raise ValueError(
            f"{color} is light, and no paint would be planned that is darker in any band; give the colour of your "
            f"darkest paint, at most {round(255 * _LIGHTEST_DARK)} of 255 in each band"
        )
    return color


def _is_color(text: str) -> bool:
    return re.fullmatch("#[0-9a-f]{6}", text) is not None


def _policy(text: str | None) -> str | None:
    try:
        if text is not None:
            replan_policy_named(text)
    except ConfigError as error:
        raise ValueError(str(error)) from error
    return text


def brush_shares(text: str) -> tuple[tuple[str, float | None], ...]:
    """ "broad:60%,fine:40%" as brushes with their shares in (0, 1], None where none are given; raises ValueError.

    A brush is a name or a file; what it is, is not looked at.
    """
    found = []
    for part in text.split(","):
        name, colon, share = part.strip().rpartition(":") if part.rstrip().endswith("%") else (part.strip(), "", "")
        if not name:
            raise ValueError(f"{text[:60]!r} names no brush at one place; write broad or broad:60%,medium:40%")
        if not colon and re.fullmatch(r".+:\s*(\d[\d.]*|inf|nan)", part.strip()):
            raise ValueError(f"{part.strip()[:40]!r} is no share; write it in percent, as broad:60%,medium:40%")
        try:
            found.append((name.strip(), float(share.rstrip("%")) / 100 if colon else None))
        except ValueError as error:
            raise ValueError(
                f"the share {share[:20]!r} of {name[:40]!r} is not a number; write broad:60%,medium:40%"
            ) from error
    shares = [share for _, share in found if share is not None]
    if shares and len(shares) < len(found):
        raise ValueError("some brushes have a share and some have none; give shares to all of them or to none")
    if any(not 0 < share <= 1 for share in shares):
        raise ValueError("a share is above 0 % and at most 100 %; leave brushes out that paint nothing")
    if shares and not abs(sum(shares) - 1) <= 0.005:
        raise ValueError(f"the shares make {100 * sum(shares):g} %; together they make 100 %")
    if len(found) > MOST_LAYERS:
        raise ValueError(f"{len(found)} brushes were given; there are at most {MOST_LAYERS} layers")
    return tuple(found)


def _brushes(value: Any) -> Any:
    """As a TOML file may have them: a text, or a list of texts."""
    if isinstance(value, list | tuple) and all(isinstance(part, str) for part in value):
        value = ",".join(value)
    if isinstance(value, str) and value:
        names = [name for name, _ in brush_shares(value)]
        if AUTO in names and value.strip() != AUTO:
            raise ValueError(
                f"{value[:60]!r} names brushes and leaves them to the planner; write {AUTO}, or names alone"
            )
    return value


Brushes = Annotated[str | None, BeforeValidator(_brushes)]
Ground = Annotated[str | None, AfterValidator(_ground)]
Focus = Literal["faces", "subject", "none"]
DarkestPaint = Annotated[str | None, AfterValidator(_darkest)]
Policy = Annotated[str | None, AfterValidator(_policy)]
Canvas = Annotated[CanvasSize, BeforeValidator(_canvas), PlainSerializer(_millimetres)]
File = Annotated[Path | None, BeforeValidator(_path), PlainSerializer(_whole_path, when_used="json")]
Placement = Annotated[str | None, AfterValidator(_placement)]


def canvas_of(workspace: Path) -> CanvasSize:
    """The canvas of a workspace file. Raises ConfigError."""
    from frida_painter.hardware.workcell import WorkcellConfig  # with it come tensors

    size = WorkcellConfig.load(workspace).canvas
    return CanvasSize.parse(f"{size.width * 1000:.3f}x{size.height * 1000:.3f}mm")


def paints_of(palette: Path) -> int:
    """The number of paints of a palette's file or picture. Raises ConfigError for a photograph, which shows any."""
    if is_palette_file(palette):
        return len(read_colors(palette))
    from frida_painter.perception.swatches import read_palette  # with it come tensors

    try:
        return len(read_palette(palette, None))
    except ImageError as error:
        raise ConfigError(str(error)) from error
