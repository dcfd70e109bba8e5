"""Paints of a person: absorption and scattering from a name, a colour or a few test marks."""

import csv
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any, Self

import numpy as np
import torch
from torch import Tensor

from frida_painter.errors import ConfigError
from frida_painter.mixing import Finish
from frida_painter.strokes.palette import ciede2000, from_hex, to_lab
from frida_painter.system import storage
from frida_painter.system.images import to_linear, to_srgb

# Reflectance in sixteen bands of light, its colour, and the smoothest reflectance of a colour
#
# Three numbers are too few for mixing: the common reflectance of two paints shows only in bands.

BANDS = tuple(range(400, 701, 20))
"""Centres of the bands in nanometres."""
# CIE 1931 colour matching functions and the power of daylight D65 at the bands (ISO/CIE 11664-1 and -2).
_X = (
    0.01431, 0.13438, 0.34828, 0.2908, 0.09564, 0.0049, 0.06327, 0.2904,
    0.5945, 0.9163, 1.0622, 0.85445, 0.4479, 0.1649, 0.04677, 0.01136,
)  # fmt: skip
_Y = (0.0004, 0.004, 0.023, 0.06, 0.13902, 0.323, 0.71, 0.954, 0.995, 0.87, 0.631, 0.381, 0.175, 0.061, 0.017, 0.0041)
_Z = (
    0.06785, 0.6456, 1.74706, 1.6692, 0.81295, 0.272, 0.07825, 0.0203,
    0.0039, 0.00165, 0.0008, 0.00019, 0.00002, 0.0, 0.0, 0.0,
)  # fmt: skip
_D65 = (
    82.75, 93.43, 104.87, 117.81, 115.92, 109.35, 104.79, 104.41,
    100.0, 95.79, 90.01, 87.7, 83.7, 80.21, 78.28, 71.61,
)  # fmt: skip
_XYZ_TO_RGB = ((3.2406, -1.5372, -0.4986), (-0.9689, 1.8758, 0.0415), (0.0557, -0.2040, 1.0570))
# Limits of the reflectance of paints. Outside them the computed spectra are extreme and unlike any paint.
_DARKEST, _LIGHTEST = 0.003, 0.95
_ROUNDS = 60
_EXACT = 1e-9


def color_of(reflectance: Tensor) -> Tensor:
    """Converts reflectances [..., 16] to sRGB [..., 3] in [0, 1] in daylight, clipped to sRGB."""
    return to_srgb(reflectance @ _light(reflectance).T)


def reflectance_of(color: Tensor) -> Tensor:
    """Returns the smoothest reflectance [..., 16] between 0 and 1 with the colour sRGB [..., 3].

    It minimises the squared slope of the inverse hyperbolic tangent by Newton's method (S. A. Burns,
    "Generating reflectance curves from sRGB triplets", arXiv 1710.05732, 2017). Colours darker or lighter than
    all paints are clipped first.
    """
    linear = to_linear(color.detach().double()).clamp(_DARKEST, _LIGHTEST)
    flat = linear.reshape(-1, 3)
    found = torch.stack([_smoothest(one) for one in flat]) if len(flat) else flat.new_zeros(0, len(BANDS))
    return found.reshape(*color.shape[:-1], len(BANDS))


def _smoothest(linear: Tensor) -> Tensor:
    """Returns the smoothest reflectance [16] with the linear light [3]."""
    bands, light = len(BANDS), _light(linear)
    slope = torch.diff(torch.eye(bands, dtype=linear.dtype), dim=0)
    stiffness = 2 * slope.T @ slope
    height, price = linear.new_full((bands,), float(torch.atanh(2 * linear.mean() - 1))), linear.new_zeros(3)
    for _ in range(_ROUNDS):
        curve = torch.tanh(height)
        steep = light * (1 - curve**2) / 2  # [3, 16], derivative of the light by the heights
        bent = torch.diag(-curve * (1 - curve**2) * (light.T @ price))
        left = torch.cat((stiffness @ height + steep.T @ price, light @ (curve + 1) / 2 - linear))
        if float(left.abs().max()) < _EXACT:
            break
        system = torch.zeros(bands + 3, bands + 3, dtype=linear.dtype)
        system[:bands, :bands] = stiffness + bent
        system[:bands, bands:] = steep.T
        system[bands:, :bands] = steep
        step = torch.linalg.solve(system, -left)
        pace = min(1.0, 1.5 / float(step[:bands].abs().max().clamp(min=1e-12)))  # limits steps in flat parts of tanh
        height, price = height + pace * step[:bands], price + pace * step[bands:]
    return (torch.tanh(height) + 1) / 2


