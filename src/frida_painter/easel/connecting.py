"""Examination, connection and guiding of a machine before a painting; a lost zero is found again."""

import math
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.dialogue import Answer, Confirm, Jog, JogMove, Procedure, Question, lead
from frida_painter.easel.guard import STANDS
from frida_painter.easel.kinds import state_folder
from frida_painter.easel.open import hold_machines, identities, make_robot
from frida_painter.errors import (
    ConfigError,
    RobotDisconnected,
    RobotError,
    RobotStopped,
    WorkspaceViolation,
    ZeroUnknown,
)
from frida_painter.hardware.deadline import in_our_errors, within
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.gateway import RobotGateway
from frida_painter.hardware.latch import HOW_TO_ARM, latch_of, shared_folder, why_private
from frida_painter.hardware.motion import Motion
from frida_painter.hardware.robot import (
    Examination,
    ExaminedRobot,
    GuidedRobot,
    LimitedRobot,
    MachineFact,
    TimedRobot,
    Waypoints,
    Workspace,
    ZeroedRobot,
)
from frida_painter.hardware.timing import AxisTiming, TravelLimits
from frida_painter.hardware.workcell import WorkcellConfig

_MAX_STEP = 0.02  # metres of a jog
_INSIDE = 2e-4  # metres from the edge of a workspace that is entered
_ROOM = 2.0  # metres that a person may jog along one axis, in all
_PATIENCE = 20.0  # seconds: an examination takes ten, and a driver may hang
_SLOWER = 0.95  # share of the wanted speed below which a person is told
GUIDED_RATE = 50
"""Samples of a guided tip per second, at most."""
_LONGEST = 3600.0  # seconds that an arm is guided


def connect_easel(easel: Easel, answer: Callable[[Question], Answer] | None, tell: Callable[[str], None]) -> Easel:
    """Connects robot and camera, and returns the easel with the limits that the robot's controller told.

    answer: asks a person, who finds the zero again if the machine lost it; None if nobody is there
    tell: receives a sentence about each speed of the workspace that the machine cannot do, about each place that is
        beyond its own limits, and about stops that other users of this computer do not see

    Raises ZeroUnknown if the zero is lost and nobody finds it. Raises RobotError, CameraError and their subclasses.
    """
    robot = easel.robot
    shared = None if easel.simulated else shared_folder()
    if shared is not None and (why := why_private(shared)) is not None:
        tell(
            f"A stop holds this robot for you alone, because {why}; if others use this computer too: sudo install -d "
            f"-m 1777 {shared}"
        )
    robot.connect()
    if isinstance(robot, ZeroedRobot) and not (zero := robot.zero()).known:
        if answer is None:
            raise _refusal(zero.lost, "nobody is there to find it again; start it in a terminal or in the studio")
        lead(find_zero(easel, robot), answer)
    if isinstance(robot, ZeroedRobot):
        lead(enter_workspace(easel, robot), answer or _allow_nothing)
    warnings: list[str] = []
    if isinstance(robot, TimedRobot) and (timing := robot.timing()) is not None:
        easel = replace(easel, timing=timing)
        warnings += warn_of_speeds(timing, easel.workspace)
    if isinstance(robot, LimitedRobot) and (travel := robot.travel_limits()) is not None:
        warnings += warn_of_places(travel, easel.workspace, easel.canvas, easel.calibration.press_height)
    for sentence in warnings:
        tell(sentence)
    easel.camera.connect()
    return easel


def allow_motions(question: Question) -> bool:
    """Answers for a person who allowed motions before (--yes) and is not there. Raises ZeroUnknown if asked more."""
    if isinstance(question, Confirm) and question.moves:
        return True
    raise _refusal("nobody is there to find it", "start it without --yes in a terminal, or in the studio")


def _allow_nothing(question: Question) -> bool:
    raise WorkspaceViolation("The tip stands outside the workspace, and nobody is there to let it go back.")


def examine_robot(name: str, workspace: Workspace, *, compare: bool = True) -> Examination | None:
    """Returns what the controller of a named robot tells, without motion; None if its driver has no examination.

    workspace: of the machine; a driver needs one
    compare: True to add a warning for each speed of the workspace that the machine cannot do

    Raises ConfigError if the name is wrong, RobotBusy if another process uses the robot, RobotError if nobody answers.
    """
    driver = make_robot(name, workspace)
    if not isinstance(driver, ExaminedRobot):
        return None
    with ExitStack() as stack:
        hold_machines(stack, state_folder(), identities(name))
        found = in_our_errors(
            lambda: within(_PATIENCE, name, driver.examine),
            late=lambda: RobotDisconnected(
                f"{name[:60]} did not finish its answers in {_PATIENCE:.0f} s; look at it and at its cable."
            ),
            failed=lambda why: RobotError(f"The examination of {name[:60]} failed ({why}); look at the robot."),
        )
    if not compare or found.timing is None:
        return found
    slow = (MachineFact(sentence, "warning") for sentence in warn_of_speeds(found.timing, workspace))
    return replace(found, facts=(*found.facts, *slow))


