"""The watch beside a robot: stop asked for on a line of its own, a stop file, and a painting process that falls silent.

Nothing here waits for a motion, a message or the painting process. Whatever touches the disk, and so
may wait for it, has a thread of its own.
"""

import contextlib
import select
import signal
import socket
import threading
from collections.abc import Callable
from pathlib import Path

from frida_painter.hardware.deadline import asleep, steady

# What comes over the line, one byte each: a heartbeat, a stop, or the number of a signal, which the
# system's own handler writes there (signal.set_wakeup_fd) whatever the painting process is doing.
BEAT, STOP = b"\x00", b"\xff"
BEAT_EVERY = 0.25
# A robot is stopped within 3 s of silence; half a second of it is for the stop itself. While nothing moves a painting
# process may compute for longer without a breath, but not so long that everybody has forgotten it.
MOST_SILENCE, MOST_ABSENCE = 2.5, 30.0
_LOOK_EVERY = 0.02
_NAP = 1.0


class Watch:
    """Stops the robot by `stop(reason)`, from a thread of its own, until `dismiss`.

    line: bytes as above come over it. Silence of more than `most_silence` seconds stops the robot; where it
    is not `moving()` and the painting process is seen `thinking()`, silence of more than `most_absence`. So
    does a computer that slept. A line that was closed (the painting process ended) is silent, and nothing can
    move any more but what moves already.
    """

    def __init__(
        self,
        line: socket.socket,
        stop: Callable[[str], None],
        moving: Callable[[], bool],
        thinking: Callable[[], bool],
        *,
        most_silence: float = MOST_SILENCE,
        most_absence: float = MOST_ABSENCE,
    ) -> None:
        self._line, self._stop, self._moving, self._thinking = line, stop, moving, thinking
        self._most_silence, self._most_absence = most_silence, most_absence
        self._heard = self._still = steady()
        self._asleep = asleep()
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
                select.select([self._line], [], [], _LOOK_EVERY)
            else:
                self._dismissed.wait(_LOOK_EVERY)
            now = steady()
            # Before anything is read: what was sent before the computer slept says nothing of now.
            slept, self._asleep = asleep() - self._asleep, asleep()
            if slept > _NAP:
                self._stop(f"the computer slept for {slept:.0f} s")
            if self._open:
                self._read(now)
            if not self._moving():
                self._still = now
            # Whoever asked for a motion was there when it began.
            silent, absent = now - max(self._heard, self._still), now - self._heard
            patience = self._most_absence if self._thinking() else self._most_silence
            if silent > self._most_silence or (self._open and self._still == now and absent > patience):
                self._stop(f"the painting process fell silent for {absent:.1f} s")
                self._heard = now

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
                self._heard = now
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
        while not self._dismissed.wait(_LOOK_EVERY):
            if self._path.exists():
                self._stop(f"the stop file {self._path.name} appeared")
                # Where it cannot be taken away it stops the next painting in this folder as well.
                with contextlib.suppress(OSError):
                    self._path.unlink()
                return


class Pulse:
    """The painting process's end of the line: sends a heartbeat from a thread of its own, and stop when asked.

    file: the line's file number, for signal.set_wakeup_fd.
    """

    def __init__(self, line: socket.socket) -> None:
        self._line = line
        self._line.setblocking(False)
        self._ended = threading.Event()
        threading.Thread(target=self._beat, name="heartbeat", daemon=True).start()

    @property
    def file(self) -> int:
        """The line's file number."""
        return self._line.fileno()

    def stop(self) -> None:
        """Has the robot stopped at once."""
        self._send(STOP)

    def end(self) -> None:
        """Closes the line."""
        self._ended.set()
        self._line.close()

    def _beat(self) -> None:
        self._send(BEAT)
        while not self._ended.wait(BEAT_EVERY):
            self._send(BEAT)

    def _send(self, byte: bytes) -> None:
        with contextlib.suppress(OSError):  # nobody listens any more, or the line is full of heartbeats
            self._line.send(byte)