def _light(like: Tensor) -> Tensor:
    """Returns the linear light of each band in red, green and blue: [3, 16]; all bands together are white."""
    matching = torch.tensor((_X, _Y, _Z), dtype=like.dtype) * torch.tensor(_D65, dtype=like.dtype)
    light = torch.tensor(_XYZ_TO_RGB, dtype=like.dtype) @ matching
    return light / light.sum(1, keepdim=True)


WHITE = "titanium white"
_WHITE_CARD = 0.95  # reflectance of the white ground under a film
_NOISE = 0.01  # sRGB
_TINT = 4.0  # parts of white for one part of a published paint
_WHITE_ABSORPTION = 0.0025
# Tested scatterings: strength (powers of ten, number), slope over the bands, dependence on absorption.
_STRENGTHS = (-2.7, -0.3, 61)
_LEANS, _FOLLOWS = (-1.0, -0.5, 0.0, 0.5, 1.0, 1.5, 2.0), (-0.5, -0.25, 0.0, 0.25, 0.5, 0.75)
_SCATTERING, _MIN_ABSORPTION, _MIN_SHARE = (0.005, 0.5), 3e-4, 0.05
_PRICE = 0.5  # CIEDE2000 of penalty for a slope of 1
_PAINT_ROUNDS = 10
_MAX_OFF = 10.0  # CIEDE2000
# Scattering of dark published paints relative to titanium white, on average.
_TYPICAL_SCATTERING = 0.1


class PaintDataSource(StrEnum):
    """Source of a paint's numbers, best first."""

    published = "published"
    tint = "its tint with white"
    films = "films over white and over black"
    color = "its colour alone"


@dataclass(frozen=True)
class Paint:
    """Paint with absorption K and scattering S [16] in the bands of `BANDS`; titanium white has S = 1.

    pigment: its Colour Index name, as on tubes; "" if unknown
    """

    name: str
    absorption: Tensor
    scattering: Tensor
    source: PaintDataSource
    pigment: str = ""

    @property
    def title(self) -> str:
        """Name with the pigment, for a shop."""
        return f"{self.name} ({self.pigment})" if self.pigment else self.name

    @property
    def color(self) -> Tensor:
        """Colour of a thick mark, sRGB [3]."""
        return color_of(reflectance(self.absorption, self.scattering))

    @classmethod
    def of_color(cls, name: str, color: Tensor) -> Self:
        """Returns a paint from its colour alone, sRGB [3].

        Kubelka-Munk with a single constant: only K / S is known. Dark paints get a typical scattering. Light
        paints get one like white, which they mostly contain.
        """
        seen = reflectance_of(color)
        lightest = float(color_of(seen).min())
        scattering = torch.full_like(seen, _TYPICAL_SCATTERING + (1 - _TYPICAL_SCATTERING) * lightest**2)
        return cls(name, ratio(seen) * scattering, scattering, PaintDataSource.color)

    @classmethod
    def of_tint(cls, name: str, color: Tensor, tint: Tensor, parts: float) -> Self:
        """Returns a paint from its colour, and the colour of one part with `parts` parts of titanium white.

        color, tint: sRGB [3]
        The tint gives the absorption in each band for a given scattering. The scattering is searched so that
        the pure colour fits: its strength, its slope towards red or blue, and its dependence on the absorption.
        Raises ConfigError if the tint cannot belong to that colour.
        """
        tinted = ratio(reflectance_of(tint))
        axis = torch.linspace(-1, 1, len(tinted), dtype=tinted.dtype)
        strength = torch.logspace(*_STRENGTHS, dtype=tinted.dtype)[:, None, None, None]
        lean = torch.tensor(_LEANS, dtype=tinted.dtype)[:, None, None]
        follows = torch.tensor(_FOLLOWS, dtype=tinted.dtype)[:, None]
        plain = scattering = (strength * (lean * axis).exp()).expand(-1, -1, len(_FOLLOWS), -1)  # [s, l, f, 16]

        def absorption() -> Tensor:
            return (tinted * (scattering + parts) - parts * _WHITE_ABSORPTION).clamp(min=_MIN_ABSORPTION)

        for _ in range(_PAINT_ROUNDS):
            share = absorption() / absorption().amax(-1, keepdim=True)
            following = (plain * share.clamp(min=_MIN_SHARE) ** follows).clamp(*_SCATTERING)
            scattering = (scattering + following) / 2
        off = ciede2000(to_lab(color_of(reflectance(absorption(), scattering))), to_lab(color.to(tinted)))
        plainer = off + _PRICE * (2 * follows.abs() + lean.abs())[..., 0]
        # PyTorch's own function would load its compiler, which takes half a second.
        best = tuple(int(index) for index in np.unravel_index(int(plainer.argmin()), plainer.shape))
        if not float(off[best]) <= _MAX_OFF:
            raise ConfigError(
                f"its colour lies {float(off[best]):.0f} CIEDE2000 from all that a paint with this tint can have; "
                "photograph both in the same light"
            )
        return cls(name, absorption()[best], scattering[best], PaintDataSource.tint)

    @classmethod
    def of_films(cls, name: str, over_white: Tensor, over_black: Tensor) -> Self:
        """Returns a paint from films of equal thickness over a white and a black ground.

        over_white, over_black: sRGB [3]
        The numbers are for the film, not yet relative to white. Raises ConfigError if the film is lighter over black.
        """
        if not bool((over_black <= over_white + _NOISE).all()):
            raise ConfigError("it is lighter over black than over white; give over_white and over_black of one film")
        white = reflectance_of(over_white)
        black = torch.minimum(reflectance_of(over_black), white)
        absorption, scattering = film_over(white, black, torch.full_like(white, _WHITE_CARD))
        return cls(name, absorption, scattering, PaintDataSource.films)


