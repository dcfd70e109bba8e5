"""A robot under guard: it stays stopped once it was stopped, and whatever its driver does becomes an error with a name.

The guard stands around a driver, in the process that owns the robot. It does not trust the driver:
a call that never comes back is given up, nonsense that it reports is not passed on, and after any
fault the robot is stopped and latched. What a driver keeps to by itself is in drivers/interlock.py.
"""

import contextlib
import math
import threading
import time
from collections.abc import Callable
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from frida_painter.errors import (
    CameraError,
    FridaError,
    PoseMismatch,
    RobotBusy,
    RobotDisconnected,
    RobotError,
    RobotStopped,
    StorageError,
    WorkspaceViolation,
)
from frida_painter.hardware import gateway
from frida_painter.hardware.deadline import Caller, in_our_errors, steady
from frida_painter.hardware.latch import Latch, StopRecord, Unlatched
from frida_painter.hardware.robot import Camera, Frame, LiveCamera, MotionReport, Robot, Waypoints, Workspace

T = TypeVar("T")

# How long, s, a driver may take to end its motion after a stop and to send the stop itself, and a disk to take it down.
_WIND_DOWN, _SENDING, _WRITING = 1.0, 1.0, 10.0
_TOLERANCE, _ARRIVED = 1e-6, 0.002


