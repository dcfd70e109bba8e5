"""An arm's node as docs/how-to/ros.md wants it, which misbehaves when told to; plain Python on purpose.

The same node stands behind connections of the tests' own, and behind a websocket that plays rosbridge.
"""

import math
import threading
import time
from collections.abc import Callable
from typing import Any

CODES = {"taken": 1, "stopped": 5, "done": 4, "gave up": 6, "refused": 6}
"""ACCEPTED, CANCELED, SUCCEEDED, ABORTED of action_msgs."""


class RosArm:
    """tell(topic, message): says something; pace: how many times faster than asked it moves.

    misbehave: "" or what it does from the next motion on: "ignores" it, "refuses", "aborts", "stopped" at
    its own switch, "mute" (says nothing any more), "garbage pose", "garbage status", "odd status", "never",
    "slow" (takes ten times longer), "chatters" (tells of motions that ended long ago).
    abort: gives up its motion, until a person sets it free
    stopped: until a person sets it free; watchdog: seconds after the last
    sign of life of the painter at which it stops
    """

    watchdog = 1.0

    def __init__(self, tell: Callable[[str, dict[str, Any]], None], pace: float = 50.0) -> None:
        self.tell, self.pace = tell, pace
        self.misbehave = ""
        self.place = (0.2, 0.0, 0.3)
        self.moved: list[tuple[float, float, float]] = []
        self.at: list[float] = []
        self.heard: list[str] = []
        self.stopped = self.abort = self._restarted = False
        self._alive_at = -math.inf
        self._work: list[dict[str, Any]] = []
        self._running = True
        self._thread = threading.Thread(target=self._run, daemon=True)

    def start(self) -> None:
        self._thread.start()

    def restart(self) -> None:
        """The node ends and starts again: it stands, and has forgotten its motion."""
        self._restarted = True

    def end(self) -> None:
        self._running = False
        self._thread.join(2)

    def hear(self, topic: str, message: dict[str, Any]) -> None:
        if topic == "/brush/alive":
            self._alive_at = time.monotonic()
            return
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
        self._say_status(stamp, "refused" if self.misbehave == "refuses" else "taken")
        if self.misbehave == "refuses":
            return
        self._alive_at, self._restarted = time.monotonic(), False
        began, before, start = time.monotonic(), 0.0, self.place
        for number, point in enumerate(path["points"]):
            where = point["transforms"][0]["translation"]
            goal = (where["x"], where["y"], where["z"])
            slow = 10.0 if self.misbehave == "slow" else 1.0
            due = slow * sum(
                part * unit for part, unit in zip(point["time_from_start"].values(), (1, 1e-9), strict=True)
            )
            while self._running:
                now = (time.monotonic() - began) * self.pace
                share = 1.0 if due <= before else min(1.0, (now - before) / (due - before))
                self.place = tuple(a + max(0.0, share) * (b - a) for a, b in zip(start, goal, strict=True))
                self.moved.append(self.place)
                self.at.append(time.monotonic())
                if time.monotonic() > self._alive_at + self.watchdog:
                    self.stopped = True
                if self._restarted:
                    return
                if self.abort:
                    self.stopped = True
                    self._say_status(stamp, "gave up")
                    return
                if self.stopped:
                    self._say_status(stamp, "stopped")
                    return
                if share >= 1:
                    break
                self._say_pose()
                time.sleep(0.002)
            before, start = due, goal
            if number == 10 and self.misbehave in ("aborts", "stopped", "odd status"):
                self.stopped = True
                how = {"aborts": "gave up", "stopped": "stopped"}.get(self.misbehave, "")
                self._say_status(stamp, how)
                return
        while self.misbehave in ("never", "mute", "garbage pose", "garbage status") and self._running:
            self._say_pose()
            if self.misbehave == "garbage status":
                self.tell("/brush/status", {"status": "done", "goal_info": None})
            if self.stopped:
                return
            time.sleep(0.02)
        self._say_status(stamp, "done")

    def _say_status(self, stamp: dict[str, int], status: str) -> None:
        code = CODES.get(status, 77)
        self.tell("/brush/status", {"goal_info": {"goal_id": {"uuid": [0] * 16}, "stamp": stamp}, "status": code})

    def _say_pose(self) -> None:
        if self.misbehave == "mute" and self.moved:
            return
        if self.misbehave == "chatters":
            self._say_status({"sec": 1, "nanosec": 2}, "done")
        x, y, z = self.place
        if self.misbehave == "garbage pose" and self.moved:
            z = math.nan
        self.tell("/brush/pose", {"pose": {"position": {"x": x, "y": y, "z": z}}})
