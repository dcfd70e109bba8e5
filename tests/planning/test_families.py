"""A planner with strokes of a family: layers, gradients to the code, replans, and what cannot be planned."""

import pytest
import torch

from frida_painter.brush.kinds import FINE
from frida_painter.brush.table import StrokeTable, TableDetail
from frida_painter.errors import PlanError
from frida_painter.planning.effort import Effort
from frida_painter.planning.mixable import mixing_changes
from frida_painter.planning.planner import Planner
from frida_painter.runs.goals import make_goal
from frida_painter.strokes.family import CODE_REACH
from frida_painter_calibration.teaching.families import FamilyRibbon
from marks import coarse_table, ribbon, wave_family
from support.planning import plain

FAMILY = wave_family()


def planner(rows: int = 32, ink: tuple[float, float, float] = (0.1, 0.1, 0.1)) -> Planner:
    detail = TableDetail((2, 2, 2), rank=8, parts=(1, 1))
    taught = StrokeTable.of(FamilyRibbon(FINE.of_family(FAMILY)), detail=detail)
    goal = torch.ones(3, 48, 64)
    goal[:, 20:26, 8:56] = torch.tensor(ink)[:, None, None]
    told = plain(
        "16x12cm", [coarse_table(ribbon()), taught], Effort().scale(0.05), rows, strokes=8, colors=2, layers=2,
        new_paints=True,
    )  # fmt: skip
    return Planner(make_goal(goal).fit_to(48, 64), *told)


def test_a_plan_has_a_layer_of_the_family_and_a_replan_keeps_it():
    painter = planner()
    assert (painter.kinds, painter.brushes) == (("small", "fine+wave"), ("small", "fine"))
    plan = painter.plan()
    own, taught = plan.by_layer()
    assert own.strokes.taught is None
    assert taught.strokes.taught.families == (FAMILY,)
    code = taught.strokes.taught.code
    assert float(code.abs().amax()) <= CODE_REACH
    assert plan.kinds == painter.kinds
    again = painter.replan(plan.part(slice(3, None)), painter.bare)
    assert again.families == (FAMILY,)
    assert painter.cost(again, painter.bare) <= painter.cost(plan.part(slice(3, None)), painter.bare)
    assert painter.expected(plan).shape == (3, 32, 43)


def test_layers_in_paints_that_can_be_mixed_are_still_of_the_family():
    plan = planner(ink=(1.0, 0.0, 1.0)).plan()  # no acrylic gives it
    assert mixing_changes(plan) and plan.families == (FAMILY,)


def test_slopes_reach_place_angle_size_press_and_code():
    painter = planner()
    plan = painter.plan().by_layer()[1]
    problem = painter.problems.of(painter.bare, painter.fine, "fine+wave")
    strokes = plan.strokes
    leaves = {name: getattr(strokes, name).clone().requires_grad_() for name in ("position", "angle", "length")}
    leaves["thickness"] = strokes.thickness.clamp(0.2, 0.8).clone().requires_grad_()
    code = (0.5 * strokes.taught.code).clone().requires_grad_()
    moving = strokes.with_groups(**leaves, taught=type(strokes.taught).of(FAMILY, code))
    problem.expected_loss(moving).backward()
    for leaf in (*leaves.values(), code):
        assert bool(leaf.grad.isfinite().all())
        assert float(leaf.grad.abs().sum()) > 0


def test_an_unknown_kind_of_stroke_is_named():
    painter = planner()
    with pytest.raises(PlanError, match=r"fine\+comma.*small, fine\+wave"):
        painter.problems.of(painter.bare, painter.fine, "fine+comma")
