"""Brushes by name, ours and those of other packages, and the rectangle in which a brush's marks lie."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol, Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter import registry
from frida_painter.errors import ConfigError, PlanError
from frida_painter.frames import MapFrame
from frida_painter.strokes import StrokeLimits, Strokes

# How much one dip of a brush paints before the next one.

_MOST = 1000
_STAYS_FULL = 0.3  # of what a dip paints; after that marks fade evenly


@dataclass(frozen=True)
class Dip:
    """What one dip is good for before the next one.

    holds: square metres that it paints, or where by_strokes a number of strokes, whatever their size; fades: the share
    of their paint that marks lack at its end, from 0 to 1. Raises ConfigError where that cannot be.
    """

    holds: float
    by_strokes: bool = False
    fades: float = 0.0

    def __post_init__(self) -> None:
        least, most = (1, _MOST) if self.by_strokes else (0.0, 1.0)
        if not (least <= self.holds <= most and self.holds > 0):
            unit = "strokes" if self.by_strokes else "m2"
            raise ConfigError(f"A dip that holds {self.holds:g} {unit} was given; it is from {least:g} to {most:g}.")
        if not 0 <= self.fades <= 1:
            raise ConfigError(f"A dip that fades by {self.fades:g} was given; it is from 0 to 1.")

    @classmethod
    def of_strokes(cls, count: int) -> Self:
        """One that is good for so many strokes."""
        return cls(float(count), by_strokes=True)

    def used_by(self, areas: Tensor) -> Tensor:
        """How much of it strokes use that paint these areas, m2 [n]."""
        return torch.ones_like(areas) if self.by_strokes else areas

    def lacking(self, left: float, use: float) -> float:
        """The share of its paint that a mark lacks in its middle, which uses so much of what is left of the dip."""
        spent = 1 - (left - use / 2) / self.holds
        return min(1.0, self.fades * max(0.0, spent - _STAYS_FULL) / (1 - _STAYS_FULL))

    def until(self, lacking: float) -> Self:
        """The dip as it is where the brush is dipped again before marks lack more than that share of their paint."""
        if self.fades <= lacking:
            return self
        share = _STAYS_FULL + (1 - _STAYS_FULL) * lacking / self.fades
        return replace(self, holds=max(share * self.holds, float(self.by_strokes)), fades=lacking)

    def __str__(self) -> str:
        return f"{self.holds:.0f} strokes" if self.by_strokes else f"{self.holds * 1e4:.1f} cm²"


def painted_area(length: Tensor, thickness: Tensor, width: float) -> Tensor:
    """What strokes paint, m2 [n]: their length times the width of a mark of their thickness."""
    return length * width * (0.25 + 0.75 * thickness)


# What a stroke model is: from the shape of a stroke to the mark that it leaves.


class StrokeModel(Protocol):
    """Maps (thickness, length, bend) to magnitude maps; differentiable in all three.

    frame says where the map lies around the stroke's start, limits what the brush can do, and
    brush which one it is.
    """

    @property
    def brush(self) -> str:
        """Name of the brush."""

    @property
    def frame(self) -> MapFrame:
        """Where a map lies around the start of its stroke."""

    @property
    def limits(self) -> StrokeLimits:
        """What lengths and bends the brush can paint."""

    def __call__(self, thickness: Tensor, length: Tensor, bend: Tensor) -> Tensor:
        """thickness [n] in [0, 1], length [n] and bend [n] in metres -> magnitude [n, rows, columns] in [0, 1]."""


CELLS_ALONG = 80
_DIP_SHARE = 0.6
_IN_ANY_ORDER = 0.3  # of its paint, that a mark may lack


@dataclass(frozen=True)
class BrushKind:
    """A brush: its name, what it can paint, and the widest mark that it leaves, in metres.

    known_dip: what one dip is good for, where that is known of it better than `dip` reckons; studio: the brush
    that stands for it in the virtual studio, "" where the studio knows it by its own name.
    """

    name: str
    limits: StrokeLimits
    width: float
    known_dip: Dip | None = None
    studio: str = ""

    @property
    def dip(self) -> Dip:
        """What one dip is good for: where nothing is known, six tenths of the largest mark."""
        return self.known_dip or Dip(_DIP_SHARE * self.limits.length[1] * self.width)

    @property
    def in_studio(self) -> str:
        """The name of the brush that paints for it in the virtual studio."""
        return self.studio or self.name

    @property
    def for_any_order(self) -> Self:
        """The brush for strokes in an order that does not spare those that matter: it is dipped before it is as dry."""
        return replace(self, known_dip=self.dip.until(_IN_ANY_ORDER))

    def area(self, strokes: Strokes) -> Tensor:
        """What each stroke paints, m2, [n]: its length times the width of a mark of its thickness."""
        return painted_area(strokes.length, strokes.thickness, self.width)

    @property
    def frame(self) -> MapFrame:
        """The rectangle around a stroke's start that holds every mark of this brush, in near-square cells.

        The path reaches three quarters of the bend aside; around it lie half of the mark, and some
        margin for bristles that splay and for a brush that trails behind its tip.
        """
        around = 0.65 * self.width
        aside = 0.75 * max(abs(bend) for bend in self.limits.bend) + around
        left, right = -around, self.limits.length[1] + around
        pitch = (right - left) / CELLS_ALONG
        rows = 4 * round(2 * aside / pitch / 4)  # the network's upscaler works on whole coarse cells
        return MapFrame(left, right, -rows * pitch / 2, rows * pitch / 2, rows, CELLS_ALONG)


def _kind(name: str, shortest: float, longest: float, bend: float, width: float, dip: float) -> BrushKind:
    return BrushKind(name, StrokeLimits((shortest, longest), (-bend, bend)), width, Dip(dip, fades=_FADES))


# At the end of a dip the brush is nearly dry; strokes that matter are painted before (session/hand.py).
_FADES = 0.5
FINE = _kind("fine", 0.008, 0.048, 0.012, 0.009, 6.5e-4)
MEDIUM = _kind("medium", 0.010, 0.060, 0.016, 0.017, 17.0e-4)
BROAD = _kind("broad", 0.012, 0.075, 0.022, 0.030, 44.0e-4)
KINDS = (FINE, MEDIUM, BROAD)


@dataclass(frozen=True)
class BrushModel:
    """A brush with a stroke model of it, as both are registered under the brush's name (registry.py).

    load: gives the stroke model, of the same brush and limits; may raise WeightsError.
    """

    kind: BrushKind
    load: Callable[[], StrokeModel]

    @property
    def name(self) -> str:
        """Name of the brush."""
        return self.kind.name


def brush_kind(name: str) -> BrushKind:
    """The brush of that name. Raises ConfigError where none is called so, PluginError where it cannot be loaded."""
    for kind in KINDS:
        if kind.name == name:
            return kind
    known = registry.parts(registry.STROKE_MODELS)
    if name not in known:
        raise ConfigError(f"Brush {name!r} is not known; brushes are {', '.join(known)}.")
    return known[name].load(BrushModel).kind


# A stroke model that is only a function: from the shapes of strokes to their magnitude maps.


class StrokeFunction:
    """Implements brush.kinds.StrokeModel by a function of (thickness, length, bend), for a brush.

    kind: the brush, with its limits; function: takes three tensors [n], thickness in [0, 1], length and bend
    in metres, and returns magnitudes [n, rows, columns] in [0, 1] over the cells of `frame`; frame: where a map
    lies around the start of its stroke, by default the brush's own. The function need not be differentiable:
    while a plan is optimised, a table stands in for it (brush/table.py).
    """

    def __init__(
        self, kind: BrushKind, function: Callable[[Tensor, Tensor, Tensor], Tensor], frame: MapFrame | None = None
    ) -> None:
        self.kind, self.function = kind, function
        self._frame = frame or kind.frame

    @property
    def brush(self) -> str:
        """Name of the brush."""
        return self.kind.name

    @property
    def frame(self) -> MapFrame:
        """Where a map lies around the start of its stroke."""
        return self._frame

    @property
    def limits(self) -> StrokeLimits:
        """What lengths and bends the brush can paint."""
        return self.kind.limits

    def __call__(self, thickness: Tensor, length: Tensor, bend: Tensor) -> Tensor:
        """The function's maps [n, rows, columns]. Raises ConfigError where they are of another shape or range."""
        maps = self.function(thickness, length, bend)
        wanted = (len(length), self._frame.rows, self._frame.columns)
        if tuple(maps.shape) != wanted:
            raise ConfigError(
                f"The stroke model of brush {self.brush!r} gave maps of shape {tuple(maps.shape)}; its function has to "
                f"return {wanted}, one map of rows and columns for each stroke."
            )
        if maps.numel():
            least, most = (float(value) for value in maps.detach().aminmax())
            if not (0 <= least <= most <= 1):
                raise ConfigError(
                    f"The stroke model of brush {self.brush!r} gave magnitudes from {least:g} to {most:g}; its "
                    "function has to keep them from 0, bare paper, to 1, covered."
                )
        return maps


