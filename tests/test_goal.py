import math

import pytest
import torch

from frida_painter.errors import ConfigError
from frida_painter.goal import Goal, ImageTerm, SemanticTerm, StyleTerm
from scenes import picture


@pytest.mark.parametrize("kind", [ImageTerm, SemanticTerm, StyleTerm])
@pytest.mark.parametrize("weight", [0.0, -1.0, math.nan, math.inf])
def test_weights_are_above_zero_and_finite(kind: type, weight: float) -> None:
    with pytest.raises(ConfigError, match="weights are above 0 and finite"):
        kind(picture(), weight)


def test_a_single_color_has_no_style() -> None:
    with pytest.raises(ConfigError, match="no style"):
        StyleTerm(torch.full((3, 20, 20), 0.3))


def test_a_plan_begins_with_what_it_is_told_or_else_with_the_pictures() -> None:
    image, style, first = ImageTerm(picture()), StyleTerm(picture(), 2.0), ImageTerm(1 - picture())
    alone = Goal((image,))
    assert alone.opening is alone.terms
    assert Goal((style, image)).opening == (image,)
    assert Goal((style, image), (first,)).opening == (first,)
    (opening,) = Goal((style,)).opening
    assert isinstance(opening, ImageTerm) and opening.image is style.image
    (opening,) = Goal((style, SemanticTerm(image.image, 2.0))).opening
    assert isinstance(opening, ImageTerm) and opening.image is image.image
