"""The robot kind `so101`: the SO-101 of hobbyists, six STS3215 servos on a bus, through Feetech's SDK.

The sixth closes the gripper, which holds the brush along its fixed jaw (docs/images/so101-brush.svg). It is held closed
as it was found. An arm with a holder in its place lacks it.

Its gears have about a degree of play, which `check` tells in millimetres at the tip. A motion is planned as a whole
before anything moves: the tip's path in time (Timing), the joint angles along it with the brush upright (mink), their
limits and speeds. The goals are then sent every 20 ms, never faster: a computer that was busy does not catch up.
"""

import math
import threading
import time
from collections.abc import Callable, Iterator
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from frida_painter import registry
from frida_painter.errors import MotionFailed, RobotDisconnected, RobotError
from frida_painter.hardware.deadline import one_line, steady
from frida_painter.hardware.gateway import FASTEST
from frida_painter.hardware.kinds import MachineName, Needed, RobotKind, at_port, find_port, remember_port, require_home
from frida_painter.hardware.robot import MachineFact, Point, Waypoints, Workspace
from frida_painter.hardware.timing import AxisTiming, Timing
from frida_painter_drivers.driver import Driver

Answer = TypeVar("Answer")
_NEEDED = Needed(module="scservo_sdk", extra="so101")
_PERIOD = 0.02  # seconds between two goals
_EVERY = 5  # goals between two reports of the servos
_SETTLING, _STILL = 2.0, 2  # seconds to come to rest; steps that a resting servo moves at most
_BEHIND, _AWAY = math.radians(8), math.radians(3)  # that a moving, a resting joint may be away from its goal
_STOPPING = 1.0  # seconds that a stop waits for a packet under way
_RESTING = 0.08  # seconds until the servos are known to stand
_JOINT_MARGIN = math.radians(2)
_ACCELERATION = 0.3  # m/s2 of the tip

# Inverse kinematics by mink: costs of a metre off, of the sine of the tilt, and of a radian of the wrist's roll;
# radians that the last step changed; errors of a solution.
_TILTING, _ROLLING = 0.1, 1e-3
_CONVERGED, _ITERATIONS = 1e-6, 60
_MISSED, _UPRIGHT = 1e-4, math.radians(1)

# Registers of the STS3215 (Feetech's memory table): address of the first byte.
_BAUD = 1_000_000
_MODEL, _STS3215, _MIN_ANGLE, _MAX_ANGLE, _MODE, _TORQUE, _GOAL = 3, 777, 9, 11, 33, 40, 42
_POSITION, _LOAD, _VOLTAGE = 56, 60, 62  # the byte after the voltage is the temperature
_SIGN = 0x8000  # of a position or goal, whose other bits are its amount
_STEPS, _MIDDLE, _STEP = 4096, 2048, 2 * math.pi / 4096  # a step in radians
_WEAK, _WARM = 6.0, 55  # volts and degrees Celsius from which `doctor` warns
_ERRORS = {1: "its voltage is wrong", 2: "its angle sensor fails", 4: "it is too hot", 8: "its current is too high",
           32: "it is overloaded"}  # fmt: skip

JOINTS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll")
"""Joints in the order of their servos, which have the numbers 1 to 5."""
_GRIPPER = 6
LIMITS = np.array([1.91986, 1.74533, 1.69, 1.65806, 2.79253])
"""Greatest angle of each joint to both sides of its middle, radians (The Robot Studio's model of the SO-101)."""
PLAY = math.radians(1.0)
"""Play of the gears of each joint, radians: what users measure at STS3215 servos."""
_MAX_RATE = 3.0  # rad/s of a joint; the servo does about 4.7 at 7.4 V

# Chain of the arm: origin (m) and fixed-axis angles (rad) of each joint in the frame before it, as in the same model.
# Around it a frame of our own: its origin is on the table below the first joint, x forward, y to the left.
_CHAIN = """<mujoco><compiler angle="radian" eulerseq="XYZ"/><default><geom size="0.01"/></default><worldbody>
<body pos="-0.0230745 -0.0207909 0" euler="0 0 1.57079633">
<body pos="0.0207909 -0.0230745 0.0948817" euler="-3.14159265 0 1.57079633"><joint name="shoulder_pan"/><geom/>
<body pos="-0.0303992 -0.0182778 -0.0542" euler="-1.57079633 -1.57079633 0"><joint name="shoulder_lift"/><geom/>
<body pos="-0.11257 -0.028 0" euler="0 0 1.57079633"><joint name="elbow_flex"/><geom/>
<body pos="-0.1349 0.0052 0" euler="0 0 -1.57079633"><joint name="wrist_flex"/><geom/>
<body pos="0 -0.0611 0.0181" euler="1.57079633 0 3.14159265"><joint name="wrist_roll"/><geom/>
<site name="tip" pos="-0.0079 -0.000218 {tip}"/></body></body></body></body></body></body></worldbody></mujoco>"""
_FINGERS = 0.0981  # metres from the last joint's frame to the fingertips, along the tool


