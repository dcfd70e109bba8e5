"""The robot procedure: measures where sixteen painted dots land, and corrects the placement of strokes."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.calibration import Calibration
from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.dialogue import Procedure
from frida_painter.errors import CalibrationError
from frida_painter.frames import PixelGrid
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.motion import Motion
from frida_painter.hardware.robot import Waypoints
from frida_painter.perception.landmarks import Match, find_dots, match_dots
from frida_painter.perception.rectify import Fit, apply, fit_homography, rectify
from frida_painter.sheet import CREAM, INK, Sheet
from frida_painter_calibration.procedures.paper import EaselAccess, ask_for_paper, fill_with_black

# Picture of a robot calibration: dots as meant, as seen, and the remaining errors.

_COLUMNS = 1100
_LARGER = 20
_MARGIN, _HEAD, _FOOT = 40, 24, 64
_MEANT, _SEEN, _MISSING = (40, 105, 185), (214, 40, 80), (225, 140, 20)
_RADIUS = 18


def dot_sheet(
    canvas: Tensor,
    grid: PixelGrid,
    meant: NDArray[np.float64],
    found: NDArray[np.float64],
    seen: NDArray[np.float64],
    matrix: NDArray[np.float64],
) -> Tensor:
    """Returns the picture of a robot calibration, sRGB [3, h, w] in [0, 1].

    canvas: [3, rows, columns], the rectified photograph on `grid`
    meant: [n, 2], all dots
    found, seen: [k, 2], the dots that were found: as meant, and as seen
    matrix: fit from found to seen
    """
    rows = round(_COLUMNS * grid.rows / grid.columns)
    pixels = (255 * canvas.clamp(0, 1)).round().to(torch.uint8).permute(1, 2, 0).numpy()
    picture = np.asarray(cv2.resize(pixels, (_COLUMNS, rows), interpolation=cv2.INTER_AREA), np.uint8).copy()
    view = PixelGrid(grid.size, rows, _COLUMNS)

    def at(places: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(view.to_pixels(torch.from_numpy(places)).numpy(), np.float64)

    left = seen - apply(matrix, found)
    for start, end, rest in zip(at(found), at(seen), at(seen + _LARGER * left), strict=True):
        _circle(picture, end, _SEEN)
        _line(picture, start, end, _MEANT, 1)
        _line(picture, end, rest, _SEEN, 2)
    missing = (np.linalg.norm(meant[:, None] - found[None], axis=-1) > 1e-9).all(1)
    for place, lost in zip(at(meant), missing, strict=True):
        for color, width in (((255, 255, 255), 4), (_MISSING if lost else _MEANT, 2)):
            for offset in ((8, 0), (0, 8)):
                _stripe(picture, place - offset, place + offset, color, width)
        if lost:
            _circle(picture, place, _MISSING)
    sheet = Sheet(_COLUMNS + 2 * _MARGIN, rows + _HEAD + _FOOT, CREAM)
    sheet.paste(picture, (_MARGIN, _HEAD))
    text = f"Circles: the dots. Crosses: where they were meant to be. Red lines: what remains, {_LARGER} times as long."
    sheet.text((_MARGIN, rows + _HEAD + 18), text, 20, INK)
    return sheet.tensor()


def _fine(place: NDArray[np.float64]) -> tuple[int, int]:
    """Returns a position in sixteenths of a pixel, for OpenCV with shift=4."""
    return round(16 * float(place[0])), round(16 * float(place[1]))


def _circle(picture: NDArray[np.uint8], place: NDArray[np.float64], color: tuple[int, ...]) -> None:
    for around, width in (((255, 255, 255), 4), (color, 2)):
        cv2.circle(picture, _fine(place), 16 * _RADIUS, around, width, cv2.LINE_AA, shift=4)


def _line(
    picture: NDArray[np.uint8],
    start: NDArray[np.float64],
    end: NDArray[np.float64],
    color: tuple[int, ...],
    width: int,
) -> None:
    _stripe(picture, start, end, (255, 255, 255), width + 2)
    _stripe(picture, start, end, color, width)


def _stripe(
    picture: NDArray[np.uint8],
    start: NDArray[np.float64],
    end: NDArray[np.float64],
    color: tuple[int, ...],
    width: int,
) -> None:
    cv2.line(picture, _fine(start), _fine(end), color, width, cv2.LINE_AA, shift=4)


SIDE = 4
"""Number of dots along each side of the canvas."""
WORST_RESIDUAL = 0.0015
"""Greatest residual of a fit, metres, root mean square."""
FEWEST_DOTS = 10
"""Number of the sixteen dots that must be found."""
_EDGE = 0.12  # share of each side of the canvas between its edge and the outermost dots
_IRREGULAR = 0.1  # share of the distance between dots by which they are moved off the regular grid
# Chosen so that at most 5 dots coincide if all are mirrored or turned, or their axes exchanged.
_NUDGES = (
    (1, -1), (0, 1), (1, 0), (0, -1), (0, 0), (1, 1), (-1, 1), (0, 0),
    (1, 0), (-1, -1), (1, 0), (0, 0), (1, 0), (-1, 1), (-1, -1), (1, 0),
)  # fmt: skip
_TOUCH = 0.12  # thickness of a dot: a light touch that reaches the canvas even if it is slightly uneven
_PITCH = 0.00025
_MAX_ROWS = 1400
_TOLERANCE = 0.0025
_FEWEST_IN_QUARTER = 2


@dataclass(frozen=True)
class RobotFinding:
    """Result of the robot procedure.

    meant, seen: [k, 2], positions of the found dots as meant and as seen, canvas metres
    fit: homography from meant to seen
    painted: number of dots painted
    strangers: number of other spots seen
    """

    meant: NDArray[np.float64]
    seen: NDArray[np.float64]
    fit: Fit
    painted: int
    strangers: int
    size: CanvasSize
    picture: Tensor | None

    @property
    def shift(self) -> float:
        """Distance from the middle of the canvas at which the robot paints without correction, metres."""
        return float(np.linalg.norm(self._derivative()[0]))

    @property
    def turn(self) -> float:
        """Angle by which the robot paints turned, radians counter-clockwise."""
        slope = self._derivative()[1]
        return math.atan2(slope[1, 0] - slope[0, 1], slope[0, 0] + slope[1, 1])

    @property
    def sentence(self) -> str:
        """Result in plain words."""
        others = f" and {self.strangers} other spots that do not count" if self.strangers else ""
        beside, turned = f"{self.shift * 1000:.1f} mm", f"{math.degrees(self.turn):.1f} degrees"
        return (
            f"{len(self.meant)} of {self.painted} dots were found{others}. The robot painted {beside} beside where it "
            f"was sent, turned by {turned}. With the correction the dots are {self.fit.residual * 1000:.2f} mm off, "
            "which is how exactly it places a single dot."
        )

    def enter(self, record: Calibration) -> Calibration:
        """Returns the calibration with the placement that cancels the measured error."""
        placement = tuple(map(tuple, self.fit.inverse().tolist()))
        return record.with_robot(placement, residual=self.fit.residual)

    def _derivative(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Returns the error in the middle of the canvas [2], and the derivative of the map there [2, 2]."""
        x, y = self.size.width / 2, self.size.height / 2
        matrix = self.fit.matrix
        depth = matrix[2] @ (x, y, 1)
        place = matrix[:2] @ (x, y, 1) / depth
        return place - (x, y), (matrix[:2, :2] - np.outer(place, matrix[2, :2])) / depth


