"""The driver of plotters with an EBB, against a board that is simulated from the maker's documents."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from frida_painter.errors import (
    ConfigError,
    MotionFailed,
    RobotDisconnected,
    RobotError,
    WorkspaceViolation,
    ZeroUnknown,
)
from frida_painter.hardware.gcode import Servo
from frida_painter.hardware.interlock import PATIENCE
from frida_painter.hardware.kinds import MachineName
from frida_painter.hardware.robot import ExaminedRobot, PausableRobot, TimedRobot, Waypoints, Workspace, ZeroedRobot
from frida_painter_drivers.axidraw import KIND, LIFTS, MAX_SPEED, AxidrawRobot, AxidrawSettings
from frida_painter_drivers.serial_line import SerialLine
from machines.ebb import BRUSHLESS, STANDARD, TimedEbb
from machines.paths import a_stroke
from machines.plotter_bench import plotter_bench
from machines.simulated_time import SimulatedTime

pytest.importorskip("serial", reason="the extra `plotter` is not installed")
from serial.tools.list_ports_common import ListPortInfo

HOME = (0.002, -0.001, 0.01)
SERVO = Servo((-0.002, 10_000), (0.012, 24_000))
BOARDS: list[dict[str, Any]] = [
    {"version": "2.5.3"},
    {"version": "2.6.5"},
    {"version": "2.8.1"},
    {"version": "3.0.3"},
    {"version": "3.0.3", "future": True},
    {"version": "3.0.3", "future": "only"},
    {"version": "3.0.3", "future": True, "lift": BRUSHLESS},
]
"""Boards as they are sold and left behind: NextDraw's software leaves the last two kinds."""


def name_board(how: dict[str, Any]) -> str:
    future = how.get("future", False)
    syntax = " " + {True: "future", "only": "future only"}[future] if future else ""
    return f"{how['version']}{syntax}{' brushless' if 'lift' in how else ''}"


Plug = Callable[..., TimedEbb]
every_board = pytest.mark.parametrize("how", BOARDS, ids=name_board)


def below(waypoints: Waypoints) -> Waypoints:
    """The same path where an AxiDraw's table is: y below zero."""
    return Waypoints(waypoints.label, waypoints.position * (1, -1, 1), waypoints.speed)


STROKE = below(a_stroke())


def robot_of(board: TimedEbb, **settings: Any) -> AxidrawRobot:
    lift = "brushless" if board.lift == BRUSHLESS else "standard"
    servo = Servo((-0.002, 5400), (0.012, 12_600)) if lift == "brushless" else SERVO
    return AxidrawRobot(AxidrawSettings(HOME, str(board.port), **{"lift": lift, "servo": servo, **settings}))


@contextmanager
def connected(plug: Plug, how: dict[str, Any] = {}, **more: Any) -> Iterator[tuple[TimedEbb, AxidrawRobot]]:  # noqa: B006
    """A board with its robot, connected, its zero known."""
    settings = more.pop("settings", {})
    with plug(**{"version": "2.8.1", **how, **more}) as board:
        robot = robot_of(board, **settings)
        robot.connect()
        robot.set_zero(np.zeros(3))
        yield board, robot
        robot.close()


@pytest.fixture
def plug(tmp_path: Path, simulated_time: SimulatedTime) -> Plug:
    """Makes a board and plugs it in. It lives while its driver waits."""
    return partial(TimedEbb, tmp_path / "port", simulated_time)


def places(board: TimedEbb, servo: Servo) -> np.ndarray:
    """Where the brush's tip was: x, y, z in metres."""
    rise = (servo.high[0] - servo.low[0]) / (servo.high[1] - servo.low[1])
    return np.array(
        [
            ((a + b) / 160_000, -(a - b) / 160_000, servo.low[0] + (pulse - servo.low[1]) * rise)
            for _, (a, b), pulse in board.trace
            if pulse is not None
        ]
    )


@every_board
def test_m4_m5_every_board_makes_the_steps_of_the_stroke_and_its_lift_the_heights(
    plug: Plug, how: dict[str, Any]
) -> None:
    with connected(plug, how) as (board, robot):
        for protocol in (ZeroedRobot, TimedRobot, ExaminedRobot, PausableRobot):
            assert isinstance(robot, protocol)
        report = robot.follow(STROKE)
        assert report.reached == pytest.approx(STROKE.position[-1], abs=1e-5)
        assert robot.pose() == pytest.approx(report.reached)
        found = places(board, robot.settings.range)
        for point in STROKE.position[1:-1]:
            near = np.abs(found - point)
            assert near[:, :2].max(1).min() < 2e-5
            assert near[near[:, :2].max(1) < 2e-5, 2].min() < 8e-4  # the servo is up to one pulse late
        assert robot.home().reached == pytest.approx(HOME, abs=1e-5)


