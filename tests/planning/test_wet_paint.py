import math
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest
import torch
from torch import Tensor

from frida_painter.calibration import WetPaint
from frida_painter.errors import CalibrationError, PlanError
from frida_painter.frames import PixelGrid
from frida_painter.planning.planner import Planner
from frida_painter.planning.problem import PlanningProblem
from frida_painter.planning.wet_paint import (
    PackedMarks,
    PaintedPart,
    Wetness,
    change_by_wet_paint,
    lay_packed_marks,
    learn_wet_paint,
    pack_marks,
)
from frida_painter.render.reference import bilinear
from frida_painter.strokes.palette import Palette
from frida_painter.strokes.plan import Plan
from frida_painter.strokes.strokes import Strokes
from frida_painter.system import images
from support.planning import CANVAS, as_it_is, goal, plain, problem, small_table, some_strokes

WET = WetPaint(rate=20.0, share=0.2, drying=300.0)


# The plain twin: pixel by pixel, and place by place along a path.


class WetMark(NamedTuple):
    """Mark of one stroke: numbers of its pixels, their coverage and nearest places, metres of the way, and sRGB."""

    pixel: Tensor
    alpha: Tensor
    nearest: Tensor
    steps: Tensor
    color: Tensor


def plain_pigment(color: list[float]) -> list[float]:
    found = []
    for value in color:
        linear = value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4
        reflected = min(max(linear, 0.006), 0.985)
        found.append((1 - reflected) ** 2 / (2 * reflected))
    scattering = [1 / math.sqrt(1 + ratio) for ratio in found]
    return [*(ratio * each for ratio, each in zip(found, scattering, strict=True)), *scattering]


def plain_color(pigment: list[float]) -> list[float]:
    found = []
    for band in range(3):
        ratio = pigment[band] / pigment[3 + band]
        linear = 1 + ratio - math.sqrt(ratio**2 + 2 * ratio)
        found.append(12.92 * linear if linear <= 0.0031308 else 1.055 * linear ** (1 / 2.4) - 0.055)
    return found


def lay_plainly(marks: list[WetMark], wet: WetPaint, painted_at: list[float], pixels: int) -> list[list[float]]:
    change = [[0.0] * 3 for _ in range(pixels)]
    amount, pigment = [0.0] * pixels, [[1.0] * 6 for _ in range(pixels)]
    now = painted_at[0]
    for mark, at in zip(marks, painted_at, strict=True):
        amount, now = [max(0.0, each - (at - now) / wet.drying) for each in amount], at
        own, covered = plain_pigment(mark.color.tolist()), mark.pixel.tolist()
        alpha, nearest = mark.alpha.tolist(), mark.nearest.tolist()
        brush, held = list(own), []
        for place, step in enumerate(mark.steps.tolist()):
            here = [k for k in range(len(covered)) if nearest[k] == place]
            there = sum(alpha[k] for k in here) + 1e-6
            found = sum(alpha[k] * amount[covered[k]] for k in here) / there
            taken = 1 - math.exp(-wet.rate * step * found)
            for band in range(6):
                paint = sum(alpha[k] * amount[covered[k]] * pigment[covered[k]][band] for k in here) / there
                brush[band] = (1 - taken) * brush[band] + taken * paint / max(found, 1e-4)
            held.append(list(brush))
        for k, pixel in enumerate(covered):
            share = wet.share * amount[pixel]
            mixed = [(1 - share) * a + share * b for a, b in zip(held[nearest[k]], pigment[pixel], strict=True)]
            for band, (seen, wanted) in enumerate(zip(plain_color(mixed), plain_color(own), strict=True)):
                change[pixel][band] = change[pixel][band] * (1 - alpha[k]) + (seen - wanted) * alpha[k]
            kept = amount[pixel] * (1 - alpha[k])
            pigment[pixel] = [
                (a * kept + b * alpha[k]) / (kept + alpha[k]) for a, b in zip(pigment[pixel], mixed, strict=True)
            ]
            amount[pixel] = min(1.0, kept + alpha[k])
    return change


