"""A simulated control box of an xArm at a socket, to which the maker's own SDK connects.

Sources: xarm-python-sdk 1.18 (core/wrapper/uxbus_cmd*.py: the frames; core/config: registers; x3/base.py: reports and
bits of the state; core/config/x_code.py: codes), and what UFACTORY's people wrote in the SDK's issues: 46, 59, 79,
107. Nothing here is taken from our driver.
"""

import contextlib
import math
import socket
import struct
import threading
import time
from collections import deque
from dataclasses import dataclass
from typing import Self

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

STANDARD_REACH = (100.0, 700.0)
"""Nearest and farthest place of the tool from the shoulder of an xArm 6, millimetres."""
_SHOULDER = np.array([0.0, 0.0, 267.0])
MOVING, STANDBY, PAUSED, STOPPED, RESET = 1, 2, 3, 4, 5
TEACHING = 2
QUEUE_IS_FULL, NO_SOLUTION = 11, 14
PLANNING, COLLISION = 25, 31
_GET_VERSION, _GET_SN, _MOTION_EN, _SET_STATE, _GET_STATE, _GET_CMDNUM, _GET_ERROR = 1, 2, 11, 12, 13, 14, 15
_CLEAN_ERROR, _CLEAN_WARNING, _SET_MODE, _MOVE_LINE, _SET_LOAD, _SET_SENSITIVITY, _GET_POSE = 16, 17, 19, 21, 36, 37, 41
_IS_TCP_LIMIT = 46
_TICK = 0.004  # seconds of the arm


@dataclass
class Line:
    """A straight line in the queue: target in millimetres and radians, mm/s, mm/s2, blending radius (below 0: none)."""

    target: np.ndarray
    speed: float
    gain: float
    radius: float


