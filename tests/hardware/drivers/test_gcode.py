"""What only one firmware has: laser mode, inches, software endstops, ports. All else is in test_behaviours.py."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from frida_painter.errors import ConfigError, MotionFailed, RobotDisconnected, RobotError, RobotStopped
from frida_painter.hardware.gcode import Gcode, OwnGcode, Servo
from frida_painter.hardware.robot import Waypoints
from frida_painter_drivers import serial_line
from frida_painter_drivers.gcode import GcodeRobot
from machines import grbl, marlin
from machines.bench import FOUND, SERVO_GRBL, SERVO_MARLIN, SerialBench, grbl_bench, marlin_bench, serial_bench
from machines.paths import a_stroke
from machines.simulated_time import SimulatedTime

LASER = {**grbl.QUICK, "32": 1}
HOMES = {**grbl.QUICK, "22": 1, "25": 3000.0}


def texts(bench: SerialBench, weight: str) -> str:
    return " ".join(fact.text for fact in bench.robot().examine().facts if fact.weight == weight)


# GRBL


def test_a_line_that_resets_the_board_does_so_once_and_the_zero_is_not_believed(simulated_time: SimulatedTime) -> None:
    """M1: DTR rises when the line is opened; from then on it stays up."""
    bench = grbl_bench(simulated_time, grbl.GRBL, grbl.QUICK)
    robot = bench.robot()
    robot.connect()
    assert bench.controller.starts == 1
    assert "was reset, and counts from 0 wherever it stands" in robot.zero().lost
    for _ in range(3):
        robot.close()
        simulated_time.sleep(1)
        robot.connect()
    assert bench.controller.starts == 1


def test_another_programs_reset_or_offset_makes_the_zero_doubtful(simulated_time: SimulatedTime) -> None:
    bench = grbl_bench(simulated_time, grbl.GRBL, grbl.QUICK)
    bench.ready().close()
    bench.controller.hear(b"\x18")  # a soft reset, as other programs send when they connect
    simulated_time.sleep(0.1)
    robot = bench.robot()
    robot.connect()
    assert not robot.zero().known
    robot.set_zero(FOUND)
    robot.close()
    bench.controller.stored = bench.controller.stored + np.array([5.0, 0, 0])  # somebody set another zero
    robot.connect()
    assert not robot.zero().known


def test_a_machine_with_switches_is_homed_only_if_that_is_allowed(simulated_time: SimulatedTime) -> None:
    bench = serial_bench(simulated_time, grbl.GrblController(grbl.GRBL, HOMES), Gcode("grbl", 0.1))
    with pytest.raises(RobotError, match="allow homing in its settings"):
        bench.robot().connect()
    assert "$H" not in bench.commands() and "$X" not in bench.commands()
    allowed = serial_bench(simulated_time, grbl.GrblController(grbl.GRBL, HOMES), Gcode("grbl", 0.1), homing=True)
    robot = allowed.robot()
    robot.connect()
    assert not robot.zero().known and robot.zero().homes, "a person is asked first (M26)"
    sent = len(allowed.commands())
    for act in (lambda: robot.jog(np.array([0.001, 0, 0])), lambda: robot.set_zero(FOUND)):
        with pytest.raises(RobotError, match=r"locked by an alarm.* Let it home"):
            act()
    assert len(allowed.commands()) == sent
    robot.find_zero()
    assert robot.zero().known and allowed.commands().count("$H") == 1
    robot.follow(Waypoints("aside", np.array([[-0.05, -0.05, -0.02]]), 0.1))
    robot.close()
    robot.connect()
    assert robot.zero().known, "it knows where it is"
    robot.find_zero()
    assert allowed.commands().count("$H") == 2


def test_a_machine_without_switches_goes_on_without(simulated_time: SimulatedTime) -> None:
    """M28: homing was allowed by a preset, and a person knows better."""
    bench = serial_bench(simulated_time, grbl.GrblController(grbl.GRBL, grbl.QUICK), Gcode("grbl", 0.1), homing=True)
    asked = [fact for fact in bench.robot().examine().facts if fact.question]
    assert any("does not home ($22=0)" in fact.question and fact.weight == "warning" for fact in asked)
    robot = bench.ready()
    assert not robot.zero().homes and "$H" not in bench.commands()


@pytest.mark.parametrize(("bits", "homes"), [(1, True), (3, True), (7, True), (13, True), (2, False), (12, False)])
def test_the_lowest_bit_says_if_grblhal_homes(simulated_time: SimulatedTime, bits: int, homes: bool) -> None:
    """M41: homing_settings_flags_t of grblHAL's settings.h."""
    machine = grbl.GrblController(grbl.GRBLHAL, {**HOMES, "22": bits})
    bench = serial_bench(simulated_time, machine, Gcode("grbl", 0.1), homing=True)
    robot = bench.robot()
    robot.connect()
    assert robot.zero().homes is homes


