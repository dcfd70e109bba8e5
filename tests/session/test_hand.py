from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from frida_painter.brush.kinds import BrushKind, Dip, brush_kind
from frida_painter.brush.library import StrokeLibrary
from frida_painter.calibration import Calibration, LearnedFile
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import LibraryError, PoseMismatch, WorkspaceViolation
from frida_painter.hardware.motion import Motion
from frida_painter.planning.placement import Placement
from frida_painter.session.choreography import Choreography
from frida_painter.session.events import Dipped, StrokePainted
from frida_painter.session.hand import STROKES_PER_DIP, Hand, with_measured_dip
from frida_painter.strokes.palette import Palette
from frida_painter.strokes.plan import Plan
from frida_painter.strokes.strokes import StrokeLimits
from frida_painter.virtual.studio import StudioSettings, open_studio
from frida_painter_drivers.sawyer.arm import SAWYER
from marks import SMALL, small_library
from support.easel import CALIBRATION, WORKSPACE, NotingRobot, PatientCamera, stub_easel
from support.plans import SMALL_LIMITS, made_up_strokes, plan_of_paints

BRUSH = BrushKind("small", SMALL_LIMITS, 0.008)


def painted(hand: Hand, which: Plan, done: int = 0) -> list[str]:
    """What the robot was told, after the plan has been painted."""
    for action in hand.prepare(which, done, done + len(which)):
        hand.perform(action)
    return hand.easel.robot.labels()


def dipped(hand: Hand, which: Plan) -> list[Dipped]:
    actions = hand.prepare(which, 0, len(which))
    return [action.done for action in actions if isinstance(action.done, Dipped)]


def test_a_brush_that_touches_lower_is_sent_lower_unless_the_workspace_ends_there() -> None:
    hard = plan_of_paints([1], thickness=1.0)
    touches_lower = Placement.unknown({"small": 0.01})
    touches_lower = replace(touches_lower, touch=touches_lower.touch.after("small", 0.001, 0.00001))
    for floor, lowest in ((CALIBRATION.press_height - 0.002, 0.091), (CALIBRATION.press_height, 0.092)):
        low = replace(WORKSPACE, lower=(*WORKSPACE.lower[:2], floor))
        hand = Hand(replace(stub_easel(), workspace=low), BRUSH)
        hand.learn(touches_lower)
        painted(hand, hard)
        robot = hand.easel.robot
        assert isinstance(robot, NotingRobot)
        stroke = next(motion for motion in robot.motions if motion.label == "stroke 1")
        assert stroke.position[:, 2].min() == pytest.approx(lowest, abs=1e-4)


def test_a_clean_brush_dips_before_the_first_stroke_and_is_not_cleaned() -> None:
    told = painted(Hand(stub_easel(), BRUSH), plan_of_paints([1]))
    assert told == ["dip into well 2", "stroke 1"]


def test_the_brush_is_rinsed_wiped_and_dipped_where_the_colour_changes() -> None:
    hand = Hand(stub_easel(), BRUSH)
    told = painted(hand, plan_of_paints([0, 1, 1, 2], length=0.01, thickness=0.0))
    clean = ["rinse", "wipe"]
    assert told == [
        *("dip into well 1", "stroke 1"),
        *(*clean, "dip into well 2", "stroke 2", "stroke 3"),
        *(*clean, "dip into well 3", "stroke 4"),
    ]
    cleaned = [done.cleaned for done in dipped(Hand(stub_easel(), BRUSH), plan_of_paints([0, 1, 1, 2]))]
    assert cleaned[0] is False and cleaned.count(True) == 2


def test_a_batch_goes_on_with_what_the_batch_before_left_on_the_brush() -> None:
    hand = Hand(stub_easel(), BRUSH)
    painted(hand, plan_of_paints([0], length=0.01, thickness=0.0))
    told = painted(hand, plan_of_paints([0, 1], length=0.01, thickness=0.0), done=1)
    assert told[2] == "stroke 2"
    assert told[3:] == ["rinse", "wipe", "dip into well 2", "stroke 3"]


def test_a_brush_that_held_a_darker_or_an_unknown_paint_is_cleaned_twice() -> None:
    wells = plan_of_paints([2, 0, 1], length=0.01, thickness=0.0)
    told = painted(Hand(stub_easel(), BRUSH), wells)
    assert told[2:7] == [*2 * ["rinse", "wipe"], "dip into well 1"]
    assert told[8:11] == ["rinse", "wipe", "dip into well 2"]
    by = Choreography(Motion(WORKSPACE, CALIBRATION), BRUSH)
    assert len(by.cleaning_between(wells, 7, 0)) == 4 and by.cleaning_between(wells, None, 0) == ()


def test_the_brush_is_refilled_by_the_area_it_has_painted() -> None:
    def dips(length: float, thickness: float) -> int:
        return len(dipped(Hand(stub_easel(), BRUSH), plan_of_paints(12 * [0], length, thickness)))

    assert dips(0.03, 1.0) == 12, "the largest mark takes a dip of its own"
    assert dips(0.01, 0.0) < dips(0.012, 0.3) < dips(0.03, 1.0)
    assert dips(0.01, 0.0) <= 3, "small marks, of a twelfth of the largest, share one"


def test_strokes_are_told_by_their_number_and_colour() -> None:
    done = [action.done for action in Hand(stub_easel(), BRUSH).prepare(plan_of_paints([0, 2]), 7, 20)]
    strokes = [one for one in done if isinstance(one, StrokePainted)]
    assert [(one.done, one.of) for one in strokes] == [(8, 20), (9, 20)]
    assert strokes[1].color == pytest.approx((0.1, 0.1, 0.1))


