"""The robot procedure: measures where six painted dots land, and corrects the placement of strokes."""

import math
from collections.abc import Iterator

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.dialogue import Finding, Procedure
from frida_painter.errors import CalibrationError
from frida_painter.frames import PixelGrid
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.motion import Motion
from frida_painter.hardware.robot import Waypoints
from frida_painter.perception.flatfield import FlatField
from frida_painter.perception.landmarks import Match, find_dots, match_dots
from frida_painter.perception.rectify import apply, fit_homography, rectify
from frida_painter.system import images
from frida_painter.system.images import to_srgb
from frida_painter.system.sheet import CREAM, Sheet
from frida_painter_calibration.procedures.paper import EaselAccess, ask_for_paper, fill_with_black

DOTS = ((0.13, 0.15), (0.47, 0.12), (0.87, 0.19), (0.12, 0.82), (0.58, 0.87), (0.86, 0.80))
"""Meant places of the dots, shares of the canvas's sides; mirrored or turned, at most two of them coincide."""
WORST_RESIDUAL = 0.0015
"""Greatest residual of a fit, metres, root mean square."""
FEWEST_DOTS = 5
"""Number of the six dots that must be found."""
_APART = 0.35  # share of the shorter side between two dots at least
_TOUCH = 0.12  # thickness of a dot: a light touch that reaches the canvas even if it is slightly uneven
_PITCH = 0.00025
_MAX_ROWS = 1400
_TOLERANCE = 0.0025


def robot(easel: Easel) -> Procedure[Finding]:
    """Paints six black dots, photographs them, and fits their seen positions to the meant ones.

    The canvas procedure's photograph of the bare canvas tells how it looked before, if there is one.

    Raises CalibrationError if too few dots are found, they are mirrored or turned, or the residual exceeds 1.5 mm.
    Raises WorkspaceViolation before anything moves; RobotError, CameraError and their subclasses.
    """
    yield from ask_for_paper(
        easel,
        f"The robot will paint {len(DOTS)} small black dots on the canvas. Is the canvas bare and free of the card of "
        "colours, does it lie as it lay before, and is black paint in the first well?",
        "The robot was not calibrated; repeat it when canvas and paint are there.",
    )
    fill_with_black(easel)
    size = easel.canvas
    grid = PixelGrid.of_height(size, min(_MAX_ROWS, round(size.height / _PITCH)))
    meant, access = np.array(DOTS) * (size.width, size.height), EaselAccess(easel)
    bare = easel.calibration.bare
    before = (
        rectify(access.photograph().image, easel.calibration, grid)
        if bare is None
        else to_srgb(FlatField.of(bare.light).light(grid.rows, grid.columns))
    )
    access.gateway.perform(_motions(easel, meant))
    after = rectify(access.photograph().image, easel.calibration, grid)
    spots = find_dots(before, after, grid)
    match = _match_dots(meant, spots, size)
    found, seen = meant[match.meant], spots[match.seen]
    fit = fit_homography(found, seen)
    if not fit.residual <= WORST_RESIDUAL:
        raise CalibrationError(
            f"The dots are {fit.residual * 1000:.1f} mm off the best placement, and {WORST_RESIDUAL * 1000:g} mm are "
            "allowed: something moved, or the brush is loose. Fasten brush, canvas and camera, and repeat the robot "
            "calibration."
        )
    # The error in the middle of the canvas, and the derivative of the map there.
    middle, matrix = np.array([size.width / 2, size.height / 2]), fit.matrix
    depth = matrix[2] @ (*middle, 1)
    place = matrix[:2] @ (*middle, 1) / depth
    slope = (matrix[:2, :2] - np.outer(place, matrix[2, :2])) / depth
    turn = math.atan2(slope[1, 0] - slope[0, 1], slope[0, 0] + slope[1, 1])
    strangers = len(spots) - len(found)
    others = f" and {strangers} other spots that do not count" if strangers else ""
    placement = tuple(map(tuple, fit.inverse().tolist()))
    return Finding(
        f"{len(found)} of {len(meant)} dots were found{others}. The robot painted "
        f"{1000 * float(np.linalg.norm(place - middle)):.1f} mm beside where it was sent, turned by "
        f"{math.degrees(turn):.1f} degrees. With the correction the dots are {fit.residual * 1000:.2f} mm off, which "
        "is how exactly it places a single dot.",
        draw_dots(after, grid, meant, match, seen, seen - apply(matrix, found)),
        lambda record: record.with_robot(placement, residual=fit.residual),
    )


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
    apart = _APART * min(size.width, size.height)
    near = {"reach": 0.5 * apart, "tolerance": min(_TOLERANCE, 0.06 * apart)}
    middle = np.array([size.width / 2, size.height / 2])
    match = match_dots(meant, spots, **near)
    if len(match.meant) < FEWEST_DOTS:
        for name, sign in (
            ("mirrored from left to right", (-1, 1)),
            ("mirrored from top to bottom", (1, -1)),
            ("upside down", (-1, -1)),
        ):
            if len(match_dots((meant - middle) * sign + middle, spots, **near).meant) >= FEWEST_DOTS:
                raise CalibrationError(
                    f"The robot paints {name}: its axes do not run as the workspace says, or the corners of the canvas "
                    "were given in another order. Mend the workspace or repeat the canvas calibration, then repeat the "
                    "robot calibration."
                )
        raise CalibrationError(
            f"Of {len(meant)} dots {len(match.meant)} were found within {near['reach'] * 1000:.0f} mm of where they "
            f"should be, among {len(spots)} spots; {FEWEST_DOTS} are needed. Is there paint in the well, does the "
            "brush reach the canvas everywhere, and is the canvas bare? Mend that, then repeat the robot calibration."
        )
    return match


