"""Sheets of paper on which single strokes are painted and photographed, with checks of the photographs.

A stroke's mark is the change between two photographs (paper, "Real Data to Simulation"). This module detects all
other changes. It removes them if possible, and otherwise marks the stroke as flawed. It refuses photographs that
show nothing reliable.
"""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.brush.kinds import BrushKind
from frida_painter.brush.library import Flaw
from frida_painter.calibration import Calibration
from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.dialogue import Confirm, Procedure
from frida_painter.errors import CalibrationError, ConfigError, FrameRejected
from frida_painter.frames import MapFrame, PixelGrid
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.gateway import RobotGateway
from frida_painter.hardware.motion import Motion
from frida_painter.hardware.robot import Frame, Waypoints
from frida_painter.images import to_linear, to_srgb
from frida_painter.palette import Palette
from frida_painter.perception.color import true_color
from frida_painter.perception.flatfield import FlatField
from frida_painter.perception.rectify import rectify
from frida_painter.perception.registration import PaperEdge
from frida_painter.session.observer import Photographer
from frida_painter.stroke_family import CODE_REACH, Taught
from frida_painter.strokes import Strokes

# Access of procedures to an easel: motions, and photographs with the arm out of view.


class EaselAccess:
    """Access of one procedure to an easel: a gateway to its robot, and a photographer with its camera.

    lowest: see RobotGateway; only the brush procedure sets it
    """

    def __init__(self, easel: Easel, *, lowest: float | None = None) -> None:
        self.easel = easel
        self._gateway = RobotGateway(easel, lowest=lowest)
        self._photographer = Photographer(easel.camera)

    def photograph(self) -> Frame:
        """Returns a photograph without the arm in view. Raises RobotError, CameraError and their subclasses."""
        self._gateway.step_aside()
        return self._photographer.photograph(self._gateway.last_motion)

    def perform(self, motions: Iterable[Waypoints]) -> None:
        """Makes the motions, checked as one batch. Raises WorkspaceViolation before anything moves, RobotError."""
        self._gateway.perform(motions)

    def step_aside(self) -> None:
        """Moves the arm out of the camera's view. Raises RobotError."""
        self._gateway.step_aside()

    def pose(self) -> NDArray[np.float64]:
        """Returns the position of the tip, [3] metres. Raises RobotError."""
        return self._gateway.pose()


def ask_for_paper(easel: Easel, question: str, refusal: str) -> Procedure[None]:
    """Returns when bare paper lies on the easel: the operator lays it, or a person who is asked.

    Raises CalibrationError with the sentence `refusal` if the person declines.
    """
    if not easel.operator.lay_paper() and (yield Confirm(question)) is not True:
        raise CalibrationError(refusal)


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


# Trial strokes: short strokes at given heights, each on a free place of the paper, and the widths of their marks.

LENGTH = 0.012
"""Length of a trial stroke, metres."""
BLACK = 0.04
WHITE = (1.0, 1.0, 1.0)
_PITCH = 0.0005
_STEP = 0.001
_EDGE = 0.004
# A pixel belongs to a mark if it is darkened by at least this share; a mark has at least this area, m2.
_DARKENED, _SMALLEST = 0.25, 2e-6


@dataclass(frozen=True)
class Trial:
    """Trial stroke.

    height: robot z, metres
    width: of its mark, metres; 0 if it left none
    look: picture of its cell [3, h, w]
    pitch: metres per pixel of the look
    """

    height: float
    width: float
    look: Tensor
    pitch: float

    @property
    def marked(self) -> bool:
        """True if the stroke left a mark."""
        return self.width > 0