def test_cleaning_leaves_no_paint_on_the_brush() -> None:
    hand = Hand(stub_easel(), BRUSH)
    painted(hand, plan_of_paints([0], length=0.01))
    hand.clean()
    told = painted(hand, plan_of_paints([0], length=0.01))
    assert told == ["dip into well 1", "stroke 1", *2 * ["rinse", "wipe"], "dip into well 1", "stroke 1"]


def test_a_robot_that_is_not_where_it_was_sent_stops_the_painting() -> None:
    robot = NotingRobot(astray=0.005)
    hand = Hand(stub_easel(robot), BRUSH)
    actions = hand.prepare(plan_of_paints([0, 1]), 0, 2)
    with pytest.raises(PoseMismatch, match=r"dip into well 1: .* 5\.0 mm from where it was sent; allowed are 2 mm"):
        hand.perform(actions[0])
    assert len(robot.motions) == 1
    robot.astray = float("nan")
    with pytest.raises(PoseMismatch):
        hand.perform(actions[1])


def test_a_hair_s_breadth_is_forgiven() -> None:
    painted(Hand(stub_easel(NotingRobot(astray=0.0015)), BRUSH), plan_of_paints([0, 1]))


def test_nothing_of_a_batch_is_sent_where_one_waypoint_lies_outside() -> None:
    astray = replace(CALIBRATION, placement=((1.0, 0.0, 0.0), (0.0, 1.0, 0.9), (0.0, 0.0, 1.0)))
    easel = replace(stub_easel(), calibration=astray)
    with pytest.raises(WorkspaceViolation, match=r"stroke 1: y = .*Nothing was sent"):
        Hand(easel, BRUSH).prepare(plan_of_paints([0, 1, 2]), 0, 3)
    assert easel.robot.motions == []


def test_a_paint_without_a_well_is_refused_before_anything_moves() -> None:
    easel = stub_easel()
    fewer = replace(easel, workspace=replace(easel.workspace, wells=easel.workspace.wells[:2]))
    with pytest.raises(WorkspaceViolation, match="2 wells"):
        Hand(fewer, BRUSH).prepare(plan_of_paints([0, 1, 2]), 0, 3)
    assert fewer.robot.motions == []


def test_the_time_of_the_last_motion_is_the_robot_s() -> None:
    hand = Hand(stub_easel(NotingRobot(now=100.0), PatientCamera()), BRUSH)
    hand.step_aside()
    assert hand.last_motion == 101.0
    painted(hand, plan_of_paints([0]))
    assert hand.last_motion == 105.0, "a dip, above the stroke, the stroke, and up"


def test_a_batch_that_the_simulated_sawyer_does_not_reach_is_refused_before_anything_moves() -> None:
    pytest.importorskip("mink")
    wide = CanvasSize(0.9, 0.9)
    studio = open_studio(wide, "broad", settings=StudioSettings(arm=SAWYER, cell=2.0))
    strokes = made_up_strokes(6, 0, wide)
    which = Plan.of(
        strokes, Palette(torch.zeros(1, 3)), torch.zeros(6).long(), canvas=wide, brush="broad",
        limits=StrokeLimits((0.01, 0.06), (-0.016, 0.016)),
    )  # fmt: skip
    with pytest.raises(WorkspaceViolation, match=r"stroke \d: the arm does not reach .* Nothing was sent to the robot"):
        Hand(studio.easel, brush_kind("broad")).prepare(which, 0, 6)
    assert studio.robot.motions == 0


def record_of(library: StrokeLibrary, folder: Path) -> Calibration:
    """A record with that stroke library."""
    library.save(folder / "strokes.npz")
    return replace(CALIBRATION, library=LearnedFile(str(folder / "strokes.npz"), "0" * 64))


def test_a_library_with_fewer_dips_than_strokes_tells_what_a_dip_paints(tmp_path: Path) -> None:
    library = small_library(40)
    since = np.where(np.arange(40) % 2 == 0, 0, 1e-4).astype(np.float32)
    known = record_of(replace(library, since_dip=since, flaws=np.zeros(40, np.uint8)), tmp_path)
    for simulated in (False, True):
        dip = with_measured_dip(SMALL, known, simulated=simulated).dip
        assert 1e-4 < dip.holds < 4e-4 and not dip.by_strokes
    told = with_measured_dip(SMALL, known, simulated=False, refill=200.0).dip
    assert told == Dip(0.2 * SMALL.width), "what a person says comes before what the library shows"
    other = replace(SMALL, name="other")
    assert with_measured_dip(other, known, simulated=False).dip == Dip.of_strokes(STROKES_PER_DIP), (
        "it is of another brush"
    )


def test_where_nothing_shows_it_strokes_are_counted_but_the_projects_own_brushes_are_known(tmp_path: Path) -> None:
    for record in (CALIBRATION, record_of(small_library(4), tmp_path)):
        assert with_measured_dip(SMALL, record, simulated=False).dip == Dip.of_strokes(4)
        assert with_measured_dip(SMALL, record, simulated=True) is SMALL


def test_a_damaged_library_is_told(tmp_path: Path) -> None:
    record = record_of(small_library(4), tmp_path)
    (tmp_path / "strokes.npz").write_bytes(b"PK")
    with pytest.raises(LibraryError, match=r"strokes\.npz"):
        with_measured_dip(SMALL, record, simulated=False)
