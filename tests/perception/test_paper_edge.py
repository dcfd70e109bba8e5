import math

import cv2
import numpy as np
import pytest

from frida_painter.perception.registration import PaperEdge

CORNERS = ((60.0, 50.0), (338.0, 56.0), (330.0, 246.0), (66.0, 240.0))
REACH = 18.0


def photograph(shift=(0.0, 0.0), turn=0.0, blur=0.8, paper=235, table=110, seed=0):
    """A sheet on a table with two strokes near its edges."""
    corners = np.array(CORNERS)
    middle = corners.mean(0)
    cos, sin = math.cos(turn), math.sin(turn)
    moved = (corners - middle) @ np.array([[cos, sin], [-sin, cos]]) + middle + shift
    fine = np.full((1200, 1600, 3), table, np.uint8)
    cv2.fillConvexPoly(fine, np.rint(16 * (4 * moved + 1.5)).astype(np.int32), (paper,) * 3, cv2.LINE_AA, 4)
    for start, end in (((75, 70), (140, 75)), ((200, 232), (260, 228))):
        line = [np.rint(16 * (4 * (np.array(point) + shift) + 1.5)).astype(int).tolist() for point in (start, end)]
        cv2.line(fine, *line, (20, 20, 20), 24, cv2.LINE_AA, 4)
    seen = cv2.resize(fine, (400, 300), interpolation=cv2.INTER_AREA).astype(np.float32)
    seen = cv2.GaussianBlur(seen, (0, 0), blur)
    noise = np.random.default_rng(seed).normal(0, 2, seen.shape)
    return np.clip(seen + noise, 0, 255).astype(np.uint8)


def read(**kwargs):
    return PaperEdge.read(photograph(**kwargs), CORNERS, REACH)


def test_a_paper_that_lies_still_is_seen_to_lie_still_also_in_other_light():
    first = read()
    assert first.visible and first.beside < 0.5
    assert read(seed=1).moved_since(first) < 0.15
    assert read(paper=150, table=70, seed=1).moved_since(first) < 0.4


@pytest.mark.parametrize("shift", [(2.0, 0.0), (0.0, -3.0), (6.0, 5.0), (-9.0, 4.0)])
def test_a_shift_is_measured(shift):
    assert read(shift=shift, seed=1).moved_since(read()) == pytest.approx(math.hypot(*shift), abs=0.4)


def test_a_turn_is_measured_at_the_corners():
    reach = max(math.dist(corner, np.mean(CORNERS, 0)) for corner in CORNERS)
    assert read(turn=0.03).moved_since(read()) == pytest.approx(0.03 * reach, rel=0.15)


def test_blur_shows_in_the_softness_alone():
    first, blurred = read(), read(blur=4.0)
    assert blurred.softness == pytest.approx(1.68 * 4.0, rel=0.2) and first.softness < 0.45 * blurred.softness
    assert blurred.moved_since(first) < 0.8 and blurred.blurring_since(first) > 3


def test_a_paper_that_is_gone_has_moved_infinitely_far_and_one_never_seen_tells_nothing():
    away, unseen = read(shift=(60.0, 0.0)), read(table=232)
    assert not away.visible and away.moved_since(read()) == math.inf
    assert not unseen.visible and math.isnan(unseen.softness)
    assert math.isnan(unseen.beside) and math.isnan(read().moved_since(unseen))
