"""Every method of a robot and a camera, misbehaving in every way, in every state: an error with a name, no motion."""

import math
import random
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from pathlib import Path
from types import NoneType

import numpy as np
import pytest

from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.connection import requests
from frida_painter.easel.guard import GuardedCamera, GuardedRobot
from frida_painter.errors import (
    CameraError,
    FridaError,
    MotionFailed,
    PoseMismatch,
    RobotBusy,
    RobotDisconnected,
    RobotError,
    RobotStopped,
    WorkspaceViolation,
)
from frida_painter.hardware import deadline
from frida_painter.hardware.faults import FailedMotion, Faults
from frida_painter.hardware.gateway import MotionLimits
from frida_painter.hardware.latch import Latch, Unlatched
from frida_painter.hardware.robot import BrushRack, Frame, MotionReport, Robot, Waypoints
from frida_painter.hardware.timing import AxisTiming
from frida_painter.system.messages import decode_error, encode_error
from frida_painter.virtual.studio import StudioSettings, open_studio
from hardware.misbehaving import Action, Hang, MisbehavingCamera, MisbehavingRobot, fine, unknown, vendor_error
from support.easel import WORKSPACE

ABOVE = Waypoints("stroke 7", np.array([[0.0, 0.0, 0.2], [0.1, 0.0, 0.2]]), 0.25)
NONSENSE = {
    "follow": [
        None, "done", MotionReport("x", 0.0, 1.0, np.array([0.0, np.nan, 0.0])),
        MotionReport("x", 2.0, 1.0, np.zeros(3)), MotionReport("x", 0.0, float("nan"), np.zeros(3)),
        MotionReport("x", 0.0, 1.0, np.zeros(2)),
    ],
    "home": [None, 0, MotionReport("x", 0.0, 1.0, np.full(3, np.inf))],
    "pose": [None, np.zeros(2), np.full(3, np.nan), "here", np.array(["a", "b", "c"])],
}  # fmt: skip


WAYS: dict[str, Action] = {"vendor error": vendor_error, "unknown": unknown, "nonsense": fine}


def guarded(robot: Robot, folder: Path, **patiently: float) -> GuardedRobot:
    hangs = isinstance(getattr(robot, "action", None), Hang)  # only then is a deadline waited for
    seconds = 0.5 if hangs else 30.0
    quick = {"patience": seconds, "grace": seconds, "connecting": seconds, **patiently}
    return GuardedRobot(robot, MotionLimits(WORKSPACE), Latch(folder / "stopped.json", "the arm"), **quick)


class Numbered(MisbehavingRobot):
    """One whose controller says which it is."""

    serial_number = "XA-7"


def test_a_robot_that_says_which_one_it_is_stays_stopped_under_a_new_address(tmp_path: Path) -> None:
    """B1, B2: what the controller says of itself counts, whatever address it was found at."""
    Latch(tmp_path / "old.json", "left", {"10.0.0.3", "serial number XA-7"}).engage("a child ran by")
    claimed: list[str] = []
    robot = Numbered("", fine)
    guard = GuardedRobot(
        robot, MotionLimits(WORKSPACE), Latch(tmp_path / "new.json", "right", {"10.0.0.9"}), claim=claimed.append
    )
    assert guard.stopped is None, "nobody can know before it was asked"
    with pytest.raises(RobotStopped, match=r"left was stopped.*a child ran by"):
        guard.connect()
    assert claimed == ["serial number XA-7"]
    with pytest.raises(RobotStopped):
        guard.follow(ABOVE)

    def taken(identity: str) -> None:
        raise RobotBusy(f"{identity} is in use", 7)

    guard = GuardedRobot(
        Numbered("", fine), MotionLimits(WORKSPACE), Latch(tmp_path / "a.json", "a", {"10.0.0.9"}), claim=taken
    )
    with pytest.raises(RobotBusy, match="XA-7 is in use"):
        guard.connect()


def in_state(state: str, robot: MisbehavingRobot, folder: Path) -> GuardedRobot:
    """A guard over the robot, which behaves well until it is in that state."""
    bad, robot.bad = robot.bad, ""
    guard = guarded(robot, folder)
    if state != "fresh":
        guard.connect()
    if state == "moved":
        guard.follow(ABOVE)
    robot.bad = bad
    return guard


@pytest.fixture
def hang() -> Iterator[Hang]:
    hanging = Hang()
    yield hanging
    hanging.released.set()