def published_names() -> tuple[str, ...]:
    """Returns the names of eleven artists' acrylics."""
    return WHITE, *_colors()


def find_acrylic(name: str) -> Paint:
    """Returns one of the eleven acrylics by name.

    Each is known by two colours: a thick mark, and one part with four parts of titanium white. Both follow from
    absorption and scattering as determined by the method of Y. Okumura, "Developing a spectral and colorimetric
    database of artist paint materials" (Rochester Institute of Technology, 2005), with the data of
    github.com/feeneyko/km-web.
    """
    if name == WHITE:  # hardly absorbs; other paints are relative to its scattering
        scattering = torch.ones(len(BANDS), dtype=torch.float64)
        return Paint(WHITE, _WHITE_ABSORPTION * scattering, scattering, PaintDataSource.published, "PW6")
    color, tint, pigment = _colors()[name]
    paint = Paint.of_tint(name, from_hex(color).double(), from_hex(tint).double(), _TINT)
    return replace(paint, source=PaintDataSource.published, pigment=pigment)


def _colors() -> dict[str, tuple[str, str, str]]:
    """Returns the colours of the other ten acrylics, pure and as tints, and their pigments, by name."""
    table = resources.files("frida_painter.mixing") / "data" / "acrylics.csv"
    rows = csv.DictReader(table.read_text(encoding="utf-8").splitlines())
    return {row["paint"]: (row["color"], row["tint"], row["pigment"]) for row in rows}


# Paints of a person, from a small TOML file; by default six paints that mix most colours

MAX_PAINTS = 32
SIX = ("titanium white", "hansa yellow", "pyrrole red", "quinacridone magenta", "phthalo blue", "carbon black")
"""Names of the published paints that are used by default."""
_MAX_BYTES = 2**18
_COLORS = ("color", "tint", "over_white", "over_black")
_ENTRIES = ("name", *_COLORS[:2], "white", *_COLORS[2:])
_MEASURED = (("color",), ("color", "tint", "white"), ("over_white", "over_black"))  # entries that tell a paint
_ADVICE = "docs/how-to/mix.md shows such a file"


@cache
def usual_paints() -> tuple[Paint, ...]:
    """Returns the six default paints."""
    return tuple(find_acrylic(name) for name in SIX)


def read_paints(path: Path) -> tuple[tuple[Paint, ...], Finish, str]:
    """Reads paints, finish and mixer of a TOML file with [[paint]] entries. Raises ConfigError that names all faults.

    Without entries the finish is gloss, and the mixer "kubelka-munk".

    An entry has a name. A published paint needs nothing else. Other paints have `color` ("#rrggbb" of a thick
    mark), better with `tint`, the colour of one part with `white` parts of titanium white; or `over_white` and
    `over_black` of one film.
    """
    values = storage.read_toml(path, "a file of paints (TOML)", _MAX_BYTES, _ADVICE)
    entries = values.get("paint", ())
    counted = isinstance(entries, list) and 1 <= len(entries) <= MAX_PAINTS
    if set(values) - {"finish", "mixer"} != {"paint"} or not counted:
        raise ConfigError(f"{path} is no file of paints: it has 1 to {MAX_PAINTS} [[paint]] entries; {_ADVICE}.")
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
    finish, mixer = values.get("finish", Finish.gloss.value), values.get("mixer", "kubelka-munk")
    if finish not in list(Finish):
        faults.append(f"its finish is {str(finish)[:20]!r}, and it is {' or '.join(Finish)}")
    if not isinstance(mixer, str):
        faults.append(f"its mixer is {str(mixer)[:20]!r}, and it is a name")
    if faults:
        raise ConfigError(f"{path} is no file of paints: {'; '.join(faults)}; {_ADVICE}.")
    for at, paint in enumerate(paints):
        if white is not None and paint.source is PaintDataSource.films:
            unit = float(white.scattering.mean())
            paints[at] = replace(paint, absorption=paint.absorption / unit, scattering=paint.scattering / unit)
    return tuple(paints), Finish(finish), mixer


