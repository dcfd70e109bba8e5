import itertools
from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from frida_painter.brush.kinds import FINE, MEDIUM, BrushKind, Dip
from frida_painter.hardware.motion import Motion
from frida_painter.planning.forecast import Fading
from frida_painter.render import render
from frida_painter.session.choreography import BrushLoad, Choreography
from frida_painter.session.events import Dipped
from frida_painter.session.hand import put_in_order
from frida_painter.strokes.plan import Plan
from frida_painter_calibration.teaching.bezier import BezierStroke, RibbonShape
from support.easel import CALIBRATION, WORKSPACE
from support.plans import CANVAS, made_up_plan


def choreography(brush: BrushKind = FINE) -> Choreography:
    return Choreography(Motion(WORKSPACE, CALIBRATION), brush)


def travel(plan: Plan, by: Choreography) -> float:
    """Metres that the tip moves from the first motion until the brush is clean again."""
    motions = [motion for action in by.actions(plan, BrushLoad(), 0, len(plan)) for motion in action.motions]
    motions += by.cleaning()
    between = sum(
        float(np.linalg.norm(one.position[-1] - other.position[0])) for one, other in itertools.pairwise(motions)
    )
    return between + sum(motion.length for motion in motions)


def dips(plan: Plan, by: Choreography) -> int:
    return sum(isinstance(action.done, Dipped) for action in by.actions(plan, BrushLoad(), 0, len(plan)))


def places(before: Plan, after: Plan) -> list[int]:
    """Where each stroke of `before` stands in `after`."""
    starts = [tuple(start) for start in after.strokes.position.tolist()]
    return [starts.index(tuple(start)) for start in before.strokes.position.tolist()]


plans = st.builds(
    lambda count, colors, seed: made_up_plan(count, colors, seed),
    st.integers(1, 40),
    st.integers(1, 3),
    st.integers(0, 10_000),
)


@given(plans, st.integers(0, 45))
def test_paints_and_what_comes_later_keep_their_order(plan: Plan, count: int) -> None:
    count = min(count, len(plan))
    after = put_in_order(plan, count, choreography(), BrushLoad())
    where = places(plan, after)
    assert sorted(where) == list(range(len(plan)))
    assert where[count:] == list(range(count, len(plan)))
    assert after.paint.tolist() == plan.paint.tolist()


@settings(max_examples=min(15, settings.default.max_examples))
@given(plans)
def test_the_picture_stays_and_the_hand_travels_no_farther(plan: Plan) -> None:
    by = choreography()
    after = put_in_order(plan, len(plan), by, BrushLoad())
    model = BezierStroke("fine", FINE.frame, FINE.limits, RibbonShape.typical(FINE.width))
    bare = torch.ones(3, 40, 60)
    with torch.no_grad():
        pictures = [render(one.strokes, model, bare, CANVAS) for one in (plan, after)]
    assert float((pictures[0] - pictures[1]).abs().max()) < 1e-5
    assert travel(after, by) <= travel(plan, by) * 1.0001


def test_a_fifth_of_the_way_is_saved_where_strokes_are_short() -> None:
    brush = BrushKind("small", MEDIUM.limits, 0.006)
    plan = made_up_plan(80, 2, seed=3)
    short = plan.strokes.with_groups(length=torch.full((80,), 0.012), thickness=torch.full((80,), 0.2))
    plan = Plan.of(
        short.project(plan.layers[0].limits, CANVAS), plan.palette, plan.paint,
        canvas=CANVAS, brush="medium", limits=plan.layers[0].limits,
    )  # fmt: skip
    by = choreography(brush)
    after = put_in_order(plan, 80, by, BrushLoad())
    assert travel(after, by) < 0.8 * travel(plan, by)


def test_dips_are_used_up() -> None:
    """Strokes that take two fifths and three fifths of a dip: pairs of them need half as many dips as strokes."""
    plan = made_up_plan(24, 1, seed=4)
    length = torch.tensor([0.016, 0.024]).repeat_interleave(12)
    even = plan.strokes.with_groups(length=length, thickness=torch.ones(24), bend=torch.zeros(24))
    plan = replace(plan, strokes=even.project(plan.layers[0].limits, CANVAS))
    brush = replace(FINE, known_dip=Dip(0.0402 * FINE.width))
    by = choreography(brush)
    after = put_in_order(plan, 24, by, BrushLoad())
    assert dips(plan, by) == 18
    assert dips(after, by) == 12


def test_a_paint_without_a_well_is_left_for_others_to_refuse() -> None:
    plan = made_up_plan(8, 6)
    assert torch.equal(put_in_order(plan, 8, choreography(), BrushLoad()).strokes.position, plan.strokes.position)


@pytest.mark.parametrize("load", [BrushLoad(), BrushLoad(0, 1e-5), BrushLoad(2, 1e-3)])
def test_the_order_is_the_same_every_time(load: BrushLoad) -> None:
    plan = made_up_plan(50, 2, seed=9)
    once, again = (put_in_order(plan, 50, choreography(), load) for _ in range(2))
    assert torch.equal(once.strokes.position, again.strokes.position)


def test_what_matters_is_painted_with_a_full_brush() -> None:
    """Strokes at one place, of which two matter: each comes first after a dip, and the brush dips no more often."""
    plan = made_up_plan(12, 1, seed=4)
    shape = {"length": torch.full((12,), 0.02), "thickness": torch.ones(12), "bend": torch.zeros(12)}
    there = torch.full((12, 2), 0.1) + 0.001 * torch.arange(12)[:, None]
    even = plan.strokes.with_groups(position=there, angle=torch.zeros(12), **shape)
    plan = replace(plan, strokes=even.project(plan.layers[0].limits, CANVAS))
    by = choreography(replace(FINE, known_dip=Dip(6.01 * 0.02 * FINE.width, fades=0.8)))
    matters = torch.zeros(12)
    matters[[7, 10]] = 1.0
    fading = Fading(torch.zeros(12), matters)
    after = put_in_order(plan, 12, by, BrushLoad(), fading)
    where = places(plan, after)
    assert sorted(where) == list(range(12))
    lacks = [by.brush.dip.lacking(load.left + by.brush.dip.holds / 6.01, by.brush.dip.holds / 6.01)
             for _, load in by.loads(after, BrushLoad())]  # fmt: skip
    assert max(lacks[where[7]], lacks[where[10]]) == 0.0 < max(lacks)
    assert dips(after, by) == dips(put_in_order(plan, 12, by, BrushLoad()), by) == 2
