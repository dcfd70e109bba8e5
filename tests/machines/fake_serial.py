"""Machines that a test plays at the other end of a pseudo-terminal."""

import contextlib
import os
import select
import threading
import time
import tty
from types import TracebackType
from typing import Self


class FakeMachine:
    """Something at the end of a serial line: `name` is the port to open. Subclasses say what they do with bytes."""

    def __init__(self) -> None:
        self._ours, self._theirs = os.openpty()
        tty.setraw(self._theirs)
        self.name = os.ttyname(self._theirs)
        self.received: list[str] = []
        self._running = True
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> None:
        self._running = False
        self._thread.join(2)
        self.unplug()

    def unplug(self) -> None:
        """Pulls the cable."""
        for end in (self._ours, self._theirs):
            with contextlib.suppress(OSError):
                os.close(end)
        self._ours = self._theirs = -1

    def settle(self) -> None:
        """Returns when nothing has arrived for a while."""
        known = -1
        while known != len(self.received):
            known = len(self.received)
            time.sleep(0.05)

    def say(self, line: str) -> None:
        if self._ours >= 0:
            os.write(self._ours, line.encode() + b"\r\n")

    def hear(self, content: bytes) -> None:
        """What arrived; called in the machine's own thread."""
        raise NotImplementedError

    def pass_time(self) -> None:
        """Called a few hundred times a second in the machine's own thread."""

    def _run(self) -> None:
        while self._running and self._ours >= 0:
            try:
                ready, _, _ = select.select([self._ours], [], [], 0.002)
                if ready:
                    self.hear(os.read(self._ours, 4096))
                self.pass_time()
            except (OSError, ValueError):
                return