@pytest.mark.parametrize("kind", [grbl.GRBL, grbl.GRBLHAL, grbl.FLUIDNC])
def test_homing_has_the_time_that_its_rates_need_and_giving_up_ends_it(
    simulated_time: SimulatedTime, kind: grbl.Kind
) -> None:
    """M27: at 500 and 25 mm/min 900 mm take longer than anybody waited."""
    slow = {**HOMES, "25": 500.0, "24": 25.0, "130": 900.0, "131": 400.0}
    bench = serial_bench(simulated_time, grbl.GrblController(kind, slow), Gcode("grbl", 0.1), homing=True)
    robot = bench.robot()
    robot.connect()
    began = simulated_time.now
    robot.find_zero()
    assert 100 < simulated_time.now - began < robot.zero().seconds
    bench.controller.settings["25"] = 1.0  # a motor that stalls
    with pytest.raises(RobotDisconnected):
        robot.find_zero()
    simulated_time.sleep(0.1)
    assert bench.controller.state == "Alarm" and "reset" in bench.commands()


def test_a_mark_for_a_known_zero_moves_nothing(simulated_time: SimulatedTime) -> None:
    """M29: a pen on the spindle output is lifted by lines of one's own; S would move it, as gcode.c says."""
    own = OwnGcode(lift=("M3 S900",), lower=("M3 S300",), down_below=0.001)
    language = Gcode("grbl", 0.1, own=own)
    bench = serial_bench(simulated_time, grbl.GrblController(grbl.GRBL, grbl.QUICK), language)
    robot = bench.ready()
    assert bench.controller.output == []
    robot.follow(Waypoints("stroke 1", np.array([[0.1, 0.05, 0.01], [0.1, 0.05, 0.0], [0.12, 0.05, 0.0]]), 0.05))
    assert [value for value, _ in bench.controller.output] == [900, 300]
    robot.close()
    robot.connect()
    assert robot.zero().known and [value for value, _ in bench.controller.output] == [900, 300]
    robot.stop()
    robot.close()
    robot.connect()
    assert robot.zero().known, "it was stopped at rest, and reset at rest"


@pytest.mark.parametrize(("kind", "directions", "inside", "outside"), [
    (grbl.GRBL, 0, -10.0, 10.0), (grbl.GRBL, 7, -10.0, 10.0), (grbl.ORIGIN, 7, 10.0, -10.0),
    (grbl.ORIGIN, 0, -10.0, 10.0), (grbl.FLUIDNC, 7, 10.0, -10.0), (grbl.FLUIDNC, 0, -10.0, 10.0),
    (replace(grbl.FLUIDNC, places=(300.0, 300.0, 40.0)), 0, 30.0, 310.0),
])  # fmt: skip
def test_the_box_is_where_the_machine_homes(
    simulated_time: SimulatedTime, kind: grbl.Kind, directions: int, inside: float, outside: float
) -> None:
    """M30: HOMING_FORCE_SET_ORIGIN (system.c), positive_direction and mpos_mm (FluidNC's Limit.cpp)."""
    limited = {**HOMES, "20": 1, "23": directions}
    bench = serial_bench(simulated_time, grbl.GrblController(kind, limited), Gcode("grbl", 0.1), homing=True)
    robot = bench.robot()
    robot.connect()
    robot.find_zero()
    robot.follow(Waypoints("there", np.full((1, 3), inside / 1000), 0.1))
    with pytest.raises(MotionFailed, match="beyond the limits"):
        robot.follow(Waypoints("out", np.full((1, 3), outside / 1000), 0.1))
    assert robot._firmware._ask().state == "Idle", "it was not sent: an alarm would follow"


