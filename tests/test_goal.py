import math

import pytest
import torch

from frida_painter.errors import ConfigError
from frida_painter.objectives.image import ImageTerm
from frida_painter.objectives.objective import Goal
from frida_painter.objectives.semantic import SemanticTerm
from frida_painter.objectives.sketch import SketchTerm
from frida_painter.objectives.style import StyleTerm
from frida_painter_words.text import TextTerm
from support.planning import picture


@pytest.mark.parametrize("kind", [ImageTerm, SemanticTerm, SketchTerm, StyleTerm])
@pytest.mark.parametrize("weight", [0.0, -1.0, math.nan, math.inf])
def test_weights_are_above_zero_and_finite(kind: type, weight: float) -> None:
    with pytest.raises(ConfigError, match="weights are above 0 and finite"):
        kind(picture(), weight)


def test_a_single_color_has_no_style() -> None:
    with pytest.raises(ConfigError, match="no style"):
        StyleTerm(torch.full((3, 20, 20), 0.3))


@pytest.mark.parametrize("value", [1.0, 0.5, 0.02])
def test_paper_without_a_line_is_no_sketch(value: float) -> None:
    with pytest.raises(ConfigError, match="without a single line"):
        SketchTerm(torch.full((3, 60, 80), value))


def test_sketches_are_begun_with_in_broad_lines() -> None:
    lines = torch.ones(3, 240, 300)
    lines[:, 120, 30:270] = 0
    sketch = SketchTerm(lines, 2.0)
    (alone,) = Goal((sketch,)).initial_terms
    assert alone.weight == 2 and torch.equal(alone.image, sketch.drawing)
    assert float(sketch.drawing[:, 118:123, 60:240].max()) < 0.1, "as broad as brushes paint"
    image = ImageTerm(picture())
    assert Goal((sketch, image)).initial_terms == (image,)


def test_a_plan_begins_with_what_it_is_told_or_else_with_the_pictures() -> None:
    image, style, first = ImageTerm(picture()), StyleTerm(picture(), 2.0), ImageTerm(1 - picture())
    alone = Goal((image,))
    assert alone.initial_terms is alone.terms
    assert Goal((style, image)).initial_terms == (image,)
    assert Goal((style, image), (first,)).initial_terms == (first,)
    (opening,) = Goal((style,)).initial_terms
    assert isinstance(opening, ImageTerm) and opening.image is style.image
    (opening,) = Goal((style, SemanticTerm(image.image, 2.0))).initial_terms
    assert isinstance(opening, ImageTerm) and opening.image is image.image


def test_words_say_something_and_have_a_weight() -> None:
    with pytest.raises(ConfigError, match="are empty"):
        TextTerm(" ")
    with pytest.raises(ConfigError, match="above 0 and finite"):
        TextTerm("a ship", math.nan)
    assert Goal((TextTerm("a ship"),)).initial_terms == (TextTerm("a ship"),)
