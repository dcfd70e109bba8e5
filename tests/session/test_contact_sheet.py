from dataclasses import replace

import numpy as np
import pytest

from frida_painter.brush.library import Flaw
from frida_painter_calibration.procedures.strokes import MAX_SHOWN, contact_sheet
from marks import small_library


def judged(count, dirty):
    flaws = np.zeros(count, np.uint8)
    flaws[list(dirty)] = list(dirty.values())
    few = small_library(20)[np.arange(count) % 20]
    return replace(few, flaws=flaws, recorded_index=np.arange(count, dtype=np.int32))


def test_the_sheet_looks_as_it_did_when_it_was_found_good(snapshot):
    snapshot("contact-sheet", contact_sheet(judged(12, {4: Flaw.EMPTY, 9: Flaw.TOUCHED}), "Strokes of the small brush"))


def redness(picture):
    return float(((picture[0] - picture[2]) > 0.08).float().mean())


def test_every_dirty_stroke_is_marked():
    none, one, two = (
        redness(contact_sheet(judged(12, dirty), "Strokes"))
        for dirty in ({}, {3: Flaw.TORN}, {3: Flaw.TORN, 4: Flaw.MOVED})
    )
    assert none < 0.001 < one < two


@pytest.mark.parametrize("count", [1, 3, 60])
def test_any_number_of_strokes_fits(count):
    picture = contact_sheet(judged(count, {}), "A title that is much longer than what the page is wide " * 4)
    assert picture.shape[0] == 3 and picture.shape[2] == 1800


def test_of_very_many_the_dirty_ones_are_all_shown():
    library = judged(2000, {1999: Flaw.TORN})
    assert contact_sheet(library, "Strokes").shape == contact_sheet(judged(MAX_SHOWN, {}), "Strokes").shape
    assert redness(contact_sheet(library, "Strokes")) > 0.0005