# Picture of a robot calibration: dots as meant, as seen, and the remaining errors.

_COLUMNS, _MARGIN, _HEAD, _FOOT = 1100, 40, 24, 64
_LARGER = 20
_MEANT, _SEEN, _MISSING = (40, 105, 185), (214, 40, 80), (225, 140, 20)
_RADIUS = 18


def draw_dots(
    canvas: Tensor,
    grid: PixelGrid,
    meant: NDArray[np.float64],
    match: Match,
    seen: NDArray[np.float64],
    left: NDArray[np.float64],
) -> Tensor:
    """Returns the picture of a robot calibration, sRGB [3, h, w] in [0, 1].

    canvas: [3, rows, columns], the rectified photograph on `grid`
    meant [n, 2]: all dots
    seen [k, 2]: the dots that were found
    left [k, 2]: their remaining errors
    """
    rows = round(_COLUMNS * grid.rows / grid.columns)
    picture = cv2.resize(images.to_uint8(canvas), (_COLUMNS, rows), interpolation=cv2.INTER_AREA)
    view = PixelGrid(grid.size, rows, _COLUMNS)

    def at(places: NDArray[np.float64]) -> list[tuple[int, int]]:
        """Returns pixels in sixteenths, for OpenCV with shift=4."""
        return [(round(16 * x), round(16 * y)) for x, y in view.to_pixels(torch.from_numpy(places)).tolist()]

    places = at(meant)
    lost = [places[number] for number in range(len(meant)) if number not in match.meant]
    for start, end, rest in zip(at(meant[match.meant]), at(seen), at(seen + _LARGER * left), strict=True):
        cv2.circle(picture, end, 16 * _RADIUS, _SEEN, 2, cv2.LINE_AA, shift=4)
        cv2.line(picture, start, end, _MEANT, 1, cv2.LINE_AA, shift=4)
        cv2.line(picture, end, rest, _SEEN, 2, cv2.LINE_AA, shift=4)
    for x, y in places:
        color = _MISSING if (x, y) in lost else _MEANT
        cv2.drawMarker(picture, (x // 16, y // 16), color, cv2.MARKER_CROSS, 16, 2, cv2.LINE_AA)
    for place in lost:
        cv2.circle(picture, place, 16 * _RADIUS, _MISSING, 2, cv2.LINE_AA, shift=4)
    sheet = Sheet(_COLUMNS + 2 * _MARGIN, rows + _HEAD + _FOOT, CREAM)
    sheet.paste(np.asarray(picture, np.uint8), (_MARGIN, _HEAD))
    text = f"Circles: the dots. Crosses: where they were meant to be. Red lines: what remains, {_LARGER} times as long."
    sheet.text((_MARGIN, rows + _HEAD + 18), text, 20)
    return sheet.tensor()
