"""The robot kind `xarm`: UFACTORY's xArm 6, xArm 7 and Lite 6 through their SDK, in millimetres and degrees.

Neither the SDK nor this program clears an error: a person does that, at the arm.
"""

import math
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from frida_painter import registry
from frida_painter.errors import ConfigError, FridaError, MotionFailed, RobotDisconnected, RobotError, RobotStopped
from frida_painter.hardware.deadline import steady, within
from frida_painter.hardware.interlock import PATIENCE, Interlock, motion_timeout
from frida_painter.hardware.kinds import MachineName, Needed, RobotKind, at_host, require_home
from frida_painter.hardware.robot import (
    Examination,
    MachineFact,
    Point,
    StopLine,
    Waypoints,
    Workspace,
)
from frida_painter.hardware.timing import AxisTiming
from frida_painter_drivers.driver import Driver

Answer = TypeVar("Answer")

_NEEDED = Needed(module="xarm", extra="xarm")
_OPENING, _CLOSING = 5.0, 1.0
_POLL = 0.02
_TURNING, _TURN_STEP = 0.5, math.radians(2)  # rad/s about the tip, in straight lines of the tool's centre
_UPRIGHT = math.radians(0.1)  # lean that counts as none
_STILL = 1e-4  # metres between two polls
_MOVING, _STANDING, _PAUSED, _RESET, _STOPPED = 1, (0, 2), 3, 5, (4, 6)
_AFTER_START = 0.15  # seconds after set_state within which the arm ignores moves: 0.1 (SDK issue 59)
_AHEAD, _FEWEST = 64, 8  # waypoints that wait in the arm's queue; W11 comes up at 2048, at 256 in old firmware
_AHEAD_SECONDS = 0.3  # of motion that they are worth: it is finished if nobody is left who could stop the arm
_SHORT = 1e-6  # metres
_STOP_FRAME = bytes((0, 1, 0, 2, 0, 2, 12, 4))  # number 1, UFACTORY's protocol 2, two bytes: set the state (12) to 4
_ERRORS = {
    1: "the emergency stop at the control box was pressed",
    2: "the emergency input of the control box was triggered",
    3: "the three-state switch of the control box was pressed",
    10: "a joint's motor failed",
    **{10 + joint: f"the motor of joint {joint} failed" for joint in range(1, 8)},
    18: "its force sensor does not answer",
    19: "the end of the arm does not answer its control box",
    21: "a place that it cannot reach, or near one",
    22: "it would collide with itself",
    23: "a joint would turn beyond its limit",
    24: "a joint would be too fast",
    25: "it could not plan the way",
    26: "its control box lost its real-time clock",
    27: "a joint did not acknowledge a command",
    28: "the end of the arm does not answer",
    30: "a joint turned faster than it may",
    31: "it ran into something, or its payload or its sensitivity for collisions is set wrongly",
    33: "the inputs of its control box failed",
    35: "beyond its own safety boundary",
    36: "too many delayed commands wait",
    37: "it moved by itself while it was led by hand; its payload is set wrongly",
    38: "a joint stands at an angle that cannot be",
    39: "its power board failed",
    40: "it found no joint angles on the way",
    41: "its friction file is damaged",
    42: "its calibration file is damaged",
    50: "its force sensor cannot be read",
    51: "its force sensor did not change its mode",
    52: "its force sensor could not be set to zero",
    53: "its force sensor is overloaded",
    60: "it would be faster than it may",
    110: "the board in its base does not answer",
    111: "a device at its control box does not answer",
}
"""Errors of the control box (ControllerErrorCodeMap of the SDK)."""
_WARNINGS = {
    11: "its queue is full, and the waypoint was dropped",
    12: "it does not understand the values of a command, which was dropped",
    13: "it does not know a command, which was dropped",
    14: "it cannot reach the waypoint, which was dropped",
    15: "its queue for devices is full",
}
"""Warnings of the control box (ControllerWarnCodeMap). The SDK returns 0 for a command that was dropped with one."""
_SILENT, _GONE = (3,), (-1, 8)  # ERR_TOUT; NOT_CONNECTED, ERR_NOTTCP
_NO_PAYLOAD = 0.05  # kg
_POSITIONS, _TEACHING = 0, 2  # modes of the control box
_GUIDE = "guide"