def test_m5_at_the_wrong_pin_the_board_says_ok_and_the_brush_stays(plug: Plug) -> None:
    with plug("3.0.3", lift=BRUSHLESS) as board:
        robot = robot_of(board, lift="standard")
        robot.connect()
        robot.jog(np.array([0.0, 0.0, -0.004]))
        assert not board.pen  # nothing drove the servo at pin 5
        told = " ".join(fact.text for fact in robot.examine().facts)
        assert "if the brush does not move as the plotter is connected, write lift=brushless" in told
        robot = robot_of(board, lift="brushless", servo=None)
        robot.connect()
        assert board.pen == 12_600
        with pytest.raises(WorkspaceViolation, match=r"its servo reaches from .* Nothing was moved"):
            robot.jog(np.array([0.0, 0.0, 0.004]))
        assert board.pen == 12_600
        robot.jog(np.array([0.0, 0.0, -0.012]))
        board.settle()
        assert board.pen == 5400
        robot.close()


def test_m6_the_lift_holds_while_a_layer_dries_for_twenty_minutes(plug: Plug) -> None:
    with connected(plug, {"version": "2.6.5"}) as (board, robot):
        board.clock.sleep(1200)
        assert board.pen == 24_000  # up
        robot.follow(STROKE)


def test_m6_a_board_that_was_plotting_before_does_not_switch_the_lift_off(plug: Plug) -> None:
    with plug("2.6.3") as board:
        board.hear(b"SP,1\r")
        robot = robot_of(board)
        robot.connect()
        board.clock.sleep(120)
        assert board.pen is not None
        robot.close()


@every_board
def test_m7_the_brush_never_drops_faster_than_its_rates(plug: Plug, how: dict[str, Any]) -> None:
    settings = {"up_speed": 0.05, "down_speed": 0.02}
    with connected(plug, how, settings=settings) as (board, robot):
        board.trace.clear()
        robot.follow(STROKE)
        servo = robot.settings.range
        per_metre = (servo.high[1] - servo.low[1]) / (servo.high[0] - servo.low[0])
        pulses = np.array([[moment, pulse] for moment, _, pulse in board.trace if pulse is not None])
        changes = np.diff(pulses[:, 1])
        assert changes.max() <= 0.05 * 0.024 * per_metre * 1.1 + 1
        assert changes.min() >= -0.02 * 0.024 * per_metre * 1.1 - 1
        assert changes.min() < -0.02 * 0.024 * per_metre * 0.8  # and it does not crawl


@pytest.mark.parametrize("version", ["2.5.3", "3.0.3"])
def test_m8_too_many_steps_a_second_are_refused_before_anything_moves(plug: Plug, version: str) -> None:
    with connected(plug, {"version": version}) as (board, robot):
        board.settle()
        before = len(board.trace)
        fast = Waypoints("stroke 1", np.array([[0.1, -0.1, 0.01]]), 0.25)
        with pytest.raises(ConfigError, match=r"0.25 m/s; its board makes 25000 steps a second, .* It did not move"):
            robot.follow(fast)
        board.settle()
        assert len(board.trace) == before
        diagonal = Waypoints("stroke 1", np.array([[0.01, -0.01, 0.01], [0.09, -0.09, 0.01]]), MAX_SPEED)
        robot.follow(diagonal)  # which the board takes
    with pytest.raises(ConfigError, match=r"travel speed of 0.3 m/s; its board makes 25000 steps a second"):
        AxidrawSettings(HOME, approach=0.3)


@every_board
def test_m9_a_press_of_the_boards_button_is_told_once(plug: Plug, how: dict[str, Any]) -> None:
    with plug(**how) as board:
        board.press()
        robot = robot_of(board)
        robot.connect()
        assert not robot.wants_pause()  # it was pressed before
        board.press()
        assert robot.wants_pause() and not robot.wants_pause()
        robot.set_zero(np.zeros(3))
        board.press()
        robot.follow(STROKE)  # in which the board is asked for other things
        assert robot.wants_pause() and not robot.wants_pause()
        robot.close()


# The zero is never assumed.


@every_board
def test_a_board_that_was_just_started_does_not_move_until_its_zero_is_told(plug: Plug, how: dict[str, Any]) -> None:
    with plug(**how) as board:
        robot = robot_of(board)
        robot.connect()
        assert not robot.zero().known and not robot.zero().homes
        with pytest.raises(ZeroUnknown, match="does not know where it stands: its board was reset or just switched on"):
            robot.follow(STROKE)
        with pytest.raises(RobotError, match="has no switches"):
            robot.find_zero()
        board.push(4000, -800)  # its motors are off, so that a person can push the carriage
        assert board.carriage == [4000, -800]
        robot.set_zero(np.array([0.02, -0.03, 0.0]))
        board.push(4000, -800)
        assert board.carriage == [4000, -800]
        assert robot.zero().known
        assert robot.pose()[:2] == pytest.approx([0.02, -0.03])
        robot.jog(np.array([0.01, 0.0, 0.0]))
        assert board.carriage == [4800, 0]
        robot.close()


