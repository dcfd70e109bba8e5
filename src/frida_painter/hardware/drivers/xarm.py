"""The robot kind `xarm`: UFACTORY's xArm 6, xArm 7 and Lite 6 through their SDK, in millimetres and degrees.

Neither the SDK nor this program clears an error: a person does that, at the arm.
"""

import socket
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from frida_painter.errors import ConfigError, FridaError, MotionFailed, RobotDisconnected, RobotError, RobotStopped
from frida_painter.hardware.deadline import within
from frida_painter.hardware.drivers.interlock import PATIENCE, Interlock, motion_timeout
from frida_painter.hardware.kinds import MachineName, Needed, RobotKind, at_host, require_home
from frida_painter.hardware.robot import MotionReport, Point, Waypoints, Workspace

Answer = TypeVar("Answer")

_NEEDED = Needed("pip install 'frida-painter[xarm]'", "xarm")
_CONTROL_PORT = 502
_OPENING, _CLOSING = 5.0, 1.0
_POLL = 0.02
_STILL = 1e-4  # metres between two polls
_MOVING, _STANDING, _PAUSED, _STOPPED = 1, (0, 2, 5), 3, (4, 6)
_ERRORS = {
    1: "the emergency stop at the control box was pressed",
    2: "the emergency input of the control box was triggered",
    3: "the three-state switch of the control box was pressed",
    19: "the end of the arm does not answer its control box",
    21: "a place that it cannot reach, or near one",
    22: "it would collide with itself",
    23: "a joint would turn beyond its limit",
    24: "a joint would be too fast",
    25: "it could not plan the way",
    31: "it ran into something",
    35: "beyond its own safety boundary",
}
"""Controller errors of UFACTORY that can occur while painting (xarm_api_code.md of the SDK)."""