class TrialPaper:
    """Bare paper for trial strokes, one in each cell of `cell` (width, height) metres.

    The well is filled with black first.
    Raises FrameRejected if the paper is not bare.
    """

    def __init__(self, access: EaselAccess, cell: tuple[float, float], ground: tuple[float, float, float]) -> None:
        easel = access.easel
        fill_with_black(easel)
        self._access, self._easel, self._cell = access, easel, cell
        pitch = max(_PITCH, _metres_per_pixel(easel.calibration, easel.canvas.width))
        self._grid = PixelGrid.of_height(easel.canvas, max(8, round(easel.canvas.height / pitch)))
        bare = rectify(self._access.photograph().image, easel.calibration, self._grid)
        self._light = FlatField.learn(bare, ground)
        self._seen = self._in_true_colors(bare)
        self._places = self._cells()
        self._here: tuple[float, float] | None = next(self._places)

    @property
    def is_full(self) -> bool:
        """True if no cell is free."""
        return self._here is None

    @property
    def free_place(self) -> tuple[float, float]:
        """Middle of the next free cell, canvas metres; the middle of the paper if there is none."""
        return self._here or (self._easel.canvas.width / 2, self._easel.canvas.height / 2)

    def stroke(self, height: float) -> Trial:
        """Dips, paints a horizontal stroke at robot z `height`, and photographs it.

        A cell without a mark stays free.
        Raises WorkspaceViolation, RobotError, CameraError.
        """
        assert self._here is not None
        easel, (x, y) = self._easel, self._here
        along = np.arange(-LENGTH / 2, LENGTH / 2 + _STEP / 2, _STEP)
        path = np.c_[x + along, np.full_like(along, y)]
        dip, trial = Motion(easel.workspace, easel.calibration).dip(0), at_height(easel, path, height)
        self._access.perform([dip, trial])
        after = self._in_true_colors(rectify(self._access.photograph().image, easel.calibration, self._grid))
        cell = window(self._grid, self._here, *self._cell)
        width = self._width(self._seen[:, *cell], after[:, *cell])
        self._seen = after
        if width > 0:
            self._here = next(self._places, None)
        return Trial(height, width, after[:, *cell], self._grid.pitch[0])

    def _in_true_colors(self, picture: Tensor) -> Tensor:
        return true_color(self._light.correct(picture), self._easel.calibration)

    def _width(self, before: Tensor, after: Tensor) -> float:
        """Returns the width of the mark that appeared between two pictures of a cell, metres; 0 if there is none."""
        one, other = (look.mean(0).numpy() for look in (before, after))  # [h, w]
        # The brightest pixels are paper; they show how the light has changed.
        change = float(np.quantile(one, 0.8)) / max(1e-3, float(np.quantile(other, 0.8)))
        mark = other * change < (1 - _DARKENED) * one
        across, down = self._grid.pitch
        if not mark.sum() * across * down >= _SMALLEST:
            return 0.0
        columns = mark.sum(0)
        return float(np.quantile(columns[columns > 0], 0.75)) * down

    def _cells(self) -> Iterator[tuple[float, float]]:
        """Yields the middles of the cells, row by row from the top left."""
        width, height = (side - 2 * _EDGE for side in (self._easel.canvas.width, self._easel.canvas.height))
        across, down = max(1, int(width / self._cell[0])), max(1, int(height / self._cell[1]))
        for row in range(down):
            for column in range(across):
                yield _EDGE + (column + 0.5) * width / across, _EDGE + height * (1 - (row + 0.5) / down)


def at_height(easel: Easel, path: NDArray[np.float64], height: float) -> Waypoints:
    """Returns the motion along a path on the canvas [k, 2] (m) at robot z `height`, from above and up again."""
    workspace = easel.workspace
    placed = workspace.to_robot(easel.calibration.place(path), np.full(len(path), height))
    above = placed[[0, -1]].copy()
    above[:, 2] = max(height, ceiling(easel))
    position = np.concatenate([above[:1], placed, above[1:]])
    return Waypoints(f"trial stroke at {1000 * height:.1f} mm", position, workspace.painting_speed)


def ceiling(easel: Easel) -> float:
    """Returns a robot z at which the tip touches nothing, metres."""
    workspace = easel.workspace
    return min(workspace.upper[2], workspace.canvas_origin[2] + workspace.hover)


def _metres_per_pixel(record: Calibration, width: float) -> float:
    top_left, top_right = np.array(record.corners[0]), np.array(record.corners[1])
    return width / float(np.linalg.norm(top_right - top_left))


_FINER = 3  # pixels of a crop per cell of the stroke model, along each side
_NOISE_FLOOR = 0.04
_BORDER = 0.002  # m along the paper's edge; a lens may show some of the table there
_ATTEMPTS = 3

_SEARCHED = 0.008  # m around the expected edge of the paper
_MAX_BESIDE = 0.004  # m between the paper and the calibrated canvas
_MAX_MOVED = 0.0004  # m since the sheet's first photograph
_SOFTEST, _SOFTEST_PIXELS = 0.05, 2.0  # width of the paper's edge: share of the brush's width, pixels
_SOFTER = 1.8  # times the softness of the sheet's first photograph
_BARE, _DARKER, _SHADED = 0.85, 0.3, 0.08  # light relative to the paper's: bare paper, and two changes of it
_MAX_DARK, _MAX_SHADE = 25e-6, 400e-6  # m2 of bare paper beside the stroke that may change so much
_DIMMEST, _MAX_CLIPPED = 0.05, 0.2  # light of bare paper; overexposed share of the photograph
_MAX_INK = 3e-6  # m2 that may already be inked in the crop of a new stroke