@every_board
@pytest.mark.parametrize("event", ["unplugged", "reset", "motors off", "another program"])
def test_the_zero_is_lost_where_the_carriage_may_have_moved(plug: Plug, how: dict[str, Any], event: str) -> None:
    with connected(plug, how) as (board, robot):
        robot.follow(STROKE)
        robot.close()
        board.settle()
        if event == "unplugged":
            board.pull_out()
            board.plug_in()
        elif event == "reset":
            board.restart()
        elif event == "motors off":
            board._on = [False, False]
        else:
            board.hear(b"EM,1,1\rCS\r")
            board.settle()
        robot.connect()
        assert not robot.zero().known
        with pytest.raises(ZeroUnknown):
            robot.home()


@pytest.mark.parametrize("version", ["2.8.1", "3.0.3"])
def test_motors_that_lose_their_power_lose_the_zero(plug: Plug, version: str) -> None:
    with connected(plug, {"version": version}) as (board, robot):
        board.cut_motor_power()
        with pytest.raises(MotionFailed, match="lost the power of its motors, so its carriage may have moved"):
            robot.follow(STROKE)
        with pytest.raises(RobotError, match="no power for its motors"):
            robot.connect()
        board.voltage = 300
        robot.connect()
        assert not robot.zero().known


def test_firmware_3_remembers_a_short_failure_of_the_motors_power(plug: Plug) -> None:
    with connected(plug, {"version": "3.0.3"}) as (board, robot):
        board.cut_motor_power(0.5)
        board.clock.sleep(1.0)
        assert board.voltage == 300
        with pytest.raises(MotionFailed, match="lost the power of its motors"):
            robot.follow(STROKE)


# What goes wrong.


@pytest.mark.parametrize("how", [{"version": "2.5.3"}, {"version": "3.0.3", "future": True}], ids=name_board)
@pytest.mark.parametrize(
    ("fault", "error", "says"),
    [
        ("error", MotionFailed, "answered '(XM,)?!6 Err: Invalid parameter value' to 'XM,.*' at waypoint"),
        ("garbage", MotionFailed, "answered '.*~~'"),
        ("unplug", RobotDisconnected, "is gone"),
        ("mute", RobotDisconnected, "said nothing for . s after '.*'; a command was lost"),
        ("half", RobotDisconnected, "said nothing for . s after '.*'; a command was lost"),
        ("late", RobotDisconnected, "said nothing for . s after '.*'; a command was lost"),
        ("reset", RobotDisconnected, "said nothing for . s after '.*'; a command was lost"),
    ],
)
def test_what_goes_wrong_is_told_and_nothing_moves_after(
    plug: Plug, how: dict[str, Any], fault: str, error: type[RobotError], says: str
) -> None:
    with connected(plug, how, faults={60: fault}) as (board, robot):
        board.silence = 2 * PATIENCE
        with pytest.raises(error, match=says):
            robot.follow(below(a_stroke(speed=0.2)))
        board.clock.sleep(3 * PATIENCE)
        moved = len(board.trace)
        assert fault in ("unplug", "mute") or board.stops == 1
        for action in (robot.home, robot.pose, lambda: robot.follow(STROKE)):
            with pytest.raises(RobotError, match="does not move after its last fault"):
                action()
        board.settle()
        assert len(board.trace) == moved
        if fault in ("error", "garbage", "late", "half"):  # the cable or the board recovered: it goes on where it was
            robot.connect()
            assert robot.zero().known
            robot.follow(STROKE)
            assert places(board, SERVO)[-1] == pytest.approx(STROKE.position[-1], abs=4e-4)


def test_a_board_is_found_by_its_numbers_or_by_the_name_that_its_owner_gave_it(monkeypatch: pytest.MonkeyPatch) -> None:
    ports = [
        ListPortInfo("/dev/ttyACM0"), ListPortInfo("/dev/ttyACM1"), ListPortInfo("/dev/ttyACM2"),
    ]  # fmt: skip
    for port, name in zip(ports[1:], ("East", None), strict=True):
        port.vid, port.pid, port.serial_number = 0x04D8, 0xFD92, name
    monkeypatch.setattr("serial.tools.list_ports.comports", lambda: ports)

    def refuse(port: str, baud: int) -> None:
        raise RobotDisconnected(f"tried {port}")

    monkeypatch.setattr(SerialLine, "open", refuse)
    for written, wanted in ((None, "/dev/ttyACM1"), ("east", "/dev/ttyACM1"), ("/dev/ttyACM2",) * 2, ("west",) * 2):
        with pytest.raises(RobotDisconnected, match=f"tried {wanted}"):
            AxidrawRobot(AxidrawSettings(HOME, written)).connect()


