"""What every path of the renderer must do: what the reference does."""

import itertools
import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from composites import F64, VARYING_SCENES, Scene, assert_same, moments_with_gradients, scene, with_gradients
from frida_painter.brush.kinds import CERTAIN, CoverageSpread
from frida_painter.render import reference, scanline

composite, composite_moments = scanline.composite, scanline.composite_moments


def moved(affine: Tensor, columns: int, rows: int) -> Tensor:
    """The affine maps for a canvas whose pixel (0, 0) was pixel (columns, rows)."""
    shift = affine[:, :, 0] * columns + affine[:, :, 1] * rows
    return torch.cat((affine[:, :, :2], (affine[:, :, 2] + shift)[:, :, None]), 2)


@given(
    n=st.integers(0, 12),
    cells=st.tuples(st.integers(1, 9), st.integers(1, 9)),
    pixels=st.tuples(st.integers(1, 33), st.integers(1, 40)),
    scale=st.sampled_from((0.05, 0.3, 1.0, 3.0, 20.0)),
    spread=st.sampled_from((0.5, 1.4, 5.0)),
    seed=st.integers(0, 2**31),
)
def test_it_equals_the_reference_with_every_gradient(
    n: int, cells: tuple[int, int], pixels: tuple[int, int], scale: float, spread: float, seed: int
) -> None:
    tensors = scene(n, cells, pixels, seed, scale=scale, spread=spread)
    assert_same(with_gradients(composite, tensors), with_gradients(reference.composite, tensors))


@pytest.mark.parametrize("shift", [(0, 0), (-1, 2), (7, -3), (-4, -6), (18, 11)])
def test_samples_on_cells_take_the_same_side_of_the_kink(shift: tuple[int, int]) -> None:
    tensors = scene(1, (6, 5), (14, 17))
    affine = torch.tensor([[[1.0, 0.0, -shift[0]], [0.0, 1.0, -shift[1]]]], dtype=F64)
    tensors = tensors._replace(affine=affine)
    assert_same(with_gradients(composite, tensors), with_gradients(reference.composite, tensors))


@pytest.mark.parametrize(
    "matrix",
    [
        [[0.0, 0.0, 2.5], [0.0, 0.0, 1.5]],
        [[0.3, 0.6, 1.2], [0.1, 0.2, 0.7]],
        [[0.0, 0.5, -0.3], [0.5, 0.0, -0.4]],
        [[1e-12, 0.0, 2.5], [0.0, 1e-12, 1.5]],
        [[0.0, 0.0, 99.0], [0.0, 1.0, 0.0]],
    ],
)
def test_maps_that_are_squeezed_flat_or_pulled_without_end(matrix: list[list[float]]) -> None:
    tensors = scene(1, (5, 6), (8, 9))._replace(affine=torch.tensor([matrix], dtype=F64))
    assert_same(with_gradients(composite, tensors), with_gradients(reference.composite, tensors))


@pytest.mark.parametrize("wanted", [flags for flags in itertools.product((True, False), repeat=4) if any(flags)])
def test_any_choice_of_gradients_gives_the_same_ones(wanted: tuple[bool, ...]) -> None:
    tensors = scene(9, (6, 8), (20, 22))
    picture, *every = with_gradients(composite, tensors)
    chosen = [part for part, wants in zip(every, wanted, strict=True) if wants]
    assert_same(with_gradients(composite, tensors, wanted), [picture, *chosen], within=1e-12)


def test_single_precision_gradients_to_maps_and_colors_agree() -> None:
    tensors = scene(40, (24, 40), (64, 80), scale=0.8)
    single = Scene(*(tensor.float() for tensor in tensors))
    ours = with_gradients(composite, single)
    theirs = with_gradients(reference.composite, Scene(*(tensor.double() for tensor in single)))
    for k in (1, 3, 4):
        torch.testing.assert_close(ours[k].double(), theirs[k], rtol=1e-4, atol=1e-3)


def test_strokes_off_the_canvas_leave_it_and_get_no_gradient() -> None:
    tensors = scene(5, (4, 6), (9, 9))
    away = tensors._replace(affine=moved(tensors.affine, 500, -300))
    picture, to_map, to_affine, to_color, _ = with_gradients(composite, away)
    assert torch.equal(picture, away.canvas)
    assert not to_map.any() and not to_affine.any() and not to_color.any()


def test_the_canvas_given_is_not_painted_on() -> None:
    tensors = scene(5, (6, 6), (16, 16))
    before = tensors.canvas.clone()
    composite(*tensors)
    assert torch.equal(tensors.canvas, before)


def test_a_picture_without_gradients_is_the_same_one() -> None:
    tensors = scene(12, (6, 9), (30, 31))
    picture = composite(*tensors)
    assert not picture.requires_grad
    with torch.no_grad():
        unwatched = composite(*(tensor.clone().requires_grad_() for tensor in tensors))
    assert not unwatched.requires_grad
    watched = with_gradients(composite, tensors)[0]
    assert torch.equal(picture, watched)
    assert torch.equal(picture, unwatched)


