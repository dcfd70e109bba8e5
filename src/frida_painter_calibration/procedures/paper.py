"""Access of procedures to an easel, and sheets of paper on which single strokes are painted and photographed.

A stroke's mark is the change between two photographs (paper, "Real Data to Simulation"). This module detects all
other changes. It removes them if possible, and otherwise marks the stroke as flawed. It refuses photographs that
show nothing reliable.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.brush.kinds import BrushKind
from frida_painter.brush.library import Flaw
from frida_painter.calibration import Corners
from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.dialogue import Confirm, PointCorners, Procedure
from frida_painter.errors import CalibrationError, ConfigError, FrameRejected
from frida_painter.frames import MapFrame, PixelGrid
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.gateway import RobotGateway
from frida_painter.hardware.motion import Motion
from frida_painter.hardware.robot import Frame, Waypoints
from frida_painter.perception.color import true_color
from frida_painter.perception.flatfield import FlatField
from frida_painter.perception.landmarks import Outline, trace_outline
from frida_painter.perception.rectify import pixels_per_metre, rectify
from frida_painter.perception.snapshot import find_corners
from frida_painter.session.observer import Photographer
from frida_painter.strokes.family import CODE_REACH, Taught
from frida_painter.strokes.palette import Palette
from frida_painter.strokes.plan import WHITE
from frida_painter.strokes.strokes import Strokes
from frida_painter.system.images import from_uint8, to_linear, to_srgb

LENGTH = 0.012
"""Length of a short stroke, metres."""
BLACK = 0.04
_STEP = 0.001


class EaselAccess:
    """Access of one procedure to an easel: the gateway to its robot, and photographs with the arm out of view.

    lowest: see RobotGateway; only procedures that search for the canvas set it
    """

    def __init__(self, easel: Easel, *, lowest: float | None = None) -> None:
        self.easel, self.gateway = easel, RobotGateway(easel, lowest=lowest)
        self._photographer = Photographer(easel.camera)

    def photograph(self) -> Frame:
        """Returns a photograph without the arm in view. Raises RobotError, CameraError and their subclasses."""
        self.gateway.step_aside()
        return self._photographer.photograph(self.gateway.last_motion)


def ask_for_paper(easel: Easel, question: str, refusal: str) -> Procedure[None]:
    """Returns when bare paper lies on the easel: the operator lays it, or a person who is asked.

    Raises CalibrationError with the sentence `refusal` if the person declines.
    """
    if not easel.operator.lay_paper() and (yield Confirm(question)) is not True:
        raise CalibrationError(refusal)


def require_four(answer: object, refusal: str) -> NDArray[np.float64]:
    """Returns the corners of an answer, [4, 2] as (column, row). Raises CalibrationError with this sentence."""
    points = np.array(answer if isinstance(answer, tuple) else (), np.float64)
    if points.shape != (4, 2) or not np.isfinite(points).all():
        raise CalibrationError(refusal)
    return points


def ask_for_corners(
    photograph: NDArray[np.uint8], canvas: CanvasSize, known: Corners | None = None
) -> Procedure[Corners]:
    """Returns the corners of the canvas in a person's picture [H, W, 3], clockwise from any of them.

    known: corners that the person gave
    Raises CalibrationError if none are found and nobody points at them.
    """
    found, unseen = known, CalibrationError("Without the four corners of the canvas its picture tells nothing.")
    try:
        found = known or find_corners(photograph, canvas)
    except CalibrationError as reason:
        unseen = reason
    told, drawn = "Where are the canvas's corners, clockwise from any of them?", photograph.copy()
    if found is not None:
        told = "Are these the canvas's corners, clockwise from any of them? (The green lines join them.)"
        around = np.array(found).round().astype(np.int32)
        cv2.polylines(drawn, [around], isClosed=True, color=(0, 200, 80), thickness=max(2, drawn.shape[1] // 400))
    answer = yield PointCorners(told, from_uint8(drawn), found)
    if not isinstance(answer, tuple):
        raise unseen
    return answer


def fill_with_black(easel: Easel) -> None:
    """Has the first well filled with black."""
    easel.operator.fill_wells(Palette(torch.full((1, 3), BLACK)))


def window(grid: PixelGrid, middle: tuple[float, float], wide: float, high: float) -> tuple[slice, slice]:
    """Returns rows and columns of a rectangle around a place; all in canvas metres."""
    column, row = grid.to_pixels(torch.tensor(middle)).tolist()
    across, down = grid.pitch
    return (
        slice(max(0, round(row - high / 2 / down)), round(row + high / 2 / down) + 1),
        slice(max(0, round(column - wide / 2 / across)), round(column + wide / 2 / across) + 1),
    )


def short_stroke(easel: Easel, middle: tuple[float, float], length: float, height: float) -> Waypoints:
    """Returns a stroke across the canvas at robot z `height`, from above and up again; all in metres."""
    along = np.arange(-length / 2, length / 2 + _STEP / 2, _STEP)
    path = np.c_[middle[0] + along, np.full_like(along, middle[1])]
    placed = easel.workspace.to_robot(easel.calibration.place(path), np.full(len(path), height))
    above = placed[[0, -1]].copy()
    above[:, 2] = max(height, ceiling(easel))
    position = np.concatenate([above[:1], placed, above[1:]])
    return Waypoints(f"trial stroke at {1000 * height:.1f} mm", position, easel.workspace.painting_speed)


def ceiling(easel: Easel) -> float:
    """Returns a robot z at which the tip touches nothing, metres."""
    workspace = easel.workspace
    return min(workspace.upper[2], workspace.canvas_origin[2] + workspace.hover)


# Sheets of paper for a stroke library

_FINER = 3  # pixels of a crop per cell of the stroke model, along each side
_NOISE_FLOOR = 0.04
_BORDER = 0.002  # m along the paper's edge; a lens may show some of the table there
_ATTEMPTS = 3

_MIN_SEEN = 0.5  # share of a side of the paper
_SEARCHED = 0.008  # m around the expected edge of the paper
_MAX_BESIDE = 0.004  # m between the paper and the calibrated canvas
_MAX_MOVED = 0.0004  # m since the sheet's first photograph
_SOFTEST, _SOFTEST_PIXELS = 0.05, 2.0  # width of the paper's edge: share of the brush's width, pixels
_SOFTER = 1.8  # times the softness of the sheet's first photograph
_BARE, _DARKER, _SHADED = 0.85, 0.3, 0.08  # light relative to the paper's: bare paper, and two changes of it
_MAX_DARK, _MAX_SHADE = 25e-6, 400e-6  # m2 of bare paper beside the stroke that may change so much
_DIMMEST, _MAX_CLIPPED = 0.05, 0.2  # light of bare paper; overexposed share of the photograph
_MAX_INK = 3e-6  # m2 that may already be inked in the crop of a new stroke


def sample_strokes(kind: BrushKind, count: int, seed: int) -> Strokes:
    """Returns black strokes at the origin that head along x, with shapes drawn uniformly from the brush's limits.

    With the same seed, a larger count starts with the same shapes.
    """
    chance = torch.Generator().manual_seed(seed)
    thickness, along, aside = torch.rand(count, 3, generator=chance).T.contiguous()
    (shortest, longest), (least, most) = kind.limits.length, kind.limits.bend
    length, bend = shortest + along * (longest - shortest), least + aside * (most - least)
    family, taught = kind.limits.family, None
    if family is not None:
        chance = torch.Generator().manual_seed(seed + 1)
        taught = Taught.of(family, CODE_REACH * (2 * torch.rand(count, family.codes, generator=chance) - 1))
    black = torch.full((count, 3), BLACK)
    return Strokes(torch.zeros(count, 2), torch.zeros(count), length, bend, thickness, black, taught)


@dataclass(frozen=True)
class Crop:
    """Crop of a stroke's picture: its extent in pixels around the pixel at which the stroke starts.

    pitch: metres per pixel
    """

    left: int
    right: int
    above: int
    below: int
    pitch: float

    @classmethod
    def covering(cls, frame: MapFrame) -> "Crop":
        """Returns the crop that covers a stroke model's frame."""
        pitch = frame.pitch[0] / _FINER
        reaches = (-frame.left, frame.right, frame.top, -frame.bottom)
        left, right, above, below = (math.ceil(reach / pitch) for reach in reaches)
        return cls(left, right, above, below, pitch)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.above + self.below + 1, self.left + self.right + 1

    def places(self, grid: PixelGrid) -> Iterator[tuple[int, int]]:
        """Yields pixels (row, column) at which strokes may start without overlapping crops."""
        rows, columns = self.shape
        for row in range(self.above, grid.rows - self.below, rows):
            for column in range(self.left, grid.columns - self.right, columns):
                yield row, column