@dataclass(frozen=True)
class XarmSettings:
    """Settings of an xArm.

    address: of the control box
    home: home position of the tip, metres
    approach: m/s to the first waypoint
    brush_length: from the arm's tool centre to the brush's tip, metres; 0 if the arm's own tool offset includes it
    tool: roll, pitch and yaw of the tool in degrees; the default points straight down
    blend: distance from a waypoint at which the arm may round the corner, metres; less where waypoints are close
    acceleration: m/s2

    Raises ConfigError if a value is out of range.
    """

    address: str
    home: Point
    approach: float = 0.15
    brush_length: float = 0.0
    tool: tuple[float, float, float] = (180.0, 0.0, 0.0)
    blend: float = 0.0005
    acceleration: float = 1.0

    def __post_init__(self) -> None:
        if not (0 < self.approach <= 1 and 0 <= self.brush_length <= 1 and 0 <= self.blend <= 0.01):
            raise ConfigError(
                f"An xArm was given an approach of {self.approach} m/s, a brush of {self.brush_length} m and a blend "
                f"of {self.blend} m; they are above 0 to 1 m/s, 0 to 1 m and 0 to 0.01 m."
            )
        if not (0 < self.acceleration <= 10 and all(-360 <= angle <= 360 for angle in self.tool)):
            raise ConfigError(
                f"An xArm was given an acceleration of {self.acceleration} m/s2 and a tool turned by {self.tool}; they "
                "are above 0 to 10 m/s2 and three angles of -360 to 360 degrees."
            )