def test_two_numbers_are_a_place(simulated_time: SimulatedTime) -> None:
    """M37: FluidNC with two axes; its brush is raised by a servo."""
    flat = grbl.GrblController(grbl.FLUIDNC_FLAT, {**grbl.QUICK, "32": 1})
    bench = serial_bench(simulated_time, flat, Gcode("grbl", 0.1, SERVO_GRBL))
    robot = bench.ready()
    robot.jog(np.array([0.01, 0.0, 0.0]))
    robot.follow(Waypoints("stroke 1", np.array([[0.1, 0.05, 0.01], [0.12, 0.05, 0.0]]), 0.05))
    assert robot.pose()[:2] == pytest.approx((0.12, 0.05)) and robot.timing() is not None
    robot.close()
    flat = grbl.GrblController(grbl.FLUIDNC_FLAT, grbl.QUICK)
    with pytest.raises(RobotError, match=r"has no axis Z.*give servo="):
        serial_bench(simulated_time, flat, Gcode("grbl", 0.1)).robot().connect()


def test_grbl_0_9_is_named_with_what_to_do(simulated_time: SimulatedTime) -> None:
    """M38."""
    with pytest.raises(RobotError, match=r"has GRBL 0\.9 or older.*flash GRBL 1\.1"):
        grbl_bench(simulated_time, grbl.GRBL_0_9, grbl.QUICK).robot().connect()


def test_a_slow_list_of_settings_is_waited_for(simulated_time: SimulatedTime) -> None:
    """M39: and no ok of it acknowledges another line."""
    bench = grbl_bench(simulated_time, grbl.SLOW, {**grbl.QUICK, "22": 1, "20": 1})
    examined = bench.robot().examine()
    assert examined.timing is not None and examined.travel is not None


def test_a_stop_while_homing_ends_it(simulated_time: SimulatedTime) -> None:
    bench = serial_bench(simulated_time, grbl.GrblController(grbl.GRBL, HOMES), Gcode("grbl", 0.1), homing=True)
    robot = bench.robot()
    robot.connect()
    simulated_time.when(lambda: bench.controller.state == "Home", lambda: simulated_time.after(1, robot.stop))
    with pytest.raises(RobotStopped):
        robot.find_zero()
    simulated_time.sleep(0.1)
    assert bench.controller.state == "Alarm" and "reset" in bench.commands()


def test_in_laser_mode_the_servo_holds_its_height_from_the_first_travel_on(simulated_time: SimulatedTime) -> None:
    """M2: after a reset the modal state is G0, in which laser mode puts out 0."""
    bench = grbl_bench(simulated_time, grbl.GRBL, LASER, SERVO_GRBL)
    robot = bench.ready()
    robot.follow(Waypoints("above stroke 1", np.array([[0.12, 0.06, 0.05]]), 0.1))
    robot.follow(a_stroke())
    values = [value for value, _ in bench.controller.output]
    assert values[0] == 900 and min(values) >= 100
    assert not any(line.startswith("G0") for line in bench.commands())


