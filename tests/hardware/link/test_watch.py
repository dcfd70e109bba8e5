"""The watch: heartbeats, stops on a line of their own, the system's signals, a stop file, and a computer that slept."""

import errno
import math
import os
import signal
import socket
import statistics
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from frida_painter.easel import watchdog
from frida_painter.easel.watchdog import (
    BEAT,
    ENDED,
    LINE,
    MACHINE,
    SIMULATED,
    STOP,
    Patience,
    Pulse,
    StopFile,
    Watch,
)
from frida_painter.hardware import deadline
from frida_painter.hardware.robot import StopLine
from session.easel_errands import until


@dataclass
class Watched:
    """A robot as the watch knows it: what it was stopped for, and when."""

    moving: bool = True
    line: StopLine | None = None
    stopped: object = None
    reasons: list[str] = field(default_factory=list)
    times: list[float] = field(default_factory=list)

    def stop(self, reason: str) -> None:
        self.reasons.append(reason)
        self.times.append(time.monotonic())

    def stop_line(self) -> StopLine | None:
        return self.line

    def wait(self) -> str:
        """The first reason, once there is one."""
        until(lambda: self.reasons, 60.0)
        return self.reasons[0]


def patient(**limits: float) -> Patience:
    """As with a machine, but for these limits; the watch itself may be held up by what else the computer does."""
    return replace(MACHINE, **{"standstill": math.inf, **limits})


@pytest.fixture
def line() -> Iterator[tuple[socket.socket, socket.socket]]:
    ours, its = socket.socketpair()
    yield ours, its
    ours.close()
    its.close()


@pytest.fixture
def keep(line: tuple[socket.socket, socket.socket]) -> Iterator[Callable[..., Watch]]:
    """Watches a robot over the line or another one; starved: seconds for which the painter waited for a processor."""
    with ExitStack() as stack:

        def keep(
            robot: Any, patience: Patience, starved: Callable[[], float] = float, at: Any = None, file: Any = None
        ) -> Watch:
            painter: Any = SimpleNamespace(thinking=lambda: False, starved_seconds=starved)
            watching = Watch(at or line[1], robot, painter, patience, file)
            stack.callback(watching.dismiss)
            return watching

        yield keep


def test_a_stop_is_heeded_within_a_tenth_of_a_second(line, keep) -> None:
    robot = Watched()
    keep(robot, patient())
    waits = []
    for _ in range(9):
        robot.reasons.clear()
        time.sleep(0.03)
        asked = time.monotonic()
        line[0].send(STOP)
        assert "asked for it" in robot.wait()
        waits.append(robot.times[-1] - asked)
    assert statistics.median(waits) < 0.1


def test_heartbeats_keep_it_calm_and_silence_does_not(line, keep) -> None:
    """Fault F12: the painting process is held up (SIGSTOP)."""
    robot = Watched()
    keep(robot, patient(silence=1.0))
    pulse = Pulse(line[0])
    time.sleep(2.0)
    assert robot.reasons == []
    pulse._over.set()  # the thread is held up; the line stays open
    silent = time.monotonic()
    for _ in range(20):
        line[0].send(b"\x1c\x07")  # a window was resized: that is no heartbeat
    assert "fell silent" in robot.wait()
    assert 0.7 < robot.times[0] - silent < MACHINE.absence / 2


def test_the_painter_hears_the_watch_and_misses_it(line, keep) -> None:
    """Fault B11: the easel's process is frozen."""
    watching = keep(Watched(), patient())
    pulse = Pulse(line[0])
    time.sleep(1.0)
    assert pulse.silent < 1.0
    watching.dismiss()
    before = pulse.silent
    until(lambda: pulse.silent > before + 1.0)


