from pathlib import Path

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.brush.field import PathView, StrokeField
from frida_painter.brush.weights import load_stroke_model
from frida_painter.errors import WeightsError
from frida_painter.system import tensor_file
from marks import SMALL, shapes, small_frame


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    StrokeField.fresh(SMALL, seed=3).save(tmp_path / "small.safetensors")
    return tmp_path / "small.safetensors"


def test_it_is_differentiable_in_the_shape_of_the_stroke():
    model = StrokeField("small", small_frame(6, 8), SMALL.limits).double()
    inputs = [part.requires_grad_() for part in shapes(2, dtype=torch.float64)]
    assert torch.autograd.gradcheck(
        lambda thickness, length, bend: model(thickness, length / 100, bend / 100),
        [inputs[0], *(100 * part.detach() for part in inputs[1:])],
    )


def test_paint_lies_within_reach_of_the_path_only():
    model = StrokeField("small", small_frame(), SMALL.limits)
    with torch.no_grad():
        model.layers[-1].bias.fill_(50.0)
    model.reach.fill_(0.004)
    mark = model(torch.tensor([0.5]), torch.tensor([0.02]), torch.tensor([-0.004]))[0]
    x, y = model.frame.cell_centers().unbind(-1)
    inside = (x > -0.004) & (x < 0.024) & (y > -0.007) & (y < 0.004)
    assert torch.equal(mark > 0, inside)


def test_other_cells_show_the_same_field():
    coarse = StrokeField("small", small_frame(12, 21), SMALL.limits)
    fine = StrokeField("small", small_frame(36, 63), SMALL.limits)
    fine.load_state_dict(coarse.state_dict())
    torch.testing.assert_close(fine(*shapes(3))[:, 1::3, 1::3], coarse(*shapes(3)))


def test_the_seed_decides_the_first_weights_and_leaves_the_world_alone():
    before = torch.get_rng_state()
    one, same, other = (StrokeField.fresh(SMALL, seed=seed).layers[0].weight for seed in (1, 1, 2))
    assert torch.equal(one, same)
    assert not torch.equal(one, other)
    assert torch.equal(before, torch.get_rng_state())


def test_weights_come_back_as_they_were(saved):
    model, again = StrokeField.fresh(SMALL, seed=3), load_stroke_model(saved)
    assert isinstance(again, StrokeField)
    assert (again.brush, again.frame, again.limits) == ("small", SMALL.frame, SMALL.limits)
    assert torch.equal(model(*shapes(3)), again(*shapes(3)))
    assert not any(parameter.requires_grad for parameter in again.parameters())


def test_weights_of_another_shape_missing_or_nan_are_refused(saved):
    tensors, metadata = tensor_file.read_tensors(saved, "weights")
    broken = (
        {name: tensor for name, tensor in tensors.items() if name != "reach"},
        {**tensors, "layers.0.bias": torch.zeros(3)},
        {**tensors, "reach": torch.tensor(torch.nan)},
        {**tensors, "reach": torch.tensor(-1.0)},
    )
    for part in broken:
        tensor_file.write_tensors(saved, part, metadata)
        with pytest.raises(WeightsError):
            load_stroke_model(saved)


def test_strokes_of_one_path_are_drawn_together_as_each_alone():
    model = StrokeField("small", small_frame(), SMALL.limits).requires_grad_(False)
    thickness, length, bend = (part[torch.tensor([0, 1, 0, 2, 1])] for part in shapes(3))
    thickness = torch.linspace(0, 1, 5)
    together = model(thickness, length, bend)
    alone = [model(thickness[i : i + 1], length[i : i + 1], bend[i : i + 1]) for i in range(5)]
    torch.testing.assert_close(together, torch.cat(alone))
    torch.testing.assert_close(together, model(thickness, length.requires_grad_(), bend).detach())


BLEND = 0.002


def seen(place, length, bend, blend=BLEND):
    place = torch.tensor(place, dtype=torch.float64)
    stroke = torch.zeros(len(place), dtype=torch.long)
    return PathView.of(place, stroke, *(torch.tensor([part], dtype=torch.float64) for part in (length, bend)), blend)


@given(st.floats(-0.02, 0.06), st.floats(-0.02, 0.02), st.floats(-0.02, 0.02))
def test_a_mirrored_stroke_sees_a_mirrored_place_on_its_other_side(x, y, bend):
    one, other = seen([[x, y]], 0.03, bend), seen([[x, -y]], 0.03, -bend)
    torch.testing.assert_close(one.along, other.along)
    torch.testing.assert_close(one.aside, -other.aside)


def test_on_the_path_nothing_lies_aside_and_its_length_passes_by():
    fraction = torch.linspace(0.1, 0.9, 30, dtype=torch.float64)
    place = torch.stack((0.04 * fraction, 0.012 * 3 * fraction * (1 - fraction)), -1)
    view = seen(place.tolist(), 0.04, 0.012)
    assert float(view.aside.abs().max()) < 0.0005
    walked = torch.hypot(*place.diff(dim=0).unbind(-1)).cumsum(0)
    torch.testing.assert_close(view.along[1:] - view.along[0], walked, atol=0.0005, rtol=0)
    assert float((view.along + view.ahead).std()) < 1e-9


def test_it_changes_smoothly_with_the_stroke_even_inside_a_tight_bend():
    place = torch.tensor([[0.005, 0.004], [0.004, 0.006], [0.0, 0.0]], dtype=torch.float64)

    def view(length, bend):
        sight = PathView.of(place, torch.zeros(3, dtype=torch.long), length / 100, bend / 100, BLEND)
        return torch.cat((sight.along, sight.ahead, sight.aside)) * 100

    shape = [torch.tensor([part], dtype=torch.float64, requires_grad=True) for part in (1.0, 1.5)]
    assert torch.autograd.gradcheck(view, shape)
