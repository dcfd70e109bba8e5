import socket
import sys
import threading
import time

import numpy as np
import pytest

from frida_painter.errors import RobotDisconnected, RobotError
from frida_painter_drivers.rosbridge import RosbridgeConnection, RosRobot
from machines.paths import a_stroke

pytest.importorskip("roslibpy", reason="the extra `ros` is not installed")
from machines.rosbridge import Rosbridge

HOME = (0.25, -0.1, 0.3)


def robot_behind(bridge: Rosbridge) -> RosRobot:
    connections = (RosbridgeConnection("127.0.0.1", bridge.port) for _ in range(2))
    return RosRobot(HOME, *connections)


def test_a_stroke_is_painted_through_rosbridge() -> None:
    with Rosbridge() as bridge:
        robot = robot_behind(bridge)
        robot.connect()
        report = robot.follow(a_stroke())
        assert report.reached == pytest.approx(a_stroke().position[-1], abs=1e-9)
        for point in a_stroke().position:
            assert min(np.linalg.norm(np.array(bridge.arm.moved) - point, axis=1)) < 1e-9
        assert len(bridge.clients) == 2  # the second is for stops alone
        assert bridge.advertised == {
            "/brush/follow": "trajectory_msgs/msg/MultiDOFJointTrajectory",
            "/brush/alive": "std_msgs/msg/Empty",
            "/brush/stop": "std_msgs/msg/Empty",
        }
        robot.stop()
        until = time.monotonic() + 2
        while not bridge.arm.stopped and time.monotonic() < until:
            time.sleep(0.01)
        assert bridge.arm.stopped
        robot.close()


def test_m21_a_missing_package_is_told() -> None:
    with Rosbridge() as bridge:
        bridge.packages.remove("trajectory_msgs")
        robot = robot_behind(bridge)
        with pytest.raises(RobotError, match=r"ROS 2 was expected, and it says: .*trajectory_msgs"):
            robot.connect()


def test_m22_an_arm_stops_where_its_painter_died_and_rosbridge_does_not_tell() -> None:
    with Rosbridge() as bridge:
        bridge.arm.pace = 0.1
        robot = robot_behind(bridge)
        robot.connect()

        def paint() -> None:
            with pytest.raises(RobotDisconnected):
                robot.follow(a_stroke())

        thread = threading.Thread(target=paint)
        thread.start()
        until = time.monotonic() + 5
        while len(bridge.arm.moved) < 20 and time.monotonic() < until:
            time.sleep(0.01)
        bridge.freeze()
        died = time.monotonic()
        while not bridge.arm.stopped and time.monotonic() < died + 5:
            time.sleep(0.01)
        assert bridge.arm.stopped and len(bridge.clients) == 2
        assert bridge.arm.at[-1] - died < 1.3
        thread.join(5)  # the driver hears nothing for two seconds, and says so
        robot.close()


def test_the_doctor_tells_what_ros_does_not() -> None:
    with Rosbridge() as bridge:
        robot = robot_behind(bridge)
        first, often, last = robot.examine().facts
        assert "speaks ROS 2; its tip is at (200, 0, 300) mm" in first.text
        assert "times a second where it is" in often.text
        assert last.weight == "warning" and "after a second without /brush/alive" in last.text
        assert bridge.arm.heard == []


def test_nobody_at_the_address_is_told() -> None:
    with socket.create_server(("127.0.0.1", 0)) as closed:
        port = closed.getsockname()[1]
    robot = RosRobot(HOME, RosbridgeConnection("127.0.0.1", port), RosbridgeConnection("127.0.0.1", port))
    with pytest.raises(RobotDisconnected, match=rf"No rosbridge answers at 127.0.0.1:{port} \(Connection refused\)"):
        robot.connect()


def test_without_the_package_a_sentence_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "roslibpy", None)
    with pytest.raises(RobotError, match='extra "ros"'):
        RosbridgeConnection("127.0.0.1").open()
