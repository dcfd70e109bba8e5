import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.objectives.style_loss import Cloud, cosine_cost, euclidean_cost, relaxed_emd
from support.transport import exact_transport


def clouds(seed: int, count: int, others: int, channels: int) -> tuple[torch.Tensor, torch.Tensor]:
    chance = torch.Generator().manual_seed(seed)
    a = torch.randn(count, channels, generator=chance, dtype=torch.float64)
    return a, torch.randn(others, channels, generator=chance, dtype=torch.float64)


@given(st.integers(0, 10_000), st.integers(1, 30), st.integers(1, 30), st.integers(1, 5), st.booleans())
def test_the_relaxed_distance_is_a_lower_bound_of_the_exact_one(
    seed: int, count: int, others: int, channels: int, cosine: bool
) -> None:
    a, b = clouds(seed, count, others, channels)
    cost = cosine_cost(a, b) if cosine else euclidean_cost(a, b)
    assert float(relaxed_emd(cost)) <= exact_transport(cost.numpy()) + 1e-9


def test_it_is_exact_where_one_cloud_is_a_single_point() -> None:
    a, b = clouds(3, 1, 20, 4)
    cost = euclidean_cost(a, b)
    assert float(relaxed_emd(cost)) == pytest.approx(exact_transport(cost.numpy()))


@pytest.mark.parametrize("cost", [cosine_cost, euclidean_cost])
def test_slopes_are_right(cost: object) -> None:
    a, b = clouds(4, 6, 5, 3)
    assert torch.autograd.gradcheck(lambda x: relaxed_emd(cost(x, b)), a.requires_grad_())


def test_equal_and_empty_features_have_finite_slopes() -> None:
    a = torch.zeros(4, 3, requires_grad=True)
    (relaxed_emd(euclidean_cost(a, torch.zeros(4, 3))) + relaxed_emd(cosine_cost(a, torch.ones(2, 3)))).backward()
    assert bool(torch.isfinite(a.grad).all())


def moment_distance(a: torch.Tensor, b: torch.Tensor) -> torch.Tensor:
    """Mean absolute difference of the means, plus that of the covariances."""
    covariances = (torch.cov(one.T, correction=0) for one in (a, b))
    return (a.mean(0) - b.mean(0)).abs().mean() + torch.sub(*covariances).abs().mean()


@pytest.mark.parametrize("cosine", [True, False])
@pytest.mark.parametrize("counts", [(40, 25), (25, 40), (1, 7)])
def test_a_kept_cloud_tells_what_the_whole_matrix_of_costs_tells(cosine: bool, counts: tuple[int, int]) -> None:
    a, b = clouds(6, *counts, 5)
    found = []
    for kept in (True, False):
        seen = a.clone().requires_grad_()
        cost = cosine_cost(seen, b) if cosine else euclidean_cost(seen, b)
        value = Cloud(b, cosine=cosine).distance(seen) if kept else relaxed_emd(cost) + moment_distance(seen, b)
        found.append((value.detach(), *torch.autograd.grad(value, seen)))
    torch.testing.assert_close(*found, rtol=1e-6, atol=1e-9)
