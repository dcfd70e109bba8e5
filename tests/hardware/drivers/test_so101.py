"""The driver of the SO-101 against a bus of servos that is played from the protocol manual."""

import re
import time
import tomllib

import numpy as np
import pytest

pytest.importorskip("mujoco")
pytest.importorskip("mink")
pytest.importorskip("scservo_sdk")

from frida_painter.errors import MotionFailed, RobotDisconnected, RobotError, RobotStopped
from frida_painter.hardware.robot import LooseRobot, Reach, Waypoints
from frida_painter.hardware.workcell import WorkcellConfig, example
from frida_painter_cli.plan_output import _tell_play
from frida_painter_drivers.so101 import LIMITS, PLAY, So101Kinematics, So101Robot
from machines.arm_bench import so101_bus
from machines.simulated_time import SimulatedTime
from machines.sts_bus import BRUSH, StsBus, tips

HOME = (0.16, 0.0, 0.05)


@pytest.fixture
def bus(simulated_time: SimulatedTime, monkeypatch: pytest.MonkeyPatch) -> StsBus:
    return so101_bus(simulated_time, monkeypatch, np.array([0.18, 0.02, 0.06]))[0]


def connected(bus: StsBus) -> So101Robot:
    robot = So101Robot(bus.cable.name, HOME, brush_length=BRUSH)
    robot.connect()
    return robot


def a_stroke(speed: float = 0.05) -> Waypoints:
    along = np.linspace(0, 1, 31)
    path = np.c_[0.17 + 0.03 * along, 0.02 * np.sin(np.pi * along), 0.03 - 0.002 * np.sin(np.pi * along)]
    above = path[[0, -1]] + (0, 0, 0.01)
    return Waypoints("stroke 7", np.concatenate([above[:1], path, above[1:]]), speed)


@pytest.mark.parametrize("seed", range(8))
def test_the_chain_is_the_published_one(seed: int) -> None:
    joints = np.random.default_rng(seed).uniform(-1, 1, 5) * LIMITS
    tip, _ = So101Kinematics(BRUSH).tip(joints)
    assert tip == pytest.approx(tips(joints[None])[0], abs=5e-6)


def test_where_it_reaches_the_brush_is_upright_and_at_the_place() -> None:
    arm = So101Kinematics(BRUSH)
    places = np.stack(np.meshgrid((0.16, 0.2, 0.24), (-0.1, 0.0, 0.1), (0.0, 0.03)), -1).reshape(-1, 3)
    reached = arm.reachable(places)
    assert reached.sum() >= 12
    for place in places[reached]:
        joints = arm.start(place)
        tip, along = arm.tip(joints)
        assert tip == pytest.approx(place, abs=1e-4) and along[2] < -0.999
        assert (np.abs(joints) < LIMITS).all()
    assert not arm.reachable(np.array([[0.6, 0, 0.0], [0.02, 0, 0.0], [0.2, 0, 0.6]])).any()


def test_a_stop_does_not_wait_for_a_bus_that_hangs(bus: StsBus) -> None:
    robot = connected(bus)
    robot._line.acquire()  # a question that is never answered
    began = time.monotonic()
    robot.stop()
    assert time.monotonic() - began < 30
    with pytest.raises(RobotStopped):
        robot.follow(a_stroke())
    robot._line.release()


def test_goals_that_are_late_do_not_come_in_a_burst(bus: StsBus, simulated_time: SimulatedTime) -> None:
    robot = connected(bus)
    before, heard = bus.hear, []

    def hear(content: bytes) -> None:
        count = bus.goals
        before(content)
        if bus.goals > count:
            heard.append(simulated_time.now)

    bus.hear = hear  # type: ignore[method-assign]
    # The computer does something else for a second.
    simulated_time.after(0.5, lambda: setattr(simulated_time, "now", simulated_time.now + 1.0))
    robot.follow(a_stroke())
    apart = np.diff(heard)
    assert apart.max() >= 1.0
    assert apart[20:-5].min() > 0.01


def test_servos_that_lost_their_supply_are_noticed_before_the_next_motion(bus: StsBus) -> None:
    robot = connected(bus)
    robot.follow(a_stroke())
    bus.restart()
    places = len(bus.trace)
    with pytest.raises(MotionFailed, match=r"servo 1 \(shoulder_pan\) of .* is switched off: it was reset"):
        robot.follow(a_stroke())
    assert len(bus.trace) == places
    robot.connect()
    robot.home()


def test_a_servo_that_is_set_up_to_turn_less_far_is_told_before_anything_moves(bus: StsBus) -> None:
    bus.write(1, 9, 1900)
    bus.write(1, 11, 2200)
    robot = connected(bus)
    with pytest.raises(MotionFailed, match=r"shoulder_pan of .* set up for -13 to 13 .*registers 9 and 11.* not move"):
        robot.follow(Waypoints("aside", np.array([[0.15, -0.1, 0.03]]), 0.1))
    bus.write(3, 33, 1)
    with pytest.raises(RobotError, match=r"servo 3 \(elbow_flex\) .* is in mode 1, in which it turns without end"):
        robot.connect()


