"""The robot kind `xarm`: UFACTORY's xArm 6, xArm 7 and Lite 6 through their SDK, in millimetres and degrees.

Neither the SDK nor this program clears an error: a person does that, at the arm.
"""

import math
import socket
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from frida_painter import registry
from frida_painter.errors import MotionFailed, RobotDisconnected, RobotError, RobotStopped
from frida_painter.hardware.deadline import steady, within
from frida_painter.hardware.interlock import PATIENCE, motion_timeout
from frida_painter.hardware.kinds import MachineName, Needed, RobotKind, at_host, require_home
from frida_painter.hardware.robot import MachineFact, Point, StopLine, Waypoints, Workspace
from frida_painter.hardware.timing import AxisTiming
from frida_painter_drivers.driver import Driver

_NEEDED = Needed(module="xarm", extra="xarm")
_CLOSING = 1.0
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
_SILENT, _GONE = (3,), (-1, 8)  # ERR_TOUT; NOT_CONNECTED, ERR_NOTTCP
_TOOL = (180.0, 0.0, 0.0)  # roll, pitch and yaw in degrees of a tool that points straight down
_BLEND, _ACCELERATION = 0.0005, 1.0  # metres from a waypoint at which the arm may round the corner; m/s2
_STATES = {
    1: "it moves", 2: "it stands", 3: "it is paused", 4: "it was stopped", 5: "it is off", 6: "it stops",
}  # fmt: skip
_SDK = {
    "report_type": "normal",
    "check_is_pause": False,  # the SDK would wait without end while the arm is paused
    "check_cmdnum_limit": False,
    "check_robot_sn": False,
}
_NO_PAYLOAD = 0.05  # kg
_POSITIONS, _TEACHING = 0, 2  # modes of the control box
_GUIDE = "guide"


