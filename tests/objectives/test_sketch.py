import pytest
import torch

from frida_painter.frames import PixelGrid
from frida_painter.objectives.image import ImageTerm
from frida_painter.objectives.interpretation import prepare
from frida_painter.objectives.objective import Goal
from frida_painter.objectives.sketch import Sketch, SketchTerm, draw_on_picture, overlaid
from frida_painter.system import images
from frida_painter_words.text import TextTerm
from support.networks import QuickEncoders, QuickHed
from support.planning import CANVAS, picture


def drawing(shift: int = 0, rows: int = 96, columns: int = 128) -> torch.Tensor:
    """A dark upright line on white, so many pixels from the middle."""
    paper = torch.ones(3, rows, columns)
    middle = columns // 2 + shift
    paper[:, 16 : rows - 16, middle - 2 : middle + 2] = 0.1
    return paper


def distance(picture: torch.Tensor) -> float:
    with torch.no_grad():
        return float(Sketch(drawing(), QuickHed())(picture))


def test_the_drawing_itself_is_perfect_and_bare_paper_is_not() -> None:
    assert distance(drawing()) < 1e-7
    assert distance(torch.ones(3, 96, 128)) == pytest.approx(0.05, rel=1e-3), "the whole balance, relative to itself"


def test_colors_do_not_matter_but_places_do() -> None:
    blue = 1 - (1 - drawing()) * torch.tensor([1.0, 1.0, 0.99])[:, None, None]
    assert distance(blue) < 0.1 * distance(drawing(40))
    near, further, far = (distance(drawing(shift)) for shift in (2, 6, 20))
    assert near < further < far, "a line that is a little off is nearly right"


def test_descending_it_brings_a_line_to_where_it_is_drawn() -> None:
    objective = Sketch(drawing(), QuickHed())
    shift = torch.tensor(8.0, requires_grad=True)
    x = torch.arange(128.0)
    rows = ((torch.arange(96) >= 16) & (torch.arange(96) < 80)).float()[:, None]

    def painted() -> torch.Tensor:
        line = 0.9 * torch.sigmoid(2.5 - (x - 63.5 - shift).abs()) * rows
        return (1 - line).expand(3, -1, -1)

    adam = torch.optim.Adam([shift], lr=0.5)
    for _ in range(40):
        adam.zero_grad()
        objective(painted()).backward()
        adam.step()
    assert abs(shift.item()) < 1.0


def test_edges_are_looked_for_seldom_only_where_pixels_hold_the_picture_meanwhile() -> None:
    grid, photo = PixelGrid.of_height(CANVAS, 48), ImageTerm(torch.full((3, 96, 128), 0.6))
    alone, beside = (
        prepare(Goal((*others, SketchTerm(drawing()))), grid, QuickEncoders()) for others in ((), (photo,))
    )
    assert alone.sparing is None
    assert beside.sparing is not None and beside.sparing().lasts > 1 and beside.sparing().smooth


GRID = PixelGrid.of_height(CANVAS, 64)


def level_line() -> torch.Tensor:
    lines = torch.ones(3, 60, 80)
    lines[:, 28:32, 10:70] = 0
    return lines


def test_lines_are_dark_on_light_pictures_and_light_on_dark_ones() -> None:
    for gray, line in ((0.7, 0.0), (0.2, 1.0)):
        seen = draw_on_picture(torch.full((3, 60, 80), gray), level_line())
        assert torch.allclose(seen[:, 30, 40], torch.full((3,), line), atol=1e-3)
        assert torch.allclose(seen[:, 5, 40], torch.full((3,), gray), atol=1e-5)
    red = level_line()
    red[0] = 1
    assert torch.allclose(
        draw_on_picture(torch.full((3, 60, 80), 0.7), red)[:, 30, 40], torch.tensor([1.0, 0, 0]), atol=1e-3
    )


def test_a_sketch_beside_a_photograph_is_drawn_on_it_and_asks_for_the_edges_of_both() -> None:
    bare = images.fit(picture(), GRID.rows, GRID.columns)
    goal = overlaid(Goal((ImageTerm(bare), SketchTerm(level_line()), TextTerm("a line"))))
    photo, sketch, words = goal.terms
    assert isinstance(photo, ImageTerm) and isinstance(sketch, SketchTerm) and words == TextTerm("a line")
    assert sketch.shown is photo.image and not torch.equal(photo.image, bare)
    (drawn, asked) = prepare(Goal((photo, sketch)), GRID, QuickEncoders())._terms
    assert float(asked[1].objective(photo.image)) < float(asked[1].objective(bare))
    assert float(drawn[1].objective(photo.image)) < 1e-3