def made_up_marks(seed: int, count: int = 5, pixels: int = 30) -> list[WetMark]:
    generator = torch.Generator().manual_seed(seed)

    def drawn(*shape: int) -> Tensor:
        return torch.rand(*shape, generator=generator, dtype=torch.float64)

    marks = []
    for _ in range(count):
        pixel = torch.randperm(pixels, generator=generator)[: pixels * 2 // 3]
        steps = torch.cat((torch.zeros(1, dtype=torch.float64), 0.004 * drawn(16)))
        nearest = torch.randint(0, 17, (len(pixel),), generator=generator)
        marks.append(WetMark(pixel, 0.05 + 0.9 * drawn(len(pixel)), nearest, steps, 0.1 + 0.8 * drawn(3)))
    return marks


def test_compiled_loops_find_the_same_as_the_plain_twin() -> None:
    for seed in range(4):
        marks, painted_at = made_up_marks(seed), [10.0, 15.0, 15.0, 100.0, 320.0]
        plain = torch.tensor(lay_plainly(marks, WET, painted_at, 30)).T
        begin = np.cumsum([0, *(len(mark.pixel) for mark in marks)])
        pixel, alpha, nearest = (torch.cat([mark[field] for mark in marks]) for field in range(3))
        packed = (pixel.int().numpy(), alpha.float().numpy(), nearest.to(torch.int8).numpy())
        steps, color = (torch.stack([mark[field] for mark in marks]).float() for field in (3, 4))
        found = lay_packed_marks(PackedMarks(begin, *packed, steps.numpy(), color), WET, painted_at, 30)
        assert torch.allclose(found, plain, atol=2e-5)
        assert float(found.abs().max()) > 0.005


def test_strokes_of_several_brushes_change_a_picture_and_those_that_it_shows_do_not() -> None:
    on = problem()
    strokes, at = [some_strokes(7), some_strokes(0), some_strokes(5, seed=3)], [4.0 * number for number in range(12)]
    whole, after, late = (change_by_wet_paint(strokes, [on] * 3, WET, at, seen=number) for number in (0, 7, 12))
    assert float(whole.abs().max()) > 0.005
    assert not torch.allclose(after, whole, atol=1e-3) and not late.any()


def test_marks_cover_pixels_as_the_renderer_covers_them() -> None:
    on, strokes = problem(), some_strokes(3)
    grid = PixelGrid(on.size, *on.canvas.shape[1:])
    magnitude, affine = on.marks(strokes)
    row, column = torch.meshgrid(torch.arange(grid.rows), torch.arange(grid.columns), indexing="ij")
    packed = pack_marks([strokes], [on], grid)
    for index, (first, end) in enumerate(pairwise(packed.begin)):
        cell = [a[0] * column + a[1] * row + a[2] for a in affine[index]]
        alpha = bilinear(magnitude[index], *cell).flatten()
        seen = torch.from_numpy(packed.alpha[first:end])
        assert torch.allclose(seen, alpha[torch.from_numpy(packed.pixel[first:end]).long()], atol=1e-5)
        assert int((alpha > 0.02).sum()) == end - first > 0
        way = strokes[index : index + 1].path(torch.linspace(0, 1, 17))[0]
        steps = float((way[1:] - way[:-1]).norm(dim=1).sum())
        assert float(packed.steps[index].sum()) == pytest.approx(steps, rel=1e-3)


def crossing() -> tuple[Strokes, PlanningProblem]:
    """White across blue, twice the same place."""
    on = problem()
    limits = on.limits
    length = torch.full((2,), float(limits.length[1]))
    start = torch.tensor([[CANVAS.width / 2 - float(length[0]) / 2, CANVAS.height / 2]] * 2)
    color = torch.tensor([[0.1, 0.2, 0.6], [0.95, 0.95, 0.9]])
    return Strokes(start, torch.zeros(2), length, torch.zeros(2), torch.full((2,), 0.6), color), on


def test_a_light_stroke_on_wet_dark_paint_turns_darker_and_more_so_along_its_way() -> None:
    strokes, on = crossing()
    change = change_by_wet_paint([strokes], [on], WET, (0.0, 5.0))
    assert change.shape == on.canvas.shape
    middle = change[:, change.shape[1] // 2].mean(0)
    painted = (middle < -0.001).nonzero()[:, 0]
    assert len(painted) > 4
    left, right = middle[painted[: len(painted) // 2]].mean(), middle[painted[len(painted) // 2 :]].mean()
    assert float(right) < float(left) < -0.01


def test_dry_paint_changes_nothing_and_wet_paint_less_the_later() -> None:
    strokes, on = crossing()
    soon, later, dry = (
        float(change_by_wet_paint([strokes], [on], WET, (0.0, at)).abs().sum()) for at in (1.0, 200.0, 301.0)
    )
    assert soon > later > 1e6 * dry  # measured: 40, 23, and 0 or 9e-8, by how a processor rounds


def test_what_a_photograph_shows_is_learned() -> None:
    strokes, on = some_strokes(12), problem()
    at = [3.0 * number for number in range(12)]
    expected = on.render(strokes)
    painted = [
        PaintedPart([strokes], [on], at, expected + change_by_wet_paint([strokes], [on], wet, at), expected)
        for wet in (WetPaint(20.0, 0.2, 300.0), WetPaint(5.0, 0.05, 300.0))
    ]
    much, little = (learn_wet_paint([part]) for part in painted)
    assert much is not None and little is not None
    for part, found in zip(painted, (much, little), strict=True):
        off = part.seen - part.expected
        left = off - change_by_wet_paint([strokes], [on], found, at)
        assert float(left.square().mean()) < 0.1 * float(off.square().mean())
    assert much.rate * much.share > 2 * little.rate * little.share


def test_nothing_is_learned_from_paint_that_dries_at_once_or_from_nothing() -> None:
    strokes, on = some_strokes(12), problem()
    expected = on.render(strokes)
    noise = 0.02 * torch.randn(expected.shape, generator=torch.Generator().manual_seed(0))
    at = [3.0 * number for number in range(12)]
    assert learn_wet_paint([PaintedPart([strokes], [on], at, expected + noise, expected)]) is None
    assert learn_wet_paint([]) is None


@pytest.mark.parametrize("times", [(0.0,), (0.0, 1.0, 2.0), (1.0, 0.0), (0.0, math.nan)])
def test_times_that_do_not_fit_the_strokes_are_refused(times: tuple[float, ...]) -> None:
    strokes, on = crossing()
    with pytest.raises(PlanError, match="give one for each, in painting order"):
        change_by_wet_paint([strokes], [on], WET, times)


@pytest.mark.parametrize("name", ["rate", "share", "drying"])
def test_numbers_of_no_paint_are_refused(name: str) -> None:
    for value in (-1.0, math.nan, math.inf):
        with pytest.raises(CalibrationError, match=name):
            replace(WET, **{name: value})


def test_the_planner_expects_and_forecasts_wet_paint() -> None:
    strokes, on = crossing()
    planner = Planner(goal(), *plain(CANVAS, small_table(), strokes=2, colors=2, rows=48))
    facts = {"canvas": CANVAS, "brush": on.model.brush, "limits": on.limits}
    plan = Plan.of(strokes, Palette(strokes.color), torch.arange(2), **facts)
    dry, wet = planner.expected(plan), planner.expected(plan, wetness=Wetness(WET, (0.0, 5.0)))
    assert float((wet - dry).min()) < -0.01
    assert torch.allclose(planner.expected(plan, wetness=Wetness(WET, (0.0, 400.0))), dry, atol=1e-6)
    sure = planner.forecast(plan, planner.bare)
    wetter = planner.forecast(plan, planner.bare, wetness=Wetness(WET, (0.0, 5.0)))
    target = images.resize_by_area(planner.goal.terms[0].picture, *planner.bare.shape[1:])
    errors = [float((picture - target).square().mean()) for picture in (dry, wet)]
    assert (wetter.expected < sure.expected) == (errors[1] > errors[0])


def test_a_plan_that_is_settled_for_wet_paint_is_expected_to_be_nearer_to_its_picture() -> None:
    strokes, on = crossing()
    strokes = strokes.with_groups(color=torch.tensor([[0.1, 0.2, 0.6], [0.6, 0.6, 0.55]]))
    wanted = as_it_is(on.render(strokes))
    planner = Planner(
        wanted, *plain(CANVAS, small_table(), strokes=2, colors=2, rows=48, paints="any", new_paints=True)
    )
    facts = {"canvas": CANVAS, "brush": on.model.brush, "limits": on.limits}
    dark_first = Plan.of(strokes[:1], Palette(strokes.color[:1]), torch.zeros(1, dtype=torch.long), **facts)
    plan = dark_first.under(Plan.of(strokes[1:], Palette(strokes.color[1:]), torch.zeros(1, dtype=torch.long), **facts))
    wetness = Wetness(WET, (0.0, 5.0))
    wet, fixed = (planner.settle_wet(plan, planner.bare, wetness, mixed=mixed) for mixed in (False, True))
    costs = [planner.cost(each, planner.bare, wetness) for each in (wet, fixed, plan)]
    assert max(costs[:2]) < 0.7 * costs[2]
    assert torch.equal(fixed.strokes.color[0], plan.strokes.color[0])  # that paint is mixed
    assert not torch.equal(wet.strokes.color[0], plan.strokes.color[0])
    later, before = (each.strokes.color[1] for each in (wet, plan))
    assert float((later - before).mean()) > 0.05  # lighter paint makes up for what it takes up
    assert wet.layer_sizes == fixed.layer_sizes == (1, 1)
    below, rest = plan.part([0]), plan.part([1])  # the same on a photograph of the first stroke, which is wet
    seen = planner.expected(below)
    still = Wetness(WET, (0.0,), below, (-5.0,))
    assert torch.allclose(planner.expected(rest, seen, still), planner.expected(plan, wetness=wetness), atol=0.01)
    assert not torch.allclose(planner.expected(rest, seen), planner.expected(rest, seen, still), atol=0.05)
    ready = planner.settle_wet(rest, seen, still, mixed=False)
    costs = [planner.cost(planner.replan(ready, seen, wetness=each), seen, still) for each in (still, None)]
    assert costs[0] <= planner.cost(ready, seen, still) < costs[1]
    empty = plan.part([])
    assert planner.settle_wet(empty, planner.bare, Wetness(WET, ())) is empty
