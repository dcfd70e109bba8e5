import torch
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.brush import spline


@given(place=st.floats(0, 1), spans=st.integers(1, 20))
def test_weights_sum_to_one_and_their_slopes_to_zero(place, spans):
    first, weight, slope = spline.weights(torch.tensor([place], dtype=torch.float64), spans)
    assert 0 <= int(first) <= spans - 1
    torch.testing.assert_close(weight.sum(), torch.tensor(1.0, dtype=torch.float64))
    torch.testing.assert_close(slope.sum(), torch.tensor(0.0, dtype=torch.float64), atol=1e-9, rtol=0)


def test_slopes_are_the_derivatives_of_the_weights():
    place = torch.linspace(0.013, 0.987, 41, dtype=torch.float64)
    step = 1e-6
    above, below = (spline.weights(place + sign * step, 5)[1] for sign in (1, -1))
    torch.testing.assert_close(spline.weights(place, 5)[2], (above - below) / (2 * step), atol=1e-6, rtol=0)


def test_a_fitted_spline_reproduces_any_cubic():
    grid = spline.sample_grid(4)
    coefficients = spline.fit_matrix(grid, 4) @ (2 - grid + 3 * grid**3)
    place = torch.linspace(0, 1, 33, dtype=torch.float64)
    first, weight, _ = spline.weights(place, 4)
    value = (coefficients[first[:, None] + torch.arange(4)] * weight).sum(1)
    torch.testing.assert_close(value, 2 - place + 3 * place**3)


def test_the_rows_of_a_cube_are_those_of_its_flattened_coefficients():
    spans = (2, 3, 4)
    cube = torch.arange(5 * 6 * 7, dtype=torch.float64).reshape(5, 6, 7)
    place = torch.tensor([[0.6], [0.4], [0.9]], dtype=torch.float64)
    row, weight, _ = spline.local(place, spans)
    first = [int(spline.weights(axis, pieces)[0]) for axis, pieces in zip(place, spans, strict=True)]
    block = cube[first[0] : first[0] + 4, first[1] : first[1] + 4, first[2] : first[2] + 4]
    assert torch.equal(cube.flatten()[row[0]], block.flatten())
    wanted = torch.einsum("i,j,k,ijk->", *(part[0] for part in weight), block)
    torch.testing.assert_close((cube.flatten()[row[0]] * spline.outer(*weight)[0]).sum(), wanted)
