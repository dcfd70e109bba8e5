"""Photographs, scenes and drawings in the colours, values and marks of a style picture."""

import operator

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from frida_painter.objectives.image import ImageTerm
from frida_painter.objectives.objective import Goal
from frida_painter.objectives.sketch import SketchTerm
from frida_painter.objectives.style import StyleTerm
from frida_painter.objectives.style_marks import fill_drawing_in_style, in_style, in_style_marks, lay_marks, transport
from frida_painter.strokes.palette import to_lab


def stripes(rows: int = 96, columns: int = 128) -> torch.Tensor:
    """A style: dark blue and yellow stripes, slanting."""
    down, across = torch.meshgrid(torch.arange(rows), torch.arange(columns), indexing="ij")
    light = (((down + across) // 6) % 3 == 0).float()
    dark, bright = torch.tensor([0.1, 0.15, 0.5])[:, None, None], torch.tensor([0.95, 0.85, 0.3])[:, None, None]
    return torch.lerp(dark, bright, light)


def photograph() -> torch.Tensor:
    """A dark disc with sharp edges on an even gray."""
    down, across = torch.meshgrid(torch.arange(64.0), torch.arange(80.0), indexing="ij")
    disc = ((down - 32).square() + (across - 40).square()).sqrt() < 12
    return torch.where(disc, 0.15, 0.6).expand(3, -1, -1).contiguous()


@settings(max_examples=12, deadline=None)
@given(st.integers(30, 300), st.integers(30, 300), st.integers(0, 100))
def test_colours_are_distributed_as_those_that_are_wanted(many: int, wanted: int, seed: int) -> None:
    chance = torch.Generator().manual_seed(seed)
    aim = torch.rand(wanted, 3, generator=chance) * torch.tensor([60.0, 40.0, 20.0])
    moved = transport(torch.rand(many, 3, generator=chance) * 30, aim)
    torch.testing.assert_close(moved.mean(0), aim.mean(0), atol=3.0, rtol=0.1)
    torch.testing.assert_close(moved.std(0), aim.std(0), atol=3.0, rtol=0.25)


def test_even_areas_get_marks_and_colours_and_edges_stay() -> None:
    picture, style = photograph(), stripes()
    shown = lay_marks(picture, style)
    assert shown.shape == picture.shape and 0 <= float(shown.min()) <= float(shown.max()) <= 1
    lab = to_lab(shown.permute(1, 2, 0))
    even = lab[:, :16].flatten(0, 1)
    assert float(even[:, 0].std()) > 5, "marks"
    assert float(even[:, 1:].norm(dim=1).mean()) > 10, "colours, though the photograph has none"
    inside, around = lab[26:38, 34:46, 0].mean(), torch.cat((lab[:, 16:24, 0], lab[:, 56:64, 0])).mean()
    assert float(inside) < float(around) - 5, "the disc is still dark"


def test_faces_keep_their_picture() -> None:
    picture = torch.lerp(torch.tensor([0.9, 0.8, 0.2])[:, None, None], 1 - stripes(64, 80)[:, :1, :1], photograph())
    importance = torch.ones(16, 20)
    importance[4:12, 6:14] = 7.0
    free, kept = lay_marks(picture, stripes()), lay_marks(picture, stripes(), importance)
    inside = slice(22, 42), slice(30, 50)
    change = [float((one - picture)[:, inside[0], inside[1]].abs().mean()) for one in (kept, free)]
    assert change[0] < change[1]


def test_a_style_that_matters_less_changes_less() -> None:
    picture = photograph()
    (shown, _) = in_style_marks(Goal((ImageTerm(picture, 4.0), StyleTerm(stripes())))).terms
    wanted = torch.lerp(picture, lay_marks(picture, stripes()), 0.25)
    assert shown.picture is not None
    torch.testing.assert_close(shown.picture, wanted)
    assert shown.weight == pytest.approx(4.0 * 4.0**0.25), "it has more of the style, and may count more"
    (whole, _) = in_style_marks(Goal((ImageTerm(picture), StyleTerm(stripes(), 2.0)))).terms
    assert whole.weight == 4.0


def test_what_a_goal_begins_with_and_goals_without_a_style_stay() -> None:
    term = ImageTerm(photograph())
    unstyled, begun = Goal((term,)), Goal((term, StyleTerm(stripes())), (term,))
    assert in_style_marks(unstyled) is unstyled
    assert in_style_marks(begun).terms[0] is term


def scene() -> tuple[torch.Tensor, torch.Tensor]:
    """A brown square on bare paper, and its opacity."""
    where = torch.zeros(64, 80)
    where[20:50, 25:55] = 1.0
    picture = torch.ones(3, 64, 80)
    picture[:, where > 0] = torch.tensor([0.5, 0.35, 0.2])[:, None]
    picture[:, 28:36, 30:50] = 0.05
    return picture, where


def test_a_scene_on_bare_paper_takes_on_the_colours_and_the_marks_of_a_style() -> None:
    (picture, where), style = scene(), stripes()
    shown = in_style(picture, where, style)
    assert shown.shape == picture.shape and 0 <= float(shown.min()) <= float(shown.max()) <= 1
    ground = shown[:, where == 0]
    own = to_lab(style.flatten(1).T)[::40]
    assert float(torch.cdist(to_lab(ground.T), own).amin(1).median()) < 15, "the colours of the style"
    assert float(to_lab(shown[:, where == 0].T)[:, 0].std()) > 0.5 * float(own[:, 0].std()), "and its marks"
    assert float((shown - 1).abs().amax(0).amin()) > 0.03, "no paper is left"


def sheet() -> torch.Tensor:
    """A drawing: a black frame on white paper."""
    drawing = torch.ones(3, 64, 80)
    drawing[:, 20:50, 25:55] = 0
    drawing[:, 24:46, 29:51] = 1
    return drawing


def test_a_drawing_in_a_style_becomes_a_picture_without_paper_and_keeps_its_lines() -> None:
    goal = Goal((SketchTerm(sheet()), StyleTerm(stripes())))
    *given, made = fill_drawing_in_style(goal, 64, 80).terms
    assert all(map(operator.is_, given, goal.terms)) and isinstance(made, ImageTerm) and made.weight == 4.0
    lab = to_lab(made.image.permute(1, 2, 0))
    assert float((made.image - 1).abs().amax(0).amin()) > 0.03, "no paper is left"
    assert float(lab[:16, :, 0].std()) > 5, "marks"
    assert float(lab[21:24, 30:50, 0].mean()) < float(lab[28:42, 33:47, 0].mean()) - 20, "lines are dark"
    (begun,) = Goal((*given, made)).initial_terms
    assert begun is made, "the painting begins with it"


def test_a_drawing_is_not_filled_without_a_style_or_beside_another_picture() -> None:
    sketch, style, photo = SketchTerm(sheet()), StyleTerm(stripes()), ImageTerm(photograph())
    for goal in (Goal((sketch,)), Goal((sketch, style, photo)), Goal((sketch, style), (photo,))):
        assert fill_drawing_in_style(goal, 64, 80) is goal
