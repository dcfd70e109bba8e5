"""Brushes by name, of this and other packages; dips, stroke models, spread of marks, path of a stroke."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple, Protocol, Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter import registry
from frida_painter.errors import ConfigError, FridaError, PlanError, WeightsError
from frida_painter.frames import MapFrame
from frida_painter.strokes.family import StrokeFamily, describe_kind
from frida_painter.strokes.strokes import StrokeLimits, Strokes

_MAX = 1000
_STAYS_FULL = 0.3  # share of the dip with full marks; later marks fade evenly


@dataclass(frozen=True)
class Dip:
    """Capacity of one dip of the brush.

    holds: painted area in m2, or a number of strokes
    by_strokes: True if `holds` counts strokes
    fades: share of paint that marks lack at the end of the dip, in [0, 1]
    Raises ConfigError if a number is out of range.
    """

    holds: float
    by_strokes: bool = False
    fades: float = 0.0

    def __post_init__(self) -> None:
        least, most = (1, _MAX) if self.by_strokes else (0.0, 1.0)
        if not (least <= self.holds <= most and self.holds > 0):
            unit = "strokes" if self.by_strokes else "m2"
            raise ConfigError(f"A dip that holds {self.holds:g} {unit} was given; it is from {least:g} to {most:g}.")
        if not 0 <= self.fades <= 1:
            raise ConfigError(f"A dip that fades by {self.fades:g} was given; it is from 0 to 1.")

    @classmethod
    def of_strokes(cls, count: int) -> Self:
        """Returns a dip for `count` strokes."""
        return cls(float(count), by_strokes=True)

    def used_by(self, areas: Tensor) -> Tensor:
        """Returns the use of the dip by strokes of these areas, m2 [n]."""
        return torch.ones_like(areas) if self.by_strokes else areas

    def lacking(self, left: float, use: float) -> float:
        """Returns the share of paint that a mark lacks at its middle.

        left: rest of the dip before the stroke
        use: use of the dip by the stroke
        """
        spent = 1 - (left - use / 2) / self.holds
        return min(1.0, self.fades * max(0.0, spent - _STAYS_FULL) / (1 - _STAYS_FULL))

    def until(self, lacking: float) -> Self:
        """Returns a shorter dip that ends before marks lack more than that share of their paint."""
        if self.fades <= lacking:
            return self
        share = _STAYS_FULL + (1 - _STAYS_FULL) * lacking / self.fades
        return replace(self, holds=max(share * self.holds, float(self.by_strokes)), fades=lacking)

    def __str__(self) -> str:
        return f"{self.holds:.0f} strokes" if self.by_strokes else f"{self.holds * 1e4:.1f} cm²"


def painted_area(length: Tensor, thickness: Tensor, width: float) -> Tensor:
    """Returns the painted area of strokes, m2 [n]: length times mark width at that thickness."""
    return length * width * (0.25 + 0.75 * thickness)


class StrokeModel(Protocol):
    """Differentiable map from (thickness, length, bend) to magnitude maps.

    brush: name of the brush
    frame: rectangle of the map around the start of the stroke
    limits: limits of the brush, with the family of the strokes

    A model of a stroke family takes the codes of the strokes, [n, codes], in the place of bend [n]. Its frame is
    that of the largest stroke; the frame of a smaller one is smaller in the same proportion (`growth_of`).

        >>> import frida_painter as fp, torch
        >>> model: fp.StrokeModel = fp.load_stroke_model("fine")
        >>> half = torch.tensor([0.5])
        >>> maps = model(half, length=half * 0.04, bend=half * 0.0)
        >>> maps.dim(), bool(maps.min() >= 0), bool(maps.max() <= 1)
        (3, True, True)
    """

    @property
    def brush(self) -> str: ...  # noqa: D102

    @property
    def frame(self) -> MapFrame: ...  # noqa: D102

    @property
    def limits(self) -> StrokeLimits: ...  # noqa: D102

    def __call__(self, thickness: Tensor, length: Tensor, bend: Tensor) -> Tensor:
        """Returns magnitudes [n, rows, columns] in [0, 1].

        thickness [n]: in [0, 1]
        length [n], bend [n]: in metres
        """


_FAINT = 1 / 255  # less coverage changes no pixel


def require_stroke_model(model: object, what: str, error: type[FridaError] = WeightsError) -> StrokeModel:
    """Returns a stroke model after four trial strokes, from the lightest and shortest to the hardest and longest.

    what: subject of the sentence, such as "The stroke model of my.safetensors"
    Raises `error` if something is missing, or if its maps have another shape than its frame, are not in [0, 1], or
    mark nothing. Errors of the model itself pass through.
    """
    registry.require_like(model, StrokeModel, what, error)
    known: StrokeModel = model  # type: ignore[assignment]
    if not (isinstance(known.frame, MapFrame) and isinstance(known.limits, StrokeLimits)):
        raise error(f"{what} has a frame or limits of another type; they are a MapFrame and StrokeLimits.")
    (least, most), (left, right), family = known.limits.length, known.limits.bend, known.limits.family
    if not (0 < least <= most <= 1 and -1 <= left <= right <= 1):
        raise error(f"{what} has limits that are not metres, from least to most.")
    device = next((one.device for one in known.parameters()), None) if isinstance(known, torch.nn.Module) else None
    thickness, length = torch.tensor([[0.0, 0.5, 1.0, 1.0], [least, most, most, least]], device=device)
    bend = torch.tensor([0.0, left, right, 0.0], device=device)
    with torch.no_grad():
        maps = known(thickness, length, bend if family is None else bend.new_zeros(4, family.codes))
    wanted = (4, known.frame.rows, known.frame.columns)
    if not isinstance(maps, Tensor) or tuple(maps.shape) != wanted:
        given = tuple(maps.shape) if isinstance(maps, Tensor) else type(maps).__name__
        raise error(f"{what} gives maps of shape {given}; for 4 strokes they are {wanted}, as its frame says.")
    if not bool(((maps >= 0) & (maps <= 1)).all()):
        raise error(f"{what} gives magnitudes that are not in [0, 1]; keep them from 0, bare paper, to 1, covered.")
    if not bool((maps[1:].flatten(1).amax(1) > _FAINT).all()):
        raise error(
            f"{what} marks nothing where a stroke presses; return coverage there, or train it again (frida-painter "
            "strokes train)."
        )
    return known


def kind_of(model: StrokeModel) -> str:
    """Returns the kind of strokes of a model, as `plan.Layer.kind`: its brush, or brush and family ("fine+comma")."""
    return describe_kind(model.brush, model.limits.family)


def mark_width(model: StrokeModel) -> float:
    """Returns about the width of the brush's widest mark in metres, from the frame of its stroke model."""
    family = model.limits.family
    if family is None:
        return (model.frame.top - model.frame.bottom) / 3
    least, most = model.limits.length
    return (family.extent[0] * most - model.frame.left) * least / most / _AROUND