def _faults(number: int, entry: Any) -> Iterator[str]:
    """Yields a sentence for each formal fault of an entry."""
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
    for key in _COLORS:
        if key in entry:
            try:
                from_hex(entry[key])
            except ConfigError as error:
                yield f"{name}: {key} {str(error).removesuffix('.')}"
    parts = entry.get("white", 1)
    if isinstance(parts, bool) or not isinstance(parts, int | float) or not 0.1 <= parts <= 1000 or math.isnan(parts):
        yield f"{name}: white is {str(parts)[:20]}; it is how many parts of white the tint has, from 0.1 to 1000"
    given = tuple(key for key in _ENTRIES[1:] if key in entry)
    if not given and name.lower() not in published_names():
        yield f"{name} is not one of the published paints ({', '.join(published_names())}); give its color"
    if given and given not in _MEASURED:
        yield f"{name} needs a color, or color, tint and white, or over_white and over_black"


def _paint(entry: dict[str, Any]) -> Paint:
    name = entry["name"].strip()
    colors = {key: from_hex(entry[key]).double() for key in _COLORS if key in entry}
    if "tint" in entry:
        return Paint.of_tint(name, colors["color"], colors["tint"], float(entry["white"]))
    if "color" in entry:
        return Paint.of_color(name, colors["color"])
    if "over_white" in entry:
        return Paint.of_films(name, colors["over_white"], colors["over_black"])
    return replace(find_acrylic(name.lower()), name=name)


# Theory of Kubelka and Munk: absorption K and scattering S of paints, which add up in mixtures.
#
# P. Kubelka, F. Munk, "Ein Beitrag zur Optik der Farbanstriche" (1931); for mixtures D. R. Duncan, "The colour of
# pigment mixtures" (1940); for the surface J. L. Saunderson, "Calculation of the color of pigmented plastics" (1942).
# All values are for each band of light. Films are opaque unless stated otherwise.


# Reflection by the surface of a dry matte paint for light from outside and from inside (Saunderson).
_OUTER, _INNER = 0.035, 0.6
_BLACKEST = 1e-3  # smallest reflectance inside a paint
_MIN_SCATTERING = 1e-4
_OPAQUE = 1e-4  # smallest difference between white and black ground


def reflectance(absorption: Tensor, scattering: Tensor, finish: Finish = Finish.matte) -> Tensor:
    """Returns the visible reflectance of an opaque film in (0, 1], any shape."""
    ratio = absorption / scattering
    within = 1 + ratio - (ratio.square() + 2 * ratio).sqrt()
    beneath = (1 - _OUTER) * (1 - _INNER) * within / (1 - _INNER * within)
    return beneath + _OUTER if finish is Finish.matte else beneath


def ratio(reflected: Tensor) -> Tensor:
    """Returns K / S of an opaque matte film with this visible reflectance, any shape."""
    within = inside(reflected)
    return (1 - within).square() / (2 * within)


def inside(reflected: Tensor) -> Tensor:
    """Returns the reflectance inside a paint from the visible reflectance of its matte surface, any shape."""
    beneath = (reflected - _OUTER) / (1 - _OUTER)
    return (beneath / (1 - _INNER + _INNER * beneath)).clamp(_BLACKEST, 1 - _BLACKEST)


def mix_reflectance(parts: Tensor, absorption: Tensor, scattering: Tensor, finish: Finish = Finish.matte) -> Tensor:
    """Returns the visible reflectance [m, b] of mixtures.

    parts [m, n]: amounts of n paints
    absorption, scattering [n, b]: K and S of the paints
    """
    return reflectance(parts @ absorption, parts @ scattering, finish)


def film_over(over_white: Tensor, over_black: Tensor, ground: Tensor) -> tuple[Tensor, Tensor]:
    """Returns K and S [b], for the thickness of the film, from measurements over white and over black.

    over_white, over_black: reflectance of the film on a ground of reflectance `ground`, and on a black ground.
    The second must not be larger than the first (Kubelka's hyperbolic solution, 1948).
    """
    over_black, ground = inside(over_black), inside(ground)
    white = torch.maximum(inside(over_white), over_black + _OPAQUE)
    a = (white + (over_black - white + ground) / (over_black * ground)) / 2
    a = a.clamp(min=1 + 1e-6)
    b = (a.square() - 1).sqrt()
    scattering = torch.atanh((b * over_black / (1 - a * over_black)).clamp(max=1 - 1e-9)) / b
    scattering = scattering.clamp(min=_MIN_SCATTERING)
    return scattering * (a - 1), scattering