class GuardedRobot:
    """Implements hardware.robot.Robot over another.

    latch: keeps a stop over restarts, or, of a simulated robot, does not.
    claim: takes the robot for this process by the serial number that it states once it is connected, and raises
    RobotBusy where another one has it.
    patience, grace: a motion is given up after `patience` times the time that its way takes, and
    `grace` seconds more; connecting: seconds that the robot may take to be reached. Raises RobotStopped
    where a person has to re-arm first.
    """

    def __init__(
        self,
        robot: Robot,
        workspace: Workspace,
        latch: Latch | Unlatched,
        *,
        patience: float = 2.0,
        grace: float = 5.0,
        connecting: float = 30.0,
        claim: Callable[[str], object] = lambda identity: None,
    ) -> None:
        self._claim = claim
        self.robot, self.workspace, self.latch = robot, workspace, latch
        self._patience, self._grace, self._connecting = patience, grace, connecting
        self._caller = Caller("robot")
        self._lock = threading.RLock()  # a signal may come while it is held, and stop as well
        self._stop: StopRecord | None = latch.read()
        self._stopped_at = steady()
        self._asked = False
        self._latching: threading.Thread | None = None
        self._tip: NDArray[np.float64] | None = None
        self._moving = threading.Event()
        self._lifted = False

    @property
    def moving(self) -> bool:
        """Whether a motion is on its way."""
        return self._moving.is_set()

    @property
    def stopped(self) -> StopRecord | None:
        """Why the robot stands still and has to be re-armed; None where it has not."""
        return self._stop

    def connect(self) -> None:
        """Reaches the robot and reads where it is. Raises RobotStopped; WorkspaceViolation where it is outside."""
        self._require_armed("connect")
        self._call("connect", self.robot.connect, self._connecting)
        self._recognise()
        tip = self.pose()
        lower, upper = np.array(self.workspace.lower), np.array(self.workspace.upper)
        if not ((tip >= lower - _TOLERANCE) & (tip <= upper + _TOLERANCE)).all():
            self.close()
            raise WorkspaceViolation(
                f"The robot's tip stands at {_millimetres(tip)} mm; the workspace reaches from {_millimetres(lower)} "
                f"to {_millimetres(upper)} mm. Nothing was sent to it; guide it into the workspace by hand, then start "
                "again."
            )
        self._tip, self._lifted = tip, False

    def _recognise(self) -> None:
        """Of a robot that says which one it is: whether it was stopped, or is in use, under another name."""
        number = str(getattr(self.robot, "serial_number", "") or "")
        if not number or isinstance(self.latch, Unlatched):
            return
        identity = f"serial number {number}"
        try:
            self._claim(identity)
            self.latch.machines |= {identity}
            self._stop = self._stop or self.latch.read()
            self._require_armed("connect")
        except RobotError:
            self.close()
            raise

    def home(self) -> MotionReport:
        """Goes aside. Raises RobotError and its kinds."""
        self._lift_first()
        reach = float(np.linalg.norm(np.subtract(self.workspace.upper, self.workspace.lower)))
        return self._move("home", self.robot.home, reach / self.workspace.travel_speed)

    def pose(self) -> NDArray[np.float64]:
        """Where the tip is, [3] metres. Raises RobotError where the robot does not know."""
        tip = np.asarray(self._call("pose", self.robot.pose, self._grace))
        if not (tip.shape == (3,) and tip.dtype.kind in "fi" and np.isfinite(tip).all()):
            raise RobotError(
                "The robot does not know where its tip is, and it was not moved; home it as its maker says, then start "
                "again."
            )
        return tip.astype(np.float64)

    def follow(self, waypoints: Waypoints) -> MotionReport:
        """Moves along waypoints that lie in the workspace. Raises WorkspaceViolation before anything moves."""
        gateway.check([waypoints], self.workspace)
        self._lift_first()
        way = waypoints.length + self._away_from(waypoints.position[0])
        return self._move(waypoints.label, lambda: self.robot.follow(waypoints), way / waypoints.speed)

    def stop(self, reason: str = "it was asked for", *, asked: bool = False) -> None:
        """Stops at once, from any thread, and latches. As often as one likes: the first reason stays.

        asked: whether a person asked for it, as RobotStopped tells.
        """
        with self._lock:
            first = self._stop is None
            if first:
                self._stop, self._stopped_at = StopRecord(self.latch.easel, reason, time.time()), steady()
                self._asked = asked
        sending = threading.Thread(target=self._send_stop, daemon=True)
        sending.start()
        if first:  # the disk may be slow or gone; the robot is stopped beside it, and sooner
            self._latching = threading.Thread(target=self._latch, args=(reason,), daemon=True)
            self._latching.start()
        sending.join(_SENDING)

    def close(self) -> None:
        """Lets go of the robot, and waits until a stop is on the disk."""
        if self._latching is not None:
            self._latching.join(_WRITING)
        with contextlib.suppress(FridaError):  # whatever is wrong was said before
            self._call("close", self.robot.close, self._grace)
        self._caller.end()

    def _send_stop(self) -> None:
        with contextlib.suppress(Exception):  # of any driver: the latch holds all the same
            self.robot.stop()

    def _latch(self, reason: str) -> None:
        with contextlib.suppress(StorageError):  # it holds in this process at least
            self._stop = self.latch.engage(reason)

    def _lift_first(self) -> None:
        """Straight up, once after connecting, where the brush was left low: it may stand on the canvas or in a well."""
        here, hover = self.workspace, self.workspace.hover
        surface = here.canvas_origin[2] if here.rack is None else here.top  # the hand may be among standing brushes
        clear = min(surface + hover, self.workspace.upper[2])
        if self._lifted or self._tip is None or self._tip[2] >= surface + hover / 2:
            self._lifted = True
            return
        up = Waypoints("lift", np.array([[*self._tip[:2], clear]]), self.workspace.travel_speed)
        way = clear - float(self._tip[2])
        self._move(up.label, lambda: self.robot.follow(up), way / up.speed)
        self._lifted = True

    def _move(self, label: str, act: Callable[[], MotionReport], seconds: float) -> MotionReport:
        self._require_armed(label)
        self._moving.set()
        try:
            report = self._call(label, act, seconds * self._patience + self._grace)
            self._require_sense(label, report)
        except (WorkspaceViolation, RobotBusy):
            raise  # refused before anything moved
        except FridaError as fault:
            by_person = self._stop
            self.stop(str(fault))
            if by_person is not None:
                raise self._refusal(label) from fault
            raise
        finally:
            self._moving.clear()
        self._tip = np.asarray(report.reached, np.float64)
        self._require_there(label, self.pose())
        return report

    def _call(self, label: str, act: Callable[[], T], within: float) -> T:
        """What the driver returns, or an error of the tree whatever it raises and however long it takes."""
        began = steady()

        def until() -> float:
            return min(began + within, self._stopped_at + _WIND_DOWN if self._moving_and_stopped else began + within)

        return in_our_errors(
            lambda: self._caller.call(act, until),
            late=lambda: RobotDisconnected(
                f"{label}: the robot did not come back within {steady() - began:.1f} s; nothing more is sent to it. "
                "Look at it and at its cable before going on."
            ),
            failed=lambda why: RobotError(
                f"{label}: the robot's driver failed ({why}); look at the robot before going on."
            ),
        )

    @property
    def _moving_and_stopped(self) -> bool:
        return self._moving.is_set() and self._stop is not None

    def _require_sense(self, label: str, report: object) -> None:
        sound = isinstance(report, MotionReport)
        if isinstance(report, MotionReport):
            reached, times = np.asarray(report.reached), (report.started_at, report.finished_at)
            sound = (
                reached.shape == (3,)
                and reached.dtype.kind in "fi"
                and bool(np.isfinite(reached).all())
                and all(isinstance(time, int | float) and np.isfinite(time) for time in times)
                and times[0] <= times[1]
            )
        if not sound:
            raise RobotError(
                f"{label}: the robot reported {_shortly(report)}, which is no report of a motion; nobody knows where "
                "its tip is. Look at it before going on."
            )

    def _require_there(self, label: str, tip: NDArray[np.float64]) -> None:
        away = self._away_from(tip)
        self._tip = tip
        if not away <= _ARRIVED:
            raise PoseMismatch(
                f"{label}: the robot says it is done, but its tip is {away * 1000:.1f} mm from where it says it went; "
                f"allowed are {_ARRIVED * 1000:g} mm. Look at the robot, then repeat the robot calibration."
            )

    def _require_armed(self, label: str) -> None:
        if self._stop is not None:
            raise self._refusal(label)

    def _refusal(self, label: str) -> RobotStopped:
        assert self._stop is not None
        why = self._stop.reason.rstrip(".")
        told = f"{label}: nothing moves, {self._stop.easel} was stopped ({why}); {self.latch.remedy}"
        return RobotStopped(told, asked=self._asked)

    def _away_from(self, point: NDArray[np.float64]) -> float:
        return 0.0 if self._tip is None else float(np.linalg.norm(point - self._tip))


