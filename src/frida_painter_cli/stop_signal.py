"""Stop by signals such as Ctrl-C: the first ends painting after the stroke, the second stops the robot at once."""

import contextlib
import os
import signal
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from types import FrameType

from frida_painter.system.operating_system import HANGUP, SIGNALS

OF_PAINTING = (
    "Stopping after this stroke. Once more stops the robot at once.",
    "The robot was stopped at once; writing down what there is.",
)
"""Lines for the first and the second Ctrl-C during a painting."""


class StopSignal:
    """State of a stop by signals.

    asked: True after the first signal: finish the stroke, lift, look, and save the work.
    signal: number of the first signal.
    at_once: stops the robot of an easel without a process. An easel's process receives signals itself, and sooner.
    """

    def __init__(self, lines: tuple[str, str] = OF_PAINTING) -> None:
        self._lines = lines
        self.terminal = tuple(filter(os.isatty, (0, 1, 2)))
        self.asked = False
        self.signal: int | None = None
        self.at_once: Callable[[], None] = lambda: None  # before there is a robot to stop
        self._interrupts = 0

    @property
    def exit_status(self) -> int:
        """Exit status of a process after a stop, by convention."""
        return 128 + (self.signal or signal.SIGINT)

    def stop_now(self) -> None:
        """Stops the robot at once, and all work."""
        self.asked = True
        self.at_once()

    def hear(self, number: int, frame: FrameType | None) -> None:
        """Handles a signal.

        SIGHUP and the first SIGINT ask to stop; SIGTERM, SIGBREAK and the second SIGINT stop the robot at once. A third
        SIGINT raises KeyboardInterrupt, which ends the program.
        """
        self.asked, self.signal = True, self.signal or number
        if number == HANGUP:
            leave_terminal(self.terminal)
        elif number != signal.SIGINT:
            self.at_once()
        else:
            self._interrupts += 1
            if self._interrupts == 1:
                _say(f"\n{self._lines[0]}")
            elif self._interrupts == 2:
                self.at_once()
                _say(f"\n{self._lines[1]}")
            else:
                raise KeyboardInterrupt


@contextmanager
def stop_on_signals(lines: tuple[str, str] = OF_PAINTING) -> Iterator[StopSignal]:
    """Handles signals as requests to stop, within the `with` block.

    lines: told at the first and the second Ctrl-C
    """
    stop = StopSignal(lines)
    heard = [number for number in SIGNALS if signal.getsignal(number) is not signal.SIG_IGN]  # as by nohup
    before = {number: signal.signal(number, stop.hear) for number in heard}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _say(line: str) -> None:
    with contextlib.suppress(OSError, RuntimeError):  # the terminal is closed or busy
        print(line, file=sys.stderr)


def leave_terminal(files: Iterable[int]) -> None:
    """Redirects these files to the null device, because their terminal or reader is closed.

    files: descriptors that were a terminal before; a closed terminal no longer reports itself as one.
    """
    nowhere = os.open(os.devnull, os.O_RDWR)
    for file in files:
        os.dup2(nowhere, file)
    os.close(nowhere)
