"""Benches of arms for the table of behaviours: xArm, Franka, SO-101, and an arm behind ROS.

An arm does not reach the places of the rows around its own base, so that a bench turns and moves the frame in which it
is driven. The SO-101 lives in simulated time; the others live in real time, some faster than real arms.
"""

import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from frida_painter.hardware.robot import MotionReport, Waypoints
from frida_painter_drivers.franka import FrankaReach, FrankaRobot
from frida_painter_drivers.rosbridge import RosbridgeConnection, RosRobot
from frida_painter_drivers.so101 import So101Kinematics, So101Robot
from frida_painter_drivers.xarm import XarmRobot
from machines import franky_arm, sts_bus
from machines.bench import FOUND, SerialBench
from machines.franky_fake import FakeFranky
from machines.rosbridge import Rosbridge
from machines.simulated_time import Cable, SimulatedTime
from machines.xarm_box import COLLISION, XarmBox, use_ports

HOME = (0.0, 0.0, 0.05)
_LONGEST = 0.4  # real seconds for which a row waits at most
_EVERY, _WHILE, _MOVING = 4, 20, 1e-4  # ms between two places; a tip that moves at least so far in so many ms counts
_ENCODERS = "its joints have absolute encoders"


class LiveBench:
    """Base of benches in real time. Implements a part of Bench."""

    servo = None
    pace = 1.0

    def __init__(self) -> None:
        self._robots: list[Any] = []
        self._fault = ""

    def made(self, robot: Any) -> Any:
        """Remembers a driver, to close it at the end."""
        self._robots.append(robot)
        return robot

    def robot(self) -> Any:
        raise NotImplementedError

    def moved(self) -> np.ndarray:
        raise NotImplementedError

    def slow_down(self) -> None:
        """Makes the arm slow enough that something can happen in the middle of a motion."""

    def end(self) -> None:
        for robot in self._robots:
            robot.close()

    def ready(self) -> Any:
        robot = self.robot()
        robot.connect()
        return robot

    def wait(self, seconds: float) -> None:
        time.sleep(min(seconds / self.pace, _LONGEST))

    def wait_until(self, reached: Callable[[], bool]) -> None:
        until = time.monotonic() + 10
        while not reached() and time.monotonic() < until:
            time.sleep(0.002)

    def when_moved(self, metres: float, act: Callable[[], object]) -> None:
        start = len(self.moved())

        def watch() -> None:
            until = time.monotonic() + 10
            while time.monotonic() < until:
                way = self.moved()[start:]
                if len(way) > 1 and np.linalg.norm(np.diff(way, axis=0), axis=1).sum() >= metres:
                    act()
                    return
                time.sleep(0.001)

        self.slow_down()
        threading.Thread(target=watch, daemon=True).start()


class XarmBench(LiveBench):
    """Bench of an xArm: the maker's SDK, its protocol, a simulated control box. Implements Bench."""

    exact = exact_height = 1e-6

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        super().__init__()
        self.box = XarmBox(pace=20.0)
        self.box.__enter__()
        self.box.pose[:3] = 1000 * FOUND
        use_ports(self.box, monkeypatch)
        self.lacks = {
            "zero": _ENCODERS,
            "lose a line": "TCP loses nothing",
            "pause button": "it pauses by itself and tells its state",
            "two programs": "its control box takes several connections, and the last command counts",
            "time": "UFACTORY does not publish how it plans",
        }

    def end(self) -> None:
        super().end()
        self.box.__exit__()

    @property
    def pace(self) -> float:  # type: ignore[override]
        return self.box.pace

    def robot(self) -> Any:
        return self.made(XarmRobot("127.0.0.1", HOME, 0.1))

    def tip(self) -> np.ndarray:
        return np.array(self.box.pose[:3]) / 1000

    def moved(self) -> np.ndarray:
        return np.array(list(self.box.moved)).reshape(-1, 3) / 1000

    def slow_down(self) -> None:
        self.box.pace = 2.0

    def fault(self, name: str) -> None:
        self._fault = name
        match name:
            case "alarm":
                with self.box._lock:  # its own thread goes through the queue meanwhile
                    self.box._fail(COLLISION)
            case "reset" | "power cut" | "another program":
                with self.box._lock:
                    self.box._reset()
            case "unplug":
                self.box.leave_network()
            case "silence":
                self.box.mute = True
            case "chatter":
                pass  # its reports come unasked for all the time
            case "garbage":
                self.box.garbage = True
            case _:
                raise AssertionError(name)

    def mend(self) -> None:
        match self._fault:
            case "alarm":
                self.box.clear_error()
            case "unplug":
                self.box.join_network()
            case "silence":
                self.box.mute = False

    def commands(self) -> list[str]:
        return ["MOVE_LINE"] * self.box.commands.count(21)


