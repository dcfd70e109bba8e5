"""Robots and cameras that misbehave in every way there is, and the clock that makes them do it quickly."""

import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from support.easel import NotingRobot, PatientCamera

Action = Callable[[], Any]


def fine() -> None:
    """Nothing goes wrong."""


def vendor_error() -> None:
    raise OSError(110, "APIException: controller is not responding")


def unknown() -> None:
    raise ZeroDivisionError


@dataclass
class Hang:
    """A call that never returns; the tests let it go when they are done, so that no thread is left behind."""

    released: threading.Event = field(default_factory=threading.Event)

    def __call__(self) -> None:
        self.released.wait(30)


class MisbehavingRobot(NotingRobot):
    """Does as NotingRobot does, but for the method `bad`, which does `action` first and may return `garbage`."""

    def __init__(self, bad: str = "", action: Action = fine, garbage: Any = None) -> None:
        super().__init__()
        self.bad, self.action, self.garbage = bad, action, garbage
        self.calls: list[str] = []
        self.stops = 0

    def stop(self) -> None:
        self.stops += 1
        self._misbehave("stop", None)

    def connect(self) -> None:
        self._misbehave("connect", None)

    def close(self) -> None:
        self._misbehave("close", None)

    def pose(self) -> Any:
        there = self.motions[-1].position[-1] if self.motions else np.array([0.0, 0.0, 0.3])
        return self._misbehave("pose", there)

    def home(self) -> Any:
        return self._misbehave("home", super().home())

    def follow(self, waypoints: Any) -> Any:
        self.calls.append(waypoints.label)
        return (
            self._misbehave("follow", super().follow(waypoints))
            if waypoints.label != "home"
            else super().follow(waypoints)
        )

    def _misbehave(self, name: str, result: Any) -> Any:
        if name != self.bad:
            return result
        self.action()
        return self.garbage if self.action is fine else result


class MisbehavingCamera(PatientCamera):
    """Likewise a camera."""

    def __init__(self, bad: str = "", action: Action = fine, garbage: Any = None) -> None:
        super().__init__()
        self.bad, self.action, self.garbage = bad, action, garbage

    def connect(self) -> None:
        self._misbehave("connect", None)

    def close(self) -> None:
        self._misbehave("close", None)

    def capture(self, newer_than: float) -> Any:
        return self._misbehave("capture", super().capture(newer_than))

    def _misbehave(self, name: str, result: Any) -> Any:
        if name != self.bad:
            return result
        self.action()
        return self.garbage if self.action is fine else result
