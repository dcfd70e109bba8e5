"""Some rows of a picture, rendered alone, are those rows of the whole picture, with the gradients that these give."""

import importlib.util

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from composites import F64, Scene, assert_same, scene, upstream
from frida_painter.brush.kinds import CERTAIN, CoverageSpread
from frida_painter.frames import Rows
from frida_painter.render import reference, render_moments, scanline
from marks import ribbon
from support.planning import CANVAS, some_strokes

VARIES = CoverageSpread(0.4, 0.9)
PATHS = [scanline.composite_moments]
if importlib.util.find_spec("triton") is not None:
    from frida_painter.render import tiles

    PATHS.append(tiles.composite_moments)


def mixture(mean: Tensor, variance: Tensor, rows: Rows, like: Tensor) -> Tensor:
    """A random mixture of moments that have these rows of a picture like that."""
    return (rows.of(upstream(like, 1)) * mean).sum() + (rows.of(upstream(like, 2)) * variance).sum()


def of_all(tensors: Scene, rows: Rows) -> list[Tensor]:
    """By the reference on the full canvas: rows of both moments, and the gradients of their mixture."""
    leaves = [tensor.detach().requires_grad_() for tensor in tensors]
    mean, variance = (rows.of(moment) for moment in reference.composite_moments(*leaves, VARIES))
    gradients = torch.autograd.grad(mixture(mean, variance, rows, tensors.canvas), leaves)
    return [mean.detach(), variance.detach(), *gradients]


def of_some(composite, tensors: Scene, rows: Rows) -> list[Tensor]:
    """The same by a path that is given these rows only."""
    leaves = [tensor.detach().requires_grad_() for tensor in tensors]
    magnitude, affine, color, canvas = leaves
    there = affine.new_tensor([[1, 0, 0], [0, rows.every, rows.first], [0, 0, 1]])
    mean, variance = composite(magnitude, affine @ there, color, rows.of(canvas), VARIES)
    gradients = torch.autograd.grad(mixture(mean, variance, rows, tensors.canvas), leaves)
    return [mean.detach(), variance.detach(), *gradients]


@pytest.mark.parametrize("composite", PATHS, ids=lambda path: path.__module__.rpartition(".")[2])
@given(
    n=st.integers(1, 12),
    cells=st.tuples(st.integers(1, 9), st.integers(1, 9)),
    pixels=st.tuples(st.integers(1, 40), st.integers(1, 20)),
    scale=st.sampled_from((0.05, 0.3, 1.0, 3.0)),
    every=st.integers(1, 9),
    first=st.integers(0, 8),
    seed=st.integers(0, 2**31),
)
@settings(max_examples=min(15, settings.default.max_examples), deadline=None)
def test_a_path_that_sees_some_rows_equals_the_reference_on_all(
    composite, n: int, cells: tuple[int, int], pixels: tuple[int, int], scale: float, every: int, first: int, seed: int
) -> None:
    rows = Rows(every, min(first, every - 1, pixels[0] - 1))
    tensors = scene(n, cells, pixels, seed, scale=scale)
    assert_same(of_some(composite, tensors, rows), of_all(tensors, rows))


@pytest.mark.parametrize("spread", [CERTAIN, VARIES], ids=["certain", "varies"])
@pytest.mark.parametrize("rows", [Rows(2, 1), Rows(4, 0), Rows(5, 3)], ids=str)
def test_strokes_are_rendered_on_some_rows_as_on_all(rows: Rows, spread: CoverageSpread) -> None:
    found = []
    for picked in (Rows(), rows):
        strokes = some_strokes(12, dtype=F64)
        leaves = {name: part.requires_grad_() for name, part in strokes.arrays().items()}
        moments = render_moments(
            strokes, ribbon().to(F64), torch.full((3, 61, 81), 0.8, dtype=F64), CANVAS, spread, picked
        )
        mean, variance = (moment if picked is rows else rows.of(moment) for moment in moments)
        gradients = torch.autograd.grad(
            mixture(mean, variance, rows, torch.empty(3, 61, 81, dtype=F64)), leaves.values()
        )
        found.append([mean.detach(), variance.detach(), *gradients])
    assert_same(found[1], found[0])