class RosBench(LiveBench):
    """Bench of an arm behind rosbridge, whose node is that of docs/how-to/ros.md. Implements Bench."""

    exact = exact_height = 1e-6
    pace = 50.0

    def __init__(self) -> None:
        super().__init__()
        self.bridge = Rosbridge()
        self.bridge.__enter__()
        self.bridge.arm.place = tuple(FOUND)
        self.lacks = {
            "zero": "its node knows where it is, or says so",
            "limits": "no topic of ROS tells how fast an arm may be",
            "lose a line": "TCP loses nothing",
            "pause button": "it pauses by itself; its node counts that as moving",
            "two programs": "a topic has any number of publishers",
            "alarm at rest": "its node tells why a motion ended, and nothing while it stands",
            "reset": "rosbridge does not tell whether the node behind it is the same as before",
            "time": "no topic of ROS tells how it plans",
        }

    def end(self) -> None:
        super().end()
        self.bridge.__exit__()

    def robot(self) -> Any:
        place = ("127.0.0.1", self.bridge.port)
        return self.made(RosRobot(HOME, RosbridgeConnection(*place), RosbridgeConnection(*place), 0.1))

    def tip(self) -> np.ndarray:
        return np.array(self.bridge.arm.place)

    def moved(self) -> np.ndarray:
        return np.array(list(self.bridge.arm.moved)).reshape(-1, 3)

    def slow_down(self) -> None:
        self.bridge.arm.pace = 4.0

    def fault(self, name: str) -> None:
        self._fault = name
        arm = self.bridge.arm
        match name:
            case "alarm":
                arm.abort = True
            case "reset" | "power cut":
                arm.restart()
            case "unplug":
                self.bridge.leave_network()
            case "silence":
                self.bridge.freeze()
            case "another program":
                arm.pace = 1.0
                arm.hear("/brush/follow", another_motion())
                self.wait_until(lambda: len(arm.moved) > 1)
            case "chatter":
                arm.misbehave = "chatters"
            case "garbage":
                self.bridge.garbage = True
            case _:
                raise AssertionError(name)

    def mend(self) -> None:
        arm = self.bridge.arm
        match self._fault:
            case "alarm":
                arm.misbehave, arm.stopped, arm.abort = "", False, False
            case "unplug":
                self.bridge.join_network()
                arm.stopped = False
            case "silence":
                self.bridge.dead = False

    def commands(self) -> list[str]:
        return [topic for topic in self.bridge.arm.heard if topic == "/brush/follow"]


def another_motion() -> dict[str, Any]:
    """A motion of another program: 100 mm aside."""
    point = {
        "transforms": [{"translation": {"x": 0.2, "y": 0.05, "z": 0.03}}],
        "time_from_start": {"sec": 2, "nanosec": 0},
    }
    header = {"stamp": {"sec": 77, "nanosec": 7}, "frame_id": "base"}
    return {"header": header, "joint_names": ["brush_tip"], "points": [point]}


