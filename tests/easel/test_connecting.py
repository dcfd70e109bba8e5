"""A machine that forgot where it is: nothing moves before its zero is found again, in whatever way a person chooses."""

import socket
import threading
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from numpy.typing import NDArray

from frida_painter.easel.connecting import allow_motions, connect_easel, warn_of_places
from frida_painter.easel.connection import Host, Link, make_remote
from frida_painter.easel.dialogue import Answer, Confirm, Jog, JogMove, Question
from frida_painter.easel.guard import GuardedRobot
from frida_painter.easel.operator import AbsentOperator
from frida_painter.errors import Interrupted, ProcessLost, RobotError, WorkspaceViolation, ZeroUnknown
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.gateway import MotionLimits, RobotGateway
from frida_painter.hardware.latch import Unlatched
from frida_painter.hardware.robot import MotionReport, Waypoints, Zero
from frida_painter.hardware.timing import AxisTiming, TravelLimits
from frida_painter.system.messages import Wire
from support.easel import CALIBRATION, CANVAS, WORKSPACE, NotingRobot, PatientCamera

RESET = "its board was reset as the line was opened"
CORNER = np.array([*WORKSPACE.canvas_origin[:2], CALIBRATION.touch_height])


@dataclass
class ForgetfulRobot(NotingRobot):
    """Stands somewhere (`stands`, which only the test knows) and thinks that it stands at `stands` - `astray`."""

    stands: NDArray[np.float64] = field(default_factory=lambda: np.array([0.2, 0.1, 0.25]))
    off: NDArray[np.float64] = field(default_factory=lambda: np.array([0.03, -0.02, 0.05]))
    lost: str = RESET
    homes: bool = False
    steps: list[float] = field(default_factory=list)
    limits: AxisTiming | None = None
    travel: TravelLimits | None = None

    def travel_limits(self) -> TravelLimits | None:
        return self.travel

    def zero(self) -> Zero:
        return Zero(self.lost, self.homes)

    def find_zero(self) -> None:
        self.stands, self.off, self.lost = np.array([-0.2, -0.2, 0.3]), np.zeros(3), ""

    def jog(self, step: NDArray[np.float64]) -> None:
        self.steps.append(float(np.linalg.norm(step)))
        self.stands = self.stands + step

    def set_zero(self, tip: NDArray[np.float64]) -> None:
        self.off, self.lost = self.stands - tip, ""

    def pose(self) -> NDArray[np.float64]:
        return self.stands - self.off

    def follow(self, waypoints: Waypoints) -> MotionReport:
        self.stands = waypoints.position[-1] + self.off
        return super().follow(waypoints)

    def home(self) -> MotionReport:
        return self.follow(Waypoints("home", np.array([[0.0, 0.0, 0.3]]), 0.1))

    def timing(self) -> AxisTiming | None:
        return self.limits

    def alive_at(self) -> float:
        return -np.inf


def easel_with(robot: ForgetfulRobot) -> Easel:
    guarded = GuardedRobot(robot, MotionLimits(WORKSPACE), Unlatched("the easel"))
    return Easel(guarded, PatientCamera(), AbsentOperator(), WORKSPACE, CALIBRATION, CANVAS)


class Person:
    """Answers from a script: True, False, or the position to which the tip is led by eye."""

    def __init__(self, robot: ForgetfulRobot, *script: bool | NDArray[np.float64]) -> None:
        self.robot, self.script, self.asked, self.remarks = robot, list(script), list[str](), list[str]()
        self._jogging = 0

    def answer(self, question: Question) -> Answer:
        self.asked.append(question.text)
        if isinstance(question, Jog):
            self.remarks.append(question.remark)
            target = self.script[0]
            assert isinstance(target, np.ndarray)
            axes = {"Raise": 2, "Move it along x": 0, "Move it along y": 1, "Lower": 2}
            axis = next(axis for word, axis in axes.items() if word in question.text)
            wanted = 0.3 if "Raise" in question.text else target[axis]
            step = float(wanted - self.robot.stands[axis])
            if abs(step) < 1e-9:
                if "Lower" in question.text:
                    self.script.pop(0)
                return JogMove(settled=True)
            return JogMove(step)
        assert isinstance(question, Confirm)
        told = self.script.pop(0)
        assert isinstance(told, bool)
        return told


def tell_nobody(sentence: str) -> None:
    raise AssertionError(sentence)


def test_nothing_moves_while_the_zero_is_lost_and_the_sentence_says_what_to_do() -> None:
    robot = ForgetfulRobot()
    easel = easel_with(robot)
    easel.robot.connect()
    for act in (easel.robot.home, lambda: easel.robot.follow(Waypoints("stroke 1", np.array([[0, 0, 0.2]]), 0.1))):
        with pytest.raises(ZeroUnknown, match=r"nothing moves.*reset as the line was opened.*find its zero again"):
            act()
    assert robot.motions == []
    assert easel.robot.stopped is None, "nothing happened that a person must look at first"  # type: ignore[attr-defined]


