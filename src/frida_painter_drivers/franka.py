"""The robot kind `franka`: Franka Research 3 and Panda through franky, a client of libfranka.

A motion is planned as a whole before anything moves: the tip's path in time (Timing), the arm's joint angles along it
by the arm's own model, with the brush upright, and their limits. It is sent as one motion in joint angles. Neither
franky nor this program clears an error: a person does that, at the arm.
"""

import math
import platform
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from frida_painter import registry
from frida_painter.errors import MotionFailed, RobotDisconnected, RobotError, RobotStopped
from frida_painter.hardware.deadline import one_line, steady, within
from frida_painter.hardware.gateway import FASTEST
from frida_painter.hardware.interlock import PATIENCE
from frida_painter.hardware.kinds import MachineName, Needed, RobotKind, at_host, require_home
from frida_painter.hardware.robot import MachineFact, MotionReport, Point, Sense, Waypoints, Workspace
from frida_painter.hardware.timing import AxisTiming, Timing
from frida_painter_drivers.driver import Driver

_NEEDED = Needed(module="franky", extra="franka")
_POLL = 0.01
_PORT, _LISTENING = 1337, 0.1  # port of the control interface; seconds to wait for words of another device
_STILL, _APART = 2e-5, 0.02  # metres that a standing tip moves at most in so many seconds of the arm's clock
_SETTLING = 2.0  # seconds that the arm may take until it stands
_PERIOD = 0.02  # seconds between the joint angles of a motion
_ACCELERATION = 0.5  # m/s2 of the tip
_TURNING = 0.5  # rad/s of the hand, and of the elbow, as they come into the painting posture
_MAX_TURNED, _MAX_BENT = math.radians(75), math.radians(60)
_CONVERGED, _ITERATIONS = 1e-7, 20
_UPRIGHT = 0.5  # degrees from the vertical below which a brush is called upright
_DAMPING, _LONGEST_STEP = 1e-9, 0.2

# Metres above the first touch from which the second begins; the largest force, as a multiple of the touch force.
_ABOVE_TOUCH, _MAX_TIMES = 0.003, 3.0
_TOUCHES, _NEAR_LOWEST = 4, 2e-4  # attempts, because noise may end one; metres within which the lowest place is reached
_SMOOTHED, _ZEROS, _FITTED = 40, 10, 300  # forces that are averaged along the way and before it; those that are fitted

_NO_RATE = 1e-6  # rad/s below which a joint counts as resting: franky's planner fails at numbers near 0
_RESTING = 0.5  # seconds until it has come to rest
_SHARE_OF_SPEED = 0.7  # of the joints' speed limits

# franky plans from waypoint to waypoint while the arm moves. If packets are lost in between, its planner may find no
# way, and ends the motion.
_NO_WAY = "Motion planner failed"
_MAX_RESUMED = 5  # times that a motion goes on after that
_BEFORE, _AFTER = 100, 15  # periods around the one of the timetable in which the arm may stand then
_OFF_WAY = 0.01  # radians that a joint may be off its way then

_GUIDE = "guide"
_GUIDED = ("Idle", "Guiding", "UserStopped")  # a Panda is guided with its user stop pressed, too
_MODES = {
    "UserStopped": "its user stop is pressed, or its brakes are locked",
    "Reflex": "it is in a reflex: it ran into something or was commanded beyond its limits",
    "Guiding": "somebody guides it by hand",
    "Move": "another program moves it",
    "AutomaticErrorRecovery": "it recovers from an error",
    "Other": "it is in no state for motions",
}
_REMEDY = {
    "UserStopped": "release the user stop and unlock the brakes in Desk",
    "Reflex": "look at it, free it, then press and release its user stop, or clear the error in Desk; this program "
    "never does",
    "Guiding": "let it go",
    "Move": "end the other program",
    "AutomaticErrorRecovery": "wait until it stands",
    "Other": "look at Desk",
}


_JOINT_MARGIN = math.radians(3)
_LOWER_JOINTS = np.array([-2.7437, -1.7837, -2.9007, -3.0421, -2.8065, 0.5445, -3.0159])
_UPPER_JOINTS = np.array([2.7437, 1.7837, 2.9007, -0.1518, 2.8065, 4.5169, 3.0159])
# Joint limits of the Franka Research 3 in radians, which are inside those of the Panda (Franka's data sheet), and the
# margin that is kept from them.
_STARTING = 10  # periods at the beginning of a path, in which the arm accelerates

