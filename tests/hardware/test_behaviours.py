"""The table of behaviours: every row runs against every simulated controller (tests/machines), as its driver drives it.

The controllers are written from the firmwares' documents. The rows say what a person who stands beside a machine may
expect. Rows that only one firmware has (laser mode, software endstops) are in tests/hardware/drivers.
"""

import math
import re
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from frida_painter.errors import MotionFailed, RobotDisconnected, RobotError, RobotStopped
from frida_painter.hardware.robot import ExaminedRobot, PausableRobot, TimedRobot, Waypoints, ZeroedRobot
from machines import grbl, marlin
from machines.arm_bench import FakeFrankaBench, FrankaBench, FrankaShelf, RosBench, XarmBench, so101_bench
from machines.bench import FOUND, SERVO_GRBL, SERVO_MARLIN, Bench, a_dip, grbl_bench, marlin_bench
from machines.paths import NOT_PATHS, a_stroke
from machines.plotter_bench import plotter_bench
from machines.simulated_time import SimulatedTime

LASER, NO_LASER = {**grbl.QUICK, "32": 1}, {**grbl.QUICK, "32": 0}
COLUMNS: dict[str, Callable[[SimulatedTime], Bench]] = {
    "GRBL as it comes": lambda clock: grbl_bench(clock, grbl.GRBL),
    "GRBL set up": lambda clock: grbl_bench(clock, grbl.GRBL, grbl.QUICK),
    "GRBL in inches": lambda clock: grbl_bench(clock, grbl.GRBL, {**grbl.QUICK, "13": 1, "10": 0}),
    "GRBL, servo, laser mode": lambda clock: grbl_bench(clock, grbl.GRBL, LASER, SERVO_GRBL),
    "GRBL, servo, no laser mode": lambda clock: grbl_bench(clock, grbl.GRBL, NO_LASER, SERVO_GRBL),
    "GRBL clone": lambda clock: grbl_bench(clock, grbl.CLONE, grbl.QUICK),
    "grblHAL": lambda clock: grbl_bench(clock, grbl.GRBLHAL, grbl.QUICK),
    "FluidNC": lambda clock: grbl_bench(clock, grbl.FLUIDNC, grbl.QUICK),
    "FluidNC, two axes, servo": lambda clock: grbl_bench(clock, grbl.FLUIDNC_FLAT, LASER, SERVO_GRBL),
    "Marlin": lambda clock: marlin_bench(clock, marlin.PLAIN),
    "Marlin, advanced ok": lambda clock: marlin_bench(clock, marlin.ADVANCED),
    "Marlin 1.1, no emergency parser": lambda clock: marlin_bench(clock, marlin.OLD),
    "Marlin, no extruders": lambda clock: marlin_bench(clock, marlin.BARE),
    "Marlin, servo": lambda clock: marlin_bench(clock, marlin.SERVO, SERVO_MARLIN),
    "EBB 2.5": lambda clock: plotter_bench(clock, "2.5.3"),
    "EBB 2.8": lambda clock: plotter_bench(clock, "2.8.1"),
    "EBB 3": lambda clock: plotter_bench(clock, "3.0.3"),
    "EBB 3, future syntax, brushless": lambda clock: plotter_bench(clock, "3.0.3", future=True, lift="brushless"),
}


ARMS = {"xArm": "xarm", "ROS": "roslibpy", "SO-101": "scservo_sdk", "Franka": "franky"}
"""Arms, and the package that their drivers need."""
_LOST = "gone|lost|did not answer|has not said|said nothing"  # as soon as a network tells, or after a while


@pytest.fixture(scope="module")
def frankas(tmp_path_factory: pytest.TempPathFactory) -> Iterator[FrankaShelf]:
    shelf = FrankaShelf(tmp_path_factory.mktemp("franka"))
    yield shelf
    shelf.drop()


STAND_IN = "Franka, a stand-in"


