"""Rectification of photographs of the easel to pictures of the canvas, and fits of homographies."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.calibration import Calibration
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import CalibrationError, FrameRejected
from frida_painter.frames import PixelGrid
from frida_painter.system.images import light_of_bytes, to_srgb

# Map from commanded to painted positions, fitted to places at which both are known

FEWEST = 5
"""Smallest number of places for a fit."""
_SINGULAR = 0.2  # smallest scale of areas, and of their inverse
_OUTLYING = 3.5  # times the usual distance
_ROUNDS = 5


@dataclass(frozen=True)
class Fit:
    """Fitted homography of canvas metres.

    matrix [3, 3]: scaled so that its last number is 1
    kind: "similarity", "affine" or "homography"
    off [n]: distance of each place from its mapped position in metres
    used [n]: True for places that the fit used
    """

    matrix: NDArray[np.float64]
    kind: str
    off: NDArray[np.float64]
    used: NDArray[np.bool_]

    @property
    def residual(self) -> float:
        """Root mean square of the remaining distances of used places in metres."""
        return float(np.sqrt(np.mean(self.off[self.used] ** 2)))

    def inverse(self) -> NDArray[np.float64]:
        """Returns the inverse homography [3, 3] with last number 1."""
        back = np.linalg.inv(self.matrix)
        return back / back[2, 2]


def apply(matrix: NDArray[np.float64], places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the positions of places [n, 2] after a homography [3, 3]."""
    homogeneous = np.c_[places, np.ones(len(places))] @ matrix.T
    return homogeneous[:, :2] / homogeneous[:, 2:]


def fit_homography(meant: NDArray[np.float64], seen: NDArray[np.float64]) -> Fit:
    """Returns the best homography from places `meant` [n, 2] to places `seen` [n, 2].

    A robot that only stands askew needs four numbers; a homography fits its other four to the noise of the
    dots. So the fit with the lowest corrected information criterion is chosen from similarity, affine map and
    homography (N. Sugiura, 1978). Outliers are left out.
    Raises CalibrationError if there are too few places, or if the fit is singular or mirrored.
    """
    there = np.asarray(np.isfinite(meant).all(1) & np.isfinite(seen).all(1), bool)
    fit = _fit_simplest(meant, seen, there)
    for _ in range(_ROUNDS):
        usual = max(float(np.median(fit.off[fit.used])), 1e-9)
        used = np.asarray(there & (fit.off <= _OUTLYING * usual), bool)
        if used.sum() < FEWEST or (used == fit.used).all():
            break
        fit = _fit_simplest(meant, seen, used)
    _refuse_impossible(fit.matrix, meant[fit.used])
    return fit


def _fit_simplest(meant: NDArray[np.float64], seen: NDArray[np.float64], used: NDArray[np.bool_]) -> Fit:
    numbers, fits = 2 * int(used.sum()), []
    if not numbers >= 2 * FEWEST:
        raise CalibrationError(
            f"A placement was to be fitted to {used.sum()} places; {FEWEST} are needed. Repeat the robot calibration."
        )
    for kind, unknowns, fitted in (("similarity", 5, _similarity), ("affine", 7, _affine), ("homography", 9, _full)):
        matrix = fitted(meant[used], seen[used])
        off = np.linalg.norm(apply(matrix, meant) - seen, axis=1)
        variance = max(float(np.mean(off[used] ** 2)) / 2, 1e-18)  # one of the unknowns
        correction = 2 * unknowns * (unknowns + 1) / max(numbers - unknowns - 1, 1)
        fits.append((numbers * np.log(variance) + 2 * unknowns + correction, Fit(matrix, kind, off, used)))
    return min(fits, key=lambda scored: scored[0])[1]


