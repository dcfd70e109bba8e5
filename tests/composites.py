"""Scenes to composite, and their gradients."""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import torch
from hypothesis import strategies as st
from torch import Tensor

from frida_painter.brush.kinds import CoverageSpread

F64 = torch.float64
Composite = Callable[[Tensor, Tensor, Tensor, Tensor], Tensor]


# Arguments of `scene` and of `CoverageSpread`, for hypothesis.
VARYING_SCENES: dict[str, Any] = {
    "n": st.integers(0, 12),
    "cells": st.tuples(st.integers(1, 9), st.integers(1, 9)),
    "pixels": st.tuples(st.integers(1, 33), st.integers(1, 40)),
    "scale": st.sampled_from((0.05, 0.3, 1.0, 3.0, 20.0)),
    "share": st.floats(0, 1),
    "full": st.floats(0.05, 1),
    "seed": st.integers(0, 2**31),
}


class Scene(NamedTuple):
    """The four tensors that `composite` takes."""

    magnitude: Tensor
    affine: Tensor
    color: Tensor
    canvas: Tensor


def scene(
    n: int,
    cells: tuple[int, int],
    pixels: tuple[int, int],
    seed: int = 0,
    *,
    spread: float = 1.4,
    scale: float = 1.0,
    dtype: torch.dtype = F64,
) -> Scene:
    """Random marks, turned, stretched and spread around a random canvas; some maps have empty rims, some are empty."""
    generator = torch.Generator().manual_seed(seed)

    def random(*shape: int) -> Tensor:
        return torch.rand(shape, generator=generator, dtype=F64)

    (h, w), (height, width) = cells, pixels
    magnitude = random(n, h, w)
    magnitude[::3, : h // 3] = 0
    magnitude[::4, :, w // 2 :] = 0
    magnitude[6::7] = 0
    angle = 2 * math.pi * random(n)
    size = scale * torch.exp(1.5 * (random(n) - 0.5))
    turn = torch.stack((angle.cos(), -angle.sin(), angle.sin(), angle.cos()), -1).reshape(n, 2, 2) * size[:, None, None]
    corner = torch.tensor([width, height], dtype=F64)
    middle = (0.5 + spread * (random(n, 2) - 0.5)) * corner
    shift = torch.tensor([w / 2, h / 2], dtype=F64) - (turn @ middle[:, :, None])[:, :, 0]
    affine = torch.cat((turn, shift[:, :, None]), 2)
    tensors = magnitude, affine, random(n, 3), random(3, height, width)
    return Scene(*(tensor.to(dtype) for tensor in tensors))


def upstream(canvas: Tensor, seed: int = 99) -> Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(canvas.shape, generator=generator, dtype=F64).to(canvas.dtype)


def with_gradients(composite: Composite, tensors: Scene, wanted: tuple[bool, ...] = (True,) * 4) -> list[Tensor]:
    """The picture and the gradients to those tensors that are wanted."""
    leaves = [tensor.detach().requires_grad_(wants) for tensor, wants in zip(tensors, wanted, strict=True)]
    picture = composite(*leaves)
    asked = [leaf for leaf in leaves if leaf.requires_grad]
    gradients = torch.autograd.grad(picture, asked, upstream(picture), allow_unused=True)
    zeros = (torch.zeros_like(leaf) if part is None else part for leaf, part in zip(asked, gradients, strict=True))
    return [picture.detach(), *zeros]


def moments_with_gradients(composite, tensors: Scene, spread: CoverageSpread, device: str | torch.device = "cpu"):
    """Both moments, and the gradients of a random mixture of them to all tensors and the canvas's variance."""
    uncertain = upstream(tensors.canvas[0], 3).square() * 0.1
    leaves = [tensor.detach().to(device).requires_grad_() for tensor in (*tensors, uncertain)]
    mean, variance = composite(*leaves[:4], spread, leaves[4])
    mixture = (upstream(mean.cpu(), 1).to(mean) * mean).sum() + (upstream(variance.cpu(), 2).to(mean) * variance).sum()
    gradients = torch.autograd.grad(mixture, leaves, allow_unused=True)
    zeros = [torch.zeros_like(leaf) if part is None else part for leaf, part in zip(leaves, gradients, strict=True)]
    return [part.detach().cpu() for part in (mean, variance, *zeros)]


def assert_same(ours: list[Tensor], theirs: list[Tensor], within: float = 1e-9) -> None:
    for mine, their in zip(ours, theirs, strict=True):
        largest = float(their.abs().max()) if their.numel() else 0.0
        torch.testing.assert_close(mine, their, rtol=0, atol=within * max(1.0, largest))
