"""Reader of palette files of many programs, as colours in file order; imports no tensor library.

Formats are recognised by content, not by name. The reader guesses nothing: it refuses a colour in CMYK (which
needs a printer's profile), a transparent colour, or a colour that is written in two ways; the message gives its
number.

Sources: the comments of Scribus' and GIMP's importers (.ase); GIMP's "GPL palette format"
(app/core/gimppalette-load.c).
"""

import csv
import itertools
import json
import math
import re
import struct
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from frida_painter import storage
from frida_painter.errors import ConfigError

Color = tuple[float, float, float]
"""sRGB in [0, 1]."""

FORMS = (
    'a palette is a JSON file like {"paints": ["#f2e9dc", "#3b2f2a"]}, a list of such colours (one a line, or CSV), a '
    "palette of GIMP (.gpl), Adobe (.ase), Paint.NET (.txt) or JASC (.pal), or a picture of its colours, in the order "
    "of the wells"
)
_WHAT = "a palette"
_MAX_BYTES = 2**20
_MAX_FAULTS = 3  # in one message
_HEX = re.compile(r"(?:[0-9a-f]{3}|[0-9a-f]{6}|[0-9a-f]{8})")
_NUMBER = re.compile(r"(?<![\w.#-])(?:\d+(?:\.\d*)?|\.\d+)(?![\w.])")
_LISTS = ("paints", "colors", "colours", "palette", "swatches")
_WRITTEN = ("hex", "hexcode", "html", "color", "colour", "value", "code")
_BANDS = (("r", "g", "b"), ("red", "green", "blue"))


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
    if first.startswith("GIMP Palette"):
        return _gpl(first.splitlines())
    if first.startswith("JASC-PAL"):
        return _jasc(first.splitlines())
    return _list(text.splitlines())


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


def _plural(faults: Iterable[str]) -> _Fault:
    told = list(itertools.islice(faults, _MAX_FAULTS))
    return _Fault(f"is not a palette: {' '.join(told)}".removesuffix("."))


def _hex(text: Any, *, opacity_first: bool) -> Color:
    """Converts "#b97f2c", "b97f2c", "#b72" or "0xB97F2C" to sRGB.

    opacity_first: True if the first two of eight digits are the opacity; else the last two are
    Raises ConfigError for any other text and for a colour that is not opaque.
    """
    given = text.strip().lower() if isinstance(text, str) else ""
    digits = given.removeprefix("#").removeprefix("0x")
    marked = given != digits
    # Without a mark, three digits are a number, and the opacity in eight digits is ambiguous.
    if _HEX.fullmatch(digits) is None or (len(digits) != 6 and not marked and not opacity_first):
        raise ConfigError(f"{str(text)[:20]!r} is not a colour; write it like #b97f2c.")
    if len(digits) == 3:
        digits = "".join(2 * digit for digit in digits)
    if len(digits) == 8:
        opacity, digits = (digits[:2], digits[2:]) if opacity_first else (digits[6:], digits[:6])
        if opacity != "ff":
            raise ConfigError(f"{str(text)[:20]!r} is not opaque, and paint is; write it like #b97f2c.")
    red, green, blue = (int(digits[at : at + 2], 16) / 255 for at in (0, 2, 4))
    return red, green, blue


class _Numbers:
    """Colours of three numbers each: from 0 to 255 if all are integers, else from 0 to 1."""

    def __init__(self) -> None:
        self._whole = True
        self._found: list[tuple[str, Color]] = []

    def add(self, where: str, bands: Sequence[Any]) -> int:
        """Adds a colour and returns its index. Raises _Fault if `bands` are not three numbers."""
        values = [float(band) for band in bands if isinstance(band, int | float) and not isinstance(band, bool)]
        if len(values) != 3 or len(bands) != 3 or not all(math.isfinite(value) for value in values):
            raise _Fault(f"{where}: {str(list(bands))[:30]} are not three numbers.")
        self._whole = self._whole and all(value.is_integer() for value in values)
        self._found.append((where, (values[0], values[1], values[2])))
        return len(self._found) - 1

    def color(self, number: int) -> Color:
        """Returns the colour at an index; call it after all `add`. Raises _Fault if it is out of range."""
        where, (red, green, blue) = self._found[number]
        most = 255 if self._whole else 1
        if not all(0 <= band <= most for band in (red, green, blue)):
            raise _Fault(f"{where}: {red:g}, {green:g}, {blue:g} are not from 0 to {most}.")
        return red / most, green / most, blue / most


