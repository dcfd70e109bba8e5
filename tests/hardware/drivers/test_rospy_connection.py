"""With a real ROS 1 master and a node of ours that plays the arm, where Debian's packages of ROS are installed."""

import json
import os
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from frida_painter.errors import RobotDisconnected, RobotError
from frida_painter.hardware.drivers import ros_connections
from frida_painter.hardware.drivers.ros_connections import RospyConnection
from machines.paths import a_stroke

MACHINES = Path(__file__).parents[2] / "machines"
SYSTEM = "/usr/bin/python3"
NEEDED = ("rospy", "rosmaster", "trajectory_msgs", "geometry_msgs", "actionlib_msgs", "std_msgs")
PACKAGES = Path("/usr/lib/python3/dist-packages")
installed = all((PACKAGES / name).is_dir() for name in NEEDED) and shutil.which("rosmaster") is not None
with_ros = pytest.mark.skipif(not installed, reason="ROS 1 is not installed (apt install ros-core python3-rospy)")


@pytest.fixture(scope="module")
def surroundings(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, str]]:
    """The environment of processes that speak with a master, which runs meanwhile."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    surroundings = os.environ | {
        "ROS_MASTER_URI": f"http://127.0.0.1:{port}",
        "ROS_HOSTNAME": "127.0.0.1",
        "ROS_LOG_DIR": str(tmp_path_factory.mktemp("ros")),
    }
    process = subprocess.Popen(
        [SYSTEM, shutil.which("rosmaster") or "", "--core", "-p", str(port)],
        env=surroundings | {"PYTHONPATH": ""},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    until = time.monotonic() + 15
    while time.monotonic() < until:
        try:
            socket.create_connection(("127.0.0.1", port), timeout=1).close()
            break
        except OSError:
            time.sleep(0.05)
    yield surroundings
    process.terminate()
    process.wait(5)


def painted(surroundings: dict[str, str], arm: str, what: str) -> dict[str, Any]:
    """What becomes of a stroke with an arm that misbehaves so."""
    node = subprocess.Popen(
        [SYSTEM, str(MACHINES / "ros_arm_node.py"), arm],
        env=surroundings | {"PYTHONPATH": ""},
        stderr=subprocess.DEVNULL,
    )
    try:
        done = subprocess.run(
            [sys.executable, str(MACHINES / "ros_painter.py"), surroundings["ROS_MASTER_URI"], what],
            env=surroundings, capture_output=True, text=True, timeout=60,
        )  # fmt: skip
        assert done.stdout, done.stderr
        return json.loads(done.stdout.splitlines()[-1])
    finally:
        node.terminate()
        node.wait(10)


@with_ros
@pytest.mark.slow
def test_a_stroke_is_painted_by_a_node_behind_a_real_master(surroundings: dict[str, str]) -> None:
    told = painted(surroundings, "", "paint")
    assert told.get("reached") == pytest.approx(a_stroke().position[-1], abs=1e-6), told
    assert told["took"] < 5


@with_ros
@pytest.mark.slow
@pytest.mark.parametrize(("arm", "what", "error"), [("aborts", "paint", "MotionFailed"), ("", "stop", "RobotStopped")])
def test_errors_and_stops_go_through_a_real_master(
    surroundings: dict[str, str], arm: str, what: str, error: str
) -> None:
    assert painted(surroundings, arm, what)["error"] == error


def test_no_master_at_the_address_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ros_connections, "_rospy", lambda: None)
    with socket.create_server(("127.0.0.1", 0)) as closed:
        port = closed.getsockname()[1]
    with pytest.raises(RobotDisconnected, match=rf"No ROS master answers at http://127.0.0.1:{port} .*roscore"):
        RospyConnection(f"http://127.0.0.1:{port}").open()


def test_without_ros_a_sentence_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ros_connections, "_PACKAGES", ())
    monkeypatch.setitem(sys.modules, "rospy", None)
    with pytest.raises(RobotError, match="apt install python3-rospy"):
        RospyConnection("http://127.0.0.1:1").open()
