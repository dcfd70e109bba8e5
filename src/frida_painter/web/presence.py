"""The press at the machine: what makes a robot move that could hurt somebody is confirmed by who stands beside it."""

import os
import select
import threading
import time
from dataclasses import dataclass, field

from frida_painter.errors import RobotStopped
from frida_painter.web.studio_easel import StudioEasel

GOOD_FOR = 60.0
"""Seconds after a press in which one thing may be begun from the page."""
_BETWEEN_GLANCES = 0.5


@dataclass
class Presence:
    """Whether somebody has just pressed Enter in the studio's terminal. Each press is good for one thing.

    possible: whether there is a terminal at all in which it could be pressed.
    """

    possible: bool = False
    _pressed: float | None = field(default=None, init=False)

    def press(self) -> None:
        """Somebody stands at the machine now."""
        self._pressed = time.monotonic()

    def use(self) -> bool:
        """Whether somebody pressed within the last minute; the press is used up then."""
        pressed, self._pressed = self._pressed, None
        return pressed is not None and time.monotonic() - pressed <= GOOD_FOR

    def allow(self, easel: StudioEasel) -> None:
        """Lets a machine that could hurt somebody be moved; a simulated one, or a hand, needs nobody's leave.

        Raises RobotStopped, saying what to do, where nobody has pressed for it. (A stop of a real robot holds
        until `frida-painter arm`.)
        """
        if easel.drives_machine and not self.use():
            raise RobotStopped(how_to_press(self))

    def listen(self, file: int) -> None:
        """Takes every line that is typed into the terminal (an open file's number) for a press, on a thread."""
        self.possible = True
        threading.Thread(target=self._listen, args=(file,), daemon=True, name="presence").start()

    def _listen(self, file: int) -> None:
        while True:
            if not select.select([file], [], [], _BETWEEN_GLANCES)[0]:
                continue
            if os.isatty(file) and os.tcgetpgrp(file) != os.getpgrp():
                time.sleep(_BETWEEN_GLANCES)  # in the background what is typed is meant for the shell
                continue
            try:
                typed = os.read(file, 1024)
            except OSError:
                typed = b""
            if not typed:  # the terminal was closed
                self.possible = False
                return
            self.press()
            print(f"Pressed. For {GOOD_FOR:.0f} s one thing may be begun from the page.", flush=True)


def how_to_press(presence: Presence) -> str:
    """What to do where a press is needed, in a sentence."""
    if presence.possible:
        return (
            "Is nobody in the robot's way, and is its brush free? Then press Enter in the terminal of the studio, "
            f"beside the robot, and ask again within {GOOD_FOR:.0f} s."
        )
    return "Somebody has to be beside the robot: start `frida-painter studio` in a terminal there, and open its page."