def robot(easel: Easel) -> Procedure[RobotFinding]:
    """Paints sixteen black dots, photographs them, and fits their seen positions to the meant ones.

    Raises CalibrationError if too few dots are found, they are mirrored or turned, or the residual exceeds 1.5 mm.
    Raises WorkspaceViolation before anything moves; RobotError, CameraError and their subclasses.
    """
    yield from ask_for_paper(
        easel,
        f"The robot will paint {SIDE * SIDE} small black dots all over the canvas. Does a bare canvas lie on the "
        "easel, as it lay before, and is black paint in the first well?",
        "The robot was not calibrated; repeat it when canvas and paint are there.",
    )
    fill_with_black(easel)
    grid = _grid(easel.canvas)
    meant = dot_places(easel.canvas)
    access = EaselAccess(easel)
    before = rectify(access.photograph().image, easel.calibration, grid)
    access.perform(_motions(easel, meant))
    after = rectify(access.photograph().image, easel.calibration, grid)
    spots = find_dots(before, after, grid)
    match = _match_dots(meant, spots, easel.canvas)
    fit = fit_homography(meant[match.meant], spots[match.seen])
    if not fit.residual <= WORST_RESIDUAL:
        raise CalibrationError(
            f"The dots are {fit.residual * 1000:.1f} mm off the best placement, and {WORST_RESIDUAL * 1000:g} mm are "
            "allowed: something moved, or the brush is loose. Fasten brush, canvas and camera, and repeat the robot "
            "calibration."
        )
    found = meant[match.meant], spots[match.seen]
    strangers = len(spots) - len(match)
    picture = dot_sheet(after, grid, meant, *found, fit.matrix)
    return RobotFinding(*found, fit, len(meant), strangers, easel.canvas, picture)


