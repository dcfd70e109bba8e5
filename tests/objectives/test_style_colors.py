import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.frames import PixelGrid
from frida_painter.objectives.image import ImageTerm
from frida_painter.objectives.objective import Goal
from frida_painter.objectives.sketch import SketchTerm
from frida_painter.objectives.style import StyleTerm, in_style_colors
from frida_painter.objectives.style_flow import brushwork_of
from frida_painter.objectives.style_marks import fill_drawing_in_style, in_style_marks
from frida_painter.strokes.palette import from_lab, to_lab
from frida_painter_words.text import TextTerm
from support.planning import CANVAS


def scattered(mean: tuple[float, ...], spread: tuple[float, ...], seed: int = 0) -> torch.Tensor:
    """A picture whose colours of Lab are scattered so about their mean."""
    chance = torch.Generator().manual_seed(seed)
    lab = torch.tensor(mean) + torch.tensor(spread) * (torch.rand(32 * 40, 3, generator=chance) - 0.5)
    return from_lab(lab).T.reshape(3, 32, 40)


def moments(picture: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    lab = to_lab(picture.flatten(1).T)
    return lab.mean(0), lab.T.cov()


BROWN = scattered((45.0, 12.0, 20.0), (30.0, 12.0, 12.0))
BLUE = scattered((55.0, -5.0, -20.0), (36.0, 16.0, 20.0), seed=1)


def test_a_picture_takes_on_the_mean_and_the_spread_of_a_styles_colors() -> None:
    goal = in_style_colors(Goal((ImageTerm(BROWN), StyleTerm(BLUE))))
    (mean, spread), (wanted_mean, wanted_spread) = moments(goal.terms[0].image), moments(BLUE)
    torch.testing.assert_close(mean, wanted_mean, atol=0.6, rtol=0)
    torch.testing.assert_close(spread, wanted_spread, atol=8.0, rtol=0.1)
    assert goal.terms[1].image is BLUE


def test_a_style_that_matters_less_moves_colors_less() -> None:
    whole = in_style_colors(Goal((ImageTerm(BROWN), StyleTerm(BLUE, 2.0)))).terms[0].image
    part = in_style_colors(Goal((ImageTerm(BROWN), StyleTerm(BLUE, 0.25)))).terms[0].image
    torch.testing.assert_close(part, 0.75 * BROWN + 0.25 * whole)


def test_only_what_is_painted_in_a_style_is_wanted_in_its_colors() -> None:
    words, picture = TextTerm("a lemon"), ImageTerm(BROWN)
    unstyled = Goal((words, picture))
    assert in_style_colors(unstyled) is unstyled
    other = ImageTerm(1 - BROWN)
    goal = in_style_colors(Goal((words, picture, StyleTerm(BLUE)), (ImageTerm(BROWN), other)))
    assert goal.terms[0] is words and goal.initial[1] is other, "what is only begun with stays as it is"
    assert goal.initial[0].image is goal.terms[1].image is not BROWN


def test_in_a_style_that_is_as_good_as_black_a_picture_can_still_be_told() -> None:
    night = scattered((4.0, 0.0, -3.0), (6.0, 4.0, 4.0), seed=3)
    contrasts = scattered((50.0, 0.0, 0.0), (90.0, 20.0, 20.0), seed=4)
    moved = to_lab(in_style_colors(Goal((ImageTerm(contrasts), StyleTerm(night)))).terms[0].image.flatten(1).T)[:, 0]
    before = to_lab(contrasts.flatten(1).T)[:, 0]
    assert 0.4 * float(before.std()) < float(moved.std()) < 0.6 * float(before.std())
    assert float(moved.mean()) < float(before.mean()) - 20


@given(gray=st.floats(0, 1), seed=st.integers(0, 99))
def test_pictures_of_a_single_color_become_one_of_the_styles(gray: float, seed: int) -> None:
    style = torch.rand(3, 20, 20, generator=torch.Generator().manual_seed(seed))
    moved = in_style_colors(Goal((ImageTerm(torch.full((3, 20, 24), gray)), StyleTerm(style)))).terms[0].image
    assert moved.shape == (3, 20, 24) and bool(((moved >= 0) & (moved <= 1)).all())
    assert float(moved.flatten(1).std(1).max()) < 1e-4
    torch.testing.assert_close(moments(moved)[0], moments(style)[0], atol=5.0, rtol=0)


def dusk() -> torch.Tensor:
    """A picture that is darkest on the left and lightest on the right."""
    return torch.linspace(0.05, 0.95, 80).expand(3, 64, 80).contiguous()


def striped(color: tuple[float, float, float], *, upright: bool) -> torch.Tensor:
    """A style: stripes of one colour, upright or level."""
    light = (torch.arange(60) // 5 % 2).float() * 0.5 + 0.5
    stripes = (light[None, :] if upright else light[:, None]).expand(60, 60)
    return torch.tensor(color)[:, None, None] * stripes


DEEP_BLUE = striped((0.1, 0.1, 0.6), upright=True)
RED = striped((1.0, 0.6, 0.5), upright=False)


def is_red(picture: torch.Tensor) -> torch.Tensor:
    return (picture[0] > picture[2]).float()


@pytest.mark.parametrize(("blue", "red"), [(1.0, 1.0), (1.0, 3.0), (3.0, 1.0)])
def test_the_darker_style_takes_the_darker_places_and_each_its_share(blue: float, red: float) -> None:
    goal = in_style_colors(Goal((ImageTerm(dusk()), StyleTerm(RED, red), StyleTerm(DEEP_BLUE, blue))))
    assert goal.terms[0].picture is not None
    reddish = is_red(goal.terms[0].picture)
    assert float(reddish.mean()) == pytest.approx(red / (red + blue), abs=0.1)
    assert float(reddish[:, :8].mean()) < 0.1 and float(reddish[:, -8:].mean()) > 0.9


def test_photographs_and_drawings_get_the_marks_of_all_styles() -> None:
    frame = torch.ones(3, 64, 80)
    frame[:, 8:56, 10:60] = 0
    frame[:, 14:50, 16:54] = 1
    styles = StyleTerm(DEEP_BLUE), StyleTerm(RED)
    for shown in (
        in_style_marks(in_style_colors(Goal((ImageTerm(dusk()), *styles)))).terms[0].picture,
        fill_drawing_in_style(Goal((SketchTerm(frame), *styles)), 64, 80).terms[-1].picture,
    ):
        assert shown is not None and shown.shape == (3, 64, 80)
        assert 0.1 < float(is_red(shown).mean()) < 0.9


def test_strokes_follow_each_style_at_its_places() -> None:
    even = torch.linspace(0.3, 0.7, 80).expand(3, 64, 80).contiguous()
    styled = in_style_marks(in_style_colors(Goal((ImageTerm(even), StyleTerm(DEEP_BLUE), StyleTerm(RED)))))
    found = brushwork_of(styled, PixelGrid.of_height(CANVAS, 64))
    assert found is not None
    turned = found[0]  # 1 along the x axis, -1 across it
    assert float(turned[:, :16].mean()) < 0 < float(turned[:, -16:].mean())
