"""The watch: heartbeats, stops on a line of their own, the system's signals, a stop file, and a computer that slept."""

import errno
import itertools
import math
import os
import signal
import socket
import statistics
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

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
class Stops:
    """What the watch stopped the robot for, and when."""

    reasons: list[str] = field(default_factory=list)
    times: list[float] = field(default_factory=list)

    def __call__(self, reason: str) -> None:
        self.reasons.append(reason)
        self.times.append(time.monotonic())

    def wait(self, seconds: float = 60.0) -> str:
        """The first reason, once there is one."""
        deadline = time.monotonic() + seconds
        while not self.reasons:
            assert time.monotonic() < deadline, "nothing was stopped"
            time.sleep(0.002)
        return self.reasons[0]


@dataclass(frozen=True)
class Painter:
    """A painting process as it is seen from outside."""

    busy: bool = False
    counted: Callable[[], float] = float

    def thinking(self) -> bool:
        return self.busy

    def starved_seconds(self) -> float:
        return self.counted()


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
def keeping(line: tuple[socket.socket, socket.socket]) -> Iterator[Callable[..., Watch]]:
    watches: list[Watch] = []

    def keep(stop: Stops, moving: bool = True, thinking: bool = False, **limits: float) -> Watch:
        watches.append(Watch(line[1], stop, lambda: moving, Painter(thinking), patient(**limits)))
        return watches[-1]

    yield keep
    for each in watches:
        each.dismiss()


def test_a_stop_is_heeded_within_a_tenth_of_a_second(line, keeping) -> None:
    stops = Stops()
    keeping(stops)
    waits = []
    for _ in range(9):
        stops.reasons.clear()
        time.sleep(0.03)
        asked = time.monotonic()
        line[0].send(STOP)
        assert "asked for it" in stops.wait()
        waits.append(stops.times[-1] - asked)
    assert statistics.median(waits) < 0.1


def test_heartbeats_keep_it_calm_and_silence_does_not(line, keeping) -> None:
    stops = Stops()
    keeping(stops, silence=1.5)
    pulse = Pulse(line[0])
    time.sleep(3.0)
    assert stops.reasons == []
    pulse._over.set()  # the thread is held up; the line stays open
    silent = time.monotonic()
    assert "fell silent" in stops.wait()
    assert 1.0 < stops.times[0] - silent < MACHINE.absence / 2


def test_the_painter_hears_the_watch_and_misses_it(line, keeping) -> None:
    """Fault B11: the easel's process is frozen."""
    watching = keeping(Stops())
    pulse = Pulse(line[0])
    time.sleep(1.0)
    assert pulse.silent < 1.0
    watching.dismiss()
    before = pulse.silent
    deadline = time.monotonic() + 30
    while pulse.silent < before + 1.0:
        assert time.monotonic() < deadline
        time.sleep(0.05)


def test_while_nothing_moves_a_painter_may_compute_but_not_forever(line, keeping) -> None:
    stops = Stops()
    keeping(stops, moving=False, thinking=True, silence=0.1, absence=2.0)
    time.sleep(0.6)
    assert stops.reasons == []
    assert "fell silent" in stops.wait()


def test_while_nothing_moves_a_painter_that_stands_still_is_missed_as_soon_as_while_it_moves(line, keeping) -> None:
    """Fault F12: the painting process is held up (SIGSTOP)."""
    stops = Stops()
    keeping(stops, moving=False, silence=0.2)
    began = time.monotonic()
    assert "fell silent" in stops.wait()
    assert stops.times[0] - began < MACHINE.absence / 2


def test_a_motion_that_was_asked_for_after_a_long_thought_is_not_stopped_for_it(line) -> None:
    stops, moving = Stops(), threading.Event()
    watching = Watch(line[1], stops, moving.is_set, Painter(busy=True), patient(silence=1.5))
    time.sleep(2.0)
    moving.set()
    time.sleep(0.2)
    assert stops.reasons == []
    assert "fell silent" in stops.wait()
    watching.dismiss()


def test_what_is_no_heartbeat_does_not_count_as_one(line, keeping) -> None:
    stops = Stops()
    keeping(stops, silence=0.3)
    deadline = time.monotonic() + 60
    while not stops.reasons and time.monotonic() < deadline:
        line[0].send(b"\x1c\x07")  # a window was resized
        time.sleep(0.01)
    assert "fell silent" in stops.reasons[0]


@pytest.mark.parametrize(
    ("content", "stopped"),
    [
        (bytes([signal.SIGINT]), False),
        (bytes([signal.SIGINT, signal.SIGINT]), True),
        (BEAT + bytes([signal.SIGINT]) + BEAT + bytes([signal.SIGINT]), True),
        (bytes([signal.SIGTERM]), True),
        (bytes([signal.SIGHUP]), False),
        (bytes([signal.SIGCHLD, signal.SIGWINCH]), False),
    ],
)
def test_signals_say_what_they_say_to_the_painter(line, keeping, content: bytes, stopped: bool) -> None:
    stops = Stops()
    keeping(stops)
    line[0].send(content)
    if stopped:
        stops.wait()
    else:
        time.sleep(0.15)
        assert stops.reasons == []