class XarmRobot(Driver):
    """Robot through UFACTORY's SDK. Implements Robot, TimedRobot, ExaminedRobot and GuidedRobot.

    Stops use a separate connection.

    Its joints have absolute encoders, so its zero survives everything.
    """

    def __init__(self, settings: XarmSettings) -> None:
        self.settings = settings
        self._interlock = Interlock(f"the xArm at {settings.address}")
        self._arm: Any = None
        self._stopper: Any = None
        self._alive = -math.inf
        self.serial_number = ""

    def connect(self) -> None:
        """Opens one connection for motions and one for stops, and enables the arm if it has no error.

        Raises RobotDisconnected if the address does not answer.
        Raises RobotError if the package is missing or the arm refuses a command, MotionFailed if it has an error,
        which only a person clears.
        """
        self._start(_POSITIONS, self.pose)

    def _start(self, mode: int, look: Callable[[], object]) -> None:
        """Opens both connections and puts the arm into a mode; closes them if that, or `look`, fails."""
        self.close()
        kind = self._load_sdk()
        self._interlock.mark_connected()
        try:
            self._stopper = self._open_connection(kind)
            self._arm = self._open_connection(kind)
            self.serial_number = str(getattr(self._arm, "sn", None) or "")
            self._clear_warning()
            self._require_no_fault("connect", None)
            for what, call in (
                ("motion_enable", lambda: self._arm.motion_enable(True)),
                ("set_mode", lambda: self._arm.set_mode(mode)),
                ("set_state", lambda: self._arm.set_state(0)),
            ):
                self._require_done(what, self._interlock.asking(what, call))
            time.sleep(_AFTER_START)
            self._require_no_fault("connect", None)
            self._require_ready("connect", mode)
            look()
        except FridaError:
            self._end_mode(mode)
            self.close()
            raise

    # Guiding by a person's hand: the control box's mode for joint teaching.

    def begin_guiding(self) -> None:
        """Connects and puts the arm into its teach mode, in which it carries its own weight. Implements GuidedRobot.

        Raises the errors of `connect`.
        """
        self._start(_TEACHING, self.guided_tip)

    def guided_tip(self) -> NDArray[np.float64]:
        """Returns the tip [3] (m), the brush tilted or not.

        Raises MotionFailed if the control box has an error, RobotStopped if the arm was stopped there, RobotError if
        another program ended the teach mode.
        """
        self._interlock.require_ready(_GUIDE)
        self._require_no_fault(_GUIDE, None)
        self._require_ready(_GUIDE, _TEACHING)
        return self._tip(self._place(_GUIDE))

    def end_guiding(self) -> None:
        """Stops the arm, ends its teach mode and disconnects."""
        self._end_mode(_TEACHING)
        self.close()

    def _end_mode(self, mode: int) -> None:
        """Ends the teach mode, if the arm may be in it: it then holds its place and takes no motions."""
        if mode == _POSITIONS or self._arm is None:
            return
        self._halt()
        with suppress(RobotError):  # an arm that does not answer was told to stop over both connections
            self._interlock.asking("set_mode", lambda: self._arm.set_mode(_POSITIONS))
            self._interlock.asking("set_state", lambda: self._arm.set_state(_STOPPED[0]))

    def pose(self) -> NDArray[np.float64]:
        """Returns the position of the tip, [3] metres. Raises RobotError if the answer is no position."""
        self._interlock.require_ready("pose")
        return self._tip(self._place("pose"))

    def _tip(self, place: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns the tip [3] (m) for the place [6] of the tool's centre."""
        return place[:3] / 1000 + self.settings.brush_length * _along_tool(np.radians(place[3:]))

    def _upright(self, tip: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns the place [6] of the tool's centre, in mm and degrees, for a tip [3] (m) of an upright brush."""
        return np.r_[(tip + np.array([0.0, 0.0, self.settings.brush_length])) * 1000, self.settings.tool]

    def _place(self, label: str) -> NDArray[np.float64]:
        """Returns x, y and z of the tool's centre in mm, and roll, pitch and yaw in degrees: [6]."""
        answer = self._interlock.asking(label, lambda: self._arm.get_position(is_radian=False))
        try:
            code, told = answer
            place = np.array(told, dtype=np.float64)
        except (TypeError, ValueError):
            code, place = None, np.empty(0)
        self._require_line(label, code)
        if code != 0 or place.shape != (6,) or not np.isfinite(place).all():
            raise self._interlock.fault(
                RobotError(f"{self._interlock.name} said {str(answer)[:80]} when asked where it is; look at it.")
            )
        return place

    def _go(self, waypoints: Waypoints) -> NDArray[np.float64]:
        """Moves in straight lines with slightly rounded corners.

        A brush of known length that leans, as after guiding, is turned upright about its tip before that.
        """
        started = time.monotonic()
        self._require_no_fault(waypoints.label, None)
        self._require_ready(waypoints.label)
        place = self._place(waypoints.label)
        here = self._tip(place)
        turning = self._turn_upright(here, place)
        until = started + motion_timeout(waypoints.length, waypoints.speed)
        until += motion_timeout(float(np.linalg.norm(waypoints.position[0] - here)), self.settings.approach)
        until += 2 * _TURN_STEP * len(turning) / _TURNING
        targets = [*turning, *map(self._upright, waypoints.position)]
        pace = waypoints.speed * len(waypoints.position) / max(waypoints.length, _SHORT)  # waypoints per second
        ahead = int(np.clip(_AHEAD_SECONDS * pace, _FEWEST, _AHEAD))
        radii = self._blend(np.array([place, *targets])[:, :3] / 1000)
        for number, (target, radius) in enumerate(zip(targets, radii, strict=True)):
            if number and number % ahead == 0:
                self._await_room(waypoints.label, ahead)
            self._send(waypoints, number - len(turning), target, radius)
        self._wait(waypoints, until)
        return self.pose()

    def stop_line(self) -> StopLine | None:
        """Returns the connection for stops, over which another process can stop the arm too."""
        try:
            return StopLine(self._stopper._arm.arm_cmd.arm_port.com.fileno(), _STOP_FRAME)
        except (AttributeError, OSError):  # not connected, or an SDK that keeps its socket elsewhere
            return None

    def close(self) -> None:
        """Closes both connections."""
        arm, stopper, self._arm, self._stopper = self._arm, self._stopper, None, None
        self._interlock.mark_disconnected()
        for connection in (arm, stopper):
            if connection is not None:
                with suppress(RobotError):  # A connection that does not close in time is abandoned.
                    self._interlock.asking("close", connection.disconnect)

    def timing(self) -> AxisTiming:
        """Returns the limits with which the arm is told to move; it blends corners."""
        gain = self.settings.acceleration
        return AxisTiming(
            (1.0, 1.0, 1.0), (gain, gain, gain), deviation=max(self.settings.blend / 4, 1e-5), between=0.1
        )

    def alive_at(self) -> float:
        """Returns when the arm last reported that it moves."""
        return self._alive

    def examine(self) -> Examination:
        """Connects, reads what the control box tells, and disconnects; moves and changes nothing."""
        self.close()
        kind = self._load_sdk()
        self._interlock.mark_connected()
        try:
            self._arm = self._open_connection(kind)
            return Examination(tuple(self._facts()), self.timing())
        finally:
            self.close()

    def _facts(self) -> Iterator[MachineFact]:
        arm, until = self._arm, time.monotonic() + 1.0
        while arm.collision_sensitivity == 0 and arm.tcp_load[0] == 0 and time.monotonic() < until:
            time.sleep(_POLL)  # both come with the first report
        yield MachineFact(
            f"An xArm answers at {self.settings.address}: serial number {arm.sn}, firmware {arm.version}."
        )
        error, warning = self._codes("examine")
        if error:
            yield MachineFact(f"It has error {_name(error, _ERRORS)}. Look at it and clear the error there.", "refusal")
        if warning:
            yield MachineFact(f"It has warning {_name(warning, _WARNINGS)}.", "warning")
        state = self._number("examine", "get_state")
        yield MachineFact(
            f"Its state is {state}, {_STATES.get(state, 'which is not known here')}, and its mode {arm.mode}"
            f"{'' if arm.mode == 0 else ': another program uses it'}.",
            "fact" if arm.mode == 0 else "warning",
        )
        weight, sensitivity = arm.tcp_load[0], arm.collision_sensitivity
        light = weight < _NO_PAYLOAD
        yield MachineFact(
            f"Its payload is set to {weight:g} kg and its sensitivity for collisions to {sensitivity} of 5"
            + ("; set the weight of brush and holder, or it may stop with error 31." if light else "."),
            "warning" if light or sensitivity == 0 else "fact",
        )
        yield MachineFact(
            "Its own tool offset is (" + ", ".join(f"{number:g}" for number in arm.tcp_offset[:3]) + ") mm; the brush "
            f"reaches {1000 * self.settings.brush_length:g} mm below that."
        )

    def _load_sdk(self) -> Callable[..., Any]:
        """Returns the SDK's class, if somebody answers at the address. Raises RobotError, RobotDisconnected."""
        with registry.importing("xarm", "An xArm", RobotError):
            from xarm.core.config.x_config import XCONF
            from xarm.wrapper import XArmAPI
        self._require_somebody(XCONF.SocketConf.TCP_CONTROL_PORT)
        return partial(XArmAPI, is_radian=False, do_not_open=True, **_SDK)

    def _require_somebody(self, port: int) -> None:
        """Checks that the control box answers, because the SDK would wait for long."""
        try:
            socket.create_connection((self.settings.address, port), timeout=PATIENCE).close()
        except OSError as cause:
            raise RobotDisconnected(
                f"No xArm answers at {self.settings.address} ({cause.strerror or cause}); look whether its control box "
                "is on and in this computer's network, and whether the address is right."
            ) from cause

    def _open_connection(self, kind: Callable[..., Any]) -> Any:
        """Returns an open connection."""
        made = self._interlock.asking("connect", lambda: kind(self.settings.address))
        try:
            self._interlock.asking("connect", made.connect, _OPENING)
        except RobotError:
            self._interlock.mark_disconnected()
            with suppress(RobotError):
                self._interlock.asking("close", made.disconnect, _CLOSING)
            raise
        finally:
            socket.setdefaulttimeout(None)  # the SDK sets one second for all sockets of the process
        return made

    def _blend(self, path: NDArray[np.float64]) -> list[float | None]:
        """Returns for each waypoint after the first the radius of its arc in mm, None for a stop there.

        Arcs of neighbours must not overlap: the arm then fails with C25 (SDK issue 79).
        """
        length = np.linalg.norm(np.diff(path, axis=0), axis=1)
        room = 0.4 * np.minimum(length[:-1], length[1:])
        radii = [min(self.settings.blend, float(metres)) for metres in room]
        return [1000 * radius if radius > _SHORT else None for radius in radii] + [None]

    def _await_room(self, label: str, ahead: int) -> None:
        """Returns when at most `ahead` waypoints wait in the arm's queue."""
        until = time.monotonic() + PATIENCE
        waiting = self._number(label, "get_cmdnum")
        while waiting > ahead:
            self._interlock.heed_stop(label)
            self._require_no_fault(label, None)
            if self._state(label) == _PAUSED:
                raise MotionFailed(f"{label}: {self._interlock.name} is paused, and is stopped now; look at it, then "
                                   "connect anew.")  # fmt: skip
            time.sleep(_POLL)
            before, waiting = waiting, self._number(label, "get_cmdnum")
            if waiting < before:
                self._alive, until = steady(), time.monotonic() + PATIENCE
            if time.monotonic() > until:
                raise MotionFailed(f"{label}: {self._interlock.name} does not go on, and is stopped; look at it, then "
                                   "connect anew.")  # fmt: skip

    def _turn_upright(self, tip: NDArray[np.float64], place: NDArray[np.float64]) -> list[NDArray[np.float64]]:
        """Returns the places of the tool's centre that turn a leaning brush upright about its tip, in steps."""
        handle = -_along_tool(np.radians(place[3:]))
        aside = float(np.hypot(*handle[:2]))
        leans = math.atan2(aside, handle[2])
        if self.settings.brush_length == 0 or leans <= _UPRIGHT:
            return []
        axis = np.array((-handle[1], handle[0], 0.0)) / aside
        upright = Rotation.from_euler("xyz", self.settings.tool, degrees=True)
        turned = [
            Rotation.from_rotvec(angle * axis)
            for angle in np.linspace(leans, 0, math.ceil(leans / _TURN_STEP) + 1)[1:-1]
        ]
        along = np.array([0.0, 0.0, self.settings.brush_length])
        return [
            *(np.r_[(tip + one.apply(along)) * 1000, (one * upright).as_euler("xyz", degrees=True)] for one in turned),
            self._upright(tip),
        ]

    def _send(self, waypoints: Waypoints, index: int, target: NDArray[np.float64], radius: float | None) -> None:
        """Puts one waypoint into the arm's queue. Raises MotionFailed if the arm dropped it.

        index: of the waypoint; below 0 while the brush is turned before the first
        target: place [6] of the tool's centre
        """
        self._interlock.heed_stop(waypoints.label)
        x, y, z, roll, pitch, yaw = target.tolist()
        speed = waypoints.speed if index > 0 else self.settings.approach
        if index < 0:
            speed = _TURNING * self.settings.brush_length
        index = max(index, 0)

        def move() -> Any:
            return self._arm.set_position(
                x=float(x),
                y=float(y),
                z=float(z),
                roll=roll,
                pitch=pitch,
                yaw=yaw,
                radius=radius,
                speed=1000 * speed,
                mvacc=1000 * self.settings.acceleration,
                is_radian=False,
                wait=False,
            )

        code = self._interlock.asking(waypoints.label, move)
        if code != 0:
            self._interlock.heed_stop(waypoints.label)
            self._require_line(waypoints.label, code)
        self._require_no_fault(waypoints.label, index)
        if code != 0:
            self._state(waypoints.label)
            raise MotionFailed(
                f"{waypoints.label}: {self._interlock.name} did not take waypoint {index} (the SDK's code {code}); it "
                "is stopped. Look at it, then connect anew.",
                code if isinstance(code, int) else None,
                index,
            )

    def _wait(self, waypoints: Waypoints, until: float) -> None:
        """Returns when the arm reports rest and an empty queue, and two polls show the same position."""
        seen, last, moved = 0, np.full(3, np.nan), np.full(3, np.inf)
        while seen < 2:
            self._interlock.heed_stop(waypoints.label)
            self._require_no_fault(waypoints.label, None)
            state = self._state(waypoints.label)
            standing = state in _STANDING and self._number(waypoints.label, "get_cmdnum") == 0
            here = self.pose()
            if state == _MOVING and float(np.linalg.norm(here - moved)) > _STILL:
                # An arm that moves is alive, also if its speed was reduced at its control box.
                moved, until, self._alive = here, max(until, time.monotonic() + PATIENCE), steady()
            seen = seen + 1 if standing and float(np.linalg.norm(here - last)) <= _STILL else 0
            last = here if standing else np.full(3, np.nan)
            if time.monotonic() > until:
                how = "is paused" if state == _PAUSED else "did not arrive in time"
                raise MotionFailed(
                    f"{waypoints.label}: {self._interlock.name} {how}, and is stopped now; look at it, then connect "
                    "anew."
                )
            time.sleep(_POLL)

    def _require_ready(self, label: str, mode: int = _POSITIONS) -> None:
        """Raises RobotError if the arm is not in a mode, that for positions, and ready in it."""
        if self._state(label) == _PAUSED:
            raise RobotError(f"{label}: {self._interlock.name} is paused; let it go on there, then connect anew.")
        until = time.monotonic() + 1.0  # the mode comes with reports, five times a second
        while self._arm.mode != mode:
            if time.monotonic() > until:
                raise RobotError(
                    f"{label}: {self._interlock.name} is in mode {self._arm.mode} and not in {mode}, for "
                    f"{'positions' if mode == _POSITIONS else 'teaching'}; another program uses it. End that, then "
                    "connect anew."
                )
            time.sleep(_POLL)

    def _state(self, label: str) -> int:
        """Returns the arm's state.

        Raises RobotStopped if it was stopped at the arm, MotionFailed if its own fault stopped it, RobotError if it was
        reset.
        """
        state = self._number(label, "get_state")
        if state == _RESET:  # it has then dropped its queue (SDK issue 107)
            raise RobotError(
                f"{label}: {self._interlock.name} was reset, as by another program that changed its payload, its tool "
                "or its mode, and has dropped its motions. End that program, then connect anew."
            )
        if state in _STOPPED:
            self._require_no_fault(label, None)  # one that came after the last question
            raise RobotStopped(
                f"{label}: {self._interlock.name} was stopped, by its switch or to protect somebody; look at it before "
                "it is connected anew."
            )
        return state

    def _number(self, label: str, call: str) -> int:
        """Calls a question of the SDK whose answer is (code, number), and returns the number."""
        answer = self._interlock.asking(label, getattr(self._arm, call))
        if isinstance(answer, tuple | list) and len(answer) == 2:
            if answer[0] == 0 and isinstance(answer[1], int):
                return answer[1]
            self._require_line(label, answer[0])
        self._interlock.heed_stop(label)  # what a call answers that a stop broke off says nothing
        raise RobotError(f"{label}: {self._interlock.name} answered {str(answer)[:80]} to {call}; look at it.")

    def _clear_warning(self) -> None:
        """Clears a warning, which stays until somebody does: it concerned an earlier command."""
        error, warning = self._codes("connect")
        if warning and not error:
            self._require_done("clean_warn", self._interlock.asking("clean_warn", self._arm.clean_warn))

    def _codes(self, label: str) -> tuple[int, int]:
        """Returns the error and the warning of the control box, 0 for none."""
        answer = self._interlock.asking(label, self._arm.get_err_warn_code)
        try:
            code, (error, warning) = answer
        except (TypeError, ValueError):
            code = error = warning = None
        if code == 0 and isinstance(error, int) and isinstance(warning, int):
            return error, warning
        self._require_line(label, code)
        raise RobotError(
            f"{label}: {self._interlock.name} answered {str(answer)[:80]} when asked for errors; look at it."
        )

    def _require_line(self, label: str, code: Any) -> None:
        """Raises RobotDisconnected if a code of the SDK means that the connection is lost or silent."""
        if code in _GONE or (code in _SILENT and not self._arm.connected):
            raise self._interlock.fault(
                RobotDisconnected(
                    f"{label}: the connection to {self._interlock.name} is gone; look at its control box and its "
                    "network. The arm may finish the motion that it has."
                )
            )
        if code in _SILENT:
            raise self._interlock.fault(
                RobotDisconnected(
                    f"{label}: {self._interlock.name} said nothing for some seconds, and is told to stop; look at it "
                    "and at its network."
                )
            )

    def _require_no_fault(self, label: str, waypoint: int | None) -> None:
        """Raises MotionFailed if the control box has an error or a warning: the SDK calls the latter a success."""
        error, warning = self._codes(label)
        if not error and not warning:
            return
        where = "" if waypoint is None else f" at waypoint {waypoint}"
        told = f"error {_name(error, _ERRORS)}" if error else f"warning {_name(warning, _WARNINGS)}"
        remedy = "Look at it and clear the error at the arm; this program never does." if error else (
            "It is stopped. Look at the workspace and at its address, then connect anew.")  # fmt: skip
        raise MotionFailed(f"{label}: {self._interlock.name} has {told}{where}. {remedy}", error or warning, waypoint)

    def _require_done(self, what: str, code: Any) -> None:
        if code != 0:
            raise RobotError(
                f"connect: {self._interlock.name} refused {what} with the SDK's code {str(code)[:40]}; look at it, and "
                "whether another program uses it."
            )

    def _halt(self) -> None:
        """Sets state 4: the arm stands and forgets its motions. If one connection fails, over the other.

        Waits at most two seconds.
        """
        for connection in (self._stopper, self._arm):
            if connection is None:
                continue
            try:
                if within(1.0, f"{self._interlock.name}: stop", partial(connection.set_state, 4)) == 0:
                    return
            except Exception:  # after any exception of the library, the other connection is tried
                continue


_STATES = {
    1: "it moves", 2: "it stands", 3: "it is paused", 4: "it was stopped", 5: "it is off", 6: "it stops",
}  # fmt: skip
_SDK = {
    "report_type": "normal",
    "check_is_pause": False,  # the SDK would wait without end while the arm is paused
    "check_cmdnum_limit": False,
    "check_robot_sn": False,
}


def _along_tool(angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the direction [3] in which a tool points, for its roll, pitch and yaw in radians about fixed axes."""
    (sr, sp, sy), (cr, cp, cy) = np.sin(angles), np.cos(angles)
    return np.array([cy * sp * cr + sy * sr, sy * sp * cr - cy * sr, cp * cr])


def _name(code: int, names: dict[int, str]) -> str:
    return f"{code}: {names[code]}" if code in names else f"{code} (see UFACTORY's manual)"


def _open(name: MachineName, workspace: Workspace) -> XarmRobot:
    name.require("brush_length")
    length = name.choose("brush_length", float, 0.0)
    return XarmRobot(XarmSettings(name.where, require_home(name, workspace), workspace.travel_speed, length))


KIND = RobotKind(
    "xarm",
    "xarm:ADDRESS[,brush_length=METRES]",
    "UFACTORY xArm 6 and 7, Lite 6",
    open=_open,
    needed=_NEEDED,
    identify=lambda name: at_host(name.where),
)