def growth_of(model: StrokeModel, length: Tensor) -> Tensor | None:
    """Returns the scale [n] of the model's frame for strokes of these lengths [n]; None if all have the same frame."""
    return None if model.limits.family is None else length / model.limits.length[1]


CELLS_ALONG = 80
_AROUND = 0.65  # of the brush's width, around the paths of a frame
_DIP_SHARE = 0.6
_IN_ANY_ORDER = 0.3  # largest share of paint that a mark may lack


@dataclass(frozen=True)
class BrushKind:
    """Brush with its name, limits and the width of its widest mark in metres.

    known_dip: measured capacity of one dip; None to use the default of `dip`
    studio: brush that represents it in the virtual studio; "" if the studio knows its name

    With `of_family` it is the brush that paints strokes of a family: then the limits name the family.
    """

    name: str
    limits: StrokeLimits
    width: float
    known_dip: Dip | None = None
    studio: str = ""

    @property
    def dip(self) -> Dip:
        """Capacity of one dip; by default 0.6 of the largest mark."""
        return self.known_dip or Dip(_DIP_SHARE * self.limits.length[1] * self.width)

    @property
    def in_studio(self) -> str:
        """Name of the brush that represents it in the virtual studio."""
        return self.studio or self.name

    def of_family(self, family: StrokeFamily) -> Self:
        """Returns the brush for the strokes of a family."""
        return replace(self, limits=StrokeLimits(family.size, (0.0, 0.0), family))

    def dipped_for(self, distance: float | None) -> "BrushKind":
        """Returns the brush whose dip paints that many millimetres with its whole width; the same one for None."""
        return self if distance is None else replace(self, known_dip=Dip(distance / 1000 * self.width))

    @property
    def for_any_order(self) -> Self:
        """Brush for strokes whose order ignores their importance: it is dipped before it gets too dry."""
        return replace(self, known_dip=self.dip.until(_IN_ANY_ORDER))

    def area(self, strokes: Strokes) -> Tensor:
        """Returns the painted area of each stroke, m2 [n]."""
        return painted_area(strokes.way(), strokes.thickness, self.width)

    @property
    def frame(self) -> MapFrame:
        """Rectangle around the start of a stroke that holds each mark of this brush, in nearly square cells.

        The path reaches 0.75 of the bend to the side. The rectangle adds half of the mark and a margin, for
        splayed bristles and for a brush that trails behind its tip.
        """
        around = _AROUND * self.width
        if (family := self.limits.family) is not None:
            # The frame of the smallest stroke is smaller, and its mark is not.
            least, most = self.limits.length
            around *= most / least
            left, right, bottom, top = (most * side for side in family.extent)
            left, right, bottom, top = left - around, right + around, bottom - around, top + around
            pitch = max(right - left, top - bottom) / CELLS_ALONG
            rows, columns = (4 * max(1, round(side / pitch / 4)) for side in (top - bottom, right - left))
            return MapFrame(left, right, bottom, top, rows, columns)
        aside = 0.75 * max(abs(bend) for bend in self.limits.bend) + around
        left, right = -around, self.limits.length[1] + around
        pitch = (right - left) / CELLS_ALONG
        rows = 4 * round(2 * aside / pitch / 4)  # the network's upscaler needs whole coarse cells
        return MapFrame(left, right, -rows * pitch / 2, rows * pitch / 2, rows, CELLS_ALONG)


