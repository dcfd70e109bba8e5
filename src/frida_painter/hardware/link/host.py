"""The easel's end of the link: does what the painting process asks for, one thing after another.

A request names a part of the easel and what it is to do; the answer holds the result, or the kind and
the sentence of an error of the tree in errors.py.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from frida_painter.errors import FridaError, MotionFailed, RobotBusy, RobotDisconnected, RobotError, RobotStopped
from frida_painter.hardware.camera import Camera
from frida_painter.hardware.easel import Operator
from frida_painter.hardware.link.wire import Wire
from frida_painter.hardware.reach import Reach
from frida_painter.hardware.robot import MotionReport, Robot, Waypoints
from frida_painter.palette import Palette

Answer = tuple[dict[str, Any], dict[str, NDArray[Any]]]


@dataclass(frozen=True)
class Host:
    """Serves an easel over a wire, with robot and camera under guard; reach: of its arm, where that is asked for."""

    robot: Robot
    camera: Camera
    operator: Operator
    reach: Reach | None = None

    def serve(self, wire: Wire) -> bool:
        """Answers requests until the painting process asks for the end, which is then still to be answered (True).

        False where it is gone, and nobody is left to tell.
        """
        try:
            while True:
                words, arrays = wire.receive()
                if words.get("do") == "end":
                    return True
                wire.send(*self._answer(words, arrays))
        except RobotDisconnected:
            return False

    def _answer(self, words: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> Answer:
        try:
            return self._do(words, arrays)
        except FridaError as error:
            return told(error), {}
        except (KeyError, TypeError, ValueError, IndexError) as error:
            return told(RobotError(f"The easel's process could not read {words.get('do')!r} ({error!r}).")), {}

    def _do(self, words: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> Answer:
        robot, camera, operator = self.robot, self.camera, self.operator
        match words.get("do"):
            case "robot.connect":
                robot.connect()
            case "robot.home":
                return _report(robot.home())
            case "robot.pose":
                return {}, {"pose": robot.pose()}
            case "robot.follow":
                return _report(robot.follow(Waypoints(str(words["label"]), arrays["position"], float(words["speed"]))))
            case "robot.close":
                robot.close()
            case "robot.reaches" if self.reach is not None:
                return {}, {"reachable": self.reach.reachable(arrays["position"]).astype(np.uint8)}
            case "camera.connect":
                camera.connect()
            case "camera.capture":
                frame = camera.capture(float(words["newer_than"]))
                return {"captured_at": frame.captured_at, "sequence": frame.sequence}, {"image": frame.image}
            case "camera.close":
                camera.close()
            case "operator.fill_wells":
                operator.fill_wells(Palette(torch.from_numpy(arrays["color"])))
            case "operator.tone":
                red, green, blue = map(float, words["ground"])
                operator.tone((red, green, blue))
            case "operator.change_brush":
                operator.change_brush(str(words["brush"]))
            case "operator.let_dry":
                operator.let_dry(words["seconds"])
            case "operator.lay_paper":
                return {"done": operator.lay_paper()}, {}
            case "operator.lay_checker":
                return {"done": operator.lay_checker()}, {}
            case "operator.take_checker_away":
                return {"done": operator.take_checker_away()}, {}
            case unknown:
                raise RobotError(f"The easel's process was asked for {unknown!r}, which it does not know.")
        return {}, {}


def told(error: FridaError) -> dict[str, Any]:
    """An error as words for the other end, which `heard` makes one again."""
    details: dict[str, Any] = {}
    if isinstance(error, RobotBusy):
        details = {"pid": error.pid}
    elif isinstance(error, MotionFailed):
        details = {"code": error.code, "waypoint": error.waypoint}
    elif isinstance(error, RobotStopped):
        details = {"asked": error.asked}
    return {"error": type(error).__name__, "message": str(error), "details": details}


def _report(report: MotionReport) -> Answer:
    times = {"label": report.label, "started_at": report.started_at, "finished_at": report.finished_at}
    return times, {"reached": np.asarray(report.reached, np.float64)}
