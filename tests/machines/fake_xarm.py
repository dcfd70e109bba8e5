"""A control box of an xArm behind the calls of its SDK that are used, which misbehaves when told to.

Its numbers, units and states are those of xarm-python-sdk: millimetres, codes, (code, value) pairs.
"""

import threading
import time
from collections import deque
from typing import Any

import numpy as np


class ApiError(Exception):
    """What the SDK raises itself."""


class ControlBox:
    """One arm; every connection of `api` speaks to it. pace: how many times faster than real it moves.

    `misbehave` maps the name of a call to "vendor" (the SDK's exception), "unknown" (another one),
    "hangs", "garbage" or "refuses" (code 9); it applies from the `after`-th such call on.
    error_at: the waypoint at which error 31 (it ran into something) comes up; protective_at: where it
    is stopped at its own switch; paused_at: where somebody pauses it; astray: mm that it ends beside
    where it was sent; hasty: it says that it stands, with nothing left to do, as soon as all was sent.
    """

    def __init__(self, pace: float = 100.0) -> None:
        self.pace = pace
        self.misbehave: dict[str, str] = {}
        self.after: dict[str, int] = {}
        self.place = np.array([300.0, 0.0, 200.0, 180.0, 0.0, 0.0])
        self.state, self.error, self.enabled = 5, 0, False
        self.error_at: int | None = None
        self.protective_at: int | None = None
        self.paused_at: int | None = None
        self.astray = np.zeros(3)
        self.hasty = False
        self.calls: list[tuple[str, Any]] = []
        self.connections = 0
        self.moved: list[np.ndarray] = []
        self.at: list[float] = []
        self.sent = 0
        self._queue: deque[tuple[np.ndarray, float]] = deque()
        self._lock = threading.RLock()
        self._last = time.monotonic()
        self.free = threading.Event()

    def api(self, address: str, is_radian: bool | None = None, do_not_open: bool = False) -> "FakeApi":
        assert do_not_open and is_radian is False
        return FakeApi(self, address)

    def run(self) -> None:
        """Moves as far as the time since the last look allows."""
        with self._lock:
            now = time.monotonic()
            budget, self._last = (now - self._last) * self.pace, now
            while self._queue and budget > 0 and self.state not in (3, 4):
                target, speed = self._queue[0]
                far = float(np.linalg.norm(target[:3] - self.place[:3]))
                if far > speed * budget:
                    self.place = self.place + (target - self.place) * speed * budget / far
                    budget = 0
                else:
                    budget -= far / speed
                    self.place = target
                    self._queue.popleft()
                self.moved.append(self.place[:3].copy())
                self.at.append(now)
            if self.state not in (3, 4, 5):
                self.state = 1 if self._queue else 2

    def call(self, name: str, given: Any = None) -> str | None:
        """Notes a call and says how it is to misbehave."""
        with self._lock:
            self.run()
            self.calls.append((name, given))
            count = sum(1 for called, _ in self.calls if called == name)
            kind = self.misbehave.get(name)
            if kind is None or count <= self.after.get(name, 0):
                return None
        if kind == "vendor":
            raise ApiError(f"{name}: -8, timed out")
        if kind == "unknown":
            raise ZeroDivisionError("never heard of")
        if kind == "hangs":
            self.free.wait(30)
        return kind

    def stop(self) -> None:
        with self._lock:
            self.run()
            self.state = 4
            self._queue.clear()

    def queue(self, target: np.ndarray, speed: float) -> int:
        with self._lock:
            if not self.enabled or self.state == 4 or self.error:
                return 1 if self.error else 9
            number, self.sent = self.sent, self.sent + 1
            if number == self.error_at:
                self.error = 31
                self.stop()
                return 1
            if number == self.protective_at:
                self.stop()
                return 0
            self._queue.append((target + np.r_[self.astray, 0, 0, 0], speed))
            if number == self.paused_at:
                self.state = 3
            elif self.state != 3:
                self.state = 1
            return 0


class FakeApi:
    """xarm.wrapper.XArmAPI as far as it is used."""

    def __init__(self, box: ControlBox, address: str) -> None:
        self._box, self._address = box, address
        self._connected = False

    def connect(self) -> None:
        self._box.call("connect")
        self._connected = True
        self._box.connections += 1

    def disconnect(self) -> None:
        self._box.call("disconnect")
        self._box.connections -= self._connected
        self._connected = False

    def motion_enable(self, enable: bool) -> Any:
        return self._answer("motion_enable", lambda: setattr(self._box, "enabled", enable) or 0)

    def set_mode(self, mode: int) -> Any:
        return self._answer("set_mode", lambda: 0, mode)

    def set_state(self, state: int) -> Any:
        def change() -> int:
            if state == 4:
                self._box.stop()
            elif self._box.error == 0:
                self._box.state = 2
            return 0

        return self._answer("set_state", change, state)

    def get_position(self, is_radian: bool) -> Any:
        assert is_radian is False
        return self._answer("get_position", lambda: (0, self._box.place.tolist()))

    def get_state(self) -> Any:
        return self._answer("get_state", lambda: (0, 2 if self._box.hasty else self._box.state))

    def get_cmdnum(self) -> Any:
        return self._answer("get_cmdnum", lambda: (0, 0 if self._box.hasty else len(self._box._queue)))

    def get_err_warn_code(self) -> Any:
        return self._answer("get_err_warn_code", lambda: (0, [self._box.error, 0]))

    def set_position(
        self, x: float, y: float, z: float, roll: float, pitch: float, yaw: float, *, radius: float | None,
        speed: float, mvacc: float, is_radian: bool, wait: bool,
    ) -> Any:  # fmt: skip
        assert is_radian is False and wait is False and mvacc > 0
        target = np.array([x, y, z, roll, pitch, yaw])
        return self._answer("set_position", lambda: self._box.queue(target, speed), (radius, speed))

    def _answer(self, name: str, well: Any, given: Any = None) -> Any:
        kind = self._box.call(name, given)
        if kind == "garbage":
            return ("?", None, 3.5)
        if kind == "refuses":
            return 9
        return well()