def guide_arm(
    name: str,
    workcell: WorkcellConfig,
    hear: Callable[[NDArray[np.float64], float], None],
    ended: Callable[[], bool],
) -> None:
    """Releases a named arm for a person's hand, and tells where its tip is until `ended`, or for an hour.

    hear: receives the tip [3] in metres of the robot's frame, and the seconds since the release

    The arm holds its place afterwards, also after an error, and is stopped until a person arms it. The stop is stored
    before the arm is released, so that it holds even if this process is killed in between.
    Raises ConfigError if the robot cannot be guided, RobotBusy if another process uses it, RobotStopped if it is
    stopped, RobotError and its subclasses.
    """
    driver = make_robot(name, workcell.workspace)
    if not isinstance(driver, GuidedRobot):
        raise ConfigError(
            f"{name[:60]!r} cannot be guided by hand; xarm and franka can. Of another robot, record trajectories into "
            "a folder of .json or .csv files, and teach that folder."
        )
    state, known = state_folder(), identities(name)
    with ExitStack() as stack:
        hold_machines(stack, state, known)
        latch = latch_of(state, workcell.easel, known)
        if (stopped := latch.read()) is not None:
            raise RobotStopped(f"{stopped}. It is not released before somebody has looked: {HOW_TO_ARM}")
        latch.engage("it was released to be guided by hand")
        stack.callback(driver.end_guiding)
        driver.begin_guiding()
        began, now, due = time.monotonic(), 0.0, 0.0
        while now < _LONGEST:
            hear(driver.guided_tip(), now)
            if ended():
                return
            due = max(due + 1 / GUIDED_RATE, now)
            now = time.monotonic() - began
            time.sleep(max(0.0, due - now))
            now = time.monotonic() - began


def warn_of_speeds(timing: AxisTiming, workspace: Workspace) -> list[str]:
    """Returns a sentence for each speed of the workspace that the machine does not reach along x, y or z."""
    found = []
    for name, speed in (("painting", workspace.painting_speed), ("travel", workspace.travel_speed)):
        reached = timing.limit_speeds(np.eye(3), np.full(3, speed))
        slow = [f"{1000 * most:.3g} mm/s along {axis}" for axis, most in zip("xyz", reached, strict=True)
                if most < _SLOWER * speed]  # fmt: skip
        if slow:
            found.append(
                f"The machine cannot do the {name} speed of {1000 * speed:g} mm/s: its controller allows "
                f"{', '.join(slow)}, and that is what it will do."
            )
    return found


def warn_of_places(travel: TravelLimits, workspace: Workspace, canvas: CanvasSize, lowest: float) -> list[str]:
    """Returns a sentence if a machine's own limits do not include some places of the workspace.

    lowest: robot z of the hardest press on the canvas, metres
    """
    heights = lowest, workspace.top + workspace.hover
    places: dict[str, NDArray[np.float64]] = {
        "the canvas": np.array([(x, y, z) for x, y, _ in workspace.corners(canvas).values() for z in heights]),
        **{f"well {number}": np.array([well]) for number, well in enumerate(workspace.wells, 1)},
        "the water": np.array([workspace.water]),
        "the rag": np.array([workspace.rag]) + np.array([[-1.0], [1.0]]) * (workspace.rag_width / 2, 0, 0),
    }
    if workspace.home is not None:
        places["home"] = np.array([workspace.home])
    axes = np.flatnonzero(travel.beyond(np.concatenate(list(places.values()))).any(0)).tolist()
    if not axes:
        return []
    limits = ", ".join(f"{'xyz'[axis]} {travel.describe(axis)}" for axis in axes)
    beyond = ", ".join(name for name, place in places.items() if travel.beyond(place).any())
    return [
        f"The machine's own limits ({limits}) do not include {beyond or 'all places of the workspace together'}; "
        "motions there are refused. Make the workspace true, or change the machine's limits if they are wrong."
    ]


