"""Calls with a deadline, by a clock that also counts the time for which the computer sleeps.

Drivers, makers' libraries and cameras may hang, and Python cannot end a thread. An overdue call is left in a daemon
thread, which does not keep the program alive.
"""

import queue
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, wait
from typing import Any, TypeVar

from frida_painter.errors import FridaError

T = TypeVar("T")

_LOOK_EVERY = 0.02
_LONGEST = 200


def steady() -> float:
    """Returns seconds of a clock that ignores changes of the system time and includes the computer's sleep."""
    if hasattr(time, "CLOCK_BOOTTIME"):
        return time.clock_gettime(time.CLOCK_BOOTTIME)
    return time.monotonic()


def asleep() -> float:
    """Returns the seconds that the computer has slept since its start; 0 if the system does not tell (Linux does)."""
    return steady() - time.monotonic()


class Overdue(Exception):
    """Error of an overdue call. Not a TimeoutError, because drivers raise that themselves."""


class LibraryExit(Exception):
    """Error of a library that tried to end the program, for example by SystemExit; chained to its exception."""


class Caller:
    """Runs calls one after another in its own thread, each with a deadline.

    name: of the thread, also in messages

    An overdue call goes on in the thread. No other call runs at the same time.
    """

    def __init__(self, name: str) -> None:
        self._calls: queue.SimpleQueue[tuple[Callable[[], Any], Future[Any]] | None] = queue.SimpleQueue()
        self._current: Future[Any] | None = None
        self._name = name
        self._thread: threading.Thread | None = None

    def call(self, act: Callable[[], T], until: Callable[[], float]) -> T:
        """Returns the result of `act`, or raises its exception.

        until: returns the deadline on the clock of `steady`; it is asked repeatedly during the wait

        The call first waits for an earlier overdue call.
        Raises Overdue if the deadline passes, LibraryExit if `act` tried to end the program.
        """
        if self._current is not None:
            self._wait_for(self._current, until)
        if self._thread is None:
            self._thread = threading.Thread(target=self._work, name=self._name, daemon=True)
            self._thread.start()
        call: Future[T] = Future()
        self._current = call
        self._calls.put((act, call))
        self._wait_for(call, until)
        error = call.exception()
        if error is not None and not isinstance(error, Exception):
            raise LibraryExit(one_line(error)) from error
        return call.result()

    def end(self) -> None:
        """Ends the thread when its current call has returned. A later call starts another thread."""
        self._calls.put(None)
        self._thread = None

    def _wait_for(self, call: "Future[Any]", until: Callable[[], float]) -> None:
        while not wait((call,), _LOOK_EVERY).done:
            if not steady() <= until():
                raise Overdue(f"{self._name} did not return in time")

    def _work(self) -> None:
        while (job := self._calls.get()) is not None:
            act, call = job
            try:
                call.set_result(act())
            except BaseException as error:  # any exception of a driver or a library; the caller sorts it
                call.set_exception(error)


def within(seconds: float, what: str, call: Callable[[], T]) -> T:
    """Returns the result of `call`, or raises its exception; the call runs in its own thread.

    what: name of the thread, also in messages

    Raises Overdue if it takes more than `seconds`, LibraryExit if `call` tried to end the program.
    """
    caller, until = Caller(what), steady() + seconds
    try:
        return caller.call(call, lambda: until)
    finally:
        caller.end()


def in_our_errors(call: Callable[[], T], *, late: Callable[[], FridaError], failed: Callable[[str], FridaError]) -> T:
    """Returns the result of `call` and converts its exceptions to FridaErrors.

    late: makes the error for an overdue call
    failed: makes the error for any other exception, from its description as part of a sentence

    Raises FridaErrors of `call` unchanged.
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
    """Returns the description of an exception as part of a sentence."""
    text = " ".join(str(failure).split())[:_LONGEST]
    if isinstance(failure, LibraryExit):
        return text
    return f"{type(failure).__name__}: {text}" if text else type(failure).__name__
