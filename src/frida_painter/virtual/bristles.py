"""Tuft of a brush: its bristles spread, trail behind the handle, leave the canvas one by one, and hold paint.

The tuft follows the handle like a rope that is pulled over the ground (a tractrix). It opens at once under
pressure, closes slowly when it is raised, and fans out across its path while it is dragged. Therefore a stroke
begins round, cuts its bends, and ends blunt and torn: locks of bristles differ in length and leave the canvas at
different heights. The model follows W. Baxter and M. Lin, "A versatile interactive 3D brush model" (2004), and Z.
Chen et al., "WetBrush" (2015), reduced to the effects that are visible in the mark.
"""

import math
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from frida_painter.errors import ConfigError
from frida_painter.virtual.paint import BANDS

# Brushes of the studio, by name, with all their constants.


@dataclass(frozen=True)
class BristleBrush:
    """Round bristle brush; lengths in millimetres, volumes in microlitres.

    bristles: number of simulated bristles; each stands for a lock of hairs.
    light_radius: radius of the tuft at the lightest touch.
    hard_radius: radius of the tuft at the hardest press.
    press_depth: distance from the lightest touch to the hardest press.
    drag: distance of the tuft behind the handle at the hardest press; larger for softer brushes.
    closing: speed at which a spread tuft closes when it is raised, mm per mm painted.
    capacity: paint in a full tuft.
    film: thickness of the wet film that a full tuft leaves.
    lengths, bends: (least, most) of the strokes that the brush paints well.
    """

    name: str
    bristles: int
    light_radius: float
    hard_radius: float
    press_depth: float
    drag: float
    closing: float
    capacity: float
    film: float
    lengths: tuple[float, float]
    bends: tuple[float, float]

    def radius(self, depth: float) -> float:
        """Returns the radius of the tuft at a depth between 0 (lightest touch) and 1 (hardest press)."""
        return self.light_radius + (self.hard_radius - self.light_radius) * depth


_JAR = (
    BristleBrush("fine", 190, 3.1, 5.0, 4.0, 5.0, 0.05, 38.0, 0.06, (10.0, 50.0), (-20.0, 20.0)),
    BristleBrush("medium", 300, 2.2, 8.2, 6.0, 6.5, 0.08, 64.0, 0.06, (12.0, 60.0), (-20.0, 20.0)),
    BristleBrush("broad", 480, 1.9, 14.0, 8.0, 9.0, 0.12, 140.0, 0.06, (12.0, 75.0), (-22.0, 22.0)),
)


def find_brush(name: str) -> BristleBrush:
    """Returns the brush of that name. Raises ConfigError for an unknown name."""
    for brush in _JAR:
        if brush.name == name:
            return brush
    raise ConfigError(f"There is no brush {name!r} in the virtual studio; take {', '.join(brush_names())}.")


def brush_names() -> tuple[str, ...]:
    """Returns the names of all brushes, from the finest to the broadest."""
    return tuple(brush.name for brush in _JAR)


_LOCKS = 34
_STRANDS = 22
_STRAYS = 0.05
_FANNED = 0.74
# A light touch already lays the tuft down: its distance behind the handle grows with this power of the depth.
_LYING = 0.3
_LEVELLING = 0.4


