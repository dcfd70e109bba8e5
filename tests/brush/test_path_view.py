import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from frida_painter.brush.path_view import PathView

BLEND = 0.002


def seen(place, length, bend, blend=BLEND):
    place = torch.tensor(place, dtype=torch.float64)
    stroke = torch.zeros(len(place), dtype=torch.long)
    return PathView.of(place, stroke, *(torch.tensor([part], dtype=torch.float64) for part in (length, bend)), blend)


@given(st.floats(-0.02, 0.06), st.floats(-0.02, 0.02), st.floats(0.01, 0.05))
@settings(max_examples=30, deadline=None)
def test_along_a_straight_path_the_view_is_exact(x, y, length):
    view = seen([[x, y]], length, 0.0)
    torch.testing.assert_close(torch.stack((view.along, view.ahead, view.aside)), _column(x, length - x, y))


@given(st.floats(-0.02, 0.06), st.floats(-0.02, 0.02), st.floats(-0.02, 0.02))
@settings(max_examples=30, deadline=None)
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


def test_places_belong_to_the_strokes_that_they_name():
    length, bend = torch.tensor([0.02, 0.05]), torch.tensor([0.01, -0.01])
    place = torch.tensor([[0.01, 0.0], [0.02, 0.003]])
    both = PathView.of(place, torch.tensor([1, 0]), length, bend, BLEND)
    for index, stroke in enumerate((1, 0)):
        alone = PathView.of(
            place[index : index + 1], torch.zeros(1, dtype=torch.long), length[stroke, None], bend[stroke, None], BLEND
        )
        torch.testing.assert_close(both.along[index], alone.along[0])
        torch.testing.assert_close(both.aside[index], alone.aside[0])


def _column(*numbers: float) -> torch.Tensor:
    return torch.tensor(numbers, dtype=torch.float64)[:, None]
