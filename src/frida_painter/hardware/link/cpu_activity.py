"""Whether a process computes, stands still, or waits for a processor: by what the system counts of its threads."""

import os
from dataclasses import dataclass
from pathlib import Path

from frida_painter.hardware.deadline import steady

_LOOK_EVERY = 0.5  # seconds
_BUSY = 0.02  # of that time on a processor; a process that was stopped, or hangs, takes none
_COUNT_EVERY = 0.1
_READY = "R"


class CpuActivity:
    """Of the process of that number; where the system does not tell (Linux does), it neither computes nor waits."""

    def __init__(self, pid: int) -> None:
        self._place = Path(f"/proc/{pid}")
        self._at, self._used = steady(), self._taken()
        self._busy = False
        self._counted_at, self._starved = steady(), 0.0
        self._threads: dict[str, _Thread] = {}

    def thinking(self) -> bool:
        """Whether it was busy in the last second; to be asked often."""
        now = steady()
        if now - self._at >= _LOOK_EVERY:
            used = self._taken()
            self._busy = used - self._used >= _BUSY * (now - self._at)
            self._at, self._used = now, used
        return self._busy

    def starved(self) -> float:
        """Seconds so far in which a thread of it was ready to run and no processor was free.

        Only the difference of two answers means anything, and only where it was asked often in between.
        """
        now = steady()
        if now - self._counted_at >= _COUNT_EVERY:
            waited = self._waited(now)
            self._starved += min(waited, now - self._counted_at)
            self._counted_at = now
        return self._starved

    def _waited(self, now: float) -> float:
        """Seconds that the thread which waited longest has waited since this was asked before."""
        threads: dict[str, _Thread] = {}
        longest = 0.0
        try:
            tasks = list((self._place / "task").iterdir())
        except OSError:
            tasks = []
        for task in tasks:
            try:
                state, _ = _state_and_ticks(task / "stat")
                ran, delayed, *_ = map(int, (task / "schedstat").read_text().split())
            except (OSError, ValueError, IndexError):
                continue  # it has ended meanwhile, or the system does not count
            before = self._threads.get(task.name)
            threads[task.name] = after = _Thread.after(before, now, state, ran, delayed / 1e9)
            if before is not None:
                longest = max(longest, after.waited - before.waited)
        self._threads = threads
        return longest

    def _taken(self) -> float:
        """Seconds of all processors that it has taken so far."""
        try:
            return _state_and_ticks(self._place / "stat")[1] / os.sysconf("SC_CLK_TCK")
        except (OSError, ValueError, IndexError):
            return 0.0


@dataclass(frozen=True)
class _Thread:
    """What was counted of a thread; changed: when the counts last moved; waited: seconds, the wait under way included.

    The system counts a wait when it ends, so that one that lasts is seen by a thread that is ready and does not run.
    """

    ran: int
    delayed: float
    changed: float
    waited: float

    @classmethod
    def after(cls, before: "_Thread | None", now: float, state: str, ran: int, delayed: float) -> "_Thread":
        if before is None:
            return cls(ran, delayed, now, delayed)
        moved = state != _READY or (ran, delayed) != (before.ran, before.delayed)
        changed = now if moved else before.changed
        return cls(ran, delayed, changed, max(before.waited, delayed + now - changed))


def _state_and_ticks(stat: Path) -> tuple[str, int]:
    """The state letter of a process or thread, and the ticks of processors that it has taken."""
    fields = stat.read_text().rpartition(")")[2].split()  # its name may hold anything
    return fields[0], int(fields[11]) + int(fields[12])
