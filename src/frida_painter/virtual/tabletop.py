"""Table of the studio: canvas, paint wells, water and rag, and the effects of the moving brush tip.

The table knows no strokes or dips. All effects follow from the tip position.
"""

import math
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import ConfigError
from frida_painter.hardware.faults import Bump, Faults, PlacementError
from frida_painter.hardware.robot import Point, Workspace
from frida_painter.strokes.palette import MAX_COLORS
from frida_painter.virtual.bristles import BristleBrush, Tuft
from frida_painter.virtual.canvas import Canvas
from frida_painter.virtual.paint import to_linear
from frida_painter.virtual.simulation_log import Note, ignore_entry

# Colour checker of the studio: a card of 24 patches at any place on the table.

# Mean sRGB of 30 measured cards (D. Pascale, BabelColor, 2012; given there as xyY under D50), row by row as the
# card is read.
_PATCHES = (
    (0.458, 0.321, 0.265), (0.780, 0.580, 0.506), (0.358, 0.481, 0.615),
    (0.352, 0.424, 0.254), (0.513, 0.504, 0.687), (0.367, 0.744, 0.674),
    (0.876, 0.488, 0.175), (0.273, 0.361, 0.659), (0.782, 0.328, 0.381),
    (0.362, 0.234, 0.406), (0.625, 0.740, 0.248), (0.905, 0.634, 0.150),
    (0.150, 0.248, 0.577), (0.268, 0.582, 0.288), (0.711, 0.188, 0.222),
    (0.941, 0.784, 0.085), (0.757, 0.330, 0.585), (0.000, 0.530, 0.657),
    (0.963, 0.961, 0.942), (0.787, 0.792, 0.789), (0.630, 0.635, 0.634),
    (0.470, 0.476, 0.475), (0.326, 0.332, 0.334), (0.196, 0.196, 0.199),
)  # fmt: skip
_ACROSS, _DOWN = 6, 4
_CARD_SRGB = (36, 35, 34)
# Difference of a printed patch from the mean one: standard deviation in each channel, share of its light.
_BATCH = 0.006
# Width of the largest available card, mm.
_CLASSIC = 280.0
# Card in units of a patch's side: distance between patches, and the rim around them.
_PITCH, _RIM = 1.15, 0.32
_CELLS_PER_PATCH = 40


@dataclass(frozen=True)
class Checker:
    """Colour checker card on the table.

    center: mm on the canvas's plane.
    turn: radians counter-clockwise.
    width: mm of its longer side.
    looks [rows, columns, 3]: linear reflectance, row 0 is its upper edge.
    Raises ConfigError if the width is not from 30 to 400 mm, or if the position is not finite.
    """

    center: tuple[float, float]
    turn: float
    width: float
    looks: NDArray[np.float32]

    def __post_init__(self) -> None:
        if not 30 <= self.width <= 400 or not np.isfinite([*self.center, self.turn]).all():
            raise ConfigError(
                f"A colour checker {self.width} mm wide at {self.center} mm, turned by {self.turn}, was given; it is "
                "30 to 400 mm wide and lies somewhere."
            )

    @classmethod
    def sample(cls, random: np.random.Generator, width: float, height: float) -> Self:
        """Returns a random card for a canvas of that size (mm), roughly in its middle."""
        size = float(np.clip(0.62 * min(width, 1.4 * height), 30, _CLASSIC))
        x, y = random.uniform(-0.04, 0.04, 2)
        center = (float(width * (0.5 + x)), float(height * (0.5 + y)))
        return cls(center, float(random.uniform(-0.2, 0.2)), size, _print_card(random))

    def place_at(self, center: tuple[float, float], turn: float, width: float | None) -> Self:
        """Returns the same card at another place, or with another width."""
        return replace(self, center=center, turn=turn, width=width or self.width)

    def cells(self) -> NDArray[np.float64]:
        """Returns the affine map [2, 3] from mm on the canvas's plane (x, y, 1) to the card's (column, row)."""
        rows, columns = self.looks.shape[:2]
        cos, sin = math.cos(self.turn), math.sin(self.turn)
        turned = np.array([[cos, sin], [sin, -cos]]) * columns / self.width  # y goes up, rows go down.
        middle = np.array([(columns - 1) / 2, (rows - 1) / 2])
        return np.c_[turned, middle - turned @ self.center]


