import torch

from frida_painter.frames import CanvasSize, PixelGrid
from frida_painter.goal import Goal
from frida_painter.objectives.interpretation import interpreted
from frida_painter.objectives.kinds.image import ImageTerm
from frida_painter.objectives.kinds.semantic import SemanticTerm
from frida_painter.objectives.kinds.sketch import SketchTerm
from frida_painter.objectives.kinds.style import StyleTerm
from frida_painter.objectives.kinds.text import TextTerm
from networks import QuickEncoders
from scenes import picture

GRID = PixelGrid.of_height(CanvasSize(0.12, 0.09), 64)
LINES = torch.ones(3, 64, 85)
LINES[:, 30:33, 10:70] = 0


def pursued(*terms) -> Goal:
    return interpreted(Goal(terms), GRID, QuickEncoders(), seed=0)


def test_a_picture_alone_is_painted_as_it_is() -> None:
    goal = Goal((ImageTerm(picture()),))
    assert interpreted(goal, GRID, QuickEncoders(), seed=0) is goal


def test_words_in_a_style_begin_with_a_picture_in_the_styles_colors() -> None:
    plain, styled = pursued(TextTerm("a lemon")), pursued(TextTerm("a lemon"), StyleTerm(1 - picture()))
    (first,), (instead,) = plain.initial, styled.initial
    assert instead.image is styled.terms[-1].image and not torch.equal(first.image, instead.image)


def test_a_sketch_is_drawn_on_its_photograph_before_the_photograph_takes_a_styles_colors() -> None:
    goal = pursued(ImageTerm(picture()), SketchTerm(LINES), StyleTerm(1 - picture()))
    wanted = goal.terms[0].image
    beside = pursued(ImageTerm(picture()), StyleTerm(1 - picture())).terms[0].image
    assert float((wanted - beside)[:, 30:33, 12:68].abs().mean()) > 2 * float((wanted - beside).abs().mean())


def test_meaning_in_a_style_is_attended_to_where_it_is() -> None:
    goal = pursued(SemanticTerm(picture()), StyleTerm(1 - picture()))
    (begun,) = goal.initial
    assert begun.importance is not None and begun.image is goal.terms[0].image
