"""How far a sweep is, and how long it still takes: by what the runs that ended took, and what the others are asked."""

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from frida_painter.sweeps.run import SweepRun

_LEAST_BETWEEN = 2.0  # seconds
_SHARE = 0.05  # of the time that may go into writing


@dataclass(frozen=True)
class SweepProgress:
    """How far a sweep is. seconds_left: None until a run has ended; slots: runs at the same time."""

    total: int
    done: int
    failed: int
    seconds_left: float | None
    slots: int


class Renewal:
    """Says when something that shows how far a sweep is should be written anew: seldom enough to cost little."""

    def __init__(self) -> None:
        self._next = time.monotonic() + _LEAST_BETWEEN

    @contextmanager
    def where_due(self) -> Iterator[bool]:
        """Whether it should be written now; what it takes in the block decides when it should be again."""
        started = time.monotonic()
        due = started >= self._next
        yield due
        if due:
            now = time.monotonic()
            self._next = now + max(_LEAST_BETWEEN, (now - started) / _SHARE)


class Tally:
    """Counts the runs of a sweep as they end. slots: runs at the same time."""

    def __init__(self, runs: Sequence[SweepRun], slots: int) -> None:
        self._total, self.slots = len(runs), slots
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
        at_once = max(1, min(self.slots, self._total - self._done - self._failed))
        seconds = max(0.0, self._left) * self._seconds / self._cost / at_once if self._cost else None
        return SweepProgress(self._total, self._done, self._failed, seconds, self.slots)
