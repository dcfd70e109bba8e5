"""Fields of a painting's description as a person writes them, and their faults in the words of the command line.

This module loads no tensors.
"""

import math
import re
from collections.abc import Callable, Mapping
from difflib import get_close_matches
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import AfterValidator, BeforeValidator, PlainSerializer
from pydantic.fields import FieldInfo

from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import ConfigError, ImageError
from frida_painter.palette_file import is_palette_file, read_colors
from frida_painter.runs.goal_item import GoalItem
from frida_painter.runs.shares import AUTO, parse_brushes, parse_families
from frida_painter.session.replan_policy import parse_replan_policy

_T = TypeVar("_T")
_R = TypeVar("_R")

# Faults of a description, in the words of the command line.


def sentence_on(fault: Any, fields: Mapping[str, FieldInfo]) -> str:
    """Returns a fault of pydantic in the words of the command line."""
    message = fault["msg"].removeprefix("Value error, ").removesuffix(".")
    if not fault["loc"]:
        return message
    field = str(fault["loc"][0])
    if fault["type"] == "extra_forbidden":
        near = get_close_matches(field, fields, 3)
        known = f"near it is {' or '.join(near)}" if near else "there are " + ", ".join(sorted({*fields} - {"version"}))
        return f"{field[:40]!r} is not a setting; {known}"
    name = f"--{field.replace('_', '-')}"
    if fault["type"] == "value_error":
        return message if field in ("goal", "initial") or message.startswith(name) else f"{name}: {message}"
    if field not in fields or len(fault["loc"]) > 1:
        return f"{name}: {message}"
    return f"{name} was given {_shortly(fault['input'])}; it is {_list_allowed(fields[field])}"


def _list_allowed(field: FieldInfo) -> str:
    """Returns the allowed values of a setting, in words."""
    bounds = {name: getattr(part, name) for part in field.metadata for name in ("ge", "le") if hasattr(part, name)}
    choices = getattr(field.annotation, "__args__", ()) if "Literal" in str(field.annotation) else ()
    if choices:
        return f"one of {', '.join(map(str, choices))}"
    if not bounds:
        return "true or false" if field.annotation in (bool, bool | None) else "a name or a path"
    kind = "a number" if field.annotation in (float, float | None) else "a whole number"
    if "le" not in bounds:
        return f"{kind} of at least {bounds['ge']}"
    return f"{kind} from {bounds['ge']} to {bounds['le']}"