@pytest.mark.parametrize(
    ("content", "stopped"),
    [
        (bytes([signal.SIGINT]), False),
        (bytes([signal.SIGINT, signal.SIGINT]), True),
        (BEAT + bytes([signal.SIGINT]) + BEAT + bytes([signal.SIGINT]), True),
        (bytes([signal.SIGTERM]), True),
        (bytes([signal.SIGHUP, signal.SIGCHLD, signal.SIGWINCH]), False),
    ],
)
def test_signals_say_what_they_say_to_the_painter(line, keep, content: bytes, stopped: bool) -> None:
    robot = Watched()
    keep(robot, patient())
    line[0].send(content)
    if stopped:
        robot.wait()
    else:
        time.sleep(0.15)
        assert robot.reasons == []


def test_where_the_painter_has_ended_a_motion_may_end_as_well_but_not_for_long(line, keep) -> None:
    """Fault B12: a very busy machine and a simulated robot, whose painter may be silent but has to exist."""
    still, moving = Watched(moving=False), Watched()
    other, its = socket.socketpair()
    with other, its:
        keep(moving, replace(SIMULATED, orphaned=0.2), at=its)
        time.sleep(0.5)
        assert moving.reasons == []
        keep(still, patient(silence=0.2))
        line[0].close()
        other.close()
        assert "fell silent" in moving.wait()
        time.sleep(0.3)
        assert still.reasons == [], "nothing moves, and nothing needs a person"


@pytest.mark.parametrize("waits", [True, False])
def test_a_painter_that_waits_for_a_processor_is_waited_for_and_one_that_does_not_is_missed(keep, waits: bool) -> None:
    """Fault B12: a very busy machine and a simulated robot."""
    robot, began = Watched(), time.monotonic()
    limits = patient(silence=0.8, starved_moving=math.inf)
    keep(robot, limits, (lambda: time.monotonic() - began) if waits else float)
    if waits:
        time.sleep(1.5)
        assert robot.reasons == []
    else:
        assert "fell silent" in robot.wait()


