import math

import pytest
import torch

from frida_painter.frames import PixelGrid
from frida_painter.objectives.image import ImageTerm
from frida_painter.objectives.objective import Goal
from frida_painter.objectives.style import StyleTerm
from frida_painter.objectives.style_flow import directions, flow, flow_of
from support.planning import CANVAS


def stripes(angle: float, rows: int = 120, columns: int = 160) -> torch.Tensor:
    """Stripes [3, rows, columns] that run at an angle, counter-clockwise from the canvas's x."""
    up, right = torch.meshgrid(-torch.arange(rows).float(), torch.arange(columns).float(), indexing="ij")
    across = right * -math.sin(angle) + up * math.cos(angle)
    return (0.5 + 0.4 * torch.sin(across * 2 * math.pi / 9)).expand(3, -1, -1).contiguous()


@pytest.mark.parametrize("angle", [0.0, 0.4, math.pi / 4, math.pi / 2, 2.0, 3.0])
def test_a_stripe_runs_the_way_it_was_drawn(angle: float) -> None:
    doubled, coherence, energy = directions(stripes(angle))
    inner = slice(15, -15), slice(15, -15)
    assert float(torch.cos(doubled[inner] - 2 * angle).min()) > 0.98
    assert float(coherence[inner].min()) > 0.9 and float(energy.min()) >= 0


def test_what_changes_alike_in_all_directions_has_none() -> None:
    dots = 0.5 * (stripes(0.0) + stripes(math.pi / 2))
    assert float(directions(dots)[1][20:-20, 20:-20].mean()) < 0.3
    assert float(directions(torch.full((3, 40, 40), 0.5))[1].max()) < 1e-5  # sums of equal numbers differ by rounding


def test_the_style_says_which_way_only_where_the_content_does_not() -> None:
    content = torch.full((3, 120, 160), 0.6)
    content[:, :, 80:] = stripes(math.pi / 2)[:, :, 80:]
    field = flow(stripes(0.3), content, 60, 80)
    assert field.shape == (3, 60, 80)
    assert float(field[2, 10:-10, 8:28].min()) > 0.9 and float(field[2, 10:-10, 52:72].max()) < 0.3
    alone = flow(stripes(0.3), None, 60, 80)
    assert float(alone[2, 10:-10, 10:-10].min()) > 0.9
    inner = alone[:, 10:-10, 10:-10]
    assert float((inner[0] * math.cos(0.6) + inner[1] * math.sin(0.6)).min()) > 0.9


def test_a_goal_has_the_flow_of_its_style() -> None:
    grid, photo, style = PixelGrid.of_height(CANVAS, 48), torch.rand(3, 48, 64), stripes(0.3)
    assert flow_of(Goal((ImageTerm(photo),)), grid) is None
    styled = flow_of(Goal((ImageTerm(photo), StyleTerm(style))), grid)
    assert styled is not None and torch.equal(styled, flow(style, photo, 48, 64))
    begun = flow_of(Goal((StyleTerm(style),), (StyleTerm(style),)), grid)
    assert begun is not None and torch.equal(begun, flow(style, None, 48, 64)), "its own composition is no objection"