def _similarity(meant: NDArray[np.float64], seen: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the best similarity, which may be mirrored; `_refuse_impossible` rejects that (S. Umeyama, 1991)."""
    middle, there = meant.mean(0), seen.mean(0)
    u, stretch, vt = np.linalg.svd((seen - there).T @ (meant - middle))
    scale = stretch.sum() / max(float(((meant - middle) ** 2).sum()), 1e-18)
    matrix = np.eye(3)
    matrix[:2, :2] = scale * u @ vt
    matrix[:2, 2] = there - matrix[:2, :2] @ middle
    return matrix


def _affine(meant: NDArray[np.float64], seen: NDArray[np.float64]) -> NDArray[np.float64]:
    columns = np.c_[meant, np.ones(len(meant))]
    matrix = np.eye(3)
    matrix[:2] = np.linalg.lstsq(columns, seen, rcond=None)[0].T
    return matrix


def _full(meant: NDArray[np.float64], seen: NDArray[np.float64]) -> NDArray[np.float64]:
    matrix, _ = cv2.findHomography(meant, seen, 0)
    if matrix is None or not abs(matrix[2, 2]) > 1e-9:
        return _affine(meant, seen)
    return np.asarray(matrix / matrix[2, 2], np.float64)


def _refuse_impossible(matrix: NDArray[np.float64], places: NDArray[np.float64]) -> None:
    """Raises CalibrationError if the map folds, flattens or mirrors the canvas around the places."""
    low, high = places.min(0), places.max(0)
    around = np.array([(x, y) for x in (low[0], high[0]) for y in (low[1], high[1])])
    depth = np.c_[around, np.ones(4)] @ matrix[2]
    # The determinant of a homography's derivative at a place is that of the matrix over the depth cubed.
    area = np.linalg.det(matrix) / np.where(depth > 0, depth, np.nan) ** 3
    spread = np.linalg.svd(places - places.mean(0), compute_uv=False)
    if not spread[-1] > 0.05 * spread[0]:
        raise CalibrationError(
            "The dots that were found lie on one line, which tells nothing about the rest of the canvas; "
            "repeat the robot calibration."
        )
    if (area <= -_SINGULAR).any():  # a flat map has a random sign
        raise CalibrationError(
            "The robot paints mirrored: one of its axes runs the other way than the workspace says. Mend the "
            "workspace, then repeat the robot calibration."
        )
    if not ((area >= _SINGULAR) & (area <= 1 / _SINGULAR)).all():
        raise CalibrationError(
            "The fitted placement is singular: it folds or flattens the canvas. Look whether the dots on the canvas "
            "are where they should be, then repeat the robot calibration."
        )


_DARKEST = 0.01  # linear light of the brightest part; the canvas may be black, but not everything around it
_BRIGHTEST, _APART = 0.01, 4  # share of the brightest part, and step between the tested pixels
_MAX_OVERLAP = 2.0
_RIM = 1.0  # pixels of the photograph; a corner is known to about half a pixel
_FINEST = 8
_STRIDE = 16


def rectify(photograph: NDArray[np.uint8], calibration: Calibration, grid: PixelGrid) -> Tensor:
    """Returns the rectified canvas [3, rows, columns], sRGB in [0, 1], float32, with its top-left corner at (0, 0).

    photograph [rows, columns, 3]: uint8 sRGB
    The distortion of a known lens is removed. If the photograph is finer than the grid, each pixel is the mean
    over its area in linear light, which avoids aliasing.
    Raises FrameRejected if the photograph is dark or not from the calibrated camera.
    """
    require_photograph(photograph, calibration)
    require_some_light(photograph)
    places, border = sampling_places(calibration, grid), cv2.BORDER_REPLICATE
    light = cv2.remap(light_of_bytes(photograph), *places, cv2.INTER_LINEAR, borderMode=border)
    if light.shape[:2] != (grid.rows, grid.columns):
        light = cv2.resize(light, (grid.columns, grid.rows), interpolation=cv2.INTER_AREA)
    return to_srgb(torch.from_numpy(np.ascontiguousarray(light.transpose(2, 0, 1), np.float32)))


def sampling_places(calibration: Calibration, grid: PixelGrid) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Returns column and row in the photograph of each sample: [f rows, f columns] each.

    Each pixel of the grid is the mean in linear light of its f x f samples, as in `rectify`. The outermost samples fall
    into photograph pixels that show some of the table, which would look like a dark line along the canvas edge: they
    use the positions of their inner neighbours.
    """
    fineness = _fineness(calibration, grid)
    rows, columns = grid.rows * fineness, grid.columns * fineness
    across, down = _rim(calibration, rows, columns)
    column, row = _project(calibration, rows, columns)
    inside = np.ix_(
        np.clip(np.arange(rows), down, rows - 1 - down), np.clip(np.arange(columns), across, columns - 1 - across)
    )
    return np.ascontiguousarray(column[inside]), np.ascontiguousarray(row[inside])


def require_some_light(photograph: NDArray[np.uint8]) -> None:
    """Raises FrameRejected if a photograph [H, W, 3], sRGB bytes, is dark."""
    if not float((light_of_bytes(photograph[::_APART, ::_APART]) >= _DARKEST).mean()) >= _BRIGHTEST:
        raise FrameRejected("The photograph of the canvas is dark; switch the light on and take the camera's cap off.")


def rectified_pixels(place: NDArray[np.float64], calibration: Calibration, grid: PixelGrid) -> NDArray[np.float64]:
    """Returns the positions in the rectified picture of photograph positions [n, 2], both (column, row).

    NaN at positions that the calibrated lens does not show.
    """
    seen = _undistort(np.array(calibration.corners), calibration)
    view = cv2.getPerspectiveTransform(seen.astype(np.float32), _outline(grid.rows, grid.columns))
    straight = _undistort(np.asarray(place, np.float64), calibration)
    return np.asarray(cv2.perspectiveTransform(straight[None], view)[0], np.float64)


def photographed_pixels(place: NDArray[np.float64], calibration: Calibration, grid: PixelGrid) -> NDArray[np.float64]:
    """Returns the positions in the photograph of positions [n, 2] in the rectified picture or outside it.

    Both are (column, row).
    """
    view = _to_photograph(calibration, grid.rows, grid.columns)
    straight = np.asarray(cv2.perspectiveTransform(np.asarray(place, np.float64)[None], view)[0], np.float64)
    return straight if calibration.lens is None else calibration.lens.distort(straight)


def _outline(rows: int, columns: int) -> NDArray[np.float32]:
    """Returns the corners of a picture, clockwise from the top left: the outer corners of its corner pixels."""
    right, lower = columns - 0.5, rows - 0.5
    return np.array([(-0.5, -0.5), (right, -0.5), (right, lower), (-0.5, lower)], np.float32)


def _to_photograph(calibration: Calibration, rows: int, columns: int) -> NDArray[np.float64]:
    """Returns the homography [3, 3] from a picture of rows x columns samples to the undistorted photograph."""
    seen = _undistort(np.array(calibration.corners), calibration)
    return np.asarray(cv2.getPerspectiveTransform(_outline(rows, columns), seen.astype(np.float32)), np.float64)


def _undistort(seen: NDArray[np.float64], calibration: Calibration) -> NDArray[np.float64]:
    return seen if calibration.lens is None else calibration.lens.undistort(seen)


def _project(calibration: Calibration, rows: int, columns: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Returns column and row in the photograph of rows x columns places of the canvas.

    They are computed for one place in 16 x 16 and interpolated between them, with an error below 0.01 pixels.
    """
    down, across = (_STRIDE * np.arange(-1, side // _STRIDE + 2) + (_STRIDE - 1) / 2 for side in (rows, columns))
    grid = np.stack(np.meshgrid(across, down), -1)
    seen = np.asarray(cv2.perspectiveTransform(grid, _to_photograph(calibration, rows, columns)), np.float64)
    if calibration.lens is not None:
        seen = calibration.lens.distort(seen.reshape(-1, 2)).reshape(grid.shape)
    fine = cv2.resize(
        seen.astype(np.float32), (_STRIDE * len(across), _STRIDE * len(down)), interpolation=cv2.INTER_LINEAR
    )
    cut = np.asarray(fine, np.float32)[_STRIDE : _STRIDE + rows, _STRIDE : _STRIDE + columns]
    return np.ascontiguousarray(cut[..., 0]), np.ascontiguousarray(cut[..., 1])


def require_photograph(photograph: NDArray[np.uint8], calibration: Calibration) -> None:
    """Raises FrameRejected if the photograph cannot be from the calibrated camera, or the canvas leaves it."""
    wanted = (*calibration.photograph, 3)
    if photograph.shape != wanted or photograph.dtype != np.uint8:
        raise FrameRejected(
            f"A photograph of shape {photograph.shape} and kind {photograph.dtype} was taken; the calibration is for "
            f"{wanted} and uint8; set the camera as it was, or repeat the canvas calibration."
        )
    column, row = np.array(calibration.corners).T
    rows, columns = calibration.photograph
    overlap = max(-column.min(), -row.min(), column.max() - (columns - 1), row.max() - (rows - 1))
    if not overlap <= _MAX_OVERLAP:
        raise FrameRejected(
            f"The canvas reaches {overlap:.0f} pixels beyond the photograph; move the camera until it sees all four "
            "corners, and repeat the canvas calibration."
        )


def _rim(calibration: Calibration, rows: int, columns: int) -> tuple[int, int]:
    """Returns the width of the rim in samples: (left and right, top and bottom)."""
    top, right, bottom, left = list_sides(calibration)
    return math.ceil(_RIM * columns / min(top, bottom)), math.ceil(_RIM * rows / min(left, right))


def list_sides(calibration: Calibration) -> tuple[float, float, float, float]:
    """Returns the lengths of the canvas's top, right, bottom and left side in photograph pixels."""
    corners = np.array(calibration.corners)
    top, right, bottom, left = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1).tolist()
    return top, right, bottom, left


def pixels_per_metre(calibration: Calibration, size: CanvasSize) -> float:
    """Returns the pixels of the photograph per metre of the canvas, averaged over its sides."""
    return sum(list_sides(calibration)) / (2 * (size.width + size.height))


def _fineness(calibration: Calibration, grid: PixelGrid) -> int:
    """Returns the number of samples along each side of a grid pixel that reaches each photograph pixel."""
    top, right, bottom, left = list_sides(calibration)
    denser = max(top / grid.columns, bottom / grid.columns, left / grid.rows, right / grid.rows)
    return min(_FINEST, max(1, math.ceil(denser)))
