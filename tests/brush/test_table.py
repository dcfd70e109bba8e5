import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.brush.kinds import StrokeFunction
from frida_painter.brush.table import (
    StrokeTable,
    TableDetail,
    cached_table,
    fit_matrix,
    outer,
    rows,
    sample_grid,
    squash,
    stretch_sigmoid,
    unsquash,
    weights,
)
from frida_painter.brush.weights import load_stroke_model
from frida_painter.errors import ConfigError
from frida_painter_calibration.teaching.bezier import BezierStroke
from marks import SMALL, ribbon, shapes, small_frame

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


@given(place=st.floats(0, 1), spans=st.integers(1, 20))
def test_weights_sum_to_one(place, spans):
    first, weight = weights(torch.tensor([place], dtype=torch.float64), spans)
    assert 0 <= int(first) <= spans - 1
    torch.testing.assert_close(weight.sum(), torch.tensor(1.0, dtype=torch.float64))


def test_a_fitted_spline_reproduces_any_cubic():
    grid = sample_grid(4)
    coefficients = fit_matrix(grid, 4) @ (2 - grid + 3 * grid**3)
    place = torch.linspace(0, 1, 33, dtype=torch.float64)
    first, weight = weights(place, 4)
    value = (coefficients[first[:, None] + torch.arange(4)] * weight).sum(1)
    torch.testing.assert_close(value, 2 - place + 3 * place**3)


def test_the_rows_of_a_cube_are_those_of_its_flattened_coefficients():
    spans = (2, 3, 4)
    cube = torch.arange(5 * 6 * 7, dtype=torch.float64).reshape(5, 6, 7)
    place = torch.tensor([[0.6], [0.4], [0.9]], dtype=torch.float64)
    looked = [weights(axis, pieces) for axis, pieces in zip(place, spans, strict=True)]
    row, weight = rows([first for first, _ in looked], cube.shape), [weight for _, weight in looked]
    first = [int(first) for first, _ in looked]
    block = cube[first[0] : first[0] + 4, first[1] : first[1] + 4, first[2] : first[2] + 4]
    assert torch.equal(cube.flatten()[row[0]], block.flatten())
    wanted = torch.einsum("i,j,k,ijk->", *(part[0] for part in weight), block)
    torch.testing.assert_close((cube.flatten()[row[0]] * outer(*weight)[0]).sum(), wanted)


@given(st.floats(0, 1))
def test_unsquash_undoes_squash(magnitude):
    given_one = torch.tensor(magnitude, dtype=torch.float64)
    torch.testing.assert_close(squash(unsquash(given_one)), given_one, atol=1e-12, rtol=0)


def test_far_from_a_mark_there_is_nothing_at_all():
    assert squash(torch.tensor(-6.0)) == 0
    assert squash(torch.tensor(6.0)) == 1
    assert stretch_sigmoid(torch.tensor(-6.0)) < 0


COARSE = TableDetail(spans=(2, 3, 3), rank=12)


def same(one, other):
    return all(torch.equal(part, other.get_buffer(name)) for name, part in one.named_buffers())


def test_a_table_is_made_once_and_read_again_to_the_bit(tmp_path, monkeypatch):
    made = cached_table(ribbon(), COARSE, tmp_path)
    assert same(made, StrokeTable.of(ribbon(), detail=COARSE))
    monkeypatch.setattr(StrokeTable, "from_samples", None)
    again = cached_table(ribbon(), COARSE, tmp_path)
    assert same(again, made) and torch.equal(again(*shapes(5)), made(*shapes(5)))
    assert (again.brush, again.frame, again.limits, again.detail) == (made.brush, made.frame, made.limits, COARSE)


def test_another_model_or_detail_has_another_table(tmp_path):
    cached_table(ribbon(), COARSE, tmp_path)
    wider = ribbon()
    with torch.no_grad():
        next(wider.parameters()).add_(0.01)
    cached_table(wider, COARSE, tmp_path)
    cached_table(ribbon(12, 20), COARSE, tmp_path)
    cached_table(ribbon(), TableDetail(spans=(2, 3, 4), rank=12), tmp_path)
    assert len(list(tmp_path.iterdir())) == 4


def stripe(width):
    """A stroke model that is only a function: a straight stripe, as wide as it is told."""
    frame = small_frame()
    x, y = frame.cell_centers().unbind(-1)

    def marks(thickness, length, bend):
        on = (x > 0) & (x < length[:, None, None])
        return on * (1 - (y.abs() / (width * (0.5 + thickness[:, None, None])))).clamp(0, 1)

    return StrokeFunction(SMALL, marks, frame)


def test_a_model_that_is_only_a_function_is_known_by_what_it_gives(tmp_path, monkeypatch):
    made = cached_table(stripe(0.004), COARSE, tmp_path)
    assert same(made, StrokeTable.of(stripe(0.004), detail=COARSE))
    cached_table(stripe(0.005), COARSE, tmp_path)
    assert len(list(tmp_path.iterdir())) == 2
    monkeypatch.setattr(StrokeTable, "from_samples", None)
    assert same(cached_table(stripe(0.004), COARSE, tmp_path), made)


def test_a_network_of_someone_elses_is_known_by_what_it_gives_as_well(tmp_path):
    class Fainter(BezierStroke):
        """The same weights, another program: what a researcher changes between two runs."""

        def forward(self, thickness, length, bend):
            return 0.5 * super().forward(thickness, length, bend)

    known = ribbon()
    fainter = Fainter("small", known.frame, known.limits, known.ribbon).requires_grad_(False)
    coarse = TableDetail(spans=(1, 2, 2), rank=4)
    plain, half = (cached_table(model, coarse, tmp_path)(*shapes(8)) for model in (known, fainter))
    Fainter.forward = BezierStroke.forward
    assert torch.equal(cached_table(fainter, coarse, tmp_path)(*shapes(8)), plain) and half.sum() < 0.7 * plain.sum()


@pytest.mark.parametrize(
    ("marks", "says"),
    [
        (
            lambda h, *_: torch.zeros(len(h), 3, 3),
            r"maps of shape \(2, 3, 3\); its function has to return \(2, 24, 42\)",
        ),
        (lambda h, *_: torch.full((len(h), 24, 42), 1.5), "magnitudes from 1.5 to 1.5"),
        (lambda h, *_: torch.full((len(h), 24, 42), float("nan")), "magnitudes from nan to nan"),
    ],
)
def test_a_function_that_gives_no_marks_is_told(marks, says):
    with pytest.raises(ConfigError, match=says):
        StrokeFunction(SMALL, marks, small_frame())(*shapes(2))


@pytest.mark.parametrize("content", [b"", b"nonsense", "cut", "another's"])
def test_a_damaged_one_is_made_anew(tmp_path, content):
    made = cached_table(ribbon(), COARSE, tmp_path)
    (path,) = tmp_path.iterdir()
    whole = path.read_bytes()
    if content == "cut":
        content = whole[: len(whole) // 2]
    elif content == "another's":
        cached_table(ribbon(12, 20), COARSE, tmp_path)
        content = next(one for one in tmp_path.iterdir() if one != path).read_bytes()
    path.write_bytes(content)
    assert same(cached_table(ribbon(), COARSE, tmp_path), made)
    assert path.read_bytes() == whole


def test_only_so_many_are_kept(tmp_path, monkeypatch):
    monkeypatch.setattr("frida_painter.brush.table._MAX_KEPT", 2)
    for columns in (14, 16, 18):
        cached_table(ribbon(8, columns), TableDetail(spans=(1, 1, 1), rank=2), tmp_path)
    assert len(list(tmp_path.iterdir())) == 2
