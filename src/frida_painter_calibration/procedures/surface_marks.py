"""Height map of an uneven canvas, learned from marks: no sense of touch is needed, and nobody lowers the brush.

The brush paints a grid of short marks, at a few heights at each point. A picture of them shows their widths. A mark is
wider if the canvas is higher there. One curve of width over depth is fitted to all marks, together with the height of
the canvas at each point; the middle of the canvas, the place of the brush calibration, has height 0.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import least_squares
from torch import Tensor

from frida_painter.brush.kinds import BrushKind
from frida_painter.calibration import SurfaceMap
from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.dialogue import Finding, Procedure
from frida_painter.errors import CalibrationError, ConfigError
from frida_painter.frames import PixelGrid
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.motion import Motion
from frida_painter.perception.rectify import rectify
from frida_painter.perception.snapshot import read_snapshot
from frida_painter_calibration.procedures.paper import (
    LENGTH,
    EaselAccess,
    ask_for_corners,
    ask_for_paper,
    fill_with_black,
    short_stroke,
    window,
)
from frida_painter_calibration.procedures.surface import POINTS, tell_surface, today

SHARES = (-0.5, -0.25, 0.0, 0.25, 0.5, 0.75)
"""Depths of the marks at a point, from the lightest, as shares of the way from the lightest touch to the hardest press.

