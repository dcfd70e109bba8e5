import torch
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.brush import table


@given(place=st.floats(0, 1), spans=st.integers(1, 20))
def test_weights_sum_to_one(place, spans):
    first, weight = table.weights(torch.tensor([place], dtype=torch.float64), spans)
    assert 0 <= int(first) <= spans - 1
    torch.testing.assert_close(weight.sum(), torch.tensor(1.0, dtype=torch.float64))


def test_the_derivative_of_a_spline_is_continuous():
    knots = torch.tensor([0.3, -1.0, 2.0, 0.5, 0.1, -0.7, 1.2, 0.4], dtype=torch.float64)

    def slope(place):
        at = torch.tensor([place], dtype=torch.float64, requires_grad=True)
        first, weight = table.weights(at, 5)
        (found,) = torch.autograd.grad((knots[first[:, None] + torch.arange(4)] * weight).sum(), at)
        return found

    for place in (0.2, 0.4, 0.6, 0.8):
        torch.testing.assert_close(slope(place - 1e-9), slope(place + 1e-9), atol=1e-6, rtol=0)


def test_a_fitted_spline_reproduces_any_cubic():
    grid = table.sample_grid(4)
    coefficients = table.fit_matrix(grid, 4) @ (2 - grid + 3 * grid**3)
    place = torch.linspace(0, 1, 33, dtype=torch.float64)
    first, weight = table.weights(place, 4)
    value = (coefficients[first[:, None] + torch.arange(4)] * weight).sum(1)
    torch.testing.assert_close(value, 2 - place + 3 * place**3)


def test_the_rows_of_a_cube_are_those_of_its_flattened_coefficients():
    spans = (2, 3, 4)
    cube = torch.arange(5 * 6 * 7, dtype=torch.float64).reshape(5, 6, 7)
    place = torch.tensor([[0.6], [0.4], [0.9]], dtype=torch.float64)
    looked = [table.weights(axis, pieces) for axis, pieces in zip(place, spans, strict=True)]
    row, weight = table.rows([first for first, _ in looked], cube.shape), [weight for _, weight in looked]
    first = [int(first) for first, _ in looked]
    block = cube[first[0] : first[0] + 4, first[1] : first[1] + 4, first[2] : first[2] + 4]
    assert torch.equal(cube.flatten()[row[0]], block.flatten())
    wanted = torch.einsum("i,j,k,ijk->", *(part[0] for part in weight), block)
    torch.testing.assert_close((cube.flatten()[row[0]] * table.outer(*weight)[0]).sum(), wanted)
