"""The canvas procedure: finds the canvas's four corners in the photograph, and the distortion of the lens."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.calibration import BareCanvas, Calibration, Corners
from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.dialogue import PointCorners, Procedure
from frida_painter.errors import CalibrationError, FrameRejected
from frida_painter.frames import Lens
from frida_painter.hardware.easel import Easel
from frida_painter.images import from_uint8
from frida_painter.perception.flatfield import bare_canvas
from frida_painter.perception.landmarks import Outline, find_canvas, trace_outline
from frida_painter.sheet import CREAM, Grid, Sheet
from frida_painter_calibration.procedures.paper import EaselAccess

# Picture of a canvas calibration: the outline on the photograph, and each corner magnified.

_ROWS = 760
_GLASS = 24  # pixels of the photograph across a magnified corner
_SIDE, _GAP, _MARGIN, _HEAD = 300, 24, 40, 56
_FOUND = (214, 40, 80)
_NAMES = ("top left", "top right", "bottom right", "bottom left")
_EDGE_POINTS = 33


def corner_sheet(photograph: NDArray[np.uint8], outline: Outline) -> Tensor:
    """Returns the picture, sRGB [3, h, w] in [0, 1]: the photograph on the left, the four corners on the right."""
    scale = (_ROWS - _HEAD - _MARGIN) / photograph.shape[0]
    size = (round(photograph.shape[1] * scale), _ROWS - _HEAD - _MARGIN)
    corners = Grid(_MARGIN + size[0] + _GAP, _HEAD, 2, _SIDE, _SIDE, across=_GAP, down=_GAP + 40)
    sheet = Sheet(corners.right + _MARGIN, _ROWS, CREAM)
    edge = _edge(outline)
    seen = np.asarray(cv2.resize(photograph, size, interpolation=cv2.INTER_AREA), np.uint8)
    _trace(seen, (edge + 0.5) * scale - 0.5, 2)
    for column, row in (np.array(outline.corners) + 0.5) * scale - 0.5:
        _ring(seen, column, row, 9)
    sheet.paste(seen, (_MARGIN, _HEAD))
    # The magnified corners are arranged as on the canvas.
    for number, place in enumerate((0, 1, 3, 2)):
        column, row = outline.corners[number]
        text = f"{_NAMES[number]}  {column:.1f}, {row:.1f}"
        glass = _magnify(photograph, outline, edge, number)
        sheet.cell(corners.corner(place), glass, text, size=18, gap=6, anchor="la")
    sheet.text((_MARGIN, 20), "The canvas as it was found", 20)
    sheet.text((corners.left, 20), f"Its corners, {_SIDE / _GLASS:g} times as large", 20)
    return sheet.tensor()


def _edge(outline: Outline) -> NDArray[np.float64]:
    """Returns points along the outline as the camera sees it, [n, 2]; a lens bends its sides."""
    corners = np.array(outline.corners)
    straight = corners if outline.lens is None else outline.lens.undistort(corners)
    share = np.linspace(0, 1, _EDGE_POINTS, endpoint=False)[:, None]
    sides = [a + share * (b - a) for a, b in zip(straight, np.roll(straight, -1, axis=0), strict=True)]
    edge = np.concatenate(sides)
    return edge if outline.lens is None else outline.lens.distort(edge)


def _magnify(
    photograph: NDArray[np.uint8], outline: Outline, edge: NDArray[np.float64], number: int
) -> NDArray[np.uint8]:
    corner = np.array(outline.corners[number])
    scale = _SIDE / _GLASS
    shift = (_SIDE - 1) / 2 - scale * corner
    view = np.array([[scale, 0, shift[0]], [0, scale, shift[1]]])
    enlarged = cv2.warpAffine(
        photograph, view, (_SIDE, _SIDE), flags=cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=CREAM
    )
    glass: NDArray[np.uint8] = np.asarray(enlarged, np.uint8)
    _trace(glass, edge * scale + shift, 2)
    return glass


def _trace(picture: NDArray[np.uint8], points: NDArray[np.float64], width: int) -> None:
    cv2.polylines(picture, [(16 * points).round().astype(np.int32)], True, _FOUND, width, cv2.LINE_AA, shift=4)


def _ring(picture: NDArray[np.uint8], column: float, row: float, radius: int) -> None:
    center = (round(16 * column), round(16 * row))
    cv2.circle(picture, center, 16 * radius, (255, 255, 255), 4, cv2.LINE_AA, shift=4)
    cv2.circle(picture, center, 16 * radius, _FOUND, 2, cv2.LINE_AA, shift=4)


POINTING = 2.0
"""Usual error of a corner that a person points at, pixels; the residual if no edge gives a better one."""
_NEAR = 0.006  # share of the photograph's diagonal within which edges are looked for around pointed corners
_WELL_SEEN = 0.5
_BEYOND = 2.0
_SMALLEST = 0.02


@dataclass(frozen=True)
class CanvasFinding:
    """Result of the canvas procedure.

    corners: clockwise from the canvas's top left, (column, row) pixels
    shape: (rows, columns) of the photograph
    lens: None if the edges look straight
    residual: pixels, root mean square deviation of the edges from straight lines; for pointed corners, their
        distance from the intersections of the edges
    support: visible share of the worst edge
    pointed: True if a person gave the corners
    bare: the light on the bare canvas; None if the canvas is not bare
    """

    corners: Corners
    shape: tuple[int, int]
    lens: Lens | None
    residual: float
    support: float
    pointed: bool
    camera: str
    canvas: CanvasSize
    bare: BareCanvas | None
    picture: Tensor | None

    @property
    def sentence(self) -> str:
        """Result in plain words."""
        how = (
            "where you pointed"
            if self.pointed
            else f"by its edges, each seen over at least {self.support:.0%} of its length"
        )
        if self.lens is None:
            lens = "The lens shows no distortion."
        else:
            reach = float(np.hypot(*self.lens.middle))
            bending = self.lens.coefficients[0] * (reach / self.lens.focal[0]) ** 2
            kind = "barrel" if bending < 0 else "pincushion"
            lens = f"The lens bends the photograph's corners by {abs(bending):.1%} ({kind}); that is undone."
        light = (
            "It is not bare, so that no painting can begin on a canvas that is painted already."
            if self.bare is None
            else "It is bare, and what the light does is known from now on."
        )
        return f"The canvas was found {how}, to {self.residual:.2f} pixels. {lens} {light}"

    def enter(self, record: Calibration) -> Calibration:
        """Returns the calibration with these corners, this lens, and the names of this camera and canvas."""
        return record.with_canvas(
            self.corners,
            self.shape,
            camera=self.camera,
            canvas=self.canvas,
            residual=self.residual,
            lens=self.lens,
            bare=self.bare,
        )


def canvas(easel: Easel) -> Procedure[CanvasFinding]:
    """Photographs the easel, proposes the canvas's corners, and uses the corners of the answer.

    Raises CalibrationError if there are no corners, or the answered ones cannot be a canvas's; CameraError.
    """
    frame = EaselAccess(easel).photograph().image
    found: Outline | None = None
    unseen = ""
    try:
        found = find_canvas(frame, easel.canvas)
    except CalibrationError as reason:
        unseen = f" {reason}"
    answer = yield PointCorners(
        f"Where are the canvas's corners? Top left, top right, bottom right, bottom left.{unseen}",
        from_uint8(frame),
        None if found is None else found.corners,
    )
    if found is not None and answer == found.corners:
        outline, pointed = found, False
    else:
        outline, pointed = _outline_from_points(frame, _four(answer, frame.shape, unseen)), True
    return CanvasFinding(
        corners=outline.corners,
        shape=(frame.shape[0], frame.shape[1]),
        lens=outline.lens,
        residual=outline.residual,
        support=outline.support,
        pointed=pointed,
        camera=easel.calibration.camera,
        canvas=easel.canvas,
        bare=_bare(frame, easel, outline),
        picture=corner_sheet(frame, outline),
    )


def _bare(frame: NDArray[np.uint8], easel: Easel, outline: Outline) -> BareCanvas | None:
    """Returns the light on the bare canvas; None if the canvas is not bare."""
    shape = (frame.shape[0], frame.shape[1])
    seen = replace(easel.calibration, corners=outline.corners, photograph=shape, lens=outline.lens)
    try:
        return bare_canvas(frame, seen, easel.canvas)
    except FrameRejected:
        return None


def _four(answer: object, shape: tuple[int, ...], unseen: str) -> Corners:
    """Returns the answer as four corners of a canvas. Raises CalibrationError."""
    points = np.array(answer if isinstance(answer, tuple) else (), np.float64)
    if points.shape != (4, 2) or not np.isfinite(points).all():
        raise CalibrationError(
            unseen.strip() or f"{len(points)} corners were given; a canvas has four, each as (column, row) pixels."
        )
    rows, columns = shape[:2]
    inside = (points >= -_BEYOND).all() and (points <= np.array([columns, rows]) - 1 + _BEYOND).all()
    side = np.roll(points, -1, axis=0) - points
    after = np.roll(side, -1, axis=0)
    turn = side[:, 0] * after[:, 1] - side[:, 1] * after[:, 0]
    if not inside:
        raise CalibrationError(
            f"A corner lies outside the photograph of {columns} x {rows} pixels; move the camera until it sees "
            "all four, and repeat the canvas calibration."
        )
    if not ((turn > 0).all() and np.linalg.norm(side, axis=1).min() >= _SMALLEST * rows):
        raise CalibrationError(
            "The corners do not go round the canvas clockwise from its top left (top left, top right, bottom right, "
            "bottom left), or two of them nearly coincide; repeat the canvas calibration."
        )
    return tuple((float(column), float(row)) for column, row in points)


def _outline_from_points(frame: NDArray[np.uint8], corners: Corners) -> Outline:
    """Returns a person's corners, with the lens that follows from the edges near them if these are visible."""
    near = trace_outline(frame, corners, max(POINTING, _NEAR * float(np.hypot(*frame.shape[:2]))))
    if near is None or not near.support >= _WELL_SEEN:
        return Outline(corners, None, 0.0 if near is None else near.support, POINTING)
    off = np.linalg.norm(np.array(near.corners) - np.array(corners), axis=1)
    return Outline(corners, near.lens, near.support, float(np.sqrt(np.mean(off**2))))