@pytest.mark.parametrize("laser", [0, 1])
def test_a_stop_drops_the_servos_signal_only_in_laser_mode_and_doctor_says_so(
    simulated_time: SimulatedTime, laser: int
) -> None:
    """M3."""
    bench = grbl_bench(simulated_time, grbl.GRBL, {**grbl.QUICK, "32": laser}, SERVO_GRBL)
    assert ("a stop cuts the servo's signal, and the brush may drop" in texts(bench, "warning")) == bool(laser)
    robot = bench.ready()
    robot.follow(Waypoints("above", np.array([[0.1, 0.05, 0.03]]), 0.05))
    bench.when_moved(0.01, robot.stop)
    with pytest.raises(RobotStopped):
        robot.follow(Waypoints("stroke 1", np.array([[0.16, 0.05, 0.03]]), 0.05))
    simulated_time.sleep(3)
    assert bench.controller.pulse == (0 if laser else pytest.approx(598, abs=1))
    robot.close()
    assert bench.controller.state == "Hold:0", "a reset would drop it, too"
    again = bench.robot()
    again.connect()
    assert bench.controller.state == "Idle"


@pytest.mark.parametrize("build", [lambda clock: grbl_bench(clock, grbl.GRBL, LASER, SERVO_GRBL),
                                   lambda clock: marlin_bench(clock, marlin.SERVO, SERVO_MARLIN)])  # fmt: skip
@pytest.mark.parametrize("how", ["jog", "follow"])
def test_a_brush_that_a_stop_may_have_dropped_is_lifted_before_it_goes_anywhere(
    simulated_time: SimulatedTime, build: Callable[[SimulatedTime], SerialBench], how: str
) -> None:
    """M3."""
    bench = build(simulated_time)
    robot = bench.ready()
    robot.follow(Waypoints("down", np.array([[0.1, 0.05, 0.0]]), 0.05))
    bench.when_moved(0.01, robot.stop)
    with pytest.raises(RobotStopped):
        robot.follow(Waypoints("stroke 1", np.array([[0.1, 0.05, 0.0], [0.16, 0.05, 0.0]]), 0.05))
    robot.close()
    again = bench.robot()
    again.connect()
    before, heights = len(bench.moved()), list[float]()
    simulated_time.when(lambda: len(bench.moved()) > before and bool(heights.append(bench.height_of_servo())), list)
    if how == "jog":
        again.jog(np.array([0.01, 0.0, 0.0]))
    else:
        if not again.zero().known:
            again.set_zero(np.array([0.11, 0.05, 0.0]))
        again.follow(Waypoints("away", np.array([[0.18, 0.05, 0.04]]), 0.05))
    assert heights and heights[0] == pytest.approx(0.05, abs=bench.exact_height + 1e-6)


def test_the_brush_is_lifted_before_a_machine_homes(simulated_time: SimulatedTime) -> None:
    """M3: it may stand on the canvas. GRBL itself homes the axis Z first; Marlin does not."""
    for machine, language, code in (
        (grbl.GrblController(grbl.GRBL, HOMES), Gcode("grbl", 0.1, SERVO_GRBL), "$H"),
        (marlin.MarlinController(marlin.SERVO), Gcode("marlin", 0.1, SERVO_MARLIN), "G28"),
        (marlin.MarlinController(marlin.PLAIN), Gcode("marlin", 0.1), "G28"),
    ):
        bench = serial_bench(simulated_time, machine, language, homing=True)
        robot = bench.robot()
        robot.connect()
        for _ in range(2):  # the first ends an alarm, in which GRBL takes no other line
            robot.find_zero()
        said = bench.commands()
        at = len(said) - 1 - said[::-1].index(code)
        if language.servo is not None:
            assert any("S9" in line for line in said[at - 3 : at]), said[at - 5 : at + 1]
        else:
            assert any("Z5.000" in line for line in said[at - 4 : at]), said[at - 5 : at + 1]


@pytest.mark.parametrize("make", [lambda clock, servo: grbl_bench(clock, grbl.GRBL, LASER, servo),
                                  lambda clock, servo: marlin_bench(clock, marlin.SERVO, servo)])  # fmt: skip