@pytest.fixture(params=[*COLUMNS, "xArm", "ROS", "SO-101", STAND_IN, pytest.param("Franka", marks=pytest.mark.slow)])
def bench(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    if request.param in COLUMNS:
        yield COLUMNS[request.param](request.getfixturevalue("simulated_time"))
        return
    if request.param == STAND_IN:
        arm = FakeFrankaBench(monkeypatch)
        yield arm
        arm.end()
        return
    pytest.importorskip(ARMS[request.param], reason=f"the package for the {request.param} is not installed")
    if request.param == "SO-101":
        pytest.importorskip("mink")
        yield so101_bench(request.getfixturevalue("simulated_time"), monkeypatch)
        return
    if request.param == "Franka":
        pytest.importorskip("franky_sim")
        arm = FrankaBench(request.getfixturevalue("frankas"))
    else:
        arm = XarmBench(monkeypatch) if request.param == "xArm" else RosBench()
    yield arm
    arm.end()


def knows_its_zero(bench: Bench, robot: Any) -> bool:
    """True for a machine that always knows where it is."""
    assert isinstance(robot, ZeroedRobot) == ("zero" not in bench.lacks)
    return "zero" in bench.lacks


def sentence_of(error: BaseException) -> str:
    """The message, which is one sentence or a few for a person: no traceback, no class name."""
    text = str(error)
    assert text and "\n" not in text and len(text) < 600 and "Error(" not in text, text
    return text


def stands(bench: Bench) -> bool:
    """True if nothing moves for a while, once a heavy arm has braked."""
    bench.wait(getattr(bench, "braking", 0.0))
    before = len(bench.moved())
    bench.wait(2.0)
    return len(bench.moved()) == before


def missed(bench: Bench, places: np.ndarray) -> float:
    """The farthest that the true way missed one of the places; heights only if the tip itself goes up and down."""
    way = bench.moved()
    axes = slice(0, 2) if getattr(bench, "servo", None) else slice(0, 3)
    return max(float(np.linalg.norm(way[:, axes] - place[axes], axis=1).min()) for place in places)


def is_where_it_says(bench: Bench, robot: Any) -> bool:
    off = np.abs(robot.pose() - bench.tip())
    return bool(off[:2].max() <= bench.exact + 1e-5 and off[2] <= bench.exact_height + 1e-5)


def test_connect_reads_everything_and_moves_nothing(bench: Bench) -> None:
    robot = bench.robot()
    robot.connect()
    assert len(bench.moved()) == 0
    knows_its_zero(bench, robot)
    assert isinstance(robot, TimedRobot) and isinstance(robot, ExaminedRobot)
    limits = robot.timing()
    assert "limits" in bench.lacks if limits is None else 0 < limits.speed[0] <= 1
    robot.close()
    robot.connect()
    robot.close()


def test_doctor_says_in_words_what_the_machine_told_within_ten_seconds(bench: Bench) -> None:
    clock = getattr(bench, "clock", None)
    began = clock.now if clock else 0.0
    found = bench.robot().examine()
    assert len(bench.moved()) == 0
    assert clock is None or clock.now - began < 10
    assert len(found.facts) >= 3 and (found.timing is not None or "limits" in bench.lacks)
    for fact in found.facts:
        assert fact.text.endswith((".", ")")) and fact.weight in ("fact", "warning", "refusal")
    assert not any(fact.weight == "refusal" for fact in found.facts)


def test_a_zero_that_nobody_has_found_is_not_believed(bench: Bench) -> None:
    robot = bench.robot()
    robot.connect()
    if knows_its_zero(bench, robot):
        return
    assert not robot.zero().known and robot.zero().lost
    robot.set_zero(FOUND)
    assert robot.zero().known
    assert np.abs(robot.pose()[:2] - FOUND[:2]).max() < 1e-4
    assert len(bench.moved()) == 0


def test_a_zero_survives_the_end_of_a_program_and_not_a_power_cut(bench: Bench) -> None:
    robot = bench.ready()
    robot.follow(a_stroke())
    robot.close()
    later = bench.robot()
    later.connect()
    assert knows_its_zero(bench, later) or later.zero().known
    assert np.abs(later.pose()[:2] - bench.tip()[:2]).max() <= bench.exact + 1e-5
    later.close()
    bench.fault("power cut")
    bench.wait(5)
    last = bench.robot()
    last.connect()
    if knows_its_zero(bench, last):
        assert is_where_it_says(bench, last)
        return
    assert not last.zero().known
    assert "nobody has told it" in last.zero().lost or "reset" in last.zero().lost
    last.close()


def test_what_is_no_path_is_refused_before_a_line_is_sent(bench: Bench) -> None:
    robot = bench.ready()
    sent = len(bench.commands())
    for position in NOT_PATHS:
        with pytest.raises(MotionFailed, match="did not move"):
            robot.follow(Waypoints("stroke 1", position, 0.1))
    with pytest.raises(MotionFailed, match="speed of nan"):
        robot.follow(Waypoints("stroke 1", np.zeros((1, 3)), math.nan))
    assert len(bench.commands()) == sent and len(bench.moved()) == 0


def test_stroke_dip_and_press_go_where_they_are_sent_in_lines_that_fit_the_buffer(bench: Bench) -> None:
    robot, stroke, dip = bench.ready(), a_stroke(), a_dip()
    report = robot.follow(stroke)
    assert report.label == "stroke 7" and report.started_at <= report.finished_at
    assert np.abs(report.reached - stroke.position[-1]).max() <= bench.exact + 1e-5
    assert missed(bench, stroke.position) <= bench.exact + 1e-6
    assert is_where_it_says(bench, robot) and stands(bench)
    robot.follow(dip)
    assert missed(bench, dip.position) <= bench.exact + 1e-6
    robot.follow(Waypoints("press", np.array([[0.03, 0.03, 0.02], [0.03, 0.03, -0.002]]), 0.02))
    assert abs(bench.tip()[2] + 0.002) <= bench.exact_height + 1e-6
    home = robot.home()
    assert np.abs(home.reached - (0, 0, 0.05)).max() <= bench.exact + 1e-5
    assert is_where_it_says(bench, robot)
    assert max(map(len, bench.commands())) <= 70


def test_jog_moves_by_what_it_was_told_also_if_the_zero_is_lost(bench: Bench) -> None:
    robot = bench.robot()
    robot.connect()
    if knows_its_zero(bench, robot):
        return
    assert not robot.zero().known
    before = bench.tip()
    for step in ((0.01, 0, 0), (0, -0.005, 0)):
        robot.jog(np.array(step))
    moved, servo = bench.tip() - before, getattr(bench, "servo", None)
    assert np.abs(moved - (0.01, -0.005, 0))[: 2 if servo else 3].max() <= 2 * bench.exact
    assert servo is None or abs(bench.tip()[2] - servo.high[0]) <= bench.exact_height, "a brush may stand low: it rises"
    assert stands(bench) and not robot.zero().known


def test_stop_in_motion_stands_at_once_and_stays(bench: Bench) -> None:
    robot = bench.ready()
    stopped: list[tuple[float, np.ndarray]] = []
    clock = getattr(bench, "clock", None)

    def stop() -> None:
        robot.stop()
        robot.stop()
        stopped.append((clock.now if clock else 0.0, bench.tip()))

    bench.when_moved(0.012, stop)
    with pytest.raises(RobotStopped) as told:
        robot.follow(Waypoints("stroke 7", np.array([[0.1, 0.05, 0.012], [0.18, 0.05, 0.012]]), 0.05))
    assert "look at it" in sentence_of(told.value)
    bench.wait(0.5)
    assert stopped
    assert np.linalg.norm((bench.tip() - stopped[0][1])[:2]) < 0.006, "braking at the machine's own acceleration"
    assert stands(bench)
    for act in (robot.home, robot.pose, lambda: robot.follow(a_stroke())):
        with pytest.raises(RobotError, match="look at it"):
            act()
    robot.close()
    assert stands(bench)
    again = bench.robot()
    again.connect()
    assert stands(bench), "what was left is not gone on with"
    assert not isinstance(again, PausableRobot) or again.wants_pause() is False, "the stop was no button"
    if knows_its_zero(bench, again) or again.zero().known:
        assert np.abs(again.pose()[:2] - bench.tip()[:2]).max() <= bench.exact + 1e-5
    again.close()


def test_stop_between_motions_is_kept(bench: Bench) -> None:
    robot = bench.ready()
    robot.stop()
    before = len(bench.moved())
    with pytest.raises(RobotStopped):
        robot.follow(a_stroke())
    bench.wait(1)
    assert len(bench.moved()) == before
    robot.close()
    again = bench.robot()
    again.connect()
    assert len(bench.moved()) == before


def test_an_alarm_is_told_and_never_cleared(bench: Bench) -> None:
    robot = bench.ready()
    bench.when_moved(0.01, lambda: bench.fault("alarm"))
    with pytest.raises(MotionFailed) as told:
        robot.follow(a_stroke())
    assert "ook at it" in sentence_of(told.value)
    bench.wait(1)  # a Marlin that gives up moves on for 0.6 s (minkill in MarlinCore.cpp)
    assert stands(bench)
    with pytest.raises(RobotError, match=r"does not move after its last fault|was stopped"):
        robot.follow(a_stroke())
    if "alarm at rest" in bench.lacks:
        bench.mend()
        return
    with pytest.raises(RobotError) as still:
        robot.connect()
    sentence_of(still.value)
    assert stands(bench)
    assert not any(line.startswith(("$X", "M999")) for line in bench.commands())
    bench.mend()
    robot.connect()
    robot.close()


def test_a_reset_in_motion_is_noticed_and_its_zero_is_not_believed(bench: Bench) -> None:
    robot = bench.ready()
    bench.when_moved(0.01, lambda: bench.fault("reset"))
    with pytest.raises(RobotError) as told:
        robot.follow(a_stroke())
    said = sentence_of(told.value)
    assert re.search("reset|gone|lost", said) or ("reset" in bench.lacks and "did not arrive" in said), (
        "a board that has no serial adapter drops off the bus"
    )
    assert stands(bench)
    robot.close()
    bench.wait(3)
    again = bench.robot()
    again.connect()
    assert knows_its_zero(bench, again) or not again.zero().known
    again.close()


def test_a_slow_machine_is_waited_for_and_its_time_was_foretold(bench: Bench) -> None:
    robot = bench.ready()
    if "time" in bench.lacks:
        assert robot.follow(a_stroke()).reached == pytest.approx(a_stroke().position[-1], abs=bench.exact + 1e-5)
        return
    limits = robot.timing()
    places = np.array([[0.1, 0.05, 0.02], [0.181, 0.05, 0.02], [0.181, 0.01, 0.02], [0.02, 0.03, 0.02]])
    robot.follow(Waypoints("above", places[:1], 0.1))
    path = np.concatenate([robot.pose()[None], places[1:]])
    clock = getattr(bench, "clock", None)
    began = clock.now if clock else 0.0
    report = robot.follow(Waypoints("stroke 7", places[1:], 0.1))
    took = clock.now - began if clock else report.finished_at - report.started_at
    foretold = limits.seconds(path, np.full(len(places) - 1, 0.1)) + limits.between
    assert took == pytest.approx(foretold, rel=0.05, abs=0.12)


def test_a_lost_line_ends_the_motion(bench: Bench) -> None:
    robot = bench.ready()
    if "lose a line" in bench.lacks:
        robot.follow(a_stroke())
        assert is_where_it_says(bench, robot)
        return
    bench.fault("lose a line")
    with pytest.raises(RobotDisconnected) as told:
        robot.follow(a_stroke())
    assert "lost" in sentence_of(told.value)
    assert stands(bench)
    robot.connect()
    robot.close()


def test_lines_that_nobody_asked_for_are_no_acknowledgement(bench: Bench) -> None:
    robot, stroke = bench.ready(), a_stroke()
    bench.fault("chatter")
    robot.follow(stroke)
    assert missed(bench, stroke.position) <= bench.exact + 1e-6
    assert is_where_it_says(bench, robot)


def test_unplugged_and_plugged_again(bench: Bench) -> None:
    robot = bench.ready()
    bench.when_moved(0.01, lambda: bench.fault("unplug"))
    with pytest.raises(RobotDisconnected) as told:
        robot.follow(a_stroke())
    assert re.search(_LOST, sentence_of(told.value))
    robot.close()
    with pytest.raises(RobotDisconnected) as missing:
        robot.connect()
    sentence_of(missing.value)
    bench.mend()
    again = bench.robot()
    again.connect()
    if knows_its_zero(bench, again):
        assert is_where_it_says(bench, again)
        return
    assert not again.zero().known, "it was fed by the cable"
    again.set_zero(FOUND)
    assert again.zero().known
    again.close()


def test_a_machine_that_says_nothing_for_a_minute_and_goes_on_has_done_nothing_more(bench: Bench) -> None:
    robot = bench.ready()
    bench.when_moved(0.01, lambda: bench.fault("silence"))
    with pytest.raises(RobotDisconnected) as told:
        robot.follow(a_stroke())
    assert re.search(_LOST, sentence_of(told.value))
    bench.wait(60)
    before = len(bench.moved())
    bench.mend()
    bench.wait(5)
    assert len(bench.moved()) == before
    robot.connect()
    robot.close()
    assert len(bench.moved()) == before


def test_a_held_machine_is_waited_for_and_the_painting_is_asked_to_pause(bench: Bench) -> None:
    robot, stroke = bench.ready(), a_stroke()
    if "pause button" in bench.lacks:
        assert not isinstance(robot, PausableRobot) or robot.wants_pause() is False
        return
    assert robot.wants_pause() is False
    held: list[int] = []

    def press() -> None:
        bench.fault("press the button")
        clock = bench.clock  # type: ignore[attr-defined]
        clock.after(5, lambda: held.append(len(bench.moved())))
        clock.after(70, lambda: held.append(len(bench.moved())))
        clock.after(70.1, bench.mend)

    bench.when_moved(0.01, press)
    robot.follow(stroke)
    if not held:  # its button holds nothing: the stroke was finished, and the painting pauses after it
        bench.wait(71)
    assert held[0] == held[1], "it stood while it was held"
    assert missed(bench, stroke.position) <= bench.exact + 1e-6
    assert robot.wants_pause() is True
    assert robot.wants_pause() is False


def test_an_hour_of_drying_changes_nothing(bench: Bench) -> None:
    robot = bench.ready()
    before = bench.tip()
    bench.wait(1200)
    assert np.array_equal(bench.tip(), before)
    on = getattr(getattr(bench, "controller", None), "motors_on", True)
    robot.follow(a_stroke())
    assert is_where_it_says(bench, robot)
    robot.close()
    assert on or any("releases its motors" in fact.text for fact in bench.robot().examine().facts)


def test_another_device_that_answers_garbage_is_told_in_one_sentence(bench: Bench) -> None:
    robot, controller = bench.robot(), getattr(bench, "controller", None)
    if controller is None:
        bench.fault("garbage")
    else:
        controller.hear = lambda content: bench.fault("garbage")
        controller.pass_time = lambda seconds: None
        controller.restart = lambda: None
    with pytest.raises(RobotDisconnected if controller else RobotError) as told:
        robot.connect()
    sentence_of(told.value)


def test_two_programs_on_one_machine_are_refused(bench: Bench) -> None:
    robot = bench.ready()
    if "two programs" in bench.lacks:  # what another program changes is told (M15)
        bench.fault("another program")
        with pytest.raises(RobotError, match="as by another program"):
            robot.follow(a_stroke())
        return
    with pytest.raises(RobotDisconnected) as told:
        bench.robot().connect()
    sentence_of(told.value)
    robot.follow(a_stroke())
    assert is_where_it_says(bench, robot)
