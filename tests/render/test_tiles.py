"""The GPU's renderer equals the reference: interpreted on the CPU by Triton, or on a GPU where there is one."""

import copy
import os
import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from hypothesis import given, settings
from torch import Tensor
from torch.utils._python_dispatch import _disable_current_modes

from composites import VARYING_SCENES, Scene, assert_same, moments_with_gradients, scene, upstream
from elsewhere import elsewhere, waits
from frida_painter.brush.kinds import CERTAIN, CoverageSpread
from frida_painter.planning import problem as planning
from frida_painter.planning.optimize import optimize
from frida_painter.render import reference
from nightly import installed
from support.planning import CANVAS, small_table, some_strokes

DEVICE = torch.device("cuda" if torch.cuda.is_available() else "cpu")
installed("triton")
from frida_painter.render import tiles  # noqa: E402


def both(tensors: Scene, spread: CoverageSpread) -> tuple[list[Tensor], list[Tensor]]:
    theirs = moments_with_gradients(reference.composite_moments, tensors, spread)
    return moments_with_gradients(tiles.composite_moments, tensors, spread, DEVICE), theirs


@given(**VARYING_SCENES)
@settings(max_examples=min(20, settings.default.max_examples), deadline=None)
def test_it_equals_the_reference_with_every_gradient(
    n: int, cells: tuple[int, int], pixels: tuple[int, int], scale: float, share: float, full: float, seed: int
) -> None:
    assert_same(*both(scene(n, cells, pixels, seed, scale=scale), CoverageSpread(share, full)))


def test_many_strokes_over_one_another_equal_the_reference() -> None:
    assert_same(*both(scene(50, (5, 7), (9, 18), spread=0.6), CoverageSpread(0.5, 0.97)))


def test_strokes_that_never_vary_leave_the_plain_picture() -> None:
    tensors = scene(9, (6, 8), (20, 30))
    seen = tiles.composite(*(tensor.to(DEVICE) for tensor in tensors)).cpu()
    torch.testing.assert_close(seen, reference.composite(*tensors), rtol=0, atol=1e-12)


def test_float32_is_near_the_reference() -> None:
    mine, theirs = both(scene(12, (6, 8), (20, 30), dtype=torch.float32), CoverageSpread(0.4, 0.9))
    assert_same(mine[:2], theirs[:2], within=1e-5)
    assert_same(mine[3:], theirs[3:], within=1e-2)  # places are ill-conditioned where a map has kinks


def test_a_colour_that_is_not_finite_spoils_all_of_it_and_its_gradients() -> None:
    tensors = scene(3, (4, 5), (9, 8))
    tensors.color[1, 2] = torch.nan
    mean, variance, *gradients = moments_with_gradients(tiles.composite_moments, tensors, CERTAIN, DEVICE)
    assert bool(mean.isnan().all()) and bool(variance.isnan().all())
    assert all(bool(part.isnan().all()) for part in gradients[:3])


def test_gradients_to_bare_cells_are_left_out_where_nobody_asks() -> None:
    magnitude, affine, color, canvas = (tensor.to(DEVICE) for tensor in scene(5, (6, 8), (12, 14)))
    found = []
    for answer in (True, False):
        maps = magnitude.clone().requires_grad_()
        picture = tiles.composite(maps, affine, color, canvas, bare_cells_answer=answer)
        found.append(torch.autograd.grad(picture, maps, upstream(picture.cpu()).to(picture))[0])
    torch.testing.assert_close(found[1][magnitude != 0], found[0][magnitude != 0], rtol=0, atol=1e-9)
    assert float(found[0][magnitude == 0].abs().sum()) > float(found[1][magnitude == 0].abs().sum())


class Unwrapped:
    """A kernel for the pretended device, whose tensors hold those that are there."""

    def __init__(self, kernel: Any) -> None:
        self._kernel = kernel

    def __getitem__(self, grid: tuple[int, int]) -> Callable[..., None]:
        def launch(*given: Any, **constants: Any) -> None:
            with _disable_current_modes():
                self._kernel[grid](*(getattr(one, "held", one) for one in given), **constants)

        return launch


