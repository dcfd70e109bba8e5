import socket
import sys
import time

import numpy as np
import pytest

from frida_painter.errors import RobotDisconnected, RobotError
from frida_painter.hardware.drivers.ros import RosRobot, RosSettings
from frida_painter.hardware.drivers.ros_connections import RosbridgeConnection
from machines.paths import a_stroke

pytest.importorskip("roslibpy", reason="the extra `ros` is not installed")
from machines.fake_rosbridge import FakeRosbridge

HOME = (0.25, -0.1, 0.3)


def robot_behind(bridge: FakeRosbridge, version: int = 1) -> RosRobot:
    connections = (RosbridgeConnection("127.0.0.1", bridge.port) for _ in range(2))
    return RosRobot(RosSettings(HOME, ros=version), *connections)


@pytest.mark.parametrize("version", [1, 2])
def test_a_stroke_is_painted_through_rosbridge(version: int) -> None:
    with FakeRosbridge(version) as bridge:
        robot = robot_behind(bridge, version)
        robot.connect()
        report = robot.follow(a_stroke())
        assert report.reached == pytest.approx(a_stroke().position[-1], abs=1e-9)
        for point in a_stroke().position:
            assert min(np.linalg.norm(np.array(bridge.arm.moved) - point, axis=1)) < 1e-9
        assert len(bridge.clients) == 2  # the second is for stops alone
        assert bridge.advertised == {
            "/brush/follow": "trajectory_msgs/MultiDOFJointTrajectory",
            "/brush/stop": "std_msgs/Empty",
        }
        robot.stop()
        until = time.monotonic() + 2
        while not bridge.arm.stopped and time.monotonic() < until:
            time.sleep(0.01)
        assert bridge.arm.stopped
        robot.close()


def test_a_network_that_breaks_is_told_and_nothing_is_kept_for_later() -> None:
    with FakeRosbridge() as bridge:
        robot = robot_behind(bridge)
        robot.connect()
        bridge.drop()
        until = time.monotonic() + 2
        while bridge.clients and time.monotonic() < until:
            time.sleep(0.01)
        time.sleep(0.1)
        with pytest.raises(RobotDisconnected, match="is lost; look at it"):
            robot.follow(a_stroke())
        heard = len(bridge.arm.heard)
        robot.connect()
        time.sleep(0.2)
        assert len(bridge.arm.heard) == heard
        robot.follow(a_stroke())
        robot.close()


def test_nobody_at_the_address_is_told() -> None:
    with socket.create_server(("127.0.0.1", 0)) as closed:
        port = closed.getsockname()[1]
    robot = RosRobot(RosSettings(HOME), RosbridgeConnection("127.0.0.1", port), RosbridgeConnection("127.0.0.1", port))
    with pytest.raises(RobotDisconnected, match=rf"No rosbridge answers at 127.0.0.1:{port} \(Connection refused\)"):
        robot.connect()


def test_without_the_package_a_sentence_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "roslibpy", None)
    with pytest.raises(RobotError, match=r"pip install 'frida-painter\[ros\]'"):
        RosbridgeConnection("127.0.0.1").open()
