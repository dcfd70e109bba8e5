"""A paint that a person owns, and what its name, its colour or a few marks tell of its absorption and scattering."""

import csv
from dataclasses import dataclass
from enum import StrEnum
from importlib import resources
from typing import Self

import torch
from torch import Tensor

from frida_painter.errors import ConfigError
from frida_painter.mixing.kubelka_munk import film_over, ratio, reflectance
from frida_painter.mixing.spectrum import BANDS, color_of, reflectance_of
from frida_painter.palette import to_lab
from frida_painter.perception.difference import ciede2000

WHITE = "titanium white"
_WHITE_CARD = 0.95  # what the white ground under a film reflects
_NOISE = 0.01  # sRGB
_STEEPNESS, _STEEPEST = (0.0, 0.25, 0.5), 50.0
_MOST_OFF = 10.0  # CIEDE2000
_ROUNDED_AWAY = 0.0025  # what stands as 0.00 in a table of two decimals
# How much less than titanium white the published paints scatter, on average, where they are dark.
_TYPICAL_SCATTERING = 0.1


class Source(StrEnum):
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
    source: Source

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
        return cls(name, ratio(seen) * scattering, scattering, Source.color)

    @classmethod
    def of_tint(cls, name: str, color: Tensor, tint: Tensor, parts: float) -> Self:
        """A paint whose colour is known alone and as one part with `parts` parts of titanium white, sRGB [3] each.

        Raises ConfigError where the tint cannot be one of that paint.
        """
        white, own = published()[WHITE], ratio(reflectance_of(color))
        # Where a paint absorbs much, it may scatter more as well: how much more is tried, too.
        strength = torch.logspace(-3, 0.7, 75, dtype=own.dtype)[:, None, None]
        steepness = torch.tensor(_STEEPNESS, dtype=own.dtype)[:, None]
        scattering = (strength * own.clamp(max=_STEEPEST) ** steepness).reshape(-1, len(own))  # [m, 16]
        tints = reflectance(
            own * scattering + parts * white.absorption, scattering + parts * white.scattering
        )  # fmt: skip
        off = ciede2000(to_lab(color_of(tints)), to_lab(tint.to(tints)))
        best = int(off.argmin())
        if not float(off[best]) <= _MOST_OFF:
            raise ConfigError(
                f"its tint lies {float(off[best]):.0f} CIEDE2000 from all that the paint and white can give; "
                "photograph both in the same light"
            )
        return cls(name, own * scattering[best], scattering[best], Source.tint)

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
        return cls(name, absorption, scattering, Source.films)

    def against(self, scattering: float) -> Self:
        """The same paint where white scatters `scattering` per film and not 1."""
        return type(self)(self.name, self.absorption / scattering, self.scattering / scattering, self.source)


def published() -> dict[str, Paint]:
    """Eleven artists' acrylics by name, by their absorption and scattering as determined from tints.

    The method is that of Y. Okumura, "Developing a spectral and colorimetric database of artist paint
    materials" (Rochester Institute of Technology, 2005); the numbers are those of the public table
    github.com/feeneyko/km-web, every 20 nm of it.
    """
    table = resources.files("frida_painter.mixing") / "data" / "acrylics.csv"
    rows = list(csv.reader(table.read_text(encoding="utf-8").splitlines()))
    assert tuple(map(int, rows[0][2:])) == BANDS
    numbers = {
        (row[0], row[1]): torch.tensor([float(part) for part in row[2:]], dtype=torch.float64) for row in rows[1:]
    }
    names = list(dict.fromkeys(row[0] for row in rows[1:]))
    absorption = {name: torch.where(numbers[name, "K"] == 0, _ROUNDED_AWAY, numbers[name, "K"]) for name in names}
    return {name: Paint(name, absorption[name], numbers[name, "S"], Source.published) for name in names}