def test_a_computer_that_slept_stops_a_machine_on_waking_whatever_was_sent_before(
    line, keep, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Fault F31: the clock jumps or the computer sleeps."""
    robot, slept = Watched(moving=False), [0.0]
    monkeypatch.setattr(watchdog, "asleep", lambda: deadline.asleep() + slept[0])
    keep(robot, patient())
    Pulse(line[0])
    for jump in (3600, -3600):  # the clock on the wall does not count
        monkeypatch.setattr(time, "time", lambda jump=jump: jump)
        time.sleep(0.1)
    assert robot.reasons == []
    slept[0] = 600.0
    assert "slept for 600 s" in robot.wait()


def test_the_system_itself_sends_a_signal_on_while_python_is_busy(line, keep) -> None:
    """A painter that computes for seconds on end runs no handler of Python's; the line hears of it all the same."""
    robot = Watched()
    keep(robot, patient())
    before = signal.signal(signal.SIGTERM, lambda number, frame: None)
    Pulse(line[0])
    wakeup = signal.set_wakeup_fd(line[0].fileno(), warn_on_full_buffer=False)
    try:
        os.kill(os.getpid(), signal.SIGTERM)
        assert "SIGTERM" in robot.wait()
    finally:
        signal.set_wakeup_fd(wakeup)
        signal.signal(signal.SIGTERM, before)


def test_the_stop_file_stops_at_once_and_is_taken_away(tmp_path: Path) -> None:
    waits = []
    for number in range(3):
        robot, file = Watched(), tmp_path / f"not there yet {number}" / "stop"
        watching = StopFile(file, robot.stop)
        time.sleep(0.05)
        file.parent.mkdir()
        asked = time.monotonic()
        file.touch()
        assert "stop file" in robot.wait()
        waits.append(robot.times[0] - asked)
        until(lambda file=file: not file.exists())
        watching.dismiss()
    assert min(waits) < 0.5, "a busy computer holds one of them up"


@pytest.mark.parametrize("number", [errno.EACCES, errno.ESTALE])
def test_a_look_for_the_stop_file_that_fails_is_told_once_and_tried_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    """A network folder is away for a moment."""
    robot, told, away = Watched(), list[str](), threading.Event()
    look = Path.exists

    def exists(path: Path) -> bool:
        if away.is_set():
            raise OSError(number, os.strerror(number))
        return look(path)

    monkeypatch.setattr(Path, "exists", exists)
    away.set()
    watching = StopFile(tmp_path / "stop", robot.stop, told.append)
    until(lambda: told)
    time.sleep(5 * watchdog.LOOK_EVERY)
    assert len(told) == 1 and watching.looks == 0
    away.clear()
    until(lambda: watching.looks)
    (tmp_path / "stop").touch()
    assert "stop file" in robot.wait()


def test_a_robot_that_moves_while_nobody_can_look_for_the_stop_file_is_stopped(keep) -> None:
    """Looks fail, or one of them hangs."""
    robot, file = Watched(), SimpleNamespace(looks=0)
    keep(robot, replace(SIMULATED, blind=0.3), file=file)
    for _ in range(50):
        file.looks += 1
        time.sleep(0.01)
    assert robot.reasons == []
    assert "stop file" in robot.wait()


def test_a_watch_that_fails_stops_the_robot_and_goes_on(line, keep) -> None:
    class Failing(Watched):
        def stop_line(self) -> StopLine | None:
            if not self.reasons:
                raise MemoryError
            return None

    robot = Failing()
    keep(robot, patient())
    assert "MemoryError" in robot.wait()
    line[0].send(STOP)
    until(lambda: any("asked for it" in reason for reason in robot.reasons))


def test_a_line_is_lent_taken_back_and_used_once_the_other_process_is_gone(line, keep) -> None:
    """The bytes that stop a machine are longer than one, and come between heartbeats."""
    machine, driver = socket.socketpair()
    robot = Watched(moving=False, line=StopLine(driver.fileno(), b"\nM410\nG92 E0\n"))
    vanished: list[bool] = []
    watching = keep(robot, patient())
    pulse = Pulse(line[0], vanished.append)
    until(lambda: pulse._lent)
    robot.line = None
    until(lambda: pulse._lent is None)
    robot.line = StopLine(driver.fileno(), b"!")
    until(lambda: pulse._lent)
    driver.close()
    watching.dismiss()
    assert not pulse.stopped and not vanished
    line[1].close()
    until(lambda: pulse.gone.is_set())
    assert vanished == [True] and pulse.stopped and machine.recv(10) == b"!"
    pulse.end()
    assert machine.recv(10) == b"", "the second descriptor is closed"
    machine.close()


@pytest.mark.parametrize("last", [ENDED, STOP + ENDED])
def test_a_process_that_has_closed_everything_has_not_vanished(line, last: bytes) -> None:
    told: list[bool] = []
    pulse = Pulse(line[0], told.append)
    line[1].send(BEAT + last)
    line[1].close()
    until(lambda: pulse.gone.is_set())
    assert told == [] and pulse.ended and pulse.stopped == (STOP in last)
    pulse.end()


def test_a_line_of_a_machine_that_is_gone_too_was_not_told(line) -> None:
    machine, driver = socket.socketpair()
    told: list[bool] = []
    pulse = Pulse(line[0], told.append)
    socket.send_fds(line[1], [LINE + b"\x01!"], [driver.fileno()])
    until(lambda: pulse._lent)
    for each in (machine, driver, line[1]):
        each.close()
    until(lambda: pulse.gone.is_set())
    assert told == [False]
    pulse.end()


def test_the_painting_process_is_told_that_the_robot_was_stopped(line, keep) -> None:
    robot, pulse = Watched(moving=False), Pulse(line[0])
    watching = keep(robot, patient())
    time.sleep(3 * watchdog.BEAT_EVERY)
    assert not pulse.stopped
    robot.stopped = "the stop file appeared"
    until(lambda: pulse.stopped)
    assert pulse.silent == 0, "what tells it is a heartbeat as well"
    watching.dismiss()
    pulse.end()


def test_a_pulse_whose_line_is_full_or_gone_troubles_nobody(line) -> None:
    pulse = Pulse(line[0])
    for _ in range(100_000):
        pulse._send(BEAT)
    line[1].close()
    pulse.stop()
    pulse.end()
