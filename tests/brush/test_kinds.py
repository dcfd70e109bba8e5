import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.brush.kinds import BROAD, KINDS, MEDIUM, Dip, brush_kind, stroke_path
from frida_painter.brush.weights import load_stroke_model
from frida_painter.errors import ConfigError, PlanError, WeightsError
from frida_painter.strokes.strokes import Strokes
from frida_painter_calibration.teaching.bezier import BezierStroke
from marks import shapes


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_no_mark_of_the_typical_brush_is_cut_off_by_its_frame(kind):
    thickness, _, _ = shapes(1)
    model = BezierStroke.typical(kind).requires_grad_(False)
    for length in kind.limits.length:
        for bend in kind.limits.bend:
            mark = model(thickness * 0 + 1, thickness * 0 + length, thickness * 0 + bend)[0]
            assert mark.amax() > 0.9
            assert mark[[0, -1]].amax() == mark[:, [0, -1]].amax() == 0


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_frames_have_square_cells_and_are_symmetric_about_the_stroke(kind):
    across, down = kind.frame.pitch
    assert across == pytest.approx(down)
    assert kind.frame.top == pytest.approx(-kind.frame.bottom)
    assert kind.frame.rows % 2 == kind.frame.columns % 2 == 0


def test_an_unknown_brush_is_refused_and_the_known_ones_are_named():
    with pytest.raises(ConfigError, match="fine, medium, broad"):
        brush_kind("broom")


class Given:
    """A stroke model of a person, whose maps are `made` times ones, of the shape of its frame or of another."""

    def __init__(self, made: float, shape: tuple[int, ...] | None = None, **other: object) -> None:
        self.brush, self.limits, self.frame = "fine", KINDS[0].limits, KINDS[0].frame
        self.made, self.shape = made, shape or (self.frame.rows, self.frame.columns)
        vars(self).update(other)

    def __call__(self, thickness: torch.Tensor, length: torch.Tensor, bend: torch.Tensor) -> torch.Tensor:
        return torch.full((len(thickness), *self.shape), self.made)


def test_every_stroke_model_is_tried_wherever_it_comes_from(tmp_path) -> None:
    assert load_stroke_model(Given(0.5)).brush == "fine"
    wrong = (Given(0.0), Given(2.0), Given(float("nan")), Given(2.0, (3, 3)), Given(0.5, (3, 3)), Given(0.5, frame=3))
    for model in (*wrong, lambda thickness, length, bend: thickness, 3):
        with pytest.raises(WeightsError):
            load_stroke_model(model)
    blank = load_stroke_model("fine")
    with torch.no_grad():
        blank.layers[-1].bias.fill_(-20.0)
    blank.save(tmp_path / "blank.safetensors")
    with pytest.raises(WeightsError, match=r"blank\.safetensors"):
        load_stroke_model(tmp_path / "blank.safetensors")


def test_a_dip_is_used_up_by_area_or_by_strokes() -> None:
    areas = torch.tensor([1e-4, 3e-4])
    assert torch.equal(Dip(5e-4).used_by(areas), areas)
    assert torch.equal(Dip.of_strokes(4).used_by(areas), torch.ones(2))
    assert (str(Dip(5e-4)), str(Dip.of_strokes(4))) == ("5.0 cm²", "4 strokes")


def test_marks_lack_paint_towards_the_end_of_a_dip() -> None:
    """Full at first, they fade evenly from three tenths of it on; as by the middle of each mark."""
    dip = Dip(10e-4, fades=0.7)
    assert [dip.lacking(left, 0.0) for left in (10e-4, 8e-4, 7e-4)] == pytest.approx([0, 0, 0], abs=1e-9)
    assert dip.lacking(3.5e-4, 0.0) == pytest.approx(0.35)
    assert dip.lacking(4.5e-4, 2e-4) == pytest.approx(0.35)
    assert dip.lacking(0.0, 0.0) == pytest.approx(0.7)
    assert Dip(1e-4, fades=1.0).lacking(-1e-4, 0.0) == 1.0
    assert Dip(10e-4).lacking(0.0, 0.0) == 0.0


def test_a_dip_may_end_before_marks_are_faint() -> None:
    dip = Dip(10e-4, fades=0.6)
    short = dip.until(0.3)
    assert short.fades == 0.3 and short.holds == pytest.approx(6.5e-4)
    assert short.lacking(0.0, 0.0) == pytest.approx(0.3) == dip.lacking(3.5e-4, 0.0)
    assert dip.until(0.7) is dip
    assert replace(Dip.of_strokes(2), fades=0.5).until(0.1).holds == 1.0
    assert BROAD.for_any_order.dip.holds < BROAD.dip.holds


