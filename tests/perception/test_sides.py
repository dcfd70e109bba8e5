import math

import cv2
import numpy as np
import pytest

from frida_painter.perception.landmarks import trace_outline
from frida_painter.perception.registration import find_widening, trace_sides

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
    return trace_outline(photograph(**kwargs), CORNERS, REACH)


def away(one, other):
    return float(np.linalg.norm(np.subtract(one.corners, other.corners), axis=1).max())


def test_a_paper_that_lies_still_is_seen_to_lie_still_also_in_other_light():
    first = read()
    assert first.support > 0.5 and np.abs(np.subtract(first.corners, CORNERS)).max() < 0.5
    assert away(read(seed=1), first) < 0.15
    assert away(read(paper=150, table=70, seed=1), first) < 0.4


@pytest.mark.parametrize("shift", [(2.0, 0.0), (0.0, -3.0), (6.0, 5.0), (-9.0, 4.0)])
def test_a_shift_is_measured(shift):
    assert away(read(shift=shift, seed=1), read()) == pytest.approx(math.hypot(*shift), abs=0.4)


def test_a_turn_is_measured_at_the_corners():
    reach = max(math.dist(corner, np.mean(CORNERS, 0)) for corner in CORNERS)
    assert away(read(turn=0.03), read()) == pytest.approx(0.03 * reach, rel=0.15)


def test_blur_shows_in_the_softness_alone():
    first, blurred = read(), read(blur=4.0)
    assert blurred.softness == pytest.approx(1.68 * 4.0, rel=0.2) and first.softness < 0.45 * blurred.softness


def test_paint_beside_most_of_the_edge_is_no_blur():
    first, painted = photograph(), photograph(seed=1)
    inner = [np.array(CORNERS).mean(0) * (1 - at) + np.array(CORNERS) * at for at in (0.97, 0.86)]
    band = np.zeros(painted.shape[:2], np.uint8)
    cv2.fillConvexPoly(band, np.rint(inner[0]).astype(np.int32), 1)
    cv2.fillConvexPoly(band, np.rint(inner[1]).astype(np.int32), 0)
    band[:, 230:] = 0  # of three sides, a part stays bare
    painted[band > 0] = (150, 60, 40)
    widths = [trace_sides(each, CORNERS, REACH).widths for each in (first, painted, photograph(blur=4.0))]
    assert abs(find_widening(widths[1], widths[0])) < 0.5 and find_widening(widths[2], widths[0]) > 3


def test_a_paper_that_is_gone_and_one_of_the_tables_colour_are_not_seen():
    assert read(shift=(60.0, 0.0)) is None and read(table=235) is None
