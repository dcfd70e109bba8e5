"""An arm's node as the `ros` driver's contract wants it, which misbehaves when told to; plain Python on purpose.

The same node stands behind connections of the tests' own, behind a websocket that plays rosbridge, and in a
process of its own behind a real ROS master.
"""

import math
import threading
import time
from collections.abc import Callable
from typing import Any


class FakeArm:
    """tell(topic, message): says something; pace: how many times faster than asked it moves.

    misbehave: "" or what it does from the next motion on: "ignores" it, "refuses", "aborts", "stopped" at
    its own switch, "mute" (says nothing any more), "garbage pose", "garbage status", "odd status", "never".
    """

    def __init__(self, tell: Callable[[str, dict[str, Any]], None], pace: float = 50.0, ros: int = 1) -> None:
        self.tell, self.pace, self.ros = tell, pace, ros
        self.misbehave = ""
        self.place = (0.2, 0.0, 0.3)
        self.moved: list[tuple[float, float, float]] = []
        self.at: list[float] = []
        self.heard: list[str] = []
        self.stopped = False
        self._work: list[dict[str, Any]] = []
        self._running = True
        self._thread = threading.Thread(target=self._run, daemon=True)

    def start(self) -> None:
        self._thread.start()

    def end(self) -> None:
        self._running = False
        self._thread.join(2)

    def hear(self, topic: str, message: dict[str, Any]) -> None:
        self.heard.append(topic)
        if topic == "/brush/stop":
            self.stopped = True
        elif topic == "/brush/follow" and self.misbehave != "ignores":
            self._work.append(message)

    def _run(self) -> None:
        while self._running:
            if self._work and not self.stopped:
                self._follow(self._work.pop(0))
            self._work = [] if self.stopped else self._work
            self._say_pose()
            time.sleep(0.01)

    def _follow(self, path: dict[str, Any]) -> None:
        stamp = path["header"]["stamp"]
        assert path["joint_names"] == ["brush_tip"] and path["header"]["frame_id"] == "base"
        self._say_status(stamp, {"refuses": 5}.get(self.misbehave, 1), self.misbehave)
        if self.misbehave == "refuses":
            return
        began, before, start = time.monotonic(), 0.0, self.place
        for number, point in enumerate(path["points"]):
            where = point["transforms"][0]["translation"]
            goal = (where["x"], where["y"], where["z"])
            due = sum(part * unit for part, unit in zip(point["time_from_start"].values(), (1, 1e-9), strict=True))
            while self._running:
                now = (time.monotonic() - began) * self.pace
                share = 1.0 if due <= before else min(1.0, (now - before) / (due - before))
                self.place = tuple(a + max(0.0, share) * (b - a) for a, b in zip(start, goal, strict=True))
                self.moved.append(self.place)
                self.at.append(time.monotonic())
                if self.stopped:
                    self._say_status(stamp, 2, "told to stop")
                    return
                if share >= 1:
                    break
                self._say_pose()
                time.sleep(0.002)
            before, start = due, goal
            if number == 10 and self.misbehave in ("aborts", "stopped", "odd status"):
                self.stopped = True
                self._say_status(stamp, {"aborts": 4, "stopped": 2, "odd status": 77}[self.misbehave], "at point 10")
                return
        while self.misbehave in ("never", "mute", "garbage pose", "garbage status") and self._running:
            self._say_pose()
            if self.misbehave == "garbage status":
                self.tell("/brush/status", {"status": "done", "goal_id": None})
            if self.stopped:
                return
            time.sleep(0.02)
        self._say_status(stamp, 3, "")

    def _say_status(self, stamp: dict[str, int], status: int, text: str) -> None:
        self.tell("/brush/status", {"goal_id": {"stamp": stamp, "id": ""}, "status": status, "text": text})

    def _say_pose(self) -> None:
        if self.misbehave == "mute" and self.moved:
            return
        x, y, z = self.place
        if self.misbehave == "garbage pose" and self.moved:
            z = math.nan
        self.tell("/brush/pose", {"pose": {"position": {"x": x, "y": y, "z": z}}})