class Placed:
    """Part of a driver that is driven in the frame of the rows.

    turn [3, 3], origin [3]: that frame in the arm's own
    """

    turn = np.eye(3)
    origin = np.zeros(3)

    def follow(self, waypoints: Waypoints) -> MotionReport:
        position = waypoints.position
        if position.ndim == 2 and position.shape[1] == 3 and np.isfinite(position).all():  # the driver refuses others
            waypoints = replace(waypoints, position=position @ self.turn.T + self.origin)
        report = super().follow(waypoints)  # type: ignore[misc]
        return replace(report, reached=self.to_rows(report.reached))

    def pose(self) -> np.ndarray:
        return self.to_rows(super().pose())  # type: ignore[misc]

    @classmethod
    def to_rows(cls, place: np.ndarray) -> np.ndarray:
        return (place - cls.origin) @ cls.turn


class PlacedFranka(Placed, FrankaRobot):
    origin = np.array([0.35, -0.05, 0.15])


class PlacedSo101(Placed, So101Robot):
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    origin = np.array([0.20, -0.10, -0.03])


class FrankaShelf:
    """Keeps one simulation for all rows; one that a row has broken is replaced."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._arm, self._count = folder, None, 0
        self.joints = FrankaReach(franky_arm.BRUSH).solve(FOUND[None] + PlacedFranka.origin)[0]

    def take(self) -> "franky_arm.FrankyArm":
        """Returns a simulation that runs; a new one stands where the last one stood."""
        if self._arm is None:
            self._count += 1
            place = self._folder / str(self._count)
            place.mkdir()
            self._arm = franky_arm.FrankyArm(place, table=False, start=self.joints.tolist()).__enter__()
        return self._arm

    def drop(self) -> None:
        """Ends the simulation, as a power cut would."""
        arm, self._arm = self._arm, None
        if arm is not None:
            arm.__exit__()
            self.joints = arm.joints()[-1]


class FrankaBench(LiveBench):
    """Bench of a Franka over franky-sim, which other authors wrote. Implements Bench.

    The true places come from Franka's published table. The simulated arm follows a moving goal 0.1 s late, so that it
    rounds corners at the speeds of the rows; test_franka.py measures how exact it is at the speed of a painting.
    """

    exact = exact_height = 2.5e-3
    braking = 0.6

    def __init__(self, shelf: FrankaShelf) -> None:
        super().__init__()
        self._shelf = shelf
        self._arm = shelf.take()
        self._arm.order(mode=None, errors=[], reject=None)
        self._read = len(self._arm.joints())
        self._start = self._tips(self._arm.joints()[-1:])[0]
        self._places: list[np.ndarray] = []
        self._moves, self._reading = self._arm.moves(), threading.Lock()
        self._impostor: socket.socket | None = None
        self.lacks = {
            "zero": _ENCODERS,
            "lose a line": "TCP loses nothing, and the arm itself ends a motion that lacks commands",
            "pause button": "its user stop is a stop",
            "time": "foretold by its own clock in test_franka.py; the rows' clock counts a busy computer's planning",
        }

    def end(self) -> None:
        super().end()
        if any(thread.name.endswith(": connect") for thread in threading.enumerate()):
            self._fault = "unplug"  # a second program still waits until the arm is free, and would take it
        if self._impostor is not None:
            self._impostor.close()
        if self._fault:
            self._shelf.drop()

    def robot(self) -> Any:
        self._live_again()
        return self.made(PlacedFranka(self._arm.address, HOME, 0.05, brush_length=franky_arm.BRUSH))

    def _live_again(self) -> None:
        if self._fault not in ("unplug", "garbage") and self._shelf.take() is not self._arm:
            self._arm, self._read, self._moves = self._shelf.take(), 0, 0

    @staticmethod
    def _tips(joints: np.ndarray) -> np.ndarray:
        return PlacedFranka.to_rows(franky_arm.tip_positions(joints))

    def tip(self) -> np.ndarray:
        self._look()
        return (self._places[-1] if self._places else self._start).copy()

    def moved(self) -> np.ndarray:
        self._look()
        return np.array(self._places).reshape(-1, 3)

    def wait(self, seconds: float) -> None:
        """Waits by the arm's own clock."""
        if self._fault == "silence":
            return
        until = len(self._arm.joints()) + 1000 * min(seconds, 0.8)
        self.wait_until(lambda: self._arm.process.poll() is not None or len(self._arm.joints()) >= until)

    def _look(self) -> None:
        """Reads where the tip was since the last time; an arm that has arrived creeps on, which does not count."""
        with self._reading:
            joints = self._arm.joints()
            fresh = np.arange(max(self._read, _WHILE), len(joints), _EVERY)
            if len(fresh):
                tips = self._tips(joints[fresh])
                moves = np.linalg.norm(tips - self._tips(joints[fresh - _WHILE]), axis=1) >= _MOVING
                self._places.extend(tips[moves])
                self._read = int(fresh[-1]) + _EVERY

    def fault(self, name: str) -> None:
        self._fault = name
        match name:
            case "alarm":
                self._arm.order(mode="kReflex", errors=[7], abort="kReflexAborted")
            case "reset" | "power cut" | "unplug":
                self._arm.kill()
                self._shelf.drop()
            case "silence":
                os.kill(self._arm.process.pid, signal.SIGSTOP)
            case "chatter":
                pass  # its states come unasked, a thousand a second
            case "garbage":
                self._shelf.drop()
                self._impostor = socket.create_server((self._arm.address, 1337))
                threading.Thread(target=_talk_nonsense, args=(self._impostor,), daemon=True).start()
            case _:
                raise AssertionError(name)

    def mend(self) -> None:
        match self._fault:
            case "alarm":
                self._arm.order(mode=None, errors=[])
            case "silence":
                os.kill(self._arm.process.pid, signal.SIGCONT)
                self._fault, stood = "", self.tip()
                self.wait(self.braking)  # its time stood still too: an arm would have braked meanwhile
                self._read = len(self._arm.joints())
                assert np.linalg.norm(self._tips(self._arm.joints()[-1:])[0] - stood) < 0.012
        self._fault = "reset" if self._fault == "unplug" else ""

    def commands(self) -> list[str]:
        return ["move"] * (self._arm.moves() - self._moves)


