"""The virtual studio as an easel, with an ideal arm."""

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from frida_painter import registry
from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.kinds import SIMULATION_LOG, EaselKind, OpenEasel

if TYPE_CHECKING:
    from frida_painter.calibration import Calibration, Matrix
    from frida_painter.easel.order import EaselOrder
    from frida_painter.hardware.easel import Easel
    from frida_painter.virtual.camera import CameraSpec
    from frida_painter.virtual.studio import StudioSettings, VirtualStudio

PAPER = CanvasSize(0.42, 0.297)
PRINT, PRINT_DENSITY = 3000, 300 / 0.0254
"""Least pixels of the longer side of the print of a painting; fewer if so many pixels a metre, 300 dpi, are enough."""


def assemble_easel(order: "EaselOrder", arm: str, **furniture: Any) -> "tuple[VirtualStudio, Easel]":
    """Opens the studio with one of its arms; returns it with its easel, which has the order's brush names.

    furniture: fields of StudioSettings that replace those of the order or the defaults
    Raises ConfigError if the studio has no such brush, PluginError if a stroke model cannot be loaded, and
    StorageError.
    """
    from frida_painter.virtual.studio import StudioSettings, load_kernels, open_studio

    own = {name: studio_brush(name) for name in order.brushes}
    load_kernels(own[order.brushes[0]])
    wanted = order.simulation
    same = {name: getattr(wanted, name) for name in ("placement_error", "pace", "faults")}
    settings = StudioSettings(**{"arm": arm, **same, "picture": wanted.canvas_picture, **furniture})
    diary = None if order.folder is None else order.folder / SIMULATION_LOG
    enough = min(PRINT, round(PRINT_DENSITY * max(order.canvas.width, order.canvas.height)))
    settings = settings if diary is None else replace(settings, print_pixels=enough)
    studio = open_studio(order.canvas, own, seed=wanted.seed, settings=settings, state=diary)
    easel = replace(studio.easel, calibration=replace(studio.easel.calibration, color=_true_colors_of(settings.camera)))
    if wanted.canvas_picture is not None:
        easel = replace(easel, calibration=_with_bare_canvas(easel.calibration, order, own, settings))
    return studio, easel


def _true_colors_of(camera: "CameraSpec") -> "Matrix":
    """Returns the map from the camera's light to true light; a studio comes with a measured camera.

    Each band of the camera contains some light of the others. Even white looks white, but a deep yellow ground
    looks too blue. A painter that trusts the photograph would then correct an error that does not exist.
    """
    import numpy as np

    unmixed = np.linalg.inv((1 - 3 * camera.bleed) * np.eye(3) + camera.bleed)
    return tuple((*map(float, row), 0.0) for row in unmixed)


def _with_bare_canvas(
    known: "Calibration", order: "EaselOrder", brushes: Mapping[str, str], settings: "StudioSettings"
) -> "Calibration":
    """Returns the calibration with the bare canvas as the same camera sees it."""
    from frida_painter.perception.flatfield import bare_canvas
    from frida_painter.virtual.studio import FREE, open_studio

    before = open_studio(
        order.canvas, brushes, seed=order.simulation.seed, settings=replace(settings, arm=FREE, picture=None)
    )
    before.easel.camera.connect()
    photograph = before.easel.camera.capture(0.0).image
    return replace(known, bare=bare_canvas(photograph, known, order.canvas))


def studio_brush(name: str) -> str:
    """Returns the studio's brush that stands for a named brush. Raises PluginError."""
    from frida_painter.brush.kinds import BrushModel

    known = registry.parts(registry.STROKE_MODELS).get(name)
    return name if known is None else known.load(BrushModel).kind.in_studio


def with_brush(easel: "Easel", name: str) -> "Easel":
    """Returns the easel with another name of its brush."""
    return replace(easel, calibration=replace(easel.calibration, brush=name))


def _open_virtual(order: "EaselOrder") -> OpenEasel:
    from frida_painter.virtual.studio import FREE

    studio, easel = assemble_easel(order, FREE)
    return OpenEasel(easel, studio.close)


def open_virtual_easel(brush: str, seed: int) -> "Easel":
    """Opens a virtual studio for painting a stroke library: paper, and a robot without a placement error."""
    from frida_painter.hardware.faults import PlacementError
    from frida_painter.virtual.studio import open_studio

    studio = open_studio(PAPER, studio_brush(brush), seed=seed, placement_error=PlacementError((0.0, 0.0), 0.0))
    studio.easel.robot.connect()
    studio.easel.camera.connect()
    return with_brush(studio.easel, brush)


def load_loops() -> None:
    """Compiles or loads the studio's numerical loops, which are the same for all brushes."""
    from frida_painter.virtual.studio import load_kernels

    load_kernels("broad")


VIRTUAL_KIND = EaselKind("virtual", "virtual studio", _open_virtual, simulated=True, load=load_loops)