@pytest.mark.parametrize("state", ["connected", "moved"])
@pytest.mark.parametrize("method", ["home", "follow"])
@pytest.mark.parametrize("way", ["vendor error", "unknown", "hang", "nonsense"])
def test_a_motion_that_goes_wrong_is_the_last(state: str, method: str, way: str, hang: Hang, tmp_path: Path) -> None:
    for number, garbage in enumerate(NONSENSE[method] if way == "nonsense" else [None]):
        robot = MisbehavingRobot(method, WAYS.get(way, hang), garbage)
        guard = in_state(state, robot, tmp_path / str(number))
        with pytest.raises(RobotError) as fault:
            guard.home() if method == "home" else guard.follow(ABOVE)
        assert isinstance(fault.value, RobotDisconnected) == (way == "hang")
        assert ("home" if method == "home" else "stroke 7") in str(fault.value)
        assert robot.stops == 1 and guard.stopped is not None, "whatever it was, the robot was told to stop"
        moved = len(robot.motions)
        robot.bad = ""
        for again in (guard.home, lambda guard=guard: guard.follow(ABOVE), guard.connect):
            with pytest.raises(RobotStopped, match="frida-painter arm"):
                again()
        assert len(robot.motions) == moved
        guard.close()
        assert Latch(tmp_path / str(number) / "stopped.json", "the arm").read() is not None
        hang.released.set()


@pytest.mark.parametrize("state", ["fresh", "connected", "moved"])
@pytest.mark.parametrize(
    ("method", "way"),  # what connect returns is nobody's business
    [*product(["connect", "pose"], ["vendor error", "unknown", "hang"]), ("pose", "nonsense")],
)
def test_whatever_else_goes_wrong_has_a_name_and_moves_nothing(
    state: str, method: str, way: str, hang: Hang, tmp_path: Path
) -> None:
    for garbage in NONSENSE["pose"] if way == "nonsense" else [None]:
        robot = MisbehavingRobot(method, WAYS.get(way, hang), garbage)
        guard = in_state(state, robot, tmp_path)
        moved = len(robot.motions)
        with pytest.raises(RobotError) as fault:
            guard.connect() if method == "connect" else guard.pose()
        assert isinstance(fault.value, RobotDisconnected) == (way == "hang")
        assert len(robot.motions) == moved
        guard.close()
        hang.released.set()


@pytest.mark.parametrize("action", ["vendor error", "hang"])
@pytest.mark.parametrize("method", ["stop", "close"])
def test_a_stop_and_an_end_that_fail_still_hold(method: str, action: str, hang: Hang, tmp_path: Path) -> None:
    robot = MisbehavingRobot(method, vendor_error if action == "vendor error" else hang)
    guard = in_state("moved", robot, tmp_path)
    began = time.monotonic()
    guard.stop("a person said so")
    guard.close()
    assert time.monotonic() - began < 3
    with pytest.raises(RobotStopped, match="a person said so"):
        guard.follow(ABOVE)
    assert len(robot.motions) == 1


@pytest.mark.parametrize("asked", [True, False])
def test_a_stop_in_the_middle_of_a_dip_is_told_as_what_it_was(tmp_path: Path, asked: bool) -> None:
    """Fault F8: a stop is pressed. A person's own stop is no fault, and the first stop is the one that counts."""
    robot = MisbehavingRobot()
    guard = in_state("connected", robot, tmp_path)

    def dip() -> None:
        guard.stop("the stop file stop appeared", asked=asked)
        guard.stop("and another one", asked=not asked)
        raise MotionFailed("dip: the virtual robot was stopped on its way.")

    robot.bad, robot.action = "follow", dip
    with pytest.raises(RobotStopped, match="the stop file stop appeared") as told:
        guard.follow(ABOVE)
    again = decode_error(encode_error(told.value), RobotError)
    assert isinstance(again, RobotStopped) and str(again) == str(told.value)
    assert told.value.asked is again.asked is asked
    with pytest.raises(RobotStopped):
        guard.home()
    guard.close()
    with pytest.raises(RobotStopped) as later:
        guarded(MisbehavingRobot(), tmp_path).connect()
    assert not later.value.asked, "whoever starts again has to look first"