class FakeFrankaBench(LiveBench):
    """Bench of a Franka over a stand-in for franky, for every day. Implements Bench."""

    exact = exact_height = 1e-3
    pace = 20.0

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        super().__init__()
        self._arm = FakeFranky(FrankaReach(franky_arm.BRUSH).solve(FOUND[None] + PlacedFranka.origin)[0])
        monkeypatch.setitem(sys.modules, "franky", self._arm)
        self.lacks = {
            "zero": _ENCODERS,
            "lose a line": "TCP loses nothing, and the arm itself ends a motion that lacks commands",
            "pause button": "its user stop is a stop",
            "time": "the stand-in has no dynamics",
        }

    def end(self) -> None:
        super().end()
        self._arm.silent.clear()
        self._arm.unplug()

    def robot(self) -> Any:
        return self.made(PlacedFranka(self._arm.address, HOME, 0.05, brush_length=franky_arm.BRUSH))

    def tip(self) -> np.ndarray:
        return PlacedFranka.to_rows(franky_arm.tip_positions(self._arm.joints[None]))[0]

    def moved(self) -> np.ndarray:
        joints = np.array(list(self._arm.trace)).reshape(-1, 7)
        return PlacedFranka.to_rows(franky_arm.tip_positions(joints))

    def slow_down(self) -> None:
        self._arm.pace = 2.0

    def fault(self, name: str) -> None:
        self._fault, arm = name, self._arm
        match name:
            case "alarm":
                arm.mode, arm.errors = "Reflex", ("cartesian_reflex",)
                arm.halt(arm.ControlException("reflex"))
            case "reset" | "power cut":
                arm.restart()
            case "unplug":
                arm.unplug()
            case "silence":
                arm.silent.set()
            case "chatter":
                pass  # its states come unasked, a thousand a second
            case "garbage":
                arm.talk()
            case _:
                raise AssertionError(name)

    def mend(self) -> None:
        match self._fault:
            case "alarm":
                self._arm.mode, self._arm.errors = "Idle", ()
            case "unplug":
                self._arm.plug_in()
            case "silence":
                self._arm.restart()
                self._arm.silent.clear()

    def commands(self) -> list[str]:
        return ["move"] * self._arm.moves


