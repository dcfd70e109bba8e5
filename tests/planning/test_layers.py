import copy

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.errors import ConfigError, PlanError
from frida_painter.objectives.objective import Goal
from frida_painter.planning.effort import Effort
from frida_painter.planning.planner import Planner
from frida_painter.planning.settings import layer_sizes, usual_shares
from frida_painter.strokes.palette import Palette
from frida_painter.strokes.plan import Plan
from support.planning import CANVAS, goal, plain, small_table

QUICK = Effort().scale(0.1)
BARE = torch.ones(3, 64, 85)


def planner(layers: int | None = 2, wanted: Goal | None = None, effort: Effort = QUICK) -> Planner:
    return Planner(wanted or goal(), *plain(CANVAS, small_table(), rows=64, effort=effort, seed=1, layers=layers))


@pytest.fixture(scope="module")
def plan() -> Plan:
    return planner().plan(BARE, 30, 4)


@given(st.integers(1, 1000), st.integers(1, 8))
def test_each_layer_has_a_stroke_and_the_first_has_most(strokes: int, layers: int) -> None:
    if layers > strokes:
        with pytest.raises(ConfigError, match=f"{layers} layers for {strokes} strokes"):
            layer_sizes(strokes, usual_shares(layers))
        return
    sizes = layer_sizes(strokes, usual_shares(layers))
    assert len(sizes) == layers and sum(sizes) == strokes and min(sizes) >= 1
    assert layers > strokes / 5 or sizes[0] >= 0.55 * strokes


def test_every_layer_goes_from_light_to_dark_in_the_same_paints(plan: Plan) -> None:
    assert plan.layer_sizes == (18, 12) and len(plan.palette) == 4
    for layer in plan.by_layer():
        assert bool((layer.paint.diff() >= 0).all())
    by, (first, _) = planner(), plan.by_layer()
    assert by.validation_loss(by.expected(plan)) < by.validation_loss(by.expected(first)), "the second one helps"


def test_only_many_strokes_towards_a_picture_get_layers_of_themselves() -> None:
    assert planner(None).layer_sizes(200) == (120, 80)
    assert planner(None).layer_sizes(40) == (40,)
    assert planner(3).layer_sizes(40) == (24, 8, 8)


def test_where_a_layer_begins_its_strokes_go_where_the_canvas_needs_them_and_light_over_dark(plan: Plan) -> None:
    by, (first, _) = planner(effort=Effort().scale(0.5)), plan.by_layer()
    rest = plan.part(slice(len(first), None))
    spoilt = by.expected(first)
    spoilt[:, 40:, :30] = 0.05  # a dark blot where the picture is pale
    again = by.replan(rest, spoilt, fresh=True)
    lost = [by.validation_loss(by.expected(one, spoilt)) for one in (rest, again)]
    assert again.layer_sizes == rest.layer_sizes == (0, 12)
    assert lost[1] < 0.8 * lost[0]
    assert int(again.paint.min()) == 0


def test_planning_again_inside_the_first_layer_keeps_both(plan: Plan) -> None:
    by, rest = planner(), plan.part(slice(10, None))
    canvas = by.expected(plan.part(slice(0, 10))) * 0.85
    again = by.replan(rest, canvas)
    assert again.layer_sizes == (8, 12)
    first, second = again.by_layer()
    assert int(first.paint.min()) >= int(rest.by_layer()[0].paint.min()), "no lighter than what is wet"
    assert by.cost(again, canvas) < by.cost(rest, canvas), "by 7 to 9 %"
    assert torch.equal(again.palette.color, rest.palette.color), "all of it is mixed"
    for moved, old in zip((first, second), rest.by_layer(), strict=True):
        assert not torch.equal(moved.strokes.position, old.strokes.position), "what is left of both is settled together"
    changed = by.replan(rest, canvas, rounds=2)
    assert changed.layer_sizes == (8, 12) and changed.by_layer()[1].digest != second.digest


