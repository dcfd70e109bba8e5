"""Actions and strokes: every action is a stroke that the brush may paint, and every such stroke is an action."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from frida_painter.brush.kinds import brush_kind
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import PlanError, StepRefused
from frida_painter.strokes.palette import Palette
from frida_painter.strokes.plan import Plan
from frida_painter_lab.env.actions import NUMBERS, StrokeCode, require_action

PALETTE = Palette(torch.tensor([[0.9, 0.9, 0.9], [0.5, 0.1, 0.1], [0.1, 0.1, 0.3]]))
numbers = st.floats(-1, 1, width=32)
actions = st.integers(1, 5).flatmap(lambda n: arrays(np.float32, (n, NUMBERS), elements=numbers))
sizes = st.sampled_from([CanvasSize(0.2, 0.16), CanvasSize(0.05, 0.31), CanvasSize(0.03, 0.03), CanvasSize(1.0, 0.7)])


def code(size: CanvasSize, brush: str) -> StrokeCode:
    return StrokeCode(size, brush_kind(brush).limits.within(size), len(PALETTE))


@given(actions, sizes, st.sampled_from(["fine", "medium", "broad"]))
def test_every_action_is_a_stroke_that_a_plan_may_have(action, size, brush):
    it = code(size, brush)
    strokes, paint = it.decode(action, PALETTE.color)
    Plan.of(strokes, PALETTE, paint, brush=brush, limits=it.limits, canvas=size)  # raises for a stroke that breaks one
    assert torch.equal(strokes.color, PALETTE.color[paint])


@given(actions, sizes)
def test_a_stroke_is_found_again_from_its_action(action, size):
    it = code(size, "medium")
    strokes, paint = it.decode(action, PALETTE.color)
    again, paint_again = it.decode(it.encode(strokes, paint), PALETTE.color)
    assert torch.equal(paint, paint_again)
    fraction = torch.linspace(0, 1, 9)
    assert torch.allclose(strokes.path(fraction), again.path(fraction), atol=2e-6)
    assert torch.allclose(strokes.thickness, again.thickness, atol=1e-6)


def test_the_corners_of_the_space_are_the_edges_of_the_canvas():
    size = CanvasSize(0.2, 0.16)
    action = np.zeros((2, NUMBERS), np.float32)
    action[0, :2], action[1, :2] = -1, 1
    (low, high), _ = code(size, "fine").decode(action, PALETTE.color)[0].extremes(), None
    assert low.amin(0).tolist() == pytest.approx([0, 0], abs=1e-6)
    assert high.amax(0).tolist() == pytest.approx([size.width, size.height], abs=1e-6)


def test_the_paint_is_the_part_of_the_last_number():
    action = np.zeros((5, NUMBERS), np.float32)
    action[:, 6] = [-1, -0.34, -0.32, 0.34, 1]
    assert code(CanvasSize(0.2, 0.16), "fine").decode(action, PALETTE.color)[1].tolist() == [0, 0, 1, 2, 2]


def test_a_stroke_of_a_larger_brush_is_no_action():
    size = CanvasSize(0.2, 0.16)
    strokes, paint = code(size, "broad").decode(np.ones((1, NUMBERS), np.float32), PALETTE.color)
    with pytest.raises(PlanError, match="same brush"):
        code(size, "fine").encode(strokes, paint)


@pytest.mark.parametrize(
    ("action", "says"),
    [
        (np.full(7, np.nan), "nan for the x"),
        (np.array([0, 0, 0, 0, 0, 0, 1.5]), "1.5 for the paint"),
        (np.array([0, -np.inf, 0, 0, 0, 0, 0]), "-inf for the y"),
        (np.zeros(6), r"shape \(6,\)"),
        (np.zeros((1, 7)), r"shape \(1, 7\)"),
        ("a stroke", "type str|of str"),
        (None, "NoneType"),
        ([[1], [1, 2]], "list"),
        (np.zeros(7, complex), "ndarray"),
    ],
)
def test_an_action_outside_the_space_is_refused_with_a_sentence(action, says):
    with pytest.raises(StepRefused, match=says) as refusal:
        require_action(action, (7,))
    assert str(refusal.value).count(". ") == 0 and str(refusal.value).endswith(".")


def test_whole_numbers_and_lists_are_numbers():
    assert require_action([0, 1, -1, 0, 0, 0, 0], (7,)).dtype == np.float32
