from dataclasses import replace

import numpy as np
import pytest

from frida_painter.brush.kinds import painted_area
from frida_painter.brush.library import Flaw, StrokeLibrary, estimate_dip
from marks import SMALL, small_library

COUNT = 60
WHOLE = small_library(COUNT)
AREAS = painted_area(*(part for part in WHOLE.shapes()[1::-1]), SMALL.width).numpy().astype(np.float64)


def fading(holds: float, every: int = 3, noise: float = 0.05) -> StrokeLibrary:
    """A library whose brush was dipped before each `every`-th stroke, and pales once it has painted `holds` m2."""
    since = np.concatenate([np.cumsum(np.r_[0, AREAS[first : first + every - 1]]) for first in range(0, COUNT, every)])
    left = np.clip(2.0 - (since + AREAS) / holds, 0.1, 1.0)
    left *= 1 + noise * np.random.default_rng(0).standard_normal(COUNT)
    magnitude = np.clip(WHOLE.magnitude * left[:, None, None], 0, 255).astype(np.uint8)
    return replace(
        WHOLE, magnitude=magnitude, since_dip=since.astype(np.float32), flaws=np.zeros(COUNT, np.uint8)
    )  # fmt: skip


@pytest.mark.parametrize("strokes", [1.3, 1.8])
def test_what_a_dip_holds_shows_where_strokes_fade(strokes: float) -> None:
    holds = strokes * float(AREAS.mean())
    found = estimate_dip(fading(holds), SMALL.width)
    assert found is not None and not found.by_strokes
    assert 0.85 * holds < found.holds < 1.5 * holds, found.holds / holds
    assert 0 <= found.fades <= 0.3


def test_of_a_brush_that_never_fades_it_is_known_for_as_long_as_it_was_tried() -> None:
    library = fading(1.0)
    assert library.since_dip is not None
    found = estimate_dip(library, SMALL.width)
    assert found is not None and found.holds == pytest.approx(float((library.since_dip + AREAS).max()), rel=1e-3)


def test_dirt_that_is_no_lack_of_paint_tells_nothing() -> None:
    clean = fading(1.5 * float(AREAS.mean()))
    flaws, magnitude = clean.flaws.copy(), clean.magnitude.copy()
    flaws[1::9], magnitude[1::9] = Flaw.DISTURBED, 255
    assert estimate_dip(clean, SMALL.width) is not None
    spoiled = estimate_dip(replace(clean, flaws=flaws, magnitude=magnitude), SMALL.width)
    assert spoiled is not None and spoiled.holds == pytest.approx(estimate_dip(clean, SMALL.width).holds, rel=0.25)


def test_a_library_that_does_not_show_it_is_not_believed() -> None:
    assert estimate_dip(WHOLE, SMALL.width) is None, "nothing is known of its dips"
    assert estimate_dip(fading(1.0, every=1), SMALL.width) is None, "every stroke had a dip of its own"
    assert estimate_dip(fading(1e-4)[np.arange(20)], SMALL.width) is None, "too few strokes"
