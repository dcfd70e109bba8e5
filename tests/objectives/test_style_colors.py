import torch
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.objectives.image import ImageTerm
from frida_painter.objectives.objective import Goal
from frida_painter.objectives.semantic import SemanticTerm
from frida_painter.objectives.style import StyleTerm, in_style_colors
from frida_painter.palette import from_lab, to_lab
from frida_painter_words.text import TextTerm


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


def test_what_is_lighter_stays_lighter() -> None:
    moved = in_style_colors(Goal((SemanticTerm(BROWN), StyleTerm(BLUE)))).terms[0].image
    before, after = to_lab(BROWN.flatten(1).T)[:, 0], to_lab(moved.flatten(1).T)[:, 0]
    assert torch.stack((before, after)).corrcoef()[0, 1] > 0.8


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
