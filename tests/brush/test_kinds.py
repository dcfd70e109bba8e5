import pytest
import torch

from frida_painter.brush.kinds import KINDS, brush_kind
from frida_painter.brush.weights import load_stroke_model
from frida_painter.errors import ConfigError, WeightsError
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
