import math
from dataclasses import replace

import torch

from frida_painter.planning.initialize import along_flow, best_proposals
from frida_painter.strokes import Strokes
from marks import SMALL
from support.planning import CANVAS, problem, some_strokes, target

PROBLEM = problem(48)


def field(angle: torch.Tensor | float, sure: float) -> torch.Tensor:
    """A flow [3, 48, 64] of those angles."""
    doubled = 2 * torch.as_tensor(angle).expand(48, 64)
    return torch.stack((doubled.cos(), doubled.sin(), torch.full_like(doubled, sure)))


def turned(flow: torch.Tensor, count: int = 200) -> tuple[Strokes, Strokes]:
    strokes = some_strokes(count)
    chance = torch.Generator().manual_seed(1)
    return strokes, along_flow(strokes, flow, SMALL.limits, CANVAS, chance)


def test_strokes_turn_into_the_flow_about_their_middles() -> None:
    before, after = turned(field(0.7, 1.0))
    assert float(torch.cos(2 * (after.angle - 0.7)).mean()) > 0.9
    half = torch.tensor([0.5])
    moved = (after.path(half) - before.path(half)).norm(dim=-1)
    assert float(moved.median()) < 1e-6, "only those that would leave the canvas are moved"
    assert float(after.bend.abs().max()) < 1e-5, "a straight flow bends nothing"
    after.check(SMALL.limits, CANVAS)
    both_ways = torch.cos(after.angle - 0.7) > 0
    assert 0.3 < float(both_ways.float().mean()) < 0.7


def test_as_many_turn_as_the_flow_is_sure() -> None:
    for sure in (0.0, 0.4):
        before, after = turned(field(0.7, sure))
        share = float((before.angle != after.angle).float().mean())
        assert abs(share - sure) < 0.12
    unmoved = turned(field(0.7, 0.0))
    assert torch.allclose(unmoved[0].bend, unmoved[1].bend)


def test_where_the_flow_turns_strokes_bend_with_it_and_are_shorter() -> None:
    """About the middle of the canvas the flow goes in circles: strokes lie along them, ends nearer than chords."""
    y, x = torch.meshgrid(torch.linspace(0.045, -0.045, 48), torch.linspace(-0.06, 0.06, 64), indexing="ij")
    before, after = turned(field(torch.atan2(y, x) + math.pi / 2, 1.0))
    middle = torch.tensor([CANVAS.width, CANVAS.height]) / 2
    path = after.path(torch.tensor([0.1, 0.5, 0.9])) - middle
    radius = path.norm(dim=-1)
    lies = (radius[:, 1] > 0.015) & (path.abs() < middle - 0.012).all(-1).all(-1)
    straight = after.with_groups(bend=torch.zeros_like(after.bend)).path(torch.tensor([0.1, 0.5, 0.9])) - middle

    def unround(points: torch.Tensor) -> torch.Tensor:
        far = points.norm(dim=-1)
        return (far[:, 1] - (far[:, 0] + far[:, 2]) / 2).abs()[lies].mean()

    assert int(lies.sum()) > 20 and float(unround(path)) < 0.6 * float(unround(straight))
    assert float(after.length.mean()) < float(before.length.mean())


def test_placed_strokes_go_the_way_of_the_flow() -> None:
    def agreement(of: torch.Tensor | None) -> float:
        found = best_proposals(
            Strokes.empty(), None, 12, replace(PROBLEM, flow=of), target(PROBLEM), 12, light_to_dark=True,
            generator=torch.Generator().manual_seed(0),
        )  # fmt: skip
        return float(torch.cos(2 * (found.strokes.angle - 1.2)).mean())

    assert agreement(field(1.2, 1.0)) > 0.8 > agreement(None) + 0.3