class XarmRobot(Driver):
    """Robot through UFACTORY's SDK. Implements GuidedRobot as well.

    address: of the control box
    brush_length: from the arm's tool centre to the brush's tip, metres; 0 if the arm's own tool offset includes it

    Stops use a separate connection. Its joints have absolute encoders, so its zero survives everything.
    """

    def __init__(self, address: str, resting: Point, approach: float = 0.15, brush_length: float = 0.0) -> None:
        super().__init__(f"the xArm at {address}", resting, approach)
        self._require_between("a brush length", brush_length, 0, 1, "m")
        self.address, self.brush_length = address, brush_length
        self._arm: Any = None
        self._stopper: Any = None
        self._mode = _POSITIONS
        self._errors: Mapping[Any, Any] = {}
        self._warnings: Mapping[Any, Any] = {}
        self.serial_number = ""

    def _open(self, *, examines: bool) -> None:
        """Opens a connection for motions and one for stops, and enables the arm in its mode if it has no error."""
        kind = self._load_sdk()
        self._stopper = self._open_connection(kind)
        self._arm = self._open_connection(kind)
        self.serial_number = str(getattr(self._arm, "sn", None) or "")
        if examines:
            return
        error, warning = self._codes("connect")
        if warning and not error:  # it stays until somebody clears it, and concerned an earlier command
            self._set("clean_warn")
        self._require_no_fault("connect", None)
        self._set("motion_enable", True)
        self._set("set_mode", self._mode)
        self._set("set_state", 0)
        time.sleep(_AFTER_START)
        self._require_no_fault("connect", None)
        self._require_ready("connect", self._mode)
        self._place("connect")

    def _set(self, call: str, *value: object) -> None:
        """Has the SDK set something. Raises RobotError if the arm refuses."""
        code = self._interlock.asking(call, lambda: getattr(self._arm, call)(*value))
        if code != 0:
            refused = (
                f"refused {call} with the SDK's code {str(code)[:40]}; look at it, and whether another program uses it."
            )
            raise self._failure(RobotError, "connect", refused)

    # Guiding by a person's hand: the control box's mode for joint teaching.

    def begin_guiding(self) -> None:
        """Connects and puts the arm into its teach mode, in which it carries its own weight. Implements GuidedRobot.

        Raises the errors of `connect`.
        """
        with self._opening():
            self._mode = _TEACHING
            self._open(examines=False)

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
        """Stops the arm, ends its teach mode, and disconnects; in teach mode it would take no motions."""
        self.close()

    def pose(self) -> NDArray[np.float64]:
        """Returns the position of the tip, [3] metres. Raises RobotError if the answer is no position."""
        self._interlock.require_ready("pose")
        return self._tip(self._place("pose"))

    def _tip(self, place: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns the tip [3] (m) for the place [6] of the tool's centre."""
        along = Rotation.from_euler("xyz", place[3:], degrees=True).apply([0.0, 0.0, self.brush_length])
        return np.asarray(place[:3] / 1000 + along)

    def _upright(self, tip: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns the place [6] of the tool's centre, in mm and degrees, for a tip [3] (m) of an upright brush."""
        return np.r_[(tip + np.array([0.0, 0.0, self.brush_length])) * 1000, _TOOL]

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
            error = self._failure(RobotError, label, f"said {str(answer)[:80]} when asked where it is; look at it.")
            raise self._interlock.fault(error)
        return place

    def _go(self, waypoints: Waypoints) -> NDArray[np.float64]:
        """Moves in straight lines with slightly rounded corners.

        A brush of known length that leans, as after guiding, is turned upright about its tip before that.
        """
        started, label = time.monotonic(), waypoints.label
        self._require_no_fault(label, None)
        self._require_ready(label)
        place = self._place(label)
        here = self._tip(place)
        turning = self._turn_upright(here, place)
        until = started + motion_timeout(waypoints.length, waypoints.speed)
        until += motion_timeout(float(np.linalg.norm(waypoints.position[0] - here)), self.approach)
        until += 2 * _TURN_STEP * len(turning) / _TURNING
        targets = [*turning, *map(self._upright, waypoints.position)]
        pace = waypoints.speed * len(waypoints.position) / max(waypoints.length, _SHORT)  # waypoints per second
        ahead = int(np.clip(_AHEAD_SECONDS * pace, _FEWEST, _AHEAD))
        radii = _blend(np.array([place, *targets])[:, :3] / 1000)
        for number, (target, radius) in enumerate(zip(targets, radii, strict=True)):
            if number and number % ahead == 0:
                self._await_room(label, ahead)
            index = number - len(turning)
            speed = waypoints.speed if index > 0 else _TURNING * self.brush_length if index < 0 else self.approach
            self._send(label, max(index, 0), target, radius, speed)
        self._wait(label, until)
        return self.pose()

    def stop_line(self) -> StopLine | None:
        """Returns the connection for stops, over which another process can stop the arm too."""
        try:
            return StopLine(self._stopper._arm.arm_cmd.arm_port.com.fileno(), _STOP_FRAME)
        except (AttributeError, OSError):  # not connected, or an SDK that keeps its socket elsewhere
            return None

    def close(self) -> None:
        """Closes both connections. An arm in its teach mode is stopped and holds its place before."""
        arm, stopper, mode = self._arm, self._stopper, self._mode
        if mode == _TEACHING and arm is not None:
            self._halt()
            with suppress(RobotError):  # an arm that does not answer was told to stop over both connections
                self._interlock.asking("set_mode", lambda: arm.set_mode(_POSITIONS))
                self._interlock.asking("set_state", lambda: arm.set_state(_STOPPED[0]))
        self._arm, self._stopper, self._mode = None, None, _POSITIONS
        self._interlock.mark_disconnected()
        for connection in (arm, stopper):
            if connection is not None:
                with suppress(RobotError):  # A connection that does not close in time is abandoned.
                    self._interlock.asking("close", connection.disconnect)

    def timing(self) -> AxisTiming:
        """Returns the limits with which the arm is told to move; it blends corners."""
        return AxisTiming((1.0, 1.0, 1.0), (_ACCELERATION,) * 3, deviation=_BLEND / 4, between=0.1)

    def _facts(self) -> Iterator[MachineFact]:
        arm, until = self._arm, time.monotonic() + 1.0
        while arm.collision_sensitivity == 0 and arm.tcp_load[0] == 0 and time.monotonic() < until:
            time.sleep(_POLL)  # both come with the first report
        yield MachineFact(f"An xArm answers at {self.address}: serial number {arm.sn}, firmware {arm.version}.")
        error, warning = self._codes("examine")
        if error:
            told = f"It has error {_name(error, self._errors)}. Look at it and clear the error there."
            yield MachineFact(told, "refusal")
        if warning:
            yield MachineFact(f"It has warning {_name(warning, self._warnings)}.", "warning")
        state = self._number("examine", "get_state")
        yield MachineFact(
            f"Its state is {state}, {_STATES.get(state, 'which is not known here')}, and its mode "
            f"{arm.mode}{'' if arm.mode == 0 else ': another program uses it'}.",
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
            f"reaches {1000 * self.brush_length:g} mm below that."
        )

    def _load_sdk(self) -> Callable[..., Any]:
        """Returns the SDK's class, if somebody answers at the address, because the SDK would wait for long.

        Raises RobotError, RobotDisconnected.
        """
        with registry.importing("xarm", "An xArm", RobotError):
            from xarm.core.config.x_code import ControllerErrorCodeMap, ControllerWarnCodeMap
            from xarm.core.config.x_config import XCONF
            from xarm.wrapper import XArmAPI
        self._errors, self._warnings = ControllerErrorCodeMap, ControllerWarnCodeMap
        try:
            socket.create_connection((self.address, XCONF.SocketConf.TCP_CONTROL_PORT), timeout=PATIENCE).close()
        except OSError as cause:
            raise RobotDisconnected(
                f"No xArm answers at {self.address} ({cause.strerror or cause}); look whether its control box is on "
                "and in this computer's network, and whether the address is right."
            ) from cause
        return partial(XArmAPI, self.address, is_radian=False, do_not_open=True, **_SDK)

    def _open_connection(self, kind: Callable[..., Any]) -> Any:
        made = self._interlock.asking("connect", kind)
        try:
            self._interlock.asking("connect", made.connect)
        except RobotError:
            with suppress(RobotError):
                self._interlock.asking("close", made.disconnect, _CLOSING)
            raise
        finally:
            socket.setdefaulttimeout(None)  # the SDK sets one second for all sockets of the process
        return made

    def _await_room(self, label: str, ahead: int) -> None:
        """Returns when at most `ahead` waypoints wait in the arm's queue."""
        until = time.monotonic() + PATIENCE
        waiting = self._number(label, "get_cmdnum")
        while waiting > ahead:
            self._interlock.heed_stop(label)
            self._require_no_fault(label, None)
            is_paused = self._state(label) == _PAUSED
            if is_paused or time.monotonic() > until:
                how = "is paused, and is stopped now" if is_paused else "does not go on, and is stopped"
                raise self._failure(MotionFailed, label, f"{how}; look at it, then connect anew.")
            time.sleep(_POLL)
            before, waiting = waiting, self._number(label, "get_cmdnum")
            if waiting < before:
                self._alive, until = steady(), time.monotonic() + PATIENCE

    def _turn_upright(self, tip: NDArray[np.float64], place: NDArray[np.float64]) -> list[NDArray[np.float64]]:
        """Returns the places of the tool's centre that turn a leaning brush upright about its tip, in steps."""
        handle = -Rotation.from_euler("xyz", place[3:], degrees=True).apply([0.0, 0.0, 1.0])
        aside = float(np.hypot(*handle[:2]))
        leans = math.atan2(aside, handle[2])
        if self.brush_length == 0 or leans <= _UPRIGHT:
            return []
        axis = np.array((-handle[1], handle[0], 0.0)) / aside
        upright = Rotation.from_euler("xyz", _TOOL, degrees=True)
        along = np.array([0.0, 0.0, self.brush_length])
        places = []
        for angle in np.linspace(leans, 0, math.ceil(leans / _TURN_STEP) + 1)[1:-1]:
            turn = Rotation.from_rotvec(angle * axis)
            places.append(np.r_[(tip + turn.apply(along)) * 1000, (turn * upright).as_euler("xyz", degrees=True)])
        return [*places, self._upright(tip)]

    def _send(self, label: str, index: int, target: NDArray[np.float64], radius: float | None, speed: float) -> None:
        """Puts one waypoint into the arm's queue. Raises MotionFailed if the arm dropped it.

        index: of the waypoint
        target: place [6] of the tool's centre
        radius: of the arc at the waypoint, mm; None for a stop there
        speed: m/s
        """
        self._interlock.heed_stop(label)
        place = dict(zip(("x", "y", "z", "roll", "pitch", "yaw"), target.tolist(), strict=True))
        pace = {"speed": 1000 * speed, "mvacc": 1000 * _ACCELERATION, "radius": radius}
        code = self._interlock.asking(
            label, lambda: self._arm.set_position(**place, **pace, is_radian=False, wait=False)
        )
        if code != 0:
            self._interlock.heed_stop(label)
            self._require_line(label, code)
        self._require_no_fault(label, index)
        if code != 0:
            self._state(label)
            said = (
                f"did not take waypoint {index} (the SDK's code {code}); it is stopped. Look at it, then connect anew."
            )
            raise self._failure(MotionFailed, label, said, code if isinstance(code, int) else None, index)

    def _wait(self, label: str, until: float) -> None:
        """Returns when the arm reports rest and an empty queue, and two polls show the same position."""
        seen, last, moved = 0, np.full(3, np.nan), np.full(3, np.inf)
        while seen < 2:
            self._interlock.heed_stop(label)
            self._require_no_fault(label, None)
            state = self._state(label)
            standing = state in _STANDING and self._number(label, "get_cmdnum") == 0
            here = self.pose()
            if state == _MOVING and float(np.linalg.norm(here - moved)) > _STILL:
                # An arm that moves is alive, also if its speed was reduced at its control box.
                moved, until, self._alive = here, max(until, time.monotonic() + PATIENCE), steady()
            seen = seen + 1 if standing and float(np.linalg.norm(here - last)) <= _STILL else 0
            last = here if standing else np.full(3, np.nan)
            if time.monotonic() > until:
                how = "is paused" if state == _PAUSED else "did not arrive in time"
                raise self._failure(MotionFailed, label, f"{how}, and is stopped now; look at it, then connect anew.")
            time.sleep(_POLL)

    def _require_ready(self, label: str, wanted: int = _POSITIONS) -> None:
        """Raises RobotError if the arm is not in a mode, that for positions, and ready in it."""
        if self._state(label) == _PAUSED:
            raise self._failure(RobotError, label, "is paused; let it go on there, then connect anew.")
        until = time.monotonic() + 1.0  # the mode comes with reports, five times a second
        while self._arm.mode != wanted:
            if time.monotonic() > until:
                said = (
                    f"is in mode {self._arm.mode} and not in {wanted}, for "
                    f"{'positions' if wanted == _POSITIONS else 'teaching'}; another program uses it. End that, then "
                    "connect anew."
                )
                raise self._failure(RobotError, label, said)
            time.sleep(_POLL)

    def _state(self, label: str) -> int:
        """Returns the arm's state.

        Raises RobotStopped if it was stopped at the arm, MotionFailed if its own fault stopped it, RobotError if it was
        reset.
        """
        state = self._number(label, "get_state")
        if state == _RESET:  # it has then dropped its queue (SDK issue 107)
            said = (
                "was reset, as by another program that changed its payload, its tool or its mode, and has dropped its "
                "motions. End that program, then connect anew."
            )
            raise self._failure(RobotError, label, said)
        if state in _STOPPED:
            self._require_no_fault(label, None)  # one that came after the last question
            said = "was stopped, by its switch or to protect somebody; look at it before it is connected anew."
            raise self._failure(RobotStopped, label, said)
        return state

    def _number(self, label: str, call: str) -> int:
        """Calls a question of the SDK whose answer is (code, number), and returns the number."""
        answer = self._interlock.asking(label, getattr(self._arm, call))
        if isinstance(answer, tuple | list) and len(answer) == 2:
            if answer[0] == 0 and isinstance(answer[1], int):
                return answer[1]
            self._require_line(label, answer[0])
        self._interlock.heed_stop(label)  # what a call answers that a stop broke off says nothing
        raise self._failure(RobotError, label, f"answered {str(answer)[:80]} to {call}; look at it.")

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
        raise self._failure(RobotError, label, f"answered {str(answer)[:80]} when asked for errors; look at it.")

    def _require_line(self, label: str, code: Any) -> None:
        """Raises RobotDisconnected if a code of the SDK means that the connection is lost or silent."""
        if code not in (*_GONE, *_SILENT):
            return
        said = "said nothing for some seconds, and is told to stop; look at it and at its network."
        if code in _GONE or not self._arm.connected:
            said = "is gone; look at its control box and its network. The arm may finish the motion that it has."
        raise self._interlock.fault(self._failure(RobotDisconnected, label, said))

    def _require_no_fault(self, label: str, waypoint: int | None) -> None:
        """Raises MotionFailed if the control box has an error or a warning: the SDK calls the latter a success."""
        error, warning = self._codes(label)
        if not error and not warning:
            return
        where = "" if waypoint is None else f" at waypoint {waypoint}"
        told = (
            f"error {_name(error, self._errors)}{where}. Look at it and clear the error at the arm; this program never "
            "does."
            if error
            else f"warning {_name(warning, self._warnings)}, and has dropped what it was told{where}. It is stopped. "
            "Look at the workspace and at its address, then connect anew."
        )
        raise self._failure(MotionFailed, label, f"has {told}", error or warning, waypoint)

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


def _blend(path: NDArray[np.float64]) -> list[float | None]:
    """Returns for each waypoint after the first of a path [n, 3] (m) the radius of its arc in mm, None for a stop.

    Arcs of neighbours must not overlap: the arm then fails with C25 (SDK issue 79).
    """
    length = np.linalg.norm(np.diff(path, axis=0), axis=1)
    radii = np.minimum(_BLEND, 0.4 * np.minimum(length[:-1], length[1:])).tolist()
    return [1000 * radius if radius > _SHORT else None for radius in radii] + [None]


def _name(code: int, names: Mapping[Any, Any]) -> str:
    title = names[code]["en"]["title"].rstrip(".") if code in names else ""
    return f"{code}: {title}" if title else f"{code} (see UFACTORY's manual)"


def _open(name: MachineName, workspace: Workspace) -> XarmRobot:
    name.require("brush_length")
    length = name.choose("brush_length", float, 0.0)
    return XarmRobot(name.where, require_home(name, workspace), workspace.travel_speed, length)


KIND = RobotKind(
    "xarm",
    "xarm:ADDRESS[,brush_length=METRES]",
    "UFACTORY xArm 6 and 7, Lite 6",
    open=_open,
    needed=_NEEDED,
    identify=lambda name: at_host(name.where),
)
