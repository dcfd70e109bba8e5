"""The virtual studio as an easel, with the arm that does exactly what it is told."""

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from frida_painter import registry
from frida_painter.easel.kinds import DIARY, EaselKind, OpenEasel

if TYPE_CHECKING:
    from frida_painter.calibration import Calibration, Matrix
    from frida_painter.easel.order import EaselOrder
    from frida_painter.hardware.easel import Easel
    from frida_painter.virtual.camera import CameraSpec
    from frida_painter.virtual.studio import StudioSettings, VirtualStudio


def furnished(order: "EaselOrder", arm: str, **furniture: Any) -> "tuple[VirtualStudio, Easel]":
    """The studio with one of its arms, and its easel, which knows its brushes by the names in the order.

    furniture: fields of StudioSettings that are otherwise than ordered, or than usual. Raises ConfigError where the
    studio has no such brush, and StorageError.
    """
    from frida_painter.virtual.studio import StudioSettings, load_kernels, open_studio

    own = {name: studio_brush(name) for name in order.brushes}
    load_kernels(own[order.brushes[0]])
    ordered = {
        "arm": arm,
        "placement_error": order.placement_error,
        "pace": order.pace,
        "faults": order.faults,
        "picture": order.canvas_picture,
    }
    settings = StudioSettings(**{**ordered, **furniture})
    studio = open_studio(
        order.canvas,
        own,
        seed=order.seed,
        settings=settings,
        state=None if order.folder is None else order.folder / DIARY,
    )
    easel = replace(studio.easel, calibration=replace(studio.easel.calibration, color=_true_colors_of(settings.camera)))
    if order.canvas_picture is not None:
        easel = replace(easel, calibration=_having_seen_it_bare(easel.calibration, order, own, settings))
    return studio, easel


def _true_colors_of(camera: "CameraSpec") -> "Matrix":
    """From the light that the camera sees to true light, as a studio is delivered with its camera measured.

    Each of its bands holds a little of the others' light. Evenly lit white looks white to it, and a deep yellow ground
    would look so much bluer than it is that a painter who trusts the photograph paints against it.
    """
    import numpy as np

    unmixed = np.linalg.inv((1 - 3 * camera.bleed) * np.eye(3) + camera.bleed)
    return tuple((*map(float, row), 0.0) for row in unmixed)


def _having_seen_it_bare(
    known: "Calibration", order: "EaselOrder", brushes: Mapping[str, str], settings: "StudioSettings"
) -> "Calibration":
    """The record with what the same camera saw before anything was on the canvas."""
    from frida_painter.perception.flatfield import bare_canvas
    from frida_painter.virtual.studio import FREE, open_studio

    before = open_studio(order.canvas, brushes, seed=order.seed, settings=replace(settings, arm=FREE, picture=None))
    before.easel.camera.connect()
    photograph = before.easel.camera.capture(0.0).image
    return replace(known, bare=bare_canvas(photograph, known, order.canvas))


def studio_brush(name: str) -> str:
    """The brush that paints in the studio for the one of that name. Raises PluginError."""
    from frida_painter.brush.kinds import BrushModel

    known = registry.parts(registry.STROKE_MODELS).get(name)
    return name if known is None else known.load(BrushModel).kind.in_studio


def with_brush(easel: "Easel", name: str) -> "Easel":
    """The same easel, which knows its brush by that name."""
    return replace(easel, calibration=replace(easel.calibration, brush=name))


def _open_virtual(order: "EaselOrder") -> OpenEasel:
    from frida_painter.virtual.studio import FREE

    studio, easel = furnished(order, FREE)
    return OpenEasel(easel, studio.close)


def load_loops() -> None:
    """Compiles or loads the studio's loops, which are the same for all brushes."""
    from frida_painter.virtual.studio import load_kernels

    load_kernels("broad")


VIRTUAL_KIND = EaselKind("virtual", "virtual studio", _open_virtual, simulated=True, load=load_loops)
