"""Strokes take on the sizes and directions of a brushwork."""

import math
from dataclasses import replace

import pytest
import torch

from frida_painter.planning.brushwork import along_brushwork, brushwork_cost
from frida_painter.planning.initialize import best_proposals
from frida_painter.planning.optimize import stacked_cost
from frida_painter.planning.problem import StrokeWishes
from frida_painter.strokes.strokes import Strokes
from marks import SMALL
from support.planning import CANVAS, problem, some_strokes, target

PROBLEM = problem(48)
LENGTH, WIDTH = 0.014, 0.006


def field(angle: torch.Tensor | float, sure: float, held: float = 1.0) -> torch.Tensor:
    """A brushwork [6, 48, 64] of those angles."""
    doubled = 2 * torch.as_tensor(angle).expand(48, 64)
    rest = [torch.full_like(doubled, value) for value in (sure, math.log(LENGTH), math.log(WIDTH), held)]
    return torch.stack((doubled.cos(), doubled.sin(), *rest))


def turned(brushwork: torch.Tensor, count: int = 200) -> tuple[Strokes, Strokes]:
    strokes = some_strokes(count)
    return strokes, along_brushwork(strokes, brushwork, SMALL, CANVAS, torch.Generator().manual_seed(1))


def test_strokes_turn_into_the_direction_about_their_middles() -> None:
    before, after = turned(field(0.7, 1.0))
    assert float(torch.cos(2 * (after.angle - 0.7)).mean()) > 0.9
    half = torch.tensor([0.5])
    moved = (after.path(half) - before.path(half)).norm(dim=-1)
    assert float(moved.median()) < 1e-6, "only those that would leave the canvas are moved"
    assert float(after.bend.abs().max()) < 1e-5, "a straight direction bends nothing"
    after.check(SMALL.limits, CANVAS)
    both_ways = torch.cos(after.angle - 0.7) > 0
    assert 0.3 < float(both_ways.float().mean()) < 0.7


def test_as_many_turn_as_the_direction_is_sure_and_free_strokes_stay() -> None:
    for sure in (0.0, 0.4):
        before, after = turned(field(0.7, sure))
        assert abs(float((before.angle != after.angle).float().mean()) - sure) < 0.12
    before, after = turned(field(0.7, 0.0, held=0.0))
    for name, values in before.arrays().items():
        torch.testing.assert_close(after.arrays()[name], values, msg=name)


def test_where_the_direction_turns_strokes_bend_with_it_and_are_shorter() -> None:
    """About the middle of the canvas it goes in circles: strokes lie along them, ends nearer than chords."""
    y, x = torch.meshgrid(torch.linspace(0.045, -0.045, 48), torch.linspace(-0.06, 0.06, 64), indexing="ij")
    round_, straight = (turned(field(angle, 1.0))[1] for angle in (torch.atan2(y, x) + math.pi / 2, 0.0))
    middle = torch.tensor([CANVAS.width, CANVAS.height]) / 2
    path = round_.path(torch.tensor([0.1, 0.5, 0.9])) - middle
    lies = (path[:, 1].norm(dim=-1) > 0.015) & (path.abs() < middle - 0.012).all(-1).all(-1)
    chords = round_.with_groups(bend=torch.zeros_like(round_.bend)).path(torch.tensor([0.1, 0.5, 0.9])) - middle

    def unround(points: torch.Tensor) -> torch.Tensor:
        far = points.norm(dim=-1)
        return (far[:, 1] - (far[:, 0] + far[:, 2]) / 2).abs()[lies].mean()

    assert int(lies.sum()) > 20 and float(unround(path)) < 0.6 * float(unround(chords))
    assert float(round_.length.mean()) < float(straight.length.mean())


def test_placed_strokes_have_the_brushwork() -> None:
    def agreement(of: torch.Tensor | None) -> float:
        found = best_proposals(
            Strokes.empty(), None, 12, replace(PROBLEM, wishes=StrokeWishes(brushwork=of)), target(PROBLEM), 12,
            generator=torch.Generator().manual_seed(0),
        )  # fmt: skip
        return float(torch.cos(2 * (found.strokes.angle - 1.2)).mean())

    assert agreement(field(1.2, 1.0)) > 0.8 > agreement(None) + 0.3


def test_strokes_in_the_brushwork_cost_less_and_free_ones_nothing() -> None:
    before, after = turned(field(0.7, 1.0))
    wanted = field(0.7, 1.0)
    costs = [float(brushwork_cost(strokes, wanted, SMALL, CANVAS)) for strokes in (after, before)]
    assert 0 < costs[0] < 0.3 * costs[1]
    assert float(brushwork_cost(before, field(0.7, 0.0, held=0.0), SMALL, CANVAS)) == 0
    assert float(brushwork_cost(Strokes.empty(), wanted, SMALL, CANVAS)) == 0
    on, off = replace(PROBLEM, wishes=StrokeWishes(brushwork=wanted)), PROBLEM
    few = before[:6]
    whole = float(stacked_cost([few], [on])) / float(stacked_cost([few], [off]))
    assert whole == pytest.approx(1 + float(brushwork_cost(few, wanted, on.model, CANVAS)), rel=1e-4)


def test_its_slope_is_that_of_finite_differences() -> None:
    strokes = some_strokes(5)
    names = ("angle", "length", "bend", "thickness")
    leaves = tuple(strokes.arrays()[name].double().requires_grad_() for name in names)

    def cost(*parts: torch.Tensor) -> torch.Tensor:
        changed = strokes.to(torch.float64).with_groups(**dict(zip(names, parts, strict=True)))
        return brushwork_cost(changed, field(0.7, 0.8).double(), SMALL, CANVAS)

    assert torch.autograd.gradcheck(cost, leaves, eps=1e-7, atol=1e-3, rtol=1e-3)
