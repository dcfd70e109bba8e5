"""Printed markers around the canvas: their places, and their reading in a photograph.

Four pieces of paper lie at the canvas's corners, each with an ArUco marker (S. Garrido-Jurado et al., "Automatic
generation and detection of highly reliable fiducial markers", 2014) beside the canvas's left or right side. A card
with two more markers has patches of colour. Markers stay on the table: they tell a motion of the camera from one of
the canvas.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from frida_painter.calibration import Calibration, Matrix
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import CalibrationError
from frida_painter.frames import Lens
from frida_painter.perception.rectify import pixels_per_metre
from frida_painter.perception.registration import TELLS, fit_line, intersect, trace_sides
from frida_painter.system.images import light_of_bytes

DICTIONARY = cv2.aruco.DICT_4X4_50
CORNERS = ("top left", "top right", "bottom right", "bottom left")
"""Corners of the canvas in the order of the pieces 1 to 4."""
BAND = 0.004
"""Metres of the dark line along the canvas."""
_SIDES = ((0.25, 0.020), (0.6, 0.025), (1.0, 0.040), (np.inf, 0.050))  # a marker's side, for canvases up to a length
CARD, CARD_SIDE = 40, 0.020
"""Number of the left one of the card's two markers, and their side in metres."""
CARD_MIDDLES = ((-0.0755, 0.0), (0.0755, 0.0))
"""Middles of the card's markers, metres from the middle of the card."""
PATCHES = tuple((r, g, b) for r in (0.35, 0.55, 0.75) for g in (0.35, 0.55, 0.75) for b in (0.35, 0.55, 0.75)
                if not r == g == b)  # fmt: skip
"""Colours of the card's patches, sRGB; they are such as any printer can mix."""
PATCH_MIDDLES = tuple((0.010 * (column - 5.5), 0.0065 - 0.013 * row) for row in range(2) for column in range(12))
"""Middles of the patches, metres from the middle of the card, x right and y up."""
PATCH = (0.0075, 0.009)
"""Width and height of a patch, metres."""
_SIGNS = np.array([(-1, 1), (1, 1), (1, -1), (-1, -1)])  # of x and y, for the corners in their order
_FEWEST = 3  # pieces
_WORST_FIT = 0.0015  # metres; root mean square of a marker's corners
_SCALE, _UNEQUAL = 0.012, 0.012  # print relative to the canvas: allowed error, and difference of width and height

Marks = dict[int, NDArray[np.float64]]
"""Corners [4, 2] of each marker by its number, (column, row) in the photograph."""


def marker_kind(size: CanvasSize) -> int:
    """Returns the kind of the markers for a canvas: larger ones for a larger canvas."""
    return next(kind for kind, (longest, _) in enumerate(_SIDES) if max(size.width, size.height) <= longest)


def marker_side(kind: int) -> float:
    """Returns the side of the markers of a kind in metres."""
    return _SIDES[kind][1]


def marker_margin(kind: int) -> float:
    """Returns the white around a marker of a kind in metres: at least as wide as one of its squares."""
    return max(0.0045, marker_side(kind) / 6)


def marker_offset(kind: int, corner: int) -> NDArray[np.float64]:
    """Returns the corners [4, 2] of a printed marker in metres from the canvas's corner, x right and y up."""
    side, (right, up) = marker_side(kind), _SIGNS[corner]
    return np.array([right * (BAND + marker_margin(kind) + side / 2), -up * side / 2]) + _SIGNS * side / 2


def find_marks(photograph: NDArray[np.uint8]) -> Marks:
    """Returns all markers of our kinds in a photograph [rows, columns, 3].

    Raises CalibrationError if a marker is there twice, or if the photograph is mirrored.
    """
    grey = np.asarray(cv2.cvtColor(photograph, cv2.COLOR_RGB2GRAY), np.uint8)
    numbers, corners = _detect(grey)
    if len(set(numbers)) < len(numbers):
        twice = next(number for number in numbers if numbers.count(number) > 1)
        raise CalibrationError(
            f"The photograph shows {_name(twice)} twice: pieces of two printed sheets lie there. Take one away."
        )
    # A mirrored marker may look like another one.
    if len(numbers) < _FEWEST <= len(_detect(np.ascontiguousarray(grey[:, ::-1]))[0]):
        raise CalibrationError(
            "The printed markers are mirrored in the photograph. Switch mirroring off in the camera's or in the "
            "printer's settings."
        )
    return {number: _refine(photograph, each) for number, each in zip(numbers, corners, strict=True)}


