"""How much is painted where there is not time for all; what else the keeper does is tested with the loop."""

from dataclasses import replace

import pytest
import torch

from frida_painter.errors import ConfigError
from frida_painter.session.choreography import DRYING
from frida_painter.session.events import Paused, Scheduled, StrokePainted
from frida_painter.strokes.plan import Plan
from support.session import NotingPlanner, SessionSetup


def told(setup: SessionSetup) -> float:
    """Seconds that the robot was to take, before it began."""
    return next(event.seconds or 0.0 for event in setup.heard if isinstance(event, Scheduled))


def needed(**settings: object) -> float:
    """Seconds that it takes where there is time enough; nothing is painted."""
    setup = SessionSetup(30, colors=3, stop_at=lambda event: isinstance(event, Scheduled), **settings)  # type: ignore[arg-type]
    setup.run()
    return told(setup)


def painted(**settings: object) -> tuple[SessionSetup, float]:
    setup = SessionSetup(30, colors=3, **settings)  # type: ignore[arg-type]
    setup.run()
    return setup, told(setup)


@pytest.mark.parametrize("share", [0.9, 0.5, 0.2])
def test_as_many_strokes_are_painted_as_there_is_time_for(share: float) -> None:
    whole = needed(replans=3)
    setup, shorter = painted(replans=3, budget=share * whole)
    assert 0.7 * share * whole < shorter <= share * whole
    assert sum(setup.planner.left_out) + len(setup.painted()) == 30
    last = [event for event in setup.heard if isinstance(event, StrokePainted)][-1]
    assert last.done == last.of == len(setup.painted())


def test_with_time_enough_nothing_is_left_out() -> None:
    whole = needed(replans=3)
    setup, told_again = painted(replans=3, budget=1.03 * whole)
    assert setup.planner.left_out == [] and told_again == pytest.approx(whole)
    assert len(setup.painted()) == 30


def test_looks_for_the_film_take_of_the_time() -> None:
    whole = needed(replans=0)
    with_film, _ = painted(replans=0, timelapse_frames=30, budget=whole)
    assert 0 < len(with_film.painted()) < 30


def test_drying_takes_of_the_time_and_a_layer_for_which_there_is_none_is_left_out() -> None:
    layered, whole = painted(replans=0, planner=NotingPlanner(layers=(20, 10)))
    assert whole > DRYING
    short, took = painted(replans=0, planner=NotingPlanner(layers=(20, 10)), budget=whole - DRYING / 2)
    assert took < DRYING and 0 < len(short.painted()) <= 20
    assert sum(layered.easel.operator.dried) == pytest.approx(DRYING) and short.easel.operator.dried == []


def test_a_plan_that_was_made_before_is_shortened_as_well() -> None:
    whole = needed(replans=0)
    setup = SessionSetup(30, colors=3, budget=whole / 2)
    made = setup.planner.plan(torch.ones(3, 8, 8), 30, 3, lambda step: None)
    setup.session.run(30, 3, made)
    assert told(setup) <= whole / 2 and 0 < len(setup.painted()) < 30


def test_a_budget_in_which_not_one_stroke_is_painted_is_refused_before_anything_is() -> None:
    setup = SessionSetup(30, colors=3, budget=2.0)
    with pytest.raises(ConfigError, match=r"--minutes was given 0\.0333333, and .* single stroke takes 0\.\d minutes"):
        setup.run()
    assert setup.painted() == []


def test_what_is_left_gets_shorter_where_a_look_makes_it_longer() -> None:
    """The planner answers a look with strokes that take twice as long; the budget holds all the same."""
    whole = needed(replans=1)
    setup = SessionSetup(30, colors=3, replans=1, budget=1.03 * whole, planner=Slowing())
    setup.run()
    assert 15 < len(setup.painted()) < 30
    spent = setup.session.so_far
    assert spent is not None and spent.painted == len(setup.painted())


def test_a_plan_in_mixed_paints_that_is_being_shortened_is_given_up_where_a_person_has_another_adopted() -> None:
    whole = needed(replans=0)

    class Interrupted(Slowing):
        def bind_to_palette(self, plan, canvas, palette, notify):  # type: ignore[no-untyped-def]
            return longest(plan)

        def replan(self, *given, **more):  # type: ignore[no-untyped-def]
            setup.pausing = True
            return super().replan(*given, **more)

    def instead(paused: Paused) -> bool:
        setup.session.paint_instead(setup.session.rest.part(slice(12)))
        return True

    setup = SessionSetup(
        30, colors=3, replans=0, budget=1.03 * whole, planner=Interrupted(), go_on=instead,
        mixed=lambda wanted: wanted,
    )  # fmt: skip
    setup.run()
    assert len(setup.painted()) == 12


class Slowing(NotingPlanner):
    def replan(self, *given, **more):  # type: ignore[no-untyped-def]
        return longest(super().replan(*given, **more))


def longest(plan: Plan) -> Plan:
    """The plan with all strokes as long as they may be."""
    limits = plan.layers[0].limits
    long = plan.strokes.with_groups(length=torch.full((len(plan),), limits.length[1]))
    return replace(plan, strokes=long.project(limits, plan.canvas))