def test_no_board_no_port_and_other_devices_are_told(plug: Plug, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("serial.tools.list_ports.comports", list)
    with pytest.raises(RobotDisconnected, match="No AxiDraw was found"):
        AxidrawRobot(AxidrawSettings(HOME)).connect()
    with pytest.raises(RobotDisconnected, match="serial port '/dev/ttyNOPE' cannot be opened"):
        AxidrawRobot(AxidrawSettings(HOME, "/dev/ttyNOPE")).connect()
    with plug("2.3.0") as board:
        with pytest.raises(RobotError, match=r"firmware 2.3.0, which does not count its steps; update it"):
            robot_of(board).connect()
        board.written = "x"
        with pytest.raises(RobotDisconnected, match="is no EiBotBoard; it said 'EBBv13"):
            robot_of(board).connect()
    monkeypatch.setitem(sys.modules, "serial.tools.list_ports", None)
    with pytest.raises(RobotError, match='extra "plotter"'):
        AxidrawRobot(AxidrawSettings(HOME)).connect()


@every_board
def test_what_a_board_still_owed_an_earlier_program_is_not_taken_for_its_answer(
    plug: Plug, how: dict[str, Any]
) -> None:
    with plug(**how) as board:
        board.cable.silent = True  # it answers late
        board.hear(b"QL,0\r")
        board.clock.after(0.1, board.cable.speak_again)
        robot = robot_of(board)
        robot.connect()
        assert not robot.zero().known
        robot.close()


def test_a_height_beyond_the_servo_is_refused_before_anything_moves(plug: Plug) -> None:
    with connected(plug) as (board, robot):
        board.settle()
        before = len(board.trace)
        with pytest.raises(ConfigError, match="servo reaches from -2 to 12 mm"):
            robot.follow(Waypoints("stroke 1", np.array([[0.1, -0.1, 0.01], [0.1, -0.1, -0.01]]), 0.1))
        board.settle()
        assert len(board.trace) == before
        robot.follow(STROKE)


def test_the_doctor_reads_what_the_board_tells_and_changes_nothing(plug: Plug) -> None:
    with connected(plug, {"version": "2.6.0"}) as (board, robot):
        robot.follow(STROKE)
        robot.close()
        board.settle()
        asked, moved = len(board.received), len(board.trace)
        found = robot.examine()
        board.settle()
        assert len(board.trace) == moved
        assert {line.split(",")[0] for line in board.received[asked:]} <= {"V", "QC", "QL", "QN", "QS", "PI", "QM"}
        assert "Its zero is known" in found.facts[1].text
        assert any("firmware 2.6.0 has faults".lower() in fact.text.lower() for fact in found.facts)
        board.voltage = 0
        assert [fact.weight for fact in robot.examine().facts].count("refusal") == 1
        board.restart()
        board.voltage = 300
        assert "reset or just switched on" in robot.examine().facts[1].text


def test_names_choose_lift_and_speeds() -> None:
    corner = (0.0, 0.0, 0.0)
    workspace = Workspace(corner, corner, corner, 0.0, (), corner, corner, 0.1, 0.01, 0.05, 0.2, HOME)
    robot = KIND.open(MachineName.of("axidraw:/dev/x,lift=brushless,down_speed=0.01", KIND.form), workspace)
    assert isinstance(robot, AxidrawRobot)
    assert (robot.settings.pin, robot.settings.range) == (5, LIFTS["brushless"].servo)
    assert (robot.settings.down_speed, robot.settings.approach) == (0.01, 0.2)
    for name in ("axidraw:x,lift=hydraulic", "axidraw:x,down_speed=soon", "axidraw:x,speed=1"):
        with pytest.raises(ConfigError):
            KIND.open(MachineName.of(name, KIND.form), workspace)
    assert LIFTS["standard"].pin == STANDARD


@pytest.mark.parametrize("version", ["2.8.1", "3.0.3"])
def test_another_program_that_moved_the_carriage_is_noticed(simulated_time: SimulatedTime, version: str) -> None:
    """M35: its EM sets the counters to zero with the carriage away, and it then counts from there."""
    bench = plotter_bench(simulated_time, version)
    robot = bench.ready()
    robot.follow(a_stroke())
    robot.close()
    robot.connect()
    assert robot.zero().known
    robot.close()
    cable = bench.controller
    for line in ("EM,1,1", "XM,500,400,200"):
        cable.hear(f"{line}\r".encode())
        simulated_time.sleep(1)
    again = bench.robot()
    again.connect()
    assert "another program has moved it" in again.zero().lost
