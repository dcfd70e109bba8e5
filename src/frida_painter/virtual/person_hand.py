"""Hand of a person in the studio: own brushes, the robot's paints, and the same canvas.

The person sees the real canvas, so their strokes have no placement error and no noise of an arm. Each brush is a tuft
like the robot's. It is washed and dipped before each stroke, and takes up wet paint from the canvas during the stroke.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from frida_painter.errors import ConfigError
from frida_painter.hardware.easel import PersonBrush, PersonStroke
from frida_painter.virtual.bristles import BristleBrush, Tuft
from frida_painter.virtual.robot import Clock
from frida_painter.virtual.simulation_log import Entry, Note, ignore_entry
from frida_painter.virtual.tabletop import Table

_MM = 1000.0
_ABOVE = -0.3  # depth at which the brush is in the air before and after a stroke
_CELLS_PER_STEP, _FINER_LIFT = 0.9, 3.0  # as the robot's tip is moved
_BELLY = 0.5  # share of the hard radius by which the belly of a brush lies beside its tip if it lies flat


class PersonHand:
    """Hand of a person at a table.

    brushes: the brushes in the jar, by name.
    seed: seed of the studio; every tuft and every stroke has random numbers of its own.
    laid: number of the last stroke on the canvas; strokes up to this number are not laid again.
    note: called after each stroke.
    """

    def __init__(self, table: Table, clock: Clock, brushes: Mapping[str, BristleBrush], seed: int) -> None:
        self.note: Note = ignore_entry
        self.laid = 0
        self._table, self._clock, self._brushes, self._seed = table, clock, brushes, seed
        self._tufts: dict[str, Tuft] = {}

    @property
    def brushes(self) -> tuple[PersonBrush, ...]:
        """Brushes in the jar, with the widths of their marks in metres."""
        return tuple(
            PersonBrush(name, 2 * brush.light_radius / _MM, 2 * brush.hard_radius / _MM)
            for name, brush in self._brushes.items()
        )

    @property
    def volume(self) -> float:
        """Paint in all brushes of the person, in microlitres."""
        return sum(tuft.volume for tuft in self._tufts.values())

    def paint(self, stroke: PersonStroke) -> None:
        """Lays a stroke on the canvas, unless it is there already; time passes as the hand moves.

        Raises ConfigError if there is no such brush, or no paint in that well; then nothing is painted.
        """
        if stroke.number <= self.laid:
            return
        if stroke.brush not in self._brushes:
            raise ConfigError(f"There is no brush {stroke.brush[:40]!r} here; take {', '.join(self._brushes)}.")
        wells = len(self._table.paints)
        if not 0 <= stroke.paint < wells:
            raise ConfigError(f"Well {stroke.paint + 1} has no paint; {wells} wells are filled.")
        self._clock.now += max(stroke.seconds, 0.0)
        tuft = self._load(stroke)
        self._table.canvas.touch(tuft, self._fine(_path(stroke, tuft.brush)), self._clock.now)
        tuft.settle()
        self.laid = stroke.number
        self.note(
            {"did": "person", "stroke": stroke.record(), "now": self._clock.now, "brush": tuft.volume}, flush=True
        )

    def relive(self, entry: Entry) -> bool:
        """Lays the stroke of a log entry again; returns False if another amount of paint is left than at its time."""
        stroke = PersonStroke.of(entry["stroke"])
        self.paint(stroke)
        self._clock.now = entry["now"]
        return bool(self._tufts[stroke.brush].volume == entry["brush"])

    def _load(self, stroke: PersonStroke) -> Tuft:
        """Returns the brush, washed and dipped."""
        number = list(self._brushes).index(stroke.brush)
        if stroke.brush not in self._tufts:
            self._tufts[stroke.brush] = Tuft(self._brushes[stroke.brush], self._random(number, 0))
        tuft, paint, table = self._tufts[stroke.brush], self._table.paints[stroke.paint], self._table
        tuft.draw_luck_from(self._random(number, stroke.number))
        table.in_water += tuft.keep(0.0)
        table.drawn += tuft.fill(paint)
        return tuft

    def _random(self, brush: int, stroke: int) -> np.random.Generator:
        return np.random.default_rng(np.random.SeedSequence(self._seed, spawn_key=(1000 + brush, stroke)))

    def _fine(self, path: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns a path [k, 3] in steps as fine as those of the robot's tip."""
        deep = np.array([1, 1, _FINER_LIFT * max(brush.press_depth for brush in self._brushes.values())])
        legs = np.linalg.norm(np.diff(path * deep, axis=0), axis=1)
        count = np.maximum(1, np.ceil(legs / (_CELLS_PER_STEP * self._table.canvas.cell)).astype(int))
        place = np.concatenate([k + np.arange(n) / n for k, n in enumerate(count)] + [[len(path) - 1.0]])
        return np.stack([np.interp(place, np.arange(len(path)), column) for column in path.T], -1)


def _path(stroke: PersonStroke, brush: BristleBrush) -> NDArray[np.float64]:
    """Returns the way of the tip [k, 3]: mm on the canvas, and depth; it begins and ends in the air.

    The bristles of the studio stand upright. A brush that is tilted by an angle lies down: its belly touches the
    canvas beside the tip, on the side of the handle, and more of it than of an upright brush with the same pressure.
    """
    lies = 1 - np.cos(stroke.tilt)  # 0 upright, 1 flat
    depth = stroke.press + 0.5 * lies * (1 - stroke.press)
    beside = _BELLY * brush.hard_radius * np.sin(stroke.tilt)
    lean = np.stack((np.cos(stroke.toward), np.sin(stroke.toward)), -1)
    place = stroke.place * _MM + beside[:, None] * lean
    path = np.c_[place, depth]
    above = np.array([0.0, 0.0, _ABOVE])
    down, up = path[0] * (1, 1, 0) + above, path[-1] * (1, 1, 0) + above
    return np.concatenate([down[None], path, up[None]])