@dataclass(frozen=True)
class XarmSettings:
    """Settings of an xArm.

    address: of the control box
    home: home position of the tip, metres
    approach: m/s to the first waypoint
    brush_length: from the arm's tool centre to the brush's tip, metres; 0 if the arm's own tool offset includes it
    tool: roll, pitch and yaw of the tool in degrees; the default points straight down
    blend: distance from a waypoint at which the arm may round the corner, metres
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


class XarmRobot:
    """Robot through UFACTORY's SDK. Implements hardware.robot.Robot. Stops use a separate connection."""

    def __init__(self, settings: XarmSettings) -> None:
        self.settings = settings
        self._interlock = Interlock(f"the xArm at {settings.address}")
        self._arm: Any = None
        self._stopper: Any = None
        self.serial_number = ""

    def connect(self) -> None:
        """Opens one connection for motions and one for stops, and enables the arm if it has no error.

        Raises RobotDisconnected if the address does not answer.
        Raises RobotError if the package is missing or the arm refuses a command, MotionFailed if it has an error,
        which only a person clears.
        """
        self.close()
        try:
            from xarm.wrapper import XArmAPI
        except ImportError as missing:
            raise RobotError(f"xArms need the package xarm-python-sdk; install it with: {_NEEDED.install}") from missing
        self._require_somebody()
        self._interlock.mark_connected()
        try:
            self._stopper = self._open_connection(XArmAPI)
            self._arm = self._open_connection(XArmAPI)
            self.serial_number = str(getattr(self._arm, "sn", None) or "")
            self._require_no_error("connect", None)
            for what, call in (
                ("motion_enable", lambda: self._arm.motion_enable(True)),
                ("set_mode", lambda: self._arm.set_mode(0)),
                ("set_state", lambda: self._arm.set_state(0)),
            ):
                self._require_done(what, self._interlock.asking(what, call))
            self.pose()
        except FridaError:
            self.close()
            raise

    def home(self) -> MotionReport:
        """Moves to the home position, first vertically."""
        here, aside = self.pose(), np.array(self.settings.home)
        above = np.array([here[0], here[1], max(here[2], aside[2])])
        return self.follow(Waypoints("home", np.stack((above, aside)), self.settings.approach))

    def pose(self) -> NDArray[np.float64]:
        """Returns the position of the tip, [3] metres. Raises RobotError if the answer is no position."""
        self._interlock.require_ready("pose")
        answer = self._interlock.asking("pose", lambda: self._arm.get_position(is_radian=False))
        try:
            code, place = answer
            position = np.array(place, dtype=np.float64)[:3]
        except (TypeError, ValueError):
            code, position = None, np.empty(0)
        if code != 0 or position.shape != (3,) or not np.isfinite(position).all():
            raise self._interlock.fault(
                RobotError(f"{self._interlock.name} said {str(answer)[:80]} when asked where it is; look at it.")
            )
        return position / 1000 - (0, 0, self.settings.brush_length)

    def follow(self, waypoints: Waypoints) -> MotionReport:
        """Moves along the waypoints in straight lines with slightly rounded corners; returns when the arm stands.

        Raises MotionFailed with UFACTORY's code, RobotDisconnected, or RobotStopped if it was stopped here or at
        the arm. The arm is then stopped.
        """
        self._interlock.require_ready(waypoints.label)
        self._interlock.require_path(waypoints)
        started = time.monotonic()
        try:
            away = float(np.linalg.norm(waypoints.position[0] - self.pose()))
            until = started + motion_timeout(waypoints.length, waypoints.speed)
            until += motion_timeout(away, self.settings.approach)
            for index in range(len(waypoints.position)):
                self._send(waypoints, index)
            self._wait(waypoints, until)
            reached = self.pose()
        except FridaError as error:
            self._interlock.fault(error)
            self._halt()
            raise
        return MotionReport(waypoints.label, started, time.monotonic(), reached)

    def stop(self) -> None:
        """Sets state 4 over the connection for stops: the arm stands and forgets its remaining motions."""
        self._interlock.stop()
        self._halt()

    def close(self) -> None:
        """Closes both connections."""
        arm, stopper, self._arm, self._stopper = self._arm, self._stopper, None, None
        self._interlock.mark_disconnected()
        for connection in (arm, stopper):
            if connection is not None:
                with suppress(RobotError):  # A connection that does not close in time is abandoned.
                    self._interlock.asking("close", connection.disconnect)

    def _require_somebody(self) -> None:
        """Checks that the control box answers, because the SDK would wait for long."""
        try:
            socket.create_connection((self.settings.address, _CONTROL_PORT), timeout=PATIENCE).close()
        except OSError as cause:
            raise RobotDisconnected(
                f"No xArm answers at {self.settings.address} ({cause.strerror or cause}); look whether its control box "
                "is on and in this computer's network, and whether the address is right."
            ) from cause

    def _open_connection(self, kind: Callable[..., Any]) -> Any:
        """Returns an open connection."""
        made = self._interlock.asking("connect", lambda: kind(self.settings.address, is_radian=False, do_not_open=True))
        try:
            self._interlock.asking("connect", made.connect, _OPENING)
        except RobotError:
            self._interlock.mark_disconnected()
            with suppress(RobotError):
                self._interlock.asking("close", made.disconnect, _CLOSING)
            raise
        return made

    def _send(self, waypoints: Waypoints, index: int) -> None:
        """Puts one waypoint into the arm's queue."""
        self._heed_stop(waypoints.label)
        x, y, z = (waypoints.position[index] + (0, 0, self.settings.brush_length)) * 1000
        roll, pitch, yaw = self.settings.tool
        last = index == len(waypoints.position) - 1
        speed = waypoints.speed if index else self.settings.approach

        def move() -> Any:
            return self._arm.set_position(
                x=float(x),
                y=float(y),
                z=float(z),
                roll=roll,
                pitch=pitch,
                yaw=yaw,
                radius=None if last else 1000 * self.settings.blend,
                speed=1000 * speed,
                mvacc=1000 * self.settings.acceleration,
                is_radian=False,
                wait=False,
            )

        code = self._interlock.asking(waypoints.label, move)
        if code != 0:
            self._heed_stop(waypoints.label)
            self._require_no_error(waypoints.label, index)
            self._state(waypoints.label)
            raise MotionFailed(
                f"{waypoints.label}: {self._interlock.name} did not take waypoint {index} (the SDK's code {code}); it "
                "is stopped. Look at it, then connect anew.",
                code if isinstance(code, int) else None,
                index,
            )

    def _wait(self, waypoints: Waypoints, until: float) -> None:
        """Returns when the arm reports rest and an empty queue, and two polls show the same position."""
        seen, last = 0, np.full(3, np.nan)
        while seen < 2:
            self._heed_stop(waypoints.label)
            self._require_no_error(waypoints.label, None)
            state = self._state(waypoints.label)
            standing = state in _STANDING and self._number(waypoints.label, "get_cmdnum") == 0
            here = self.pose() if standing else np.full(3, np.nan)
            seen = seen + 1 if float(np.linalg.norm(here - last)) <= _STILL else 0
            last = here
            if time.monotonic() > until:
                how = "is paused" if state == _PAUSED else "did not arrive in time"
                raise MotionFailed(
                    f"{waypoints.label}: {self._interlock.name} {how}, and is stopped now; look at it, then connect "
                    "anew."
                )
            time.sleep(_POLL)

    def _heed_stop(self, label: str) -> None:
        if self._interlock.stopped:
            raise RobotStopped(f"{label}: {self._interlock.name} was stopped; look at it before it is connected anew.")

    def _state(self, label: str) -> int:
        """Returns the arm's state. Raises RobotStopped if it was stopped at the arm."""
        state = self._number(label, "get_state")
        if state in _STOPPED:
            raise RobotStopped(
                f"{label}: {self._interlock.name} was stopped, by its switch or to protect somebody; look at it before "
                "it is connected anew."
            )
        return state

    def _number(self, label: str, call: str) -> int:
        """Calls a question of the SDK whose answer is (code, number), and returns the number."""
        answer = self._interlock.asking(label, getattr(self._arm, call))
        if isinstance(answer, tuple | list) and len(answer) == 2 and answer[0] == 0 and isinstance(answer[1], int):
            return answer[1]
        raise RobotError(f"{label}: {self._interlock.name} answered {str(answer)[:80]} to {call}; look at it.")

    def _require_no_error(self, label: str, waypoint: int | None) -> None:
        """Raises MotionFailed if the control box has an error."""
        answer = self._interlock.asking(label, self._arm.get_err_warn_code)
        try:
            code, (error, _) = answer
        except (TypeError, ValueError):
            code, error = None, None
        if error == 0 and code is not None:
            return
        if isinstance(error, int) and error != 0:
            meaning = f": {_ERRORS[error]}" if error in _ERRORS else ""
            where = "" if waypoint is None else f" at waypoint {waypoint}"
            raise MotionFailed(
                f"{label}: {self._interlock.name} has error {error}{meaning}{where}. Look at it and clear the error at "
                "the arm; this program never does.",
                error,
                waypoint,
            )
        raise RobotError(
            f"{label}: {self._interlock.name} answered {str(answer)[:80]} when asked for errors; look at it."
        )

    def _require_done(self, what: str, code: Any) -> None:
        if code != 0:
            raise RobotError(
                f"connect: {self._interlock.name} refused {what} with the SDK's code {str(code)[:40]}; look at it, and "
                "whether another program uses it."
            )

    def _halt(self) -> None:
        """Stops the arm over one connection; if that fails, over the other. Waits at most two seconds."""
        for connection in (self._stopper, self._arm):
            if connection is None:
                continue
            try:
                if within(1.0, f"{self._interlock.name}: stop", partial(connection.set_state, 4)) == 0:
                    return
            except Exception:  # after any exception of the library, the other connection is tried
                continue


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
