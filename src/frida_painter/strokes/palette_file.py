"""Reader of palette files, as colours in file order: lists, JSON, GIMP and Adobe; imports no tensor library.

Formats are recognised by content, not by name. The reader guesses nothing: it refuses a colour in CMYK (which
needs a printer's profile), a transparent colour, or a line that may mean two colours; the message gives its number.

Sources: the comments of Scribus' and GIMP's importers (.ase); GIMP's "GPL palette format"
(app/core/gimppalette-load.c).
"""

import json
import re
import struct
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from frida_painter.errors import ConfigError
from frida_painter.system import storage

Color = tuple[float, float, float]
"""sRGB in [0, 1]."""

FORMS = (
    'a palette is a JSON file like {"paints": ["#f2e9dc", "#3b2f2a"]}, a list of such colours, a palette of GIMP '
    "(.gpl) or Adobe (.ase), or a picture of its colours, in the order of the wells"
)
_WHAT = "a palette"
_MAX_BYTES = 2**20
_MAX_FAULTS = 3  # in one message
_LISTS = ("paints", "colors", "colours", "palette", "swatches")
_WRITTEN = ("hex", "hexcode", "html", "color", "colour", "value", "code")


class _Fault(ValueError):
    """Fault of a colour or of the file; the message follows the name of the file."""


def is_palette_file(path: Path) -> bool:
    """Returns True for a palette file (text, .json or .ase), False for a picture.

    Raises ConfigError if the file cannot be read.
    """
    if path.suffix.lower() == ".json":
        return True
    with storage.open_checked(path, _WHAT, storage.MAX_BYTES, ConfigError) as file:
        start = file.read(4096)
    return not start or start[:4] == b"ASEF" or _text(start, cut=True) is not None


def read_colors(path: Path) -> list[Color]:
    """Returns the colours of a palette file in its order. Raises ConfigError that says what a palette is."""
    content = storage.read_bytes(path, _WHAT, _MAX_BYTES, ConfigError)
    try:
        return list(_colors(content, is_json=path.suffix.lower() == ".json"))
    except _Fault as fault:
        raise ConfigError(f"{storage.abridge(path)} {fault}; {FORMS}.") from fault
    except (struct.error, IndexError) as cut:
        raise ConfigError(f"{storage.abridge(path)} is damaged or cut off ({cut}); take an undamaged copy.") from cut


def _colors(content: bytes, *, is_json: bool) -> Iterable[Color]:
    if content[:4] == b"ASEF":
        return _ase(content)
    text = _text(content)
    if text is None:
        raise _Fault("is of an unknown kind")
    first = text.lstrip()
    if is_json or first[:1] in ("{", "["):
        return _json(text)
    return _lines(first.splitlines(), _of_gimp if first.startswith("GIMP Palette") else _of_list)


def _text(content: bytes, *, cut: bool = False) -> str | None:
    """Returns the content as text; None if it is not text.

    cut: True if the content may end within a character
    """
    if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return content.decode("utf-16", "replace")
    if b"\0" in content or any(byte < 9 for byte in content):
        return None
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        if cut and error.start > len(content) - 4:
            return content[: error.start].decode("utf-8-sig")
        if content[:1] >= b"\x80":  # text in Latin-1 begins with an ASCII character; a picture may not
            return None
        return content.decode("latin-1")


def _read_all(entries: Iterable[tuple[str, Any]], read: Callable[[Any], list[Color]]) -> list[Color]:
    """Returns the colours that `read` finds in entries, each with the name of its place. Raises _Fault for them all."""
    colors: list[Color] = []
    faults: list[str] = []
    for where, entry in entries:
        try:
            colors += read(entry)
        except ConfigError as error:
            faults.append(f"{where}: {error}")
    if faults:
        raise _Fault(f"is not a palette: {' '.join(faults[:_MAX_FAULTS])}".removesuffix("."))
    return colors


def _hex(text: Any) -> Color:
    """Converts "#b97f2c", "b97f2c", "#b72" or "0xB97F2C" to sRGB; the last two of eight digits are the opacity.

    Raises ConfigError for any other text and for a colour that is not opaque.
    """
    given = text.strip().lower() if isinstance(text, str) else ""
    digits = given.removeprefix("#").removeprefix("0x")
    # Without a mark, three digits are a number, and programs differ in where the opacity stands.
    sizes = (6,) if given == digits else (3, 6, 8)
    if len(digits) not in sizes or not re.fullmatch("[0-9a-f]+", digits):
        raise ConfigError(f"{str(text)[:20]!r} is not a colour; write it like #b97f2c.")
    if len(digits) == 3:
        digits = "".join(2 * digit for digit in digits)
    if digits[6:] not in ("", "ff"):
        raise ConfigError(f"{str(text)[:20]!r} is not opaque, and paint is; write it like #b97f2c.")
    red, green, blue = (int(digits[at : at + 2], 16) / 255 for at in (0, 2, 4))
    return red, green, blue


def _json(text: str) -> list[Color]:
    try:
        record = json.loads(text)
    except (ValueError, RecursionError) as cause:
        raise _Fault(f"is not JSON ({cause})") from cause
    entries = _find_list(record)
    if entries is None:
        raise _Fault("is not a palette")
    return _read_all(
        ((f"paint {number}", entry) for number, entry in enumerate(entries, 1)), lambda entry: [_hex(_value(entry))]
    )


