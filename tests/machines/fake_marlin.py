"""A Marlin that checks numbers and checksums, and misbehaves when told to."""

import re
import time

import numpy as np

from machines.fake_serial import FakeMachine


class FakeMarlin(FakeMachine):
    """`misbehave` maps the number of a motion line (from 0) to "damage" (arrives damaged once), "always damage",
    "lose", "reset", "kill" or "mute". moved: every place that the tip was sent to, in mm."""

    def __init__(self, misbehave: dict[int, str] | None = None, pace: float = 50.0) -> None:
        super().__init__()
        self.misbehave, self.pace = misbehave or {}, pace
        self.place = np.zeros(3)
        self.moved: list[np.ndarray] = []
        self.stopped_at = 0.0
        self._last, self._motions = 0, 0
        self._rest = b""
        self._mute = False

    def hear(self, content: bytes) -> None:
        *lines, self._rest = (self._rest + content).split(b"\n")
        for line in lines:
            self._obey(line.decode())

    def say(self, line: str) -> None:
        if not self._mute:
            super().say(line)

    def _obey(self, text: str) -> None:
        if text == "M410":
            self.stopped_at = time.monotonic()
            self.received.append(text)
            return
        if text == "M110 N0":
            self._last = 0
            self.say("ok")
            return
        match = re.fullmatch(r"N(\d+) (.*)\*(\d+)", text)
        if match is None:
            return
        number, line, checksum = int(match[1]), match[2], int(match[3])
        fault = None
        if line.startswith("G1"):
            fault = self.misbehave.get(self._motions)
            if fault != "always damage":
                self._motions += 1
        if fault in ("lose", "mute"):
            self._mute = fault == "mute"
            return
        wanted = 0
        for byte in text.rpartition("*")[0].encode():
            wanted ^= byte
        if checksum != wanted or fault in ("damage", "always damage"):
            self.say(f"Error:checksum mismatch, Last Line: {self._last}")
            self.say(f"Resend: {self._last + 1}")
            self.say("ok")
            return
        if number != self._last + 1:
            self.say(f"Error:Line Number is not Last Line Number+1, Last Line: {self._last}")
            self.say(f"Resend: {self._last + 1}")
            self.say("ok")
            return
        self._last = number
        self.received.append(line)
        if fault == "reset":
            self.say("start")
            return
        if fault == "kill":
            self.say("Error:Printer halted. kill() called!")
            return
        if line.startswith("G1"):
            words = {word[0]: float(word[1:]) for word in re.findall(r"[XYZF]-?[\d.]+", line)}
            target = np.array([words.get(axis, self.place[i]) for i, axis in enumerate("XYZ")])
            time.sleep(float(np.linalg.norm(target - self.place)) / (words["F"] / 60) / self.pace)
            self.place = target
            self.moved.append(target)
            self.say("echo:busy: processing")
        if line == "M114":
            x, y, z = self.place
            self.say(f"X:{x:.2f} Y:{y:.2f} Z:{z:.2f} E:0.00 Count X:0 Y:0 Z:0")
        self.say("ok")
