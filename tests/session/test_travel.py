import itertools

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from easels import CALIBRATION, WORKSPACE
from frida_painter.brush.bezier import BezierStroke, RibbonShape
from frida_painter.brush.kinds import FINE, MEDIUM, BrushKind
from frida_painter.hardware.motion import Motion
from frida_painter.plan import Plan
from frida_painter.render import render
from frida_painter.session.choreography import BrushLoad, Choreography
from frida_painter.session.travel import marks_may_meet, shorten_travel
from plans import CANVAS, made_up_plan, made_up_strokes


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


@settings(max_examples=25)
@given(plans, st.integers(0, 45))
def test_strokes_that_may_meet_and_paints_and_what_comes_later_keep_their_order(plan: Plan, count: int) -> None:
    count = min(count, len(plan))
    after = shorten_travel(plan, count, choreography(), BrushLoad())
    where = places(plan, after)
    assert sorted(where) == list(range(len(plan)))
    assert where[count:] == list(range(count, len(plan)))
    assert after.paint.tolist() == plan.paint.tolist()
    meets = marks_may_meet(plan.strokes, FINE.width)
    for one, other in itertools.combinations(range(len(plan)), 2):
        if meets[one, other]:
            assert where[one] < where[other]


@settings(max_examples=15)
@given(plans)
def test_the_picture_stays_and_the_hand_travels_no_farther(plan: Plan) -> None:
    by = choreography()
    after = shorten_travel(plan, len(plan), by, BrushLoad())
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
    after = shorten_travel(plan, 80, by, BrushLoad())
    assert travel(after, by) < 0.8 * travel(plan, by)


def test_marks_that_meet_are_never_overlooked() -> None:
    strokes = made_up_strokes(60, seed=5)
    model = BezierStroke("fine", FINE.frame, FINE.limits, RibbonShape.typical(FINE.width))
    bare = torch.ones(3, 200, 300)
    black = strokes.with_groups(color=torch.zeros(60, 3))
    with torch.no_grad():
        marks = torch.stack([render(black[index : index + 1], model, bare, CANVAS)[0] < 0.99 for index in range(60)])
    really = (marks.flatten(1).float() @ marks.flatten(1).float().T > 0).numpy()
    meets = marks_may_meet(strokes, FINE.width)
    assert not (really & ~meets).any()
    assert 0.02 < meets[~np.eye(60, dtype=bool)].mean() < 0.5, "and yet most may change places"


def test_a_paint_without_a_well_is_left_for_others_to_refuse() -> None:
    plan = made_up_plan(8, 6)
    assert torch.equal(shorten_travel(plan, 8, choreography(), BrushLoad()).strokes.position, plan.strokes.position)


@pytest.mark.parametrize("load", [BrushLoad(), BrushLoad(0, 1e-5), BrushLoad(2, 1e-3)])
def test_the_order_is_the_same_every_time(load: BrushLoad) -> None:
    plan = made_up_plan(50, 2, seed=9)
    once, again = (shorten_travel(plan, 50, choreography(), load) for _ in range(2))
    assert torch.equal(once.strokes.position, again.strokes.position)