class Tuft:
    """Bristles of a brush and their paint; all random numbers come from `random`.

    capacity, load [n]: microlitres of paint.
    pigment [n, 6]: K and S of that paint, times its volume.
    bite [n]: how much deeper than average a bristle reaches into the weave.
    """

    def __init__(self, brush: BristleBrush, random: np.random.Generator) -> None:
        self.brush = brush
        self._random = random
        n = brush.bristles
        # Like a sunflower's seeds, bristles fill the disc evenly. Drawn together into locks, they leave the gaps of
        # a real tuft.
        turn = np.arange(n) * math.pi * (3 - math.sqrt(5))
        radius = np.sqrt((np.arange(n) + 0.5) / n)
        place = np.stack((radius * np.cos(turn), radius * np.sin(turn)), -1)
        place += random.normal(0, 0.03, place.shape)
        locks = _in_disc(random, _LOCKS)
        self._lock = np.argmin(((place[:, None] - locks) ** 2).sum(-1), 1)
        outward = np.clip(np.linalg.norm(place, axis=1, keepdims=True), 0, 1) ** 2
        place += 0.35 * outward * (locks[self._lock] - place)
        self._stray = random.random(n) < _STRAYS
        place[self._stray] *= random.uniform(1.05, 1.25, (int(self._stray.sum()), 1))
        self._place = place
        self._edge = np.clip(np.linalg.norm(place, axis=1), 0, 1.2) ** 2
        self._onset = 0.22 * self._edge * random.random(_LOCKS)[self._lock] + 0.04 * random.random(n)
        self._lag = 0.40 * random.standard_normal(_LOCKS)[self._lock] + 0.15 * random.standard_normal(n)
        self.bite = 0.22 * random.standard_normal(_LOCKS)[self._lock] + 0.12 * random.standard_normal(n)
        share = random.lognormal(0, 0.35, _LOCKS)[self._lock] * random.lognormal(0, 0.25, n)
        self.capacity = (brush.capacity * share / share.sum()).astype(np.float64)
        self.load = np.zeros(n)
        self.pigment = np.zeros((n, 2 * BANDS))
        self._luck: NDArray[np.float64] | None = None

    @property
    def volume(self) -> float:
        """Paint in the tuft, in microlitres."""
        return float(self.load.sum())

    def draw_luck_from(self, random: np.random.Generator) -> None:
        """Sets the random generator for later dips and strokes."""
        self._random = random

    def fill(self, paint: NDArray[np.float64]) -> float:
        """Dips the tuft into a paint (K, S [6]); returns the microlitres that it takes up.

        Some locks take up more than others, which changes with every stroke. A second dip before the same stroke
        uses the same locks. A brush that is cleaned and dipped again after a crash therefore paints the same.
        """
        if self._luck is None:
            self._luck = np.minimum(1, 1.2 - self._random.random(_LOCKS) ** 3)[self._lock]
        missing = np.maximum(0, self._luck * self.capacity - self.load)
        self.pigment += missing[:, None] * paint
        self.load += missing
        return float(missing.sum())

    def keep(self, share: float) -> float:
        """Keeps this share of the paint; returns the microlitres of the rest."""
        before = self.volume
        self.load *= share
        self.pigment *= share
        return before - self.volume

    def settle(self) -> None:
        """Evens out the paint between full and empty bristles, as happens between strokes."""
        volume = self.volume
        if volume > 0:
            mean = self.pigment.sum(0) / volume
            even = self.capacity * (volume / self.capacity.sum())
            self.load += _LEVELLING * (even - self.load)
            self.pigment += _LEVELLING * (even[:, None] * mean - self.pigment)

    def feet(self, path: NDArray[np.float64]) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        """Returns the contact of each bristle along a path, and the drag of the tuft in each step.

        path [k, 3]: x, y of the tip in mm on the canvas, and depth (0 lightest touch, 1 hardest press), evenly
        spaced.
        Returns contacts [k, n, 3]: x, y in mm, and the pressed depth of the bristle; at 0 or below, it is in the
        air.
        Returns drags [k]: mm in each step.

        The tuft takes a slightly different shape with every stroke.
        """
        random, n, lock = self._random, len(self.load), self._lock
        self._luck = None
        shear = np.eye(2) + random.normal(0, 0.05, (2, 2))
        locks = random.normal(0, 0.05, (_LOCKS, 2))
        offset = self._place @ shear + random.normal(0, 0.05, 2) + locks[lock] + random.normal(0, 0.012, (n, 2))
        lag = self._lag + 0.35 * random.standard_normal(_LOCKS)[lock]
        onset = self._onset + 0.12 * self._edge * random.random(_LOCKS)[lock] + 0.35 * self._stray * random.random(n)
        shake = _smooth_noise(random, len(path), _LOCKS + 2)
        # Hairs in a row along the path cling together and leave the canvas together.
        heading = path[-1, :2] - path[len(path) // 2, :2]
        aside = offset @ (-heading[1], heading[0]) / max(1e-9, float(np.hypot(*heading)))
        strand = np.clip((aside + 1.2) / 2.4 * _STRANDS, 0, _STRANDS - 1).astype(int)
        grip = random.random(_STRANDS)[strand] * random.uniform(0.8, 1, n)
        brush = self.brush
        found: tuple[NDArray[np.float32], NDArray[np.float64]] = _trail(
            path, offset, onset, grip, lag, lock, shake,
            brush.light_radius, brush.hard_radius, brush.press_depth, brush.drag, brush.closing,
        )  # fmt: skip
        return found


@numba.njit(cache=True, nogil=True)
def _trail(  # type: ignore[no-untyped-def]
    path, offset, onset, grip, lag, lock, shake, light_radius, hard_radius, press_depth, drag, closing
):  # fmt: skip
    steps, n = path.shape[0], offset.shape[0]
    locks = shake.shape[1] - 2
    feet = np.empty((steps, n, 3), np.float32)
    travelled = np.zeros(steps)
    touching = np.zeros(n, np.bool_)
    middle_x, middle_y = path[0, 0], path[0, 1]
    ahead_x, ahead_y = 1.0, 0.0
    spread, lifted_from, dragged = 0.0, 0.0, 0.0
    for step in range(steps):
        x, y, depth = path[step]
        pressed = max(depth, 0.0)
        opened = light_radius + (hard_radius - light_radius) * pressed
        if step:
            moved = math.hypot(x - path[step - 1, 0], y - path[step - 1, 1])
            rise = press_depth * (path[step - 1, 2] - depth)
        else:
            moved, rise = 0.0, 0.0
        spread = max(opened, spread - closing * moved)
        # The brush is being lifted if it moves more up than along.
        lifted_from = max(lifted_from, path[step - 1, 2]) if rise > moved else 0.0
        dragged += moved if depth > 0.0 else 0.0
        rope = drag * (lifted_from ** (_LYING - 1.0) * pressed if lifted_from > 0.0 else pressed**_LYING)
        # A wet tuft comes down in one piece; its locks part only while it is dragged.
        parted = 0.3 + 0.7 * min(1.0, dragged / drag)
        trail_x, trail_y = x - middle_x, y - middle_y
        trail = math.hypot(trail_x, trail_y)
        if trail > 1e-6:
            ahead_x, ahead_y = trail_x / trail, trail_y / trail
        pulled = max(0.0, trail - rope)
        trail -= pulled
        middle_x, middle_y = x - ahead_x * trail, y - ahead_y * trail
        travelled[step] = max(pulled, math.hypot(moved, rise))
        fanned = 1.0 - _FANNED * min(1.0, trail / max(rope, 0.05 * drag))
        radius = spread * (1.0 + 0.03 * shake[step, locks])
        swerve = spread * 0.03 * shake[step, locks + 1]
        for i in range(n):
            jolt = shake[step, lock[i]]
            along = offset[i, 0] * ahead_x + offset[i, 1] * ahead_y
            across = offset[i, 1] * ahead_x - offset[i, 0] * ahead_y
            # A longer lock stays longer at its first place, then trails further behind.
            own = rope * max(0.0, 1.0 + lag[i] + 0.06 * jolt)
            along = radius * along * fanned + min(dragged, rope) - min(dragged, own)
            across = radius * across * (1.0 + 0.02 * jolt) + swerve
            feet[step, i, 0] = middle_x + along * ahead_x - across * ahead_y
            feet[step, i, 1] = middle_y + along * ahead_y + across * ahead_x
            # A bristle that touches the canvas leaves it a little later than it came. During a lift, it springs
            # forward with its lock and leaves at its own moment.
            press = depth - onset[i] * parted * (1.0 + 0.35 * jolt) + (0.03 if touching[i] and depth > 0.0 else 0.0)
            if depth < grip[i] * lifted_from:
                press = min(press, 0.0)
            touching[i] = press > 0.0
            feet[step, i, 2] = press
    return feet, travelled


def _in_disc(random: np.random.Generator, count: int) -> NDArray[np.float64]:
    angle = random.uniform(0, 2 * math.pi, count)
    radius = np.sqrt(random.random(count))
    return np.stack((radius * np.cos(angle), radius * np.sin(angle)), -1)


def _smooth_noise(random: np.random.Generator, steps: int, count: int) -> NDArray[np.float64]:
    """Returns noise of about unit variance [steps, count] with a correlation length of about 12 steps."""
    knots = random.standard_normal((steps // 12 + 3, count))
    place = np.arange(steps)[:, None] / 12 + random.random(count)
    knot = place.astype(int)
    blend = (place - knot) ** 2 * (3 - 2 * (place - knot))
    column = np.arange(count)
    return knots[knot, column] * (1 - blend) + knots[knot + 1, column] * blend