def _resolve(found: list[Color | int], numbers: _Numbers, faults: list[str]) -> list[Color]:
    """Returns the colours, with indices into `numbers` resolved. Raises _Fault that names all faults."""
    colors = []
    for one in found:
        try:
            colors.append(numbers.color(one) if isinstance(one, int) else one)
        except _Fault as fault:
            faults.append(str(fault))
    if faults:
        raise _plural(faults)
    return colors


def _json(text: str) -> list[Color]:
    try:
        record = json.loads(text)
    except (ValueError, RecursionError) as cause:
        raise _Fault(f"is not JSON ({cause})") from cause
    entries = _find_list(record)
    if entries is None:
        raise _Fault("is not a palette")
    found: list[Color | int] = []
    faults: list[str] = []
    numbers = _Numbers()
    for number, entry in enumerate(entries, 1):
        where = f"paint {number}"
        value = _value(entry)
        try:
            if isinstance(value, list):
                found.append(numbers.add(where, value))
            else:
                found.append(_hex(value, opacity_first=False))
        except ConfigError as error:
            faults.append(f"{where}: {error}")
        except _Fault as fault:
            faults.append(str(fault))
    return _resolve(found, numbers, faults)


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
    return named if named and not inner and all(isinstance(value, str | list) for value in named) else None


def _value(entry: Any) -> Any:
    """Returns the colour of an entry: a text, or a list of three numbers."""
    if not isinstance(entry, dict):
        return entry
    known = {str(key).lower(): value for key, value in entry.items()}
    for bands in _BANDS:
        if set(bands) <= set(known):
            return [known[band] for band in bands]
    value = next((known[key] for key in (*_WRITTEN, "rgb") if key in known), None)
    return _value(value) if isinstance(value, dict) else value


def _gpl(lines: Sequence[str]) -> list[Color]:
    colors, faults = [], []
    for number, line in enumerate(lines[1:], 2):
        if not line.strip() or line.lstrip().startswith("#") or re.match(r"\s*[A-Za-z]+\s*:", line):
            continue
        row = re.match(r"\s*(\d+)[\s,]+(\d+)[\s,]+(\d+)(?=\s|$)", line)
        if row is None or not all(int(band) <= 255 for band in row.groups()):
            faults.append(f"line {number}: {line.strip()[:30]!r} is not a colour; write three numbers from 0 to 255.")
        else:
            red, green, blue = (int(band) / 255 for band in row.groups())
            colors.append((red, green, blue))
    if faults:
        raise _plural(faults)
    return colors


def _jasc(lines: Sequence[str]) -> list[Color]:
    rows = [line.split() for line in lines[2:] if line.strip()]
    if not rows or len(rows[0]) != 1 or rows[0][0] != str(len(rows) - 1):
        raise _Fault(f"is damaged: it has {max(len(rows) - 1, 0)} colours and says otherwise")
    numbers = _Numbers()
    try:
        found: list[Color | int] = [
            numbers.add(f"paint {number}", [int(band) for band in row[:3]]) for number, row in enumerate(rows[1:], 1)
        ]
    except ValueError as error:
        raise _Fault(f"is not a palette: {error}") from error
    return _resolve(found, numbers, [])


