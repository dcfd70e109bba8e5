"""The guard around a robot: a stop lasts until a person re-arms, and every failure of a driver becomes a typed error.

The guard wraps a driver, in the process that owns the robot. It does not trust the driver: it abandons a call that
does not return, refuses invalid reports, and stops and latches the robot after any fault. The driver's own checks
are in hardware/interlock.py.
"""

import contextlib
import math
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from frida_painter.easel.connection import answering
from frida_painter.errors import (
    CameraError,
    FridaError,
    RobotBusy,
    RobotDisconnected,
    RobotError,
    RobotStopped,
    WorkspaceViolation,
    ZeroUnknown,
)
from frida_painter.hardware.deadline import Caller, in_our_errors, one_line, steady
from frida_painter.hardware.gateway import Door, MotionLimits, Surface, require_arrived
from frida_painter.hardware.latch import Latch, StopRecord, Unlatched
from frida_painter.hardware.robot import (
    Camera,
    Frame,
    LineStoppedRobot,
    LiveCamera,
    MotionReport,
    Robot,
    StopLine,
    TimedRobot,
    TouchProbe,
    Waypoints,
    Workspace,
    Zero,
    ZeroedRobot,
)
from frida_painter.hardware.timing import AxisTiming, motion_seconds

T = TypeVar("T")

# Seconds that a driver may take to end its motion after a stop and to send the stop, and a disk to store it.
_WIND_DOWN, _SENDING, _WRITING = 1.0, 1.0, 10.0
_JOGGING = 60.0  # seconds
_HELD = 3600.0  # the longest time for which a person may hold a machine whose controller tells so, seconds

STANDS = 1e-4
"""Distance from the workspace, metres, at which a resting tip still counts as inside: motors make whole steps."""
MAX_JOG = 0.05
"""Longest step of a jog, metres."""