def find_zero(easel: Easel, robot: ZeroedRobot) -> Procedure[None]:
    """Asks a person to find the zero again: by limit switches, by looking, or by jogging to a corner of the canvas.

    Raises ZeroUnknown if the person does not.
    """
    zero = robot.zero()
    lost = f"The machine does not know where its brush is: {zero.lost}."
    switches = f"{lost} Shall it drive to its limit switches now? Keep its way free."
    if zero.homes and (yield Confirm(switches, moves=True)) is True:
        robot.find_zero()
        return
    if zero.locked:
        raise _refusal(zero.lost, "begin again and let it home, or release it with its own controls before")
    origin, touch = easel.workspace.canvas_origin, easel.calibration.touch_height
    here = easel.robot.pose()
    x, y = 1000 * easel.workspace.to_canvas(here[None])[0]
    up = 1000 * (here[2] - touch)
    told = (
        f"{lost} It says that the tip is {abs(x):.0f} mm {'right' if x >= 0 else 'left'} of the bottom-left corner of "
        f"the canvas, {abs(y):.0f} mm {'beyond' if y >= 0 else 'before'} it and {abs(up):.0f} mm "
        f"{'above' if up >= 0 else 'below'} lightest touch. Is it exactly there?"
    )
    if (yield Confirm(told, proposal=False)) is True:
        robot.set_zero(here)
        return
    while True:
        yield from _jog_to(robot, "the bottom-left corner of the canvas, in lightest touch")
        robot.set_zero(np.array([*origin[:2], touch]))
        if (yield from _is_at_other_corner(easel)):
            return
        again = "Then it is to be done once more; the motors may have lost steps, or the canvas has moved. Go on?"
        if (yield Confirm(again)) is not True:
            raise _refusal("nobody has found it", "jog to the corner once more when the canvas lies still")


def _is_at_other_corner(easel: Easel) -> Procedure[bool]:
    """Drives to above the opposite corner; returns True if a person sees the tip there."""
    motion = Motion(easel.workspace, easel.calibration)
    far = easel.workspace.to_robot(np.array([[0.0, 0.0], [easel.canvas.width, easel.canvas.height]]), np.zeros(2))
    far[:, 2] = motion.travel_height
    way = Waypoints("to the other corner", far, easel.workspace.travel_speed)
    question = "The brush goes up now, and to above the top-right corner of the canvas. Is its way free?"
    if (yield Confirm(question, moves=True)) is not True:
        return True  # the first corner counts alone
    RobotGateway(easel).perform([way])
    return (yield Confirm("Is the tip above the top-right corner now?")) is True


def enter_workspace(easel: Easel, robot: ZeroedRobot) -> Procedure[None]:
    """Brings a tip that stands outside the workspace back, as after homing; asks nothing if it is inside.

    Raises WorkspaceViolation if the person does not allow that, RobotError and its subclasses.
    """
    here, lower, upper = easel.robot.pose(), *map(np.array, (easel.workspace.lower, easel.workspace.upper))
    outside = (here < lower - STANDS) | (here > upper + STANDS)
    inside = np.where(outside, np.clip(here, lower + _INSIDE, upper - _INSIDE), here)
    if np.array_equal(inside, here):
        return
    way = ", ".join(f"{axis} {1000 * far:+.1f} mm" for axis, far in zip("xyz", inside - here, strict=True) if far)
    question = f"The tip stands outside the workspace. Shall it go back slowly ({way})? Keep its way free."
    if (yield Confirm(question, moves=True)) is not True:
        raise WorkspaceViolation("The tip stands outside the workspace, and nobody let it go back. It did not move.")
    up = np.array([*here[:2], max(here[2], inside[2])])
    for start, end in ((here, up), (up, np.array([*inside[:2], up[2]])), (np.array([*inside[:2], up[2]]), inside)):
        for part in split_jog(end - start):
            robot.jog(part)


def split_jog(step: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Returns a way [3] in metres as equal jogs that are short enough; none for no way."""
    count = math.ceil(float(np.linalg.norm(step)) / _MAX_STEP - 1e-9)
    return [step / count] * count if count > 0 else []


def _jog_to(robot: ZeroedRobot, where: str) -> Procedure[None]:
    """Moves the tip by a person's keys: first up, then along x and y, then down."""
    tasks = (
        (2, "Raise the brush until it is free of everything (u is up)"),
        (0, f"Move it along x until it is above {where} (u is towards greater x)"),
        (1, f"Move it along y until it is above {where} (u is towards greater y)"),
        (2, f"Lower it (d is down) to {where}"),
    )
    for axis, task in tasks:
        gone, refused = 0.0, ""
        while True:
            move = yield Jog(f"{task}; ok when it is there.", gone, -_ROOM, _ROOM, remark=refused)
            refused = ""
            if not isinstance(move, JogMove) or not abs(move.step) <= _ROOM:
                raise _refusal("the jog was not understood", "type millimetres, u, d or ok")
            if move.settled:
                break
            try:
                for part in split_jog(move.step * np.eye(3)[axis]):
                    robot.jog(part)
                    gone += float(part[axis])
            except WorkspaceViolation as beyond:  # this part did not move
                refused = f"Not moved: {beyond}"


def _refusal(lost: str, remedy: str) -> ZeroUnknown:
    return ZeroUnknown(f"The machine does not know where its brush is ({lost}); {remedy}. Nothing was moved.")
