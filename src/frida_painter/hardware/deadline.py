"""Calls with a deadline: whatever does not return in time is given up, by a clock that counts sleep as well.

Drivers, makers' libraries and cameras may hang, and Python cannot end a thread. A call that is given
up is left behind in a thread that does not keep the program alive.
"""

import queue
import threading
import time
from collections.abc import Callable
from typing import Any, TypeVar

from frida_painter.errors import FridaError

T = TypeVar("T")

_LOOK_EVERY = 0.02
_LONGEST = 200


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


class LibraryExit(Exception):
    """A library wanted to end the program, as by SystemExit; its cause is what the library raised."""


class Caller:
    """Makes calls one after another on a thread of its own, and waits for each only as long as it is told to.

    A call that is given up goes on; no other is made beside it. name: of the thread and in messages.
    """

    def __init__(self, name: str) -> None:
        self._calls: queue.SimpleQueue[_Call | None] = queue.SimpleQueue()
        self._current: _Call | None = None
        self._name = name
        self._thread: threading.Thread | None = None

    def call(self, act: Callable[[], T], until: Callable[[], float]) -> T:
        """What `act` returns or raises; until: the moment of `steady` to give up at, asked again while waiting.

        Raises Overdue where that moment passes first, LibraryExit where `act` wanted to end the program.
        An earlier call that was given up is waited for, too.
        """
        if self._current is not None:
            self._wait_for(self._current, until)
        if self._thread is None:
            self._thread = threading.Thread(target=self._work, name=self._name, daemon=True)
            self._thread.start()
        self._current = call = _Call(act)
        self._calls.put(call)
        self._wait_for(call, until)
        if isinstance(call.error, Exception):
            raise call.error
        if call.error is not None:
            raise LibraryExit(one_line(call.error)) from call.error
        return call.result

    def end(self) -> None:
        """Ends the thread, once the call that it makes has come back; a later call begins another."""
        self._calls.put(None)
        self._thread = None

    def _wait_for(self, call: "_Call", until: Callable[[], float]) -> None:
        while not call.finished.wait(_LOOK_EVERY):
            if not steady() <= until():
                raise Overdue(f"{self._name} did not return in time")

    def _work(self) -> None:
        while (call := self._calls.get()) is not None:
            call.make()


class _Call:
    """One call, and what came of it."""

    def __init__(self, act: Callable[[], Any]) -> None:
        self.finished = threading.Event()
        self.result: Any = None
        self.error: BaseException | None = None
        self._act = act

    def make(self) -> None:
        try:
            self.result = self._act()
        except BaseException as error:  # whatever a driver or a library raises; the caller sorts it
            self.error = error
        finally:
            self.finished.set()


def within(seconds: float, what: str, call: Callable[[], T]) -> T:
    """What `call` returns or raises, on a thread of its own, named after `what`.

    Raises Overdue where it does not return within `seconds`, LibraryExit as Caller does.
    """
    caller, until = Caller(what), steady() + seconds
    try:
        return caller.call(call, lambda: until)
    finally:
        caller.end()


def in_our_errors(call: Callable[[], T], *, late: Callable[[], FridaError], failed: Callable[[str], FridaError]) -> T:
    """What `call` returns; whatever it raises becomes an error of errors.py.

    late: what to raise where the call is overdue; failed: what to raise for everything else, given what
    was raised as part of a sentence. Errors of errors.py pass as they are.
    """
    try:
        return call()
    except FridaError:
        raise
    except Overdue as silence:
        raise late() from silence
    except Exception as failure:
        raise failed(one_line(failure)) from failure


def one_line(failure: BaseException) -> str:
    """What a library raised, as part of a sentence."""
    text = " ".join(str(failure).split())[:_LONGEST]
    if isinstance(failure, LibraryExit):
        return text
    return f"{type(failure).__name__}: {text}" if text else type(failure).__name__
