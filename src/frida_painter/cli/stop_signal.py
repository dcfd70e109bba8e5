"""Signals such as Ctrl-C: the first asks the painter to stop after this stroke, the second stops the robot at once."""

import contextlib
import os
import signal
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from types import FrameType

_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class StopSignal:
    """Whether somebody has asked to stop, and what stops the robot at once.

    asked: finish the stroke, lift, look, and write what there is; signal: the number of the first that
    came. The easel's process hears of signals by itself and sooner; `at_once` is for an easel without one.
    """

    def __init__(self) -> None:
        self.terminal = tuple(filter(os.isatty, (0, 1, 2)))
        self.asked = False
        self.signal: int | None = None
        self.at_once: Callable[[], None] = _nothing
        self._interrupts = 0

    @property
    def exit_status(self) -> int:
        """What a process ends with that was asked to stop, by custom."""
        return 128 + (self.signal or signal.SIGINT)

    def hear(self, number: int, frame: FrameType | None) -> None:
        """A handler: SIGHUP and the first SIGINT ask, SIGTERM and the second SIGINT stop, a third ends the program."""
        self.asked, self.signal = True, self.signal or number
        if number == signal.SIGHUP:
            leave_terminal(self.terminal)
        elif number == signal.SIGTERM:
            self.at_once()
        else:
            self._interrupts += 1
            if self._interrupts == 1:
                _say("\nStopping after this stroke. Once more stops the robot at once.")
            elif self._interrupts == 2:
                self.at_once()
                _say("\nThe robot was stopped at once; writing down what there is.")
            else:
                raise KeyboardInterrupt


@contextmanager
def stop_on_signals() -> Iterator[StopSignal]:
    """While it lasts, signals ask the painter to stop."""
    stop = StopSignal()
    heard = [number for number in _SIGNALS if signal.getsignal(number) is not signal.SIG_IGN]  # as by nohup
    before = {number: signal.signal(number, stop.hear) for number in heard}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _nothing() -> None:
    """There is no robot to stop yet."""


def _say(line: str) -> None:
    with contextlib.suppress(OSError, RuntimeError):  # the terminal is gone, or was just being written to
        print(line, file=sys.stderr)


def leave_terminal(files: Iterable[int]) -> None:
    """Whatever is still said to these files goes nowhere, instead of failing: what they led to was closed.

    They are those that were a terminal: one that was closed says itself that it is none.
    """
    nowhere = os.open(os.devnull, os.O_RDWR)
    for file in files:
        os.dup2(nowhere, file)
    os.close(nowhere)