def _millimetres(point: NDArray[np.float64]) -> str:
    return "(" + ", ".join(f"{1000 * metres:.0f}" for metres in point) + ")"


def _shortly(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


# A camera under guard: whatever its driver does becomes a photograph or an error with a name, in bounded time.


class GuardedCamera:
    """Implements hardware.robot.Camera over another; a call is given up after `patience` seconds."""

    def __init__(self, camera: Camera, *, patience: float = 30.0) -> None:
        self.camera = camera
        self._patience = patience
        self._caller = Caller("camera")
        self._turn = threading.Lock()

    def connect(self) -> None:
        """Reaches the camera. Raises CameraError and its kinds."""
        self._call(self.camera.connect)

    def capture(self, newer_than: float) -> Frame:
        """A photograph taken after `newer_than` (s). Raises CameraError and its kinds."""
        with self._turn:
            frame = self._call(lambda: self.camera.capture(newer_than))
        if not _is_photograph(frame):
            raise CameraError(
                "What the camera handed out is no photograph (rows x columns x 3 bytes, a time and a number); "
                "look at the camera and its settings, then take another."
            )
        return frame

    def glance(self) -> NDArray[np.uint8] | None:
        """The picture that a live camera has now; None where it is none, or is being used. Raises CameraError."""
        if not isinstance(self.camera, LiveCamera) or not self._turn.acquire(blocking=False):
            return None
        try:
            return self._call(self.camera.glance)
        finally:
            self._turn.release()

    def close(self) -> None:
        """Lets go of the camera. Raises CameraError and its kinds."""
        try:
            self._call(self.camera.close)
        finally:
            self._caller.end()

    def _call(self, act: Callable[[], T]) -> T:
        until = steady() + self._patience
        return in_our_errors(
            lambda: self._caller.call(act, lambda: until),
            late=lambda: CameraError(
                f"The camera did not answer within {self._patience:g} s; look at it and at its cable, then take "
                "another photograph."
            ),
            failed=lambda why: CameraError(f"The camera's driver failed ({why}); look whether it is still connected."),
        )


def _is_photograph(frame: object) -> bool:
    return (
        isinstance(frame, Frame)
        and isinstance(frame.image, np.ndarray)
        and frame.image.dtype == np.uint8
        and frame.image.ndim == 3
        and frame.image.shape[2] == 3
        and frame.image.size > 0
        and isinstance(frame.captured_at, int | float)
        and math.isfinite(frame.captured_at)
        and isinstance(frame.sequence, int)
    )