def darkened(device: torch.device) -> planning.PlanningProblem:
    """A canvas on which strokes whose coverage varies are to be as dark as can be."""
    model = copy.deepcopy(small_table())
    model.spread = CoverageSpread(0.3, 0.95)

    def dark(picture: Tensor, variance: Tensor | None = None) -> Tensor:
        return picture.square().mean() + (0 if variance is None else variance.mean())

    return planning.PlanningProblem(torch.ones(3, 24, 32).to(device), CANVAS, planning.on_device(model, device), dark)


@pytest.mark.skipif(DEVICE.type == "cuda", reason="the kernels are compiled for the GPU here")
def test_a_plan_is_optimised_in_tiles_without_a_wait(monkeypatch) -> None:
    strokes = some_strokes(3)
    here, _ = optimize(strokes, darkened(torch.device("cpu")), iterations=9)
    monkeypatch.setattr("frida_painter.render.painting._find_renderer", lambda canvas: tiles)
    kernels = SimpleNamespace(lay=Unwrapped(tiles.tile_kernels.lay), pull=Unwrapped(tiles.tile_kernels.pull))
    monkeypatch.setattr(tiles, "tile_kernels", kernels)
    with elsewhere() as device:
        on, there = darkened(device), strokes.to(device)
        with waits() as noted:
            found = optimize(there, on, iterations=9)[0]
        found = found.to("cpu")
    assert Counter(noted) == {"new_tensor": 1, "tolist": 2}  # units, before the first iteration; nine are read in two
    for name, group in here.arrays().items():
        torch.testing.assert_close(found.arrays()[name], group, rtol=1e-3, atol=1e-4)


COMPILED = """
import triton
from triton.backends.compiler import GPUTarget
from triton.compiler import ASTSource
from frida_painter.render import tile_kernels

whole = {"boxes": "*i32", "counts": "*i32", "lists": "*i32", "to_maps": "*i64", "to_strokes": "*i64"}
counts = "strokes bin_side bins_across height width rows columns segment segments".split()
for kernel, choice in ((tile_kernels.lay, "KEEP"), (tile_kernels.pull, "BARE_ANSWERS")):
    kinds = {name: "*fp32" for name in kernel.arg_names}
    kinds |= {name: whole[name] if name in whole else "i32" for name in kinds if name in whole or name in counts}
    kinds |= {name: "constexpr" for name in kinds if name.isupper()}
    for wanted in (False, True):
        source = ASTSource(kernel, signature=kinds, constexprs={choice: wanted, "ROWS": 16, "COLUMNS": 16})
        for capability in (75, 80, 90):
            assert triton.compile(source, target=GPUTarget("cuda", capability, 32)).asm["cubin"]
"""


def test_the_kernels_compile_for_gpus_of_three_generations(tmp_path) -> None:
    environment = {name: text for name, text in os.environ.items() if name != "TRITON_INTERPRET"}
    environment["TRITON_CACHE_DIR"] = str(tmp_path)
    subprocess.run([sys.executable, "-c", COMPILED], env=environment, check=True, timeout=300)


@pytest.mark.parametrize("most", [1, 2, 32])
def test_bins_of_any_size_list_every_stroke_that_meets_them_in_painting_order(most: int, monkeypatch) -> None:
    monkeypatch.setattr(tiles, "_BINS", most)
    boxes, canvas = (
        torch.tensor([[0, 9, 0, 9], [0, 0, 0, 0], [10, 50, 30, 33], [15, 17, 15, 40]]),
        torch.zeros(4, 50, 40),
    )
    counts, lists, side, across = tiles._bins(boxes, canvas)
    assert side % tiles.TILE == 0 and across == -(-40 // side) <= most
    for bin_number, (count, mine) in enumerate(zip(counts.tolist(), lists.tolist(), strict=True)):
        top, left = bin_number // across * side, bin_number % across * side
        painted = [
            i
            for i, (a, b, c, d) in enumerate(boxes.tolist())
            if b > a and a < top + side and b > top and c < left + side and d > left
        ]
        assert mine[:count] == painted