def _print_card(random: np.random.Generator) -> NDArray[np.float32]:
    """Returns the looks of one card, [rows, columns, 3], with random printing differences."""
    side, pitch, rim = _CELLS_PER_PATCH, round(_PITCH * _CELLS_PER_PATCH), round(_RIM * _CELLS_PER_PATCH)
    looks = np.empty(((_DOWN - 1) * pitch + side + 2 * rim, (_ACROSS - 1) * pitch + side + 2 * rim, 3), np.float32)
    looks[:] = to_linear(np.array(_CARD_SRGB) / 255)
    patches = to_linear(np.array(_PATCHES))
    patches *= 1 + random.normal(0, _BATCH, patches.shape)
    for number, reflectance in enumerate(patches):
        top, left = rim + number // _ACROSS * pitch, rim + number % _ACROSS * pitch
        looks[top : top + side, left : left + side] = reflectance
    return looks


_MM = 1000.0
# Contact with a vessel: within this radius (m) of its centre, and at most this high above it.
_VESSEL_RADIUS, _VESSEL_HEIGHT = 0.018, 0.003
_RAG_HALF_DEPTH = 0.03
# Share of paint that stays in the brush in the water; length constants of stirring and of wiping, in metres.
_KEPT_IN_WATER, _STIRRING_LENGTH, _WIPING_LENGTH = 0.3, 0.050, 0.060
# Step of the tip along its way (m); over the canvas the cells set the step.
_LOOK = 0.002
_CELLS_PER_STEP = 0.9
# A lifted tuft springs forward faster than it rises, so lifts need smaller steps.
_FINER_LIFT = 3.0


@dataclass(frozen=True)
class HandNoise:
    """Random deviations between contacts with the canvas: of place (m) and of depth (share of a full press)."""

    place: float = 0.00025
    depth: float = 0.025


class Table:
    """Everything that the brush can touch.

    drawn, in_water, on_rag, carried_away: microlitres drawn from the wells, in the water, on the rag, and on
    canvases that were taken away.
    touches, dips: contacts with the canvas and with a well so far.
    knock: displacement of the canvas by accident.
    tip, base: positions of the brush and of the robot's base, mm on the canvas.
    checker: colour checker on the canvas, if any.
    under, over: printed papers whose edges lie below the canvas, and on it.
    note: called for every motion.
    """

    def __init__(
        self, canvas: Canvas, tuft: Tuft, workspace: Workspace, touch_height: float,
        error: PlacementError, noise: HandNoise, random: np.random.Generator,
    ) -> None:  # fmt: skip
        self.canvas, self.tuft = canvas, tuft
        self.paints: tuple[NDArray[np.float64], ...] = ()
        self.drawn = self.in_water = self.on_rag = self.carried_away = 0.0
        self.touches = self.dips = 0
        self.knock = PlacementError((0.0, 0.0), 0.0)
        self.checker: Checker | None = None
        self.under: tuple[Checker, ...] = ()
        self.over: tuple[Checker, ...] = ()
        self.note: Note = ignore_entry
        self._felt: list[Bump] = []
        self._workspace, self._touch_height = workspace, touch_height
        self._error, self._noise, self._random = error, noise, random
        self._center = np.array([canvas.width, canvas.height]) / 2 / _MM
        self.tip = np.full(2, -np.inf)
        self.base = self.on_canvas(np.zeros((1, 3)))[0, :2]

    def lay(self, canvas: Canvas) -> None:
        """Takes the canvas away and lays this one at the original place."""
        self.carried_away += self.canvas.wet_volume + self.canvas.dry_volume
        self.canvas = canvas
        self.knock = PlacementError((0.0, 0.0), 0.0)

    def move(self, path: NDArray[np.float64], now: float, faults: Faults) -> None:
        """Moves the tip along a polyline [k, 3] (metres, robot frame) that ends at time `now` (s)."""
        self._feel(faults.bumps)
        touches = self.touches
        on_canvas = self.on_canvas(path)
        self.tip = on_canvas[-1, :2]
        near = on_canvas[:, 2] > 0
        if (near[1:] | near[:-1]).any():
            self._over_canvas(on_canvas, now, faults)
        if len(path) > 1:
            self._among_vessels(_resample(path, _LOOK), faults)
        # A stroke survives a power cut, as on a real canvas; travel through the air need not.
        entry = {"did": "move", "path": path.tolist(), "now": now, "brush": self.tuft.volume}
        self.note(entry, flush=self.touches > touches)

    def _feel(self, bumps: tuple[Bump, ...]) -> None:
        for bump in bumps:
            if bump.before_touch <= self.touches and bump not in self._felt:
                self._felt.append(bump)
                x, y = self.knock.shift
                self.knock = PlacementError((x + bump.shift[0], y + bump.shift[1]), self.knock.turn + bump.turn)

    def on_canvas(self, path: NDArray[np.float64]) -> NDArray[np.float64]:
        """Maps robot frame [k, 3] to the real canvas: x, y in mm, depth (0 lightest touch, 1 hardest press)."""
        workspace = self._workspace
        cos, sin = math.cos(workspace.canvas_angle), math.sin(workspace.canvas_angle)
        meant = (path[:, :2] - workspace.canvas_origin[:2]) @ np.array([[cos, -sin], [sin, cos]])
        # A knocked canvas moves under the brush: the mark moves the other way.
        place = self.knock.undone(self._error.displace(meant, self._center), self._center) * _MM
        depth = (self._touch_height - path[:, 2]) * _MM / self.tuft.brush.press_depth
        return np.c_[place, np.minimum(depth, 1.25)]

    def _over_canvas(self, path: NDArray[np.float64], now: float, faults: Faults) -> None:
        millimetres = np.array([1, 1, _FINER_LIFT * self.tuft.brush.press_depth])
        place = _subdivide(path * millimetres, _CELLS_PER_STEP * self.canvas.cell)
        fine = _at(place, path * millimetres) / millimetres
        margin = 2 * self.tuft.brush.hard_radius
        size = np.array([self.canvas.width, self.canvas.height])
        reaches = (fine[:, 2] > -0.08) & (fine[:, :2] > -margin).all(1) & (fine[:, :2] < size + margin).all(1)
        for first, last in _runs(reaches):
            if fine[first:last, 2].max() <= 0:
                continue
            touch = (
                fine[first:last]
                + np.r_[self._random.normal(0, self._noise.place * _MM, 2), self._random.normal(0, self._noise.depth)]
            )
            if self.touches not in faults.dropped_touches:
                self.canvas.touch(self.tuft, touch, now)
                self.tuft.settle()
            self.touches += 1

    def _among_vessels(self, path: NDArray[np.float64], faults: Faults) -> None:
        workspace = self._workspace
        for well, paint in zip(workspace.wells, self.paints, strict=False):
            if _inside(path, well).any():
                if self.dips not in faults.dry_dips:
                    self.drawn += self.tuft.fill(paint)
                self.dips += 1
        stirred = _length_within(path, _inside(path, workspace.water))
        if stirred > 0:
            self.in_water += self.tuft.keep(_KEPT_IN_WATER * math.exp(-stirred / _STIRRING_LENGTH))
        x, y, z = workspace.rag
        on_rag = (np.abs(path[:, 0] - x) <= workspace.rag_width / 2 + 1e-6) & (
            np.abs(path[:, 1] - y) <= _RAG_HALF_DEPTH
        )
        wiped = _length_within(path, on_rag & (path[:, 2] <= z + _VESSEL_HEIGHT))
        if wiped > 0:
            self.on_rag += self.tuft.keep(math.exp(-wiped / _WIPING_LENGTH))