def _find_list(record: Any) -> list[Any] | None:
    """Returns the list of colours in a JSON value; None if there is none or more than one."""
    if isinstance(record, list):
        return record
    if not isinstance(record, dict):
        return None
    if "paints" in record:  # our own format has no other keys
        return record["paints"] if set(record) == {"paints"} and isinstance(record["paints"], list) else None
    inner = [record[key] for key in _LISTS if isinstance(record.get(key), list | dict)]
    if len(inner) == 1:
        return _find_list(inner[0])
    named = list(record.values())
    return named if named and not inner and all(isinstance(value, str) for value in named) else None


def _value(entry: Any) -> Any:
    """Returns the text of an entry's colour."""
    if not isinstance(entry, dict):
        return entry
    known = {str(key).lower(): value for key, value in entry.items()}
    return _value(next((known[key] for key in _WRITTEN if key in known), None))


def _lines(lines: Sequence[str], read: Callable[[str], list[Color]]) -> list[Color]:
    """Returns the colours of the lines that are neither empty nor comments."""
    numbered = ((f"line {number}", line.strip()) for number, line in enumerate(lines, 1))
    said = (each for each in numbered if each[1] and not re.match(r"(;|//|#(\s|#|!|$))", each[1]))
    return _read_all(said, read)


def _of_gimp(line: str) -> list[Color]:
    """Returns the colour of a line of GIMP's palette: three numbers from 0 to 255, and a name."""
    if line.startswith("GIMP Palette") or re.match(r"[A-Za-z]+\s*:", line):
        return []
    row = re.match(r"(\d+)[\s,]+(\d+)[\s,]+(\d+)(?=\s|$)", line)
    if row is None or not all(int(band) <= 255 for band in row.groups()):
        raise ConfigError(f"{line[:30]!r} is not a colour; write three numbers from 0 to 255.")
    red, green, blue = (int(band) / 255 for band in row.groups())
    return [(red, green, blue)]


def _of_list(line: str) -> list[Color]:
    """Returns the colours of a line: all marked ones like #b97f2c; else words of six digits, perhaps beside a name."""
    marked = re.findall(r"(?:#|\b0x)\w+", line.lower())
    if marked:
        return list(map(_hex, marked))
    words = [word for word in re.split(r"[\s,;\"'\[\]:]+", line.lower()) if word]
    bare = [word for word in words if re.fullmatch(r"[0-9a-f]{6}", word)]
    if len(bare) > 1 and len(bare) < len(words):  # "facade" may be a name
        bare = [word for word in bare if not word.isalpha()]
    if not bare or 1 < len(bare) < len(words):
        raise ConfigError(f"{line[:30]!r} is not a colour; write it like #b97f2c.")
    return list(map(_hex, bare))


def _ase(content: bytes) -> Iterator[Color]:
    (blocks,) = struct.unpack_from(">I", content, 8)
    at, number = 12, 0
    for _ in range(blocks):
        kind, length = struct.unpack_from(">HI", content, at)
        at += 6
        if kind == 1:
            number += 1
            (letters,) = struct.unpack_from(">H", content, at)
            yield _of_model(content[at + 2 + 2 * letters : at + length], number)
        at += length


def _of_model(block: bytes, number: int) -> Color:
    """Returns a colour of an Adobe swatch exchange file; the block starts at the name of its model."""
    match block[:4].strip().upper():
        case b"RGB":
            color = struct.unpack_from(">3f", block, 4)
        case b"LAB":
            lightness, a, b = struct.unpack_from(">3f", block, 4)
            color = tuple(map(_encode, light_of_lab(100 * lightness, a, b)))
        case b"GRAY":
            color = 3 * struct.unpack_from(">f", block, 4)
        case b"CMYK":
            raise _Fault(
                f"has paint {number} in CMYK, which is no colour without its printer's profile; save the swatches as "
                "RGB or Lab"
            )
        case model:
            raise _Fault(f"is not a palette: paint {number} is of the colour model {model!r}, which is not read")
    if not all(-1e-6 <= band <= 1 + 1e-6 for band in color):
        raise _Fault(f"is not a palette: paint {number} has a part outside 0 to 1")
    red, green, blue = (min(max(band, 0.0), 1.0) for band in color)
    return red, green, blue


def light_of_lab(lightness: float, a: float, b: float) -> Color:
    """Converts CIE L*a*b* of the profile connection space (D50) to linear sRGB, unclipped (Bradford, ICC.1)."""
    y = (lightness + 16) / 116
    x, y, z = (
        white * (root**3 if root > 6 / 29 else 3 * (6 / 29) ** 2 * (root - 4 / 29))
        for white, root in ((0.96422, y + a / 500), (1.0, y), (0.82521, y - b / 200))
    )
    return (
        3.1338561 * x - 1.6168667 * y - 0.4906146 * z,
        -0.9787684 * x + 1.9161415 * y + 0.0334540 * z,
        0.0719453 * x - 0.2289914 * y + 1.4052427 * z,
    )


def _encode(light: float) -> float:
    """Converts linear light to sRGB, clipped to [0, 1]."""
    return min(max(12.92 * light if light <= 0.0031308 else 1.055 * light ** (1 / 2.4) - 0.055, 0.0), 1.0)
