"""What is asked for on the page, in the settings of the command line, as the worker needs them."""

from frida_painter.config import PaintingSettings
from frida_painter.frames import CanvasSize
from frida_painter.hardware.workcell import WorkcellConfig
from frida_painter.web.calibrate import Calibrate
from frida_painter.web.station import Station
from frida_painter.web.wish import Wish


def to_paint(wish: Wish) -> PaintingSettings:
    """How a wish is painted. Raises ConfigError."""
    return PaintingSettings.of(
        strokes=wish.strokes,
        colors=min(wish.colors, wish.strokes),
        canvas=CanvasSize(wish.width / 1000, wish.height / 1000),
        brush=wish.brush,
        replans=min(wish.replans, wish.strokes - 1),
        effort=wish.effort,
        seed=wish.seed,
    )


def to_calibrate(wish: Calibrate, station: Station) -> PaintingSettings:
    """On what is calibrated: the canvas of the workspace file, where there is one. Raises ConfigError."""
    size = CanvasSize(wish.width / 1000, wish.height / 1000)
    if station.workspace is not None:
        size = WorkcellConfig.load(station.workspace).canvas
    return PaintingSettings.of(canvas=size, brush=wish.brush, seed=wish.seed)