def test_a_servo_lands_softly_and_lifts_at_once(simulated_time: SimulatedTime, make) -> None:  # type: ignore[no-untyped-def]
    """M7: never more than a millimetre at a time on the way down, at the speed that was set."""
    bench = make(simulated_time, Servo((-0.003, 10), (0.05, 90), speed=0.02))
    robot = bench.ready()
    robot.follow(Waypoints("above", np.array([[0.1, 0.05, 0.05]]), 0.05))
    heights: list[float] = []
    simulated_time.when(lambda: bool(heights.append(bench.height_of_servo())), lambda: None)
    began = simulated_time.now
    robot.follow(Waypoints("down", np.array([[0.1, 0.05, 0.0]]), 0.05))
    took = simulated_time.now - began
    down = -np.diff(heights)
    foretold = robot.timing().servo.seconds(0.05, 0.0)
    assert down.max() < 0.0018 and foretold > 2.4 and took == pytest.approx(foretold, rel=0.15)
    heights.clear()
    robot.follow(Waypoints("up", np.array([[0.1, 0.05, 0.05]]), 0.05))
    assert np.diff(heights).max() > 0.03


def test_an_axis_goes_down_no_faster_than_it_should(simulated_time: SimulatedTime) -> None:
    """M7 for machines with an axis."""
    bench = serial_bench(
        simulated_time, grbl.GrblController(grbl.GRBL, grbl.QUICK), Gcode("grbl", 0.1, None, 0.005, 0.02)
    )
    robot = bench.ready()
    began = simulated_time.now
    robot.follow(Waypoints("press", np.array([[0.1, 0.05, 0.012], [0.1, 0.05, 0.002]]), 0.05))
    assert simulated_time.now - began == pytest.approx(2.0, rel=0.2)
    slow = next(line for line in bench.commands() if "Z2.000" in line)
    assert slow.endswith("F300")


def test_a_clones_ok_after_a_report_acknowledges_nothing(simulated_time: SimulatedTime) -> None:
    """M17: no line is sent before the one before it was acknowledged, although an ok follows every report."""
    bench = grbl_bench(simulated_time, grbl.CLONE, {**grbl.DEFAULTS})
    robot = bench.ready()
    waiting: list[int] = []
    simulated_time.when(lambda: bool(waiting.append(len(bench.controller._waiting))), lambda: None)
    long = np.array([[0.1 + 0.02 * (k % 2), 0.05 + 0.002 * k, 0.012] for k in range(24)])
    robot.follow(Waypoints("stroke 1", long, 0.1))
    assert max(waiting) <= 1
    robot.close()
    assert "a clone that says ok after each report" in texts(bench, "fact")


def test_motors_that_are_released_at_rest_are_told_and_refused_if_the_brush_sinks(
    simulated_time: SimulatedTime,
) -> None:
    """M18."""
    assert "releases its motors 25 ms after each motion ($1=25)" in texts(
        grbl_bench(simulated_time, grbl.GRBL), "warning"
    )
    sinking = serial_bench(simulated_time, grbl.GrblController(grbl.GRBL), Gcode("grbl", 0.1, sinks=True))
    with pytest.raises(RobotError, match=r"cannot paint like this.*the brush would sink.*Set \$1=255"):
        sinking.robot().connect()
    held = {**grbl.DEFAULTS, "1": 255}
    fine = serial_bench(simulated_time, grbl.GrblController(grbl.GRBL, held), Gcode("grbl", 0.1, sinks=True))
    fine.robot().connect()


def test_a_servo_value_that_would_be_cut_off_is_refused(simulated_time: SimulatedTime) -> None:
    bench = grbl_bench(simulated_time, grbl.GRBL, {**LASER, "30": 255}, SERVO_GRBL)
    with pytest.raises(RobotError, match=r"The servo's value 900 is outside of 0 to 255 \(\$31, \$30\)"):
        bench.robot().connect()