def test_what_is_known_of_a_brush_goes_before_what_is_usual() -> None:
    assert replace(MEDIUM, known_dip=None).dip.holds == pytest.approx(0.6 * 0.060 * 0.017)
    assert MEDIUM.dip == Dip(17e-4, fades=0.5)
    assert replace(MEDIUM, known_dip=Dip(1e-4)).dip == Dip(1e-4)


@pytest.mark.parametrize("holds", [0.0, -1e-4, 2.0, float("nan"), float("inf")])
def test_a_dip_that_cannot_be_is_refused(holds: float) -> None:
    with pytest.raises(ConfigError, match="from 0 to 1"):
        Dip(holds)
    with pytest.raises(ConfigError, match=r"strokes was given; it is from 1 to 1000\."):
        Dip(holds / 4, by_strokes=True)


@pytest.mark.parametrize("fades", [-0.1, 1.1, float("nan")])
def test_fading_that_cannot_be_is_refused(fades: float) -> None:
    with pytest.raises(ConfigError, match="from 0 to 1"):
        Dip(1e-4, fades=fades)


def one(x: float, y: float, angle: float, length: float, bend: float, thickness: float) -> Strokes:
    return Strokes(
        position=torch.tensor([[x, y]], dtype=torch.float64),
        angle=torch.tensor([angle], dtype=torch.float64),
        length=torch.tensor([length], dtype=torch.float64),
        bend=torch.tensor([bend], dtype=torch.float64),
        thickness=torch.tensor([thickness], dtype=torch.float64),
        color=torch.zeros(1, 3, dtype=torch.float64),
    )


@given(angle=st.floats(-7, 7), length=st.floats(0.001, 0.2), bend=st.floats(-0.05, 0.05), step=st.floats(0.0005, 0.05))
def test_points_start_and_end_where_they_must_and_never_lie_further_apart_than_the_step(angle, length, bend, step):
    position, thickness = stroke_path(one(0.1, 0.2, angle, length, bend, 0.7), 0, step)
    np.testing.assert_allclose(position[0], [0.1, 0.2])
    end = [0.1 + length * math.cos(angle), 0.2 + length * math.sin(angle)]
    np.testing.assert_allclose(position[-1], end, atol=1e-12)
    assert np.linalg.norm(np.diff(position, axis=0), axis=1).max() <= step
    assert len(position) == len(thickness)


def test_the_path_is_the_bezier_of_the_plan():
    stroke = one(0.1, 0.2, 0.5, 0.06, 0.02, 0.5)
    position, _ = stroke_path(stroke, 0, 0.0005)
    wanted = stroke.path(torch.linspace(0, 1, 4001, dtype=torch.float64))[0].numpy()
    away = np.linalg.norm(position[:, None] - wanted, axis=-1).min(1)
    assert away.max() < 2e-5


def test_thickness_runs_from_a_fifth_to_the_strokes_own_and_back():
    _, thickness = stroke_path(one(0, 0, 0, 0.04, 0, 0.9), 0, 0.001)
    assert thickness[0] == thickness[-1] == pytest.approx(0.2)
    assert thickness.max() == pytest.approx(0.2 * 0.25 + 0.9 * 0.75, abs=1e-3)
    np.testing.assert_allclose(thickness, thickness[::-1], atol=1e-3)


def test_a_bend_above_zero_goes_to_the_left_of_the_heading():
    position, _ = stroke_path(one(0, 0, math.pi / 2, 0.04, 0.01, 0.5), 0)
    assert position[:, 0].min() == pytest.approx(-0.0075, abs=1e-4)
    assert position[:, 0].max() < 1e-9


@pytest.mark.parametrize("step", [0.0, -1.0, math.nan, math.inf])
def test_a_step_that_is_none_is_refused(step):
    with pytest.raises(PlanError, match="step"):
        stroke_path(one(0, 0, 0, 0.02, 0, 0.5), 0, step)


@pytest.mark.parametrize("index", [-1, 1])
def test_a_stroke_that_is_not_there_is_refused(index):
    with pytest.raises(PlanError, match="there are 1"):
        stroke_path(one(0, 0, 0, 0.02, 0, 0.5), index)


@pytest.mark.parametrize("stroke", [one(math.nan, 0, 0, 0.02, 0, 0.5), one(0, 0, 0, 0.02, 0, math.nan)])
def test_nan_is_refused(stroke):
    with pytest.raises(PlanError, match="not finite"):
        stroke_path(stroke, 0)
