"""Calls of drivers that may never come back, and the clock by which they are given up."""

import queue
import threading
import time
from collections.abc import Callable
from typing import Any, TypeVar

T = TypeVar("T")

_LOOK_EVERY = 0.02


def steady() -> float:
    """Seconds that no setting of the clock changes and that also pass while the computer sleeps."""
    if hasattr(time, "CLOCK_BOOTTIME"):
        return time.clock_gettime(time.CLOCK_BOOTTIME)
    return time.monotonic()


def asleep() -> float:
    """Seconds that the computer has slept since it was started, as far as the system tells (Linux does)."""
    return steady() - time.monotonic()


class Overdue(Exception):
    """A call was given up; not a TimeoutError, which drivers raise themselves."""


class Caller:
    """Makes calls one after another on a thread of its own, and waits for each only as long as it is told to.

    A call that is given up goes on, as no thread can be killed; no other is made beside it.
    """

    def __init__(self, name: str) -> None:
        self._calls: queue.SimpleQueue[_Call | None] = queue.SimpleQueue()
        self._current: _Call | None = None
        self._name = name
        self._thread: threading.Thread | None = None

    def call(self, act: Callable[[], T], until: Callable[[], float]) -> T:
        """What `act` returns or raises; until: the moment of `steady` to give up at, asked again while waiting.

        Raises Overdue where that moment passes first; an earlier call that was given up is waited for, too.
        """
        if self._current is not None:
            self._wait_for(self._current, until)
        if self._thread is None:
            self._thread = threading.Thread(target=self._work, name=self._name, daemon=True)
            self._thread.start()
        self._current = call = _Call(act)
        self._calls.put(call)
        self._wait_for(call, until)
        if call.error is not None:
            raise call.error
        return call.result

    def end(self) -> None:
        """Ends the thread, once the call that it makes has come back; a later call begins another."""
        self._calls.put(None)
        self._thread = None

    @staticmethod
    def _wait_for(call: "_Call", until: Callable[[], float]) -> None:
        while not call.finished.wait(_LOOK_EVERY):
            if not steady() <= until():
                raise Overdue

    def _work(self) -> None:
        while (call := self._calls.get()) is not None:
            call.make()


class _Call:
    """One call, and what came of it."""

    def __init__(self, act: Callable[[], Any]) -> None:
        self.finished = threading.Event()
        self.result: Any = None
        self.error: Exception | None = None
        self._act = act

    def make(self) -> None:
        try:
            self.result = self._act()
        except Exception as error:  # whatever a driver raises; the caller sorts it
            self.error = error
        finally:
            self.finished.set()