def test_strides_do_not_matter() -> None:
    tensors = scene(7, (6, 9), (21, 18))
    strided = Scene(
        tensors.magnitude.transpose(1, 2).contiguous().transpose(1, 2),
        tensors.affine.repeat_interleave(2, 0)[::2],
        tensors.color.T.contiguous().T,
        tensors.canvas.permute(1, 2, 0).contiguous().permute(2, 0, 1),
    )
    assert not any(tensor.is_contiguous() for tensor in strided)
    assert_same(with_gradients(composite, strided), with_gradients(composite, tensors), within=1e-12)


def test_a_gradient_that_is_one_number_everywhere() -> None:
    tensors = scene(7, (6, 9), (21, 18))
    leaves = [tensor.clone().requires_grad_() for tensor in tensors]
    twins = [tensor.clone().requires_grad_() for tensor in tensors]
    composite(*leaves).sum().backward()
    reference.composite(*twins).sum().backward()
    for leaf, twin in zip(leaves, twins, strict=True):
        assert leaf.grad is not None and twin.grad is not None
        torch.testing.assert_close(leaf.grad, twin.grad, rtol=0, atol=1e-9)


def test_a_color_that_is_not_a_number_spoils_the_picture_as_in_the_reference() -> None:
    tensors = scene(3, (4, 4), (9, 9))
    tensors.color[1, 2] = math.nan
    ours, theirs = composite(*tensors), reference.composite(*tensors)
    assert theirs[2].isnan().all()
    assert ours[2].isnan().all()


def test_a_place_that_is_not_a_number_spoils_the_picture() -> None:
    tensors = scene(3, (4, 4), (9, 9))
    tensors.affine[1, 0, 2] = math.nan
    assert composite(*tensors).isnan().all()


def test_a_cell_that_is_not_a_number_spoils_what_it_spoils_in_the_reference() -> None:
    tensors = scene(3, (5, 6), (16, 16), spread=0.5)
    tensors.magnitude[1, 2, 3] = math.nan
    ours, theirs = composite(*tensors), reference.composite(*tensors)
    assert theirs.isnan().any() and not theirs.isnan().all()
    assert torch.equal(ours.isnan(), theirs.isnan())


def test_what_is_kept_grows_with_the_paint_and_not_with_the_canvas() -> None:
    def kept(side: int) -> int:
        tensors = scene(10, (8, 8), (side, side), spread=0.2)
        sizes: list[int] = []

        def note(tensor: Tensor) -> Tensor:
            sizes.append(tensor.numel())
            return tensor

        with torch.autograd.graph.saved_tensors_hooks(note, lambda tensor: tensor):
            picture = composite(*(tensor.requires_grad_() for tensor in tensors))
        assert picture.requires_grad
        return sum(sizes) - sum(tensor.numel() for tensor in tensors)

    assert 0 < kept(300) <= 1.2 * kept(100)


@given(**VARYING_SCENES)
def test_moments_equal_the_reference_with_every_gradient(
    n: int, cells: tuple[int, int], pixels: tuple[int, int], scale: float, share: float, full: float, seed: int
) -> None:
    tensors, spread = scene(n, cells, pixels, seed, scale=scale), CoverageSpread(share, full)
    theirs = moments_with_gradients(reference.composite_moments, tensors, spread)
    assert_same(moments_with_gradients(composite_moments, tensors, spread), theirs)


def test_strokes_that_never_vary_leave_the_plain_picture_and_no_variance() -> None:
    tensors = scene(20, (6, 8), (20, 30))
    mean, variance = composite_moments(*tensors, CERTAIN)
    torch.testing.assert_close(mean, composite(*tensors), rtol=0, atol=1e-12)
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


def test_moments_in_single_precision_agree() -> None:
    tensors, spread = scene(30, (9, 12), (40, 50)), CoverageSpread(0.4, 0.97)
    single = Scene(*(tensor.float() for tensor in tensors))
    wide, narrow = (composite_moments(*part, spread) for part in (tensors, single))
    for one, other in zip(wide, narrow, strict=True):
        torch.testing.assert_close(one.float(), other, rtol=0, atol=5e-5)


def test_any_number_of_threads_computes_the_same_moments() -> None:
    tensors, spread, before = scene(60, (9, 12), (50, 40)), CoverageSpread(0.4, 0.97), torch.get_num_threads()
    found = []
    try:
        for threads in (1, 3):
            torch.set_num_threads(threads)
            found.append(moments_with_gradients(composite_moments, tensors, spread))
    finally:
        torch.set_num_threads(before)
    assert all(torch.equal(one, other) for one, other in zip(*found, strict=True))


@pytest.mark.parametrize("part", ["affine", "color"])
def test_what_is_not_a_number_spoils_both_moments(part: str) -> None:
    tensors = scene(3, (5, 6), (7, 8))
    getattr(tensors, part)[1] = torch.nan
    for moment in composite_moments(*tensors, CoverageSpread(0.4, 0.97)):
        assert moment.isnan().all()