def test_where_moving_strokes_does_not_help_they_are_settled_where_they_are(plan: Plan, monkeypatch) -> None:
    def thrown_about(strokes, paints, *rest, **more):
        return strokes.with_groups(position=strokes.position.flip(0)).project(plan.layers[0].limits, CANVAS), paints

    monkeypatch.setattr("frida_painter.planning.layers.relocate", thrown_about)
    by, rest = planner(), plan.part(slice(10, None))
    steps = []
    canvas = by.expected(plan.part(slice(0, 10))) * 0.8
    again = by.replan(rest, canvas, steps.append)
    assert by.validation_loss(by.expected(again, canvas)) < by.validation_loss(by.expected(rest, canvas))
    assert [step.iteration for step in steps][-1] == steps[-1].of


def test_steps_show_what_lies_below_and_are_as_many_as_were_told() -> None:
    by, steps = planner(), []
    by.plan(BARE, 30, 4, steps.append)
    assert len(steps) == by.iterations(30) == steps[-1].iteration == steps[-1].of
    assert sum(len(strokes) for _, strokes in steps[-1].parts) == 30


def two_brushes(**settings: object) -> Planner:
    """A brush, and a finer one that leaves half of its marks."""
    fine = copy.copy(small_table())
    fine.brush = "finer"
    models = [small_table(), fine]
    return Planner(goal(), *plain(CANVAS, models, rows=64, effort=QUICK, **{"layers": None, **settings}))  # type: ignore[arg-type]


def test_each_brush_paints_its_layer_in_paints_of_its_own() -> None:
    by = two_brushes(layers=2, shares=(0.5, 0.5), new_paints=True)
    plan = by.plan(BARE, 24, 4)
    assert [(layer.strokes, layer.brush) for layer in plan.layers] == [(12, "small"), (12, "finer")]
    first, second = plan.by_layer()
    assert not torch.equal(first.palette.color, second.palette.color) and len(plan.palette) <= 8
    for layer in (first, second):
        assert bool((layer.paint.diff() >= 0).all())
    by_hand = by.expected(second, by.expected(first))
    assert torch.allclose(by.expected(plan), by_hand, atol=1e-6)
    assert by.expected_loss(plan, BARE) < by.expected_loss(first, BARE)


def test_new_paints_are_chosen_again_where_their_layer_begins_and_stay_once_it_has() -> None:
    by = two_brushes(layers=2, new_paints=True)
    plan = by.plan(BARE, 24, 4)
    first, second = plan.by_layer()
    rest, spoilt = plan.part(slice(len(first), None)), by.expected(first)
    spoilt[:, 40:, :30] = 0.05
    again = by.replan(rest, spoilt, fresh=True)
    assert not torch.equal(again.by_layer()[1].palette.color, second.palette.color)
    whole = plan.part(slice(len(first))).followed_by(again)
    assert whole.by_layer()[0].digest == first.digest and whole.layer_sizes == plan.layer_sizes
    later = by.replan(whole.part(slice(len(first) + 3, None)), spoilt)
    assert torch.equal(later.by_layer()[1].palette.color, again.by_layer()[1].palette.color)


def test_what_was_mixed_for_a_layer_binds_only_what_is_painted_from_these_wells() -> None:
    by = two_brushes(layers=2, new_paints=True)
    plan = by.plan(BARE, 24, 4)
    first, second = plan.by_layer()
    mixed = Palette(first.palette.color * 0.9)
    one, other = by.bind_to_palette(plan, BARE, mixed).by_layer()
    assert torch.equal(one.palette.color, mixed.color) and other.digest == second.digest


def test_brushes_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ConfigError, match="3 layers and 2 brushes"):
        two_brushes(layers=3)
    with pytest.raises(ConfigError, match="3 shares of the strokes were given"):
        two_brushes(shares=(0.5, 0.3, 0.2))
    with pytest.raises(ConfigError, match="Two stroke models of one brush"):
        Planner(goal(), *plain(CANVAS, [small_table(), copy.copy(small_table())], rows=64))
    with pytest.raises(ConfigError, match=r"Layer 2 gets 1\.0% of 20 strokes, which is not one stroke"):
        layer_sizes(20, (0.5, 0.01, 0.49))
    with pytest.raises(PlanError, match="The plan is for the brush 'small', and here are finer"):
        fine = copy.copy(small_table())
        fine.brush = "finer"
        Planner(goal(), *plain(CANVAS, fine, rows=64)).expected(planner(1).plan(BARE, 3, 2))