def _talk_nonsense(server: socket.socket) -> None:
    try:
        while True:
            client, _ = server.accept()
            with client:
                client.sendall(bytes(range(128, 250)) * 20)
    except OSError:
        return


@dataclass
class So101Bench(SerialBench):
    """Bench of an SO-101: its servos' bus in simulated time. Implements Bench."""

    exact: float = 1.2e-3  # 4096 steps a turn
    servo: None = None
    lost: int = field(default=0)
    _places: list[np.ndarray] = field(default_factory=list)
    _read: int = 1

    @property
    def exact_height(self) -> float:
        return self.exact

    def ready(self) -> Any:
        robot = self.robot()
        robot.connect()
        return robot

    def tip(self) -> np.ndarray:
        return PlacedSo101.to_rows(sts_bus.tips(self.controller.load[None]))[0]

    def moved(self) -> np.ndarray:
        joints = self.controller.trace[self._read :]
        self._read += len(joints)
        if joints:
            self._places.extend(PlacedSo101.to_rows(sts_bus.tips(np.array(joints))))
        return np.array(self._places).reshape(-1, 3)

    def fault(self, name: str) -> None:
        self._fault = name
        bus = self.controller
        match name:
            case "alarm":
                bus.errors[3] = 32
            case "reset" | "power cut":
                bus.restart()
            case "chatter":
                bus.chatters = True
            case _:
                super().fault(name)

    def mend(self) -> None:
        match self._fault:
            case "alarm":
                self.controller.errors.clear()
            case "unplug":
                self.cable.plug()
            case _:
                super().mend()
        self._fault = ""

    def commands(self) -> list[str]:
        return ["goals"] * self.controller.goals


def so101_bench(clock: SimulatedTime, monkeypatch: pytest.MonkeyPatch) -> So101Bench:
    """Returns the bench of an SO-101 whose tip stands at FOUND."""
    bus, cable = so101_bus(clock, monkeypatch, FOUND @ PlacedSo101.turn.T + PlacedSo101.origin)
    bus.lose_every = 37
    bench = So101Bench(clock, bus, cable, lambda port: PlacedSo101(port, HOME, brush_length=sts_bus.BRUSH))
    bench.lacks = {
        "zero": _ENCODERS,
        "lose a line": "its servos acknowledge no goals; here one of 37 is lost all the time",
        "pause button": "it has none",
    }
    return bench


def so101_bus(
    clock: SimulatedTime, monkeypatch: pytest.MonkeyPatch, tip: np.ndarray, **bus: Any
) -> tuple[sts_bus.StsBus, Cable]:
    """Returns the bus of an SO-101 whose tip stands there, in simulated time, with the cable to it."""
    for module in ("frida_painter_drivers.so101.time", "scservo_sdk.port_handler.time"):
        monkeypatch.setattr(module, clock)
    clock.reading, clock.interrupts_reads = 0.001, False  # a stop comes from another thread, between two questions
    joints = So101Kinematics(sts_bus.BRUSH).start(tip)
    assert joints is not None
    made = sts_bus.StsBus(joints, **bus)
    return made, clock.attach(made)
