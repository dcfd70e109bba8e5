from collections.abc import Callable

import pytest
import torch

from frida_painter.report.sheets import palette_sheet
from frida_painter.system.sheet import A4
from snapshots import shrunk
from support.plans import made_up_plan


@pytest.mark.parametrize("colors", [1, 2, 6, 7, 15, 16, 20, 21, 64])
def test_every_paint_has_a_swatch_and_nothing_leaves_the_page(colors: int) -> None:
    plan = made_up_plan(max(40, colors), colors)
    sheet = palette_sheet(plan)
    assert sheet.shape == (3, *reversed(A4))
    pixels = (sheet * 255).round().long().reshape(3, -1)
    codes = pixels[0] * 65536 + pixels[1] * 256 + pixels[2]
    for color in (plan.palette.color * 255).round().long().tolist():
        red, green, blue = color
        assert int((codes == red * 65536 + green * 256 + blue).sum()) > 2000
    margin = torch.ones(3, *reversed(A4), dtype=torch.bool)
    margin[:, 60:-40, 90:-90] = False
    assert bool((sheet[margin] == 1).all())


def test_cards(snapshot: Callable[..., None]) -> None:
    snapshot("palette-sheet-12", shrunk(palette_sheet(made_up_plan(60, 12), "Coffee"), 438))


def test_lines(snapshot: Callable[..., None]) -> None:
    snapshot("palette-sheet-40", shrunk(palette_sheet(made_up_plan(60, 40), "Coffee"), 438))


def test_a_title_too_long_for_the_page_is_cut() -> None:
    sheet = palette_sheet(made_up_plan(), "a very long name of a photograph " * 5)
    assert bool((sheet[:, :, -90:] == 1).all())
