"""The watch beside a robot: stop asked for on a line of its own, a stop file, and a painting process that falls silent.

Nothing here waits for a motion, a message or the painting process. Whatever touches the disk, and so
may wait for it, has a thread of its own.
"""

import contextlib
import math
import select
import signal
import socket
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

from frida_painter.hardware.deadline import asleep, steady
from frida_painter.hardware.link.silence import LOOK_EVERY, MACHINE, LinkState, Patience, SilenceRule

# What comes over the line, one byte each: a heartbeat, a stop, or the number of a signal, which the
# system's own handler writes there (signal.set_wakeup_fd) whatever the painting process is doing.
BEAT, STOP = b"\x00", b"\xff"
BEAT_EVERY = 0.25


class Process(Protocol):
    """What is seen of the painting process from outside."""

    def thinking(self) -> bool:
        """Whether it took processor time of late."""
        ...

    def starved(self) -> float:
        """Seconds so far in which it was ready to run and no processor was free."""
        ...


class Watch:
    """Stops the robot by `stop(reason)`, from a thread of its own, until `dismiss`.

    line: bytes as above come over it. A silence that is longer than `patience` allows stops the robot, as
    silence.py tells, and so does a computer that slept. Once the line was closed (the painting process
    ended), nothing can move any more but what moves already. stopped: whether the robot stands still for whatever
    reason, which the heartbeats tell the painting process.
    """

    def __init__(
        self,
        line: socket.socket,
        stop: Callable[[str], None],
        moving: Callable[[], bool],
        process: Process,
        patience: Patience = MACHINE,
        *,
        stopped: Callable[[], bool] = lambda: False,
    ) -> None:
        self._stopped = stopped
        self._line, self._stop, self._moving, self._process = line, stop, moving, process
        self._nap = patience.nap
        self._rule = SilenceRule(steady(), patience)
        self._asleep, self._beaten = asleep(), -math.inf
        self._interrupts = 0
        self._open = True
        self._dismissed = threading.Event()
        self._line.setblocking(False)
        self._thread = threading.Thread(target=self._keep, name="watch", daemon=True)
        self._thread.start()

    def dismiss(self) -> None:
        """Ends the watch."""
        self._dismissed.set()
        self._thread.join()

    def _keep(self) -> None:
        while not self._dismissed.is_set():
            if self._open:
                select.select([self._line], [], [], LOOK_EVERY)
            else:
                self._dismissed.wait(LOOK_EVERY)
            now = steady()
            # Before anything is read: what was sent before the computer slept says nothing of now.
            slept, self._asleep = asleep() - self._asleep, asleep()
            if slept > self._nap:
                self._stop(f"the computer slept for {slept:.0f} s")
            if self._open:
                self._beat(now)
                self._read(now)
            if reason := self._rule.judge(self._look(now)):
                self._stop(reason)

    def _beat(self, now: float) -> None:
        if now - self._beaten >= BEAT_EVERY:
            self._beaten = now
            with contextlib.suppress(OSError):  # the painting process is gone, or has not read for long
                self._line.send(STOP if self._stopped() else BEAT)

    def _look(self, now: float) -> LinkState:
        thinking = self._process.thinking()
        # What it waited for is asked of each of its threads, and of no use while it is heard.
        starved = self._process.starved() if self._rule.silence(now) > 2 * BEAT_EVERY else None
        return LinkState(now, self._moving(), not self._open, thinking, starved)

    def _read(self, now: float) -> None:
        try:
            content = self._line.recv(4096)
        except BlockingIOError:
            return
        except OSError:
            content = b""
        if not content:
            self._open = False
        for byte in content:
            if byte == BEAT[0]:
                self._rule.hear(now)
            elif byte == STOP[0]:
                self._stop("the painting process asked for it")
            elif byte == signal.SIGTERM:
                self._stop("the painting process was told to end (SIGTERM)")
            elif byte == signal.SIGINT:
                self._interrupts += 1
                if self._interrupts == 2:
                    self._stop("Ctrl-C was pressed twice")


class StopFile:
    """Stops the robot when a file appears, and takes the file away; until `dismiss`."""

    def __init__(self, path: Path, stop: Callable[[str], None]) -> None:
        self._path, self._stop = path, stop
        self._dismissed = threading.Event()
        threading.Thread(target=self._keep, name="stop file", daemon=True).start()

    def dismiss(self) -> None:
        """Ends the watch."""
        self._dismissed.set()

    def _keep(self) -> None:
        while not self._dismissed.wait(LOOK_EVERY):
            if self._path.exists():
                self._stop(f"the stop file {self._path.name} appeared")
                # Where it cannot be taken away it stops the next painting in this folder as well.
                with contextlib.suppress(OSError):
                    self._path.unlink()
                return


class Pulse:
    """The painting process's end of the line: sends and hears heartbeats on a thread of its own; stops when asked.

    file: the line's file number, for signal.set_wakeup_fd.
    """

    def __init__(self, line: socket.socket) -> None:
        self._line = line
        self._line.setblocking(False)
        self._silent, self._stopped = 0.0, False
        self._ended = threading.Event()
        threading.Thread(target=self._beat, name="heartbeat", daemon=True).start()

    @property
    def file(self) -> int:
        """The line's file number."""
        return self._line.fileno()

    @property
    def silent(self) -> float:
        """Seconds since the watch was heard; of a time in which this process did not run, next to nothing counts."""
        return self._silent

    @property
    def stopped(self) -> bool:
        """Whether the watch has told that the robot was stopped, for whatever reason, and stays so."""
        return self._stopped

    def stop(self) -> None:
        """Has the robot stopped at once."""
        self._send(STOP)

    def end(self) -> None:
        """Closes the line."""
        self._ended.set()
        self._line.close()

    def _beat(self) -> None:
        self._send(BEAT)
        looked = steady()
        while not self._ended.wait(BEAT_EVERY):
            self._send(BEAT)
            now = steady()
            self._silent = 0.0 if self._heard() else self._silent + min(now - looked, 2 * BEAT_EVERY)
            looked = now

    def _heard(self) -> bool:
        """Whether anything came since this was asked before."""
        try:
            content = self._line.recv(4096)
        except OSError:
            return False
        self._stopped = self._stopped or STOP in content
        return bool(content)

    def _send(self, byte: bytes) -> None:
        with contextlib.suppress(OSError):  # nobody listens any more, or the line is full of heartbeats
            self._line.send(byte)
