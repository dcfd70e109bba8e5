"""Height maps: what is between the points, what is refused, and that strokes follow them."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.calibration import MAX_UNEVENNESS, Calibration, SurfaceMap
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import CalibrationError
from frida_painter.hardware.gateway import MotionLimits, Surface
from frida_painter.hardware.motion import Motion
from frida_painter.hardware.robot import Waypoints
from frida_painter.strokes.strokes import Strokes
from support.easel import CALIBRATION, WORKSPACE

SIZE = CanvasSize(0.3, 0.2)
LINES = (0.0, 0.15, 0.3), (0.0, 0.1, 0.2)
numbers = st.floats(-0.01, 0.01)


def plane(a: float, b: float, c: float, inset: float = 0.01) -> SurfaceMap:
    across, up = np.linspace(inset, SIZE.width - inset, 3), np.linspace(inset, SIZE.height - inset, 3)
    offset = a + b * across[None] + c * up[:, None]
    return SurfaceMap.of_points(SIZE, across.tolist(), up.tolist(), offset)


@given(st.floats(-0.005, 0.005), st.floats(-0.02, 0.02), st.floats(-0.02, 0.02), st.integers(0, 2**32 - 1))
def test_a_tilted_canvas_is_followed_exactly_to_its_edges(a: float, b: float, c: float, seed: int) -> None:
    places = np.random.default_rng(seed).random((20, 2)) * (SIZE.width, SIZE.height)
    found = plane(a, b, c).at(places)
    assert np.allclose(found, a + b * places[:, 0] + c * places[:, 1], atol=3e-6)


@given(st.lists(st.lists(numbers, min_size=3, max_size=3), min_size=3, max_size=3))
def test_the_points_have_their_own_heights_and_none_lies_beyond_them(rows: list[list[float]]) -> None:
    known = SurfaceMap(*LINES, tuple(map(tuple, rows)))
    grid = np.array([(x, y) for y in LINES[1] for x in LINES[0]])
    assert np.allclose(known.at(grid), np.array(rows).ravel(), atol=1e-12)
    beyond = known.at(np.array([(-1.0, -1.0), (9.0, 9.0)]))
    assert np.allclose(beyond, (rows[0][0], rows[2][2]))
    inside = known.at(np.random.default_rng(0).random((50, 2)) * (0.3, 0.2))
    assert (inside <= known.highest + 1e-12).all() and (inside >= known.lowest - 1e-12).all()


FLAT = ((0.0,) * 3,) * 3


@pytest.mark.parametrize(
    ("across", "offset", "said"),
    [
        (LINES[0], (*FLAT[:2], (0.0, math.nan, 0.0)), "has a hole at 150, 200 mm"),
        (LINES[0], FLAT[:2], "needs 3 rows of 3"),
        (LINES[0], (*FLAT[:2], (0.0, 0.0)), "needs 3 rows of 3"),
        (LINES[0], (*FLAT[:2], (0.0, 0.0, 2 * MAX_UNEVENNESS)), "says 40.0 mm at 300, 200 mm"),
        (LINES[0], (*FLAT[:2], (0.0, 0.0, math.inf)), "has a hole"),
        ((0.0, 0.3, 0.15), FLAT, "ascending"),
        ((0.0, math.nan, 0.3), FLAT, "ascending"),
        ((0.0,), ((0.0,),) * 3, "ascending"),
        ((0.0, 0.001, 0.3), (*FLAT[:2], (0.0, 0.001, 0.0)), "a step of 1000 mm per metre"),
    ],
)
def test_a_map_that_cannot_be_true_is_refused(across: tuple, offset: tuple, said: str) -> None:
    with pytest.raises(CalibrationError, match=said):
        SurfaceMap(across, LINES[1], offset)


def test_a_map_smaller_than_the_canvas_is_refused() -> None:
    small = SurfaceMap((0.0, 0.2), (0.0, 0.2), ((0.0, 0.0),) * 2)
    with pytest.raises(CalibrationError, match=r"from 0 to 200 mm across .* the canvas is 300 x 200 mm"):
        replace(CALIBRATION, canvas=SIZE, surface=small)


def test_the_record_keeps_the_map(tmp_path) -> None:
    record = replace(CALIBRATION, canvas=SIZE).with_surface(plane(0.001, 0.01, -0.01))
    record.save(tmp_path / "cal.json")
    assert Calibration.load(tmp_path / "cal.json") == record
    moved = record.with_canvas(record.corners, record.photograph, camera="c", canvas=CanvasSize(0.2, 0.2), residual=0.1)
    assert moved.surface is None, "another canvas is not as uneven as this one"


def stroke(thickness: float) -> Strokes:
    one = torch.ones(1)
    return Strokes(torch.tensor([[0.05, 0.05]]), 0.5 * one, 0.1 * one, 0.01 * one, thickness * one, torch.zeros(1, 3))


@given(st.floats(-0.004, 0.004), st.floats(-0.02, 0.02), st.floats(-0.02, 0.02), st.floats(0, 1))
def test_every_point_of_a_stroke_follows_the_canvas(a: float, b: float, c: float, thickness: float) -> None:
    """The twin is the same stroke on a flat canvas, lifted point by point."""
    flat = Motion(WORKSPACE, replace(CALIBRATION, canvas=SIZE))
    uneven = Motion(WORKSPACE, flat.calibration.with_surface(plane(a, b, c)))
    level, followed = (motion.stroke(stroke(thickness), 0).position[1:-1] for motion in (flat, uneven))
    place = WORKSPACE.to_canvas(level)
    assert np.allclose(followed[:, :2], level[:, :2])
    assert np.allclose(followed[:, 2] - level[:, 2], a + b * place[:, 0] + c * place[:, 1], atol=3e-6)


def test_the_tip_travels_above_the_highest_point_and_is_never_lower_than_the_hardest_press_there() -> None:
    record = replace(CALIBRATION, canvas=SIZE).with_surface(plane(0.0, 0.02, 0.0))
    motion, flat = Motion(WORKSPACE, record), Motion(WORKSPACE, replace(record, surface=None))
    assert motion.travel_height >= record.touch_height + record.surface.highest + WORKSPACE.hover - 1e-9
    assert motion.clearance_height - flat.clearance_height == pytest.approx(record.surface.highest)
    surface = Surface(SIZE, record.press_height, record.surface)
    hardest = motion.stroke(stroke(1.0), 0)
    MotionLimits(WORKSPACE, surface).check([hardest])
    pressed = WORKSPACE.to_robot(np.array([(0.005, 0.1), (0.28, 0.1)]), np.full(2, record.press_height))
    MotionLimits(WORKSPACE, surface).check([Waypoints("left", pressed[:1], 0.1)])
    (fault,) = MotionLimits(WORKSPACE, surface).faults([Waypoints("right", pressed, 0.1)])
    assert "the hardest press is at 0.0954 m there" in fault.reason, "it would dig 5.4 mm into the canvas"