def test_a_stop_latches_before_any_disk_has_answered_and_survives_a_restart(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    slow = threading.Event()
    robot = MisbehavingRobot()
    guard = in_state("moved", robot, tmp_path)
    engage, stored = Latch.engage, list[str]()
    monkeypatch.setattr(
        Latch, "engage", lambda latch, reason: (slow.wait(60), stored.append(reason), engage(latch, reason))[2]
    )
    guard.stop("the tray fell")
    assert robot.stops == 1 and not stored
    with pytest.raises(RobotStopped, match="the tray fell"):
        guard.home()
    slow.set()
    guard.close()
    restarted = guarded(MisbehavingRobot(), tmp_path)
    for action in (restarted.connect, restarted.home, lambda: restarted.follow(ABOVE)):
        with pytest.raises(RobotStopped, match=r"the tray fell.*frida-painter arm"):
            action()
    restarted.latch.release()
    armed = guarded(MisbehavingRobot(), tmp_path)
    armed.connect()
    assert armed.home().label == "home"


@pytest.mark.parametrize("tip", [(0.0, 0.0, 1.0), (9.0, 0.0, 0.2), (0.0, 0.0, 0.0)])
def test_a_robot_that_stands_outside_the_workspace_is_not_painted_with(
    tip: tuple[float, float, float], tmp_path: Path
) -> None:
    """Fault F20: the robot starts outside the workspace or at an unknown position."""
    robot = MisbehavingRobot("pose", fine, np.array(tip))
    guard = guarded(robot, tmp_path)
    with pytest.raises(WorkspaceViolation, match="guide it into the workspace by hand"):
        guard.connect()
    assert robot.motions == [] and guard.stopped is None


def test_a_robot_that_does_not_know_where_it_is_is_not_painted_with(tmp_path: Path) -> None:
    """Fault F20: the robot starts outside the workspace or at an unknown position."""
    studio = open_studio(CanvasSize(0.12, 0.09), "fine", faults=Faults(unknown_pose=True))
    guard = GuardedRobot(studio.easel.robot, MotionLimits(studio.easel.workspace), Latch(tmp_path / "latch", "studio"))
    with pytest.raises(RobotError, match="does not know where its tip is"):
        guard.connect()
    assert studio.robot.motions == 0


@pytest.mark.parametrize(
    ("height", "rack", "lifted"),
    [
        (0.095, None, 0.13),
        (0.114, None, 0.13),
        (0.116, None, None),
        (0.14, BrushRack({"fine": (0.4, -0.2, 0.1)}, (0.0, 0.06), 0.05), 0.18),  # a hand was left among its brushes
    ],
)
def test_a_brush_that_was_left_low_is_lifted_first_and_straight_up(
    height: float, rack: BrushRack | None, lifted: float | None, tmp_path: Path
) -> None:
    """Fault F1: the painting process is killed."""
    robot = MisbehavingRobot("pose", fine, np.array([0.1, 0.1, height]))
    guard = guarded(robot, tmp_path)
    guard.workspace = replace(WORKSPACE, rack=rack)
    guard.connect()
    robot.bad = ""
    guard.follow(ABOVE)
    guard.follow(ABOVE)
    assert robot.calls == [*(["lift"] if lifted else []), "stroke 7", "stroke 7"]
    if lifted:
        assert robot.motions[0].position.tolist() == [[0.1, 0.1, pytest.approx(lifted)]]


@pytest.mark.parametrize(
    "position", [[[0.0, 0.0, np.nan]], [[0.0, 0.0, 200.0]], [[0.0, 0.0, 0.0]], [[np.inf, 0.0, 0.2]]]
)
def test_the_easels_process_checks_once_more(position: list[list[float]], tmp_path: Path) -> None:
    """Fault F19: a waypoint outside the workspace or not a number."""
    robot = MisbehavingRobot()
    guard = in_state("connected", robot, tmp_path)
    with pytest.raises(WorkspaceViolation, match="stroke 9"):
        guard.follow(Waypoints("stroke 9", np.array(position), 0.1))
    assert robot.motions == [] and guard.stopped is None, "nothing has moved, and nothing has to be re-armed"


def test_a_computer_that_slept_in_the_middle_of_a_motion_gives_it_up(
    tmp_path: Path, hang: Hang, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Fault F31: the clock jumps or the computer sleeps.

    The clock that counts goes on while the computer sleeps; the one on the wall may say what it likes.
    """
    robot = MisbehavingRobot("follow", hang)
    guard = in_state("connected", robot, tmp_path)
    guard._patience = guard._grace = 100.0
    slept = threading.Event()
    really = deadline.steady

    def after_sleep() -> float:
        return really() + (600.0 if slept.is_set() else 0.0)

    monkeypatch.setattr(deadline, "steady", after_sleep)
    monkeypatch.setattr("frida_painter.easel.guard.steady", after_sleep)
    monkeypatch.setattr(time, "time", lambda: 0.0)
    threading.Timer(0.1, slept.set).start()
    began = really()
    with pytest.raises(RobotDisconnected, match="did not come back"):
        guard.follow(ABOVE)
    assert really() - began < 10 and robot.stops == 1
    with pytest.raises(RobotStopped):
        guard.follow(ABOVE)
    assert len(robot.motions) == 1, "no burst of what had queued up"


FAULTS = {
    "F15": (Faults(failed_motions=(FailedMotion(1, 1, 31),)), MotionFailed, "error 31 at waypoint 1"),
    "F18": (Faults(protective_stops=frozenset({1})), RobotStopped, "met with resistance"),
    "F14": (Faults(dead_from_motion=1), RobotDisconnected, "does not answer"),
    "F17": (Faults(lying_motions=frozenset({1})), PoseMismatch, "mm from where it says"),
}


@pytest.mark.parametrize("row", FAULTS)
def test_a_virtual_robot_that_fails_is_told_of_and_stopped(row: str, tmp_path: Path) -> None:
    faults, kind, says = FAULTS[row]
    studio = open_studio(CanvasSize(0.12, 0.09), "fine", faults=faults)
    x, y, z = studio.easel.workspace.water
    path = Waypoints("stroke 3", np.array([[x, y, z + 0.03], [x + 0.03, y, z + 0.03], [x + 0.06, y, z + 0.03]]), 0.1)
    guard = GuardedRobot(studio.easel.robot, MotionLimits(studio.easel.workspace), Latch(tmp_path / "latch", "studio"))
    guard.connect()
    guard.follow(path)
    with pytest.raises(kind, match=says) as fault:
        guard.follow(path)
    if isinstance(fault.value, MotionFailed):
        assert (fault.value.code, fault.value.waypoint) == (31, 1)
    if row == "F17":  # nothing to free: a calibration to repeat
        assert guard.stopped is None
        return
    begun = studio.robot.motions
    with pytest.raises(RobotStopped):
        guard.home()
    assert studio.robot.motions == begun
    guard.close()
    assert Latch(tmp_path / "latch", "studio").read() is not None


def test_whenever_and_however_often_it_is_stopped_nothing_moves_afterwards(tmp_path: Path) -> None:
    """Fault F10: stops at any moment, twice, and while stopping.

    100 stops at random moments of a motion that would take 3 s, half of them twice or once more afterwards.
    """
    chance = random.Random(7)
    studio = open_studio(CanvasSize(0.12, 0.09), "fine", settings=StudioSettings(pace=0.1))
    walked: list[dict] = []
    studio.table.note = lambda entry, flush: walked.append(entry)
    robot, home = studio.robot, studio.robot._home
    path = np.stack([home, home + np.array([0.3, 0, 0])])
    latencies, ways = [], []
    for trial in range(100):
        robot.rearm()
        robot._tip = home.copy()
        guard = GuardedRobot(robot, MotionLimits(studio.easel.workspace), Latch(tmp_path / "latch", "studio"))
        guard.connect()
        stops: list[float] = []

        def stop(guard: GuardedRobot = guard, stops: list[float] = stops) -> None:
            stops.append(time.monotonic())
            guard.stop("now")

        timers = [threading.Timer(chance.uniform(0, 0.012), stop) for _ in range(1 + trial % 2)]
        for timer in timers:
            timer.start()
        done, began = len(walked), time.monotonic()
        with pytest.raises(RobotStopped):
            guard.follow(Waypoints("stroke 1", path, 0.01))
        ended = time.monotonic()
        if trial % 4 == 0:  # and once more from where a stop is dealt with
            guard.stop("again")
        for timer in timers:
            timer.join()
        with pytest.raises(RobotStopped):
            guard.follow(Waypoints("stroke 2", path, 0.01))
        assert len(walked) - done <= 1
        steps = np.diff(np.array(walked[-1]["path"]), axis=0) if walked[done:] else np.zeros((1, 3))
        ways.append(float(np.linalg.norm(steps, axis=1).sum()))
        latencies.append(ended - max(began, min(stops)))
        guard.close()
        guard.latch.release()  # type: ignore[union-attr]
    # A busy computer holds one or the other up; whatever queued would hold up all.
    assert np.quantile(latencies, 0.9) <= 0.1
    assert np.quantile(ways, 0.9) < 0.015, "of 0.3 m"


@pytest.mark.parametrize(
    ("method", "way"),  # what the others return is nobody's business
    [*product(["connect", "capture", "close"], ["vendor error", "unknown", "hang"]), ("capture", "nonsense")],
)
def test_a_camera_that_goes_wrong_has_a_sentence_for_it(method: str, way: str, hang: Hang) -> None:
    picture = np.zeros((4, 5, 3), np.uint8)
    frame = Frame(picture, 1.0, 3)
    nonsense = [
        None, b"jpeg", replace(frame, image=picture[..., 0]), replace(frame, image=picture.astype(float)),
        replace(frame, image=picture[:0]), replace(frame, captured_at=float("nan")), replace(frame, sequence=None),
    ]  # fmt: skip
    for garbage in nonsense if way == "nonsense" else [None]:
        camera = MisbehavingCamera(method, WAYS.get(way, hang), garbage)
        guard = GuardedCamera(camera, patience=0.05)
        with pytest.raises(CameraError):
            {"connect": guard.connect, "capture": lambda guard=guard: guard.capture(0.0), "close": guard.close}[
                method
            ]()
        hang.released.set()
        camera.bad = ""
        deadline = time.monotonic() + 5
        while True:  # once its call has come back a camera may be asked again: a photograph harms nobody
            try:
                assert guard.capture(0.0).sequence >= 1
                break
            except FridaError:
                assert time.monotonic() < deadline
        guard.close()


class Feeling(MisbehavingRobot):
    """One that feels a table at 0.15 m, and says where its tip is."""

    def __init__(self, start: float = 0.2) -> None:
        super().__init__("", fine)
        self.tip = np.array([0.0, 0.0, start])
        self.asked: list[float] = []

    def pose(self) -> np.ndarray:
        return self.tip.copy()

    def feels(self) -> str:
        return "force"

    def touch(self, lowest: float, speed: float) -> MotionReport:
        self.asked.append(lowest)
        self.tip[2] = max(lowest, 0.15)
        return MotionReport("touch", 0.0, 1.0, self.tip.copy())


def test_whatever_may_move_or_change_a_robot_has_a_guard_of_its_own() -> None:
    """The methods that are made from the protocols only ask the driver; they know neither stop nor limits."""
    for name, request in requests("robot").items():
        only_asks = request.types["return"] not in (NoneType, MotionReport)
        assert only_asks or getattr(GuardedRobot, name).__qualname__ == f"GuardedRobot.{name}", name


def test_a_touch_is_felt_within_the_workspace_and_nowhere_else(tmp_path: Path) -> None:
    robot = Feeling()
    guard = guarded(robot, tmp_path)
    guard.connect()
    assert guard.feels() == "force"
    assert guard.touch(0.12, 0.01).reached[2] == 0.15
    for lowest in (-5.0, float("nan")):
        with pytest.raises(WorkspaceViolation):
            guard.touch(lowest, 0.01)
    with pytest.raises(WorkspaceViolation, match="raise the brush first"):
        guard.touch(0.19, 0.01)
    assert robot.asked == [0.12] and guard.stopped is None
    deaf = guarded(MisbehavingRobot("", fine), tmp_path)
    deaf.connect()
    with pytest.raises(RobotError, match="cannot feel a touch"):
        deaf.touch(0.15, 0.01)
    assert deaf.feels() is None and deaf.stopped is None


@pytest.mark.parametrize("method", ["connect", "pose", "follow", "home"])
def test_an_answer_that_takes_its_time_is_waited_for(method: str, tmp_path: Path) -> None:
    guard = guarded(MisbehavingRobot(method, lambda: time.sleep(0.1)), tmp_path)
    guard.connect()
    guard.follow(ABOVE)
    assert guard.home().label == "home" and guard.stopped is None


def test_a_motion_is_promised_before_it_begins(tmp_path: Path) -> None:
    """Whoever waits in another process knows by then how long it may take, also if a person may hold the machine."""

    class Told(MisbehavingRobot):
        def timing(self) -> AxisTiming | None:
            return AxisTiming((0.01,) * 3, (1.0,) * 3)

        def alive_at(self) -> float:
            return -math.inf

    for robot, least in ((MisbehavingRobot(), 2 * 0.316 / 0.25 + 15), (Told(), 2 * 0.1 / 0.01 + 3600)):
        promised: list[float] = []
        guard = GuardedRobot(robot, MotionLimits(WORKSPACE), Unlatched("the arm"), promise=promised.append)
        guard.connect()
        guard.follow(ABOVE)
        assert len(promised) == 1 and least - 2 < promised[0] < least + 40
