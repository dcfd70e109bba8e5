"""The margin around the canvas: by it the light is known on a canvas that is not bare.

A bare white canvas shows the light itself. Where something is on the canvas, the light is as it was when the canvas
was bare, changed as the margin has changed since: another brightness, another colour, light from another side.
"""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from frida_painter.calibration import BareCanvas, Calibration
from frida_painter.errors import CalibrationError, FrameRejected
from frida_painter.frames import CanvasSize, PixelGrid
from frida_painter.palette import to_lab
from frida_painter.perception.flatfield import FlatField
from frida_painter.perception.light import light_of_bytes, to_linear, to_srgb
from frida_painter.perception.rectify import photographed_pixels, rectify, require_photograph
from frida_painter.plan import WHITE

Color = tuple[float, float, float]
_ROWS = 256
_PLACES = 12  # on each side of the canvas
_BAND = (0.004, 0.012)  # metres beyond the edge
_ACROSS, _ALONG = 8, 9  # samples of a place
_DIMMEST = 0.003  # linear light, below which a place shows the camera's noise
_FEWEST = 16  # places
_MOST_RESIDUAL = 0.1
_CELLS = 24  # rows and columns of squares by which a canvas is called bare
_UNLIKE, _MOST_TOUCHED = 9.0, 0.02  # CIELAB of a square that has another colour, and the share of them in specks


def bare_canvas(photograph: NDArray[np.uint8], calibration: Calibration, size: CanvasSize) -> BareCanvas:
    """What a photograph [H, W, 3] of a bare white canvas tells of the light. Raises FrameRejected where it is none."""
    light = FlatField.learn(rectify(photograph, calibration, PixelGrid.of_height(size, _ROWS)), WHITE)
    seen = _margin(photograph, calibration, size)
    margin = tuple(None if np.isnan(place).any() else tuple(place.tolist()) for place in seen)
    return BareCanvas(tuple(map(tuple, light.logarithm.tolist())), margin)


def light_by_margin(photograph: NDArray[np.uint8], calibration: Calibration, size: CanvasSize) -> FlatField:
    """The light on a canvas with anything on it, by the margin now and when the canvas was bare.

    Raises CalibrationError where the record knows nothing of a bare canvas, and FrameRejected where the margin is
    not what it was, or too dark.
    """
    known = calibration.bare
    if known is None:
        raise CalibrationError(
            "What the light does is learned from a bare canvas, and the calibration record knows none; put up a bare "
            "white canvas once, and repeat the canvas calibration: frida-painter calibrate canvas"
        )
    before = np.array([(np.nan,) * 3 if place is None else place for place in known.margin])
    change = np.log(_margin(photograph, calibration, size) / before)
    usable = np.isfinite(change).all(1)
    if not usable.sum() >= _FEWEST:
        raise FrameRejected(
            f"Only {usable.sum()} of {len(usable)} places around the canvas can be seen in the photograph, and at "
            f"least {_FEWEST} tell what the light does; lay something brighter around the canvas, and leave room there."
        )
    row, column = _places(size).mean(1).T
    field = FlatField(torch.tensor(known.light))
    changed, residual = field.tilted(
        torch.from_numpy(change[usable]).T, torch.from_numpy(row[usable]), torch.from_numpy(column[usable])
    )
    if not residual <= _MOST_RESIDUAL:
        raise FrameRejected(
            f"The surroundings of the canvas differ by {100 * residual:.0f} % from what they were when the canvas was "
            f"bare, and {100 * _MOST_RESIDUAL:.0f} % is allowed; put them back, or repeat the canvas calibration with "
            "a bare canvas."
        )
    return changed


def share_unlike(canvas: Tensor, color: Color, tolerance: float = _UNLIKE) -> float:
    """The share of the canvas [3, H, W], in true colours, that is not of that colour (sRGB), within so much CIELAB."""
    squares = functional.adaptive_avg_pool2d(to_linear(canvas)[None], (_CELLS, _CELLS))[0]
    seen = to_lab(to_srgb(squares).permute(1, 2, 0))
    return float(((seen - to_lab(torch.tensor(color))).norm(dim=-1) > tolerance).double().mean())


def is_evenly(canvas: Tensor, color: Color, tolerance: float = _UNLIKE) -> bool:
    """Whether the canvas [3, H, W], in true colours, has that colour (sRGB) all over but for specks."""
    return share_unlike(canvas, color, tolerance) <= _MOST_TOUCHED


def _margin(photograph: NDArray[np.uint8], calibration: Calibration, size: CanvasSize) -> NDArray[np.float64]:
    """Linear light [places, 3] around the canvas; not a number where it is not seen, or dark."""
    require_photograph(photograph, calibration)
    place = _places(size)  # [places, samples, 2], (row, column) in [-1, 1] over the canvas
    grid = PixelGrid.of_height(size, _ROWS)
    side = np.array([grid.columns, grid.rows])
    pixel = (place[..., ::-1].reshape(-1, 2) + 1) / 2 * side - 0.5
    seen = photographed_pixels(pixel, calibration, grid)
    rows, columns = photograph.shape[:2]
    inside = np.all((seen >= 0) & (seen <= np.array([columns, rows]) - 1), axis=1)
    column, row = np.where(inside[:, None], seen, 0).round().astype(int).T
    light = light_of_bytes(photograph[row, column]).astype(np.float64)
    light[~inside] = np.nan
    mean = light.reshape(*place.shape[:2], 3).mean(1)
    mean[(mean < _DIMMEST).any(1)] = np.nan
    return mean


def _places(size: CanvasSize) -> NDArray[np.float64]:
    """Samples [places, samples, 2] around the canvas, clockwise from its top left: (row, column) in its halves."""
    along = (np.arange(_PLACES) + 0.5) / _PLACES * 2 - 1
    step = (np.arange(_ALONG) + 0.5) / _ALONG * 2 - 1
    half = np.array([size.height, size.width]) / 2
    sides = []
    for down, out in ((False, -1), (True, 1), (False, 1), (True, -1)):
        beyond = out * (1 + np.linspace(*_BAND, _ACROSS) / half[1 if down else 0])
        at = along[:, None, None] + step[None, :, None] / _PLACES
        away = np.broadcast_to(beyond[None, None], (_PLACES, _ALONG, _ACROSS))
        at = np.broadcast_to(at, away.shape)
        pair = (at, away) if down else (away, at)
        sides.append(np.stack(pair, -1).reshape(_PLACES, -1, 2))
    return np.concatenate(sides)
