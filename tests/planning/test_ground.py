import itertools
from dataclasses import replace

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.errors import ConfigError
from frida_painter.mixing.recipe import PaintSet
from frida_painter.objectives.image import ImageTerm
from frida_painter.objectives.objective import Goal
from frida_painter.objectives.style import StyleTerm
from frida_painter.planning.effort import Effort
from frida_painter.planning.ground import ground_around_things, possible_grounds, proposed_ground
from frida_painter.planning.planner import Planner
from frida_painter.strokes.plan import WHITE
from support.networks import QuickEncoders
from support.planning import CANVAS, as_it_is, plain, small_table

CHANNEL = st.floats(0, 1, width=32)


@given(st.tuples(CHANNEL, CHANNEL, CHANNEL), st.tuples(CHANNEL, CHANNEL, CHANNEL))
def test_grounds_are_white_the_mean_and_ever_darker_ones(left: tuple[float, ...], right: tuple[float, ...]) -> None:
    half = torch.tensor(left)[:, None, None].expand(3, 64, 32), torch.tensor(right)[:, None, None].expand(3, 64, 32)
    picture = torch.cat(half, 2)
    white, *darker = possible_grounds(picture)
    assert white == WHITE
    assert darker[0] == pytest.approx(picture.mean((1, 2)).tolist(), abs=0.003)
    lightness = [sum(color) for color in darker]
    assert all(light + 0.02 >= dark for light, dark in itertools.pairwise(lightness))


def planner(picture: torch.Tensor) -> Planner:
    wanted = as_it_is(picture)
    return Planner(wanted, *plain(CANVAS, small_table(), rows=64, effort=Effort().scale(0.2)))


def test_a_dark_picture_is_painted_on_a_dark_ground_and_a_light_one_on_white() -> None:
    dark = torch.full((3, 64, 85), 0.15)
    dark[:, 20:30, 20:60] = 0.9
    by = planner(dark)
    by = by.on_ground(proposed_ground(by, 6, 2))
    assert max(by.ground) < 0.3
    plan = by.plan(None, 6, 2)
    assert plan.ground == by.ground and float((by.expected(plan)[:, :4].mean() - 0.15).abs()) < 0.1
    assert by.towards(by.goal).ground == by.ground
    assert proposed_ground(planner(1 - 0.1 * dark), 6, 2)[0] > 0.9


def test_without_a_picture_a_person_names_the_ground(monkeypatch: pytest.MonkeyPatch) -> None:
    by = planner(torch.zeros(3, 64, 85))
    monkeypatch.setattr(ImageTerm, "guide", None)
    with pytest.raises(ConfigError, match="give a colour, such as #c8a878"):
        proposed_ground(by, 6, 2)


def test_too_many_layers_are_refused_before_anything_is_tried() -> None:
    by = Planner(as_it_is(torch.zeros(3, 64, 85)), *plain(CANVAS, small_table(), rows=64, layers=8))
    heard: list[object] = []
    with pytest.raises(ConfigError, match="layers"):
        proposed_ground(by, 6, 2, heard.append)
    assert heard == []


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
    assert max(proposed_ground(by, 4, 1)) == 0
    by = Planner(by.goal, by.settings, replace(by.materials, darkest=(0.2, 0.1, 0.1)), by.effort)
    assert proposed_ground(by, 4, 1) == pytest.approx((0.2, 0.1, 0.1), abs=0.003)
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
    for ground in (proposed_ground(by, 6, 2), ground_around_things(by)):
        (recipe,) = acrylics.mix(torch.tensor([ground]))
        assert recipe.within_reach and ground[0] > 2 * max(ground[1:]), "still red"
    by = Planner(as_it_is(red), settings, replace(materials, paints=None), effort)
    assert ground_around_things(by) == pytest.approx((1.0, 0.07, 0.07), abs=0.003), "any paint can be mixed"