def _refine(photograph: NDArray[np.uint8], corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns corners [4, 2] at which straight lines along a marker's four black sides meet.

    The detector's own corners lie up to half a pixel inside, in bytes instead of light.
    """
    module = float(np.linalg.norm(np.roll(corners, -1, 0) - corners, axis=1).mean()) / 6
    sides = trace_sides(photograph, tuple(map(tuple, corners.tolist())), max(0.7 * module, 2.5))
    refined = None if sides is None else intersect([fit_line(points) for points in sides.points])
    return corners if refined is None or np.abs(refined - corners).max() >= module else refined


def _detect(grey: NDArray[np.uint8]) -> tuple[list[int], list[NDArray[np.float64]]]:
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(DICTIONARY), cv2.aruco.DetectorParameters())
    corners, numbers, _ = detector.detectMarkers(grey)
    ours = (*range(4 * len(_SIDES)), CARD, CARD + 1)
    known = [] if numbers is None else [int(number) for number in np.ravel(numbers)]
    seen = [(number, np.asarray(each, np.float64).reshape(4, 2)) for number, each in zip(known, corners, strict=True)]
    return [one for one, _ in seen if one in ours], [each for one, each in seen if one in ours]


def _name(number: int) -> str:
    return "the card of colours" if number >= CARD else f"piece {number % 4 + 1} ({CORNERS[number % 4]})"


@dataclass(frozen=True)
class MarkedCanvas:
    """Canvas as the pieces at its corners tell.

    corners [4, 2]: from the top left of the upright canvas, (column, row) in the photograph, distorted
    printed: sides of the canvas in printed metres; a print at 97 % makes them larger
    off: root mean square distance of the markers' corners from the fit, metres
    marks: all markers in the photograph
    missing: names of the pieces that are not seen
    """

    corners: NDArray[np.float64]
    printed: tuple[float, float]
    off: float
    marks: Marks
    missing: tuple[str, ...] = ()

    def require_size(self, size: CanvasSize) -> None:
        """Raises CalibrationError if the pieces were printed at another scale, or the canvas has another size."""
        wide, high = size.width / self.printed[0], size.height / self.printed[1]
        told = " x ".join(f"{1000 * side:.0f}" for side in self.printed)
        if not abs(wide / high - 1) <= _UNEQUAL:
            raise CalibrationError(
                f"The pieces lie around a canvas of {told} mm, and the canvas was said to be {size}. Give the size of "
                "this canvas with --canvas, or push each piece against its corner."
            )
        if not abs(wide * high - 1) <= 2 * _SCALE:
            raise CalibrationError(
                f"The canvas was said to be {size}; by the markers' own size it is {told} mm. Measure the printed "
                f"ruler: if it is {50 * (wide + high):.3g} mm long and not 100, print the sheet again at 100 % (no "
                "'fit to page'); if it is 100 mm long, give the size of this canvas with --canvas."
            )


def read_pieces(marks: Marks, shape: tuple[int, ...], size: CanvasSize, lens: Lens | None) -> MarkedCanvas | None:
    """Returns the canvas between its pieces; None if no piece is seen.

    shape: rows and columns of the photograph
    size: of the canvas; only a start, for the pieces tell the size too
    lens: distortion; None if there is none or it is unknown
    Raises CalibrationError if pieces of two sheets are seen, fewer than three, or one that lies wrong.
    """
    pieces = {number: corners for number, corners in marks.items() if number < CARD}
    if not pieces:
        return None
    kinds = {number // 4 for number in pieces}
    if len(kinds) > 1:
        raise CalibrationError(
            "The photograph shows markers of two sheets, for canvases of different sizes. Take those of one away."
        )
    (kind,) = kinds
    missing = tuple(_name(number) for number in range(4 * kind, 4 * kind + 4) if number not in pieces)
    if len(pieces) < _FEWEST:
        raise CalibrationError(
            f"Of the four pieces at the canvas's corners {', '.join(missing)} cannot be seen; three must be. Take what "
            "covers them away (a piece at a wrong corner lies below the canvas), and let the camera see all of them."
        )
    straight = {number: each if lens is None else lens.undistort(each) for number, each in pieces.items()}
    view, printed, off = _fit(straight, shape, size)
    worst = float(np.sqrt(np.mean(np.square(np.concatenate([*off.values()])))))
    if not worst <= _WORST_FIT:
        wrong = max(off, key=lambda number: float(np.square(off[number]).sum()))
        if len(pieces) > _FEWEST:  # the fit without the wrong one is the best
            rest = {one: _fit({k: v for k, v in straight.items() if k != one}, shape, size)[2] for one in straight}
            wrong = min(rest, key=lambda one: float(np.square(np.concatenate([*rest[one].values()])).sum()))
        raise CalibrationError(
            f"The pieces do not lie around one canvas: {1000 * worst:.0f} mm off. Look at {_name(wrong)}: its dark "
            "line goes along the canvas, and the number of each piece stands upright."
        )
    corners = cv2.perspectiveTransform((_SIGNS * np.array(printed) / 2)[None], view)[0]
    return MarkedCanvas(corners if lens is None else lens.distort(corners), printed, worst, marks, missing)


def _fit(
    pieces: Marks, shape: tuple[int, ...], size: CanvasSize
) -> tuple[NDArray[np.float64], tuple[float, float], dict[int, NDArray[np.float64]]]:
    """Returns the view from printed metres to the photograph, the canvas's printed sides, and what is left (metres)."""
    numbers = sorted(pieces)
    offset = np.array([marker_offset(number // 4, number % 4) for number in numbers])  # [pieces, 4, 2]
    sign = _SIGNS[[number % 4 for number in numbers]]
    seen = np.array([pieces[number] for number in numbers])
    start = np.array([size.width, size.height])
    scale = float(np.hypot(shape[0], shape[1]))

    def places(sides: NDArray[np.float64]) -> NDArray[np.float64]:
        return (sign * sides / 2)[:, None] + offset

    def off(unknown: NDArray[np.float64]) -> NDArray[np.float64]:
        view, there = np.append(unknown[:8], 1.0).reshape(3, 3), places(start * np.exp(unknown[8:]))
        mapped = np.c_[there.reshape(-1, 2), np.ones(there.size // 2)] @ view.T
        depth = np.where(mapped[:, 2:] > 1e-6, mapped[:, 2:], 1e-6)
        return (scale * mapped[:, :2] / depth - seen.reshape(-1, 2)).ravel()

    # Each marker is fitted by itself first: one that lies wrong shall not spoil the start.
    view, _ = cv2.findHomography(places(start).reshape(-1, 2), seen.reshape(-1, 2) / scale, cv2.RANSAC, 20 / scale)
    if view is None or np.linalg.det(view) > 0:  # y goes up on the canvas, and down in the photograph
        raise CalibrationError(
            "The pieces lie in the wrong order: 1 belongs to the canvas's top left corner, 2 to its top right, 3 to "
            "its bottom right, 4 to its bottom left."
        )
    known = least_squares(off, np.append((view / view[2, 2]).ravel()[:8], (0.0, 0.0)), x_scale="jac", method="lm")
    view = np.diag([scale, scale, 1.0]) @ np.append(known.x[:8], 1.0).reshape(3, 3)
    wide, high = (start * np.exp(known.x[8:])).tolist()
    back = cv2.perspectiveTransform(seen.reshape(1, -1, 2), np.linalg.inv(view))[0].reshape(-1, 4, 2)
    return view, (wide, high), dict(zip(numbers, back - places(np.array([wide, high])), strict=True))


# Motions of the camera

_ONE_PIECE = 0.5  # pixels off the others' motion at which a marker was moved by itself


def table_of(marks: Marks) -> Matrix:
    """Returns markers as rows of number and four corners (column, row), for a calibration record."""
    return tuple((float(number), *corners.ravel().tolist()) for number, corners in sorted(marks.items()))


@dataclass(frozen=True)
class CameraMotion:
    """Motion of the camera over the table, by markers that lie still.

    view [3, 3]: homography from the earlier photograph to this one
    far: metres by which the farthest corner of the canvas seems to have moved
    moved: names of pieces that moved by themselves
    """

    view: NDArray[np.float64]
    far: float
    moved: tuple[str, ...]

    @property
    def sentence(self) -> str:
        """Sentence about it; "" if it is not told from noise."""
        if not self.far > TELLS:
            return ""
        return (
            f"The camera was moved: the canvas is {1000 * self.far:.1f} mm beside where it was in the picture. That is "
            "taken out of every picture; the painting goes on."
        )


def find_camera_motion(photograph: NDArray[np.uint8], record: Calibration) -> CameraMotion | None:
    """Returns the motion of the camera since the canvas calibration; None if fewer than two markers tell it.

    Raises CalibrationError like `find_marks`.
    """
    known = {int(row[0]): np.array(row[1:]).reshape(4, 2) for row in record.markers}
    marks = find_marks(photograph) if known else {}
    both = sorted(known.keys() & {number for number in marks if number < CARD})
    if len(both) < 2 or record.canvas is None:
        return None
    before, now = (np.concatenate([each[number] for number in both]) for each in (known, marks))
    if len(both) == 2:  # too few for the perspective
        part, _ = cv2.estimateAffinePartial2D(before, now, method=cv2.LMEDS)
        view, inside = np.r_[part, [[0.0, 0.0, 1.0]]], np.ones(len(before), bool)
    else:
        view, mask = cv2.findHomography(before, now, cv2.RANSAC, _ONE_PIECE)
        inside = np.asarray(mask, bool).ravel()
    corners = np.array(record.corners)
    away = np.linalg.norm(cv2.perspectiveTransform(corners[None], view)[0] - corners, axis=1)
    alone = [number for number, well in zip(both, inside.reshape(-1, 4).min(1).tolist(), strict=True) if not well]
    far = float(away.max()) / pixels_per_metre(record, record.canvas)
    return CameraMotion(np.asarray(view, np.float64), far, tuple(map(_name, alone)))


# Card of colours

_CARD = np.array([(-0.0895, 0.0165), (0.0895, 0.0165), (0.0895, -0.0165), (-0.0895, -0.0165)])  # its outline, metres
_INNER, _SAMPLES = 0.5, 7  # share of a patch that is read, and samples along each side
_BLOWN_OUT = 250


@dataclass(frozen=True)
class CardReading:
    """Card of colours in a photograph.

    outline [4, 2]: in the photograph, (column, row)
    light [24, 3]: linear light of the patches relative to the white paper beside them
    """

    outline: NDArray[np.float64]
    light: NDArray[np.float64]


def read_card(photograph: NDArray[np.uint8], marks: Marks) -> CardReading | None:
    """Returns the card of colours; None unless both of its markers are seen. Raises CalibrationError if it shines."""
    if not {CARD, CARD + 1} <= marks.keys():
        return None
    there = np.concatenate([np.array(middle) + _SIGNS * CARD_SIDE / 2 for middle in CARD_MIDDLES])
    view, _ = cv2.findHomography(there, np.concatenate([marks[CARD], marks[CARD + 1]]))
    inner = (np.arange(_SAMPLES) / (_SAMPLES - 1) - 0.5) * _INNER
    around = np.stack(np.meshgrid(inner * PATCH[0], inner * PATCH[1]), -1).reshape(-1, 2)
    patches = np.array(PATCH_MIDDLES)
    # The white line between the two rows of patches is as wide as half of one is high.
    white = np.c_[patches[:, 0], np.zeros(len(patches))]
    light = []
    for middles, shrink in ((patches, (1, 1)), (white, (1, 0.4))):
        place = cv2.perspectiveTransform((middles[:, None] + around * shrink).reshape(1, -1, 2), view)[0]
        column, row = place.T.astype(np.float32)
        seen = cv2.remap(photograph, column, row, cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE)
        seen = np.asarray(seen, np.uint8).reshape(-1, 3)
        if float((seen >= _BLOWN_OUT).any(1).mean()) > 0.2:
            raise CalibrationError(
                "The card of colours is overexposed, or a lamp is reflected on it. Expose shorter, or lay it elsewhere."
            )
        light.append(light_of_bytes(seen).astype(np.float64).reshape(len(middles), -1, 3).mean(1))
    outline = cv2.perspectiveTransform(_CARD[None], view)[0]
    return CardReading(outline, light[0] / np.maximum(light[1], 1e-4))
