"""Time and cables for simulated controllers, over pseudo-terminals.

Two ways to let a controller live:

- `SimulatedTime` (fixture `simulated_time`): the driver's own waiting moves the clock, and each wait first runs the
  controllers. Nothing sleeps and nothing depends on a busy computer. Hours of painting take seconds.
- `Living`: a thread that runs a controller `pace` times faster than real, for drivers in other processes.
"""

import contextlib
import fcntl
import os
import select
import struct
import termios
import threading
import time
import tty
from collections.abc import Callable
from typing import Any, Protocol, Self

import pytest

_STEP = 0.01  # seconds of simulated time between two looks of a controller
_READ = 0.008  # seconds of simulated time after which a waiting reader notices what has come
_REAL = 2.0  # real seconds within which the kernel hands bytes through a pseudo-terminal


class Controller(Protocol):
    """A machine's controller, as its cable sees it."""

    resets_when_opened: bool
    cable: "Cable"

    def hear(self, content: bytes) -> None:
        """Bytes that arrived."""

    def pass_time(self, seconds: float) -> None:
        """So much time has passed."""

    def restart(self) -> None:
        """Power came, or the reset line was pulled."""


class Cable:
    """USB cable with a serial adapter whose DTR line resets the board, if the controller has one of that kind.

    name: of the port to open. The kernel raises DTR when a program opens the port, and drops it at the last close
    unless the program cleared HUPCL. A board with an auto-reset circuit restarts when DTR rises.
    """

    def __init__(self, controller: Controller) -> None:
        self.controller = controller
        controller.cable = self
        self._ours = -1
        self.sent = self.heard = self.said = self.read = 0
        self.silent = False
        self._dtr = self._keeps_dtr = self._open = False
        self._late = b""
        self.plug()

    def plug(self) -> None:
        """Puts the plug in: the port has the name that it had before, as by udev."""
        self._ours, theirs = os.openpty()
        tty.setraw(theirs)
        self.name = os.ttyname(theirs)
        os.close(theirs)
        os.set_blocking(self._ours, False)
        self.sent = self.heard = self.said = self.read = 0
        self._dtr = self._open = False

    def unplug(self) -> None:
        """Pulls the plug."""
        if self._ours >= 0:
            os.close(self._ours)
        self._ours = -1

    def say(self, content: bytes) -> None:
        """Sends bytes of the controller, unless nobody has the port open or the controller is held silent."""
        if self.silent:
            self._late += content
        elif self._ours >= 0 and self._open:
            with contextlib.suppress(OSError):
                self.said += os.write(self._ours, content)

    def speak_again(self) -> None:
        """Ends a silence: all that was held back comes at once."""
        self.silent = False
        late, self._late = self._late, b""
        self.say(late)

    def step(self, seconds: float, *, settle: bool) -> None:
        """Lets the controller hear, and live for some time. settle: waits until all bytes sent have come through."""
        self._look()
        until = time.monotonic() + _REAL
        while self._ours >= 0 and self._open:
            try:
                content = os.read(self._ours, 4096)
            except OSError:
                content = b""
            if content:
                self.heard += len(content)
                self.controller.hear(content)
            if not settle or self.heard >= self.sent or time.monotonic() > until:
                break
        self.controller.pass_time(seconds)

    def _look(self) -> None:
        """Notices that a program has opened or closed the port."""
        if self._ours < 0:
            return
        poll = select.poll()
        poll.register(self._ours, select.POLLIN)
        closed = any(what & select.POLLHUP for _, what in poll.poll(0))
        if closed:
            if self._open:
                self._open = False
                with contextlib.suppress(OSError):  # what was written before the close still comes
                    while content := os.read(self._ours, 4096):
                        self.controller.hear(content)
                self._dtr = self._keeps_dtr
            return
        if not self._open:
            self._open = True
            self.sent = self.heard = self.said = self.read = 0
            rises, self._dtr = not self._dtr, True
            if rises and self.controller.resets_when_opened:
                self.controller.restart()
        self._keeps_dtr = not termios.tcgetattr(self._ours)[2] & termios.HUPCL


