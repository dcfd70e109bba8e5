import pytest
import torch

from frida_painter.brush.table import StrokeTable, TableDetail
from frida_painter.brush.weights import load_stroke_model
from marks import ribbon, shapes

DETAIL = TableDetail(spans=(3, 5, 5), rank=48)


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
    assert error.mean() < 0.004


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
