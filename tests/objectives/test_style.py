import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.objectives.style import Cloud, Style, euclidean_cost
from support.networks import QuickVgg
from support.planning import picture
from support.transport import exact_transport


def style_of(image: torch.Tensor, seed: int = 0) -> Style:
    return Style(image, QuickVgg(), seed)


def test_a_picture_has_its_own_style_and_another_has_not() -> None:
    image = picture(64, 86)
    style = style_of(image)
    with torch.no_grad():
        own, turned, other = float(style(image)), float(style(image.flip(2))), float(style(1 - image))
    assert own < 0.2 * other
    assert turned < 0.5 * other, "what lies elsewhere is in the same style"


def test_colors_alone_matter_too() -> None:
    image = picture(64, 86)
    style = style_of(image)
    with torch.no_grad():
        assert float(style(image[[2, 1, 0]])) > 5 * float(style(image))


def test_descending_it_brings_the_style_nearer() -> None:
    style = style_of(picture(48, 64))
    image = torch.full((3, 48, 64), 0.5, requires_grad=True)
    adam = torch.optim.Adam([image], lr=0.05)
    start = float(style(image).detach())
    for _ in range(6):
        adam.zero_grad()
        style(image).backward()
        adam.step()
    assert float(style(image).detach()) < 0.8 * start


def test_what_is_free_of_the_style_does_not_count() -> None:
    image = picture(64, 86)
    free = torch.zeros(8, 10)
    free[:, 5:] = 1
    changed = image.clone()
    changed[:, :, 48:] = 1 - changed[:, :, 48:]
    losses = []
    for places in (free, None):
        style = Style(image, QuickVgg(), 0, free=places)
        with torch.no_grad():
            losses.append(float(style(changed)) - float(style(image)))
    assert losses[0] < 0.3 * losses[1]


def clouds(seed: int, count: int, others: int, channels: int) -> tuple[torch.Tensor, torch.Tensor]:
    chance = torch.Generator().manual_seed(seed)
    a = torch.randn(count, channels, generator=chance, dtype=torch.float64)
    return a, torch.randn(others, channels, generator=chance, dtype=torch.float64)


def costs(a: torch.Tensor, b: torch.Tensor, *, cosine: bool) -> torch.Tensor:
    return 1 - torch.cosine_similarity(a[:, None], b[None], dim=2) if cosine else euclidean_cost(a, b)


def apart(a: torch.Tensor, b: torch.Tensor, *, cosine: bool) -> torch.Tensor:
    """The relaxed Earth Mover's Distance, from the whole matrix of costs."""
    cost = costs(a, b, cosine=cosine)
    return torch.maximum(cost.amin(1).mean(), cost.amin(0).mean())


def moment_distance(a: torch.Tensor, b: torch.Tensor) -> torch.Tensor:
    """Mean absolute difference of the means, plus that of the covariances."""
    covariances = (torch.cov(one.T, correction=0) for one in (a, b))
    return (a.mean(0) - b.mean(0)).abs().mean() + torch.sub(*covariances).abs().mean()


@given(st.integers(0, 10_000), st.integers(1, 30), st.integers(1, 30), st.integers(1, 5), st.booleans())
def test_without_the_moments_it_is_a_lower_bound_of_the_exact_distance(
    seed: int, count: int, others: int, channels: int, cosine: bool
) -> None:
    a, b = clouds(seed, count, others, channels)
    cost = costs(a, b, cosine=cosine)
    relaxed, exact = float(Cloud(b, cosine=cosine).distance(a) - moment_distance(a, b)), exact_transport(cost.numpy())
    assert relaxed <= exact + 1e-5  # a direction of almost no length is not exact
    assert 1 not in (count, others) or relaxed == pytest.approx(exact, abs=1e-5), "exact for a single point"


@pytest.mark.parametrize("cosine", [True, False])
@pytest.mark.parametrize("counts", [(40, 25), (25, 40), (1, 7)])
def test_values_and_slopes_are_those_of_the_whole_matrix_of_costs(cosine: bool, counts: tuple[int, int]) -> None:
    a, b = clouds(6, *counts, 5)
    found = []
    for kept in (True, False):
        seen = a.clone().requires_grad_()
        plain = apart(seen, b, cosine=cosine) + moment_distance(seen, b)
        value = Cloud(b, cosine=cosine).distance(seen) if kept else plain
        found.append((value.detach(), *torch.autograd.grad(value, seen)))
    torch.testing.assert_close(*found, rtol=1e-6, atol=1e-9)


def test_equal_and_empty_features_have_finite_slopes() -> None:
    a = torch.zeros(4, 3, requires_grad=True)
    told = [
        Cloud(other, cosine=cosine).distance(a)
        for cosine, other in ((False, torch.zeros(4, 3)), (True, torch.ones(2, 3)))
    ]
    torch.stack(told).sum().backward()
    assert a.grad is not None and bool(torch.isfinite(a.grad).all())
