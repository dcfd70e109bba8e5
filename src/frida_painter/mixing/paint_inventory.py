"""The paints that a person owns, from a small TOML file; without one, a set of six that mixes most colours."""

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from frida_painter import storage
from frida_painter.errors import ConfigError
from frida_painter.mixing.paint import WHITE, Paint, PaintDataSource, published, published_names
from frida_painter.palette import from_hex

MOST_PAINTS = 32
SIX = ("titanium white", "hansa yellow", "pyrrole red", "quinacridone magenta", "phthalo blue", "carbon black")
"""Names of the published paints that are taken where nobody says what they own."""
_MOST_BYTES = 2**18
_ENTRIES = ("name", "color", "tint", "white", "over_white", "over_black")
_ADVICE = "docs/how-to/mix.md shows such a file"


def usual_paints() -> tuple[Paint, ...]:
    """The six paints."""
    return tuple(published(name) for name in SIX)


def read_paints(path: Path) -> tuple[Paint, ...]:
    """The paints of a TOML file of [[paint]] entries. Raises ConfigError naming all that is wrong with them.

    An entry has a name, and nothing more where it is that of a published paint; else a color
    ("#rrggbb" of a thick mark), better still with the tint that one part of it gives with `white`
    parts of titanium white, or over_white and over_black of one film.
    """
    values = storage.read_toml(path, "a file of paints (TOML)", _MOST_BYTES, _ADVICE)
    entries = values.get("paint")
    if set(values) != {"paint"} or not isinstance(entries, list) or not 1 <= len(entries) <= MOST_PAINTS:
        raise ConfigError(f"{path} is no file of paints: it has 1 to {MOST_PAINTS} [[paint]] entries; {_ADVICE}.")
    faults: list[str] = []
    paints: list[Paint] = []
    for number, entry in enumerate(entries, 1):
        wrong = list(_faults(number, entry))
        if not wrong:
            try:
                paints.append(_paint(entry))
            except ConfigError as error:
                wrong.append(f"{entry['name']}: {error}")
        faults += wrong
    names = [paint.name for paint in paints]
    faults += [f"{name} is there twice" for name in dict.fromkeys(names) if names.count(name) > 1]
    films = [paint for paint in paints if paint.source is PaintDataSource.films]
    white = next((paint for paint in films if paint.name.lower() == WHITE), None)
    if films and white is None:
        faults.append(f"paints over white and black are measured against {WHITE}: give its over_white and over_black")
    if faults:
        raise ConfigError(f"{path} is no file of paints: {'; '.join(faults)}; {_ADVICE}.")
    if white is None:
        return tuple(paints)
    unit = float(white.scattering.mean())
    return tuple(paint.against(unit) if paint.source is PaintDataSource.films else paint for paint in paints)


def _faults(number: int, entry: Any) -> Iterator[str]:
    """What is wrong with the form of an entry."""
    if not isinstance(entry, dict):
        yield f"paint {number} is no table; write [[paint]] and its entries below"
        return
    name = entry.get("name")
    if not isinstance(name, str) or not 1 <= len(name.strip()) <= 40 or not name.isprintable():
        yield f"paint {number} has no name of 1 to 40 characters"
        return
    for key in entry:
        if key not in _ENTRIES:
            yield f"{name} has {key[:40]!r}, which is not known; there are {', '.join(_ENTRIES)}"
    for key in ("color", "tint", "over_white", "over_black"):
        if key in entry:
            try:
                from_hex(entry[key])
            except ConfigError as error:
                yield f"{name}: {key} {str(error).removesuffix('.')}"
    parts = entry.get("white", 1)
    if isinstance(parts, bool) or not isinstance(parts, int | float) or not 0.1 <= parts <= 1000 or math.isnan(parts):
        yield f"{name}: white is {str(parts)[:20]}; it is how many parts of white the tint has, from 0.1 to 1000"
    given = {key for key in _ENTRIES if key in entry}
    if given == {"name"} and name.lower() not in published_names():
        yield f"{name} is not one of the published paints ({', '.join(published_names())}); give its color"
    if given != {"name"} and given not in (
        {"name", "color"},
        {"name", "color", "tint", "white"},
        {"name", "over_white", "over_black"},
    ):
        yield f"{name} needs a color, or color, tint and white, or over_white and over_black"


def _paint(entry: dict[str, Any]) -> Paint:
    name = entry["name"].strip()
    colors = {
        key: from_hex(entry[key]).double() for key in ("color", "tint", "over_white", "over_black") if key in entry
    }
    if "tint" in entry:
        return Paint.of_tint(name, colors["color"], colors["tint"], float(entry["white"]))
    if "color" in entry:
        return Paint.of_color(name, colors["color"])
    if "over_white" in entry:
        return Paint.of_films(name, colors["over_white"], colors["over_black"])
    return replace(published(name.lower()), name=name)