def _list(lines: Sequence[str]) -> list[Color]:
    """Returns the colours of lines with or without names, or of a table whose first line names the columns."""
    head = next((line for line in lines if line.strip()), "")
    opacity_first = any(line.lower().lstrip("; ").startswith("paint.net") for line in lines[:3])
    columns = _columns(head)
    found: list[Color | int] = []
    faults: list[str] = []
    numbers = _Numbers()
    for number, line in enumerate(lines, 1):
        said = line.strip()
        if not said or said.startswith((";", "//")) or re.match(r"#(\s|#|!|$)", said) or (columns and line is head):
            continue
        where = f"line {number}"
        try:
            written = _cells(line, head, columns) if columns else _parse_line(said)
            if isinstance(written, list):
                found.append(numbers.add(where, written))
            else:
                found += [_hex(color, opacity_first=opacity_first) for color in written]
        except ConfigError as error:
            faults.append(f"{where}: {error}")
        except (_Fault, ValueError) as fault:
            told = str(fault)
            faults.append(told if told.startswith("line") else f"{where}: {said[:30]!r} is not a colour.")
    return _resolve(found, numbers, faults)


def _split(line: str, head: str) -> list[str]:
    """Returns the cells of a line in a table with the first line `head`."""
    try:
        return next(csv.reader([line], delimiter=max("\t;,", key=head.count)), [])
    except csv.Error:
        return []


def _columns(head: str) -> tuple[int, ...] | None:
    """Returns the column of the colour, or the three columns of its bands; None if `head` names no columns."""
    names = [cell.strip().lower() for cell in _split(head, head)]
    for bands in _BANDS:
        if set(bands) <= set(names):
            return tuple(names.index(band) for band in bands)
    return next(((names.index(name),) for name in _WRITTEN if name in names), None)


def _cells(line: str, head: str, columns: tuple[int, ...]) -> tuple[str, ...] | list[float]:
    cells = _split(line, head)
    if not max(columns) < len(cells):
        raise ValueError("too few cells")
    return (cells[columns[0]],) if len(columns) == 1 else [float(cells[column]) for column in columns]


def _parse_line(line: str) -> tuple[str, ...] | list[float]:
    """Returns the colours of a line without columns: hexadecimal texts, or three numbers."""
    marked = re.findall(r"(?:#|\b0x)\w+", line.lower())
    if marked:
        return tuple(marked)
    words = [word for word in re.split(r"[\s,;\"'\[\]:]+", line.lower()) if word]
    bare = [word for word in words if re.fullmatch(r"[0-9a-f]{6}|[0-9a-f]{8}", word)]
    if len(bare) > 1 and len(bare) < len(words):  # "facade" may be a name
        bare = [word for word in bare if not word.isalpha()]
        if len(bare) != 1:
            raise ValueError("which of its words are colours?")
    numbers = [float(number) for number in _NUMBER.findall(line)]
    if not bare and len(numbers) != 3:
        raise ValueError("neither one nor the other")
    return tuple(bare) if bare else numbers


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
            color = _from_lab(100 * lightness, a, b)
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


def _from_lab(lightness: float, a: float, b: float) -> Color:
    """Converts CIE L*a*b* of the profile connection space (D50) to clipped sRGB (Bradford adaptation, ICC.1)."""
    y = (lightness + 16) / 116
    x, y, z = (
        white * (root**3 if root > 6 / 29 else 3 * (6 / 29) ** 2 * (root - 4 / 29))
        for white, root in ((0.96422, y + a / 500), (1.0, y), (0.82521, y - b / 200))
    )
    linear = (
        3.1338561 * x - 1.6168667 * y - 0.4906146 * z,
        -0.9787684 * x + 1.9161415 * y + 0.0334540 * z,
        0.0719453 * x - 0.2289914 * y + 1.4052427 * z,
    )
    red, green, blue = (
        min(max(12.92 * part if part <= 0.0031308 else 1.055 * part ** (1 / 2.4) - 0.055, 0.0), 1.0) for part in linear
    )
    return red, green, blue