The hardest mark leaves room for a canvas that is higher there.
"""
_EDGE = 0.006  # metres between marks and the edge of the canvas
_PITCH = 0.00025  # metres per pixel
_MIDDLE = 0.6  # share of a mark's length over which its width is measured; the ends are round
_DARKENED = 0.35  # share of the paper's light that a marked pixel lacks at least
_KNOTS = np.array((0.0, 0.25, 0.5, 0.75, 1.0, 1.5))  # of the curve, in shares
_THINNEST = 0.0003  # metres; a narrower mark counts as none
_FEWEST = 2  # marks that must be seen at a point
_MAX_RESIDUAL = 0.12  # of the widths, as a share of the widest mark
_INK = 0.1  # of the marks that are expected


@dataclass(frozen=True)
class MarkGrid:
    """Grid of marks on a canvas.

    across, up: positions of the points' lines, canvas metres
    apart: distance between two marks of a point, metres
    length: of a mark, metres
    """

    canvas: CanvasSize
    across: tuple[float, ...]
    up: tuple[float, ...]
    apart: float
    length: float

    @classmethod
    def plan(cls, canvas: CanvasSize, brush: BrushKind, points: int) -> "MarkGrid":
        """Returns the grid of `points` x `points` places. Raises ConfigError if its marks would overlap."""
        if not 2 <= points <= 9:
            raise ConfigError(f"{points} points along each side were wanted; there are 2 to 9.")
        length = max(LENGTH, brush.limits.length[0])
        apart = max(1.5 * brush.width, 0.005)
        wide, high = length + brush.width, apart * len(SHARES)
        room = [(side - 2 * _EDGE - block) / (points - 1) - block
                for side, block in ((canvas.width, wide), (canvas.height, high))]  # fmt: skip
        if not min(room) >= 0:
            raise ConfigError(
                f"A canvas of {canvas} has no room for {points} x {points} blocks of marks of the {brush.name} brush, "
                f"{wide * 1000:.0f} x {high * 1000:.0f} mm each; take fewer points (--points), or a finer brush."
            )
        lines = [np.linspace(_EDGE + block / 2, side - _EDGE - block / 2, points).tolist()
                 for side, block in ((canvas.width, wide), (canvas.height, high))]  # fmt: skip
        return cls(canvas, tuple(lines[0]), tuple(lines[1]), apart, length)

    def points(self) -> NDArray[np.float64]:
        """Returns the middles of the points [k, 2], canvas metres, row by row from the bottom."""
        return np.array([(x, y) for y in self.up for x in self.across])

    def marks(self, point: NDArray[np.float64]) -> Iterator[tuple[float, float]]:
        """Yields the middle of each mark at a point, in the order of `SHARES`, from the top."""
        top = point[1] + self.apart * (len(SHARES) - 1) / 2
        for number in range(len(SHARES)):
            yield float(point[0]), float(top - number * self.apart)


def surface_by_marks(easel: Easel, brush: BrushKind, *, points: int = POINTS) -> Procedure[Finding]:
    """Paints the grid of marks, at each point from the lightest to the hardest, and learns the heights from them.

    Without a camera the finding is a request for a person's picture.
    Raises CalibrationError if the person declines or the marks tell no map, WorkspaceViolation before anything moves,
    RobotError, CameraError.
    """
    flat = replace(easel, calibration=easel.calibration.with_surface(None))
    grid = MarkGrid.plan(easel.canvas, brush, points)
    yield from ask_for_paper(
        easel,
        "Lay a bare sheet of thin paper over the whole canvas, and fasten it. Is black paint in well 1? (A pen "
        "needs none.) Short marks follow, at each point from light to hard.",
        "Without paper no mark can be seen; repeat the surface calibration.",
    )
    fill_with_black(easel)
    access, known = EaselAccess(flat, lowest=easel.workspace.lower[2]), flat.calibration
    dip = Motion(easel.workspace, known).dip(0)
    heights = [known.touch_height - share * (known.touch_height - known.press_height) for share in SHARES]
    for point in grid.points():
        marks = zip(grid.marks(point), heights, strict=True)
        access.gateway.perform([dip, *(short_stroke(flat, place, grid.length, height) for place, height in marks)])
    access.gateway.step_aside()
    if not easel.has_camera:
        request = (
            "The marks are painted. Take a picture of the whole canvas, also from aside, and give it with the same "
            "command and --picture FILE."
        )
        return Finding(request, None, lambda record: record)
    photograph = EaselAccess(flat).photograph().image
    return learn_surface(rectify(photograph, known, _pixels(easel.canvas)), easel, brush, points=points)


def surface_in_picture(
    photograph: NDArray[np.uint8], easel: Easel, brush: BrushKind, *, points: int = POINTS
) -> Procedure[Finding]:
    """Learns the heights from a person's picture [H, W, 3] of the marks.

    Raises FrameRejected if the picture does not show these marks, CalibrationError if they tell no map.
    """
    corners = yield from ask_for_corners(photograph, easel.canvas)
    grid, pixels = MarkGrid.plan(easel.canvas, brush, points), _pixels(easel.canvas)
    bare = torch.ones(3, pixels.rows, pixels.columns)
    expected = bare.clone()
    for point in grid.points():
        for place, share in zip(grid.marks(point), SHARES, strict=True):
            if share > 0:
                rows, columns = window(pixels, place, grid.length, brush.width * (0.25 + 0.75 * share))
                expected[:, rows, columns] = _INK
    seen = read_snapshot(photograph, corners, easel.canvas, bare, expected).canvas
    return learn_surface(seen, easel, brush, points=points)


def learn_surface(picture: Tensor, easel: Easel, brush: BrushKind, *, points: int = POINTS) -> Finding:
    """Returns the height map from a picture [3, rows, columns] of the canvas with the marks.

    Raises CalibrationError if marks are missing, contradict one another, or the map cannot be true.
    """
    canvas, known, grid = easel.canvas, easel.calibration, MarkGrid.plan(easel.canvas, brush, points)
    width, span = measure_widths(picture, grid), known.touch_height - known.press_height
    few = (width > 0).sum(1) < _FEWEST
    if few.any():
        x, y = grid.points()[int(few.argmax())] * 1000
        raise CalibrationError(
            f"At {x:.0f}, {y:.0f} mm of the canvas fewer than {_FEWEST} of {len(SHARES)} marks are seen: the brush has "
            f"no paint, or the canvas is more than {span * 500:.1f} mm lower there. Raise it, or measure by jogging."
        )
    offset, residual = fit_heights(width)
    widest = float(width.max())
    if not residual <= _MAX_RESIDUAL * widest:
        raise CalibrationError(
            f"The widths of the marks contradict one another by {residual * 1000:.2f} mm, {residual / widest:.0%} of "
            "the widest. Was there paint enough, and was the paper flat? Paint them again, or measure by jogging."
        )
    heights = (offset * span).reshape(len(grid.up), len(grid.across))
    loose = SurfaceMap.of_points(canvas, grid.across, grid.up, heights)
    middle = float(loose.at(np.array([[canvas.width / 2, canvas.height / 2]]))[0])
    found = SurfaceMap.of_points(canvas, grid.across, grid.up, heights - middle, today())
    return tell_surface(found, grid.points(), None, easel)


def measure_widths(picture: Tensor, grid: MarkGrid) -> NDArray[np.float64]:
    """Returns the widths [points, depths] of the marks in metres; 0 if there is none.

    picture [3, rows, columns]: of the whole canvas, sRGB
    """
    pixels = PixelGrid(grid.canvas, *picture.shape[1:])
    light = picture.mean(0).numpy()
    down = pixels.pitch[1]
    found = np.zeros((len(grid.up) * len(grid.across), len(SHARES)))
    for number, point in enumerate(grid.points()):
        block = window(pixels, (float(point[0]), float(point[1])), grid.length, grid.apart * len(SHARES))
        paper = max(float(np.quantile(light[block], 0.9)), 1e-3)
        for depth, place in enumerate(grid.marks(point)):
            seen = light[window(pixels, place, _MIDDLE * grid.length, grid.apart)]
            # A pixel at an edge of the mark counts by its share of darkness, so that thin marks are measured, too.
            dark = 1 - seen / paper
            ink = max(float(np.quantile(dark, 0.99)), 1e-3)
            wide = np.clip(dark / ink, 0, 1).sum(0) * down if ink >= _DARKENED else np.zeros(1)
            mean = float(np.median(wide))
            found[number, depth] = mean if mean >= max(_THINNEST, 0.6 * down) else 0.0
    return found


def fit_heights(width: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """Fits the curve of width over depth, and the height of the canvas at each point.

    width [k, depths]: metres
    Returns the heights [k] as shares of the way from the lightest touch to the hardest press, and the mean error of the
    widths in metres.
    """
    widest, count, steps = float(width.max()), len(width), len(_KNOTS) - 1

    def misses(unknown: NDArray[np.float64]) -> NDArray[np.float64]:
        level, offset = np.r_[0.0, np.cumsum(unknown[:steps])], unknown[steps:]
        return (np.interp(np.array(SHARES) + offset[:, None], _KNOTS, level) - width / widest).ravel()

    start = np.r_[np.full(steps, 1 / steps), np.zeros(count)]
    low, high = np.r_[np.zeros(steps), np.full(count, -1.0)], np.r_[np.full(steps, 1.5), np.full(count, 0.75)]
    best = least_squares(misses, start, bounds=(low, high), loss="soft_l1", f_scale=0.1)
    return best.x[steps:], float(np.sqrt((misses(best.x) ** 2).mean())) * widest


def _pixels(canvas: CanvasSize) -> PixelGrid:
    return PixelGrid.of_height(canvas, max(64, round(canvas.height / _PITCH)))