def test_a_way_beyond_the_machines_own_limits_is_refused_before_it_moves(simulated_time: SimulatedTime) -> None:
    limited = {**HOMES, "20": 1}
    bench = serial_bench(simulated_time, grbl.GrblController(grbl.GRBL, limited), Gcode("grbl", 0.1), homing=True)
    robot = bench.robot()
    robot.connect()
    robot.find_zero()
    sent = len(bench.commands())
    with pytest.raises(MotionFailed, match=r"z = -120\.0 mm at waypoint 1 is beyond the limits .* It did not move"):
        robot.follow(Waypoints("dip", np.array([[-0.1, -0.1, -0.05], [-0.1, -0.1, -0.12]]), 0.05))
    assert not any(line.startswith("G1X") for line in bench.commands()[sent:])
    robot.follow(Waypoints("dip", np.array([[-0.1, -0.1, -0.05]]), 0.05))


def test_a_limit_switch_that_is_hit_is_named(simulated_time: SimulatedTime) -> None:
    bench = grbl_bench(simulated_time, grbl.GRBL, {**grbl.QUICK, "21": 1})
    robot = bench.ready()
    bench.controller.wall = bench.controller.tip[0] + 12
    with pytest.raises(MotionFailed, match=r"with alarm 1 \(a limit switch was hit\)"):
        robot.follow(a_stroke())


@pytest.mark.parametrize(("state", "says"), [("Door:1", "its safety door is open"), ("Sleep", "is asleep")])
def test_a_machine_that_cannot_move_says_why(simulated_time: SimulatedTime, state: str, says: str) -> None:
    bench = grbl_bench(simulated_time, grbl.GRBL, grbl.QUICK)
    robot = bench.ready()

    def happen() -> None:
        bench.controller.queue.hold()
        bench.controller.state = state

    bench.when_moved(0.005, happen)
    with pytest.raises(MotionFailed, match=says):
        robot.follow(a_stroke())


def test_a_machine_that_says_run_and_does_not_move_is_given_up(simulated_time: SimulatedTime) -> None:
    bench = grbl_bench(simulated_time, grbl.GRBL, grbl.QUICK)
    robot = bench.ready()

    def jam() -> None:
        bench.controller.queue.advance = lambda seconds: None
        bench.controller.state = "Run"

    bench.when_moved(0.005, jam)
    with pytest.raises(RobotDisconnected, match="says 'Run' and has not moved for"):
        robot.follow(a_stroke())


# Marlin


def test_software_endstops_that_would_cut_a_stroke_are_noticed(simulated_time: SimulatedTime) -> None:
    """M12: Marlin goes to the nearest place that they allow, and says ok."""
    build = marlin.Build(lowest=(0.0, 0.0, 0.0), highest=(235.0, 235.0, 250.0))
    bench = serial_bench(simulated_time, marlin.MarlinController(build), Gcode("marlin", 0.1), lowest=-0.005)
    assert "never goes below z = 0 mm, and the workspace reaches down to -5 mm" in texts(bench, "warning")
    robot = bench.robot()
    robot.connect()
    robot.set_zero(np.array([0.1, 0.05, 0.0]))
    with pytest.raises(MotionFailed, match=r"stroke 7: z = -.* is beyond the limits .* It did not move"):
        robot.follow(a_stroke())
    assert len(bench.moved()) == 0
    off = serial_bench(simulated_time, marlin.MarlinController(marlin.Build(endstops=False)), Gcode("marlin", 0.1))
    off.ready().follow(a_stroke())


def test_a_servo_that_marlin_does_not_know_is_refused(simulated_time: SimulatedTime) -> None:
    """M11."""
    bench = marlin_bench(simulated_time, marlin.PLAIN, SERVO_MARLIN)
    with pytest.raises(RobotError, match="M280 is an unknown command"):
        bench.robot().connect()
    assert len(bench.moved()) == 0


def test_an_unknown_command_in_a_motion_ends_it(simulated_time: SimulatedTime) -> None:
    bench = marlin_bench(simulated_time, marlin.PLAIN)
    robot = bench.ready()
    with pytest.raises(MotionFailed, match="does not know 'M999 X1'"):
        robot._firmware.send("M999 X1", "stroke 1", 3)