# How much the coverage of a mark varies from stroke to stroke, where its mean is known.
#
# Of a number in [0, full] with mean m the variance is at most m (full - m): it is that where the number is either 0
# or
# full, as at the edge of an opaque mark that lands now here, now there. Marks come near it by the same share nearly
# everywhere, so that one number tells the variance of all places of all marks of a brush.

_FULL = (0.5, 1.0, 51)  # least, most and number of those that are tried


class CoverageSpread(NamedTuple):
    """The variance of coverage with mean m is `share` m (full - m), and 0 where m is above `full`.

    share: in [0, 1], 0 where every mark is as predicted; full: the coverage of a mark's solid parts, in (0, 1].
    """

    share: float = 0.0
    full: float = 1.0

    def variance(self, mean: Tensor) -> Tensor:
        """The variance of coverage of that mean, any shape, in [0, 1/4]."""
        return self.share * mean * (self.full - mean).clamp(min=0)

    @classmethod
    def fitted(cls, mean: Tensor, coverage: Tensor) -> Self:
        """What explains best, in least squares, how far coverage was from its mean; both any shape, in [0, 1].

        Take marks that the model of the mean did not learn from.
        """
        missed, best, least = (coverage - mean).square(), cls(), float("inf")
        for full in torch.linspace(*_FULL).tolist():
            whole = mean * (full - mean).clamp(min=0)
            share = min(1.0, float((missed * whole).sum() / whole.square().sum().clamp(min=1e-12)))
            left = float((missed - share * whole).square().sum())
            if left < least:
                best, least = cls(share, full), left
        return best

    def widened(self, factor: float) -> Self:
        """The spread of marks whose variance is `factor` times as large, as far as it can be."""
        return self._replace(share=min(1.0, factor * self.share))

    def require(self) -> Self:
        """Itself. Raises ValueError where a number is out of its range."""
        if not (0 <= self.share <= 1 and 0 < self.full <= 1):
            raise ValueError(f"a spread of {self.share} and {self.full}")
        return self


