"""Picture of the canvas that a person took, with any camera and from any place: rectified, and in true colours.

Nothing is known of the camera. So the four corners give the view, and the strokes that are on the canvas give the
light and the colours. They also tell whether it is this canvas at all, and which side of it is up.
"""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from frida_painter.calibration import Calibration, Corners
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import CalibrationError, FrameRejected
from frida_painter.frames import PixelGrid
from frida_painter.perception.flatfield import FlatField
from frida_painter.perception.landmarks import find_canvas
from frida_painter.perception.rectify import rectify
from frida_painter.strokes.palette import to_lab
from frida_painter.system.images import to_linear

_CELLS = 32  # squares along the shorter side; colours are compared by squares
_UNPAINTED = 1.5  # CIELAB; a square that the strokes change less is unpainted
_MIN_PAINTED = 3  # squares; fewer tell nothing
_MIN_SHOWN = 0.4  # share of the expected change that a picture of this canvas shows at least
_MIN_ALIKE = 0.6  # least correlation of the expected change with the seen one
_STRANGE, _MAX_STRANGE = 12.0, 0.12  # CIELAB, and share of the unpainted squares that may differ so much
_DIMMEST = 1e-4


@dataclass(frozen=True)
class Snapshot:
    """The canvas in a person's picture.

    canvas [3, rows, columns]: rectified, true sRGB
    corners: in the picture, clockwise from the top left of the upright canvas, (column, row)
    shown: share of the expected change that the picture shows; 1 is as expected
    alike: correlation of the expected change with the seen one
    """

    canvas: Tensor
    corners: Corners
    shown: float
    alike: float


def find_corners(photograph: NDArray[np.uint8], size: CanvasSize) -> Corners:
    """Returns the corners of a canvas in a picture [H, W, 3], clockwise from any of them.

    Raises CalibrationError if no canvas stands out from the table.
    """
    try:
        return find_canvas(photograph, size).corners
    except CalibrationError as unseen:
        if size.width == size.height:
            raise
        try:  # the picture was taken from a side of the table
            return find_canvas(photograph, CanvasSize(size.height, size.width)).corners
        except CalibrationError:
            raise unseen from None


def read_snapshot(
    photograph: NDArray[np.uint8], corners: Corners, size: CanvasSize, before: Tensor, expected: Tensor
) -> Snapshot:
    """Returns the canvas in a person's picture, with the side up that fits the expected canvas best.

    photograph [H, W, 3]: sRGB bytes
    corners: clockwise from any of them
    before, expected [3, rows, columns]: the bare ground, and the canvas as it should look now
    Raises FrameRejected, with the reason, if it is another canvas or the picture cannot be used.
    """
    ground, best = _coarsen(before, size), None
    wanted = _coarsen(expected, size) - ground
    for turned in list_turns(corners, size):
        view = Calibration("snapshot", "any", turned, photograph.shape[:2], touch_height=0.0, press_height=-1.0)
        seen = rectify(photograph, view, PixelGrid(size, *expected.shape[1:]))
        canvas = _fit_light(seen, before, expected, size).correct(seen).float()
        change = _coarsen(canvas, size) - ground
        both, weight = float((wanted * change).sum()), wanted.square().sum()
        alike = both / float((weight * change.square().sum()).sqrt().clamp(min=1e-6))
        if best is None or alike > best.alike:
            best, shows = Snapshot(canvas, turned, both / float(weight.clamp(min=1e-6)), alike), change
    assert best is not None
    painted = wanted.norm(dim=0) > _UNPAINTED
    strange = shows.norm(dim=0)[~painted] > _STRANGE
    covered = float(strange.float().mean()) if len(strange) else 0.0
    if int(painted.sum()) >= _MIN_PAINTED and not (best.shown >= _MIN_SHOWN and best.alike >= _MIN_ALIKE):
        shown, alikes = (f"{100 * max(0.0, share):.0f} %" for share in (best.shown, best.alike))
        raise FrameRejected(
            f"The picture does not show this canvas: {shown} of its strokes can be seen, and their places agree by "
            f"{alikes}. Take a picture of this canvas as a whole, with all four corners."
        )
    if not covered <= _MAX_STRANGE:
        raise FrameRejected(
            f"The picture shows something that nobody painted on {100 * covered:.0f} % of the unpainted canvas: take "
            "arms, hands and shadows away, or take a picture of this canvas, and not of another one."
        )
    return best


def list_turns(corners: Corners, size: CanvasSize) -> list[Corners]:
    """Returns the corners from each corner that may be the top left: all of a square, else two."""
    turned = [(*corners[first:], *corners[:first]) for first in range(4)]
    if abs(size.width / size.height - 1) < 0.02:
        return turned
    side = np.linalg.norm(np.roll(np.array(corners), -1, 0) - np.array(corners), axis=1)
    lies = (side[0] + side[2] >= side[1] + side[3]) == (size.width >= size.height)
    return turned[::2] if lies else turned[1::2]


def _fit_light(seen: Tensor, before: Tensor, expected: Tensor, size: CanvasSize) -> FlatField:
    """Returns the light in a rectified picture: brightness, colour and direction, from all of the expected canvas.

    The bare parts then refine it.
    """
    rows, columns = _shape(size)
    dim, bright = (
        functional.adaptive_avg_pool2d(to_linear(each)[None], (rows, columns))[0] for each in (seen, expected)
    )
    change = (dim.clamp(min=_DIMMEST) / bright.clamp(min=_DIMMEST)).log().flatten(1).double()
    middles = ((2 * torch.arange(count, dtype=torch.float64) + 1) / count - 1 for count in (rows, columns))
    down, across = torch.meshgrid(*middles, indexing="ij")
    field, _ = FlatField.even().fit_tilt(change, down.flatten(), across.flatten())
    ground = before.flatten(1).median(1).values
    bare = (to_lab(expected.permute(1, 2, 0)) - to_lab(ground)).norm(dim=-1) <= _UNPAINTED
    red, green, blue = ground.tolist()
    return field.refit(to_linear(seen), bare, (red, green, blue))


def _coarsen(picture: Tensor, size: CanvasSize) -> Tensor:
    """Returns a picture in coarse squares, CIELAB [3, rows, columns]."""
    coarse = functional.adaptive_avg_pool2d(picture[None].float(), _shape(size))[0]
    return to_lab(coarse.permute(1, 2, 0)).permute(2, 0, 1)


def _shape(size: CanvasSize) -> tuple[int, int]:
    """Returns the rows and columns of coarse squares."""
    pitch = min(size.width, size.height) / _CELLS
    return max(_CELLS, round(size.height / pitch)), max(_CELLS, round(size.width / pitch))