def test_a_stop_while_marlin_homes_is_an_emergency_stop_and_doctor_said_so(simulated_time: SimulatedTime) -> None:
    """M13: it does not hear M410 while it homes."""
    bench = serial_bench(simulated_time, marlin.MarlinController(marlin.PLAIN), Gcode("marlin", 0.1), homing=True)
    assert "hears nothing but the emergency stop (M112)" in texts(bench, "warning")
    robot = bench.robot()
    robot.connect()
    assert not robot.zero().known and "G28" not in bench.commands(), "a person is asked first (M26)"
    simulated_time.when(lambda: bench.controller._busy_with == "G28", lambda: simulated_time.after(2, robot.stop))
    with pytest.raises(RobotStopped):
        robot.find_zero()
    simulated_time.sleep(0.1)
    assert bench.controller.killed and "M112" in bench.commands()


def test_a_line_that_marlin_got_damaged_is_sent_again_three_times(simulated_time: SimulatedTime) -> None:
    bench = marlin_bench(simulated_time, marlin.ADVANCED)
    robot, stroke = bench.ready(), a_stroke()
    bench.controller.damage_lines = 2
    assert robot.follow(stroke).reached == pytest.approx(stroke.position[-1], abs=2e-5)
    bench.controller.damage_lines = 3
    with pytest.raises(RobotDisconnected, match="damaged 3 times"):
        robot.follow(stroke)


def test_a_stop_may_lose_steps_so_marlins_zero_is_found_again(simulated_time: SimulatedTime) -> None:
    bench = marlin_bench(simulated_time, marlin.PLAIN)
    robot = bench.ready()
    bench.when_moved(0.01, robot.stop)
    with pytest.raises(RobotStopped):
        robot.follow(a_stroke())
    robot.close()
    robot.connect()
    assert "since its last start or stop nobody has told it where it stands" in robot.zero().lost


# Ports and names


def test_a_port_that_does_not_exist_lists_those_that_do(monkeypatch: pytest.MonkeyPatch) -> None:
    class Port:
        device, description = "/dev/ttyUSB3", "USB Serial"
        serial_number = manufacturer = product = None

    monkeypatch.setattr("serial.tools.list_ports.comports", lambda: [Port()])
    robot = GcodeRobot("/dev/ttyNOPE", (0.0, 0.0, 0.05), Gcode())
    with pytest.raises(RobotDisconnected, match=r"'/dev/ttyNOPE' cannot be opened .* There are: /dev/ttyUSB3 \(USB"):
        robot.connect()
    monkeypatch.setattr("serial.tools.list_ports.comports", list)
    with pytest.raises(RobotDisconnected, match="has no serial ports; plug"):
        robot.connect()
    robot.close()


def test_a_port_that_the_user_may_not_use_or_that_brltty_took_says_what_to_do(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """M23."""

    def refuse(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("serial.Serial", refuse)
    with pytest.raises(RobotDisconnected, match=r"may not use it: run `sudo usermod -aG \S+ \$USER`, log out and in"):
        GcodeRobot(str(tmp_path / "ttyUSB0"), (0.0, 0.0, 0.05), Gcode()).connect()
    monkeypatch.undo()
    monkeypatch.setattr(serial_line, "_is_taken_by_brltty", lambda: True)
    with pytest.raises(RobotDisconnected, match="takes CH340 adapters for Braille displays: remove it"):
        GcodeRobot(str(tmp_path / "ttyUSB0"), (0.0, 0.0, 0.05), Gcode()).connect()


@pytest.mark.parametrize("speed", [0.0, -1.0, math.nan, math.inf])
def test_speeds_of_the_brush_are_above_0(speed: float) -> None:
    with pytest.raises(ConfigError, match="to lower the brush"):
        Gcode("grbl", lower=speed)
    with pytest.raises(ConfigError, match="to lift the brush"):
        Gcode("grbl", lift=speed)