def _inside(path: NDArray[np.float64], vessel: Point) -> NDArray[np.bool_]:
    off = np.hypot(path[:, 0] - vessel[0], path[:, 1] - vessel[1])
    return (off <= _VESSEL_RADIUS) & (path[:, 2] <= vessel[2] + _VESSEL_HEIGHT)


def _length_within(path: NDArray[np.float64], inside: NDArray[np.bool_]) -> float:
    """Returns the length of those pieces of a path whose two ends are inside."""
    piece = np.linalg.norm(np.diff(path, axis=0), axis=1)
    return float(piece[inside[1:] & inside[:-1]].sum())


def _resample(path: NDArray[np.float64], step: float) -> NDArray[np.float64]:
    """Returns a polyline [k, d] as points at most `step` apart, with its corners."""
    return _at(_subdivide(path, step), path)


def _subdivide(path: NDArray[np.float64], step: float) -> NDArray[np.float64]:
    """Returns places on a polyline [k, d] that are at most `step` apart, in numbers of its points."""
    piece = np.linalg.norm(np.diff(path, axis=0), axis=1)
    count = np.maximum(1, np.ceil(piece / step).astype(int))
    return np.concatenate([k + np.arange(n) / n for k, n in enumerate(count)] + [[len(path) - 1.0]])