def _kind(name: str, shortest: float, longest: float, bend: float, width: float, dip: float) -> BrushKind:
    return BrushKind(name, StrokeLimits((shortest, longest), (-bend, bend)), width, Dip(dip, fades=_FADES))


# At the end of a dip the brush is nearly dry; important strokes are painted before (session/hand.py).
_FADES = 0.5
FINE = _kind("fine", 0.008, 0.048, 0.012, 0.009, 6.5e-4)
MEDIUM = _kind("medium", 0.010, 0.060, 0.016, 0.017, 17.0e-4)
BROAD = _kind("broad", 0.012, 0.075, 0.022, 0.030, 44.0e-4)
KINDS = (FINE, MEDIUM, BROAD)


@dataclass(frozen=True)
class BrushModel:
    """Brush with a stroke model, registered under the name of the brush (registry.py).

    kind: the brush
    load: returns a stroke model with the same brush and limits; may raise WeightsError
    """

    kind: BrushKind
    load: Callable[[], StrokeModel]

    @property
    def name(self) -> str:
        """Name of the brush."""
        return self.kind.name


_READ_FAMILY = registry.Later("frida_painter_calibration.teaching.families:read_family")


@dataclass(frozen=True)
class FamilyPart:
    """Stroke family that is registered under its name (registry.py).

    folder: folder of its files
    help: the stroke in a few words
    """

    name: str
    folder: Path
    help: str = ""

    @property
    def file(self) -> Path:
        """File of the family itself."""
        return self.folder / f"{self.name}.safetensors"

    def load(self) -> StrokeFamily:
        """Returns the family. Raises FamilyError."""
        family: StrokeFamily = _READ_FAMILY(self.file)
        return family

    def weights(self, brush: str) -> Path | None:
        """Returns the file of the stroke model for a brush; None if nobody has learned one."""
        path = self.folder / f"{self.name}-{brush}.safetensors"
        return path if path.is_file() else None


