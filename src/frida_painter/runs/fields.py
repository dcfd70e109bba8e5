"""Fields of a description as a person writes them, and their faults in the words of the command line.

A canvas, a colour, a file, a placement error, and brushes and stroke families with their shares of the strokes:
"broad:60%,fine+comma:40%". This module loads no tensors.
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
from frida_painter.session.replan_policy import parse_replan_policy

_T = TypeVar("_T")
_R = TypeVar("_R")


def sentence_on(fault: Any, fields: Mapping[str, FieldInfo]) -> str:
    """Returns a fault of pydantic in the words of the command line."""
    message = fault["msg"].removeprefix("Value error, ").removesuffix(".")
    if not fault["loc"]:
        return message
    name = str(fault["loc"][0])
    if fault["type"] == "extra_forbidden":
        near = get_close_matches(name, fields, 3)
        known = f"near it is {' or '.join(near)}" if near else "there are " + ", ".join(sorted({*fields} - {"version"}))
        return f"{name[:40]!r} is not a setting; {known}"
    option = f"--{name.replace('_', '-')}"
    if fault["type"] == "value_error":
        return message if name in ("goal", "initial") or message.startswith(option) else f"{option}: {message}"
    if name not in fields or len(fault["loc"]) > 1:
        return f"{option}: {message}"
    given = repr(fault["input"])
    given = given if len(given) <= 40 else f"{given[:37]}..."
    return f"{option} was given {given}; it is {_list_allowed(fields[name])}"


def limits_of(field: FieldInfo) -> dict[str, float]:
    """Returns the least and the greatest value of a setting as `ge` and `le`, as far as it has them."""
    return {name: getattr(part, name) for part in field.metadata for name in ("ge", "le") if hasattr(part, name)}


def _list_allowed(field: FieldInfo) -> str:
    """Returns the allowed values of a setting, in words."""
    bounds = limits_of(field)
    if "Literal" in str(field.annotation):
        return f"one of {', '.join(map(str, getattr(field.annotation, '__args__', ())))}"
    if not bounds:
        return "true or false" if field.annotation in (bool, bool | None) else "a name or a path"
    kind = "a number" if field.annotation in (float, float | None) else "a whole number"
    return f"{kind} from {bounds['ge']} to {bounds['le']}" if "le" in bounds else f"{kind} of at least {bounds['ge']}"


# Brushes and stroke families, with their shares of the strokes.

MAX_LAYERS = 8
FAMILY_SHARE = 0.4
"""Share of the strokes that stroke families get together if none is named."""
AUTO = "auto"
"""Ground that the planner chooses."""


def brush_shares(text: str) -> tuple[tuple[str, float | None], ...]:
    """Parses brushes such as "broad:60%,fine:40%"; returns names with shares in (0, 1], None without shares.

    A brush is a name or a file, which is not opened here. Raises ValueError.
    """
    found = []
    for part in map(str.strip, text.split(",")):
        name, colon, share = part.rpartition(":") if part.endswith("%") else (part, "", "")
        if not name:
            raise ValueError(f"{text[:60]!r} names no brush at one place; write broad or broad:60%,medium:40%")
        if not colon and re.fullmatch(r".+:\s*(\d[\d.]*|inf|nan)", part):
            raise ValueError(f"{part[:40]!r} is no share; write it in percent, as broad:60%,medium:40%")
        found.append((name.strip(), _share(share, name) if colon else None))
    shares = [share for _, share in found if share is not None]
    if shares and len(shares) < len(found):
        raise ValueError("some brushes have a share and some have none; give shares to all of them or to none")
    if any(not 0 < share <= 1 for share in shares):
        raise ValueError("a share is above 0 % and at most 100 %; leave brushes out that paint nothing")
    if shares and not abs(sum(shares) - 1) <= 0.005:
        raise ValueError(f"the shares make {100 * sum(shares):g} %; together they make 100 %")
    if len(found) > MAX_LAYERS:
        raise ValueError(f"{len(found)} brushes were given; there are at most {MAX_LAYERS} layers")
    return tuple(found)


def family_shares(text: str) -> tuple[tuple[str, float], ...]:
    """Parses families such as "comma:20%,flourish:30%"; returns names or files with shares in (0, 1].

    Without shares, they get 40 % together. Raises ValueError.
    """
    parts = [part.strip() for part in text.split(",")]
    if "%" not in text:
        parts = [f"{name}:{100 * FAMILY_SHARE / len(parts)}%" for name in parts]
    found = []
    for part in parts:
        name, colon, share = part.rpartition(":")
        if not (colon and name.strip() and "+" not in name and share.endswith("%") and _share(share, name) > 0):
            raise ValueError(f"{part[:40]!r} is no family with a share above 0 %; write comma:20%,flourish:30%")
        found.append((name.strip(), _share(share, name)))
    if not sum(share for _, share in found) <= 1:
        raise ValueError(f"the families get {100 * sum(share for _, share in found):g} %; it is at most 100 %")
    return tuple(found)


def _share(percent: str, name: str) -> float:
    try:
        return float(percent.rstrip("%")) / 100
    except ValueError as error:
        raise ValueError(
            f"the share {percent[:20]!r} of {name[:40]!r} is not a number; write {name[:40]}:60%"
        ) from error


def brush_file(name: str) -> Path | None:
    """Returns the file that a brush is named by: that of its weights, or of its family ("fine+own.safetensors")."""
    source = name if Path(name).is_file() else name.rpartition("+")[2]
    return Path(source) if Path(source).suffix else None


def _named(parse: Callable[[str], object], value: Any) -> Any:
    """Returns a name, a file or a list of them as one text, if they can be parsed; other values as they are."""
    several = value if isinstance(value, list | tuple) and value else [value]
    if all(isinstance(part, str | Path) for part in several):
        value = ",".join(map(str, several))
    if isinstance(value, str) and value:
        parse(value)
    return value


# A canvas, a colour, a file, a replan policy.

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


def _allow(parse: Callable[[str], object], text: str | None) -> str | None:
    """Returns the text as it is, if it can be parsed."""
    if text is not None:
        _read(parse, text)
    return text


def _whole_path(text: str) -> str:
    return text if text in NAMED_PAINTS else str(Path(text).resolve())


def rgb(color: str) -> tuple[float, float, float]:
    """Returns a colour such as "#c8a878", or "white", as sRGB in [0, 1]."""
    if color == "white":
        return 1.0, 1.0, 1.0
    red, green, blue = (int(color[at : at + 2], 16) / 255 for at in (1, 3, 5))
    return red, green, blue


def _hex(value: Any) -> Any:
    """Returns 3 numbers in [0, 1] as "#rrggbb", and a text in small letters; other values as they are."""
    parts = value.tolist() if hasattr(value, "tolist") else value
    if not isinstance(parts, list | tuple) or len(parts) != 3:
        return value.strip().lower() if isinstance(value, str) else value
    if not all(isinstance(part, float | int) and 0 <= part <= 1 for part in parts):
        raise ValueError(f"{str(parts)[:40]} is not a colour; its 3 numbers are in [0, 1]")
    return "#" + "".join(f"{round(255 * part):02x}" for part in parts)


def _is_color(text: str) -> bool:
    return re.fullmatch("#[0-9a-f]{6}", text) is not None


def _ground(ground: str | None) -> str | None:
    if ground is not None and ground not in (AUTO, "white") and not _is_color(ground):
        raise ValueError(f"{ground[:40]!r} is not a ground; give auto, white, or a colour such as #c8a878")
    return ground


def _darkest(color: str | None) -> str | None:
    if color is not None and not _is_color(color):
        raise ValueError(f"{color[:40]!r} is not a colour; give one such as #202020")
    if color is not None and max(rgb(color)) > _LIGHTEST_DARK:
        raise ValueError(
            f"{color} is light, and no paint would be planned that is darker in any band; give the colour of your "
            f"darkest paint, at most {round(255 * _LIGHTEST_DARK)} of 255 in each band"
        )
    return color


def _goal_items(value: Any) -> Any:
    """Returns goal items from tables of a TOML file ({"text": "a lemon", "weight": 2}); others stay as they are."""
    return tuple(map(GoalItem.of, value)) if isinstance(value, list | tuple) else value


def _plain(items: tuple[GoalItem, ...], *, beginning: bool) -> tuple[GoalItem, ...]:
    return tuple(_read(partial(GoalItem.plain, beginning=beginning), item) for item in items)


Brushes = Annotated[str | None, BeforeValidator(partial(_named, brush_shares))]
Families = Annotated[str | None, BeforeValidator(partial(_named, family_shares))]
Ground = Annotated[str | None, BeforeValidator(_hex), AfterValidator(_ground)]
Focus = Literal["faces", "none"]
DarkestPaint = Annotated[str | None, BeforeValidator(_hex), AfterValidator(_darkest)]
PaintsInUse = Annotated[
    str,
    BeforeValidator(lambda value: str(value) if isinstance(value, Path) else value),
    PlainSerializer(_whole_path, when_used="json"),
]
Policy = Annotated[str | None, AfterValidator(partial(_allow, parse_replan_policy))]
Canvas = Annotated[
    CanvasSize,
    BeforeValidator(lambda size: size if isinstance(size, CanvasSize) else _read(CanvasSize.parse, str(size))),
    PlainSerializer(lambda size: f"{size.width * 1000:g}x{size.height * 1000:g}mm"),
]
File = Annotated[
    Path | None,
    BeforeValidator(lambda value: Path(value) if isinstance(value, str) and value else value),
    PlainSerializer(lambda path: None if path is None else str(path.resolve()), when_used="json"),
]
Placement = Annotated[str | None, AfterValidator(partial(_allow, millimetres_and_degrees))]
Items = Annotated[tuple[GoalItem, ...], BeforeValidator(_goal_items), AfterValidator(partial(_plain, beginning=False))]
InitialItems = Annotated[
    tuple[GoalItem, ...], BeforeValidator(_goal_items), AfterValidator(partial(_plain, beginning=True))
]


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
