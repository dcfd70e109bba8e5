"""An easel in a process of its own, as the painting process sees it: an easel like any other."""

import contextlib
import math
import signal
import subprocess
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter

from frida_painter import errors
from frida_painter.calibration import Calibration
from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.launch import EaselLaunch
from frida_painter.easel.open import is_simulated
from frida_painter.easel.order import EaselOrder
from frida_painter.easel.watchdog import Pulse
from frida_painter.easel.wire import Arrays, Wire
from frida_painter.errors import FridaError, MotionFailed, RobotBusy, RobotDisconnected, RobotError, RobotStopped
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.robot import Frame, MotionReport, Timing, Waypoints, Workspace
from frida_painter.palette import Palette

# The painting process's end of the link: a robot, a camera and an operator that are really in another process.

# The guard in the easel's process gives up a driver sooner; this is for a process that hangs as a whole.
_MARGIN = 10.0
_CALL = 60.0
# One that sends no heartbeat for so long hangs, or was frozen.
_MOST_SILENCE = 10.0
_LOOK_EVERY = 0.25
_END = "end"  # while it closes everything there are no heartbeats any more


class Link:
    """Asks the easel's process, one request at a time; after one that was not answered it is broken for good.

    patience: seconds for an answer, where a request does not say; most_silence: seconds without a heartbeat from there,
    while an answer is waited for. Raises RobotDisconnected, having sent a stop, where
    there is no answer; otherwise what the easel raised.
    """

    def __init__(self, wire: Wire, pulse: Pulse) -> None:
        self._wire, self._pulse = wire, pulse
        self.patience, self.most_silence = _CALL, _MOST_SILENCE
        self._turn = threading.Lock()
        self._broken: RobotDisconnected | None = None

    def ask(
        self, do: str, arrays: Arrays | None = None, *, within: float | None = None, **words: object
    ) -> tuple[Mapping[str, Any], Mapping[str, NDArray[Any]]]:
        """What the easel's process answers to a request, within so many seconds, by default the link's patience."""
        with self._turn:
            if self._broken is not None:
                raise RobotDisconnected(str(self._broken))
            try:
                self._wire.send({"do": do, **words}, arrays)
                answer, result = self._answer(self.patience if within is None else within, listen=do != _END)
            except RobotDisconnected as error:
                self._pulse.stop()
                self._broken = RobotDisconnected(
                    f"The easel's process does not answer ({error}) The robot was told to stop; look at it before "
                    "going on."
                )
                raise self._broken from error
        if "error" in answer:
            raise heard(answer)
        return answer, result

    def _answer(self, within: float, *, listen: bool) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        now = began = time.monotonic()
        while now < began + within and not self._wire.waits(min(_LOOK_EVERY, began + within - now)):
            now = time.monotonic()
            silent = min(self._pulse.silent, now - began)
            if listen and silent > self.most_silence:
                raise RobotDisconnected(f"Nothing has been heard from it for {silent:.0f} s.")
        return self._wire.receive(max(began + within - time.monotonic(), 0.0))

    def stop(self) -> None:
        """Stops the robot at once, whatever is being asked."""
        self._pulse.stop()

    def end(self, *, ask: bool = True) -> None:
        """Lets go of the easel's process; ask: has it say first that all is closed. Raises what went wrong there."""
        try:
            if ask and self._broken is None:
                self.ask(_END)
        finally:
            self._wire.close()
            self._pulse.end()


