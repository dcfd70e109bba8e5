"""Rows of the fault matrix that speak of processes and of time: real processes and signals, a robot at its own pace.

The robot is a virtual one that is taken for a machine, so that nothing here is spared to it.
"""

import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO

import numpy as np
import pytest

from frida_painter.easel.kinds import STOP_FILE
from frida_painter.easel.order import EaselOrder
from frida_painter.easel.parent import EaselProcess
from frida_painter.errors import MotionFailed, PoseMismatch, RobotDisconnected, RobotStopped
from frida_painter.hardware.faults import FailedMotion, Faults
from frida_painter.hardware.latch import Latch, latch_path
from frida_painter.hardware.robot import Waypoints
from killing import ForkedProcess
from session import easel_errands
from session.easel_errands import MACHINE, PAINTS, dip, easel_of, install_machine, moves, paint, stroke, until

STUDIO = "virtual studio 3"


@pytest.fixture(autouse=True)
def machine(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    install_machine(tmp_path_factory.mktemp("installed"), monkeypatch)


def order_in(folder: Path, **settings: object) -> EaselOrder:
    return easel_errands.order_in(folder, **{"robot": MACHINE, **settings})


def latch(folder: Path) -> Latch:
    return Latch(latch_path(folder.parent / "state", STUDIO), STUDIO)


def gone(entry: dict) -> float:
    """Metres gone in a motion."""
    return float(np.linalg.norm(np.diff(np.array(entry["path"]), axis=0), axis=1).sum())


def paint_six(folder: Path, speed: float, robot: str) -> None:
    """Paints one stroke after another, at so many m/s, and says so, with the number of the easel's process."""
    with easel_of(order_in(folder, pace=1.0, robot=robot)) as (easel, process):
        easel.operator.fill_wells(PAINTS)
        easel.robot.follow(dip(easel, 0))
        for number in range(6):
            print(number, process._process.pid, flush=True)
            easel.robot.follow(replace(stroke(easel, number), speed=speed))


@dataclass(frozen=True)
class Painter:
    """A painting process. said: what it has painted; complaint: what it says where something goes wrong"""

    process: ForkedProcess
    said: IO[str]
    complaint: Path

    def end(self, timeout: float) -> str:
        self.process.wait(timeout)
        return self.complaint.read_text()


@contextmanager
def painter(folder: Path, speed: float = 0.06, robot: str = MACHINE) -> Iterator[Painter]:
    """The painting process; whatever becomes of the test, it is gone afterwards, even where it was held up."""
    reading, writing = os.pipe()
    complaint = folder.parent / "complaint"
    with os.fdopen(reading) as said, os.fdopen(writing, "w") as telling, complaint.open("w") as complaining:
        process = ForkedProcess(lambda: paint_six(folder, speed, robot), stdout=telling, stderr=complaining)
        telling.close()
        try:
            yield Painter(process, said, complaint)
        finally:
            process.kill()
            process.wait()


@pytest.mark.parametrize("way", ["line", "file"])
def test_stop_within_a_stroke_acts_at_once_and_holds_until_a_person_re_arms(tmp_path: Path, way: str) -> None:
    """Faults F8: a stop is pressed; F9: somebody tries to go on after a stop."""
    folder = tmp_path / "painting"
    order = order_in(folder, pace=1.0)
    asked = []
    with easel_of(order) as (easel, _):
        path = stroke(easel, 0)
        easel.robot.follow(Waypoints("there", path.position[:1], 0.5))
        quiet = len(moves(folder))

        def stop() -> None:
            asked.append(time.time())
            easel.robot.stop() if way == "line" else (folder / STOP_FILE).touch()

        timer = threading.Timer(0.6, stop)
        began = time.time()
        timer.start()
        with pytest.raises(RobotStopped):
            easel.robot.follow(path)
        heard = time.time() - asked[0]
        stopped = until(lambda: latch(folder).read())
        for action in (easel.robot.home, lambda: easel.robot.follow(path), easel.robot.connect):
            with pytest.raises(RobotStopped, match="frida-painter arm"):
                action()
        easel.robot.stop()  # as often as one likes
    # The robot says so itself: it went for as long as nobody asked, hardly longer, and never again. How long a stop
    # takes is measured where a thousand of them are (test_guard.py); here the computer may be busy with other tests.
    assert len(moves(folder)) == quiet + 1
    cut = moves(folder)[-1]
    assert cut["now"] - moves(folder)[-2]["now"] <= asked[0] - began + 0.5 < path.length / path.speed
    assert heard < 3.0 and stopped.at - asked[0] < 3.0
    assert not (folder / STOP_FILE).exists()

    with EaselProcess() as restarted, pytest.raises(RobotStopped, match=f"{STUDIO} was stopped on .*frida-painter arm"):
        restarted.open(order)
    with EaselProcess() as new_job, pytest.raises(RobotStopped, match="frida-painter arm"):
        new_job.open(order_in(tmp_path / "another painting"))
    if way == "file":
        return
    latch(folder).release()
    with easel_of(order_in(folder)) as (easel, _):
        easel.robot.home()
    lifted, home = moves(folder)[quiet + 1 :]
    assert np.allclose(lifted["path"][0][:2], lifted["path"][-1][:2]), "a brush that stands on the canvas: straight up"
    assert lifted["path"][0] == cut["path"][-1] and home["path"][0] == lifted["path"][-1]


def test_a_painting_process_that_is_held_up_has_its_robot_stopped_within_three_seconds(tmp_path: Path) -> None:
    """Fault F12: the painting process is held up (SIGSTOP)."""
    folder = tmp_path / "painting"
    with painter(folder, speed=0.005) as painting:
        assert painting.said.readline().startswith("0"), painting.complaint.read_text()
        time.sleep(1.0)  # within a stroke of more than ten seconds
        painting.process.send_signal(signal.SIGSTOP)
        held = time.time()
        stopped = until(lambda: latch(folder).read(), 10)
        assert "fell silent" in stopped.reason and stopped.at - held < 3.3
        told = len(moves(folder))
        painting.process.send_signal(signal.SIGCONT)
        assert "RobotStopped" in painting.end(timeout=60) and len(moves(folder)) <= told + 1


def test_a_painting_process_killed_within_a_stroke_leaves_it_done_and_nothing_moves_on(tmp_path: Path) -> None:
    """Fault F2: the painting process is killed within a stroke."""
    folder = tmp_path / "painting"
    with painter(folder) as painting:
        while not (line := painting.said.readline()).startswith("2"):  # by then all that computes has been loaded
            assert line
        host = int(line.split()[1])
        time.sleep(0.8)
        before = len(moves(folder))
        painting.process.kill()
    until(lambda: not Path(f"/proc/{host}/stat").exists() or Path(f"/proc/{host}/stat").read_text().split()[2] == "Z")
    assert len(moves(folder)) == before + 1
    assert latch(folder).read() is None, "it ended well within the three seconds, and nobody has anything to free"
    with easel_of(order_in(folder)) as (easel, _):
        assert np.allclose(easel.robot.pose(), moves(folder)[-1]["path"][-1])
        paint(easel, range(1, 2))


def test_a_robot_that_lies_and_then_fails_is_told_of_as_it_is(tmp_path: Path) -> None:
    """Faults F15: the robot returns an error; F17: the robot reports success from a wrong position."""
    folder = tmp_path / "painting"
    faults = Faults(lying_motions=frozenset({1}), failed_motions=(FailedMotion(2, 3, 31),))
    with easel_of(order_in(folder, faults=faults)) as (easel, _):
        easel.operator.fill_wells(PAINTS)
        easel.robot.home()
        with pytest.raises(PoseMismatch, match="repeat the robot calibration"):
            easel.robot.follow(stroke(easel, 0))
        with pytest.raises(MotionFailed, match="error 31 at waypoint 3") as fault:
            easel.robot.follow(stroke(easel, 1))
        assert (fault.value.code, fault.value.waypoint) == (31, 3)
        with pytest.raises(RobotStopped, match="error 31"):
            easel.robot.home()
    held = latch(folder).read()
    assert held is not None and "error 31" in held.reason, "never cleared by the program"
    assert len(moves(folder)) == 3


def test_a_robot_that_meets_with_resistance_and_one_that_is_gone(tmp_path: Path) -> None:
    """Faults F14: the connection to the robot breaks; F18: the robot meets resistance (protective stop)."""
    for name, faults, kind in (
        ("resisted", Faults(protective_stops=frozenset({0})), RobotStopped),
        ("gone", Faults(dead_from_motion=0), RobotDisconnected),
    ):
        folder = tmp_path / name / "painting"
        folder.parent.mkdir()
        with easel_of(order_in(folder, faults=faults)) as (easel, _):
            with pytest.raises(kind):
                easel.robot.follow(stroke(easel, 0))
            with pytest.raises(RobotStopped, match="frida-painter arm"):
                easel.robot.home()
        assert latch(folder).read() is not None


def test_a_robot_whose_call_never_returns_is_given_up(tmp_path: Path) -> None:
    """Fault F16: a call to the robot never returns."""
    folder = tmp_path / "painting"
    with easel_of(order_in(folder, faults=Faults(hanging_motions=frozenset({1})))) as (easel, _):
        easel.robot.home()
        here = easel.robot.pose()
        began = time.monotonic()
        with pytest.raises(RobotDisconnected, match="did not come back within 5"):
            easel.robot.follow(Waypoints("stroke 4", np.stack([here, here - np.array([0, 0, 0.001])]), 0.1))
        assert 5 <= time.monotonic() - began < 10
        with pytest.raises(RobotStopped):
            easel.robot.home()
    assert latch(folder).read() is not None and len(moves(folder)) == 1


def test_an_easels_process_that_is_told_to_end_stops_its_robot_and_loses_nothing(tmp_path: Path) -> None:
    folder = tmp_path / "painting"
    with pytest.raises(RobotDisconnected), easel_of(order_in(folder, pace=1.0)) as (easel, process):
        timer = threading.Timer(0.5, process._process.terminate)
        timer.start()
        easel.robot.follow(stroke(easel, 0))
    held = latch(folder).read()
    assert held is not None and "SIGTERM" in held.reason
    assert len(moves(folder)) == 1 and gone(moves(folder)[0]) > 0


def test_an_easels_process_that_was_frozen_within_a_stroke_does_not_go_on_by_itself(tmp_path: Path) -> None:
    """Fault B11: the easel's process is frozen."""
    folder = tmp_path / "painting"
    with easel_of(order_in(folder, pace=1.0)) as (easel, process):
        easel.robot.home()
        path = replace(stroke(easel, 0), speed=0.005)
        for seconds, number in ((0.5, signal.SIGSTOP), (5.5, signal.SIGCONT)):
            threading.Timer(seconds, process._process.send_signal, (number,)).start()
        with pytest.raises(RobotStopped, match="held up for"):
            easel.robot.follow(path)
        with pytest.raises(RobotStopped, match="frida-painter arm"):
            easel.robot.home()
    held = latch(folder).read()
    assert held is not None and "in the middle of a motion" in held.reason


def test_a_painting_process_says_so_when_it_hears_nothing_from_the_easels(tmp_path: Path) -> None:
    """Fault B11: the easel's process is frozen."""
    folder = tmp_path / "painting"
    with easel_of(order_in(folder, pace=1.0)) as (easel, process):
        easel.robot.home()
        process._link.most_silence = 2.0
        path = replace(stroke(easel, 0), speed=0.005)
        threading.Timer(0.5, process._process.send_signal, (signal.SIGSTOP,)).start()
        began = time.monotonic()
        with pytest.raises(RobotDisconnected, match="Nothing has been heard from it for"):
            easel.robot.follow(path)
        assert time.monotonic() - began < 8 < path.length / path.speed
        time.sleep(max(0.0, began + 5.0 - time.monotonic()))
        process._process.send_signal(signal.SIGCONT)
        assert "Nothing has been heard" not in until(lambda: latch(folder).read()).reason
        with pytest.raises(RobotDisconnected):
            easel.robot.home()


def test_a_simulated_robot_that_was_stopped_stands_still_but_is_neither_latched_nor_armed(tmp_path: Path) -> None:
    """Fault B12: a very busy machine and a simulated robot."""
    folder = tmp_path / "painting"
    order = order_in(folder, pace=1.0, robot="virtual")
    latch(folder).engage("an earlier version latched simulated robots as well")
    before = latch(folder).path.read_bytes()
    for way in ("line", "file"):
        with easel_of(order) as (easel, _):
            path = replace(stroke(easel, 0), speed=0.005)
            stop = easel.robot.stop if way == "line" else (folder / STOP_FILE).touch
            threading.Timer(0.4, stop).start()
            began = time.monotonic()
            with pytest.raises(RobotStopped, match="resume the painting"):
                easel.robot.follow(path)
            assert time.monotonic() - began < 8 < path.length / path.speed, "at once"
            count = len(moves(folder))
            with pytest.raises(RobotStopped, match="resume the painting"):
                easel.robot.home()
            assert len(moves(folder)) == count
    with easel_of(order_in(folder, robot="virtual")) as (easel, _):
        easel.operator.fill_wells(PAINTS)
        paint(easel, range(1))
    assert latch(folder).path.read_bytes() == before, "neither read nor written"


def test_a_painting_process_that_is_held_up_has_its_simulated_robot_wait_for_it(tmp_path: Path) -> None:
    """Fault B12: a very busy machine and a simulated robot."""
    folder = tmp_path / "painting"
    with painter(folder, robot="virtual") as painting:
        assert painting.said.readline().startswith("0"), painting.complaint.read_text()
        painting.process.send_signal(signal.SIGSTOP)
        time.sleep(5.0)
        painting.process.send_signal(signal.SIGCONT)
        complaint = painting.end(timeout=120)
        assert painting.process.returncode == 0, complaint
    assert len(moves(folder)) == 7, "a dip and six strokes"
    assert not (tmp_path / "state" / "stopped").exists()


def test_a_simulated_robots_process_that_was_frozen_goes_on(tmp_path: Path) -> None:
    """Fault B11: the easel's process is frozen."""
    folder = tmp_path / "painting"
    with easel_of(order_in(folder, pace=1.0, robot="virtual")) as (easel, process):
        for seconds, number in ((0.5, signal.SIGSTOP), (5.5, signal.SIGCONT)):
            threading.Timer(seconds, process._process.send_signal, (number,)).start()
        easel.robot.follow(stroke(easel, 0))
        easel.robot.home()
