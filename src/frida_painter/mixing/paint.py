"""A paint that a person owns, and what its name, its colour or a few marks tell of its absorption and scattering."""

import csv
from dataclasses import dataclass, replace
from enum import StrEnum
from importlib import resources
from typing import Self

import torch
from torch import Tensor

from frida_painter.errors import ConfigError
from frida_painter.mixing.kubelka_munk import film_over, ratio, reflectance
from frida_painter.mixing.spectrum import BANDS, color_of, reflectance_of
from frida_painter.palette import from_hex, to_lab
from frida_painter.perception.difference import ciede2000

WHITE = "titanium white"
_WHITE_CARD = 0.95  # what the white ground under a film reflects
_NOISE = 0.01  # sRGB
_TINT = 4.0  # parts of white with one part of a published paint
_WHITE_ABSORPTION = 0.0025
# What is tried for a paint's scattering: how strong (powers of ten, steps), how it leans, how it follows absorption.
_STRENGTHS = (-2.7, -0.3, 61)
_LEANS, _FOLLOWS = (-1.0, -0.5, 0.0, 0.5, 1.0, 1.5, 2.0), (-0.5, -0.25, 0.0, 0.25, 0.5, 0.75)
_SCATTERING, _LEAST_ABSORPTION, _LEAST_SHARE = (0.005, 0.5), 3e-4, 0.05
_PRICE = 0.5  # CIEDE2000 for a scattering that leans by 1
_ROUNDS = 10
_MOST_OFF = 10.0  # CIEDE2000
# How much less than titanium white the published paints scatter, on average, where they are dark.
_TYPICAL_SCATTERING = 0.1


class PaintDataSource(StrEnum):
    """Where a paint's numbers come from, best first."""

    published = "published"
    tint = "its tint with white"
    films = "films over white and over black"
    color = "its colour alone"


@dataclass(frozen=True)
class Paint:
    """A paint: absorption K and scattering S [16] in the bands of `spectrum`, where titanium white scatters 1."""

    name: str
    absorption: Tensor
    scattering: Tensor
    source: PaintDataSource

    @property
    def color(self) -> Tensor:
        """sRGB [3] of a thick mark of it."""
        return color_of(reflectance(self.absorption, self.scattering))

    @classmethod
    def of_color(cls, name: str, color: Tensor) -> Self:
        """A paint of which only its colour, sRGB [3], is known.

        Kubelka-Munk with a single constant: only K / S is known. Dark paints are taken to scatter as
        typical ones do, light ones like the white that they mostly hold.
        """
        seen = reflectance_of(color)
        lightest = float(color_of(seen).min())
        scattering = torch.full_like(seen, _TYPICAL_SCATTERING + (1 - _TYPICAL_SCATTERING) * lightest**2)
        return cls(name, ratio(seen) * scattering, scattering, PaintDataSource.color)

    @classmethod
    def of_tint(cls, name: str, color: Tensor, tint: Tensor, parts: float) -> Self:
        """A paint whose colour is known alone and as one part with `parts` parts of titanium white, sRGB [3] each.

        The tint tells the absorption band by band, whatever the scattering is; the colour alone tells
        that, of which is tried how strong it is, how it leans towards red or blue, and how it goes with
        the absorption. Raises ConfigError where the tint cannot be one of that paint.
        """
        white, tinted = _white(), ratio(reflectance_of(tint))
        axis = torch.linspace(-1, 1, len(tinted), dtype=tinted.dtype)
        strength = torch.logspace(*_STRENGTHS, dtype=tinted.dtype)[:, None, None, None]
        lean = torch.tensor(_LEANS, dtype=tinted.dtype)[:, None, None]
        follows = torch.tensor(_FOLLOWS, dtype=tinted.dtype)[:, None]
        plain = scattering = (strength * (lean * axis).exp()).expand(-1, -1, len(_FOLLOWS), -1)  # [s, l, f, 16]

        def absorption() -> Tensor:
            return (tinted * (scattering + parts) - parts * white.absorption).clamp(min=_LEAST_ABSORPTION)

        for _ in range(_ROUNDS):
            share = absorption() / absorption().amax(-1, keepdim=True)
            following = (plain * share.clamp(min=_LEAST_SHARE) ** follows).clamp(*_SCATTERING)
            scattering = (scattering + following) / 2
        off = ciede2000(to_lab(color_of(reflectance(absorption(), scattering))), to_lab(color.to(tinted)))
        plainer = off + _PRICE * (2 * follows.abs() + lean.abs())[..., 0]
        best = tuple(int(index) for index in torch.unravel_index(plainer.argmin(), plainer.shape))
        if not float(off[best]) <= _MOST_OFF:
            raise ConfigError(
                f"its colour lies {float(off[best]):.0f} CIEDE2000 from all that a paint with this tint can have; "
                "photograph both in the same light"
            )
        return cls(name, absorption()[best], scattering[best], PaintDataSource.tint)

    @classmethod
    def of_films(cls, name: str, over_white: Tensor, over_black: Tensor) -> Self:
        """A paint that was drawn down over a white and a black ground, sRGB [3] each, in films of equal thickness.

        Its scattering is per film, not yet against white: see `against`. Raises ConfigError.
        """
        if not bool((over_black <= over_white + _NOISE).all()):
            raise ConfigError("it is lighter over black than over white; give over_white and over_black of one film")
        white = reflectance_of(over_white)
        black = torch.minimum(reflectance_of(over_black), white)
        absorption, scattering = film_over(white, black, torch.full_like(white, _WHITE_CARD))
        return cls(name, absorption, scattering, PaintDataSource.films)

    def against(self, scattering: float) -> Self:
        """The same paint where white scatters `scattering` per film and not 1."""
        return type(self)(self.name, self.absorption / scattering, self.scattering / scattering, self.source)


def published_names() -> tuple[str, ...]:
    """Names of eleven artists' acrylics."""
    return WHITE, *_colors()


def published(name: str) -> Paint:
    """One of the eleven acrylics by its name.

    Each is known by two colours, of a thick mark and of one part with four parts of titanium white. Both
    follow from absorption and scattering that were determined by the method of Y. Okumura, "Developing a
    spectral and colorimetric database of artist paint materials" (Rochester Institute of Technology,
    2005), as github.com/feeneyko/km-web has them.
    """
    if name == WHITE:
        return _white()
    color, tint = (from_hex(text).double() for text in _colors()[name])
    return replace(Paint.of_tint(name, color, tint, _TINT), source=PaintDataSource.published)


def _white() -> Paint:
    """Titanium white, which hardly absorbs, and by whose scattering all others are measured."""
    scattering = torch.ones(len(BANDS), dtype=torch.float64)
    return Paint(WHITE, _WHITE_ABSORPTION * scattering, scattering, PaintDataSource.published)


def _colors() -> dict[str, tuple[str, str]]:
    """The colours of the other ten, alone and as tints, by name."""
    table = resources.files("frida_painter.mixing") / "data" / "acrylics.csv"
    rows = csv.DictReader(table.read_text(encoding="utf-8").splitlines())
    return {row["paint"]: (row["color"], row["tint"]) for row in rows}
