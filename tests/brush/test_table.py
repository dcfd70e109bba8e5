import pytest
import torch

from frida_painter.brush.kinds import StrokeFunction
from frida_painter.brush.table import StrokeTable, TableDetail
from frida_painter.brush.weights import load_stroke_model
from marks import SMALL, ribbon, shapes

DETAIL = TableDetail(spans=(3, 5, 5), parts=(2, 3), rank=18)


@pytest.fixture(scope="module")
def table() -> StrokeTable:
    return StrokeTable.of(ribbon(), detail=DETAIL)


def test_it_stands_in_for_its_model(table):
    model = ribbon()
    assert (table.brush, table.frame, table.limits) == (model.brush, model.frame, model.limits)
    shape = shapes(64, seed=1)
    error = (table(*shape) - model(*shape)).abs()
    assert error.mean() < 0.01


def test_it_stands_in_for_the_shipped_network_as_well_as_the_docs_say():
    model = load_stroke_model("broad")
    thickness, along, aside = torch.rand(3, 100, generator=torch.Generator().manual_seed(5))
    (shortest, longest), (least, most) = model.limits.length, model.limits.bend
    shape = (thickness, shortest + along * (longest - shortest), least + aside * (most - least))
    error = (StrokeTable.of(model)(*shape) - model(*shape)).abs()
    assert error.mean() < 0.002


def test_slopes_are_those_of_the_value():
    table = StrokeTable.of(ribbon(12, 20).double(), torch.zeros((), dtype=torch.float64), DETAIL)
    thickness, length, bend = (part[:4] for part in shapes(8, seed=2, dtype=torch.float64))
    scaled = [part.detach().requires_grad_() for part in (thickness, 100 * length, 100 * bend)]
    assert torch.autograd.gradcheck(lambda h, x, y: table(h, x / 100, y / 100), scaled, atol=1e-6)


def test_the_paper_stays_clean(table):
    shape = shapes(64, seed=3)
    magnitude, wanted = table(*shape), ribbon()(*shape)
    far = torch.nn.functional.max_pool2d(wanted, 9, 1, 4) == 0
    assert float(magnitude[wanted == 0].mean()) < 0.003
    assert float((magnitude[far] == 0).float().mean()) > 0.97
    assert float(magnitude.detach().amin()) >= 0
    assert float(magnitude.detach().amax()) <= 1


def test_shapes_outside_the_limits_count_as_the_nearest_inside(table):
    outside = table(torch.tensor([1.5]), torch.tensor([0.2]), torch.tensor([-0.5]))
    inside = table(torch.tensor([1.0]), torch.tensor([0.03]), torch.tensor([-0.008]))
    torch.testing.assert_close(outside, inside)


def test_no_strokes_give_no_maps(table):
    assert table(*(torch.zeros(0) for _ in range(3))).shape == (0, 24, 42)


def test_the_same_model_gives_the_same_table(table):
    again = StrokeTable.of(ribbon(), detail=DETAIL)
    assert all(torch.equal(buffer, table.state_dict()[name]) for name, buffer in again.state_dict().items())


@pytest.mark.parametrize("parts", [(1, 1), (2, 3), (9, 9)])
def test_the_compiled_loops_give_what_plain_pytorch_does(parts):
    table = StrokeTable.of(ribbon(), detail=TableDetail((2, 5, 4), 7, parts=parts))
    edges = torch.tensor([-0.3, 0.0, 0.2, 0.4, 0.5, 0.6, 0.75, 0.8, 1.0, 1.4])
    chance = torch.rand(3, 50, generator=torch.Generator().manual_seed(4))
    place = torch.cat((chance, torch.cartesian_prod(edges, edges, edges).T), 1)
    upstream = torch.randn(place.shape[1], *table.window, generator=torch.Generator().manual_seed(5))
    found = []
    (shortest, longest), (least, most) = table.limits.length, table.limits.bend
    for look_up in (table.windows, lambda *shape: table.plainly(table.places(*shape).clamp(0, 1))):
        at = place.clone().requires_grad_()
        maps, shift = look_up(at[0], shortest + at[1] * (longest - shortest), least + at[2] * (most - least))
        (slope,) = torch.autograd.grad((maps * upstream).sum(), at)
        found.append((maps.detach(), shift, slope))
    (maps, shift, slope), (plain_maps, plain_shift, plain_slope) = found
    assert torch.equal(shift, plain_shift)
    torch.testing.assert_close(maps, plain_maps, atol=2e-6, rtol=0)
    torch.testing.assert_close(slope, plain_slope, atol=2e-5 * float(plain_slope.abs().amax()), rtol=1e-3)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_windows_hold_all_paint_where_they_say_it_is(dtype):
    table = StrokeTable.of(ribbon().to(dtype), torch.zeros((), dtype=dtype), DETAIL)
    shape = shapes(40, seed=6, dtype=dtype)
    whole, (windows, shift) = table(*shape), table.windows(*shape)
    rows, columns = table.window
    assert rows * columns < 24 * 42, "a frame is mostly empty"
    for frame, window, place in zip(whole, windows, shift, strict=True):
        assert place[:, :2].eq(0).all()
        left, top = place[:, 2].long().tolist()
        there = frame[top : top + rows, left : left + columns]
        assert torch.equal(there, window) and frame.sum() == pytest.approx(float(window.sum()))


def test_a_shape_that_is_not_finite_gives_no_number(table):
    nowhere = torch.tensor([float("nan"), 0.5]), torch.tensor([0.02, 0.02]), torch.tensor([0.0, 0.0])
    magnitude = table(*nowhere)
    assert bool(magnitude[0].isnan().any()) and bool(magnitude[1].isfinite().all())


def test_a_model_without_marks_has_a_table_without_marks():
    bare = ribbon()
    nothing = StrokeFunction(SMALL, lambda h, *_: torch.zeros(len(h), 24, 42), bare.frame)
    assert float(StrokeTable.of(nothing, detail=DETAIL)(*shapes(8)).abs().amax()) == 0
