import math

import pytest
import torch

from frida_painter.frames import PixelGrid
from frida_painter.objectives.image import ImageTerm
from frida_painter.objectives.objective import Goal
from frida_painter.objectives.semantic import SemanticTerm
from frida_painter.objectives.style import StyleTerm
from frida_painter.objectives.style_flow import brushwork_of, directions, magnification, mark_size, mark_spacing
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


def dots(side: int) -> torch.Tensor:
    """Light squares [3, 240, 320] of a side, on dark, as far apart as they are wide."""
    down, across = (torch.arange(length) // side % 2 for length in (240, 320))
    return (0.2 + 0.6 * (down[:, None] * across).float()).expand(3, -1, -1).contiguous()


def test_marks_are_measured_by_how_often_they_follow_each_other() -> None:
    fine, coarse = mark_spacing(stripes(0.3, 240, 320)), mark_spacing(dots(8))
    assert fine == pytest.approx(9 / 240, rel=0.15)
    assert coarse == pytest.approx(16 / 240, rel=0.4) and mark_spacing(dots(4)) < 0.7 * coarse


def test_stripes_make_long_marks_and_dots_short_ones_and_fine_ones_become_larger() -> None:
    (length, width), (other_length, other_width) = mark_size(stripes(0.3, 240, 320)), mark_size(dots(8))
    assert length > 4 * width and other_length < 2 * other_width
    assert magnification(dots(2)) > magnification(dots(8)) >= 1
    assert mark_size(dots(2))[1] >= 0.03, "no brush paints finer"


def test_a_goal_has_the_brushwork_of_its_style_and_faces_are_free() -> None:
    grid, style = PixelGrid.of_height(CANVAS, 48), stripes(0.3)
    assert brushwork_of(Goal((ImageTerm(stripes(1.0)),)), grid) is None
    face = torch.ones(12, 16)
    face[4:8, 6:10] = 7.0
    found = brushwork_of(Goal((ImageTerm(stripes(1.0), importance=face), StyleTerm(style))), grid)
    assert found is not None and found.shape == (6, 48, 64)
    inner = found[:, 10:-10, 10:-10]
    assert float((inner[0] * math.cos(2.0) + inner[1] * math.sin(2.0)).mean()) > 0.9, "the picture that is begun with"
    assert float(found[5, 20:28, 28:36].max()) < 0.2 and float(found[5, :8].min()) > 0.9
    length, width = (float(part) * CANVAS.height for part in mark_size(style))
    assert float(found[3].exp().mean()) == pytest.approx(length, rel=1e-3)
    assert float(found[4].exp().mean()) == pytest.approx(width, rel=1e-3)
    begun = brushwork_of(Goal((StyleTerm(style),), (StyleTerm(style),)), grid)
    assert begun is not None and float(begun[5].min()) == 1


def test_photographs_have_directions_that_strokes_follow_as_far_as_is_said_and_no_sizes() -> None:
    grid, goal = PixelGrid.of_height(CANVAS, 48), Goal((ImageTerm(stripes(1.0)),))
    for form in (0.3, 1.0):
        found = brushwork_of(goal, grid, form)
        assert found is not None and found.shape == (6, 48, 64) and not bool(found[3:].any())
        inner = found[:, 10:-10, 10:-10]
        assert float((inner[0] * math.cos(2.0) + inner[1] * math.sin(2.0)).mean()) > 0.9
        assert float(inner[2].mean()) == pytest.approx(form, rel=0.05)
    assert brushwork_of(goal, grid, 0.0) is None


def test_content_wants_large_marks_where_it_matters_little() -> None:
    grid, matters = PixelGrid.of_height(CANVAS, 48), torch.ones(12, 16)
    matters[:, 8:] = 6.0
    goal = Goal((SemanticTerm(stripes(0.3)),), (ImageTerm(stripes(0.3), importance=matters),))
    found = brushwork_of(goal, grid)
    assert found is not None and float(found[5, :, 40:].max()) < 0.3 < 0.9 < float(found[5, :, :24].min())
