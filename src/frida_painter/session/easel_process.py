"""An easel in a process of its own, as the painting process sees it: an easel like any other."""

import contextlib
import math
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import Any, Self

from pydantic import TypeAdapter

from frida_painter.calibration import Calibration
from frida_painter.errors import FridaError, RobotDisconnected
from frida_painter.frames import CanvasSize
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.link.remote import Link, RemoteCamera, RemoteOperator, RemoteReach, RemoteRobot, heard
from frida_painter.hardware.link.watch import Pulse
from frida_painter.hardware.link.wire import Wire
from frida_painter.hardware.timing import Timing
from frida_painter.hardware.workspace import Workspace
from frida_painter.session.easel_launch import EaselLaunch
from frida_painter.session.easel_order import EaselOrder
from frida_painter.session.easels import is_simulated

# A diary of many thousand strokes is lived through before the easel is there.
_OPENING = 600.0
_ENDING = 30.0


class EaselProcess:
    """Starts the process, which loads meanwhile; `open` gives the easel; used in a `with` block.

    When the block ends the robot is let go of and the process ends; where it is left by an exception
    likewise, and one that does not end is killed. launch: one that was started before, which is taken over.
    """

    def __init__(self, launch: EaselLaunch | None = None) -> None:
        launched = (launch or EaselLaunch()).take_over()
        self._process, self._complaints = launched.process, launched.complaints
        self._wire, self._pulse = Wire(launched.wire), Pulse(launched.line)
        self._link = Link(self._wire, self._pulse)
        self._opened = False

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if not self._opened:
            self._process.terminate()  # it has nothing yet
        try:
            self._link.end(ask=self._opened)
        except FridaError:
            if error is None:
                raise
        finally:
            self._end()

    def open(self, order: EaselOrder) -> Easel:
        """The easel of that order, its robot and camera not connected yet.

        Raises RobotStopped where somebody has to re-arm it first, RobotBusy where another process has
        it, ConfigError and StorageError where it cannot be opened, RobotDisconnected where its process died.
        """
        try:
            self._wire.send({"order": order.record()})
            # A simulated easel takes as long as the computer does; where its process dies, that is heard at once.
            about, _ = self._wire.receive(None if is_simulated(order) else _OPENING)
        except RobotDisconnected as gone:
            raise RobotDisconnected(f"The easel's process did not start{self._complaint()}.") from gone
        if "error" in about:
            raise heard(about)
        self._opened = True
        self._link.patience = about["answer"]
        if is_simulated(order):  # it is waited for, however slow the computer is
            self._link.most_silence = math.inf
        return _easel(about, self._link)

    @property
    def stopped(self) -> bool:
        """Whether the robot was stopped, by whom or whatever: nothing that is planned from then on is painted."""
        return self._pulse.stopped

    @contextmanager
    def hearing_signals(self) -> Iterator[None]:
        """Signals reach the easel's process as well, from the system's own handler, whatever Python is busy with.

        Only for signals that have a handler, and in the main thread.
        """
        before = signal.set_wakeup_fd(self._pulse.file, warn_on_full_buffer=False)
        try:
            yield
        finally:
            signal.set_wakeup_fd(before)

    def _end(self) -> None:
        try:
            self._process.wait(_ENDING)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._complaints.close()

    def _complaint(self) -> str:
        """The last line that it complained with before it died."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(5)
        self._complaints.seek(0)
        lines = self._complaints.read().decode(errors="replace").split("\n")
        return next((f" ({line})" for line in reversed(lines) if line.strip()), "")


def _easel(about: dict[str, Any], link: Link) -> Easel:
    workspace = TypeAdapter(Workspace).validate_python(about["workspace"])
    return Easel(
        robot=RemoteRobot(link, workspace, patience=about["patience"], grace=about["grace"]),
        camera=RemoteCamera(link),
        operator=RemoteOperator(link),
        workspace=workspace,
        calibration=TypeAdapter(Calibration).validate_python(about["calibration"]),
        canvas=TypeAdapter(CanvasSize).validate_python(about["canvas"]),
        reach=RemoteReach(link) if about["knows_reach"] else None,
        timing=TypeAdapter(Timing | None).validate_python(about["timing"]),
        simulated=about["simulated"],
        pace=about["pace"],
    )
