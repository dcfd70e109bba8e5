"""Motion of a simulated controller: a queue of straight moves with look-ahead, walked in small steps of time.

It is written from the documents of the firmwares (junction deviation: S. Jeon, "Improving Grbl: Cornering
Algorithm"; classic jerk: Marlin's documentation of M205), not from the drivers, and works another way than they
reckon: it integrates speed and position.
"""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

_TICK = 0.002


@dataclass
class Move:
    """One straight move: where it leads, how fast, and what happens as it begins (a servo's pulse)."""

    start: np.ndarray
    end: np.ndarray
    fastest: float  # mm/s along the way
    gain: float  # mm/s2 along the way
    entry_limit: float
    begins: Callable[[], None] = lambda: None
    entry: float = 0.0
    walked: float = 0.0
    begun: bool = False
    length: float = field(init=False)
    unit: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        way = self.end - self.start
        self.length = float(np.linalg.norm(way))
        self.unit = way / self.length


class MotionQueue:
    """Planner of a machine with limits per axis, in mm.

    rates: mm/s; accelerations: mm/s2; deviation: mm; jerk: mm/s, instead of a deviation; room: moves that it takes
    moved: every tip position on the way
    """

    def __init__(
        self,
        rates: np.ndarray,
        accelerations: np.ndarray,
        *,
        deviation: float = 0.01,
        jerk: np.ndarray | None = None,
        along: float = math.inf,
        room: int = 15,
    ) -> None:
        self.along = along  # mm/s2 along the way, whatever its direction
        self.rates, self.accelerations, self.deviation, self.jerk, self.room = (
            rates,
            accelerations,
            deviation,
            jerk,
            room,
        )
        self.tick = _TICK  # a coarser one costs less, and ends at the same places
        self.moves: deque[Move] = deque()
        self.place = np.zeros(3)
        self.moved: list[np.ndarray] = []
        self.speed = 0.0
        self.holding = False

    @property
    def full(self) -> bool:
        return len(self.moves) >= self.room

    @property
    def moving(self) -> bool:
        return self.speed > 0 or (bool(self.moves) and not self.holding)

    @property
    def target(self) -> np.ndarray:
        return self.moves[-1].end if self.moves else self.place

    def add(self, end: np.ndarray, feed: float, begins: Callable[[], None] = lambda: None) -> None:
        """Takes a move to `end` at `feed` mm/s at most; one of no length only begins."""
        start = self.target
        if np.linalg.norm(end - start) < 1e-6:
            if not self.moves:
                begins()
            return
        move = Move(start.copy(), end.copy(), 0.0, 0.0, 0.0, begins)
        share = np.maximum(np.abs(move.unit), 1e-9)
        move.fastest = min(feed, float((self.rates / share).min()))
        move.gain = min(float((self.accelerations / share).min()), self.along)
        if self.moves:
            before = self.moves[-1]
            move.entry_limit = min(before.fastest, move.fastest, self._corner(before.unit, move.unit))
        self.moves.append(move)
        self._plan()

    def _corner(self, before: np.ndarray, after: np.ndarray) -> float:
        if self.jerk is not None:
            jump = np.abs(after - before)
            return float((self.jerk / np.maximum(jump, 1e-9)).min())
        cosine = float(np.clip(-(before @ after), -1, 1))  # of the angle between the two legs
        if cosine > 0.999999:
            return 0.0
        if cosine < -0.999999:
            return math.inf
        middle = after - before
        middle = middle / np.linalg.norm(middle)
        gain = min(float((self.accelerations / np.maximum(np.abs(middle), 1e-9)).min()), self.along)
        half = math.sqrt((1 - cosine) / 2)
        return math.sqrt(gain * self.deviation * half / (1 - half))

    def _plan(self) -> None:
        leave = 0.0
        for move in reversed(self.moves):
            move.entry = min(move.entry_limit, math.sqrt(leave**2 + 2 * move.gain * move.length))
            leave = move.entry

    def advance(self, seconds: float) -> None:
        """Walks for so long."""
        while seconds > 1e-12:
            tick = min(self.tick, seconds)
            seconds -= tick
            if not self.moves:
                self.speed = 0.0
                return
            self._walk(tick)

    def _walk(self, tick: float) -> None:
        move = self.moves[0]
        if not move.begun:
            if self.holding and self.speed == 0:
                return
            move.begun = True
            move.begins()
        left = move.length - move.walked
        leave = self.moves[1].entry if len(self.moves) > 1 else 0.0
        wanted = 0.0 if self.holding else min(move.fastest, math.sqrt(leave**2 + 2 * move.gain * max(left, 0.0)))
        change = move.gain * tick
        speed = min(max(wanted, self.speed - change), self.speed + change)
        step = (self.speed + speed) / 2 * tick
        if not self.holding and speed < 0.05 and left < 0.002:
            step = left  # the last step
        self.speed = speed
        if step >= left - 1e-9:
            over = step - left
            self.place = move.end.copy()
            self.moves.popleft()
            if self.moves and over > 0:
                self.moves[0].walked = min(over, self.moves[0].length / 2)
            elif not self.moves:
                self.speed = 0.0
        else:
            move.walked += step
            self.place = move.start + move.walked * move.unit
        if step > 0:
            self.moved.append(self.place.copy())

    def moved_at(self, slip: np.ndarray) -> list[np.ndarray]:
        """Returns every tip position on the way, as a person measures it."""
        return [place + slip for place in self.moved]

    def hold(self) -> None:
        """Slows down and stands; what is left stays in the queue."""
        self.holding = True

    def go_on(self) -> None:
        self.holding = False

    def drop(self) -> bool:
        """Forgets everything at once; returns True if it moved: steps are lost then."""
        moved = self.speed > 0
        self.moves.clear()
        self.speed, self.holding = 0.0, False
        return moved