def test_where_the_painter_has_ended_a_motion_may_end_as_well_but_not_for_long(line, keeping) -> None:
    still, moving = Stops(), Stops()
    keeping(still, moving=False, silence=0.2)
    other, its = socket.socketpair()
    second = Watch(its, moving, lambda: True, Painter(), patient(orphaned=0.2))
    line[0].close()
    other.close()
    assert "fell silent" in moving.wait()
    second.dismiss()
    its.close()
    time.sleep(0.3)
    assert still.reasons == [], "nothing moves, and nothing needs a person"


def test_a_painter_that_waits_for_a_processor_is_waited_for_and_one_that_does_not_is_missed(line, keeping) -> None:
    """Fault B12: a very busy machine and a simulated robot."""
    began = time.monotonic()
    starved, dead = Stops(), Stops()
    limits = patient(silence=0.8, starved_moving=math.inf)
    watching = Watch(line[1], starved, lambda: True, Painter(counted=lambda: time.monotonic() - began), limits)
    ours, its = socket.socketpair()
    second = Watch(its, dead, lambda: True, Painter(), limits)
    assert "fell silent" in dead.wait()
    time.sleep(0.5)
    assert starved.reasons == []
    for each in (watching, second):
        each.dismiss()
    ours.close()
    its.close()


def test_who_commands_a_simulated_robot_may_be_silent_but_has_to_exist(line) -> None:
    """Fault B12: a very busy machine and a simulated robot."""
    stops = Stops()
    watching = Watch(line[1], stops, lambda: True, Painter(), replace(SIMULATED, orphaned=0.2))
    time.sleep(MACHINE.silence + 1.0)
    assert stops.reasons == []
    line[0].send(STOP)
    assert "asked for it" in stops.wait()
    stops.reasons.clear()
    line[0].close()
    assert "fell silent" in stops.wait()
    watching.dismiss()