def _shortly(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 40 else f"{text[:37]}..."


# Fields of a description as a person writes them: a canvas, a colour, a file, a replan policy.

NAMED_PAINTS = ("acrylics", "any")
"""Values of paints that are not the name of a file."""
OF_SCENE = "scene"
"""Internal value of a ground: the colour around the things of a scene."""
_FURTHEST, _MAX_TURNED = 0.05, 15.0
_LIGHTEST_DARK = 0.4  # largest channel of the darkest paint in sRGB


def millimetres_and_degrees(text: str | None) -> tuple[float, float, float] | None:
    """Parses a placement error: "4mm,2deg" is right and turn, "3mm,-2mm,1deg" is right, up and turn.

    The turn is counter-clockwise. Returns metres right, metres up and radians; None for None.
    Raises ConfigError.
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
    if not (math.hypot(x, y) <= _FURTHEST and abs(turn) <= _MAX_TURNED):
        raise ConfigError(
            f"--placement-error was given {text[:40]!r}; at most {_FURTHEST * 1000:g} mm and {_MAX_TURNED:g} degrees "
            "can be corrected."
        )
    return x, y, math.radians(turn)


def _read(parse: Callable[[_T], _R], value: _T) -> _R:
    """Returns the result of a parser. Raises ValueError for its ConfigError, as pydantic expects."""
    try:
        return parse(value)
    except ConfigError as error:
        raise ValueError(str(error)) from error


def _canvas(value: Any) -> CanvasSize:
    return value if isinstance(value, CanvasSize) else _read(CanvasSize.parse, str(value))


def _millimetres(size: CanvasSize) -> str:
    return f"{size.width * 1000:g}x{size.height * 1000:g}mm"


def _path(value: Any) -> Any:
    return Path(value) if isinstance(value, str) and value else value


def _whole_path(path: Path | None) -> str | None:
    return None if path is None else str(path.resolve())


def _placement(text: str | None) -> str | None:
    _read(millimetres_and_degrees, text)
    return text


def ground_color(ground: str) -> tuple[float, float, float] | None:
    """Returns the colour of "white" or "#c8a878" as sRGB in [0, 1]; None if the planner chooses it."""
    if ground in (AUTO, OF_SCENE):
        return None
    return (1.0, 1.0, 1.0) if ground == "white" else rgb(ground)


def rgb(color: str) -> tuple[float, float, float]:
    """Returns a colour such as "#c8a878" as sRGB in [0, 1]."""
    red, green, blue = (int(color[at : at + 2], 16) / 255 for at in (1, 3, 5))
    return red, green, blue


def _hex(value: Any) -> Any:
    """Returns 3 numbers in [0, 1] as "#rrggbb"; other values as they are."""
    parts = value.tolist() if hasattr(value, "tolist") else value
    if not isinstance(parts, list | tuple) or len(parts) != 3:
        return value
    if not all(isinstance(part, float | int) and 0 <= part <= 1 for part in parts):
        raise ValueError(f"{str(parts)[:40]} is not a colour; its 3 numbers are in [0, 1]")
    return "#" + "".join(f"{round(255 * part):02x}" for part in parts)


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


def _paints(value: Any) -> Any:
    return str(value) if isinstance(value, Path) else value


def _whole_paints(paints: str) -> str:
    return paints if paints in NAMED_PAINTS else str(Path(paints).resolve())


def _policy(text: str | None) -> str | None:
    if text is not None:
        _read(parse_replan_policy, text)
    return text


Brushes = Annotated[str | None, BeforeValidator(parse_brushes)]
Families = Annotated[str | None, BeforeValidator(parse_families)]
Ground = Annotated[str | None, BeforeValidator(_hex), AfterValidator(_ground)]
Focus = Literal["faces", "none"]
DarkestPaint = Annotated[str | None, BeforeValidator(_hex), AfterValidator(_darkest)]
PaintsInUse = Annotated[str, BeforeValidator(_paints), PlainSerializer(_whole_paints, when_used="json")]
Policy = Annotated[str | None, AfterValidator(_policy)]
Canvas = Annotated[CanvasSize, BeforeValidator(_canvas), PlainSerializer(_millimetres)]
File = Annotated[Path | None, BeforeValidator(_path), PlainSerializer(_whole_path, when_used="json")]
Placement = Annotated[str | None, AfterValidator(_placement)]


def canvas_of(workspace: Path) -> CanvasSize:
    """Returns the canvas of a workspace file. Raises ConfigError."""
    from frida_painter.hardware.workcell import WorkcellConfig  # loads tensors

    size = WorkcellConfig.load(workspace).canvas
    return CanvasSize.parse(f"{size.width * 1000:.3f}x{size.height * 1000:.3f}mm")


def paints_of(palette: Path) -> int:
    """Returns the number of paints in a palette file or picture.

    Raises ConfigError for a photograph of any other thing.
    """
    if is_palette_file(palette):
        return len(read_colors(palette))
    from frida_painter.perception.color import read_palette  # loads tensors

    try:
        return len(read_palette(palette, None))
    except ImageError as error:
        raise ConfigError(str(error)) from error


def _goal_items(value: Any) -> Any:
    """Returns goal items from tables of a TOML file ({"text": "a lemon", "weight": 2}); others stay as they are."""
    return tuple(map(GoalItem.of, value)) if isinstance(value, list | tuple) else value


def _plain(items: tuple[GoalItem, ...], *, beginning: bool) -> tuple[GoalItem, ...]:
    return tuple(_read(partial(GoalItem.plain, beginning=beginning), item) for item in items)


Items = Annotated[tuple[GoalItem, ...], BeforeValidator(_goal_items), AfterValidator(partial(_plain, beginning=False))]
InitialItems = Annotated[
    tuple[GoalItem, ...], BeforeValidator(_goal_items), AfterValidator(partial(_plain, beginning=True))
]
