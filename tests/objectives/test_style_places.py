"""Places of several styles in one picture."""

import pytest
import torch

from frida_painter.frames import PixelGrid
from frida_painter.objectives.image import ImageTerm
from frida_painter.objectives.objective import Goal
from frida_painter.objectives.sketch import SketchTerm
from frida_painter.objectives.style import StyleTerm, in_style_colors
from frida_painter.objectives.style_flow import brushwork_of, change_by_place, styles_of
from frida_painter.objectives.style_marks import fill_drawing_in_style, in_style_marks
from support.planning import CANVAS


def dusk() -> torch.Tensor:
    """A picture that is darkest on the left and lightest on the right."""
    return torch.linspace(0.05, 0.95, 80).expand(3, 64, 80).contiguous()


def striped(color: tuple[float, float, float], *, upright: bool) -> torch.Tensor:
    """A style: stripes of one colour, upright or level."""
    light = (torch.arange(60) // 5 % 2).float() * 0.5 + 0.5
    stripes = (light[None, :] if upright else light[:, None]).expand(60, 60)
    return torch.tensor(color)[:, None, None] * stripes


BLUE = striped((0.1, 0.1, 0.6), upright=True)
RED = striped((1.0, 0.6, 0.5), upright=False)


def is_red(picture: torch.Tensor) -> torch.Tensor:
    return (picture[0] > picture[2]).float()


@pytest.mark.parametrize(("blue", "red"), [(1.0, 1.0), (1.0, 3.0), (3.0, 1.0)])
def test_the_darker_style_takes_the_darker_places_and_each_its_share(blue: float, red: float) -> None:
    goal = in_style_colors(Goal((ImageTerm(dusk()), StyleTerm(RED, red), StyleTerm(BLUE, blue))))
    assert goal.terms[0].picture is not None
    reddish = is_red(goal.terms[0].picture)
    assert float(reddish.mean()) == pytest.approx(red / (red + blue), abs=0.1)
    assert float(reddish[:, :8].mean()) < 0.1 and float(reddish[:, -8:].mean()) > 0.9


def test_photographs_and_drawings_get_the_marks_of_all_styles() -> None:
    frame = torch.ones(3, 64, 80)
    frame[:, 8:56, 10:60] = 0
    frame[:, 14:50, 16:54] = 1
    styles = StyleTerm(BLUE), StyleTerm(RED)
    for shown in (
        in_style_marks(in_style_colors(Goal((ImageTerm(dusk()), *styles)))).terms[0].picture,
        fill_drawing_in_style(Goal((SketchTerm(frame), *styles)), 64, 80).terms[-1].picture,
    ):
        assert shown is not None and shown.shape == (3, 64, 80)
        assert 0.1 < float(is_red(shown).mean()) < 0.9


def test_strokes_follow_each_style_at_its_places() -> None:
    even = torch.linspace(0.3, 0.7, 80).expand(3, 64, 80).contiguous()
    styled = in_style_marks(in_style_colors(Goal((ImageTerm(even), StyleTerm(BLUE), StyleTerm(RED)))))
    found = brushwork_of(styled, PixelGrid.of_height(CANVAS, 64))
    assert found is not None
    turned = found[0]  # 1 along the x axis, -1 across it
    assert float(turned[:, :16].mean()) < 0 < float(turned[:, -16:].mean())


def test_three_styles_share_a_picture_without_rest() -> None:
    styles = styles_of(Goal((StyleTerm(RED), StyleTerm(BLUE, 2.0), StyleTerm(0.5 * RED))))
    assert [term.weight for term in styles] == [2.0, 1.0, 1.0], "from dark to light"
    whole = change_by_place(dusk(), styles, lambda style: torch.ones(1, 64, 80))
    torch.testing.assert_close(whole, torch.ones(1, 64, 80))