def brush_kind(name: str) -> BrushKind:
    """Returns the brush of that name. Raises ConfigError if it is unknown, PluginError if it cannot be loaded."""
    for kind in KINDS:
        if kind.name == name:
            return kind
    known = registry.parts(registry.STROKE_MODELS)
    if name not in known:
        raise ConfigError(f"Brush {name!r} is not known; brushes are {', '.join(known)}.")
    return known[name].load(BrushModel).kind


class StrokeFunction:
    """Stroke model that calls a function of (thickness, length, bend).

    kind: brush, with its limits
    function: takes three tensors [n], thickness in [0, 1], length and bend in metres; returns magnitudes [n,
    rows, columns] in [0, 1] over the cells of `frame`. It need not be differentiable: the planner uses a table
    in its place (brush/table.py).
    frame: rectangle of a map around the start of its stroke; by default that of the brush
    """

    def __init__(
        self, kind: BrushKind, function: Callable[[Tensor, Tensor, Tensor], Tensor], frame: MapFrame | None = None
    ) -> None:
        self.kind, self.function = kind, function
        self.brush, self.frame, self.limits = kind.name, frame or kind.frame, kind.limits

    def __call__(self, thickness: Tensor, length: Tensor, bend: Tensor) -> Tensor:
        """Returns the function's maps [n, rows, columns]. Raises ConfigError if their shape or range is wrong."""
        maps = self.function(thickness, length, bend)
        wanted = (len(length), self.frame.rows, self.frame.columns)
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


# Variance of the coverage of a mark from stroke to stroke, as a function of the mean coverage
#
# A number in [0, full] with mean m has a variance of at most m (full - m). It has that variance if it is either 0
# or full, as at the edge of an opaque mark with a varying place. Marks reach about the same share of this bound
# nearly everywhere. So one share describes the variance of all marks of a brush.

_FULL = (0.5, 1.0, 51)  # least, most and number of tested values


class CoverageSpread(NamedTuple):
    """Variance of coverage with mean m: `share` m (full - m); 0 if m is above `full`.

    share: in [0, 1]; 0 if each mark equals its prediction
    full: coverage of the solid parts of a mark, in (0, 1]
    """

    share: float = 0.0
    full: float = 1.0

    def variance(self, mean: Tensor) -> Tensor:
        """Returns the variance for means of any shape, in [0, 1/4]."""
        return self.share * mean * (self.full - mean).clamp(min=0)

    @classmethod
    def fit(cls, mean: Tensor, coverage: Tensor) -> Self:
        """Returns the spread that best explains the squared errors of coverage, by least squares.

        mean, coverage: predictions and measurements of the same shape, in [0, 1]. The marks must not be
        training data of the model.
        """
        missed, best, least = (coverage - mean).square(), cls(), float("inf")
        for full in torch.linspace(*_FULL).tolist():
            whole = mean * (full - mean).clamp(min=0)
            share = min(1.0, float((missed * whole).sum() / whole.square().sum().clamp(min=1e-12)))
            left = float((missed - share * whole).square().sum())
            if left < least:
                best, least = cls(share, full), left
        return best

    def widen(self, factor: float) -> Self:
        """Returns the spread with `factor` times the variance; share is at most 1."""
        return self._replace(share=min(1.0, factor * self.share))

    def require(self) -> Self:
        """Returns the spread itself. Raises ValueError if a number is out of range."""
        if not (0 <= self.share <= 1 and 0 < self.full <= 1):
            raise ValueError(f"a spread of {self.share} and {self.full}")
        return self


