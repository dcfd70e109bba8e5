from collections.abc import Callable

import pytest
import torch

from frida_painter.mixing import Finish
from frida_painter.mixing.paint import usual_paints
from frida_painter.mixing.recipe import PaintSet
from frida_painter.report.sheets import mixing_sheet
from frida_painter.strokes.palette import from_hex
from frida_painter.system.sheet import A4
from snapshots import shrunk

COLORS = torch.stack([from_hex(text) for text in ("#e9dccb", "#c9a27e", "#7d9a57", "#3a5f8a", "#802828", "#101010")])


@pytest.fixture(scope="module")
def found() -> list:
    return PaintSet(usual_paints(), Finish.matte, darkest=None).mix(COLORS)


def test_the_sheet_looks_as_it_was_found_good(found: list, snapshot: Callable[..., None]) -> None:
    sheet = mixing_sheet(found, [8.0, 6.5, 4.0, 3.0, 3.0, 11.0], "Mixing")
    snapshot("mixing-sheet", shrunk(sheet, 900))


def test_the_colours_wanted_stand_beside_those_predicted(found: list) -> None:
    sheet = mixing_sheet(found, None, "Mixing").permute(1, 2, 0).reshape(-1, 3)
    for recipe in found:
        for color in (recipe.target, recipe.color):
            assert int(((sheet - color).abs().amax(1) < 0.004).sum()) > 4000


def test_a_long_palette_makes_a_long_page(found: list) -> None:
    assert mixing_sheet(found * 8, None, "Mixing").shape[1] > 1754
    assert mixing_sheet(found[:1], None, "Mixing").shape[1:] == (1754, A4[0])
