"""The table: canvas, paint wells, water and rag, and what the tip of the brush does to them as it moves.

Nothing here knows of strokes or dips. Whatever happens follows from where the tip is.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from frida_painter.hardware.workspace import Point, Workspace
from frida_painter.virtual.bristles import Tuft
from frida_painter.virtual.canvas import Canvas
from frida_painter.virtual.checker import Checker
from frida_painter.virtual.faults import Bump, Faults
from frida_painter.virtual.simulation_log import Note, unnoted

_MM = 1000.0
# A vessel is touched within this radius (m) of its centre and not higher than this above its place.
_VESSEL_RADIUS, _VESSEL_HEIGHT = 0.018, 0.003
_RAG_HALF_DEPTH = 0.03
# Paint that stays in the brush when it goes into the water, and per metre of stirring and of wiping.
_KEPT_IN_WATER, _STIRRING_LENGTH, _WIPING_LENGTH = 0.3, 0.050, 0.060
# The tip is looked at this often along its way (m); on the canvas as finely as the cells ask for.
_LOOK = 0.002
_CELLS_PER_STEP = 0.9
# A lifted tuft springs forward faster than it rises, so that lifts are followed in smaller steps.
_FINER_LIFT = 3.0


@dataclass(frozen=True)
class PlacementError:
    """How far the canvas lies from where the robot believes it to be.

    shift: metres along the canvas's x and y; turn: radians counter-clockwise about its centre.
    """

    shift: tuple[float, float]
    turn: float

    @classmethod
    def drawn_from(cls, random: np.random.Generator) -> "PlacementError":
        """A usual one: about 2 mm off in some direction and turned by about 0.4 degrees."""
        direction, size = random.uniform(0, 2 * math.pi), random.uniform(0.0015, 0.0025)
        turn = math.radians(random.uniform(0.3, 0.5)) * random.choice((-1, 1))
        return cls((size * math.cos(direction), size * math.sin(direction)), float(turn))

    def moved(self, position: NDArray[np.float64], center: NDArray[np.float64]) -> NDArray[np.float64]:
        """Canvas positions [k, 2] after the error."""
        return (position - center) @ self._rotation() + center + self.shift

    def undone(self, position: NDArray[np.float64], center: NDArray[np.float64]) -> NDArray[np.float64]:
        """Canvas positions [k, 2] before the error."""
        return (position - center - self.shift) @ self._rotation().T + center

    def _rotation(self) -> NDArray[np.float64]:
        cos, sin = math.cos(self.turn), math.sin(self.turn)
        return np.array([[cos, sin], [-sin, cos]])


@dataclass(frozen=True)
class HandNoise:
    """Deviations from one contact with the canvas to the next: of place (m) and of depth (share of a full press)."""

    place: float = 0.00025
    depth: float = 0.025


class Table:
    """Everything that the brush can touch.

    drawn, in_water, on_rag, carried_away: microlitres drawn from the wells, in the water, on the rag,
    on canvases that were taken away; touches, dips:
    contacts with the canvas and with a well so far; knock: how far the canvas was moved by accident;
    tip, base: where the brush and the robot's foot are, mm on the canvas; checker: the colour checker,
    where one lies there; note: told of every motion.
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
        self.note: Note = unnoted
        self._felt: list[Bump] = []
        self._workspace, self._touch_height = workspace, touch_height
        self._error, self._noise, self._random = error, noise, random
        self._center = np.array([canvas.width, canvas.height]) / 2 / _MM
        self.tip = np.full(2, -np.inf)
        self.base = self.on_canvas(np.zeros((1, 3)))[0, :2]

    def lay(self, canvas: Canvas) -> None:
        """Takes the canvas away and lays this one where the first lay before anybody knocked against it."""
        self.carried_away += self.canvas.wet_volume + self.canvas.dry_volume
        self.canvas = canvas
        self.knock = PlacementError((0.0, 0.0), 0.0)

    def move(self, path: NDArray[np.float64], now: float, faults: Faults) -> None:
        """The tip goes along a polyline [k, 3] (metres, robot frame), arriving at time `now` (s)."""
        self._feel(faults.bumps)
        touches = self.touches
        on_canvas = self.on_canvas(path)
        self.tip = on_canvas[-1, :2]
        near = on_canvas[:, 2] > 0
        if (near[1:] | near[:-1]).any():
            self._over_canvas(on_canvas, now, faults)
        if len(path) > 1:
            self._among_vessels(_resampled(path, _LOOK), faults)
        # A stroke survives a power cut as it would on a real canvas; ways through the air need not.
        self.note(
            {"did": "move", "path": path.tolist(), "now": now, "brush": self.tuft.volume}, flush=self.touches > touches
        )

    def _feel(self, bumps: tuple[Bump, ...]) -> None:
        for bump in bumps:
            if bump.before_touch <= self.touches and bump not in self._felt:
                self._felt.append(bump)
                x, y = self.knock.shift
                self.knock = PlacementError((x + bump.shift[0], y + bump.shift[1]), self.knock.turn + bump.turn)

    def on_canvas(self, path: NDArray[np.float64]) -> NDArray[np.float64]:
        """Robot frame [k, 3] to the true canvas: x, y in mm, depth (0 lightest touch, 1 hardest press)."""
        workspace = self._workspace
        cos, sin = math.cos(workspace.canvas_angle), math.sin(workspace.canvas_angle)
        meant = (path[:, :2] - workspace.canvas_origin[:2]) @ np.array([[cos, -sin], [sin, cos]])
        # A knocked canvas moves under the brush: the mark goes the other way.
        place = self.knock.undone(self._error.moved(meant, self._center), self._center) * _MM
        depth = (self._touch_height - path[:, 2]) * _MM / self.tuft.brush.press_depth
        return np.c_[place, np.minimum(depth, 1.25)]

    def _over_canvas(self, path: NDArray[np.float64], now: float, faults: Faults) -> None:
        millimetres = np.array([1, 1, _FINER_LIFT * self.tuft.brush.press_depth])
        fine = _resampled(path * millimetres, _CELLS_PER_STEP * self.canvas.cell) / millimetres
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
    """Length of those pieces of a path whose two ends are inside."""
    piece = np.linalg.norm(np.diff(path, axis=0), axis=1)
    return float(piece[inside[1:] & inside[:-1]].sum())


def _resampled(path: NDArray[np.float64], step: float) -> NDArray[np.float64]:
    """A polyline [k, d] as points at most `step` apart, corners kept."""
    piece = np.linalg.norm(np.diff(path, axis=0), axis=1)
    count = np.maximum(1, np.ceil(piece / step).astype(int))
    place = np.concatenate([k + np.arange(n) / n for k, n in enumerate(count)] + [[len(path) - 1.0]])
    return np.stack([np.interp(place, np.arange(len(path)), column) for column in path.T], -1)


def _runs(wanted: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and past-last index of every unbroken run of True."""
    edge = np.flatnonzero(np.diff(np.r_[False, wanted, False]))
    return [(int(a), int(b)) for a, b in zip(edge[::2], edge[1::2], strict=True)]
