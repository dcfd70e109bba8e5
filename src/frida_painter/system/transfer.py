"""Watch over transfers of bytes: one that hardly moves is ended, one that goes on is told in words."""

import time
from collections.abc import Callable

from frida_painter.system.storage import megabytes

_MIN_SPEED, _WINDOW = 2000, 60.0  # bytes a second, and the seconds over which they are counted
_FIRST, _LAST = 5.0, 60.0  # seconds between two sentences: at the beginning, and at most
_SURE = 4.0  # seconds of flow after which its speed tells how long the rest takes
TOO_SLOW = f"less than {_MIN_SPEED // 1000} kB a second came for {_WINDOW:.0f} s"
"""Reason why a transfer was ended, as part of a sentence."""


class Transfer:
    """Progress of a transfer.

    what: beginning of the sentences, for example "Fetched"
    size: bytes in total; None if nobody knows
    tell: receives a sentence after some seconds, then ever more seldom
    clock: monotonic clock in seconds
    """

    def __init__(
        self,
        what: str = "",
        size: int | None = None,
        tell: Callable[[str], None] = lambda sentence: None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._what, self._size, self._tell, self._clock = what, size, tell, clock
        self._began = self._since = clock()
        self._first: int | None = None  # bytes that were there before
        self._flow: tuple[float, int] | None = None  # time at which the first bytes came, and the bytes then
        self._counted = 0
        self._told_at = self._began

    def hear(self, done: int) -> bool:
        """Takes the number of bytes that have come, and tells it; returns False if too few came for a minute."""
        now = self._clock()
        if self._first is None:
            self._first = self._counted = done
        elif self._flow is None and done > self._first:
            self._flow = now, done
        if now - self._since >= _WINDOW:
            if done - self._counted < _MIN_SPEED * _WINDOW:
                return False
            self._since, self._counted = now, done
        if now - self._told_at >= min(_LAST, max(_FIRST, (now - self._began) / 5)):
            self._told_at = now
            self._tell(f"{self._what} {self._describe(done, now)}.")
        return True

    def _describe(self, done: int, now: float) -> str:
        """Returns the progress in words."""
        if self._size is None or done > self._size:
            return megabytes(done)
        left = ""
        if self._flow is not None and now - self._flow[0] >= _SURE and done > self._flow[1]:  # not the wait for the hub
            seconds = (self._size - done) * (now - self._flow[0]) / (done - self._flow[1])
            left = f", about {max(1, round(seconds / 60))} min left" if seconds >= _FIRST else ""
        return f"{megabytes(done)} of {megabytes(self._size)}{left}"