@answering("robot", lambda guard, request, given: guard._ask(request.method, *given.values()))
class GuardedRobot:
    """Robot under guard: wraps another robot. Implements all that a robot can be asked for (easel/connection.py); the
    driver answers the questions that are not written here, which move nothing, within `grace`.

    limits: of the robot itself; its door checks every motion by them, and by those that the painter states
    latch: keeps a stop over restarts (Latch); for a simulated robot it does not (Unlatched)
    claim: reserves the robot for this process by the serial number that it states once connected; raises RobotBusy
        if another process has it
    promise: receives the seconds within which a motion that begins now has ended
    patience, grace: time limit of a motion: `patience` times the duration of its way, plus `grace` seconds
    connecting: seconds that the connection may take
    stopped: stop that holds until the robot is re-armed; None if there is none

    Every motion raises RobotStopped if a person must re-arm the robot first, and ZeroUnknown while the machine does not
    know where it is. A motion is not overdue while the controller shows that it goes on.
    """

    def __init__(
        self,
        robot: Robot,
        limits: MotionLimits,
        latch: Latch | Unlatched,
        *,
        patience: float = 2.0,
        grace: float = 5.0,
        connecting: float = 30.0,
        claim: Callable[[str], object] = lambda identity: None,
        promise: Callable[[float], object] = lambda seconds: None,
    ) -> None:
        self._claim, self._promise = claim, promise
        self.robot, self.workspace, self.latch = robot, limits.workspace, latch
        self._door, self._box = Door(limits), MotionLimits(limits.workspace)
        self._patience, self._grace, self._connecting = patience, grace, connecting
        self._caller = Caller("robot")
        self._lock = threading.RLock()  # reentrant: a signal handler may stop the robot while the lock is held
        self.stopped: StopRecord | None = latch.read()
        self._stopped_at = steady()
        self._asked = False
        self._latching: threading.Thread | None = None
        self._tip: NDArray[np.float64] | None = None
        self._moving = threading.Event()
        self._lifted = False
        self._zero = Zero()
        self._timing: AxisTiming | None = None

    @property
    def moving(self) -> bool:
        """True while a motion is in progress."""
        return self._moving.is_set()

    def connect(self) -> None:
        """Connects to the robot and reads its position.

        Raises RobotStopped if it is stopped, RobotBusy if another process has it, WorkspaceViolation if the tip is
        outside the workspace and cannot be jogged, RobotError and its subclasses.
        """
        self._require_armed("connect")
        self._tip = None
        self._call("connect", self.robot.connect, self._connecting)
        self._recognise()
        self._timing = self._ask("timing")
        self._zero = self.zero()
        if self._zero.known:
            self._enter_workspace()

    def _recognise(self) -> None:
        """Checks by the robot's serial number if it was stopped, or is in use, under another name."""
        number = str(getattr(self.robot, "serial_number", "") or "")
        if not number or isinstance(self.latch, Unlatched):
            return
        identity = f"serial number {number}"
        try:
            self._claim(identity)
            self.latch.machines |= {identity}
            self.stopped = self.stopped or self.latch.read()
            self._require_armed("connect")
        except RobotError:
            self.close()
            raise

    def _enter_workspace(self) -> None:
        """Reads the position. A robot outside the workspace that cannot be jogged back is closed.

        Raises WorkspaceViolation then.
        """
        self._tip, self._lifted = self.pose(), False
        if not isinstance(self.robot, ZeroedRobot):
            try:
                self._require_inside("guide it into the workspace by hand, then start again")
            except WorkspaceViolation:
                self.close()
                raise
        self._door.learn_travel(self._ask("travel_limits"))

    def _require_inside(self, remedy: str) -> None:
        """Raises WorkspaceViolation if the tip is outside the workspace."""
        lower, upper = np.array(self.workspace.lower), np.array(self.workspace.upper)
        if (tip := self._tip) is None or ((tip >= lower - STANDS) & (tip <= upper + STANDS)).all():
            return
        raise WorkspaceViolation(
            f"The robot's tip stands at {_millimetres(tip)} mm; the workspace reaches from {_millimetres(lower)} to "
            f"{_millimetres(upper)} mm. Nothing was sent to it; {remedy}."
        )

    def zero(self) -> Zero:
        """Returns what the machine knows of its zero; a robot that is no ZeroedRobot knows it. Raises RobotError."""
        if not isinstance(self.robot, ZeroedRobot):
            return Zero()
        told = self._call("zero", self.robot.zero, self._grace)
        if not (isinstance(told, Zero) and isinstance(told.lost, str)):
            raise RobotError(
                f"The robot answered {_shortly(told)} when asked if it knows where it is; look at it before going on."
            )
        return told

    def find_zero(self) -> None:
        """Drives to the limit switches. Raises RobotError and its subclasses, RobotStopped if it is stopped."""
        robot = self._zeroed("homing")
        self._act("homing", robot.find_zero, self._zero.seconds + self._grace)
        self._take_zero()

    def jog(self, step: NDArray[np.float64]) -> None:
        """Moves the tip by `step` [3] metres.

        Raises WorkspaceViolation if a step is longer than `MAX_JOG`, or, if the zero is known, leaves the workspace or,
        outside of it, goes farther away.
        Raises RobotError and its subclasses.
        """
        robot = self._zeroed("jog")
        if step.shape != (3,) or not float(np.linalg.norm(step)) <= MAX_JOG:
            raise WorkspaceViolation(
                f"A jog by {_millimetres(np.ravel(step))} mm was wanted; one step is at most {MAX_JOG * 1000:g} mm. "
                "Nothing was sent."
            )
        if self._zero.known and self._tip is not None:
            ends = np.stack([self.workspace.lower, self.workspace.upper, self._tip])
            lower, upper = ends.min(0).tolist(), ends.max(0).tolist()
            box = MotionLimits(replace(self.workspace, lower=tuple(lower), upper=tuple(upper)))
            box.check([Waypoints("jog", (self._tip + step)[None], self.workspace.travel_speed)])
        self._act("jog", lambda: robot.jog(step), _JOGGING)
        self._tip = self.pose() if self._zero.known else None

    def set_zero(self, tip: NDArray[np.float64]) -> None:
        """Declares that the tip stands at `tip` [3] (m).

        Raises WorkspaceViolation if that is outside the workspace, RobotError and its subclasses.
        """
        robot = self._zeroed("set zero")
        self._box.check([Waypoints("set zero", np.atleast_2d(tip), self.workspace.travel_speed)])
        self._require_armed("set zero")
        self._call("set zero", lambda: robot.set_zero(tip), self._grace)
        self._take_zero()

    def _zeroed(self, label: str) -> ZeroedRobot:
        if not isinstance(self.robot, ZeroedRobot):
            raise RobotError(
                f"{label}: this robot always knows where it is, and its zero cannot be set from here; make the "
                "workspace true, or repeat the robot calibration."
            )
        return self.robot

    def _take_zero(self) -> None:
        """Reads again if the zero is known, and where the tip is then."""
        self._zero, self._tip = self.zero(), None
        self._require_zero("zero")
        self._enter_workspace()

    def alive_at(self) -> float:
        """Returns the time when the controller last showed that it moves or waits; -inf if it does not show it."""
        told = self.robot.alive_at() if isinstance(self.robot, TimedRobot) else -math.inf
        return told if isinstance(told, int | float) else -math.inf

    def stop_line(self) -> StopLine | None:
        """Returns the line over which another process can stop the robot; None if it has none or is closed."""
        return self.robot.stop_line() if isinstance(self.robot, LineStoppedRobot) else None

    def pose(self) -> NDArray[np.float64]:
        """Returns the position of the tip, [3] metres. Raises RobotError if the robot does not know it."""
        tip = self._call("pose", self.robot.pose, self._grace)
        if not _is_place(tip):
            raise RobotError(
                "The robot does not know where its tip is, and it was not moved; home it as its maker says, then start "
                "again."
            )
        return np.asarray(tip, np.float64)

    def home(self) -> MotionReport:
        """Moves to the home position. Raises RobotError and its subclasses."""
        self._require_zero("home")
        self._lift_first()
        here = self.workspace
        longest = np.stack((here.lower, (*here.lower[:2], here.upper[2]), here.upper))  # up, then across
        return self._move("home", self.robot.home, longest, here.travel_speed)

    def allow(self, motions: tuple[Waypoints, ...], workspace: Workspace, surface: Surface) -> None:
        """Checks a batch at the door, as `CheckedRobot`."""
        self._door.allow(motions, workspace, surface)

    def follow(self, waypoints: Waypoints) -> MotionReport:
        """Moves along waypoints that the door allows.

        Raises WorkspaceViolation before anything moves, RobotStopped if the robot is stopped, RobotError and its
        subclasses.
        """
        self._door.require_allowed(waypoints)
        self._require_zero(waypoints.label)
        self._lift_first()
        return self._follow(waypoints)

    def touch(self, lowest: float, speed: float) -> MotionReport:
        """Moves straight down inside the workspace until the brush touches something.

        lowest: robot z in metres at which the motion ends
        speed: m/s

        Raises WorkspaceViolation before anything moves, RobotError if the robot cannot feel, and the errors of
        `follow`.
        """
        tip, robot = self.pose(), self.robot
        if not isinstance(robot, TouchProbe):
            raise RobotError("This robot cannot feel a touch; lower the brush step by step until it touches.")
        down = Waypoints("touch", np.stack((tip, [*tip[:2], lowest])), speed)
        self._box.check([down])
        self._require_zero(down.label)
        if not lowest <= tip[2]:
            raise WorkspaceViolation(
                f"touch: the tip stands at {tip[2]:.4f} m, below {lowest:.4f} m; nothing was sent to the robot; "
                "raise the brush first."
            )
        return self._move(down.label, lambda: robot.touch(lowest, speed), down.position, speed)

    def stop(self, reason: str = "it was asked for", *, asked: bool = False) -> None:
        """Stops at once and latches; may be called from any thread, repeatedly. The first reason stays.

        asked: True if a person asked for the stop, for RobotStopped
        """
        with self._lock:
            first = self.stopped is None
            if first:
                self.stopped, self._stopped_at = StopRecord(self.latch.easel, reason, time.time()), steady()
                self._asked = asked
        sending = threading.Thread(target=self._send_stop, daemon=True)
        sending.start()
        if first:  # In a separate thread, because the disk may be slow or missing, and the robot must stop first.
            self._latching = threading.Thread(target=self._latch, args=(reason,), daemon=True)
            self._latching.start()
        sending.join(_SENDING)

    def close(self) -> None:
        """Disconnects from the robot, and waits until a stop is stored."""
        if self._latching is not None:
            self._latching.join(_WRITING)
        with contextlib.suppress(FridaError):  # the errors were reported before
            self._call("close", self.robot.close, self._grace)
        self._caller.end()

    def _send_stop(self) -> None:
        with contextlib.suppress(Exception):  # any driver may fail here; the latch holds all the same
            self.robot.stop()

    def _latch(self, reason: str) -> None:
        try:
            self.stopped = self.latch.engage(reason)
        except Exception as failure:  # whatever it is, a person must know that the stop ends with this process
            unkept = f"{reason.rstrip('.')}; it could not be stored, and holds only until this program ends"
            self.stopped = StopRecord(self.latch.easel, f"{unkept} ({one_line(failure)})", time.time())

    def _lift_first(self) -> None:
        """Raises a low brush vertically, once after connection: it may stand on the canvas or in a well."""
        here, hover = self.workspace, self.workspace.hover
        surface = here.canvas_origin[2] if here.rack is None else here.top  # or among brushes
        if not self._lifted and self._tip is not None and not self._tip[2] >= surface + hover / 2:
            clear = min(surface + hover, here.upper[2])
            self._follow(Waypoints("lift", np.array([[*self._tip[:2], clear]]), here.travel_speed))
        self._lifted = True

    def _follow(self, way: Waypoints) -> MotionReport:
        whole = way.position if self._tip is None else np.concatenate([self._tip[None], way.position])
        return self._move(way.label, lambda: self.robot.follow(way), whole, way.speed)

    def _move(
        self, label: str, act: Callable[[], MotionReport], path: NDArray[np.float64], speed: float
    ) -> MotionReport:
        """Moves along about this path [k, 3] (m), and checks that the tip stands where the report says."""
        seconds = motion_seconds(self._timing, path, speed) * self._patience + self._grace
        report = self._act(label, lambda: _require_report(label, act()), seconds)
        self._tip = reached = np.asarray(report.reached, np.float64)
        self._tip = self.pose()
        require_arrived(label, self._tip, reached, "it says it went")
        return report

    def _act(self, label: str, act: Callable[[], T], within: float) -> T:
        """Returns the result of a motion. Stops and latches the robot after a fault."""
        self._require_armed(label)
        self._promise(within + 2 * self._grace + (0.0 if self._timing is None else _HELD))
        self._moving.set()
        try:
            return self._call(label, act, within)
        except (WorkspaceViolation, RobotBusy, ZeroUnknown):
            raise  # refused before anything moved
        except FridaError as fault:
            by_person = self.stopped
            self.stop(str(fault))
            if by_person is not None:
                raise self._refusal(label) from fault
            raise
        finally:
            self._moving.clear()

    def _ask(self, method: str, *given: Any) -> Any:
        """Returns the driver's answer to a question that moves nothing; None if it has no such method."""
        act = getattr(self.robot, method, None)
        return self._call(method.replace("_", " "), lambda: act(*given), self._grace) if callable(act) else None

    def _call(self, label: str, act: Callable[[], T], within: float) -> T:
        """Returns the driver's result; an exception or a delay becomes a FridaError."""
        began = steady()

        def until() -> float:
            if self._moving.is_set() and self.stopped is not None:
                return min(began + within, self._stopped_at + _WIND_DOWN)
            if self._moving.is_set():  # a machine that moves, or that a person holds, is not lost
                return max(began + within, self.alive_at() + self._grace)
            return began + within

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

    def _require_zero(self, label: str) -> None:
        self._require_inside("jog it back: paint, resume, calibrate and setup offer that")
        if not self._zero.known:
            raise ZeroUnknown(
                f"{label}: nothing moves, because the robot does not know where its brush is ({self._zero.lost}); find "
                "its zero again: paint, resume or calibrate in a terminal or in the studio ask for it."
            )

    def _require_armed(self, label: str) -> None:
        if self.stopped is not None:
            raise self._refusal(label)

    def _refusal(self, label: str) -> RobotStopped:
        assert self.stopped is not None
        why = self.stopped.reason.rstrip(".")
        told = f"{label}: nothing moves, {self.stopped.easel} was stopped ({why}); {self.latch.remedy}"
        return RobotStopped(told, asked=self._asked)


