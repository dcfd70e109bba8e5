"""Fields of a description as a person writes them: canvas, colours, files, and brushes with their shares.

Brushes and stroke families share the strokes: "broad:60%,fine+comma:40%". This module loads no tensors.
"""

import re
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator, PlainSerializer
from pydantic.fields import FieldInfo

from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import ConfigError


def limits_of(field: FieldInfo) -> dict[str, float]:
    """Returns the least and the greatest value of a setting as `ge` and `le`, as far as it has them."""
    return {name: getattr(part, name) for part in field.metadata for name in ("ge", "le") if hasattr(part, name)}


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


# A canvas, a colour, a file.

NAMED_PAINTS = ("acrylics", "any")
"""Values of paints that are not the name of a file."""
OF_SCENE = "scene"
"""Internal value of a ground: the colour around the things of a scene."""
_LIGHTEST_DARK = 0.4  # largest channel of the darkest paint in sRGB


def parse_field(parse: Callable[[Any], Any], value: Any) -> Any:
    """Returns the result of a parser. Raises ValueError for its ConfigError, as pydantic expects."""
    try:
        return parse(value)
    except ConfigError as error:
        raise ValueError(str(error)) from error


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


FACES, EVERYWHERE = "faces", "none"
"""Focus on faces, and none: every place of a picture is worth the same."""
SEVERAL = "several"
"""Mark of a field whose option may be repeated; it takes a list."""


def focus_places(focus: str) -> list[tuple[float, float, float]]:
    """Returns the places of a focus such as "faces 0.4,0.3,0.1": column, row and radius as shares of a picture.

    Raises ValueError for other words, and for shares outside the picture.
    """
    words = [word for word in focus.split() if word != FACES]
    try:
        found = [(float(x), float(y), float(radius)) for x, y, radius in (word.split(",") for word in words)]
    except ValueError:
        found = [] if focus == EVERYWHERE else [(-1, -1, -1)]
    if not focus.strip() or not all(0 <= x <= 1 and 0 <= y <= 1 and 0 < radius <= 1 for x, y, radius in found):
        raise ValueError(
            f"{focus[:40]!r} is not a focus; give faces, none, or a place as X,Y,R: shares of the picture's width "
            "from the left, of its height from the top, and of its shorter side, such as 0.4,0.3,0.1"
        )
    return found


def _focus(value: Any) -> Any:
    text = " ".join(value) if isinstance(value, list | tuple) and all(isinstance(one, str) for one in value) else value
    if isinstance(text, str):
        focus_places(text)
    return text


Named = str | Path | Sequence[str | Path] | None
"""Form of names in Python: one text, or a list of names and files."""
AnyColor = str | Sequence[float] | None
"""Form of a colour in Python: "#c8a878", or 3 numbers in [0, 1]."""

Brushes = Annotated[str | None, BeforeValidator(partial(_named, brush_shares), json_schema_input_type=Named)]
Families = Annotated[str | None, BeforeValidator(partial(_named, family_shares), json_schema_input_type=Named)]
Ground = Annotated[str | None, BeforeValidator(_hex, json_schema_input_type=AnyColor), AfterValidator(_ground)]
Focus = Annotated[str, SEVERAL, BeforeValidator(_focus, json_schema_input_type=str | Sequence[str])]
DarkestPaint = Annotated[str | None, BeforeValidator(_hex, json_schema_input_type=AnyColor), AfterValidator(_darkest)]
PaintsInUse = Annotated[
    str,
    BeforeValidator(lambda value: str(value) if isinstance(value, Path) else value, json_schema_input_type=str | Path),
    PlainSerializer(lambda text: text if text in NAMED_PAINTS else str(Path(text).resolve()), when_used="json"),
]
Canvas = Annotated[
    CanvasSize,
    BeforeValidator(
        lambda size: size if isinstance(size, CanvasSize) else parse_field(CanvasSize.parse, str(size)),
        json_schema_input_type=str | CanvasSize,
    ),
    PlainSerializer(lambda size: f"{size.width * 1000:g}x{size.height * 1000:g}mm"),
]
File = Annotated[
    Path | None,
    BeforeValidator(
        lambda value: Path(value) if isinstance(value, str) and value else value,
        json_schema_input_type=str | Path | None,
    ),
    PlainSerializer(lambda path: None if path is None else str(path.resolve()), when_used="json"),
]