def test_without_a_person_or_with_one_who_leaves_everything_stays_where_it_is() -> None:
    robot = ForgetfulRobot()

    def leave(question: Question) -> Answer:
        raise Interrupted("You left.")

    with pytest.raises(ZeroUnknown, match="nobody is there to find it again; start it in a terminal"):
        connect_easel(easel_with(robot), None, tell_nobody)
    with pytest.raises(Interrupted):
        connect_easel(easel_with(robot), leave, tell_nobody)
    assert robot.motions == [] and robot.steps == []


def test_a_person_jogs_to_the_corner_and_the_tip_is_where_it_says(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = ForgetfulRobot()
    person, jog = Person(robot, False, CORNER, True, True), robot.jog
    refusals = ["its servo reaches no higher."]

    def refuse_once(step: NDArray[np.float64]) -> None:
        if refusals:
            raise WorkspaceViolation(refusals.pop())
        jog(step)

    monkeypatch.setattr(robot, "jog", refuse_once)
    easel = connect_easel(easel_with(robot), person.answer, tell_nobody)
    assert "Not moved: its servo reaches no higher." in person.remarks and max(robot.steps) <= 0.02 + 1e-9
    np.testing.assert_allclose(robot.off, 0, atol=1e-9)
    (shown,) = [motion for motion in robot.motions if motion.label == "to the other corner"]
    there = WORKSPACE.to_canvas(shown.position[-1:])[0]
    np.testing.assert_allclose(there, (CANVAS.width, CANVAS.height), atol=1e-9)
    assert shown.position[:, 2].min() > CALIBRATION.touch_height + 0.02
    easel.robot.follow(Waypoints("stroke 1", np.array([[0.1, 0.1, 0.2]]), 0.1))
    np.testing.assert_allclose(robot.stands, (0.1, 0.1, 0.2))


def test_a_second_corner_that_is_not_there_makes_it_begin_again() -> None:
    robot = ForgetfulRobot()
    wrong = CORNER + np.array([0.01, 0, 0])
    person = Person(robot, False, wrong, True, False, True, CORNER, True, True)
    connect_easel(easel_with(robot), person.answer, tell_nobody)
    np.testing.assert_allclose(robot.off, 0, atol=1e-9)
    robot = ForgetfulRobot()
    with pytest.raises(ZeroUnknown):
        connect_easel(easel_with(robot), Person(robot, False, wrong, True, False, False).answer, tell_nobody)


def test_limit_switches_or_a_look_are_enough() -> None:
    robot = ForgetfulRobot(homes=True)
    person = Person(robot, True)
    connect_easel(easel_with(robot), person.answer, tell_nobody)
    assert robot.lost == "" and robot.steps == [] and "limit switches now" in person.asked[0]
    robot = ForgetfulRobot(off=np.zeros(3))
    person = Person(robot, True)
    connect_easel(easel_with(robot), person.answer, tell_nobody)
    assert "above lightest touch. Is it exactly there?" in person.asked[0] and robot.steps == []


def test_a_tip_outside_the_workspace_goes_back_if_a_person_allows_it_and_nothing_else_moves() -> None:
    """M25: a homed machine stands where its switches are. Up, across, then down."""
    outside = np.array([0.52, 0.1, 0.02])
    for answer in (None, lambda question: False):
        robot = ForgetfulRobot(stands=outside, off=np.zeros(3), lost="")
        with pytest.raises(WorkspaceViolation, match="outside the workspace"):
            connect_easel(easel_with(robot), answer, tell_nobody)
        assert robot.steps == [] and robot.motions == []
    easel = easel_with(robot)
    easel.robot.connect()
    for act in (easel.robot.home, lambda: easel.robot.follow(Waypoints("s", np.array([[0.1, 0.1, 0.2]]), 0.1))):
        with pytest.raises(WorkspaceViolation, match="jog it back"):
            act()
    with pytest.raises(WorkspaceViolation):
        easel.robot.jog(np.array([0.01, 0, 0]))  # farther away
    assert robot.steps == [] and robot.motions == []
    places = [outside]
    robot.jog = lambda step: (places.append(places[-1] + step), setattr(robot, "stands", places[-1]))  # type: ignore
    connect_easel(easel, allow_motions, tell_nobody)
    way = np.diff(places, axis=0)
    assert way[0, 2] > 0 and not way[0, :2].any() and places[-1] == pytest.approx((0.4998, 0.1, 0.0502))
    easel.robot.home()


def test_a_jog_is_short_and_stays_in_the_workspace_once_the_zero_is_known() -> None:
    robot = ForgetfulRobot(lost="", off=np.zeros(3))
    guard = GuardedRobot(robot, MotionLimits(WORKSPACE), Unlatched("the easel"))
    guard.connect()
    for step in (np.array([0.0, 0.0, 0.2]), np.array([np.nan, 0, 0]), np.zeros(2)):
        with pytest.raises(WorkspaceViolation, match="one step is at most 50 mm"):
            guard.jog(step)
    robot.stands = np.array([0.49, 0.0, 0.2])
    guard.connect()
    with pytest.raises(WorkspaceViolation, match=r"x = 0\.51"):
        guard.jog(np.array([0.02, 0.0, 0.0]))
    assert robot.steps == []
    guard.jog(np.array([-0.02, 0.0, 0.0]))
    assert robot.steps == [0.02]
    plain = GuardedRobot(NotingRobot(), MotionLimits(WORKSPACE), Unlatched("another"))
    with pytest.raises(RobotError, match="always knows where it is"):
        plain.set_zero(CORNER)


def test_a_robot_that_keeps_a_timing_of_its_own_is_asked_for_none() -> None:
    class Keeping(NotingRobot):
        timing = AxisTiming((0.1,) * 3, (0.01,) * 3, deviation=1e-5)

    here = Waypoints("here", np.array([[0.0, 0.0, 0.3]]), 0.1)
    guard = GuardedRobot(Keeping(motions=[here]), MotionLimits(WORKSPACE), Unlatched("the easel"))
    guard.connect()
    assert guard.timing() is None


def test_speeds_that_the_machine_cannot_do_are_told_before_anything_moves() -> None:
    limits = AxisTiming((0.5 / 60,) * 3, (0.01,) * 3, deviation=1e-5)
    robot = ForgetfulRobot(lost="", off=np.zeros(3), limits=limits)
    told: list[str] = []
    easel = connect_easel(easel_with(robot), None, told.append)
    assert easel.timing == limits and robot.motions == []
    assert len(told) == 2
    assert "painting speed of 60 mm/s: its controller allows 8.33 mm/s along x, 8.33 mm/s along y" in told[0]
    fast = replace(limits, speed=(1.0,) * 3)
    connect_easel(easel_with(ForgetfulRobot(lost="", off=np.zeros(3), limits=fast)), None, tell_nobody)


def test_places_beyond_the_machines_own_limits_are_told_and_motions_there_refused_before_anything_moves() -> None:
    robot, told = ForgetfulRobot(lost="", off=np.zeros(3)), list[str]()
    low, high = np.array(WORKSPACE.lower), np.array(WORKSPACE.upper)
    robot.travel = TravelLimits(tuple(low), tuple(high))
    connect_easel(easel_with(robot), None, tell_nobody)
    low[2] = CALIBRATION.press_height + 0.0005
    robot.travel = TravelLimits(tuple(low), tuple(high))
    easel = connect_easel(easel_with(robot), None, told.append)
    (sentence,) = told
    assert "The machine's own limits (z " in sentence and "do not include the canvas" in sentence
    deepest = easel.workspace.to_robot(np.array([[0.05, 0.05]]), np.array([CALIBRATION.press_height]))
    allowed = np.add(deepest, (0, 0, 0.001))
    with pytest.raises(WorkspaceViolation, match=r"stroke 2: z = .*the machine's own limits are .*Nothing was sent"):
        RobotGateway(easel).perform([Waypoints("stroke 1", allowed, 0.1), Waypoints("stroke 2", deepest, 0.1)])
    assert robot.motions == []
    RobotGateway(easel).perform([Waypoints("stroke 1", allowed, 0.1)])


def test_travel_that_is_too_short_is_told_while_the_zero_is_not_known() -> None:
    travel = TravelLimits((0.0, 0.0, 0.0), (0.1, 5.0, np.inf), zero_known=False)
    (sentence,) = warn_of_places(travel, WORKSPACE, CANVAS, CALIBRATION.press_height)
    assert "(x 100.0 mm of travel)" in sentence and "the canvas" in sentence
    wide = TravelLimits((0.0, 0.0, -np.inf), (5.0, 5.0, np.inf), zero_known=False)
    assert warn_of_places(wide, WORKSPACE, CANVAS, CALIBRATION.press_height) == []


@pytest.mark.parametrize("upper", [(0.3, 0.2, np.inf), None])
def test_the_limits_of_a_machine_come_through_the_link_as_they_are(upper: tuple[float, float, float] | None) -> None:
    robot = ForgetfulRobot(lost="")
    robot.travel = None if upper is None else TravelLimits((0.0, -0.1, -np.inf), upper, zero_known=False)
    ours, theirs = socket.socketpair()
    guarded = GuardedRobot(robot, MotionLimits(WORKSPACE), Unlatched("the easel"))

    def serve() -> None:
        with suppress(ProcessLost):
            Host({"robot": guarded}).serve(Wire(theirs))

    serving = threading.Thread(target=serve, daemon=True)
    serving.start()
    beats, its_beats = socket.socketpair()
    link = Link(Wire(ours), beats)
    away = make_remote("robot", link.call)
    away.connect()
    assert away.travel_limits() == robot.travel
    link.end(ask=False)
    serving.join(20)
    theirs.close()
    its_beats.close()
