"""Brushes by name, ours and those of other packages, and the rectangle in which a brush's marks lie."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Self

from torch import Tensor

from frida_painter import registry
from frida_painter.brush.dip import Dip, painted_area
from frida_painter.brush.stroke_model import StrokeModel
from frida_painter.errors import ConfigError
from frida_painter.frames import MapFrame
from frida_painter.strokes import StrokeLimits, Strokes

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


# At the end of a dip the brush is nearly dry; strokes that matter are painted before (session/stroke_order.py).
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
