import threading
import time

import numpy as np
import pytest

from frida_painter.errors import MotionFailed, RobotDisconnected, RobotError, RobotStopped
from frida_painter.hardware.drivers.gcode import GcodeRobot, GcodeSettings
from frida_painter.hardware.gcode import Gcode, Servo
from frida_painter.hardware.robot import Waypoints
from machines.fake_grbl import FakeGrbl
from machines.fake_marlin import FakeMarlin
from machines.paths import NOT_PATHS, a_stroke

HOME = (0.0, 0.0, 0.05)


def robot_at(machine: FakeGrbl | FakeMarlin, homing: bool = False, servo: Servo | None = None) -> GcodeRobot:
    flavour = "grbl" if isinstance(machine, FakeGrbl) else "marlin"
    return GcodeRobot(GcodeSettings(machine.name, HOME, gcode=Gcode(flavour, 0.2, servo), homing=homing))


@pytest.mark.parametrize("kind", [FakeGrbl, FakeMarlin])
def test_it_goes_where_it_is_sent_and_says_when_it_is_there(kind: type[FakeGrbl | FakeMarlin]) -> None:
    stroke = a_stroke()
    with kind() as machine:
        robot = robot_at(machine)
        robot.connect()
        before = time.monotonic()
        report = robot.follow(stroke)
        assert before <= report.started_at <= report.finished_at <= time.monotonic()
        assert report.label == "stroke 7"
        assert np.abs(report.reached - stroke.position[-1]).max() < 1e-5
        assert np.abs(robot.pose() - stroke.position[-1]).max() < 1e-5
        sent = [place / 1000 for place in machine.moved]
        for point in stroke.position:
            assert min(np.abs(place - point).max() for place in sent) < 1e-5
        assert robot.home().reached == pytest.approx(HOME, abs=1e-5)
        robot.close()
    assert [line for line in machine.received if line.startswith("G2")] == ["G21"]
    assert "G90" in machine.received


def test_home_leads_up_before_it_leads_aside() -> None:
    with FakeGrbl() as machine:
        robot = robot_at(machine)
        robot.connect()
        robot.follow(a_stroke())
        start = len(machine.moved)
        robot.home()
        robot.close()
    lift = next(place for place in machine.moved[start:] if abs(place[2] - 50) < 1e-6)
    assert lift[:2] == pytest.approx((130, 50), abs=1e-3)


@pytest.mark.parametrize(
    ("fault", "error", "says"),
    [
        (
            "error",
            MotionFailed,
            r"stroke 7: the grbl machine .* refused a line at waypoint 12 with error 15 \(bey",
        ),
        ("alarm", MotionFailed, r"stopped at waypoint 12 with alarm 1 \(a limit switch was hit\).*never does"),
        ("quiet alarm", MotionFailed, r"is in an alarm at waypoint 12; it says 'Alarm'.*never does"),
        ("Door:0", MotionFailed, r"door was opened; the door is closed again at waypoint 12; it says 'Door:0'. Look"),
        ("Door:1", MotionFailed, r"its safety door is open at waypoint 12; it says 'Door:1'.*reset it with its own"),
        ("Hold:0", MotionFailed, r"is held: its feed hold was pressed.* at waypoint 12; it says 'Hold:0'"),
        ("Sleep", MotionFailed, r"is asleep at waypoint 12; it says 'Sleep'"),
        ("reset", MotionFailed, "was reset at waypoint 12; it has forgotten"),
        ("lose", RobotDisconnected, "idle and has not acknowledged 'G1 X.*A line was lost"),
        ("garbage", RobotDisconnected, "which is not GRBL's"),
        ("unplug", RobotDisconnected, "is gone"),
    ],
)
def test_what_goes_wrong_in_a_stroke_is_told_and_nothing_moves_after(
    fault: str, error: type[RobotError], says: str
) -> None:
    with FakeGrbl(misbehave={12: fault}) as machine:
        robot = robot_at(machine)
        robot.connect()
        with pytest.raises(error, match=says) as told:
            robot.follow(a_stroke())
        if isinstance(told.value, MotionFailed):
            assert told.value.waypoint == 12
            assert told.value.code in ("15", "1", "Alarm", "reset", fault)
        time.sleep(0.05)
        moved = len(machine.moved)
        for action in (robot.home, lambda: robot.follow(a_stroke()), robot.pose):
            with pytest.raises(RobotError, match=r"does not move after its last fault|was stopped"):
                action()
        time.sleep(0.05)
        assert len(machine.moved) == moved
        assert not any(line.startswith("$X") for line in machine.received)
        robot.close()


