"""A stand-in for the package franky and the arm behind it, for computers that have neither.

It obeys the calls that the driver makes, by Franka's published table; what libfranka really does is in test_franka.py.

    fake = FakeFranky(joints); monkeypatch.setitem(sys.modules, "franky", fake)
"""

import gc
import os
import socket
import threading
import time
import weakref
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np

from machines.franky_arm import HAND_TO_FINGERTIPS, joint_frames

PERIOD = 0.02  # seconds between two waypoints


class FakeFranky:
    """The package and its one arm, at `address`, which stands at joint angles [7].

    pace: how much faster than a real arm it moves
    trace: joint angles on its ways; moves: number of motions
    """

    NetworkException = type("NetworkException", (Exception,), {})
    IncompatibleVersionException = type("IncompatibleVersionException", (Exception,), {})
    RealtimeException = type("RealtimeException", (Exception,), {})
    ControlException = type("ControlException", (Exception,), {})
    CommandException = type("CommandException", (Exception,), {})
    Frame, RealtimeConfig = SimpleNamespace(EndEffector=0), SimpleNamespace(Enforce=0, Ignore=1)
    Duration, JointWaypointMotion = staticmethod(lambda milliseconds: milliseconds), list

    def __init__(self, joints: np.ndarray) -> None:
        self.joints, self.pace, self.mode, self.errors = joints, 20.0, "Idle", ()
        self.trace: list[np.ndarray] = []
        self.moves, self.silent, self.life = 0, threading.Event(), 0
        self.failure: Exception | None = None
        self.moving: threading.Thread | None = None
        self._client: Any = lambda: None
        self.address = f"127.43.{os.getpid() // 250 % 250}.{1 + os.getpid() % 250}"
        self.plug_in()

    def plug_in(self) -> None:
        self._listener = socket.create_server((self.address, 1337))

    def unplug(self) -> None:
        self._listener.close()
        self.restart()

    def restart(self) -> None:
        """Ends its connections and its motion."""
        self.life += 1
        self._client = lambda: None
        self.halt(self.NetworkException("connection lost") if self.moving else None)

    def talk(self) -> None:
        """Answers every connection with something that libfranka does not say."""

        def answer() -> None:
            with self._listener.accept()[0] as client:
                client.sendall(b"HTTP/1.1 400\r\n")

        threading.Thread(target=answer, daemon=True).start()

    def halt(self, failure: Exception | None) -> None:
        self.failure, moving, self.moving = failure, self.moving, None
        if moving is not None:
            moving.join()

    JointState, JointWaypoint = (
        staticmethod(lambda angles, rate: angles),
        staticmethod(lambda state, minimum_time: state),
    )

    def Robot(self, address: str, **_: Any) -> "FakeRobot":
        gc.collect()
        if self._client() is not None:
            raise self.NetworkException("another client is connected")
        robot = FakeRobot(self)
        self._client = weakref.ref(robot)
        return robot


class FakeRobot:
    """Connection to the arm."""

    def __init__(self, franky: FakeFranky) -> None:
        self._franky, self._life = franky, franky.life
        self.join_motion = partial(_join, franky)
        self.model = SimpleNamespace(pose=self._pose, zero_jacobian=self._jacobian)
        self.joint_velocity_limit = SimpleNamespace(get=lambda: np.full(7, 2.6))

    def _live(self) -> FakeFranky:
        arm = self._franky
        while arm.silent.is_set():
            time.sleep(0.01)
        if self._life != arm.life:
            raise arm.NetworkException("connection lost")
        return arm

    @property
    def state(self) -> Any:
        arm = self._live()
        moment = time.monotonic() * arm.pace
        return SimpleNamespace(
            q=arm.joints, q_d=arm.joints, F_T_EE=None, EE_T_K=None, robot_mode=SimpleNamespace(name=arm.mode),
            current_errors=SimpleNamespace(**dict.fromkeys(arm.errors, True)), last_motion_errors=SimpleNamespace(),
            time=SimpleNamespace(to_sec=lambda: moment), O_F_ext_hat_K=np.zeros(6), m_total=0.7,
        )  # fmt: skip

    def _pose(self, _: object, joints: np.ndarray, *__: object) -> Any:
        half = np.sqrt(0.5)
        hand = np.array([[half, half, 0, 0], [-half, half, 0, 0], [0, 0, 1, 0.107 + HAND_TO_FINGERTIPS], [0, 0, 0, 1]])
        return SimpleNamespace(matrix=joint_frames(joints[None])[-1][0] @ hand)

    def _jacobian(self, _: object, joints: np.ndarray, *__: object) -> np.ndarray:
        tool = self._pose(None, joints).matrix[:3, 3]
        frames = [frame[0] for frame in joint_frames(joints[None])]
        columns = [np.r_[np.cross(frame[:3, 2], tool - frame[:3, 3]), frame[:3, 2]] for frame in frames]
        return np.stack(columns, 1)

    def move(self, motion: list[np.ndarray], *, asynchronous: bool) -> None:
        arm = self._live()

        def follow() -> None:
            for joints in motion:
                time.sleep(PERIOD / arm.pace)
                while arm.silent.is_set() and arm.moving is threading.current_thread():  # it lacks commands, and stands
                    time.sleep(0.01)
                if arm.moving is not threading.current_thread():
                    return
                arm.joints = joints
                arm.trace.append(joints)
            arm.moving = None

        arm.moves, arm.failure = arm.moves + 1, None
        arm.moving = threading.Thread(target=follow, daemon=True)
        arm.moving.start()

    def stop(self) -> None:
        self._live().halt(None)


def _join(arm: FakeFranky, seconds: float) -> bool:
    """Waits for the end of a motion. Its errors refer to no connection, which would else stay open with them."""
    if (moving := arm.moving) is not None:
        moving.join(seconds)
    if arm.failure is not None:
        raise arm.failure
    return arm.moving is None
