"""Drives an arm behind ROS, in a process of its own, for rospy never leaves one: ros_painter.py MASTER paint|stop."""

import json
import sys
import threading
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from frida_painter.errors import FridaError
from frida_painter.hardware.drivers.ros import RosRobot, RosSettings
from frida_painter.hardware.drivers.ros_connections import RospyConnection
from machines.paths import a_stroke

robot = RosRobot(RosSettings((0.25, -0.1, 0.3), ros=1), RospyConnection(sys.argv[1]), RospyConnection(sys.argv[1]))
try:
    robot.connect()
    if sys.argv[2] == "stop":
        threading.Timer(0.1, robot.stop).start()
    report = robot.follow(a_stroke(speed=0.06 if sys.argv[2] == "paint" else 0.002))
    print(json.dumps({"reached": report.reached.tolist(), "took": report.finished_at - report.started_at}))
    robot.close()
except FridaError as error:
    time.sleep(0.2)
    print(json.dumps({"error": type(error).__name__, "says": str(error)}))