def test_a_machine_that_acknowledges_too_much_is_waited_for_until_it_stands() -> None:
    stroke = a_stroke()
    with FakeGrbl(pace=5, misbehave=dict.fromkeys((3, 9, 20), "twice")) as machine:
        robot = robot_at(machine)
        robot.connect()
        assert np.abs(robot.follow(stroke).reached - stroke.position[-1]).max() < 1e-5
        moved = len(machine.moved)
        time.sleep(0.05)
        assert len(machine.moved) == moved
        robot.close()


def test_a_machine_that_falls_silent_is_given_up_at_the_deadline(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("frida_painter.hardware.drivers.interlock.PATIENCE", 0.3)
    monkeypatch.setattr("frida_painter.hardware.drivers.gcode.PATIENCE", 0.3)
    with FakeGrbl(misbehave={5: "mute"}) as machine:
        robot = robot_at(machine)
        robot.connect()
        with pytest.raises(RobotDisconnected, match="did not acknowledge in time"):
            robot.follow(a_stroke(speed=0.5))
        assert "!" in machine.received
        robot.close()


def test_an_alarm_is_never_cleared_by_the_program_and_a_person_can_start_anew() -> None:
    with FakeGrbl(misbehave={12: "alarm"}) as machine:
        robot = robot_at(machine)
        robot.connect()
        with pytest.raises(MotionFailed):
            robot.follow(a_stroke())
        with pytest.raises(RobotError, match=r"is not ready: it says 'Alarm'.*never clears an alarm"):
            robot.connect()
        assert not any(line.startswith("$") for line in machine.received)
        machine.state = "Idle"  # a person has cleared it
        robot.connect()
        assert robot.follow(a_stroke()).reached == pytest.approx(a_stroke().position[-1], abs=1e-5)
        robot.close()


def test_a_machine_locked_since_its_start_is_homed_only_where_that_is_allowed() -> None:
    with FakeGrbl(state="Alarm") as machine:
        with pytest.raises(RobotError, match="allow homing in its settings"):
            robot_at(machine).connect()
        assert machine.received == []
        robot = robot_at(machine, homing=True)
        robot.connect()
        assert machine.received[0] == "$H"
        robot.close()


def test_stop_holds_the_machine_within_a_tenth_of_a_second() -> None:
    with FakeGrbl(pace=1) as machine:
        robot = robot_at(machine)
        robot.connect()
        machine.place = a_stroke().position[0] * 1000
        told: list[Exception] = []

        def paint() -> None:
            try:
                robot.follow(a_stroke())
            except RobotError as error:
                told.append(error)

        thread = threading.Thread(target=paint)
        thread.start()
        while len(machine.moved) < 20:
            time.sleep(0.005)
        stopped = time.monotonic()
        robot.stop()
        robot.stop()
        returned = time.monotonic()
        thread.join(3)
        assert not thread.is_alive()
        assert returned - stopped < 0.05
        assert machine.at[-1] - stopped < 0.1
        assert isinstance(told[0], RobotStopped)
        machine.settle()
        assert machine.received[-1] == "reset"  # what was planned is forgotten
        with pytest.raises(RobotStopped, match="look at it"):
            robot.follow(a_stroke())
        robot.close()
        moved = len(machine.moved)
        robot.connect()
        time.sleep(0.05)
        assert len(machine.moved) == moved
        robot.close()


def test_a_stop_between_motions_is_kept() -> None:
    with FakeGrbl() as machine:
        robot = robot_at(machine)
        robot.connect()
        robot.stop()
        with pytest.raises(RobotStopped):
            robot.follow(a_stroke())
        robot.close()
        machine.settle()
        assert machine.received[-2:] == ["!", "reset"]
        assert machine.moved == []


@pytest.mark.parametrize("position", NOT_PATHS, ids=lambda position: str(position.shape))
def test_what_is_no_path_is_refused_before_a_line_is_sent(position: np.ndarray) -> None:
    with FakeGrbl() as machine:
        robot = robot_at(machine)
        robot.connect()
        sent = len(machine.received)
        with pytest.raises(MotionFailed, match="did not move"):
            robot.follow(Waypoints("stroke 1", position, 0.1))
        with pytest.raises(MotionFailed, match="speed of nan"):
            robot.follow(Waypoints("stroke 1", np.zeros((1, 3)), float("nan")))
        assert len(machine.received) == sent
        robot.follow(a_stroke())  # nothing went wrong with the machine
        robot.close()


def test_a_port_that_does_not_exist_lists_those_that_do(monkeypatch: pytest.MonkeyPatch) -> None:
    class Port:
        device, description = "/dev/ttyUSB3", "USB Serial"

    monkeypatch.setattr("serial.tools.list_ports.comports", lambda: [Port()])
    robot = GcodeRobot(GcodeSettings("/dev/ttyNOPE", HOME))
    with pytest.raises(RobotDisconnected, match=r"'/dev/ttyNOPE' cannot be opened .* There are: /dev/ttyUSB3 \(USB"):
        robot.connect()
    monkeypatch.setattr("serial.tools.list_ports.comports", list)
    with pytest.raises(RobotDisconnected, match="has no serial ports; plug"):
        robot.connect()
    robot.close()


def test_nobody_at_the_other_end_is_told_and_the_port_is_free_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("frida_painter.hardware.drivers.gcode.PATIENCE", 0.3)
    with FakeGrbl() as machine:
        machine._mute = True
        robot = robot_at(machine)
        with pytest.raises(RobotDisconnected, match="gave no report"):
            robot.connect()
        machine._mute = False
        robot.connect()
        robot.close()


@pytest.mark.parametrize(
    ("fault", "error", "says"),
    [
        ("always damage", RobotDisconnected, "damaged 3 times"),
        ("reset", MotionFailed, "was reset at waypoint 12"),
        ("kill", MotionFailed, r"failed at waypoint 12: 'Printer halted. kill\(\) called!'"),
    ],
)
def test_marlin_tells_what_goes_wrong(fault: str, error: type[RobotError], says: str) -> None:
    with FakeMarlin(misbehave={12: fault}) as machine:
        robot = robot_at(machine)
        robot.connect()
        with pytest.raises(error, match=says):
            robot.follow(a_stroke())
        time.sleep(0.05)
        assert machine.received[-1] == "M410"
        robot.close()


def test_a_line_that_marlin_got_damaged_is_sent_again() -> None:
    with FakeMarlin(misbehave={12: "damage"}) as machine:
        robot = robot_at(machine)
        robot.connect()
        report = robot.follow(a_stroke())
        robot.close()
    assert report.reached == pytest.approx(a_stroke().position[-1], abs=1e-5)
    motions = [line for line in machine.received if line.startswith("G1")]
    assert len(motions) == len(a_stroke().position)


def test_a_line_that_never_reached_marlin_ends_the_motion(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("frida_painter.hardware.drivers.interlock.PATIENCE", 0.2)
    with FakeMarlin(misbehave={12: "lose"}) as machine:
        robot = robot_at(machine)
        robot.connect()
        with pytest.raises(RobotDisconnected, match="a line was lost"):
            robot.follow(a_stroke())
        robot.close()


def test_a_servo_lifts_the_brush_and_its_height_is_reported() -> None:
    servo = Servo((-0.003, 100), (0.02, 900), speed=1.0)
    with FakeGrbl() as machine:
        robot = robot_at(machine, servo=servo)
        robot.connect()
        report = robot.follow(a_stroke())
        robot.close()
    assert report.reached == pytest.approx(a_stroke().position[-1], abs=1e-5)
    assert not any("Z" in line for line in machine.received)
    assert any(line == "M3 S900" for line in machine.received)