class XarmBox:
    """One arm with its control box; `place` listens while it is entered.

    pace: how many times faster than real its time goes
    room: lines that the queue takes; firmware of today has room for 2048

    Faults: `errors` maps the number of a line (from 0, as it begins) to a code that comes up then; `events` maps it to
    "stop" (somebody presses stop), "pause", "configuration" (somebody changes the payload) or "speed" (its speed is
    reduced to a tenth); `mute`: it takes commands and answers none; `garbage`: it answers nonsense.
    """

    def __init__(self, *, pace: float = 50.0, room: int = 2048, version: str = "2.5.1") -> None:
        self.pace, self.room, self.version = pace, room, version
        self.pose = np.array([300.0, 0.0, 200.0, math.pi, 0.0, 0.0])
        self.state, self.mode, self.error, self.warning = RESET, 0, 0, 0
        self.on = False
        self.load, self.sensitivity = 0.5, 3
        self.errors: dict[int, int] = {}
        self.events: dict[int, str] = {}
        self.mute = self.garbage = False
        self.slowed = 1.0
        self.moved: list[np.ndarray] = []
        self.turned: list[np.ndarray] = []
        self.at: list[float] = []
        self.ignored = self.clears = self.connections = self.stops = self._told = 0
        self.commands: list[int] = []
        self._queue: deque[Line] = deque()
        self._begun = 0
        self._current: Line | None = None
        self._speed = 0.0
        self._ready_at = -math.inf
        self._t, self._now, self._began = 0.0, 0.0, time.monotonic()
        self._lock = threading.RLock()
        self._running = True
        self._sockets: list[socket.socket] = []
        self._threads: list[threading.Thread] = []
        self.control, self._control = self._listen()
        self.report, self._report = self._listen()

    def __enter__(self) -> Self:
        for listener, serve in ((self._control, self._serve), (self._report, self._tell)):
            self._spawn(self._accept, listener, serve)
        self._spawn(self._live)
        return self

    def __exit__(self, *_: object) -> None:
        self._running = False
        for one in (self._control, self._report, *self._sockets):
            _shut(one)
        for thread in self._threads:
            thread.join(2)

    def leave_network(self) -> None:
        """Somebody pulls its network cable, and the switch tells all others so: nobody answers any more."""
        for listener in (self._control, self._report):
            _shut(listener)
        self.cut_network()

    def join_network(self) -> None:
        """The cable is plugged in again."""
        self.control, self._control = self._listen(self.control)
        self.report, self._report = self._listen(self.report)
        for listener, serve in ((self._control, self._serve), (self._report, self._tell)):
            self._spawn(self._accept, listener, serve)

    def cut_network(self) -> None:
        """The network breaks: all connections are gone. The arm goes on with its queue."""
        for one in self._sockets:
            _shut(one)
        self._sockets.clear()

    def clear_error(self) -> None:
        """A person clears the error at the arm and switches it on again."""
        with self._lock:
            self.error, self.state = 0, STANDBY

    def guide(self, poses: np.ndarray, seconds: float) -> int:
        """A person leads the arm through poses [n, 6] (mm, radians); returns how many of them it followed.


        It follows in mode 2, joint teaching, once set_state(0) enabled that (xarm_api.py: set_mode and
        start_record_trajectory), and holds its place otherwise. The person waits at each pose until its place was
        asked for, so that a busy machine misses no mark.
        """
        followed = 0
        for pose in poses:
            with self._lock:
                if self.mode == TEACHING and self.state in (MOVING, STANDBY) and self.on and not self.error:
                    self.pose = np.array(pose, dtype=np.float64)
                    followed += 1
            told = self._told
            time.sleep(seconds / len(poses))
            while self.mode == TEACHING and self.state in (MOVING, STANDBY) and self._told == told:
                time.sleep(0.002)
        return followed

    # Connections.

    def _listen(self, port: int = 0) -> tuple[int, socket.socket]:
        listener = socket.create_server(("127.0.0.1", port))
        listener.settimeout(None)
        return listener.getsockname()[1], listener

    def _spawn(self, target: object, *arguments: object) -> None:
        thread = threading.Thread(target=target, args=arguments, daemon=True)  # type: ignore[arg-type]
        self._threads.append(thread)
        thread.start()

    def _accept(self, listener: socket.socket, serve: object) -> None:
        while self._running:
            try:
                one, _ = listener.accept()
            except OSError:
                return
            one.settimeout(None)  # the SDK sets a default for all sockets of the process
            self._sockets.append(one)
            self._spawn(serve, one)

    def _serve(self, one: socket.socket) -> None:
        self.connections += 1
        content = b""
        with contextlib.suppress(OSError):
            while self._running and (received := one.recv(4096)):
                content += received
                while len(content) >= 6 and len(content) >= (size := 6 + int.from_bytes(content[4:6], "big")):
                    frame, content = content[:size], content[size:]
                    if size > 6:
                        self._hear(one, frame)
        self.connections -= 1

    def _hear(self, one: socket.socket, frame: bytes) -> None:
        register, values = frame[6], frame[7:]
        with self._lock:
            self._pass_time()
            self.commands.append(register)
            answer = self._obey(register, values)
            bits = 0x40 * (self.error != 0) | 0x20 * (self.warning != 0) | 0x10 * (self.state in (STOPPED, RESET))
        if self.mute:
            return
        if self.garbage:
            answer = b"\xff\x7f" * max(1, len(answer) // 2)
        body = bytes([register, bits]) + answer
        one.sendall(frame[:4] + len(body).to_bytes(2, "big") + body)

    def _tell(self, one: socket.socket) -> None:
        """Sends a report every 20 ms (a real one: every 200 ms; the rest of its time is faster, too)."""
        try:
            while self._running:
                with self._lock:
                    self._pass_time()
                    report = self._make_report()
                one.sendall(report)
                time.sleep(0.02)
        except OSError:
            return

    def _make_report(self) -> bytes:
        content = bytes([self.mode << 4 | self.state]) + len(self._waiting()).to_bytes(2, "big")
        content += struct.pack("<7f", *[0.0] * 7) + struct.pack("<6f", *self.pose) + struct.pack("<7f", *[0.0] * 7)
        motors = 0x3F if self.on else 0
        content += bytes([motors, motors, self.error, self.warning]) + struct.pack("<6f", *[0.0] * 6)
        content += struct.pack("<4f", self.load, 0.0, 0.0, 30.0) + bytes([self.sensitivity, 3])
        content += struct.pack("<3f", 0.0, 0.0, -1.0)
        return (len(content) + 4).to_bytes(4, "big") + content

    # Commands.

    def _obey(self, register: int, values: bytes) -> bytes:
        if register == _GET_VERSION:
            return f"6,6,XI130308B22L34,AC130408B22L34,v{self.version}".encode().ljust(60, b"\0")
        if register == _GET_SN:
            return b"XI130308B22L34\0AC130408B22L34\0".ljust(40, b"\0")
        if register == _GET_STATE:
            return bytes([self.state])
        if register == _GET_CMDNUM:
            return len(self._waiting()).to_bytes(2, "big")
        if register == _GET_ERROR:
            return bytes([self.error, self.warning])
        if register == _GET_POSE:
            self._told += 1
            return struct.pack("<6f", *self.pose)
        if register == _IS_TCP_LIMIT:
            return bytes([not self._reaches(np.array(struct.unpack("<6f", values[:24])))])
        if register == _MOTION_EN:
            self.on = bool(values[1]) and self.error == 0
            self._reset()
        elif register == _SET_MODE:
            self._reset()
            self.mode = values[0]
        elif register in (_SET_LOAD, _SET_SENSITIVITY):
            self._reset()
        elif register == _SET_STATE:
            self._set_state(values[0])
        elif register == _CLEAN_WARNING:
            self.warning = 0
        elif register == _CLEAN_ERROR:
            self.clears += 1
            self.error = 0
        elif register == _MOVE_LINE:
            self._queue_line(struct.unpack("<10f", values[:40]))
        return b"\0\0\0"

    def _reset(self) -> None:
        """A change of the configuration: the queue is cleared, mode 0, state 5 (issue 107)."""
        self._forget()
        self.mode, self.state = 0, RESET

    def _set_state(self, state: int) -> None:
        if state == STOPPED:
            self.stops += 1
            self._forget()
            self.state = STOPPED
        elif state == PAUSED:
            self.state = PAUSED
        elif state == 0 and self.error == 0 and self.on:
            self.state = STANDBY if not self._waiting() else MOVING
            self._ready_at = self._t + 0.1

    def _queue_line(self, values: tuple[float, ...]) -> None:
        target, (speed, gain, _, radius) = np.array(values[:6]), values[6:]
        if self.error or self.state in (STOPPED, RESET) or self.mode != 0:
            return
        if self._t < self._ready_at:  # it says OK, and does not move (issue 59)
            self.ignored += 1
            return
        if not self._reaches(target):
            self.warning = NO_SOLUTION
            return
        if len(self._queue) >= self.room:
            self.warning = QUEUE_IS_FULL
            return
        self._queue.append(Line(target, speed, gain, radius))
        if self.state == STANDBY:
            self.state = MOVING

    @staticmethod
    def _reaches(target: np.ndarray) -> bool:
        nearest, farthest = STANDARD_REACH
        return nearest <= float(np.linalg.norm(target[:3] - _SHOULDER)) <= farthest

    def _waiting(self) -> list[Line]:
        return [*([] if self._current is None else [self._current]), *self._queue]

    def _forget(self) -> None:
        self._queue.clear()
        self._current, self._speed = None, 0.0

    def _fail(self, code: int) -> None:
        self._forget()
        self.error, self.state, self.on = code, STOPPED, False

    # Motion.

    def _live(self) -> None:
        while self._running:
            with self._lock:
                self._pass_time()
            time.sleep(0.002)

    def _pass_time(self) -> None:
        real = time.monotonic()
        self._now += (real - self._began) * self.pace
        self._began, now = real, self._now
        if now - self._t > 60 and not self._waiting():  # it stood long
            self._t = now - 1
        while self._t + _TICK <= now:
            self._t += _TICK
            self._step()

    def _step(self) -> None:
        if self.state == PAUSED or self.error:
            self._speed = 0.0
            return
        left = _TICK
        while left > 1e-9:
            if self._current is None and not self._begin():
                return
            line = self._current
            if line is None:
                return
            way = line.target[:3] - self.pose[:3]
            far = float(np.linalg.norm(way))
            wanted = min(line.speed * self.slowed, math.sqrt(2 * line.gain * (far + self._run_out(line))))
            self._speed = min(wanted, self._speed + line.gain * left)
            step = max(self._speed, 1.0) * left
            if step < far:
                self.pose[:3] += way * step / far
                if not np.array_equal(self.pose[3:], line.target[3:]):
                    here, there = (Rotation.from_euler("xyz", each) for each in (self.pose[3:], line.target[3:]))
                    turn = Rotation.from_rotvec((there * here.inv()).as_rotvec() * step / far)
                    self.pose[3:] = (turn * here).as_euler("xyz")
                left = 0.0
            else:
                self.pose = line.target.copy()
                left -= far / max(self._speed, 1.0)
                self._current = None
                if line.radius < 0:
                    self._speed = 0.0
            self.moved.append(self.pose[:3].copy())
            self.turned.append(self.pose[3:].copy())
            self.at.append(time.monotonic())

    def _run_out(self, line: Line) -> float:
        """Millimetres of the lines that follow without a stop."""
        further, last, path = 0.0, line.radius, line.target
        for after in self._queue:
            if last < 0 or further > 50:
                break
            further += float(np.linalg.norm(after.target[:3] - path[:3]))
            last, path = after.radius, after.target
        return further

    def _begin(self) -> bool:
        """Takes the next line out of the queue. Returns False if there is none or an error comes up."""
        if not self._queue:
            self._speed = 0.0
            if self.state == MOVING:
                self.state = STANDBY
            return False
        number, self._begun = self._begun, self._begun + 1
        line = self._queue.popleft()
        event = self.events.get(number)
        if event == "stop":
            self._set_state(STOPPED)
            return False
        if event == "configuration":
            self._reset()
            return False
        if event == "pause":
            self.state = PAUSED
        if event == "speed":
            self.slowed = 0.1
        length = float(np.linalg.norm(line.target[:3] - self.pose[:3]))
        after = self._queue[0].target[:3] - line.target[:3] if self._queue else np.full(3, math.inf)
        if line.radius >= 0 and 2 * line.radius > min(length, float(np.linalg.norm(after))):
            # Issue 79: blending fails with a planning error. UFACTORY does not say when; arcs that overlap cannot be.
            self._fail(PLANNING)
            return False
        if number in self.errors:
            self._fail(self.errors[number])
            return False
        self._current = line
        return True


def _shut(one: socket.socket) -> None:
    with contextlib.suppress(OSError):
        one.shutdown(socket.SHUT_RDWR)
    one.close()


def use_ports(box: XarmBox, monkeypatch: pytest.MonkeyPatch) -> None:
    """Has the SDK of this process connect to the ports of `box`, not to 502 and 30001, which need root."""
    from xarm.core.config.x_config import XCONF
    from xarm.x3 import report

    ports = {"TCP_CONTROL_PORT": box.control, "TCP_REPORT_NORM_PORT": box.report}
    for name, port in ports.items():
        monkeypatch.setattr(XCONF.SocketConf, name, port)
    made = report.ReportDataStructure.create
    create = staticmethod(lambda port, **how: made(30001 if port == box.report else port, **how))
    monkeypatch.setattr(report.ReportDataStructure, "create", create)