@dataclass(frozen=True)
class Print:
    """Print of one stroke.

    mark: [rows, columns] uint8, 255 for full paint
    flaw: defect of the stroke or its photograph
    since_dip: area painted since the last dip, square metres; 0 for a full brush
    """

    mark: NDArray[np.uint8]
    flaw: Flaw
    since_dip: float = 0.0


class Paper:
    """Fresh sheet of paper on the easel, with free places for strokes and its last photograph.

    moved: distance in metres by which the sheet was found to have moved; it is then given up

    Raises ConfigError if there is no room for one stroke, CalibrationError if the sheet is not bare or not at the
    calibrated place of the canvas, FrameRejected if the camera does not see it well.
    """

    def __init__(self, access: EaselAccess, kind: BrushKind) -> None:
        self._access, self._easel, self.moved = access, access.easel, 0.0
        canvas, frame = self._easel.canvas, kind.frame
        self._crop = crop = Crop.covering(frame)
        self._grid = grid = PixelGrid(canvas, round(canvas.height / crop.pitch), round(canvas.width / crop.pitch))
        self._places = crop.places(grid)
        self._place = next(self._places, None)
        if self._place is None:
            raise ConfigError(
                f"A paper of {canvas} has no room for one stroke of brush {kind.name!r}; take one of at least "
                f"{frame.right - frame.left:.3f} x {frame.top - frame.bottom:.3f} m."
            )
        self._pixels = pixels_per_metre(self._easel.calibration, canvas)
        border = round(_BORDER / crop.pitch)
        self._inner = np.zeros((grid.rows, grid.columns), np.bool_)
        self._inner[border:-border, border:-border] = True
        photograph = access.photograph().image
        self._edge = self._read_edge(photograph)
        if self._edge is not None:
            beside = self._away(self._edge.corners, self._easel.calibration.corners)
            if not beside <= _MAX_BESIDE:
                raise CalibrationError(
                    f"The paper lies {beside * 1000:.1f} mm beside where the canvas was calibrated; allowed are "
                    f"{_MAX_BESIDE * 1000:g} mm. Push it back into its place, or, where the camera was moved, repeat "
                    "the canvas and robot calibrations."
                )
            self._require_focus(self._edge, max(_SOFTEST * kind.width * self._pixels, _SOFTEST_PIXELS))
        picture = rectify(photograph, self._easel.calibration, grid)
        self._field = FlatField.learn(picture, WHITE)
        self._light = to_linear(picture) / self._field.light(*picture.shape[1:])
        self._before = self._light.mean(0).numpy()
        spots = self._area((cv2.blur(self._before, (3, 3)) < 1 - _DARKER) & self._inner)
        if spots > _MAX_DARK:
            raise CalibrationError(
                f"The paper is not bare: {spots * 1e6:.0f} mm2 of it are dark; put a fresh white one on the easel, "
                "and nothing else into the camera's sight."
            )

    @property
    def is_used_up(self) -> bool:
        """True if another sheet is needed: this one is full, or has moved."""
        return self._place is None or self.moved > 0

    def paint(self, stroke: Strokes, *, refill: bool) -> Print:
        """Paints one stroke at the next free place. Raises RobotError, CameraError and their subclasses.

        refill: True to dip the brush first
        """
        assert self._place is not None
        row, column = self._place
        crop = self._crop
        here = slice(row - crop.above, row + crop.below + 1), slice(column - crop.left, column + crop.right + 1)
        occupied = self._area(((self._before < _BARE) & self._inner)[here]) > _MAX_INK
        start = self._grid.to_canvas(torch.tensor([[column, row]], dtype=torch.float64))
        motion = Motion(self._easel.workspace, self._easel.calibration)
        stroking = motion.stroke(replace(stroke, position=start), 0, "stroke for the library")
        self._access.gateway.perform((motion.dip(0), stroking) if refill else (stroking,))
        before = self._magnitude(here)
        flaw = self._look_again(here)
        # Newly covered share of the area that was bare before.
        mark = (self._magnitude(here) - before) / (1 - before).clip(0.2)
        self._place = next(self._places, None)
        if occupied and flaw is Flaw.NONE:
            flaw = Flaw.TOUCHED
        return Print(np.rint(255 * np.where(mark < _NOISE_FLOOR, 0, mark).clip(0, 1)).astype(np.uint8), flaw)

    def _look_again(self, here: tuple[slice, slice]) -> Flaw:
        """Photographs the sheet after a stroke at `here`, repeatedly if there is a flaw, and returns the last flaw."""
        softest = math.inf if self._edge is None else _SOFTER * self._edge.softness + 0.5
        for attempt in range(_ATTEMPTS):
            last = attempt == _ATTEMPTS - 1
            photograph = self._access.photograph().image
            edge = self._read_edge(photograph)
            if edge is not None and edge.softness > softest:
                if last:
                    self._require_focus(edge, softest)
                continue
            light = to_linear(rectify(photograph, self._easel.calibration, self._grid))
            bare = torch.from_numpy(self._before > _BARE)
            bare[here] = False
            field = self._field.refit(light, bare, WHITE)
            white = field.light(*bare.shape)
            even = light / white
            exposed = float(white.median()) >= _DIMMEST and float((light >= 1).float().mean()) <= _MAX_CLIPPED
            flaw = self._compare(edge, even, here) if exposed else Flaw.LIGHT
            if flaw is Flaw.NONE or last:  # a flaw such as a hand may go away
                self._field, self._light, self._before = field, even, even.mean(0).numpy()
                return flaw
        raise AssertionError("the last attempt returns or raises")

    def _compare(self, edge: Outline | None, light: Tensor, here: tuple[slice, slice]) -> Flaw:
        """Returns the flaw due to changes elsewhere than at `here`; even light [3, rows, columns]."""
        moved = 0.0
        if self._edge is not None:
            moved = _SEARCHED if edge is None else self._away(edge.corners, self._edge.corners)
        self.moved = moved if moved > _MAX_MOVED else 0.0
        if self.moved:
            return Flaw.MOVED
        change = cv2.blur(light.mean(0).numpy() - self._before, (3, 3))
        beside = (cv2.blur(self._before, (3, 3)) > _BARE) & self._inner
        beside[here] = False
        if self._area(beside & (change < -_DARKER)) > _MAX_DARK:
            return Flaw.DISTURBED
        return Flaw.LIGHT if self._area(beside & (np.abs(change) > _SHADED)) > _MAX_SHADE else Flaw.NONE

    def _area(self, chosen: NDArray[np.bool_]) -> float:
        """Returns the area of the chosen pixels in m2."""
        return float(np.count_nonzero(chosen)) * self._crop.pitch**2

    def _read_edge(self, photograph: NDArray[np.uint8]) -> Outline | None:
        """Returns the outline of the paper; None if it is not visible."""
        seen = trace_outline(photograph, self._easel.calibration.corners, _SEARCHED * self._pixels)
        return seen if seen is not None and seen.support >= _MIN_SEEN else None

    def _away(self, corners: Corners, others: Corners) -> float:
        """Returns the greatest distance between corners in metres."""
        return float(np.linalg.norm(np.subtract(corners, others), axis=1).max()) / self._pixels

    def _require_focus(self, edge: Outline, softest: float) -> None:
        if not edge.softness <= softest:
            seen, most = (1000 * pixels / self._pixels for pixels in (edge.softness, softest))
            raise FrameRejected(
                f"The camera is out of focus: the edge of the paper is blurred over {seen:.1f} mm, and {most:.1f} mm "
                "are allowed; focus the camera and keep its focus fixed."
            )

    def _magnitude(self, here: tuple[slice, slice]) -> NDArray[np.float32]:
        """Returns the coverage of each pixel of a crop: 0 for paper, 1 for black paint."""
        picture = true_color(to_srgb(self._light[:, *here]), self._easel.calibration)
        covered: NDArray[np.float32] = ((1 - picture.mean(0)) / (1 - BLACK)).numpy()
        return covered