class RemoteRobot:
    """Implements hardware.robot.Robot over a link; patience, grace: see easel.guard.GuardedRobot."""

    def __init__(self, link: Link, workspace: Workspace, *, patience: float, grace: float) -> None:
        self._link, self._patience, self._grace = link, patience, grace
        self._reach = float(np.linalg.norm(np.subtract(workspace.upper, workspace.lower)))
        self._travel_speed = workspace.travel_speed

    def connect(self) -> None:
        """Reaches the robot. Raises RobotError and its kinds."""
        self._link.ask("robot.connect")

    def home(self) -> MotionReport:
        """Goes aside. Raises RobotError and its kinds."""
        return self._report("robot.home", self._reach / self._travel_speed)

    def pose(self) -> NDArray[np.float64]:
        """Where the tip is, [3] metres. Raises RobotError and its kinds."""
        return self._link.ask("robot.pose")[1]["pose"]

    def follow(self, waypoints: Waypoints) -> MotionReport:
        """Moves along the waypoints. Raises RobotError and its kinds."""
        position = np.asarray(waypoints.position, np.float64)
        seconds = (waypoints.length + self._reach) / waypoints.speed if waypoints.speed > 0 else 0.0
        return self._report(
            "robot.follow", seconds, {"position": position}, label=waypoints.label, speed=float(waypoints.speed)
        )

    def stop(self) -> None:
        """Stops at once, over a line of its own."""
        self._link.stop()

    def close(self) -> None:
        """Lets go of the robot. Raises RobotError and its kinds."""
        self._link.ask("robot.close")

    def _report(self, do: str, seconds: float, arrays: Arrays | None = None, **words: object) -> MotionReport:
        within = seconds * self._patience + self._grace + _MARGIN
        answer, result = self._link.ask(do, arrays, within=within, **words)
        return MotionReport(answer["label"], answer["started_at"], answer["finished_at"], result["reached"])


class RemoteReach:
    """Implements hardware.robot.Reach over a link."""

    def __init__(self, link: Link) -> None:
        self._link = link

    def reachable(self, position: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether the tip can be at each place [k, 3] metres: [k]."""
        _, result = self._link.ask("robot.reaches", {"position": np.asarray(position, np.float64)})
        return result["reachable"].astype(np.bool_)


class RemoteCamera:
    """Implements hardware.robot.Camera over a link."""

    def __init__(self, link: Link) -> None:
        self._link = link

    def connect(self) -> None:
        """Reaches the camera. Raises CameraError and its kinds."""
        self._link.ask("camera.connect")

    def capture(self, newer_than: float) -> Frame:
        """A photograph taken after `newer_than` (s). Raises CameraError and its kinds."""
        answer, result = self._link.ask("camera.capture", newer_than=float(newer_than))
        return Frame(result["image"], answer["captured_at"], answer["sequence"])

    def close(self) -> None:
        """Lets go of the camera. Raises CameraError and its kinds."""
        self._link.ask("camera.close")


class RemoteOperator:
    """Implements hardware.easel.Operator over a link."""

    def __init__(self, link: Link) -> None:
        self._link = link

    def fill_wells(self, palette: Palette) -> None:
        """Has well i filled with paint i."""
        self._link.ask("operator.fill_wells", {"color": palette.color.detach().cpu().numpy()})

    def tone(self, ground: tuple[float, float, float]) -> None:
        """Has the canvas toned in that colour (sRGB)."""
        self._link.ask("operator.tone", ground=list(ground))

    def change_brush(self, brush: str) -> None:
        """Has the brush of that name put into the holder."""
        self._link.ask("operator.change_brush", brush=brush)

    def let_dry(self, seconds: float) -> None:
        """Has the paint dry for so long."""
        self._link.ask("operator.let_dry", seconds=seconds)

    def lay_paper(self) -> bool:
        """Whether a fresh canvas lies there now."""
        return bool(self._link.ask("operator.lay_paper")[0]["done"])

    def lay_checker(self) -> bool:
        """Whether the colour checker lies there now."""
        return bool(self._link.ask("operator.lay_checker")[0]["done"])

    def take_checker_away(self) -> bool:
        """Whether the colour checker is gone again."""
        return bool(self._link.ask("operator.take_checker_away")[0]["done"])


def heard(answer: Mapping[str, Any]) -> FridaError:
    """The error that the other end told of; a plain RobotError where it is of an unknown kind."""
    kind, message, details = getattr(errors, str(answer["error"]), None), str(answer["message"]), answer["details"]
    if kind is RobotBusy:
        return RobotBusy(message, details.get("pid"))
    if kind is MotionFailed:
        return MotionFailed(message, details.get("code"), details.get("waypoint"))
    if kind is RobotStopped:
        return RobotStopped(message, asked=details.get("asked") is True)
    if isinstance(kind, type) and issubclass(kind, FridaError):
        return kind(message)
    return RobotError(message)


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
