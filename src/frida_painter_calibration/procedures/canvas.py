"""The canvas procedure: finds the canvas's four corners in the photograph, and the distortion of the lens."""

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.calibration import Calibration, Corners
from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.dialogue import Finding, PointCorners, Procedure
from frida_painter.errors import CalibrationError, FrameRejected
from frida_painter.frames import Lens
from frida_painter.hardware.easel import Easel
from frida_painter.perception import markers
from frida_painter.perception.color import find_checker
from frida_painter.perception.flatfield import bare_canvas
from frida_painter.perception.landmarks import Outline, find_canvas, trace_outline
from frida_painter.system.images import from_uint8
from frida_painter.system.sheet import CREAM, Grid, Sheet
from frida_painter_calibration.procedures.color import read_card, read_chart
from frida_painter_calibration.procedures.paper import EaselAccess, require_four

POINTING = 2.0
"""Usual error of a corner that a person points at, pixels; the residual if no edge gives a better one."""
_NEAR = 0.006  # share of the photograph's diagonal within which edges are looked for around pointed corners
_WELL_SEEN = 0.5
_BEYOND = 2.0
_SMALLEST = 0.02


def canvas(easel: Easel) -> Procedure[Finding]:
    """Photographs the easel, proposes the canvas's corners, and uses the corners of the answer.

    If the canvas is bare, its light is kept too.
    Raises CalibrationError if there are no corners, or the answered ones cannot be a canvas's; CameraError.
    """
    frame = EaselAccess(easel).photograph().image
    found: Outline | None = None
    unseen = ""
    try:
        found = find_canvas(frame, easel.canvas)
    except CalibrationError as reason:
        unseen = f" {reason}"
    answer = (
        found.corners
        if found is not None and found.marked is not None
        else (
            yield PointCorners(
                f"Where are the canvas's corners? Top left, top right, bottom right, bottom left.{unseen}",
                from_uint8(frame),
                None if found is None else found.corners,
            )
        )
    )
    if found is not None and answer == found.corners:
        outline, how = found, f"by its edges, each seen over at least {found.support:.0%} of its length"
    else:
        outline, how = _outline_from_points(frame, _read_corners(answer, frame.shape, unseen)), "where you pointed"
    rows, columns = frame.shape[:2]
    seen = replace(easel.calibration, corners=outline.corners, photograph=(rows, columns), lens=outline.lens)
    colors, card = _read_colors(seen, easel.canvas, frame, outline)
    bare, light = None, "It is not bare, so that no painting can begin on a canvas that is painted already."
    try:
        bare = bare_canvas(frame, seen, easel.canvas, card)
        light = "It is bare, and what the light does is known from now on."
    except FrameRejected:
        pass

    def enter(record: Calibration) -> Calibration:
        known = record.with_canvas(
            outline.corners,
            (rows, columns),
            camera=easel.calibration.camera,
            canvas=easel.canvas,
            residual=outline.residual,
            lens=outline.lens,
            bare=bare,
        )
        if outline.marked is not None:
            known = replace(known, markers=markers.table_of(outline.marked.marks))
        return known if colors is None else colors.enter(known)

    said = [
        f"The canvas was found {how}, to {outline.residual:.2f} pixels.",
        *([] if outline.marked is None else [_describe_pieces(outline, easel.canvas)]),
        _describe_lens(outline.lens),
        light,
        *([] if colors is None else [colors.sentence]),
    ]
    return Finding(" ".join(said), draw_corners(frame, outline), enter)


def _read_colors(
    seen: Calibration, canvas: CanvasSize, frame: NDArray[np.uint8], outline: Outline
) -> tuple[Finding | None, NDArray[np.float64] | None]:
    """Returns what the card of colours or a person's checker tells, and its outline, in a photograph with pieces."""
    if outline.marked is None:
        return None, None
    card = markers.read_card(frame, outline.marked.marks)
    if card is not None:
        return read_card(card), card.outline
    chart = find_checker(frame)
    return (None, None) if chart is None else read_chart(seen, canvas, frame, chart)


def _describe_pieces(outline: Outline, size: CanvasSize) -> str:
    """Returns how the pieces lie: their print, and their distances from the edges if these are seen."""
    marked = outline.marked
    assert marked is not None
    covered = f" ({', '.join(marked.missing)} cannot be read; three are enough)" if marked.missing else ""
    if not outline.support:
        return (
            f"Its edges do not show, so its corners are where the pieces{covered} are: put each well into its corner."
        )
    beside = np.linalg.norm(marked.corners - np.array(outline.corners), axis=1)
    sides = np.linalg.norm(np.roll(marked.corners, -1, 0) - marked.corners, axis=1)
    far = beside * 2 * (size.width + size.height) / float(sides.sum())
    scale = (size.width / marked.printed[0] + size.height / marked.printed[1]) / 2
    return f"The pieces{covered} lie within {1000 * far.max():.1f} mm of it, printed at {scale:.1%}."