def dot_places(size: CanvasSize) -> NDArray[np.float64]:
    """Returns the meant positions of the dots, canvas metres [16, 2]: nearly even, but without symmetry."""
    share = np.linspace(_EDGE, 1 - _EDGE, SIDE)
    place = np.stack(np.meshgrid(share, share), -1).reshape(-1, 2)
    place += _IRREGULAR * (share[1] - share[0]) * np.array(_NUDGES)
    return place * (size.width, size.height)


def _grid(size: CanvasSize) -> PixelGrid:
    return PixelGrid.of_height(size, min(_MAX_ROWS, round(size.height / _PITCH)))


def _motions(easel: Easel, places: NDArray[np.float64]) -> Iterator[Waypoints]:
    """Yields a dip and a vertical touch for every dot, without the calibrated placement."""
    motion = Motion(easel.workspace, easel.calibration)
    touch = easel.calibration.height(np.array([_TOUCH]))
    above = np.array([easel.calibration.highest_touch + easel.workspace.hover])
    for number, place in enumerate(places[:, None]):
        yield motion.dip(0)
        down = touch + easel.calibration.unevenness(place)
        path = np.concatenate([easel.workspace.to_robot(place, height) for height in (above, down, above)])
        yield Waypoints(f"dot {number + 1}", path, easel.workspace.painting_speed)


def _match_dots(meant: NDArray[np.float64], spots: NDArray[np.float64], size: CanvasSize) -> Match:
    """Returns the match of spots and dots. Raises CalibrationError if too few match, or they are mirrored or turned."""
    spacing = (1 - 2 * _EDGE) / (SIDE - 1) * min(size.width, size.height)
    near = {"reach": 0.5 * spacing, "tolerance": min(_TOLERANCE, 0.06 * spacing)}
    match = match_dots(meant, spots, **near)
    if len(match) < FEWEST_DOTS:
        _refuse_wrong_way_round(meant, spots, size, near)
        raise CalibrationError(
            f"Of {len(meant)} dots {len(match)} were found within {near['reach'] * 1000:.0f} mm of where they should "
            f"be, among {len(spots)} spots; {FEWEST_DOTS} are needed. Is there paint in the well, does the brush reach "
            "the canvas everywhere, and is the canvas bare? Mend that, then repeat the robot calibration."
        )
    right, upper = (meant[match.meant] > (size.width / 2, size.height / 2)).T
    for name, part in (
        ("lower left", ~right & ~upper),
        ("lower right", right & ~upper),
        ("upper left", ~right & upper),
        ("upper right", right & upper),
    ):
        if part.sum() < _FEWEST_IN_QUARTER:
            raise CalibrationError(
                f"In the {name} quarter of the canvas {part.sum()} of the dots were found; {_FEWEST_IN_QUARTER} are "
                "needed in each. Does the brush reach the canvas there? Level the canvas, and repeat the robot "
                "calibration."
            )
    return match


def _refuse_wrong_way_round(
    meant: NDArray[np.float64], spots: NDArray[np.float64], size: CanvasSize, near: dict[str, float]
) -> None:
    """Raises CalibrationError if the dots are all there, but mirrored or upside down."""
    for name, sign in (
        ("mirrored from left to right", (-1, 1)),
        ("mirrored from top to bottom", (1, -1)),
        ("upside down", (-1, -1)),
    ):
        turned = (meant - (size.width / 2, size.height / 2)) * sign + (size.width / 2, size.height / 2)
        if len(match_dots(turned, spots, **near)) >= FEWEST_DOTS:
            raise CalibrationError(
                f"The robot paints {name}: its axes do not run as the workspace says, or the corners of the canvas "
                "were given in another order. Mend the workspace or repeat the canvas calibration, then repeat the "
                "robot calibration."
            )
