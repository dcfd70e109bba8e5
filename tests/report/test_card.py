"""The framed card of a photograph and its painting."""

import numpy as np
import pytest

from frida_painter.report.sheets import card


@pytest.mark.parametrize(("rows", "columns"), [(300, 450), (450, 300), (200, 200), (40, 400)])
def test_both_pictures_are_on_the_card_whole_and_as_large_as_each_other(rows: int, columns: int) -> None:
    red, blue = (np.full((rows, columns, 3), color, np.uint8) for color in ((200, 20, 20), (20, 20, 200)))
    made = (card([red, blue], "A cup", "300 strokes") * 255).round().int().numpy()
    assert max(made.shape) >= 1500
    places = [np.argwhere((made == np.array(color)[:, None, None]).all(0)) for color in ((200, 20, 20), (20, 20, 200))]
    (first, first_end), (second, second_end) = ((place.min(0), place.max(0) + 1) for place in places)
    assert (first_end - first == second_end - second).all() and max(first_end - first) == 1300
    axis = 1 if rows > columns else 0
    assert first_end[axis] < second[axis], "the photograph comes first"
    assert (np.concatenate([first, second]) > 100).all()


def test_a_card_for_words_has_one_picture_and_a_long_title_is_cut() -> None:
    made = card([np.zeros((60, 90, 3), np.uint8)], "a fox in the snow " * 20, "1 stroke")
    assert made.shape[2] >= 1500
    edge = made[:, 40:-40, 34:130]
    assert float((edge - edge[:, :1, :1]).abs().max()) < 0.01, "no letter on the mount's edge"
