import cv2
import numpy as np
import pytest
import torch

from frida_painter.perception.color import EDITIONS, PATCHES, find_checker, read_checker, true_colors
from frida_painter.strokes.palette import difference
from frida_painter.system.images import to_srgb

# sRGB bytes that the maker published for the first and the last row.
PUBLISHED = {0: (115, 82, 68), 1: (194, 150, 130), 5: (103, 189, 170), 18: (243, 243, 242), 21: (122, 122, 121)}
# Where the corner patches' middles lie on the card drawn below: dark brown, turquoise, black, white.
MIDDLES = np.array([(60, 60), (360, 60), (360, 240), (60, 240)], np.float64)


def card(edition=EDITIONS[0]):
    """A chart drawn straight on, sRGB bytes [300, 420, 3], 60 pixels from patch to patch."""
    picture = np.full((300, 420, 3), 30, np.uint8)
    colors = (255 * to_srgb(true_colors(edition))).round().to(torch.uint8).numpy()
    for number, color in enumerate(colors):
        row, column = divmod(number, 6)
        top, left = 60 * row + 35, 60 * column + 35
        picture[top : top + 50, left : left + 50] = color
    return picture


def on_table(turn=0.0, slant=0.0, light=1.0):
    """A photograph [480, 640, 3] of it, and where the corner patches' middles are."""
    cos, sin = np.cos(turn), np.sin(turn)
    around = np.array([(0, 0), (420, 0), (420, 300), (0, 300)], np.float32)
    placed = (around - (210, 150)) @ np.array([[cos, sin], [-sin, cos]]) * 1.05
    placed = placed / (1 + slant * placed[:, :1] / 420) + (320, 240)
    view = cv2.getPerspectiveTransform(around, placed.astype(np.float32))
    table = np.full((480, 640, 3), (225, 222, 215), np.uint8)
    cv2.warpPerspective(card(), view, (640, 480), table, cv2.INTER_AREA, cv2.BORDER_TRANSPARENT)
    return (table * light).astype(np.uint8), cv2.perspectiveTransform(MIDDLES[None], view)[0]


@pytest.mark.parametrize("edition", EDITIONS)
def test_true_colours_are_near_those_that_the_maker_gives_in_srgb(edition):
    true = to_srgb(true_colors(edition))
    assert true.shape == (PATCHES, 3)
    for number, published in PUBLISHED.items():
        assert float(difference(true[number], torch.tensor(published) / 255)) < 3.6


def test_greys_are_grey_and_ordered_and_the_cyan_that_no_screen_shows_is_brought_into_srgb():
    true = true_colors(EDITIONS[0])
    greys = true[18:]
    assert (greys.diff(dim=0) < 0).all()
    assert float((greys.std(1) / greys.mean(1)).max()) < 0.06
    assert float(true[17, 0]) == 0


@pytest.mark.parametrize("turn", [0.0, 0.3, np.pi, np.pi / 2 + 0.2, -np.pi / 2])
def test_a_chart_is_found_however_it_is_turned_and_its_first_patch_is_known(turn):
    photograph, middles = on_table(turn, slant=0.15)
    found = find_checker(photograph)
    assert found is not None
    assert np.abs(np.array(found) - middles).max() < 5  # of 60 from patch to patch
    readings = read_checker(photograph, found)
    assert float(difference(to_srgb(readings.light), to_srgb(true_colors(EDITIONS[0]))).max()) < 1.5


def test_a_chart_in_dim_light_is_found_and_an_empty_table_has_none():
    assert find_checker(on_table(light=0.3)[0]) is not None
    assert find_checker(np.full((480, 640, 3), 225, np.uint8)) is None


def test_readings_say_where_they_were_taken_and_how_even_and_how_bright_they_were():
    photograph, middles = on_table(slant=0.1)
    clean = read_checker(photograph, tuple(map(tuple, middles)))
    assert clean.place.shape == (PATCHES, 2)
    assert np.abs(clean.place[[0, 5, 23, 18]].numpy() - middles).max() < 1e-3
    assert float(clean.unevenness.max()) < 0.02
    assert float(clean.blown_out.max()) == 0
    column, row = clean.place[8].round().int().tolist()
    photograph[row - 6 : row + 7, column - 6 : column + 7] = 255
    glossy = read_checker(photograph, tuple(map(tuple, middles)))
    assert int(glossy.blown_out.argmax()) == int(glossy.unevenness.argmax()) == 8
    assert float(glossy.blown_out[8]) > 0.1
    assert float(glossy.unevenness[8]) > 0.2
    assert float(glossy.blown_out.sum()) == float(glossy.blown_out[8])
