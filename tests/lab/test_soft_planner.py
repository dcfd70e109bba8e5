import pytest
import torch

from frida_painter.canvas_size import CanvasSize
from frida_painter.lab.sim2real import SoftEffort, SoftStrokes, allow_any_stroke, plan_soft_strokes, render, seen_colors

SIZE = CanvasSize(0.13, 0.1)
EFFORT = SoftEffort(rounds=3, settling=12, polishing=12)


def target() -> torch.Tensor:
    """A dark disc on a field that goes from yellow to blue."""
    y, x = torch.meshgrid(torch.linspace(-1, 1, 48), torch.linspace(-1.3, 1.3, 62), indexing="ij")
    field = torch.stack((0.5 - 0.3 * x, 0.5 - 0.2 * x, 0.5 + 0.3 * x))
    return torch.where(x * x + y * y < 0.3, torch.tensor([0.2, 0.1, 0.1])[:, None, None], field)


@pytest.mark.slow
def test_few_strokes_come_near_and_more_come_nearer():
    errors = []
    for count in (2, 16):
        made = plan_soft_strokes(target(), SIZE, allow_any_stroke(SIZE), count, colors=None, effort=EFFORT, seed=0)
        assert len(made.strokes) == count
        torch.testing.assert_close(made.picture, render(made.strokes, torch.ones(3, 48, 62), SIZE))
        errors.append(float((made.picture - target()).square().mean()))
    bare = float((1 - target()).square().mean())
    assert errors[0] < 0.6 * bare and errors[1] < 0.5 * errors[0]


@pytest.mark.slow
def test_with_paints_there_are_no_other_colours_and_progress_ends_at_one():
    heard = []
    made = plan_soft_strokes(
        target(), SIZE, allow_any_stroke(SIZE), 9, colors=3, effort=EFFORT, seed=1, notify=heard.append
    )
    assert len(torch.unique(made.strokes.color, dim=0)) <= 3
    assert heard == sorted(heard) and heard[-1] == 1.0


def test_the_same_seed_gives_the_same_plan():
    first, second = (
        plan_soft_strokes(target(), SIZE, allow_any_stroke(SIZE), 4, colors=None, effort=SoftEffort(2, 3, 3), seed=5)
        for _ in range(2)
    )
    assert torch.equal(first.picture, second.picture)


def test_a_half_opaque_black_stroke_on_white_is_seen_grey_and_the_next_sees_it():
    place = torch.tensor([[0.03, 0.05], [0.06, 0.05], [0.1, 0.05]])
    strokes = SoftStrokes(
        place.expand(2, 3, 2), torch.full((2, 2), 0.02), torch.tensor([[0.5, 0.5], [0.5, 0.5]]), torch.zeros(2, 3)
    )
    first, second = seen_colors(strokes, torch.ones(3, 48, 62), SIZE)[:, 0].tolist()
    assert abs(first - 0.5) < 0.06 and abs(second - 0.25) < 0.06
