"""A GRBL 1.1 that misbehaves when told to: it plans, moves at a pace, reports, holds, resets, and raises alarms."""

import re
import time
from collections import deque

import numpy as np

from machines.fake_serial import FakeMachine

_PLANNED = 15


class FakeGrbl(FakeMachine):
    """pace: how many times faster than real it moves.

    `misbehave` maps the number of a motion line (from 0) to what happens instead of its "ok":
    "error", "alarm", "quiet alarm" (which only its reports tell), "reset", "lose" (the line never arrived),
    "mute" (dead from then on), "Door:1", "Hold:0" or "Sleep" (as its reports tell from then on), "garbage",
    "unplug", or "twice" (it is obeyed, and acknowledged twice).
    moved: every place that the tip went to, in mm, as it happened.
    """

    def __init__(self, pace: float = 200.0, misbehave: dict[int, str] | None = None, state: str = "Idle") -> None:
        super().__init__()
        self.pace, self.misbehave, self.state = pace, misbehave or {}, state
        self.place = np.zeros(3)
        self.offset = np.array([10.0, 20.0, 5.0])
        self.moved: list[np.ndarray] = []
        self.at: list[float] = []
        self.reports = 0
        self.lies = np.zeros(3)
        self._line = b""
        self._motions = 0
        self._queue: deque[tuple[str, np.ndarray | None, float]] = deque()
        self._waiting: deque[str] = deque()
        self._last = time.monotonic()
        self._mute = False

    def hear(self, content: bytes) -> None:
        for byte in content:
            if byte == ord("?"):
                self._report()
            elif byte == ord("!"):
                self.received.append("!")
                if self.state in ("Idle", "Run"):
                    self.state = "Hold:0"
            elif byte == 0x18:
                self.received.append("reset")
                self._reset()
            elif byte == ord("\n"):
                self._waiting.append(self._line.decode())
                self._line = b""
            elif byte != ord("\r"):
                self._line += bytes([byte])

    def pass_time(self) -> None:
        while self._waiting and len(self._queue) < _PLANNED and not self.state.startswith(("Hold", "Door")):
            if self._queue and self._waiting[0].startswith("G4"):
                break
            self._obey(self._waiting.popleft())
        now = time.monotonic()
        budget, self._last = (now - self._last) * self.pace, now
        if self.state.startswith(("Hold", "Alarm", "Door", "Sleep")):
            return
        while self._queue and budget > 0:
            _, target, speed = self._queue[0]
            way = target - self.place
            far, reach = float(np.linalg.norm(way)), speed * budget
            if far > reach:
                self.place = self.place + way * reach / far
                budget = 0
            else:
                budget -= far / max(speed, 1e-9)
                self.place = target
                self._queue.popleft()
            self.moved.append(self.place)
            self.at.append(now)
        self.state = "Run" if self._queue else "Idle"

    def say(self, line: str) -> None:
        if not self._mute:
            super().say(line)

    def _obey(self, line: str) -> None:
        self.received.append(line)
        if self.state.startswith("Alarm") and line != "$H":
            self.say("error:9")
            return
        if line == "$H":
            self.state, self.place = "Idle", np.zeros(3)
        if line.startswith("G1"):
            number, self._motions = self._motions, self._motions + 1
            fault = self.misbehave.get(number)
            if fault == "lose":
                self.received.pop()
                return
            if fault == "twice":
                self.say("ok")
            elif fault is not None:
                self._misbehave(fault)
                return
            words = {word[0]: float(word[1:]) for word in re.findall(r"[XYZSF]-?[\d.]+", line)}
            before = self._queue[-1][1] if self._queue else self.place
            target = np.array([words.get(axis, before[i]) for i, axis in enumerate("XYZ")])
            self._queue.append((line, target, words["F"] / 60))
        self.say("ok")

    def _misbehave(self, fault: str) -> None:
        if fault == "error":
            self.say("error:15")
        elif fault == "alarm":
            self._queue.clear()
            self.state = "Alarm"
            self.say("ALARM:1")
        elif fault == "quiet alarm":
            self._queue.clear()
            self.state = "Alarm"
        elif fault == "reset":
            self._reset()
        elif fault == "garbage":
            self.say("\x7f~~ qwertz")
        elif fault == "mute":
            self._mute = True
        elif fault[0].isupper():
            self.state = fault
        elif fault == "unplug":
            self.unplug()

    def _reset(self) -> None:
        self._queue.clear()
        self._waiting.clear()
        if not self.state.startswith("Alarm"):
            self.state = "Idle"
        self.say("")
        self.say("Grbl 1.1h ['$' for help]")

    def _report(self) -> None:
        self.reports += 1
        place = self.place + self.offset + self.lies
        offset = f"|WCO:{','.join(f'{value:.3f}' for value in self.offset)}" if self.reports % 30 == 2 else ""
        self.say(f"<{self.state}|MPos:{','.join(f'{value:.3f}' for value in place)}|FS:0,0{offset}>")
