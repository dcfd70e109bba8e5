"""Mean and variance of what strokes of uncertain coverage leave: what the reference says, and what chance says."""

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from composites import F64, Scene, assert_same, scene, upstream
from frida_painter.brush.kinds import CERTAIN, CoverageSpread
from frida_painter.render import reference, scanline

PATHS = pytest.mark.parametrize("composite", [scanline.composite_moments], ids=["scanline"])


def uncertain(tensors: Scene) -> Tensor:
    """A variance that the canvas may have."""
    return upstream(tensors.canvas[0], 3).square() * 0.1


def with_gradients(composite, tensors: Scene, spread: CoverageSpread) -> list[Tensor]:
    """Both moments, and the gradients of a random mixture of them to all tensors and the canvas's variance."""
    leaves = [tensor.detach().requires_grad_() for tensor in (*tensors, uncertain(tensors))]
    mean, variance = composite(*leaves[:4], spread, leaves[4])
    mixture = (upstream(mean, 1) * mean).sum() + (upstream(variance, 2) * variance).sum()
    gradients = torch.autograd.grad(mixture, leaves, allow_unused=True)
    zeros = [torch.zeros_like(leaf) if part is None else part for leaf, part in zip(leaves, gradients, strict=True)]
    return [mean.detach(), variance.detach(), *zeros]


@PATHS
@given(
    n=st.integers(0, 12),
    cells=st.tuples(st.integers(1, 9), st.integers(1, 9)),
    pixels=st.tuples(st.integers(1, 33), st.integers(1, 40)),
    scale=st.sampled_from((0.05, 0.3, 1.0, 3.0, 20.0)),
    share=st.floats(0, 1),
    full=st.floats(0.05, 1),
    seed=st.integers(0, 2**31),
)
def test_it_equals_the_reference_with_every_gradient(
    composite, n: int, cells: tuple[int, int], pixels: tuple[int, int], scale: float, share: float, full: float,
    seed: int,
) -> None:  # fmt: skip
    tensors, spread = scene(n, cells, pixels, seed, scale=scale), CoverageSpread(share, full)
    theirs = with_gradients(reference.composite_moments, tensors, spread)
    assert_same(with_gradients(composite, tensors, spread), theirs)


@PATHS
def test_strokes_that_never_vary_leave_the_plain_picture_and_no_variance(composite) -> None:
    tensors = scene(20, (6, 8), (20, 30))
    mean, variance = composite(*tensors, CERTAIN)
    torch.testing.assert_close(mean, scanline.composite(*tensors), rtol=0, atol=1e-12)
    assert variance.abs().max() == 0


def test_they_are_the_moments_of_pictures_painted_by_chance() -> None:
    """Coverage that is 0 or full, independently: its mean m and its variance m (full - m) are known."""
    generator = torch.Generator().manual_seed(0)
    strokes, full, tries = 5, 0.8, 20_000
    chance = torch.rand(strokes, 1, 1, generator=generator, dtype=F64)
    color, canvas = torch.rand(strokes, 3, generator=generator, dtype=F64), torch.full((3, 1, 1), 0.7, dtype=F64)
    affine = torch.tensor([[1.0, 0, 0], [0, 1, 0]], dtype=F64).expand(strokes, 2, 3)
    mean, variance = reference.composite_moments(full * chance, affine, color, canvas, CoverageSpread(1.0, full))
    lands = torch.rand(tries, strokes, generator=generator, dtype=F64) < chance.flatten()
    pixel = torch.full((tries, 3), 0.7, dtype=F64)
    for i in range(strokes):
        cover = full * lands[:, i : i + 1].to(F64)
        pixel = pixel + cover * (color[i] - pixel)
    torch.testing.assert_close(mean[:, 0, 0], pixel.mean(0), rtol=0, atol=4 * float(pixel.std()) / tries**0.5)
    torch.testing.assert_close(variance[0, 0], pixel.var(0).mean(), rtol=0.05, atol=1e-4)


def test_single_precision_agrees() -> None:
    tensors, spread = scene(30, (9, 12), (40, 50)), CoverageSpread(0.4, 0.97)
    single = Scene(*(tensor.float() for tensor in tensors))
    wide, narrow = (scanline.composite_moments(*part, spread) for part in (tensors, single))
    for one, other in zip(wide, narrow, strict=True):
        torch.testing.assert_close(one.float(), other, rtol=0, atol=5e-5)


def test_any_number_of_threads_computes_the_same_bits() -> None:
    tensors, spread, before = scene(60, (9, 12), (50, 40)), CoverageSpread(0.4, 0.97), torch.get_num_threads()
    found = []
    try:
        for threads in (1, 3):
            torch.set_num_threads(threads)
            found.append(with_gradients(scanline.composite_moments, tensors, spread))
    finally:
        torch.set_num_threads(before)
    assert all(torch.equal(one, other) for one, other in zip(*found, strict=True))


@PATHS
@pytest.mark.parametrize("part", ["affine", "color"])
def test_what_is_not_a_number_spoils_both_moments(composite, part: str) -> None:
    tensors = scene(3, (5, 6), (7, 8))
    getattr(tensors, part)[1] = torch.nan
    for moment in composite(*tensors, CoverageSpread(0.4, 0.97)):
        assert moment.isnan().all()
