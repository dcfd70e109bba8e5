"""The virtual studio as it is ordered: with the brush that stands in it for the painting's."""

from dataclasses import replace

from frida_painter import registry
from frida_painter.brush.kinds import BrushModel
from frida_painter.hardware.easel import Easel
from frida_painter.session.easel_order import EaselOrder
from frida_painter.session.names import DIARY
from frida_painter.virtual.kernels import load_kernels
from frida_painter.virtual.studio import StudioSettings, VirtualStudio, open_studio


def furnished(order: EaselOrder, arm: str) -> tuple[VirtualStudio, Easel]:
    """The studio with one of its arms, and its easel, which knows the brush by the name in the order.

    Raises ConfigError where the studio has no such brush, and StorageError.
    """
    own = studio_brush(order.brush)
    load_kernels(own)
    studio = open_studio(
        order.canvas,
        own,
        seed=order.seed,
        settings=StudioSettings(arm=arm, placement_error=order.placement_error, pace=order.pace, faults=order.faults),
        state=None if order.folder is None else order.folder / DIARY,
    )
    return studio, with_brush(studio.easel, order.brush)


def studio_brush(name: str) -> str:
    """The brush that paints in the studio for the one of that name. Raises PluginError."""
    known = registry.parts(registry.STROKE_MODELS).get(name)
    return name if known is None else known.load(BrushModel).kind.in_studio


def with_brush(easel: Easel, name: str) -> Easel:
    """The same easel, which knows its brush by that name."""
    return replace(easel, calibration=replace(easel.calibration, brush=name))