CERTAIN = CoverageSpread()
"""Of a model that says nothing of how marks vary."""


def median_of(model: StrokeModel) -> Callable[[Tensor, Tensor, Tensor], Tensor]:
    """What gives the median of a model's marks, from thickness, length and bend: the model, where it knows no other."""
    return getattr(model, "median", model)


def spread_of(model: object) -> CoverageSpread:
    """How the marks of a stroke model vary: its `spread`; CERTAIN for one that does not say."""
    return getattr(model, "spread", CERTAIN)


# The path that the brush's tip follows while it paints one stroke.

END_THICKNESS = 0.2
"""How hard the brush is pressed where a stroke starts and ends (thickness, 0 to 1)."""
_SAMPLES = 513


def pressure(fraction: NDArray[np.float64], thickness: float) -> NDArray[np.float64]:
    """Thickness [k] at fractions [k] of the curve: the cubic Bezier 0.2, h, h, 0.2 of the paper's brush heights."""
    ends = fraction**3 + (1 - fraction) ** 3
    return END_THICKNESS * ends + thickness * (1 - ends)


def stroke_path(strokes: Strokes, index: int, step: float = 0.002) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The cubic Bezier of stroke `index` as points at most `step` metres apart, ends included.

    Returns the position [k, 2] in metres on the canvas and the thickness [k] in [0, 1], which is
    linear in the brush's height. The points are evenly spaced along the arc (paper, "Brush Stroke
    Model"). Raises PlanError where there is no such stroke, or it or the step is not finite.
    """
    if not 0 < step < math.inf:
        raise PlanError(f"A step of {step} m was given for the path of a stroke; it is above 0 and finite.")
    if not 0 <= index < len(strokes):
        raise PlanError(f"Stroke {index} was asked for; there are {len(strokes)}, and the first is stroke 0.")
    stroke = strokes[index : index + 1].to("cpu")
    fraction = np.linspace(0, 1, _SAMPLES)
    position = _points(stroke, fraction)
    if not np.isfinite(position).all() or not math.isfinite(float(stroke.thickness)):
        raise PlanError(f"Stroke {index} has a number that is not finite; plan it anew.")
    walked = np.r_[0, np.cumsum(np.linalg.norm(np.diff(position, axis=0), axis=1))]
    # The curve is measured by chords, which are a little shorter than it: a slightly smaller step keeps the promise.
    count = max(2, math.ceil(1.002 * walked[-1] / step) + 1)
    even = np.interp(np.linspace(0, walked[-1], count), walked, fraction) if walked[-1] > 0 else np.array([0.0, 1.0])
    return _points(stroke, even), pressure(even, float(stroke.thickness))


def _points(stroke: Strokes, fraction: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points [k, 2] of the one stroke's Bezier at fractions [k] of its parameter."""
    x, y = (float(part) for part in stroke.position[0])
    angle, length, bend = float(stroke.angle), float(stroke.length), float(stroke.bend)
    along, aside = fraction * length, 3 * fraction * (1 - fraction) * bend
    cos, sin = math.cos(angle), math.sin(angle)
    return np.stack((x + cos * along - sin * aside, y + sin * along + cos * aside), -1)
