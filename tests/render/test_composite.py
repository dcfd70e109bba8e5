"""What every path of the renderer must do: what the reference does."""

import itertools
import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from composites import F64, Composite, Scene, assert_same, scene, with_gradients
from frida_painter.render import reference, scanline

pytestmark = pytest.mark.parametrize("composite", [scanline.composite], ids=["scanline"])


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
    composite: Composite,
    n: int,
    cells: tuple[int, int],
    pixels: tuple[int, int],
    scale: float,
    spread: float,
    seed: int,
) -> None:
    tensors = scene(n, cells, pixels, seed, scale=scale, spread=spread)
    assert_same(with_gradients(composite, tensors), with_gradients(reference.composite, tensors))


@pytest.mark.parametrize("shift", [(0, 0), (-1, 2), (7, -3), (-4, -6), (18, 11)])
def test_samples_on_cells_take_the_same_side_of_the_kink(composite: Composite, shift: tuple[int, int]) -> None:
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
def test_maps_that_are_squeezed_flat_or_pulled_without_end(composite: Composite, matrix: list[list[float]]) -> None:
    tensors = scene(1, (5, 6), (8, 9))._replace(affine=torch.tensor([matrix], dtype=F64))
    assert_same(with_gradients(composite, tensors), with_gradients(reference.composite, tensors))


@pytest.mark.parametrize("wanted", [flags for flags in itertools.product((True, False), repeat=4) if any(flags)])
def test_any_choice_of_gradients_gives_the_same_ones(composite: Composite, wanted: tuple[bool, ...]) -> None:
    tensors = scene(9, (6, 8), (20, 22))
    picture, *every = with_gradients(composite, tensors)
    chosen = [part for part, wants in zip(every, wanted, strict=True) if wants]
    assert_same(with_gradients(composite, tensors, wanted), [picture, *chosen], within=1e-12)


def test_single_precision_gradients_to_maps_and_colors_agree(composite: Composite) -> None:
    tensors = scene(40, (24, 40), (64, 80), scale=0.8)
    single = Scene(*(tensor.float() for tensor in tensors))
    ours = with_gradients(composite, single)
    theirs = with_gradients(reference.composite, Scene(*(tensor.double() for tensor in single)))
    for k in (1, 3, 4):
        torch.testing.assert_close(ours[k].double(), theirs[k], rtol=1e-4, atol=1e-3)


def test_strokes_off_the_canvas_leave_it_and_get_no_gradient(composite: Composite) -> None:
    tensors = scene(5, (4, 6), (9, 9))
    away = tensors._replace(affine=moved(tensors.affine, 500, -300))
    picture, to_map, to_affine, to_color, _ = with_gradients(composite, away)
    assert torch.equal(picture, away.canvas)
    assert not to_map.any() and not to_affine.any() and not to_color.any()


def test_the_canvas_given_is_not_painted_on(composite: Composite) -> None:
    tensors = scene(5, (6, 6), (16, 16))
    before = tensors.canvas.clone()
    composite(*tensors)
    assert torch.equal(tensors.canvas, before)


def test_a_picture_without_gradients_is_the_same_one(composite: Composite) -> None:
    tensors = scene(12, (6, 9), (30, 31))
    picture = composite(*tensors)
    assert not picture.requires_grad
    with torch.no_grad():
        unwatched = composite(*(tensor.clone().requires_grad_() for tensor in tensors))
    assert not unwatched.requires_grad
    watched = with_gradients(composite, tensors)[0]
    assert torch.equal(picture, watched)
    assert torch.equal(picture, unwatched)


def test_strides_do_not_matter(composite: Composite) -> None:
    tensors = scene(7, (6, 9), (21, 18))
    strided = Scene(
        tensors.magnitude.transpose(1, 2).contiguous().transpose(1, 2),
        tensors.affine.repeat_interleave(2, 0)[::2],
        tensors.color.T.contiguous().T,
        tensors.canvas.permute(1, 2, 0).contiguous().permute(2, 0, 1),
    )
    assert not any(tensor.is_contiguous() for tensor in strided)
    assert_same(with_gradients(composite, strided), with_gradients(composite, tensors), within=1e-12)


def test_a_gradient_that_is_one_number_everywhere(composite: Composite) -> None:
    tensors = scene(7, (6, 9), (21, 18))
    leaves = [tensor.clone().requires_grad_() for tensor in tensors]
    twins = [tensor.clone().requires_grad_() for tensor in tensors]
    composite(*leaves).sum().backward()
    reference.composite(*twins).sum().backward()
    for leaf, twin in zip(leaves, twins, strict=True):
        assert leaf.grad is not None and twin.grad is not None
        torch.testing.assert_close(leaf.grad, twin.grad, rtol=0, atol=1e-9)


def test_a_color_that_is_not_a_number_spoils_the_picture_as_in_the_reference(composite: Composite) -> None:
    tensors = scene(3, (4, 4), (9, 9))
    tensors.color[1, 2] = math.nan
    ours, theirs = composite(*tensors), reference.composite(*tensors)
    assert theirs[2].isnan().all()
    assert ours[2].isnan().all()


def test_a_place_that_is_not_a_number_spoils_the_picture(composite: Composite) -> None:
    tensors = scene(3, (4, 4), (9, 9))
    tensors.affine[1, 0, 2] = math.nan
    assert composite(*tensors).isnan().all()


def test_a_cell_that_is_not_a_number_spoils_what_it_spoils_in_the_reference(composite: Composite) -> None:
    tensors = scene(3, (5, 6), (16, 16), spread=0.5)
    tensors.magnitude[1, 2, 3] = math.nan
    ours, theirs = composite(*tensors), reference.composite(*tensors)
    assert theirs.isnan().any() and not theirs.isnan().all()
    assert torch.equal(ours.isnan(), theirs.isnan())


def test_what_is_kept_grows_with_the_paint_and_not_with_the_canvas(composite: Composite) -> None:
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