@dataclass(frozen=True)
class Shapes:
    """Varied parameters of a library's strokes, each [n].

    taught: families and codes of strokes of a family, whose bends are 0
    """

    thickness: Tensor
    length: Tensor
    bend: Tensor
    taught: Taught | None = None

    @classmethod
    def sample(cls, kind: BrushKind, count: int, seed: int) -> "Shapes":
        """Draws shapes uniformly from the brush's limits.

        With the same seed, a larger count starts with the same shapes.
        """
        chance = torch.Generator().manual_seed(seed)
        thickness, along, aside = torch.rand(count, 3, generator=chance).T.contiguous()
        (shortest, longest), (least, most) = kind.limits.length, kind.limits.bend
        family, taught = kind.limits.family, None
        if family is not None:
            chance = torch.Generator().manual_seed(seed + 1)
            code = CODE_REACH * (2 * torch.rand(count, family.codes, generator=chance) - 1)
            taught = Taught.of(family, code)
        return cls(thickness, shortest + along * (longest - shortest), least + aside * (most - least), taught)

    def __getitem__(self, index: int) -> "Shapes":
        chosen = slice(index, index + 1)
        taught = None if self.taught is None else self.taught[chosen]
        return Shapes(self.thickness[chosen], self.length[chosen], self.bend[chosen], taught)

    def strokes(self, position: Tensor) -> Strokes:
        """Returns black strokes of these shapes that head along x from their starts [n, 2]."""
        count = len(self.length)
        black = torch.full((count, 3), BLACK)
        return Strokes(position, torch.zeros(count), self.length, self.bend, self.thickness, black, self.taught)


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

    def around(self, row: int, column: int) -> tuple[slice, slice]:
        """Returns rows and columns of the crop of a stroke that starts at that pixel."""
        return slice(row - self.above, row + self.below + 1), slice(column - self.left, column + self.right + 1)

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

    Raises ConfigError if there is no room for one stroke, CalibrationError if the sheet is not bare or not at the
    calibrated place of the canvas, FrameRejected if the camera does not see it well.
    """

    def __init__(self, access: EaselAccess, kind: BrushKind) -> None:
        self._access, self._easel = access, access.easel
        easel = access.easel
        self._motion = Motion(easel.workspace, easel.calibration)
        self.crop = Crop.covering(kind.frame)
        self._grid = _grid(easel.canvas, self.crop.pitch)
        self._places = self.crop.places(self._grid)
        self._place = next(self._places, None)
        if self._place is None:
            raise ConfigError(
                f"A paper of {easel.canvas} has no room for one stroke of brush {kind.name!r}; "
                f"take one of at least {kind.frame.right - kind.frame.left:.3f} x "
                f"{kind.frame.top - kind.frame.bottom:.3f} m."
            )
        self._pixels, self._width = _pixels_per_metre(easel), kind.width
        border = round(_BORDER / self.crop.pitch)
        self._inner = np.zeros((self._grid.rows, self._grid.columns), np.bool_)
        self._inner[border:-border, border:-border] = True
        self.moved = 0.0
        self._begin()

    @property
    def is_used_up(self) -> bool:
        """True if another sheet is needed: this one is full, or has moved (by `moved` metres)."""
        return self._place is None or self.moved > 0

    def paint(self, shape: Shapes, *, refill: bool) -> Print:
        """Paints one stroke at the next free place. Raises RobotError, CameraError and their subclasses.

        refill: True to dip the brush first
        """
        assert self._place is not None
        row, column = self._place
        here = self.crop.around(row, column)
        occupied = self._area((self._before < _BARE) & self._inner, here) > _MAX_INK
        position = self._grid.to_canvas(torch.tensor([[column, row]], dtype=torch.float64))
        stroking = self._motion.stroke(shape.strokes(position), 0, "stroke for the library")
        self._access.perform((self._motion.dip(0), stroking) if refill else (stroking,))
        before = self._magnitude(here)
        flaw = self._look_again(here)
        # Newly covered share of the area that was bare before.
        mark = (self._magnitude(here) - before) / (1 - before).clip(0.2)
        self._place = next(self._places, None)
        if occupied and flaw is Flaw.NONE:
            flaw = Flaw.TOUCHED
        return Print(np.rint(255 * np.where(mark < _NOISE_FLOOR, 0, mark).clip(0, 1)).astype(np.uint8), flaw)

    def _begin(self) -> None:
        """Takes the first photograph and checks that the sheet is bare, in place and in focus."""
        frame = self._access.photograph()
        self._edge = self._read_edge(frame.image)
        if self._edge.visible:
            self._require_place(self._edge.beside / self._pixels)
            self._require_focus(self._edge, max(_SOFTEST * self._width * self._pixels, _SOFTEST_PIXELS))
        picture = rectify(frame.image, self._easel.calibration, self._grid)
        self._field = FlatField.learn(picture, WHITE)
        self._light = to_linear(picture) / self._field.light(*picture.shape[1:])
        self._before = self._light.mean(0).numpy()
        spots = self._area((cv2.blur(self._before, (3, 3)) < 1 - _DARKER) & self._inner)
        if spots > _MAX_DARK:
            raise CalibrationError(
                f"The paper is not bare: {spots * 1e6:.0f} mm2 of it are dark; put a fresh white one on the easel, "
                "and nothing else into the camera's sight."
            )

    def _look_again(self, here: tuple[slice, slice]) -> Flaw:
        """Photographs the sheet after a stroke at `here`, repeatedly if there is a flaw, and returns the last flaw."""
        for attempt in range(_ATTEMPTS):
            last = attempt == _ATTEMPTS - 1
            frame = self._access.photograph()
            edge = self._read_edge(frame.image)
            if edge.softness > self._softest:
                if last:
                    self._require_focus(edge, self._softest)
                continue
            light = to_linear(rectify(frame.image, self._easel.calibration, self._grid))
            bare = torch.from_numpy(self._before > _BARE)
            bare[here] = False
            field = self._field.refit(light, bare, WHITE)
            white = field.light(*bare.shape)
            even = light / white
            exposed = float(white.median()) >= _DIMMEST and float((light >= 1).float().mean()) <= _MAX_CLIPPED
            flaw = self._compare(edge, even, here) if exposed else Flaw.LIGHT
            if flaw is Flaw.NONE or last:  # a flaw such as a hand may go away
                self._field = field
                self._light, self._before = even, even.mean(0).numpy()
                return flaw
        raise AssertionError("the last attempt returns or raises")

    @property
    def _softest(self) -> float:
        """Greatest softness of the paper's edge, pixels."""
        first = self._edge.softness
        return math.inf if math.isnan(first) else _SOFTER * first + 0.5

    def _compare(self, edge: PaperEdge, light: Tensor, here: tuple[slice, slice]) -> Flaw:
        """Returns the flaw due to changes elsewhere than at `here`; even light [3, rows, columns]."""
        moved = min(edge.moved_since(self._edge) / self._pixels, _SEARCHED)
        self.moved = moved if moved > _MAX_MOVED else 0.0
        if self.moved:
            return Flaw.MOVED
        change = cv2.blur(light.mean(0).numpy() - self._before, (3, 3))
        beside = (cv2.blur(self._before, (3, 3)) > _BARE) & self._inner
        beside[here] = False
        if self._area(beside & (change < -_DARKER)) > _MAX_DARK:
            return Flaw.DISTURBED
        if self._area(beside & (np.abs(change) > _SHADED)) > _MAX_SHADE:
            return Flaw.LIGHT
        return Flaw.NONE

    def _area(self, chosen: NDArray[np.bool_], here: tuple[slice, slice] | None = None) -> float:
        """Returns the area of the chosen pixels in m2, at `here` or of the whole sheet."""
        return float(np.count_nonzero(chosen if here is None else chosen[here])) * self.crop.pitch**2

    def _read_edge(self, picture: NDArray[np.uint8]) -> PaperEdge:
        return PaperEdge.read(picture, self._easel.calibration.corners, _SEARCHED * self._pixels)

    def _require_place(self, beside: float) -> None:
        if not beside <= _MAX_BESIDE:
            raise CalibrationError(
                f"The paper lies {beside * 1000:.1f} mm beside where the canvas was calibrated; allowed are "
                f"{_MAX_BESIDE * 1000:g} mm. Push it back into its place, or, where the camera was moved, repeat the "
                "canvas and robot calibrations."
            )

    def _require_focus(self, edge: PaperEdge, softest: float) -> None:
        if not edge.softness <= softest:
            raise FrameRejected(
                f"The camera is out of focus: the edge of the paper is blurred over {self._millimetres(edge.softness)} "
                f"mm, and {self._millimetres(softest)} mm are allowed; focus the camera and keep its focus fixed."
            )

    def _millimetres(self, pixels: float) -> str:
        return f"{1000 * pixels / self._pixels:.1f}"

    def _magnitude(self, here: tuple[slice, slice]) -> NDArray[np.float32]:
        """Returns the coverage of each pixel of a crop: 0 for paper, 1 for black paint."""
        picture = true_color(to_srgb(self._light[:, *here]), self._easel.calibration)
        covered: NDArray[np.float32] = ((1 - picture.mean(0)) / (1 - BLACK)).numpy()
        return covered


def _grid(canvas: CanvasSize, pitch: float) -> PixelGrid:
    return PixelGrid(canvas, round(canvas.height / pitch), round(canvas.width / pitch))


def _pixels_per_metre(easel: Easel) -> float:
    """Returns the resolution of the photograph in pixels per metre, averaged over the canvas's four sides."""
    corners = np.array(easel.calibration.corners)
    around = float(np.linalg.norm(np.roll(corners, -1, 0) - corners, axis=1).sum())
    return around / (2 * (easel.canvas.width + easel.canvas.height))
