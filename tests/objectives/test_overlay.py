import torch

from frida_painter import images
from frida_painter.frames import PixelGrid
from frida_painter.objectives.image import ImageTerm
from frida_painter.objectives.interpretation import prepare
from frida_painter.objectives.objective import Goal
from frida_painter.objectives.sketch import SketchTerm, draw_on_picture, overlaid
from frida_painter_words.text import TextTerm
from support.networks import QuickEncoders
from support.planning import CANVAS, picture

GRID = PixelGrid.of_height(CANVAS, 64)


def drawing() -> torch.Tensor:
    lines = torch.ones(3, 60, 80)
    lines[:, 28:32, 10:70] = 0
    return lines


def test_lines_are_dark_on_light_pictures_and_light_on_dark_ones() -> None:
    for gray, line in ((0.7, 0.0), (0.2, 1.0)):
        seen = draw_on_picture(torch.full((3, 60, 80), gray), drawing())
        assert torch.allclose(seen[:, 30, 40], torch.full((3,), line), atol=1e-3)
        assert torch.allclose(seen[:, 5, 40], torch.full((3,), gray), atol=1e-5)
    red = drawing()
    red[0] = 1
    assert torch.allclose(
        draw_on_picture(torch.full((3, 60, 80), 0.7), red)[:, 30, 40], torch.tensor([1.0, 0, 0]), atol=1e-3
    )


def test_a_sketch_beside_a_photograph_is_drawn_on_it_and_asks_for_the_edges_of_both() -> None:
    bare = images.fit(picture(), GRID.rows, GRID.columns)
    goal = overlaid(Goal((ImageTerm(bare), SketchTerm(drawing()), TextTerm("a line"))))
    photo, sketch, words = goal.terms
    assert isinstance(photo, ImageTerm) and isinstance(sketch, SketchTerm) and words == TextTerm("a line")
    assert sketch.shown is photo.image and not torch.equal(photo.image, bare)
    (drawn, asked) = prepare(Goal((photo, sketch)), GRID, QuickEncoders())._terms
    assert float(asked[1].objective(photo.image)) < float(asked[1].objective(bare))
    assert float(drawn[1].objective(photo.image)) < 1e-3


def test_nothing_is_drawn_where_there_is_no_photograph_or_no_sketch() -> None:
    for goal in (Goal((SketchTerm(drawing()),)), Goal((ImageTerm(picture()),))):
        assert overlaid(goal) is goal
