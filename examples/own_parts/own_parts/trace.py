"""`trace`: a robot that writes down where it would go, to be read before the real one is built.

Put the commands of your machine in the place of `_Sheet`; the rest is what every driver owes.
"""

import csv
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from frida_painter.plugins import (
    Interlock,
    MachineName,
    MotionReport,
    Point,
    RobotError,
    RobotKind,
    Waypoints,
    Workspace,
    require_home,
    yes_or_no,
)


class TraceRobot:
    """Implements hardware.robot.Robot: a row of (motion, x, y, z, speed) for each waypoint, metres and m/s."""

    def __init__(self, path: Path, home: Point, speed: float, append: bool) -> None:
        self._path, self._home, self._speed, self._append = path, np.array(home), speed, append
        self._guard = Interlock(f"the sheet {path}")  # refuses motions after a stop or a fault
        self._tip = self._home

    def connect(self) -> None:
        """Opens the sheet. A robot's library is imported here, and not at the head of the file."""
        try:
            with self._path.open("a" if self._append else "w", newline="") as sheet:
                if sheet.tell() == 0:
                    csv.writer(sheet).writerow(("motion", "x", "y", "z", "speed"))
        except OSError as error:
            raise RobotError(f"{self._path} cannot be written ({error.strerror}); give another file.") from error
        self._append, self._tip = True, self._home
        self._guard.mark_connected()

    def home(self) -> MotionReport:
        """Goes where the camera sees the whole canvas."""
        return self.follow(Waypoints("home", self._home[None], self._speed))

    def pose(self) -> NDArray[np.float64]:
        """Where the tip is, [3] metres."""
        self._guard.require_ready("pose")
        return self._tip.copy()

    def follow(self, waypoints: Waypoints) -> MotionReport:
        """Writes the motion down. A real driver returns when its robot has arrived, and says where it really is."""
        self._guard.require_ready(waypoints.label)
        self._guard.require_path(waypoints)
        started = time.monotonic()
        self._guard.asking(waypoints.label, lambda: self._write(waypoints))  # with a deadline
        self._tip = waypoints.position[-1].copy()
        return MotionReport(waypoints.label, started, time.monotonic(), self._tip.copy())

    def stop(self) -> None:
        """From any thread, without waiting: nothing more is written until the driver is connected anew."""
        self._guard.stop()

    def close(self) -> None:
        """Lets go of the sheet, which is open only while it is written."""
        self._guard.mark_disconnected()

    def _write(self, waypoints: Waypoints) -> None:
        with self._path.open("a", newline="") as sheet:
            csv.writer(sheet).writerows((waypoints.label, *place, waypoints.speed) for place in waypoints.position)


def _open(name: MachineName, workspace: Workspace) -> TraceRobot:
    name.require("append")
    append = name.choose("append", yes_or_no, False)
    return TraceRobot(Path(name.where).expanduser(), require_home(name, workspace), workspace.travel_speed, append)


KIND = RobotKind("trace", "trace:FILE[,append=yes]", "a sheet of what a robot would be told", open=_open)
