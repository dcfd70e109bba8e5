"""How far a sweep is, and how long it still takes: by what the runs that ended took, and what the others are asked."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from frida_painter.sweeps.run import SweepRun


@dataclass(frozen=True)
class SweepProgress:
    """How far a sweep is. seconds_left: None until a run has ended; slots: runs at the same time."""

    total: int
    done: int
    failed: int
    seconds_left: float | None
    slots: int


class Tally:
    """Counts the runs of a sweep as they end. slots: runs at the same time."""

    def __init__(self, runs: Sequence[SweepRun], slots: int) -> None:
        self._total, self._slots = len(runs), slots
        self._left = sum(run.cost for run in runs)
        self._seconds = self._cost = 0.0
        self._done = self._failed = 0

    def done(self, run: SweepRun, record: Mapping[str, Any]) -> None:
        """A run is done."""
        self._done += 1
        self._left -= run.cost
        self._cost += run.cost
        self._seconds += record["times"]["wall_seconds"]

    def failed(self, run: SweepRun) -> None:
        """A run has failed for good."""
        self._failed += 1
        self._left -= run.cost

    @property
    def progress(self) -> SweepProgress:
        """How far it is."""
        at_once = max(1, min(self._slots, self._total - self._done - self._failed))
        seconds = max(0.0, self._left) * self._seconds / self._cost / at_once if self._cost else None
        return SweepProgress(self._total, self._done, self._failed, seconds, self._slots)