# Lengths of the arm in metres (Denavit-Hartenberg table of Franka's documentation), from its base to the tool frame
# of its hand: to the shoulder, to the elbow and to the wrist, with the elbow's offset, and the offset and length of
# the hand.
_SHOULDER, _UPPER, _FORE, _ELBOW, _WRIST, _HAND = 0.333, 0.316, 0.384, 0.0825, 0.088, 0.107 + 0.1034


@dataclass(frozen=True)
class FrankaReach:
    """Reach of a Franka with its hand, the brush upright and the elbow up: inverse kinematics in closed form.

    The driver itself solves with the model that the arm sends; this one is known before the arm is.

    brush_length, turn: as in FrankaRobot
    """

    brush_length: float
    turn: float = 0.0

    def reachable(self, position: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Returns True for each position [k, 3] (m) that the tip reaches within the limits of all joints: [k]."""
        return np.asarray(_is_within_limits(self.solve(position)).all(1))

    def solve(self, position: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns the joint angles [k, 7] (radians) at positions [k, 3] (m); NaN at those beyond the arm's length."""
        x, y, z = np.asarray(position, np.float64).T
        across = np.hypot(x, y) - _WRIST
        up = z + self.brush_length + _HAND - _SHOULDER
        upper, fore = math.hypot(_UPPER, _ELBOW), math.hypot(_FORE, _ELBOW)
        bent_upper, bent_fore = math.atan2(_ELBOW, _UPPER), math.atan2(_ELBOW, _FORE)
        away = np.hypot(across, up)
        with np.errstate(invalid="ignore", divide="ignore"):
            at_elbow = np.arccos((upper**2 + fore**2 - away**2) / (2 * upper * fore))
            at_shoulder = np.arccos((upper**2 + away**2 - fore**2) / (2 * upper * away))
        base, rest = np.arctan2(y, x), np.zeros_like(x)
        second = np.arctan2(across, up) - at_shoulder - bent_upper
        fourth = at_elbow - math.pi - bent_upper - bent_fore
        last = math.pi / 4 + base - math.radians(self.turn)
        last = (last + math.pi) % (2 * math.pi) - math.pi
        return np.stack([base, second, rest, fourth, rest, second - fourth, last], -1)


def resume_path(joints: NDArray[np.float64], here: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns joint angles [m, 7] at every period for the rest of a path, from rest at a place beside its first angles.

    joints [n, 7]: at every period, the first beside the standing arm, the last at rest
    here [7]: angles of the standing arm
    """
    left = len(joints) - 1
    start = np.arange(2 * _STARTING) ** 2 / (4 * _STARTING)  # periods of the path, from rest to full speed
    along = np.r_[start, np.arange(_STARTING, max(_STARTING, left) + 1)] * min(1.0, left / _STARTING)
    path = np.stack([np.interp(along, np.arange(left + 1), joint) for joint in joints.T], 1)
    share = np.minimum(1, np.arange(len(path)) / len(start))
    return path + (here - joints[0]) * (1 - share**2 * (3 - 2 * share))[:, None]


class FrankaRobot(Driver):
    """Robot through franky. Implements Reach, GuidedRobot and TouchProbe as well.

    address: of the control cabinet or of the arm's base
    brush_length: from the arm's tool frame to the brush's tip along the tool, metres
    turn: of the hand about the vertical, degrees; 0 as in the arm's usual start posture
    force: N and Nm on the arm above which it stops by reflex
    touch_force: N on the brush that count as a touch

    The arm allows one client. A stop goes over the same connection, beside the motion's thread.
    """

    def __init__(
        self,
        address: str,
        resting: Point,
        approach: float = 0.15,
        brush_length: float = 0.0,
        turn: float = 0.0,
        force: float = 20.0,
        touch_force: float = 1.5,
    ) -> None:
        super().__init__(f"the Franka at {address}", resting, approach)
        self._require_between("a brush length", brush_length, 0, 1, "m")
        self._require_between("a turn", turn, -180, 180, "degrees")
        self._require_between("a force", force, 5, 100, "N")
        self._require_between("a touch force", touch_force, 0.2, 10, "N")
        self.address, self.brush_length, self._turn = address, brush_length, turn
        self._force_limit, self._touch_force = force, touch_force
        self._upright = Rotation.from_euler("xz", (180, turn), degrees=True)
        self._timing = Timing(_ACCELERATION, smoothing=0.1, period=_PERIOD)
        self._told_at = -1.0
        self._moved = 0.0  # seconds, by the arm's clock, of its last motion
        self._franky: Any = None
        self._arm: Any = None

    # Connection.

    def _open(self, *, examines: bool) -> None:
        """Loads franky, opens a connection, and checks that the arm obeys and has no error."""
        with registry.importing("franka", "A Franka", RobotError):
            import franky
        self._franky = franky
        self._arm = self._open_connection()
        if not examines:
            self._require_idle("connect")
            self.pose()

    def close(self) -> None:
        """Disconnects from the arm."""
        self._arm = None  # franky closes a connection when nothing refers to it
        self._interlock.mark_disconnected()

    def pose(self) -> NDArray[np.float64]:
        """Returns the position of the tip, [3] metres. Raises RobotError if the arm's answer is no position."""
        self._interlock.require_ready("pose")
        return self._tip(self._state("pose"))

    # Guiding by a person's hand.

    def begin_guiding(self) -> None:
        """Connects and reads the tip. A Franka is released by the buttons at its hand. Implements GuidedRobot."""
        with self._opening():
            self._open(examines=True)
            self.guided_tip()

    def guided_tip(self) -> NDArray[np.float64]:
        """Returns the tip [3] (m), the brush tilted or not.

        Raises RobotError and its subclasses if another program moves the arm, or it is at fault.
        """
        self._interlock.require_ready(_GUIDE)
        state = self._state(_GUIDE)
        if state.robot_mode.name not in _GUIDED:
            raise self._refusal(_GUIDE, state)
        return self._tip(state)

    def end_guiding(self) -> None:
        """Disconnects; the arm holds its place as soon as its buttons are let go."""
        self.close()

    # Limits and state for people.

    def reachable(self, position: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Returns True for each position [k, 3] that the arm reaches with its hand and the brush upright: [k]."""
        return FrankaReach(self.brush_length, self._turn).reachable(position)

    def timing(self) -> AxisTiming:
        """Returns the limits of the planned motions. Implements hardware.robot.TimedRobot."""
        return self._timing.tell(FASTEST, _RESTING)

    def _facts(self) -> Iterator[MachineFact]:
        state = self._state("examine")
        x, y, z = self._tip(state)
        yield MachineFact(f"The brush's tip is at ({x:.3f}, {y:.3f}, {z:.3f}) m of the arm's base.")
        mode = state.robot_mode.name
        if mode == "Idle":
            yield MachineFact("The arm is idle and ready for motions.")
        else:
            errors = "".join(f", {error}" for error in _names(state.current_errors))
            yield MachineFact(f"The arm does not move: {_MODES[mode]}{errors}; {_REMEDY[mode]}.", "refusal")
        if ended := _names(state.last_motion_errors):
            yield MachineFact(f"Its last motion ended with {', '.join(ended)}.", "warning")
        near = np.minimum(np.array(state.q) - _LOWER_JOINTS, _UPPER_JOINTS - np.array(state.q))
        joint = int(near.argmin())
        yield MachineFact(
            f"Joint {joint + 1} is nearest to its limit: {math.degrees(near[joint]):.0f} degrees away.",
            "fact" if near[joint] >= _JOINT_MARGIN else "warning",
        )
        if state.m_total > 0:
            yield MachineFact(f"It reckons with {state.m_total:.2f} kg at its flange.")
        else:
            yield MachineFact(
                "It reckons with no weight at its flange, so that it feels forces that are none; enter hand and brush "
                "in Desk.",
                "warning",
            )
        if self.brush_length == 0:
            yield MachineFact(
                "No brush length is given (brush_length=METRES): the arm's own tool frame must end at the brush's tip.",
                "warning",
            )
        if not _has_realtime():
            yield MachineFact(
                "This computer's kernel does not run programs in real time (PREEMPT_RT): if it is busy, the arm may "
                "give up a motion for lack of commands; install such a kernel, or run nothing else beside.",
                "warning",
            )

    # Motions.

    def _go(self, waypoints: Waypoints) -> NDArray[np.float64]:
        """Moves along the waypoints as one motion.

        The brush is turned upright about its tip before that. The tip slows down before corners and stops in sharp
        ones.
        Raises MotionFailed before anything moves if a waypoint is beyond the arm's reach or a joint would be too fast.
        """
        self._require_idle(waypoints.label)
        self._perform(waypoints.label, self._plan(waypoints, self.approach))
        return self._settle(waypoints.label)

    def feels(self) -> Sense:
        """Returns that the arm measures the force of the touch."""
        return "force"

    def touch(self, lowest: float, speed: float) -> MotionReport:
        """Moves straight down until the arm feels the canvas. Implements hardware.robot.TouchProbe.

        It touches twice: the second time slowly from just above. The height of the touch is where the line through
        the forces begins, so that it does not depend on how far the brush bends. `reached` is there.

        lowest: robot z in metres at which the motion ends; `reached` is there if nothing was felt
        speed: m/s
        Raises MotionFailed if the force is far above the one that counts as a touch, and the errors of `follow`.
        """
        label = "touch"
        self._interlock.require_ready(label)
        started, here = time.monotonic(), self.pose()
        low = np.array([*here[:2], lowest])
        self._interlock.require_path(Waypoints(label, low[None], speed))
        for _ in range(_TOUCHES):
            found = self._contact(self._feel(label, low, speed))
            if found is not None or self.pose()[2] <= lowest + _NEAR_LOWEST:
                break
        else:
            said = (
                "feels a force that changes although nothing touches the brush; enter the weight of hand and brush in "
                "Desk, or let a larger force count (touch_force=NEWTON)."
            )
            raise self._interlock.fault(self._failure(MotionFailed, label, said))
        if found is not None:
            above = np.array([[*here[:2], min(found + _ABOVE_TOUCH, float(here[2]))]])
            self.follow(Waypoints(label, above, self.approach))
            finer = self._contact(self._feel(label, low, speed / 4))
            found = found if finer is None else finer
            self.follow(Waypoints(label, np.array([[*here[:2], max(found, lowest)]]), speed))
        return MotionReport(label, started, time.monotonic(), self.pose())

    def _feel(self, label: str, low: NDArray[np.float64], speed: float) -> NDArray[np.float64]:
        """Moves down until the force changes, and returns z in metres and the vertical force in newton [n, 2].

        The arm itself watches the force, at every millisecond. The estimate of a standing arm is off by some newton,
        so that the first part of the way down, on which nothing is touched, is its zero.
        """
        with self._moving():
            self._require_idle(label)
            zero = self._mean_force(label)
            state = self._state(label)
            joints = self._plan(Waypoints(label, low[None], speed), speed)
            felt: list[tuple[NDArray[np.float64], float]] = []
            self._perform(label, joints, felt=felt, zero=zero)
            self._settle(label)
            force, counts = abs(self._mean_force(label) - zero), self._touch_force
            if not force <= _MAX_TIMES * counts:
                said = (
                    f"pressed with {force:.1f} N, and a touch counts from {counts:g} N: something stiff is under the "
                    "brush, or it came too fast. Look at it, and touch more slowly."
                )
                raise self._failure(MotionFailed, label, said)
        return np.array([(self._pose_of(angles, state)[0][2], force) for angles, force in felt]).reshape(-1, 2)

    def _contact(self, samples: NDArray[np.float64]) -> float | None:
        """Returns the height in metres at which the force sets in; None if none was felt."""
        if len(samples) < 3 * _SMOOTHED:
            return None
        even = np.full(_SMOOTHED, 1 / _SMOOTHED)
        z, force = (np.convolve(column, even, "valid") for column in samples.T)
        force = np.abs(force - np.median(force[: len(force) // 3]))
        most = float(force.max())
        if not most >= self._touch_force / 2:
            return None
        last = int(force.argmax()) + 1
        thin = max(1, last // _FITTED)
        return _onset(z[:last:thin], force[:last:thin])

    def _mean_force(self, label: str) -> float:
        return float(np.mean([_force(self._state(label)) for _ in range(_ZEROS)]))

    def _plan(self, waypoints: Waypoints, approach: float) -> NDArray[np.float64]:
        """Returns joint angles [n, 7] at every period, from rest to rest. Raises MotionFailed.

        The hand is turned upright and the elbow up first, while the tip stays in place.

        approach: m/s to the first waypoint
        """
        label = waypoints.label
        state = self._state(label)
        start = np.array(state.q_d, np.float64)
        tip, matrix = self._pose_of(start, state)
        rotation = Rotation.from_matrix(matrix)
        off = self._upright * rotation.inv()
        angle = float(off.magnitude())
        if not (angle <= _MAX_TURNED and abs(start[2]) <= _MAX_BENT):
            raise MotionFailed(
                f"{label}: the hand of {self._interlock.name} is turned by {math.degrees(angle):.0f} degrees from "
                f"upright, and its elbow by {math.degrees(start[2]):.0f} degrees; up to "
                f"{math.degrees(_MAX_TURNED):.0f} and {math.degrees(_MAX_BENT):.0f} are put right by itself. Guide the "
                "arm by hand until the brush points straight down and the elbow up. It did not move."
            )
        steps = max(1, math.ceil(max(angle, abs(start[2])) / _TURNING / _PERIOD))
        share = np.linspace(0, 1, steps + 1)[1:]
        share = share**2 * (3 - 2 * share)
        turned = (Rotation.from_rotvec(share[:, None] * off.as_rotvec()) * rotation).as_matrix()
        path = np.concatenate([tip[None], waypoints.position])
        speed = np.r_[approach, np.full(len(waypoints.position) - 1, waypoints.speed)]
        places = self._timing.places(path, speed)
        upright = np.broadcast_to(self._upright.as_matrix(), (len(places), 3, 3))
        joints = self._solve(
            label,
            start,
            np.concatenate([np.tile(tip, (steps, 1)), places]),
            np.concatenate([turned, upright]),
            np.r_[(1 - share) * start[2], np.zeros(len(places))],
            state,
        )
        self._require_slow(label, joints)
        return joints

    def _solve(
        self,
        label: str,
        seed: NDArray[np.float64],
        tips: NDArray[np.float64],
        rotations: NDArray[np.float64],
        elbow: NDArray[np.float64],
        state: Any,
    ) -> NDArray[np.float64]:
        """Returns joint angles [1 + n, 7] for a seed [7], tips [n, 3], rotations [n, 3, 3] and third joints [n].

        Newton's method on the arm's own model, each place from the one before. Raises MotionFailed.
        """
        joints = [seed]
        for tip, rotation, third in zip(tips, rotations, elbow, strict=True):
            angles = joints[-1].copy()
            for _ in range(_ITERATIONS):
                here, turned = self._pose_of(angles, state)
                lever = self.brush_length * turned[:, 2]
                off = np.r_[tip - here, Rotation.from_matrix(rotation @ turned.T).as_rotvec(), third - angles[2]]
                if np.abs(off).max() <= _CONVERGED:
                    break
                jacobian = np.vstack([self._jacobian(angles, state, lever), np.eye(7)[2]])
                step = np.linalg.solve(jacobian + _DAMPING * np.eye(7), off)
                angles = angles + step * min(1.0, _LONGEST_STEP / float(np.abs(step).max()))
            else:
                angles = np.full(7, np.nan)
            if not _is_within_limits(angles).all():
                place = ", ".join(f"{metres:.3f}" for metres in tip)
                angle = math.degrees(math.acos(min(1.0, max(-1.0, -float(rotation[2, 2])))))
                how = "upright" if angle < _UPRIGHT else f"still {angle:.0f} degrees from upright"
                said = (
                    f"does not reach ({place}) m with the brush {how}; move the canvas nearer to it, or the other way "
                    "round. It did not move."
                )
                raise self._failure(MotionFailed, label, said)
            joints.append(angles)
        return np.array(joints)

    def _require_slow(self, label: str, joints: NDArray[np.float64]) -> None:
        """Raises MotionFailed if a joint would turn faster than the arm's limits allow."""
        fastest = np.abs(np.diff(joints, axis=0)).max(0) / _PERIOD
        allowed = _SHARE_OF_SPEED * np.array(self._arm.joint_velocity_limit.get())
        if not (fastest <= allowed).all():
            worst = int((fastest / allowed).argmax())
            raise MotionFailed(
                f"{label}: joint {worst + 1} of {self._interlock.name} would turn at {fastest[worst]:.2f} rad/s, and "
                f"{allowed[worst]:.2f} rad/s are allowed; lower the speed, or move the canvas away from the arm's "
                "base. It did not move."
            )

    def _perform(
        self,
        label: str,
        joints: NDArray[np.float64],
        felt: list[tuple[NDArray[np.float64], float]] | None = None,
        zero: float = 0.0,
    ) -> None:
        """Sends joint angles as one motion and returns when the arm has taken the last of them.

        A motion for which franky finds no way any more goes on from where the arm stands. One that feels does not.

        felt: receives the joint angles and the vertical force (N) at every millisecond; the motion then also ends if
            that force differs from `zero` by the touch force
        """
        for _ in range(_MAX_RESUMED + 1):
            motion = self._make_motion(joints)
            if felt is not None:
                force, enough = self._franky.Measure.FORCE_Z - zero, self._touch_force
                stop = self._franky.JointStopMotion()
                motion.add_reaction(self._franky.JointPositionReaction((force > enough) | (force < -enough), stop))
                motion.register_callback(lambda state, *_: felt.append((np.array(state.q, np.float64), _force(state))))
            self._interlock.heed_stop(label)
            self._ask(label, partial(self._arm.move, motion, asynchronous=True))
            if self._wait(label, _PERIOD * len(joints)):
                return
            if felt is not None:
                break
            joints = self._rest(label, joints)
        said = (
            "lost its way, and stands; packets to it are lost. Look at the network and at what else this computer "
            "does, then connect anew."
        )
        raise self._failure(MotionFailed, label, said)

    def _make_motion(self, joints: NDArray[np.float64]) -> Any:
        franky = self._franky
        rates = np.zeros_like(joints)
        rates[1:-1] = (joints[2:] - joints[:-2]) / (2 * _PERIOD)
        rates[np.abs(rates) < _NO_RATE] = 0.0
        period = franky.Duration(round(1000 * _PERIOD))
        return franky.JointWaypointMotion([
            franky.JointWaypoint(franky.JointState(angles, rate), minimum_time=period)
            for angles, rate in zip(joints[1:], rates[1:], strict=True)
        ])  # fmt: skip

    def _rest(self, label: str, joints: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns the joint angles of the rest of a motion that ended on its way, from rest where the arm stands.

        Raises MotionFailed if the arm is not idle, or stands beside the way.
        """
        self._settle(label)
        self._require_idle(label)
        here = np.array(self._state(label).q_d, np.float64)
        due = round(self._moved / _PERIOD)
        near = slice(max(0, due - _BEFORE), max(1, due + _AFTER))
        off = np.abs(joints[near] - here).max(1)
        if not off.min() <= _OFF_WAY:
            said = (
                f"stands {off.min():.3f} rad beside its way after packets were lost; {_OFF_WAY} are allowed. Look at "
                "it, then connect anew."
            )
            raise self._failure(MotionFailed, label, said)
        rest = resume_path(joints[near.start + int(off.argmin()) :], here)
        self._require_slow(label, rest)
        return rest

    def _wait(self, label: str, seconds: float) -> bool:
        """Returns True when the motion has ended, False if franky found no way any more.

        Its time limit counts on the arm's own clock.
        """

        def join() -> bool | None:
            try:
                return bool(self._arm.join_motion(_POLL))
            except RuntimeError as failure:
                if not str(failure).startswith(_NO_WAY):
                    raise
                return None

        began = self._clock(label)
        while not (ended := self._ask(label, join)):
            self._moved = self._clock(label) - began
            if ended is None:
                return False
            self._interlock.heed_stop(label)
            if not self._moved <= 1.5 * seconds + PATIENCE:
                said = "did not arrive in time, and is stopped now; look at it, then connect anew."
                raise self._failure(MotionFailed, label, said)
        self._interlock.heed_stop(label)
        return True

    def _settle(self, label: str) -> NDArray[np.float64]:
        """Returns the tip's position when it stands. Raises MotionFailed if the arm does not come to rest."""
        before = self._state(label)
        began = before.time.to_sec()
        while True:
            time.sleep(_POLL)
            self._interlock.heed_stop(label)
            state = self._state(label)
            now = state.time.to_sec()
            if now - before.time.to_sec() < _APART:
                continue
            here = self._tip(state)
            if float(np.linalg.norm(here - self._tip(before))) <= _STILL:
                return here
            if not now - began <= _SETTLING:
                raise self._failure(MotionFailed, label, "does not come to rest; look at it.")
            before = state

    # The arm's state and model.

    def _state(self, label: str) -> Any:
        state = self._ask(label, lambda: self._arm.state)
        if (now := state.time.to_sec()) != self._told_at:  # an arm whose clock advances is alive
            self._told_at, self._alive = now, steady()
        return state

    def _clock(self, label: str) -> float:
        return float(self._state(label).time.to_sec())

    def _tip(self, state: Any) -> NDArray[np.float64]:
        """Returns the tip [3] by the measured joint angles. (franky-sim reports the desired pose as the measured.)"""
        tip, _ = self._pose_of(np.array(state.q, np.float64), state)
        if not np.isfinite(tip).all():
            raise self._interlock.fault(RobotError(f"{self._interlock.name} does not know where it is; look at it."))
        return tip

    def _pose_of(self, angles: NDArray[np.float64], state: Any) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Returns the tip [3] and the tool's rotation [3, 3] for joint angles, by the arm's model."""
        matrix = self._arm.model.pose(self._franky.Frame.EndEffector, angles, state.F_T_EE, state.EE_T_K).matrix
        return matrix[:3, 3] + self.brush_length * matrix[:3, 2], matrix[:3, :3]

    def _jacobian(self, angles: NDArray[np.float64], state: Any, lever: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns the Jacobian [6, 7] of the tip, which is `lever` [3] from the tool frame."""
        plain = self._arm.model.zero_jacobian(self._franky.Frame.EndEffector, angles, state.F_T_EE, state.EE_T_K)
        moved = np.array(plain)
        moved[:3] += np.cross(plain[3:].T, lever).T
        return moved

    def _require_idle(self, label: str) -> None:
        """Raises RobotStopped, MotionFailed or RobotError unless the arm is ready for a motion."""
        state = self._state(label)
        if state.robot_mode.name != "Idle":
            raise self._refusal(label, state)

    def _refusal(self, label: str, state: Any, because: str = "") -> RobotError:
        """Returns the error of an arm that is not ready, or that ended a motion by itself."""
        mode, errors = state.robot_mode.name, _names(state.current_errors)
        if because:
            errors = errors or _names(state.last_motion_errors)
        because = because or ", ".join(errors)
        said = f"does not move, {_MODES[mode]}{f' ({because})' if because else ''}; {_REMEDY[mode]}."
        if mode == "Reflex":
            return self._failure(MotionFailed, label, said, errors[0] if errors else "reflex")
        return self._failure(RobotStopped if mode == "UserStopped" else RobotError, label, said)

    # Calls into franky.

    def _open_connection(self) -> Any:
        """Returns an open connection. Raises RobotDisconnected if nobody answers; libfranka would wait for a minute."""
        config = self._franky.RealtimeConfig
        try:
            self._interlock.asking("connect", self._require_protocol, 2 * PATIENCE)
            return self._ask(
                "connect",
                lambda: self._franky.Robot(
                    self.address,
                    default_torque_threshold=self._force_limit,
                    default_force_threshold=self._force_limit,
                    realtime_config=config.Enforce if _has_realtime() else config.Ignore,
                ),
            )
        except RobotDisconnected as silence:
            raise RobotDisconnected(
                f"No Franka answers at {self.address} ({silence.__cause__ and one_line(silence.__cause__)}); look "
                "whether it is on and in this computer's network, whether FCI is activated in Desk, whether another "
                "program is connected to it, and whether the address is right."
            ) from silence

    def _require_protocol(self) -> None:
        """Raises RobotDisconnected unless somebody listens at the address and says nothing before it is asked.

        libfranka takes the first bytes for the length of a message: another device made it reserve gigabytes.
        """
        try:
            with socket.create_connection((self.address, _PORT), timeout=PATIENCE) as probe:
                probe.settimeout(_LISTENING)
                said = probe.recv(16)
        except TimeoutError:
            return
        except OSError as failure:
            raise RobotDisconnected("connect: nobody is there") from failure
        why = ConnectionError("another device answers there" if said else "closed at once")
        raise RobotDisconnected(f"connect: {why}") from why

    def _ask(self, label: str, call: Callable[[], Any]) -> Any:
        """Returns the result of a call into franky; its errors become ours and block all further motions."""
        try:
            return self._interlock.asking(label, lambda: self._translate(label, call))
        except RobotError as error:
            raise self._interlock.fault(error) from error.__cause__

    def _translate(self, label: str, call: Callable[[], Any]) -> Any:
        franky = self._franky
        try:
            return call()
        except franky.IncompatibleVersionException as other:
            said = (
                "has other system software than this franky-control speaks ({}); install the package for its version, "
                "as franky's FAQ tells."
            )
            raise self._failure(RobotError, label, said.format(one_line(other))) from other
        except franky.RealtimeException as lacking:
            said = "needs a computer whose kernel lets programs run in real time ({})."
            raise self._failure(RobotError, label, said.format(one_line(lacking))) from lacking
        except (franky.ControlException, franky.CommandException) as refused:
            if self._interlock.stopped:
                said = "was stopped; look at it before it is connected anew."
                raise self._failure(RobotStopped, label, said) from refused
            state = self._answer()
            if state is not None and state.robot_mode.name in ("UserStopped", "Reflex"):
                raise self._refusal(label, state, one_line(refused)) from refused
            said = "gave the motion up ({}); look at it, then connect anew."
            raise self._failure(MotionFailed, label, said.format(one_line(refused))) from refused
        except (franky.NetworkException, RuntimeError) as failure:  # also of its planner, or of its network library
            if not isinstance(failure, franky.NetworkException) and self._answer() is not None:
                said = "could not make the motion ({}); look at it, then connect anew."
                raise self._failure(MotionFailed, label, said.format(one_line(failure))) from failure
            raise RobotDisconnected(
                f"{label}: the connection to {self._interlock.name} is lost or was refused ({one_line(failure)}); look "
                "at it and at its cable, activate FCI in Desk, and end other programs that use it."
            ) from failure

    def _answer(self) -> Any:
        """Returns the arm's state after a failure; None if it does not answer."""
        try:
            return self._arm.state
        except Exception:  # of any kind: the failure itself is told
            return None

    def _halt(self) -> None:
        """Tells the arm to brake at once; it gives up its motion. Waits at most a second."""
        if self._arm is not None:
            with suppress(Exception):  # any exception of the library: the interlock holds all the same
                within(1.0, f"{self._interlock.name}: stop", lambda: self._arm.stop())


def _is_within_limits(joints: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Returns True for joint angles [..., 7] (radians) within the limits of the arm, less a margin: [..., 7]."""
    return np.asarray((joints >= _LOWER_JOINTS + _JOINT_MARGIN) & (joints <= _UPPER_JOINTS - _JOINT_MARGIN))


def _force(state: Any) -> float:
    """Returns the vertical force in newton between brush and canvas, off by a constant; its sign is not used."""
    return float(np.array(state.O_F_ext_hat_K)[2])


def _onset(z: NDArray[np.float64], force: NDArray[np.float64]) -> float:
    """Returns the height at which a force sets in: zero above it, and linear in the height below it, with a jump.

    z: descending heights [n]; force: [n], from about 0 to its greatest

    Every height is tried, and that with the least squares is taken. The line's own zero counts if it is lower, because
    hairs that bend begin without a jump.
    """
    best, found = math.inf, float(z[-1])
    for first in range(1, len(z) - 3):
        slope, constant = np.polyfit(z[first:], force[first:], 1)
        error = float((force[:first] ** 2).sum() + ((force[first:] - slope * z[first:] - constant) ** 2).sum())
        if error < best:
            best = error
            found = min(float(z[first - 1]), -float(constant / slope)) if slope < 0 else float(z[first - 1])
    return found


def _names(errors: Any) -> list[str]:
    return [name for name in dir(errors) if not name.startswith("_") and getattr(errors, name) is True]


def _has_realtime() -> bool:
    return "PREEMPT_RT" in platform.version().replace(" ", "_")


def _open(name: MachineName, workspace: Workspace) -> FrankaRobot:
    name.require("brush_length", "turn", "force", "touch_force")
    given = {option: name.choose(option, float, 0.0) for option in name.options}
    return FrankaRobot(name.where, require_home(name, workspace), workspace.travel_speed, **given)


KIND = RobotKind(
    "franka",
    "franka:ADDRESS[,brush_length=METRES][,turn=DEGREES][,force=NEWTON][,touch_force=NEWTON]",
    "Franka Research 3 and Panda",
    open=_open,
    needed=_NEEDED,
    identify=lambda name: at_host(name.where),
)
