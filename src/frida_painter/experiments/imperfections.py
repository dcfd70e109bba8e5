"""The virtual studio without some of its imperfections: what is each of them worth to a painting?

The studio itself stays as it is. What its settings can leave out is left out there; the rest is taken from the studio
once it is open.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from torch import Tensor

from frida_painter.experiments.execution import EXACT
from frida_painter.hardware.easel import Operator
from frida_painter.palette import Palette
from frida_painter.session.easel_kind import OpenEasel
from frida_painter.session.easel_kinds.studio import furnished
from frida_painter.session.easel_order import EaselOrder
from frida_painter.virtual.camera import CameraSpec
from frida_painter.virtual.studio import FREE, VirtualStudio
from frida_painter.virtual.table import HandNoise, Table

_ENDLESS = 1000.0  # times the paint that a brush holds
_COVERING = 100.0  # times the absorption and the scattering of a paint
_AT_ONCE = 1e-3  # seconds in which paint dries


@dataclass(frozen=True)
class Imperfection:
    """Something that is not perfect in the studio.

    name: as tables show it; furniture: fields of StudioSettings without it; remove: takes it from an open studio.
    """

    name: str
    furniture: Mapping[str, Any] = field(default_factory=dict)
    remove: Callable[[VirtualStudio], None] = lambda studio: None


def _never_runs_out(studio: VirtualStudio) -> None:
    """Its share of the capacity decides what a bristle leaves: one that holds a thousand times as much stays full."""
    for tuft in studio.tufts.values():
        tuft.capacity *= _ENDLESS


def _lies_flat(studio: VirtualStudio) -> None:
    studio.canvas.tooth[...] = 0.0


def _covers(studio: VirtualStudio) -> None:
    """A film of paint whose absorption and scattering grow alike keeps its colour and hides what lies below it."""
    studio.easel = replace(studio.easel, operator=_OpaquePaint(studio.easel.operator, studio.table))


PLACEMENT = Imperfection("placement error", {"placement_error": EXACT})
HAND = Imperfection("hand noise", {"noise": HandNoise(0.0, 0.0)})
LOAD = Imperfection("running out", remove=_never_runs_out)
WETNESS = Imperfection("wet mixing", {"drying_time": _AT_ONCE})
TRANSLUCENCY = Imperfection("translucency", remove=_covers)
TOOTH = Imperfection("canvas tooth", remove=_lies_flat)
CAMERA = Imperfection("camera error", {"camera": CameraSpec.ideal()})
IMPERFECTIONS = (PLACEMENT, HAND, LOAD, WETNESS, TRANSLUCENCY, TOOTH, CAMERA)


class StudioWithout:
    """Opens the virtual studio without some imperfections, and shows its canvas as it is afterwards."""

    def __init__(self, imperfections: Sequence[Imperfection] = ()) -> None:
        self._without = imperfections
        self._studio: VirtualStudio | None = None

    def open(self, order: EaselOrder) -> OpenEasel:
        """The studio that is ordered. Raises ConfigError where it has no such brush."""
        furniture = {name: value for one in self._without for name, value in one.furniture.items()}
        studio, easel = furnished(order, FREE, **furniture)
        for one in self._without:
            one.remove(studio)
        self._studio = studio
        return OpenEasel(replace(easel, operator=studio.easel.operator), studio.close)

    def truth(self, rows: int) -> Tensor:
        """The canvas as it is, sRGB [3, rows, columns], straight on and in even light. Never for the painter."""
        assert self._studio is not None, "open comes first"
        return self._studio.truth(rows)


@dataclass(frozen=True)
class _OpaquePaint:
    """The studio's operator, who fills the wells with paint that hides what it is laid on."""

    usual: Operator
    table: Table

    def fill_wells(self, palette: Palette) -> None:
        """Fills well i with paint i."""
        self.usual.fill_wells(palette)
        self.table.paints = tuple(_COVERING * paint for paint in self.table.paints)

    def tone(self, ground: tuple[float, float, float]) -> None:
        """As usual, and so are the others."""
        self.usual.tone(ground)

    def change_brush(self, brush: str) -> None:
        """The same."""
        self.usual.change_brush(brush)

    def let_dry(self, seconds: float) -> None:
        """Time passes."""
        self.usual.let_dry(seconds)

    def lay_paper(self) -> bool:
        """Fresh paper."""
        return self.usual.lay_paper()

    def lay_checker(self) -> bool:
        """The colour checker."""
        return self.usual.lay_checker()

    def take_checker_away(self) -> bool:
        """And away."""
        return self.usual.take_checker_away()