def _at(place: NDArray[np.float64], path: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the points of a polyline [k, d] at places of `_subdivide`."""
    return np.stack([np.interp(place, np.arange(len(path)), column) for column in path.T], -1)


def _runs(wanted: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Returns the first and past-last index of every unbroken run of True."""
    edge = np.flatnonzero(np.diff(np.r_[False, wanted, False]))
    return [(int(a), int(b)) for a, b in zip(edge[::2], edge[1::2], strict=True)]


# Layout of the studio: positions of canvas, paint wells, water and rag around an arm.

_WELL_PITCH = 0.045
_MARGIN = 0.06
_HOVER, _HEADROOM = 0.03, 0.15
_RAG_WIDTH = 0.08
_PAINTING_SPEED, _TRAVEL_SPEED = 0.06, 0.25
# Free arm: corner and angle of the canvas in its frame; columns of the wells to its left.
_FREE_ORIGIN: Point = (0.25, -0.15, 0.12)
_FREE_ANGLE = math.radians(4)
_FREE_COLUMNS = 4
# Sawyer: distance of the canvas's middle from the base, least distance of its edge, and its height.
_SAWYER_MIDDLE, _SAWYER_NEAREST, _SAWYER_HEIGHT = 0.60, 0.34, 0.05
_SAWYER_ROWS, _SAWYER_FIRST_WELL = 9, 0.28
_SAWYER_ASIDE = 0.25


@dataclass(frozen=True)
class StudioLayout:
    """Layout of the studio around an arm: its workspace, and the home position of the tip."""

    workspace: Workspace
    home: Point


def free_layout(canvas: CanvasSize, brush: BristleBrush) -> StudioLayout:
    """Returns the layout around an arm with unlimited reach: the canvas in front, wells, water and rag left of it."""
    _, y, z = _FREE_ORIGIN
    corners = _around(canvas, _FREE_ORIGIN, _FREE_ANGLE)
    left = float(corners[:, 0].min()) - _WELL_PITCH
    wells = tuple(
        (left - _WELL_PITCH * (i % _FREE_COLUMNS), y + _WELL_PITCH * (i // _FREE_COLUMNS), z) for i in range(MAX_COLORS)
    )
    water: Point = (left, y - 0.08, z)
    rag: Point = (left - 0.11, y - 0.08, z)
    home: Point = (rag[0], rag[1], z + 0.10)
    workspace = _workspace(brush, _FREE_ORIGIN, _FREE_ANGLE, corners, wells, water, rag)
    return StudioLayout(replace(workspace, home=home), home)


def sawyer_layout(canvas: CanvasSize, brush: BristleBrush) -> StudioLayout:
    """Returns the layout around the simulated Sawyer; the canvas faces a person opposite the arm.

    The wells are at the arm's right, water and rag at its left.
    """
    near = max(_SAWYER_NEAREST, _SAWYER_MIDDLE - canvas.height / 2)
    origin: Point = (near + canvas.height, -canvas.width / 2, _SAWYER_HEIGHT)
    angle = math.pi / 2  # the canvas's lower edge is far from the arm
    corners = _around(canvas, origin, angle)
    # Beside a small canvas, vessels still keep away from the arm's base.
    right = min(float(corners[:, 1].min()) - _WELL_PITCH, -_SAWYER_ASIDE)
    left = max(float(corners[:, 1].max()) + 0.07, _SAWYER_ASIDE)
    z = _SAWYER_HEIGHT
    wells = tuple(
        (_SAWYER_FIRST_WELL + _WELL_PITCH * (i % _SAWYER_ROWS), right - _WELL_PITCH * (i // _SAWYER_ROWS), z)
        for i in range(MAX_COLORS)
    )
    water: Point = (0.42, left, z)
    rag: Point = (0.58, left, z)
    home: Point = (0.45, left + 0.08, z + 0.10)
    return StudioLayout(replace(_workspace(brush, origin, angle, corners, wells, water, rag, home), home=home), home)


def _around(canvas: CanvasSize, origin: Point, angle: float) -> NDArray[np.float64]:
    """Returns the corners [4, 2] of the canvas with its margin, in the robot's frame."""
    cos, sin = math.cos(angle), math.sin(angle)
    return np.array(
        [
            (origin[0] + cos * u - sin * v, origin[1] + sin * u + cos * v)
            for u in (-_MARGIN, canvas.width + _MARGIN)
            for v in (-_MARGIN, canvas.height + _MARGIN)
        ]
    )


def _workspace(
    brush: BristleBrush, origin: Point, angle: float, corners: NDArray[np.float64],
    wells: tuple[Point, ...], water: Point, rag: Point, *others: Point,
) -> Workspace:  # fmt: skip
    """Returns the workspace that holds all of these, with a margin."""
    everything = np.array([*corners, *(place[:2] for place in (*wells, water, rag, *others))])
    lower, upper = everything.min(0) - _MARGIN, everything.max(0) + _MARGIN
    z = origin[2]
    return Workspace(
        lower=(float(lower[0]), float(lower[1]), z - brush.press_depth / _MM - 0.002),
        upper=(float(upper[0]), float(upper[1]), z + _HEADROOM),
        canvas_origin=origin,
        canvas_angle=angle,
        wells=wells,
        water=water,
        rag=rag,
        rag_width=_RAG_WIDTH,
        hover=_HOVER,
        painting_speed=_PAINTING_SPEED,
        travel_speed=_TRAVEL_SPEED,
    )