CERTAIN = CoverageSpread()
"""Spread of a model without variation."""


def median_of(model: StrokeModel) -> Callable[[Tensor, Tensor, Tensor], Tensor]:
    """Returns the function for the median of a model's marks; the model itself if it has no median."""
    return getattr(model, "median", model)


def spread_of(model: object) -> CoverageSpread:
    """Returns the spread of a stroke model; CERTAIN if it has none."""
    return getattr(model, "spread", CERTAIN)


END_THICKNESS = 0.2
"""Thickness in [0, 1] at the start and the end of a stroke."""
_SAMPLES, _TAUGHT_SAMPLES = 513, 4097


def pressure(fraction: NDArray[np.float64], thickness: float) -> NDArray[np.float64]:
    """Returns thickness [k] at curve parameters [k]: the cubic Bezier 0.2, h, h, 0.2 of the paper's brush heights."""
    ends = fraction**3 + (1 - fraction) ** 3
    return END_THICKNESS * ends + thickness * (1 - ends)


def stroke_path(strokes: Strokes, index: int, step: float = 0.002) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns the path of stroke `index` as points at most `step` metres apart, including the ends.

    Returns positions [k, 2] in canvas metres and thickness [k] in [0, 1], which is linear in the height of the
    brush. The points are evenly spaced along the arc (paper, "Brush Stroke Model").
    Raises PlanError if the index is out of range or a number is not finite.
    """
    if not 0 < step < math.inf:
        raise PlanError(f"A step of {step} m was given for the path of a stroke; it is above 0 and finite.")
    if not 0 <= index < len(strokes):
        raise PlanError(f"Stroke {index} was asked for; there are {len(strokes)}, and the first is stroke 0.")
    stroke = strokes[index : index + 1].to("cpu")
    fraction = np.linspace(0, 1, _SAMPLES if stroke.taught is None else _TAUGHT_SAMPLES)
    position = _points(stroke, fraction)
    if not np.isfinite(position).all() or not math.isfinite(float(stroke.thickness)):
        raise PlanError(f"Stroke {index} has a number that is not finite; plan it anew.")
    walked = np.r_[0, np.cumsum(np.linalg.norm(np.diff(position, axis=0), axis=1))]
    # Chords are slightly shorter than the curve, so the step is reduced a little to stay within the limit.
    count = max(2, math.ceil(1.002 * walked[-1] / step) + 1)
    even = np.interp(np.linspace(0, walked[-1], count), walked, fraction) if walked[-1] > 0 else np.array([0.0, 1.0])
    if stroke.taught is None:
        return _points(stroke, even), pressure(even, float(stroke.thickness))
    (family,) = stroke.taught.families
    share = family.trace(torch.from_numpy(even), stroke.length.double(), stroke.taught.code.double())[1][0]
    return _points(stroke, even), np.asarray(share.detach().numpy() * float(stroke.thickness))


def _points(stroke: Strokes, fraction: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns points [k, 2] on the path of one stroke at curve parameters [k]."""
    if stroke.taught is not None:
        return np.asarray(stroke.detach().to(torch.float64).path(torch.from_numpy(fraction))[0].numpy())
    x, y = (float(part) for part in stroke.position[0])
    angle, length, bend = float(stroke.angle), float(stroke.length), float(stroke.bend)
    along, aside = fraction * length, 3 * fraction * (1 - fraction) * bend
    cos, sin = math.cos(angle), math.sin(angle)
    return np.stack((x + cos * along - sin * aside, y + sin * along + cos * aside), -1)
