from dataclasses import replace

import torch
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.planning.effort import DRAWING, Effort
from frida_painter.planning.layers import StepCount
from frida_painter.planning.optimize import Step
from frida_painter.planning.problem import PlanningProblem, StrokeWishes
from frida_painter.planning.refine import (
    HARDLY_APART,
    bind_to_palette,
    distinct,
    loss_of_paint,
    relocate,
    visible_area,
    without_twins,
)
from frida_painter.planning.variables import Paints
from frida_painter.strokes.palette import Palette, ciede2000, from_lab, to_lab
from frida_painter.strokes.strokes import Strokes
from support.planning import CANVAS, problem, some_strokes, target

PROBLEM = problem(64)
TARGET = target(PROBLEM)


def chance(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def squared_error(strokes: Strokes) -> float:
    with torch.no_grad():
        return float((TARGET - PROBLEM.render(strokes)).square().sum())


def lost(strokes: Strokes, on: PlanningProblem, seed: int = 0) -> torch.Tensor:
    return torch.stack(loss_of_paint(strokes, on, TARGET, chance(seed))).sum(0)


def without(strokes: Strokes, index: int) -> Strokes:
    return strokes[[other for other in range(len(strokes)) if other != index]]


def test_the_loss_without_a_stroke_is_that_of_leaving_it_out() -> None:
    """Eight random probes give the squared change |D|^2 to half of itself (a standard deviation), and unbiased."""
    strokes = some_strokes(16, seed=5)
    with torch.no_grad():
        pictures = [PROBLEM.render(strokes), *(PROBLEM.render(without(strokes, index)) for index in range(16))]
    error = torch.stack([(TARGET - one).square().sum() for one in pictures])
    true, squared = error[1:] - error[0], torch.stack([(one - pictures[0]).square().sum() for one in pictures[1:]])
    estimates = torch.stack([lost(strokes, PROBLEM, seed) for seed in range(40)])
    off = (estimates - true) / squared
    assert off.mean(0).abs().max() < 0.3 and off.mean().abs() < 0.05
    assert 0.35 < off.std() < 0.65
    assert torch.corrcoef(torch.stack((estimates.mean(0), true)))[0, 1] > 0.97


def test_the_loss_counts_by_how_much_each_place_matters() -> None:
    """Where only the left half matters, a stroke in the right half is missed by nobody."""
    strokes = some_strokes(16, seed=5)
    matters = torch.zeros(PROBLEM.canvas.shape[1:])
    matters[:, : matters.shape[1] // 2] = 2
    weighted = replace(PROBLEM, wishes=StrokeWishes(importance=matters))
    with torch.no_grad():
        pictures = [PROBLEM.render(strokes), *(PROBLEM.render(without(strokes, index)) for index in range(16))]
    error = torch.stack([(matters * (TARGET - one).square()).sum() for one in pictures])
    estimates = torch.stack([lost(strokes, weighted, seed) for seed in range(40)]).mean(0)
    true = error[1:] - error[0]
    assert torch.corrcoef(torch.stack((estimates, true)))[0, 1] > 0.97
    unseen = true.abs() < 1e-6
    assert bool(unseen.any()) and bool((estimates[unseen].abs() < 1e-4).all())


def test_a_stroke_that_cannot_be_seen_is_missed_by_nobody() -> None:
    strokes = some_strokes(4)
    twice = Strokes.join(strokes[:1].with_groups(thickness=torch.zeros(1)), strokes[:1], strokes[1:])
    covering = twice.with_groups(thickness=torch.tensor([0.0, 1.0, 0.5, 0.5, 0.5]))
    loss = lost(covering, PROBLEM)
    assert loss[0].abs() < 0.15 * loss[1].abs()


def test_visible_areas_are_those_in_which_a_colour_is_seen() -> None:
    strokes = some_strokes(5)
    area = visible_area(strokes, PROBLEM)
    with torch.no_grad():
        before = PROBLEM.render(strokes)
        for index in range(5):
            color = strokes.color.clone()
            color[index] += 0.1
            changed = PROBLEM.render(strokes.with_groups(color=color)) - before
            assert torch.isclose(changed[0].sum() / 0.1, area[index], rtol=1e-2, atol=0.5)


def test_relocating_keeps_the_count_the_limits_and_the_order() -> None:
    for share in (0.0, 0.15, 0.5, 1.0):
        found, _ = relocate(some_strokes(20), None, PROBLEM, TARGET, share, chance())
        assert len(found) == 20
        found.check(PROBLEM.limits, CANVAS)
        assert bool((to_lab(found.color)[:, 0].diff() <= 1e-4).all())


def test_relocating_makes_a_poor_plan_better_and_moves_no_more_than_its_share() -> None:
    for seed in range(3):
        strokes = some_strokes(20, seed)
        found, _ = relocate(strokes, None, PROBLEM, TARGET, 0.2, chance(seed))
        assert squared_error(found) < squared_error(strokes)
        lengths = set(found.length.tolist())
        assert sum(length in lengths for length in strokes.length.tolist()) >= 16


def test_relocated_strokes_take_paints_that_there_are() -> None:
    palette = torch.tensor([[0.9, 0.85, 0.8], [0.8, 0.2, 0.1], [0.1, 0.15, 0.3]])
    paint = torch.arange(18) // 6
    strokes = some_strokes(18).with_groups(color=palette[paint])
    found, paints = relocate(strokes, Paints(palette, paint), PROBLEM, TARGET, 0.5, chance())
    assert paints is not None and torch.equal(paints.color, palette)
    assert torch.equal(found.color, palette[paints.paint])
    assert not torch.equal(found.length.sort()[0], strokes.length.sort()[0])


def test_strokes_are_drawn_to_paints_and_lie_light_to_dark_in_them_and_every_step_is_told() -> None:
    steps: list[Step] = []
    strokes, begin = some_strokes(30), StepCount(steps.append, len(DRAWING) * 2 + 4).begin
    found, paints = bind_to_palette(strokes, PROBLEM, 5, Effort(drawing=2, binding=4), 0, begin)
    assert len(found) == 30 and paints.color.shape == (5, 3)
    assert torch.equal(found.color, paints.color[paints.paint])
    assert bool((paints.paint.diff() >= 0).all()) and bool((to_lab(paints.color)[:, 0].diff() <= 0).all())
    assert (found.color.mean(0) - strokes.color.mean(0)).abs().max() < 0.1
    away = [
        float(torch.cdist(step.parts[0][1].color, paints.color).amin(1).mean())
        for step in steps[: 2 * len(DRAWING) : 2]
    ]
    assert away == sorted(away, reverse=True) and away[-1] < 0.5 * away[0]
    assert [step.iteration for step in steps] == list(range(1, 13)) and steps[-1].of == 12


def nearest_pair(color: torch.Tensor) -> float:
    gap = ciede2000(to_lab(color)[:, None], to_lab(color)[None])
    return float(gap.fill_diagonal_(torch.inf).min())


@given(st.integers(1, 12), st.integers(0, 1000), st.sampled_from([HARDLY_APART, 5.0]))
def test_no_two_wells_are_twins_and_there_are_no_more_of_them(count: int, seed: int, apart: float) -> None:
    chance = torch.Generator().manual_seed(seed)
    color = torch.rand(40, 3, generator=chance) * torch.rand(3, generator=chance)
    weight = torch.rand(40, generator=chance)
    palette = distinct(Palette.cluster(color, weight, count, seed), color, weight, apart)
    assert 1 <= len(palette) <= count
    assert len(palette) == 1 or nearest_pair(palette.color) >= apart - 0.01
    assert bool((palette.lab()[:-1, 0] >= palette.lab()[1:, 0] - 1e-3).all()), "lightest first"


def test_a_well_that_twins_shared_goes_to_the_accent_that_was_drowned() -> None:
    """Two greens that nobody tells apart, and a small red for which there was no well."""
    greens = torch.tensor([[0x07, 0x7F, 0x4B], [0x06, 0x76, 0x46]]) / 255
    red = torch.tensor([[0.8, 0.1, 0.1]])
    color, weight = torch.cat((greens.repeat(10, 1), red)), torch.ones(21)
    palette = distinct(Palette(greens), color, weight, 5.0)
    assert len(palette) == 2 and float((palette.color - red).abs().sum(1).min()) < 1e-6
    assert torch.allclose(palette.color[palette.color[:, 1].argmax()], greens.mean(0), atol=5e-3)


def test_paints_that_grew_alike_become_one_and_strokes_keep_theirs() -> None:
    color = from_lab(torch.tensor([[80.0, 0, 0], [50, 40, 0], [51, 40, 0], [20, 0, 0]]))
    paints = without_twins(Paints(color, torch.tensor([0, 1, 1, 2, 3])), HARDLY_APART)
    assert len(paints.color) == 3 and paints.paint.tolist() == [0, 1, 1, 1, 2]
    assert torch.allclose(paints.color[1], (2 * color[1] + color[2]) / 3, atol=1e-5)
    kept = without_twins(paints, HARDLY_APART)
    assert torch.equal(kept.color, paints.color) and torch.equal(kept.paint, paints.paint)