class So101Kinematics:
    """Kinematics of the arm with a brush: mink on a MuJoCo model of its chain. Implements hardware.robot.Reach.

    brush_length: metres from the fingertips

    Raises RobotError if MuJoCo or mink is not installed.
    """

    def __init__(self, brush_length: float) -> None:
        with registry.importing("so101", "The SO-101", RobotError):
            import mink
            import mujoco
        self._mujoco, self._mink = mujoco, mink
        self._model = mujoco.MjModel.from_xml_string(_CHAIN.format(tip=-_FINGERS - brush_length))
        self._model.jnt_limited[:] = True
        self._model.jnt_range[:] = np.stack([_JOINT_MARGIN - LIMITS, LIMITS - _JOINT_MARGIN], -1)
        self._arm = mink.Configuration(self._model)
        self._place = mink.FrameTask("tip", "site", position_cost=1.0, orientation_cost=0.0)
        upright = mink.AxisAlignTask("tip", "site", axis=(0.0, 0.0, 1.0), cost=_TILTING)
        upright.set_target(np.array([0.0, 0.0, 1.0]))
        self._roll = mink.PostureTask(self._model, cost=np.array([0.0, 0.0, 0.0, 0.0, _ROLLING]))
        self._tasks = (self._place, upright, self._roll)
        self._limits = (mink.ConfigurationLimit(self._model),)

    def tip(self, joints: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Returns the tip [3] (m) and the direction of the brush [3] for joint angles [5]."""
        self._arm.update(joints)
        found = self._arm.data
        return found.site_xpos[0].copy(), -found.site_xmat[0].reshape(3, 3)[:, 2]

    def jacobian(self, joints: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns the Jacobian [3, 5] of the tip's position."""
        self._arm.update(joints)
        moved = np.zeros((3, 5))
        self._mujoco.mj_jacSite(self._model, self._arm.data, moved, None, 0)
        return moved

    def solve(self, tip: NDArray[np.float64], seed: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """Returns the joint angles [5] at a tip position [3] with the brush upright; None if it is out of reach.

        seed: joint angles [5] to begin with. The roll of the wrist, which turns the brush about itself, stays.
        """
        if not np.isfinite(tip).all():
            return None
        self._arm.update(np.clip(seed, _JOINT_MARGIN - LIMITS, LIMITS - _JOINT_MARGIN))
        self._place.set_target(self._mink.SE3.from_translation(tip))
        self._roll.set_target(seed)
        for _ in range(_ITERATIONS):
            step = self._mink.solve_ik(self._arm, self._tasks, 1.0, solver="daqp", limits=self._limits)
            self._arm.integrate_inplace(step, 1.0)
            if float(np.abs(step).max()) <= _CONVERGED:
                break
        joints = self._arm.q.copy()
        here, along = self.tip(joints)
        good = np.linalg.norm(tip - here) <= _MISSED and math.acos(float(np.clip(-along[2], -1, 1))) <= _UPRIGHT
        return joints if good and (np.abs(joints) <= LIMITS - _JOINT_MARGIN + 1e-9).all() else None

    def reachable(self, position: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Returns True for each position [k, 3] (m) that the tip reaches with the brush upright: [k]."""
        return np.array([self.start(place) is not None for place in position], np.bool_)

    def start(self, tip: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """Returns joint angles at a tip position from a posture turned towards it; None if it is out of reach."""
        pan = -math.atan2(tip[1], tip[0])
        return self.solve(tip, np.array([pan, 0.0, 0.0, 1.4, 0.0]))

    def play(self, position: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns the tip's greatest likely distance from positions [k, 3] for the play of the gears: [k] metres.

        Half the play of each joint moves the tip by its column of the Jacobian; the joints are independent, so that
        their squares add up. NaN if a position is out of reach.
        """
        found = [self.start(place) for place in position]
        moves = [np.nan if one is None else float(np.linalg.norm(self.jacobian(one) * PLAY / 2)) for one in found]
        return np.array(moves)


class So101Robot(Driver):
    """Robot over the servo bus. Implements Reach and LooseRobot as well.

    port: serial port of the bus
    brush_length: from the fingertips of the fixed jaw, or the end of a holder that is as long, to the brush's tip
        along the tool, metres
    """

    def __init__(self, port: str, resting: Point, approach: float = 0.1, brush_length: float = 0.05) -> None:
        super().__init__(f"the SO-101 at {port}", resting, approach)
        self._require_between("an approach", approach, 0, 0.5, "m/s")
        self._require_between("a brush length", brush_length, 0, 0.3, "m")
        self.brush_length, self._port_name = brush_length, port
        self._timing = Timing(_ACCELERATION, smoothing=0.1, period=_PERIOD)
        self._line = threading.Lock()
        self._sdk: Any = None
        self._port: Any = None
        self._packets: Any = None
        self._ranges = np.zeros((5, 2))
        self._steps = np.zeros(5)
        self._servos: tuple[str, ...] = JOINTS

    @cached_property
    def _kinematics(self) -> So101Kinematics:
        return So101Kinematics(self.brush_length)

    def _open(self, *, examines: bool) -> None:
        """Opens the bus, finds the servos, and switches them on at their present positions.

        Raises RobotDisconnected if another program uses the bus, RobotError if a servo is of another kind or in another
        mode, MotionFailed if a servo reports an error, or a joint is beyond its limit.
        """
        self._kinematics.tip(np.zeros(5))  # a missing package is told first
        with registry.importing("so101", "The SO-101", RobotError):
            import scservo_sdk
        self._sdk, self._packets = scservo_sdk, scservo_sdk.PacketHandler(0)
        self._port = self._interlock.asking("connect", self._open_port)
        self._servos = JOINTS
        for number, joint in enumerate(JOINTS, 1):
            self._require_servo(number, joint)
        if self._answers(_GRIPPER):
            self._servos = (*JOINTS, "gripper")
        joints = self._joints("connect")
        if examines:
            return
        if not (np.abs(joints) <= LIMITS + _JOINT_MARGIN).all():
            worst = int((np.abs(joints) - LIMITS).argmax())
            raise MotionFailed(
                f"connect: {JOINTS[worst]} of {self._interlock.name} stands at {math.degrees(joints[worst]):.0f} "
                f"degrees and reaches {math.degrees(LIMITS[worst]):.0f}; calibrate the arm so that 2048 is the middle "
                "of each joint, then connect anew."
            )
        self._send(joints)
        if len(self._servos) == _GRIPPER:  # it goes on holding the brush as it does
            closed = self._read("connect", _GRIPPER, _POSITION)
            grip = lambda to: (0, *self._packets.write2ByteTxRx(self._port, to, _GOAL, closed))  # noqa: E731
            self._ask("connect", _GRIPPER, grip)
        for number in range(1, len(self._servos) + 1):  # one byte
            self._ask("connect", number, lambda to: (0, *self._packets.write1ByteTxRx(self._port, to, _TORQUE, 1)))

    def _open_port(self) -> Any:
        """Returns the open port, which no other program can open meanwhile. Raises RobotDisconnected."""
        port = self._sdk.PortHandler(find_port(self._port_name))
        try:
            port.setBaudRate(_BAUD)
            remember_port(self._port_name, port.port_name)
            port.ser.exclusive = True  # two programs on one bus garble each other's packets
        except (OSError, ValueError) as cause:  # SerialException is an OSError
            if port.is_open:
                port.closePort()
            raise RobotDisconnected(
                f"connect: the port {self._port_name} cannot be opened ({one_line(cause)}); look at its cable, and end "
                "other programs that use it."
            ) from cause
        return port

    def _answers(self, number: int) -> bool:
        """Returns True if there is a servo of that number."""

        def ping() -> bool:
            with self._line:
                self._port.ser.reset_input_buffer()
                return any(self._packets.ping(self._port, number)[1] == self._sdk.COMM_SUCCESS for _ in range(2))

        return self._interlock.asking("connect", lambda: self._on_the_bus("connect", ping))

    def _require_servo(self, number: int, joint: str) -> None:
        """Raises RobotError unless the servo is an STS3215 that goes to positions; reads its own limits."""
        who = f"connect: servo {number} ({joint}) of {self._interlock.name}"
        if (model := self._read("connect", number, _MODEL)) != _STS3215:
            raise RobotError(
                f"{who} says it is a model {model}, and an STS3215 is {_STS3215}; look whether this is the arm."
            )
        if mode := self._read("connect", number, _MODE) & 0xFF:
            raise RobotError(
                f"{who} is in mode {mode}, in which it turns without end; set its register 33 to 0 with the maker's "
                "program."
            )
        steps = [self._read("connect", number, address) for address in (_MIN_ANGLE, _MAX_ANGLE)]
        self._ranges[number - 1] = _angles(np.array(steps if steps[0] < steps[1] else (0, _STEPS - 1)))

    def close(self) -> None:
        """Closes the bus; the servos hold their positions."""
        port, self._port = self._port, None
        self._interlock.mark_disconnected()
        if port is not None and port.is_open:
            port.closePort()

    # Limits and state for people.

    def timing(self) -> AxisTiming:
        """Returns the limits of the planned motions. Implements hardware.robot.TimedRobot."""
        return self._timing.tell(FASTEST, _RESTING)

    def pose(self) -> NDArray[np.float64]:
        """Returns the position of the tip [3] in metres, as the servos' encoders tell it."""
        self._interlock.require_ready("pose")
        return self._kinematics.tip(self._joints("pose"))[0]

    def reachable(self, position: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Returns True for each position [k, 3] that the tip reaches with the brush upright: [k]."""
        return self._kinematics.reachable(position)

    def play(self, position: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns the tip's likely distance from positions [k, 3] for the play of the gears: [k] metres."""
        return self._kinematics.play(position)

    def _facts(self) -> Iterator[MachineFact]:
        joints = self._joints("examine")
        tip, _ = self._kinematics.tip(joints)
        holder = "the fingertips of its fixed jaw" if len(self._servos) == _GRIPPER else "the end of its holder"
        yield MachineFact(f"The brush's tip is at ({tip[0]:.3f}, {tip[1]:.3f}, {tip[2]:.3f}) m of the arm's base, "
                          f"{1000 * self.brush_length:.0f} mm beyond {holder} (brush_length).")  # fmt: skip
        if len(self._servos) < _GRIPPER:
            yield MachineFact("No gripper answers (servo 6). If it has one, look at its cable, or the brush drops.",
                              "warning")  # fmt: skip
        for number, joint in enumerate(self._servos, 1):
            load = self._read("examine", number, _LOAD)
            share = (load & 0x3FF) / 10  # bit 10 is the direction
            supply = self._read("examine", number, _VOLTAGE)
            volts, warm = (supply & 0xFF) / 10, supply >> 8
            advice = ": its supply is weak; look at it and at the cable" if volts < _WEAK else ""
            advice = advice or (": let it cool down before you paint" if warm > _WARM else "")
            turned = "" if number == _GRIPPER else (
                f"{math.degrees(joints[number - 1]):.0f} of {math.degrees(LIMITS[number - 1]):.0f} degrees, "
            )  # fmt: skip
            yield MachineFact(
                f"{joint}: {turned}load {share:.0f} %, {volts:.1f} V, {warm} degrees Celsius{advice}.",
                "warning" if advice else "fact",
            )
        off = float(np.linalg.norm(self._kinematics.jacobian(joints) * PLAY / 2))
        yield MachineFact(
            f"Gears with a degree of play let the tip be {1000 * off:.1f} mm off here: paint with a broad brush and "
            "on a small canvas near the arm.",
            "warning",
        )

    # Motions.

    def _go(self, waypoints: Waypoints) -> NDArray[np.float64]:
        """Moves with the brush upright.

        Raises MotionFailed before anything moves if a waypoint is out of reach or a joint would be too fast, and if a
        servo reports an error or is far behind.
        """
        self._require_held(waypoints.label)
        joints = self._plan(waypoints)
        self._stream(waypoints.label, joints)
        return self._settle(waypoints.label, joints[-1])

    def _plan(self, waypoints: Waypoints) -> NDArray[np.float64]:
        """Returns joint angles [n, 5] at every period. Raises MotionFailed."""
        label, name = waypoints.label, self._interlock.name
        start = self._joints(label)
        path = np.concatenate([self._kinematics.tip(start)[0][None], waypoints.position])
        speed = np.r_[self.approach, np.full(len(waypoints.position) - 1, waypoints.speed)]
        found = [start]
        for place in self._timing.places(path, speed):
            joints = self._kinematics.solve(place, found[-1])
            if joints is None:
                x, y, z = place
                raise MotionFailed(
                    f"{label}: {name} does not reach ({x:.3f}, {y:.3f}, {z:.3f}) m with the brush upright; move the "
                    "canvas. It did not move."
                )
            found.append(joints)
        way = np.array(found[1:])
        # A servo that is set up to turn less far would stay at its limit and say nothing.
        outside = ~((way >= self._ranges[:, 0]) & (way <= self._ranges[:, 1]))
        if outside.any():
            row, joint = np.argwhere(outside)[0]
            low, high = np.degrees(self._ranges[joint])
            raise MotionFailed(
                f"{label}: {JOINTS[joint]} of {name} would turn to {math.degrees(way[row, joint]):.0f} degrees, and "
                f"its servo is set up for {low:.0f} to {high:.0f} (registers 9 and 11); calibrate the arm anew, or "
                "move the canvas. It did not move."
            )
        rate = np.abs(np.diff(way, axis=0)) / _PERIOD
        if not (rate <= _MAX_RATE).all():
            raise MotionFailed(
                f"{label}: {JOINTS[int(rate.max(0).argmax())]} of {name} would turn at {rate.max():.1f} rad/s, and "
                f"{_MAX_RATE:g} rad/s are allowed; lower the speed. It did not move."
            )
        # The first goal may be a posture with the brush turned upright: it is approached as slowly as a motion begins.
        first = way[0] - start
        steps = max(1, math.ceil(float(np.abs(first).max()) / (0.5 * _PERIOD)))
        return np.concatenate([start + np.arange(steps)[:, None] / steps * first, way])

    def _require_held(self, label: str) -> None:
        """Raises MotionFailed if a servo is switched off, as all are after a failure of their supply."""
        for number, joint in enumerate(self._servos, 1):
            if not self._read(label, number, _TORQUE) & 0xFF:
                error = MotionFailed(
                    f"{label}: servo {number} ({joint}) of {self._interlock.name} is switched off: it was reset, as by "
                    "a failure of its supply, or another program did it. Look at the arm, which may have sunk, then "
                    "connect anew."
                )
                raise self._interlock.fault(error)

    def _stream(self, label: str, joints: NDArray[np.float64]) -> None:
        """Sends a goal every period, or later if the computer is busy."""
        due = time.monotonic()
        for index, goal in enumerate(joints):
            self._interlock.heed_stop(label)
            self._send(goal)
            if index % _EVERY == 0:
                self._require_near(label, self._joints(label), goal, _BEHIND)
            due = max(due + _PERIOD, time.monotonic())  # goals that are late do not come in a burst
            time.sleep(max(0.0, due - time.monotonic()))

    def _settle(self, label: str, goal: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns the tip's position when the servos stand at their goal [5]. Raises MotionFailed."""
        until = time.monotonic() + _SETTLING
        before = self._joints(label)
        while True:
            self._send(goal)  # again: no servo acknowledges goals, and the last one may be lost
            time.sleep(_PERIOD)
            self._interlock.heed_stop(label)
            now = self._joints(label)
            if np.abs(now - before).max() <= _STILL * _STEP:
                self._require_near(label, now, goal, _AWAY)
                return self._kinematics.tip(now)[0]
            if time.monotonic() > until:
                raise self._failure(MotionFailed, label, "does not come to rest; look at it.")
            before = now

    def _require_near(self, label: str, joints: NDArray[np.float64], goal: NDArray[np.float64], most: float) -> None:
        """Raises MotionFailed if a joint is farther than `most` radians from its goal."""
        away = np.abs(joints - goal)
        if not (away <= most).all():
            self._require_held(label)
            worst = int(away.argmax())
            raise MotionFailed(
                f"{label}: {JOINTS[worst]} of {self._interlock.name} is {math.degrees(away[worst]):.0f} degrees from "
                "its goal: something holds it, or its supply is weak. It holds now; look at it."
            )

    def _joints(self, label: str) -> NDArray[np.float64]:
        """Returns the joint angles [5] that the encoders tell."""
        words = np.array([self._read(label, number, _POSITION) for number in range(1, 6)])
        steps = np.where(words & _SIGN, -(words & ~_SIGN), words).astype(np.float64)
        if not np.array_equal(steps, self._steps):
            self._steps, self._alive = steps, steady()
        return _angles(steps)

    def _send(self, joints: NDArray[np.float64]) -> None:
        """Sends the goals of all servos in one packet, which no servo answers."""
        steps = np.round(joints / _STEP + _MIDDLE).astype(int)
        words = np.where(steps < 0, _SIGN | -steps, steps).tolist()
        data = [byte for number, word in enumerate(words, 1) for byte in (number, word & 0xFF, word >> 8)]
        port = self._port

        def send() -> int:
            with self._line:
                if self._interlock.stopped:  # a stop has written the present positions meanwhile
                    return int(self._sdk.COMM_SUCCESS)
                return int(self._packets.syncWriteTxOnly(port, _GOAL, 2, data, len(data)))

        if self._interlock.asking("goals", lambda: self._on_the_bus("goals", send)) != self._sdk.COMM_SUCCESS:
            raise self._interlock.fault(
                RobotDisconnected(f"{self._interlock.name} took no goals; look at its cable, then connect anew.")
            )

    def _read(self, label: str, number: int, address: int) -> int:
        """Returns a register of two bytes. Raises RobotDisconnected, or MotionFailed with the servo's error."""
        return self._ask(label, number, lambda of: self._packets.read2ByteTxRx(self._port, of, address))

    def _ask(self, label: str, number: int, call: Callable[[int], tuple[int, int, int]]) -> int:
        """Returns what a call for a servo answers: a value, the result of the transfer, the servo's error."""

        def locked() -> tuple[int, int, int]:
            with self._line:
                self._port.ser.reset_input_buffer()  # a late answer to an earlier question is none to this one
                return call(number)

        who = f"{label}: servo {number} ({self._servos[number - 1]}) of {self._interlock.name}"
        for _ in range(3):  # a garbled answer is asked for again
            value, result, error = self._interlock.asking(label, lambda: self._on_the_bus(label, locked))
            if result == self._sdk.COMM_SUCCESS:
                break
        else:
            raise self._interlock.fault(
                RobotDisconnected(f"{who} did not answer; look at its cable and at the arm's supply.")
            )
        if error:
            because = ", ".join(text for bit, text in _ERRORS.items() if error & bit) or f"error {error}"
            raise self._interlock.fault(
                MotionFailed(f"{who} reports that {because}; switch the arm off and on, and look at it.", error)
            )
        return value

    def _on_the_bus(self, label: str, call: Callable[[], Answer]) -> Answer:
        """Returns the result of a call that uses the port. Raises RobotDisconnected if the port is gone."""
        try:
            return call()
        except Exception as gone:  # pyserial raises TypeError if another thread closed it
            # The error of termios is no OSError, and Windows has no such module.
            if not isinstance(gone, OSError | TypeError | AttributeError) and type(gone).__module__ != "termios":
                raise
            raise RobotDisconnected(
                f"{label}: the bus of {self._interlock.name} is gone ({one_line(gone)}); look at its cable. The servos "
                "hold their last goals."
            ) from gone

    def _halt(self) -> None:
        """Makes the present positions the goals, as far as the servos answer. Raises nothing; waits a second at most.

        Without a free line after a second, the servos still hold: they get no further goals.
        """
        port, sdk = self._port, self._sdk
        if port is None or not port.is_open or not self._line.acquire(timeout=_STOPPING):
            return
        try:
            port.is_using = False  # the library forgets that after a failure, and would refuse
            port.ser.reset_input_buffer()
            for number in range(1, 6):
                step, result, _ = self._packets.read2ByteTxRx(port, number, _POSITION)
                if result == sdk.COMM_SUCCESS:
                    self._packets.syncWriteTxOnly(port, _GOAL, 2, [number, step & 0xFF, step >> 8], 3)
        except Exception:  # any failure of port or library: the interlock holds all the same
            return
        finally:
            self._line.release()


def _angles(steps: NDArray[Any]) -> NDArray[np.float64]:
    """Returns joint angles in radians for positions of servos in steps."""
    return (steps.astype(np.float64) - _MIDDLE) * _STEP


def _open(name: MachineName, workspace: Workspace) -> So101Robot:
    name.require("brush_length")
    length = name.choose("brush_length", float, 0.05)
    return So101Robot(name.where, require_home(name, workspace), workspace.travel_speed, length)


KIND = RobotKind(
    "so101",
    "so101:PORT[,brush_length=METRES]",
    "SO-101 with STS3215 servos",
    open=_open,
    needed=_NEEDED,
    identify=lambda name: at_port(name.where),
)
