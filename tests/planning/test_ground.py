from dataclasses import replace

import pytest
import torch

from frida_painter.errors import ConfigError
from frida_painter.mixing.recipe import PaintSet
from frida_painter.objectives.image import ImageTerm
from frida_painter.objectives.objective import Goal
from frida_painter.objectives.style import StyleTerm
from frida_painter.planning.effort import Effort
from frida_painter.planning.ground import ground_around_things, proposed_ground
from frida_painter.planning.planner import Planner
from frida_painter.strokes.plan import WHITE
from support.networks import QuickEncoders
from support.planning import CANVAS, as_it_is, plain, small_table


def planner(picture: torch.Tensor) -> Planner:
    wanted = as_it_is(picture)
    return Planner(wanted, *plain(CANVAS, small_table(), rows=64, effort=Effort().scale(0.2)))


def test_a_dark_picture_is_painted_on_a_dark_ground_and_a_light_one_on_white() -> None:
    dark = torch.full((3, 64, 85), 0.15)
    dark[:, 20:30, 20:60] = 0.9
    by = planner(dark)
    by = by.on_ground(proposed_ground(by))
    assert max(by.ground) < 0.3
    plan = by.plan(None, 6, 2)
    assert plan.ground == by.ground and float((by.expected(plan)[:, :4].mean() - 0.15).abs()) < 0.1
    assert by.towards(by.goal).ground == by.ground
    assert proposed_ground(planner(1 - 0.1 * dark)) == WHITE


def test_without_a_picture_a_person_names_the_ground(monkeypatch: pytest.MonkeyPatch) -> None:
    by = planner(torch.zeros(3, 64, 85))
    monkeypatch.setattr(ImageTerm, "guide", None)
    with pytest.raises(ConfigError, match="give a colour, such as #c8a878"):
        proposed_ground(by)


@pytest.mark.parametrize("share", [0.1, 0.3, 0.5])
def test_paper_that_needs_no_strokes_stays_white_under_a_drawing(share: float) -> None:
    page = torch.ones(3, 64, 85)
    page[:, 8:56, 4 : 4 + round(85 * share)] = 0.1
    assert proposed_ground(planner(page)) == WHITE
    shaded = 0.35 + 0.3 * torch.linspace(0, 1, 85).expand(3, 64, 85)  # its mean is 0.5
    assert proposed_ground(planner(shaded)) == pytest.approx((0.5, 0.5, 0.5), abs=0.01)


def test_around_things_the_commonest_colour_is_the_ground() -> None:
    picture, matters = torch.full((3, 64, 85), 0.8), torch.ones(64, 85)
    picture[:, 40:] = 0.3
    picture[0, 20:60, 20:60], matters[20:60, 20:60] = 1.0, 4.0
    by = planner(picture)
    assert ground_around_things(by) == pytest.approx((0.8, 0.8, 0.8), abs=0.003), "it counts as a whole"
    by = Planner(as_it_is(picture, 1.0, matters / matters.mean()), *plain(CANVAS, small_table(), rows=64))
    assert ground_around_things(by) == pytest.approx((0.8, 0.8, 0.8), abs=0.003)


def test_a_painting_that_begins_with_a_style_is_on_its_commonest_colour() -> None:
    picture = torch.full((3, 64, 85), 0.2)
    picture[2, :50] = 0.6
    by = Planner(Goal((StyleTerm(picture),)), *plain(CANVAS, small_table(), rows=64), encoders=QuickEncoders())
    assert ground_around_things(by) == pytest.approx((0.2, 0.2, 0.6), abs=0.003)


def test_no_ground_is_darker_than_the_darkest_paint() -> None:
    black = torch.zeros(3, 64, 85)
    by = planner(black)
    assert max(proposed_ground(by)) == 0
    by = Planner(by.goal, by.settings, replace(by.materials, darkest=(0.2, 0.1, 0.1)), by.effort)
    assert proposed_ground(by) == pytest.approx((0.2, 0.1, 0.1), abs=0.003)
    matters = torch.ones(64, 85)
    matters[20:60, 20:60] = 4.0
    by = Planner(
        as_it_is(black, 1.0, matters / matters.mean()),
        *plain(CANVAS, small_table(), rows=64, darkest=(0.2, 0.1, 0.1)),
    )
    assert ground_around_things(by) == pytest.approx((0.2, 0.1, 0.1), abs=0.003)


def test_a_ground_is_a_colour_that_the_paints_can_mix() -> None:
    red = torch.tensor([1.0, 0.07, 0.07])[:, None, None].expand(3, 64, 85)
    settings, materials, effort = plain(CANVAS, small_table(), rows=64, effort=Effort().scale(0.2))
    acrylics = PaintSet.of("acrylics")
    by = Planner(as_it_is(red), settings, replace(materials, paints=acrylics), effort)
    for ground in (proposed_ground(by), ground_around_things(by)):
        (recipe,) = acrylics.mix(torch.tensor([ground]))
        assert recipe.within_reach and ground[0] > 2 * max(ground[1:]), "still red"
    by = Planner(as_it_is(red), settings, replace(materials, paints=None), effort)
    assert ground_around_things(by) == pytest.approx((1.0, 0.07, 0.07), abs=0.003), "any paint can be mixed"
