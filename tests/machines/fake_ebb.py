"""An EiBotBoard, firmware 2.8, that counts steps and misbehaves when told to."""

import time
from collections import deque

from machines.fake_serial import FakeMachine


class FakeEbb(FakeMachine):
    """`misbehave` maps the number of an XM command (from 0) to "error", "mute", "garbage", "lose" or "unplug".

    moved: ((motor 1, motor 2), servo pulse) after every piece as it was made; at: when.
    """

    def __init__(self, pace: float = 100.0, misbehave: dict[int, str] | None = None, voltage: int = 300) -> None:
        super().__init__()
        self.pace, self.misbehave, self.voltage = pace, misbehave or {}, voltage
        self.motors, self.pulse = [0, 0], 0
        self.moved: list[tuple[tuple[int, int], int]] = []
        self.at: list[float] = []
        self.stops = 0
        self._rest = b""
        self._moves = 0
        self._mute = False
        self._queue: deque[tuple[float, int, int, int | None]] = deque()
        self._waiting: deque[str] = deque()
        self._free_at = time.monotonic()

    def hear(self, content: bytes) -> None:
        *lines, self._rest = (self._rest + content).split(b"\r")
        self._waiting.extend(line.decode() for line in lines if line)

    def say(self, line: str) -> None:
        if not self._mute:
            super().say(line)

    def pass_time(self) -> None:
        now = time.monotonic()
        while self._queue and now >= self._free_at:
            seconds, first, second, pulse = self._queue.popleft()
            self._free_at = max(self._free_at, now - 0.002) + seconds / self.pace
            self.motors[0] += first
            self.motors[1] += second
            self.pulse = self.pulse if pulse is None else pulse
            self.moved.append(((self.motors[0], self.motors[1]), self.pulse))
            self.at.append(now)
        # Like the board, it reads no further while its queue is full.
        while self._waiting and (len(self._queue) < 1 or self._waiting[0][:2] not in ("XM", "S2")):
            self._obey(self._waiting.popleft())

    def _obey(self, command: str) -> None:
        self.received.append(command)
        name, *values = command.split(",")
        if name == "V":
            self.say("EBBv13_and_above EB Firmware Version 2.8.1")
        elif name == "QC":
            self.say(f"0394,0{self.voltage}")
            self.say("OK")
        elif name == "QS":
            self.say(f"{self.motors[0]},{self.motors[1]}")
            self.say("OK")
        elif name == "QM":
            busy = bool(self._queue) or time.monotonic() < self._free_at
            self.say(f"QM,{int(busy)},{int(busy)},{int(busy)},{int(bool(self._queue))}")
        elif name == "ES":
            self.stops += 1
            self._queue.clear()
            self._waiting.clear()
            self.say("0,0,0,0,0")
            self.say("OK")
        elif name == "S2":
            self._queue.append((int(values[3]) / 1000, 0, 0, int(values[0])))
            self.say("OK")
        elif name == "XM":
            number, self._moves = self._moves, self._moves + 1
            fault = self.misbehave.get(number)
            if fault is not None:
                self._misbehave(fault)
                return
            milliseconds, right, down = (int(value) for value in values)
            assert milliseconds >= 1
            self._queue.append((milliseconds / 1000, right + down, right - down, None))
            self.say("OK")
        elif name in ("EM", "CS"):
            self.say("OK")
        else:
            self.say("!8 Err: Unknown command")

    def _misbehave(self, fault: str) -> None:
        if fault == "error":
            self.say("!3 Err: Invalid parameter value")
        elif fault == "garbage":
            self.say("\x7f~~")
        elif fault == "mute":
            self._mute = True
        elif fault == "unplug":
            self.unplug()