def _require_report(label: str, report: object) -> MotionReport:
    """Returns the report of a motion. Raises RobotError unless it has a place of the tip, and times in order."""
    if isinstance(report, MotionReport) and _is_place(report.reached):
        began, ended = report.started_at, report.finished_at
        if all(isinstance(at, int | float) and math.isfinite(at) for at in (began, ended)) and began <= ended:
            return report
    raise RobotError(
        f"{label}: the robot reported {_shortly(report)}, which is no report of a motion; nobody knows where its tip "
        "is. Look at it before going on."
    )


def _is_place(told: object) -> bool:
    """Returns True for three finite numbers."""
    place = np.asarray(told)
    return place.shape == (3,) and place.dtype.kind in "fi" and bool(np.isfinite(place).all())


def _millimetres(point: NDArray[np.float64]) -> str:
    return "(" + ", ".join(f"{1000 * metres:.0f}" for metres in point) + ")"


def _shortly(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


class GuardedCamera:
    """Camera under guard: a call ends within `patience` seconds, with a photograph or with a typed error.

    Implements hardware.robot.Camera.
    """

    def __init__(self, camera: Camera, *, patience: float = 30.0) -> None:
        self.camera = camera
        self._patience = patience
        self._caller = Caller("camera")
        self._turn = threading.Lock()

    def connect(self) -> None:
        """Connects to the camera. Raises CameraError and its subclasses."""
        self._call(self.camera.connect)

    def capture(self, newer_than: float) -> Frame:
        """Returns a photograph taken after `newer_than` (s). Raises CameraError and its subclasses."""
        with self._turn:
            frame = self._call(lambda: self.camera.capture(newer_than))
        if not _is_photograph(frame):
            raise CameraError(
                "What the camera handed out is no photograph (rows x columns x 3 bytes, a time and a number); "
                "look at the camera and its settings, then take another."
            )
        return frame

    def glance(self) -> NDArray[np.uint8] | None:
        """Returns the current picture of a live camera; None if it is not live or is in use. Raises CameraError."""
        if not isinstance(self.camera, LiveCamera) or not self._turn.acquire(blocking=False):
            return None
        try:
            return self._call(self.camera.glance)
        finally:
            self._turn.release()

    def close(self) -> None:
        """Disconnects from the camera. Raises CameraError and its subclasses."""
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
