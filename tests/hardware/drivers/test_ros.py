import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import pytest

from frida_painter.errors import MotionFailed, RobotDisconnected, RobotError, RobotStopped
from frida_painter_drivers import rosbridge
from frida_painter_drivers.rosbridge import RosRobot
from machines.paths import a_stroke
from machines.ros_arm import RosArm

HOME = (0.25, -0.1, 0.3)


@dataclass
class Air:
    """All connections between the driver and the arm."""

    listeners: dict[str, list[Callable[[Any], None]]] = field(default_factory=dict)
    broken: set[str] = field(default_factory=set)
    opened: int = 0

    def tell(self, topic: str, message: dict[str, Any]) -> None:
        for listener in self.listeners.get(topic, []):
            listener(message)


@dataclass
class AirConnection:
    """A connection of the test's own; `name` tells which of the two is broken."""

    air: Air
    arm: RosArm
    name: str
    is_open: bool = False

    def open(self) -> None:
        if self.name in self.air.broken:
            raise RobotDisconnected("No ROS at all.")
        self.is_open = True
        self.air.opened += 1

    def hear(self, topic: str, kind: str, tell: Callable[[Any], None]) -> None:
        self.air.listeners.setdefault(topic, []).append(tell)

    def announce(self, topic: str, kind: str) -> None: ...

    def publish(self, topic: str, message: Any) -> None:
        if self.name in self.air.broken or not self.is_open:
            raise RobotDisconnected("The connection is broken.")
        self.arm.hear(topic, message)

    def complaint(self) -> str:
        return ""

    def close(self) -> None:
        self.air.opened -= self.is_open
        self.is_open = False
        self.air.listeners.clear()


@pytest.fixture
def air() -> Air:
    return Air()


@pytest.fixture
def arm(air: Air) -> Iterator[RosArm]:
    arm = RosArm(air.tell)
    arm.start()
    yield arm
    arm.end()


@pytest.fixture
def robot(air: Air, arm: RosArm) -> RosRobot:
    return RosRobot(HOME, AirConnection(air, arm, "connection"), AirConnection(air, arm, "stopper"))


@pytest.mark.parametrize(
    ("fault", "error", "says"),
    [
        ("ignores", RobotDisconnected, "did not say on /brush/status that it took the motion"),
        ("refuses", MotionFailed, "gave up"),
        ("aborts", MotionFailed, "gave up; look"),
        ("stopped", RobotStopped, "was stopped there; look"),
        ("garbage pose", RobotError, "said .*pose.*, which cannot be understood"),
        ("garbage status", RobotError, "said .*done.*, which cannot be understood"),
        ("odd status", RobotError, "the status 77, which means nothing"),
        ("never", MotionFailed, "did not arrive in time"),
    ],
)
def test_whatever_the_arm_does_becomes_a_typed_error_and_it_is_told_to_stop(
    robot: RosRobot,
    arm: RosArm,
    air: Air,
    monkeypatch: pytest.MonkeyPatch,
    fault: str,
    error: type[RobotError],
    says: str,
) -> None:
    robot.connect()
    arm.misbehave = fault
    with monkeypatch.context() as patch, pytest.raises(error, match=says):
        patch.setattr(rosbridge, "PATIENCE", 0.3)
        patch.setattr(rosbridge, "_SILENCE", 0.3)
        patch.setattr(rosbridge, "motion_timeout", lambda path, speed: 0.4)
        robot.follow(a_stroke())
    assert arm.heard[-1] == "/brush/stop"
    arm.misbehave, arm.stopped = "", False
    moved, heard = _settled(arm)
    for action in (robot.home, robot.pose, lambda: robot.follow(a_stroke())):
        with pytest.raises(RobotError):
            action()
    assert (len(arm.moved), len(arm.heard)) == (moved, heard)
    robot.connect()
    robot.follow(a_stroke())
    assert air.opened == 2


def _settled(arm: Any) -> tuple[int, int]:
    """How often it moved and what it heard, once nothing more has come for a while, however slow the machine is."""
    before, quiet = (-1, -1), 0
    while quiet < 10:
        now = len(arm.moved), len(arm.heard)
        quiet = quiet + 1 if now == before else 0
        before = now
        time.sleep(0.02)
    return before


def test_an_arm_that_is_slower_than_asked_but_moves_is_alive(
    robot: RosRobot, arm: RosArm, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rosbridge, "motion_timeout", lambda path, speed: 0.05)
    monkeypatch.setattr(rosbridge, "PATIENCE", 0.5)
    robot.connect()
    arm.misbehave = "slow"
    assert robot.follow(a_stroke()).reached == pytest.approx(a_stroke().position[-1], abs=1e-9)
    assert robot.alive_at() > 0


@pytest.mark.parametrize("broken", ["connection", "stopper"])
def test_a_connection_that_fails_halfway_leaves_nothing_open_and_can_be_repeated(
    robot: RosRobot, air: Air, broken: str
) -> None:
    air.broken.add(broken)
    with pytest.raises(RobotDisconnected, match="No ROS at all"):
        robot.connect()
    assert air.opened == 0
    air.broken.clear()
    robot.connect()
    assert air.opened == 2


def test_ros_without_an_arm_is_told(air: Air, arm: RosArm, robot: RosRobot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rosbridge, "PATIENCE", 0.2)
    arm.end()
    with pytest.raises(RobotDisconnected, match="no arm in it says on /brush/pose where it is"):
        robot.connect()
    assert air.opened == 0


def test_stop_goes_over_its_own_wire_or_over_the_other(robot: RosRobot, arm: RosArm, air: Air) -> None:
    arm.pace = 1
    robot.connect()
    told: list[BaseException] = []

    def paint() -> None:
        try:
            robot.follow(a_stroke())
        except RobotError as error:
            told.append(error)

    thread = threading.Thread(target=paint)
    thread.start()
    while len(arm.moved) < 50:
        time.sleep(0.005)
    air.broken.add("stopper")
    stopped = time.monotonic()
    robot.stop()
    robot.stop()
    thread.join(2)
    assert isinstance(told[0], RobotStopped)
    assert arm.at[-1] - stopped < 0.1
    with pytest.raises(RobotStopped):
        robot.home()