def test_a_computer_that_slept_stops_the_robot_on_waking_whatever_was_sent_before(
    line, keeping, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Fault F31: the clock jumps or the computer sleeps."""
    stops = Stops()
    slept = [0.0]
    monkeypatch.setattr(watchdog, "asleep", lambda: deadline.asleep() + slept[0])
    keeping(stops, moving=False)
    Pulse(line[0])
    time.sleep(0.1)
    assert stops.reasons == []
    slept[0] = 600.0
    assert "slept" in stops.wait() and "600 s" in stops.reasons[0]


def test_a_simulated_robot_goes_on_when_the_computer_wakes(line, monkeypatch: pytest.MonkeyPatch) -> None:
    """Fault F31: the clock jumps or the computer sleeps."""
    stops = Stops()
    slept = [0.0]
    monkeypatch.setattr(watchdog, "asleep", lambda: deadline.asleep() + slept[0])
    watching = Watch(line[1], stops, lambda: True, Painter(), SIMULATED)
    slept[0] = 600.0
    time.sleep(0.3)
    assert stops.reasons == []
    watching.dismiss()


def test_the_clock_on_the_wall_may_jump(line, keeping, monkeypatch: pytest.MonkeyPatch) -> None:
    """Fault F31: the clock jumps or the computer sleeps."""
    stops = Stops()
    keeping(stops)
    Pulse(line[0])
    for jump in (3600, -3600):
        monkeypatch.setattr(time, "time", lambda jump=jump: jump)
        time.sleep(0.3)
    assert stops.reasons == []


def test_the_system_itself_sends_a_signal_on_while_python_is_busy(line, keeping) -> None:
    """A painter that computes for seconds on end runs no handler of Python's; the line hears of it all the same."""
    stops = Stops()
    keeping(stops)
    heard: list[int] = []
    before = signal.signal(signal.SIGTERM, lambda number, frame: heard.append(number))
    pulse = Pulse(line[0])
    wakeup = signal.set_wakeup_fd(pulse.file, warn_on_full_buffer=False)
    try:
        os.kill(os.getpid(), signal.SIGTERM)
        assert "SIGTERM" in stops.wait()
    finally:
        signal.set_wakeup_fd(wakeup)
        signal.signal(signal.SIGTERM, before)


def test_the_stop_file_stops_at_once_and_is_taken_away(tmp_path: Path) -> None:
    waits = []
    for number in range(3):
        stops, file = Stops(), tmp_path / f"not there yet {number}" / "stop"
        watching = StopFile(file, stops)
        time.sleep(0.05)
        file.parent.mkdir()
        asked = time.monotonic()
        file.touch()
        assert "stop file" in stops.wait()
        waits.append(stops.times[0] - asked)
        deadline = time.monotonic() + 60
        while file.exists():
            assert time.monotonic() < deadline
        watching.dismiss()
    assert min(waits) < 0.5, "a busy computer holds one of them up"


@pytest.mark.parametrize("number", [errno.EACCES, errno.EIO, errno.ESTALE])
def test_a_look_for_the_stop_file_that_fails_is_told_once_and_tried_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    """A network folder is away for a moment."""
    stops, told, away = Stops(), list[str](), threading.Event()
    look = Path.exists

    def exists(path: Path) -> bool:
        if away.is_set():
            raise OSError(number, os.strerror(number))
        return look(path)

    monkeypatch.setattr(Path, "exists", exists)
    away.set()
    watching = StopFile(tmp_path / "stop", stops, told.append)
    until(lambda: told)
    time.sleep(5 * watchdog.LOOK_EVERY)
    assert len(told) == 1 and watching.looks == 0
    away.clear()
    until(lambda: watching.looks)
    (tmp_path / "stop").touch()
    assert "stop file" in stops.wait()


@pytest.mark.parametrize(
    ("looks", "moving", "patience", "stopped"),
    [
        (lambda: 3, True, MACHINE, True),  # they fail, or one of them hangs
        (itertools.count().__next__, True, MACHINE, False),
        (lambda: 3, False, MACHINE, False),
        (lambda: 3, True, SIMULATED, False),
    ],
    ids=["blind", "sees", "stands still", "simulated"],
)
def test_a_robot_that_moves_while_nobody_can_look_for_the_stop_file_is_stopped(
    line, looks: Callable[[], int], moving: bool, patience: Patience, stopped: bool
) -> None:
    stops = Stops()
    quick = replace(patience, silence=math.inf, absence=math.inf, starved_moving=math.inf, standstill=math.inf)
    quick = replace(quick, blind=min(quick.blind, 0.2) if math.isfinite(quick.blind) else quick.blind)
    watching = Watch(line[1], stops, lambda: moving, Painter(), quick, looked=looks)
    if stopped:
        assert "stop file" in stops.wait()
    else:
        time.sleep(0.6)
        assert stops.reasons == []
    watching.dismiss()
    assert MACHINE.blind <= 2.0


def test_a_watch_that_fails_stops_the_robot_and_goes_on(line) -> None:
    stops = Stops()
    fails = [True]

    def moving() -> bool:
        if fails:
            raise MemoryError
        return True

    watching = Watch(line[1], stops, moving, Painter(), patient())
    assert "MemoryError" in stops.wait()
    fails.clear()
    time.sleep(0.1)
    stops.reasons.clear()
    line[0].send(STOP)
    assert "asked for it" in stops.wait()
    watching.dismiss()


def test_a_line_is_lent_taken_back_and_used_once_the_other_process_is_gone(line) -> None:
    """The bytes that stop a machine are longer than one, and come between heartbeats."""
    machine, driver = socket.socketpair()
    lent: list[StopLine | None] = [StopLine(driver.fileno(), b"\nM410\nG92 E0\n")]
    vanished: list[bool] = []
    watching = Watch(line[1], Stops(), lambda: False, Painter(), patient(), stop_line=lambda: lent[-1])
    pulse = Pulse(line[0], vanished.append)
    until(lambda: pulse._lent)
    lent.append(None)
    until(lambda: pulse._lent is None)
    lent.append(StopLine(driver.fileno(), b"!"))
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


@pytest.mark.parametrize("last", [b"", STOP])
def test_a_process_that_has_closed_everything_has_not_vanished(line, last: bytes) -> None:
    vanished: list[bool] = []
    pulse = Pulse(line[0], vanished.append)
    line[1].send(BEAT + last + ENDED)
    line[1].close()
    until(lambda: pulse.gone.is_set())
    assert vanished == [] and pulse.ended and pulse.stopped == bool(last)
    pulse.end()


def test_a_line_of_a_machine_that_is_gone_too_was_not_told(line) -> None:
    machine, driver = socket.socketpair()
    vanished: list[bool] = []
    pulse = Pulse(line[0], vanished.append)
    socket.send_fds(line[1], [LINE + b"\x01!"], [driver.fileno()])
    until(lambda: pulse._lent)
    machine.close()
    driver.close()
    line[1].close()
    until(lambda: pulse.gone.is_set())
    assert vanished == [False]
    pulse.end()


def test_the_painting_process_is_told_that_the_robot_was_stopped(line) -> None:
    stops = Stops()
    pulse = Pulse(line[0])
    watching = Watch(line[1], stops, lambda: False, Painter(), patient(), stopped=lambda: bool(stops.reasons))
    time.sleep(3 * watchdog.BEAT_EVERY)
    assert not pulse.stopped
    stops("the stop file appeared")
    deadline = time.monotonic() + 30
    while not pulse.stopped:
        assert time.monotonic() < deadline
        time.sleep(0.01)
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