def _describe_lens(lens: Lens | None) -> str:
    if lens is None:
        return "The lens shows no distortion."
    bending = lens.coefficients[0] * (float(np.hypot(*lens.middle)) / lens.focal[0]) ** 2
    kind = "barrel" if bending < 0 else "pincushion"
    return f"The lens bends the photograph's corners by {abs(bending):.1%} ({kind}); that is undone."


def _read_corners(answer: object, shape: tuple[int, ...], unseen: str) -> Corners:
    """Returns the answer as four corners of a canvas. Raises CalibrationError."""
    count = len(answer) if isinstance(answer, tuple) else 0
    refusal = f"{count} corners were given; a canvas has four, each as (column, row) pixels."
    points = require_four(answer, unseen.strip() or refusal)
    rows, columns = shape[:2]
    if not ((points >= -_BEYOND).all() and (points <= np.array([columns, rows]) - 1 + _BEYOND).all()):
        raise CalibrationError(
            f"A corner lies outside the photograph of {columns} x {rows} pixels; move the camera until it sees "
            "all four, and repeat the canvas calibration."
        )
    side = np.roll(points, -1, axis=0) - points
    after = np.roll(side, -1, axis=0)
    turn = side[:, 0] * after[:, 1] - side[:, 1] * after[:, 0]
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


# Picture of a canvas calibration: the outline on the photograph, and each corner magnified.

_ROWS = 760
_GLASS = 24  # pixels of the photograph across a magnified corner
_SIDE, _GAP, _MARGIN, _HEAD = 300, 24, 40, 56
_FOUND = (214, 40, 80)
_EDGE_POINTS = 33


def draw_corners(photograph: NDArray[np.uint8], outline: Outline) -> Tensor:
    """Returns the picture, sRGB [3, h, w] in [0, 1]: the photograph on the left, the four corners on the right."""
    found, lens = np.array(outline.corners), outline.lens
    straight = found if lens is None else lens.undistort(found)
    share = np.linspace(0, 1, _EDGE_POINTS, endpoint=False)[:, None]
    sides = [one + share * (other - one) for one, other in zip(straight, np.roll(straight, -1, 0), strict=True)]
    edge = np.concatenate(sides)
    edge = edge if lens is None else lens.distort(edge)  # a lens bends the sides

    def trace(picture: NDArray[np.uint8], points: NDArray[np.float64]) -> None:
        cv2.polylines(picture, [(16 * points).round().astype(np.int32)], True, _FOUND, 2, cv2.LINE_AA, shift=4)

    high = _ROWS - _HEAD - _MARGIN
    scale = high / photograph.shape[0]
    size = round(photograph.shape[1] * scale), high
    whole = np.asarray(cv2.resize(photograph, size, interpolation=cv2.INTER_AREA), np.uint8)
    trace(whole, (edge + 0.5) * scale - 0.5)
    for column, row in ((found + 0.5) * scale - 0.5).round().astype(int).tolist():
        cv2.circle(whole, (column, row), 9, _FOUND, 2, cv2.LINE_AA)
    glasses = Grid(_MARGIN + size[0] + _GAP, _HEAD, 2, _SIDE, _SIDE, across=_GAP, down=_GAP + 40)
    sheet = Sheet(glasses.right + _MARGIN, _ROWS, CREAM)
    sheet.paste(whole, (_MARGIN, _HEAD))
    larger = _SIDE / _GLASS
    # The magnified corners are arranged as on the canvas.
    for corner, place, name in zip(
        found, (0, 1, 3, 2), ("top left", "top right", "bottom right", "bottom left"), strict=True
    ):
        shift = (_SIDE - 1) / 2 - larger * corner
        view = np.array([[larger, 0, shift[0]], [0, larger, shift[1]]])
        seen = cv2.warpAffine(photograph, view, (_SIDE, _SIDE), flags=cv2.INTER_NEAREST, borderValue=CREAM)
        glass = np.asarray(seen, np.uint8)
        trace(glass, edge * larger + shift)
        caption = f"{name}  {corner[0]:.1f}, {corner[1]:.1f}"
        sheet.cell(glasses.corner(place), glass, caption, size=18, gap=6, anchor="la")
    sheet.text((_MARGIN, 20), "The canvas as it was found", 20)
    sheet.text((glasses.left, 20), f"Its corners, {larger:g} times as large", 20)
    return sheet.tensor()