class SimulatedTime:
    """Clock that stands still except while a driver waits. Takes the place of the module `time` in drivers."""

    def __init__(self) -> None:
        self.now = 1000.0
        self.reading = _READ  # seconds after which a waiting reader notices what has come
        self.interrupts_reads = True  # what is due happens while a driver waits for an answer, too
        self.cables: list[Cable] = []
        self._due: list[tuple[float, Callable[[], object]]] = []

    def monotonic(self) -> float:
        return self.now

    perf_counter = time = monotonic

    def sleep(self, seconds: float, *, interrupts: bool = True) -> None:
        """Lets that much time pass for all controllers; what is due happens in between, if `interrupts`."""
        end = self.now + max(seconds, 0.0)
        while True:
            step = min(_STEP if seconds < 2 else 10 * _STEP, end - self.now)
            if step <= 1e-12:
                break
            self.now += step
            for cable in self.cables:
                cable.step(step, settle=True)
            for entry in [entry for entry in self._due if entry[0] <= self.now and interrupts]:
                self._due.remove(entry)
                entry[1]()

    def after(self, seconds: float, act: Callable[[], object]) -> None:
        """Calls `act` when so much time has passed, in the middle of whatever the driver waits for."""
        self._due.append((self.now + seconds, act))

    def when(self, reached: Callable[[], bool], act: Callable[[], object]) -> None:
        """Calls `act` as soon as `reached()`."""

        def look() -> None:
            if reached():
                act()
            else:
                self.after(0.0, look)

        self.after(0.0, look)

    def attach(self, controller: Controller) -> Cable:
        """Connects a controller by a cable that lives by this clock."""
        cable = Cable(controller)
        self.cables.append(cable)
        return cable

    def end(self) -> None:
        for cable in self.cables:
            cable.unplug()

    def port(self) -> type[Any]:
        """Returns a class in place of serial.Serial, whose blocking reads pass this clock's time."""
        import serial

        clock = self

        class Port(serial.Serial):  # type: ignore[misc]
            def __init__(self, port: str, *args: object, **options: object) -> None:
                super().__init__(port, *args, **options)
                self._cable = next((cable for cable in clock.cables if cable.name == os.path.realpath(port)), None)
                clock.sleep(_STEP)

            def write(self, content: bytes) -> int:
                count = super().write(content)
                if self._cable is not None:
                    self._cable.sent += count
                return count

            def read(self, size: int = 1) -> bytes:
                until = clock.now + (self.timeout or clock.reading)
                while not self._waiting() and clock.now < until:
                    clock.sleep(clock.reading, interrupts=clock.interrupts_reads)
                waiting = self._waiting()
                content = super().read(min(size, waiting)) if waiting else b""
                if self._cable is not None:
                    self._cable.read += len(content)
                return content

            def reset_input_buffer(self) -> None:
                super().reset_input_buffer()
                if getattr(self, "_cable", None) is not None:
                    self._cable.read = self._cable.said

            def close(self) -> None:
                was_open = self.is_open
                super().close()
                if was_open:
                    clock.sleep(_STEP)

            def _waiting(self) -> int:
                """Bytes that can be read, when the kernel has handed over all that the controller said."""
                until = time.monotonic() + _REAL
                while True:
                    waiting = struct.unpack("I", fcntl.ioctl(self.fd, termios.TIOCINQ, struct.pack("I", 0)))[0]
                    if self._cable is None or waiting >= min(self._cable.said - self._cable.read, 1024):
                        return int(waiting)
                    if time.monotonic() > until:
                        return int(waiting)

        return Port


@pytest.fixture
def simulated_time(monkeypatch: pytest.MonkeyPatch) -> Any:
    """A clock for the drivers that speak over serial lines: they wait in simulated time from now on."""
    clock = SimulatedTime()
    monkeypatch.setattr("serial.Serial", clock.port())
    for driver in ("gcode", "grbl", "marlin", "firmware", "driver", "serial_line", "ebb", "axidraw"):
        monkeypatch.setattr(f"frida_painter_drivers.{driver}.time", clock)
    yield clock
    clock.end()


class Living:
    """Thread in which a controller lives `pace` times faster than real. Used in a `with` block.

    step: seconds of its time between two looks at its line
    """

    def __init__(self, controller: Any, pace: float = 20.0, step: float = _STEP) -> None:
        self.controller, self.pace, self.step = controller, pace, step
        self.cable = Cable(controller)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    @property
    def name(self) -> str:
        """Name of the port."""
        return self.cable.name

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join(5)
        self.cable.unplug()

    def _run(self) -> None:
        before = time.monotonic()
        while not self._over.wait(0.002):
            now = time.monotonic()
            left, before = min((now - before) * self.pace, 1.0), now
            while left > 1e-9:
                step = min(left, self.step)
                self.cable.step(step, settle=False)
                left -= step
