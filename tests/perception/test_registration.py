"""Registration of photographs that OpenCV warps by itself: a canvas on a table, painted and moved."""

import math

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from frida_painter.calibration import Calibration
from frida_painter.canvas_size import CanvasSize
from frida_painter.perception.registration import MAX_SHIFT, CanvasShift, CanvasView, Verdict, register

SIZE = CanvasSize(0.2, 0.15)
PIXELS = 2000.0  # per metre of the canvas
CORNERS = ((100.0, 80.0), (500.0, 80.0), (500.0, 380.0), (100.0, 380.0))
RECORD = Calibration(
    easel="an easel", brush="broad", corners=CORNERS, photograph=(460, 600), touch_height=0.0, press_height=-0.004,
    protrusion=0.0, camera="a camera", canvas=SIZE,
)  # fmt: skip
VIEW = CanvasView.of(RECORD, SIZE)
MIDDLE = (300.0, 230.0)
TABLE = (104, 99, 92)


def canvas(ground=245, strokes=0, seed=0):
    """The canvas alone [300, 400, 3], with a few broad strokes that know nothing of any renderer."""
    random = np.random.default_rng(seed)
    image = np.full((300, 400, 3), ground, np.uint8)
    for _ in range(strokes):
        start, end = random.integers((0, 0), (400, 300), (2, 2)).tolist()
        cv2.line(image, start, end, random.integers(20, 220, 3).tolist(), 16, cv2.LINE_AA)
    return image


def photograph(picture, right=0.0, down=0.0, turn=0.0, growth=1.0, light=1.0, seed=0):
    """It on a table, warped by metres, radians and a factor, in that light, with noise."""
    random = np.random.default_rng(seed)
    cos, sin = growth * math.cos(turn), growth * math.sin(turn)
    turned = np.array([[cos, -sin], [sin, cos]])
    offset = np.array(MIDDLE) + PIXELS * np.array([right, down]) - turned @ (200.0, 150.0)
    warp = np.c_[turned, offset]
    table = np.full((460, 600, 3), TABLE, np.uint8)
    laid = cv2.warpAffine(picture, warp, (600, 460), flags=cv2.INTER_CUBIC)
    there = cv2.warpAffine(np.ones((300, 400), np.float32), warp, (600, 460))[..., None]
    seen = cv2.GaussianBlur(there * laid + (1 - there) * table, (0, 0), 0.7)
    return np.clip(light * seen + random.normal(0, 2, seen.shape), 0, 255).astype(np.uint8)


def judged(seen, before, strokes=None):
    return register(VIEW, VIEW.light(seen), VIEW.light(before), strokes)


def linear(picture):
    """Linear light of a canvas in the view's grid, as a planner would foretell it."""
    shrunk = cv2.resize(picture, (VIEW.grid.columns, VIEW.grid.rows), interpolation=cv2.INTER_AREA)
    return ((shrunk / 255.0) ** 2.2).astype(np.float32)


@settings(max_examples=6, deadline=None)
@given(
    shift=st.floats(0.0015, 0.006), angle=st.floats(0, 2 * math.pi), turn=st.floats(-0.02, 0.02),
    strokes=st.sampled_from([0, 40]), light=st.floats(0.8, 1.05),
)  # fmt: skip
def test_a_motion_is_found_and_measured_whatever_the_light(shift, angle, turn, strokes, light):
    picture = canvas(strokes=strokes)
    right, down = shift * math.cos(angle), shift * math.sin(angle)
    found = judged(photograph(picture, right, down, turn, light=light, seed=1), photograph(picture))
    assert found.verdict is Verdict.MOVED
    assert (found.motion.right, found.motion.down) == pytest.approx((right, down), abs=3e-4)
    assert found.motion.turn == pytest.approx(turn, abs=2e-3)


@settings(max_examples=6, deadline=None)
@given(
    shift=st.floats(0, 0.0006), angle=st.floats(0, 2 * math.pi), strokes=st.sampled_from([0, 40]),
    light=st.floats(0.8, 1.05), seed=st.integers(1, 1000),
)  # fmt: skip
def test_a_canvas_that_hardly_moved_lies_still_whatever_the_light(shift, angle, strokes, light, seed):
    picture = canvas(strokes=strokes)
    right, down = shift * math.cos(angle), shift * math.sin(angle)
    found = judged(photograph(picture, right, down, light=light, seed=seed), photograph(picture))
    assert found.verdict is Verdict.STILL
    assert found.motion.corner_shift(SIZE) < MAX_SHIFT


def framed(picture, gap, color):
    """With paint all round, up to so many pixels from the edge."""
    painted = picture.copy()
    cv2.rectangle(painted, (gap + 8, gap + 8), (399 - gap - 8, 299 - gap - 8), color, 16)
    return painted


@pytest.mark.parametrize("color", [(12, 12, 12), (250, 250, 250), TABLE, (30, 40, 160)])
@pytest.mark.parametrize("gap", [0, 4, 8])
def test_paint_along_all_edges_moves_nothing_and_hides_no_motion(gap, color):
    before, after = canvas(ground=200), framed(canvas(ground=200), gap, color)
    strokes = linear(before), linear(framed(before, 0, color))  # as foretold, without the gap
    lying = judged(photograph(after, seed=1), photograph(before), strokes).verdict
    if gap == 0 and color == TABLE:  # no edge is left to be seen
        assert lying is not Verdict.MOVED
        return
    assert lying is Verdict.STILL
    moved = judged(photograph(after, 0.002, -0.0015, seed=1), photograph(before), strokes)
    assert moved.verdict is not Verdict.STILL


def test_a_lens_that_was_turned_is_a_motion():
    picture = canvas(strokes=40)
    found = judged(photograph(picture, growth=1.04, seed=1), photograph(picture))
    assert found.verdict is Verdict.MOVED
    assert found.motion.growth == pytest.approx(math.log(1.04), abs=2e-3)


def test_what_a_canvas_moved_before_counts_as_well():
    picture, drift = canvas(strokes=40), CanvasShift(right=0.0009)
    before, seen = photograph(picture), photograph(picture, 0.0009, seed=1)
    assert judged(seen, before).verdict is Verdict.STILL
    assert register(VIEW, VIEW.light(seen), VIEW.light(before), None, drift).verdict is Verdict.MOVED


def test_a_canvas_that_is_gone_does_not_lie_still_and_one_never_seen_is_not_asked_about():
    table = np.full((460, 600, 3), TABLE, np.uint8)
    assert judged(table, photograph(canvas())).verdict is not Verdict.STILL
    assert judged(table, table).verdict is Verdict.STILL