def test_what_the_bus_says_is_told_in_words(bus: StsBus) -> None:
    robot = connected(bus)
    bus.errors[3] = 32
    with pytest.raises(MotionFailed, match=r"servo 3 \(elbow_flex\) of .* reports that it is overloaded") as told:
        robot.follow(a_stroke())
    assert told.value.code == 32
    with pytest.raises(RobotError, match="does not move after its last fault"):
        robot.home()
    bus.errors.clear()
    robot.connect()
    bus.dead.add(2)
    with pytest.raises(RobotDisconnected, match=r"servo 2 \(shoulder_lift\) of .* did not answer"):
        robot.follow(a_stroke())
    with pytest.raises(RobotDisconnected, match="connect: servo 2"):
        robot.connect()
    bus.dead.clear()
    robot.connect()
    bus.stuck.add(1)
    with pytest.raises(MotionFailed, match=r"shoulder_pan of .* degrees from its goal"):
        robot.follow(Waypoints("far", np.array([[0.15, -0.1, 0.03]]), 0.1))
    robot.close()


def test_a_garbled_answer_is_asked_for_again(bus: StsBus) -> None:
    robot = connected(bus)
    before = robot.pose()
    bus.noise = b"\x00\xff\x13"
    assert np.array_equal(robot.pose(), before)
    robot.close()


def test_a_servo_of_another_kind_and_an_arm_out_of_its_middle_are_refused(bus: StsBus) -> None:
    bus.write(4, 3, 5)
    with pytest.raises(RobotError, match=r"servo 4 \(wrist_flex\) .* an STS3215 is 777"):
        connected(bus)
    bus.write(4, 3, 777)
    bus.write(1, 56, 0x8000 | 670)  # M40: bit 15 is the sign
    with pytest.raises(MotionFailed, match=r"shoulder_pan .* stands at -239 degrees"):
        connected(bus)
    bus.write(1, 56, 4000)
    with pytest.raises(MotionFailed, match=r"shoulder_pan .* stands at 172 degrees and reaches 110"):
        connected(bus)
    assert not any(registers[40] for registers in bus.registers.values()), "no servo was switched on"


def test_what_is_out_of_reach_is_refused_before_anything_moves(bus: StsBus) -> None:
    robot = connected(bus)
    assert isinstance(robot, Reach) and isinstance(robot, LooseRobot)
    with pytest.raises(MotionFailed, match="did not move"):
        robot.follow(Waypoints("stroke 1", np.array([[0.5, 0.0, 0.0]]), 0.1))
    assert len(bus.trace) == 1
    robot.close()


def test_the_gripper_goes_on_holding_the_brush(bus: StsBus) -> None:
    """M31: the sixth servo is powered where it stands; an arm without it is told so."""
    robot = connected(bus)
    assert bus.registers[6][40] == 1
    robot.follow(a_stroke())
    assert bus.grip == 2100
    bus.registers[6][40] = 0
    with pytest.raises(MotionFailed, match=r"servo 6 \(gripper\) of .* is switched off"):
        robot.follow(a_stroke())
    told = " ".join(fact.text for fact in robot.examine().facts)
    assert "50 mm beyond the fingertips of its fixed jaw" in told and "gripper: load" in told
    bus.dead.add(6)
    assert any("No gripper answers" in fact.text and fact.weight == "warning" for fact in robot.examine().facts)
    robot.connect()
    robot.follow(a_stroke())


def test_a_degree_of_play_is_told_in_millimetres(bus: StsBus) -> None:
    robot = So101Robot(bus.cable.name, HOME, brush_length=BRUSH)
    place = np.array([0.2, 0.0, 0.03])
    arm = So101Kinematics(BRUSH)
    joints = arm.start(place)
    assert joints is not None
    chance = np.random.default_rng(0).uniform(-PLAY / 2, PLAY / 2, (1000, 5))
    off = [np.linalg.norm(one - tips(joints[None])[0]) for one in tips(joints + chance)]
    told = float(robot.play(place[None])[0])
    assert np.percentile(off, 50) < told < 1.3 * max(off)
    assert np.isnan(robot.play(np.array([[0.6, 0.0, 0.0]]))[0])
    text = " ".join(fact.text for fact in robot.examine().facts)
    assert "Gears with a degree of play" in text and "elbow_flex" in text


def test_a_check_of_a_plan_tells_the_play(capsys: pytest.CaptureFixture[str]) -> None:
    values = tomllib.loads(example())
    values["canvas"].update(width=0.1, height=0.08, corner=[0.14, -0.04, 0.12], turn=0.0)
    values["bounds"].update(lower=[0.0, -0.3, -0.05], upper=[0.7, 0.28, 0.3])
    values["canvas"]["corner"][2] = values["brush"]["touch_height"] = 0.02
    values["brush"]["press_height"], values["paint"]["wells"] = 0.015, [[0.32, -0.2, 0.118]]
    values["motion"]["home"] = [0.1, -0.25, 0.25]
    workcell = WorkcellConfig.of(values, "easel.toml")
    _tell_play(So101Robot("/dev/null", HOME, brush_length=BRUSH), workcell)
    assert re.search(r"play of its gears lets the tip be up to [345]\.\d mm off", capsys.readouterr().out)
