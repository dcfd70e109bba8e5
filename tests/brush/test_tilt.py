"""Marks of a tilted brush as the stroke model draws them: one soft side, and the upright mark without a tilt."""

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from frida_painter.brush.family_field import FamilyRibbon
from frida_painter.brush.kinds import StrokeModel
from frida_painter.brush.tilt import tilt_marks
from frida_painter.canvas_size import CanvasSize
from frida_painter.render import render
from frida_painter.stroke_family import Taught
from frida_painter.strokes import MAX_TILT, Strokes
from marks import SMALL, ribbon, shapes, wave_family
from support.planning import small_table

SIZE = CanvasSize(0.06, 0.04)


def strokes(*lefts: float, forward: float = 0.0, dtype: torch.dtype = torch.float32) -> Strokes:
    """Straight black strokes from left to right with the brush leaning to the left by degrees."""
    one = torch.ones(len(lefts), dtype=dtype)
    tilt = torch.tensor([[math.radians(left), math.radians(forward)] for left in lefts], dtype=dtype)
    place = one[:, None] * torch.tensor([[0.015, 0.02]], dtype=dtype)
    return Strokes(place, 0 * one, 0.03 * one, 0 * one, 0.8 * one, torch.zeros(len(lefts), 3, dtype=dtype), tilt=tilt)


def across(one: Strokes, model: StrokeModel | None = None) -> Tensor:
    """Coverage across the middle of a stroke, ten pixels a millimetre, from its right side to its left."""
    picture = render(one, model or ribbon(48, 84), torch.ones(3, 400, 600), SIZE)
    return (1 - picture[0, :, 300]).flip(0)


def sides(coverage: Tensor) -> tuple[float, float]:
    """Widths in mm of the right and the left side, from a tenth to nine tenths of full paint."""
    share = coverage / coverage.max()
    full, some = (share > 0.9).nonzero()[:, 0], (share > 0.1).nonzero()[:, 0]
    return float(full[0] - some[0]) / 10, float(some[-1] - full[-1]) / 10


@pytest.mark.parametrize("table", [False, True])
def test_strokes_without_a_tilt_are_painted_bit_for_bit_as_upright_ones(table: bool) -> None:
    model = small_table() if table else ribbon()
    some = strokes(0.0, 0.0)
    pictures = [render(replace(some, tilt=tilt), model, torch.ones(3, 80, 120), SIZE) for tilt in (None, some.tilt)]
    assert torch.equal(*pictures)
    beside = render(replace(strokes(0.0, 40.0), tilt=None), model, torch.ones(3, 80, 120), SIZE)
    assert not torch.equal(beside, render(strokes(0.0, 40.0), model, torch.ones(3, 80, 120), SIZE))


def test_the_side_under_the_handle_is_soft_and_grows_with_the_tilt() -> None:
    right, left = zip(*(sides(across(strokes(degrees))) for degrees in (0.0, 30.0, 40.0)), strict=True)
    assert left[0] < left[1] < left[2] and left[2] > 1.5 * max(right)
    assert torch.allclose(across(strokes(-40.0)), across(strokes(40.0)).flip(0), atol=1e-3)


def test_a_lean_along_the_path_changes_neither_side() -> None:
    assert sides(across(strokes(0.0, forward=40.0))) == pytest.approx(sides(across(strokes(0.0))), abs=0.3)


def test_gradients_of_a_tilted_mark_are_the_true_ones() -> None:
    thickness, length, bend = shapes(3, dtype=torch.float64)
    magnitude, corner = torch.rand(3, 6, 9, dtype=torch.float64), torch.zeros(3, 2, dtype=torch.float64)
    some = strokes(-20.0, 25.0, 35.0, forward=12.0, dtype=torch.float64)
    assert some.tilt is not None

    def marks(tilt: Tensor, thickness: Tensor, length: Tensor, bend: Tensor) -> tuple[Tensor, Tensor]:
        leaning = replace(some, tilt=tilt, thickness=thickness, length=length / 100, bend=bend / 100)
        return tilt_marks(magnitude, torch.zeros(3, 2, 3, dtype=torch.float64), corner, leaning, ribbon(6, 9))

    assert torch.autograd.gradcheck(
        marks, [part.requires_grad_() for part in (some.tilt, thickness, 100 * length, 100 * bend)]
    )


def test_a_taught_stroke_is_soft_on_the_side_of_its_own_path() -> None:
    """The path of the wave goes up, down and up again; its mark fades from right to left of it everywhere."""
    family = wave_family()
    model = FamilyRibbon(SMALL.of_family(family))
    one, code = torch.ones(1), torch.zeros(1, 1)
    bare = Strokes(torch.zeros(1, 2), 0 * one, 0.05 * one, 0 * one, one, torch.zeros(1, 3), Taught.of(family, code))
    magnitude, affine = torch.ones(1, model.frame.rows, model.frame.columns), torch.zeros(1, 2, 3)
    leaning = replace(bare, tilt=torch.tensor([[MAX_TILT, 0.0]]))
    faded, _ = tilt_marks(magnitude, affine, torch.zeros(1, 2), leaning, model)
    path = bare.path(torch.linspace(0.2, 0.8, 7))[0]
    across, down = model.frame.pitch
    for x, y in path.tolist():
        column, row = round((x - model.frame.left) / across - 0.5), (model.frame.top - y) / down - 0.5
        left, right = (float(faded[0, round(row + side), column]) for side in (-2, 2))
        assert left < right


def test_descent_on_the_picture_finds_the_tilt_that_painted_it() -> None:
    canvas = torch.ones(3, 80, 120)
    with torch.no_grad():
        wanted = render(strokes(35.0), ribbon(), canvas, SIZE)
    tilt = torch.tensor([[math.radians(20.0), 0.0]], requires_grad=True)
    losses = []
    for step in range(24):
        loss = (render(replace(strokes(0.0), tilt=tilt), ribbon(), canvas, SIZE) - wanted).square().mean()
        (slope,) = torch.autograd.grad(loss, tilt)
        with torch.no_grad():
            tilt -= 0.06 * 0.85**step * slope.sign()
        losses.append(float(loss.detach()))
    assert losses[-1] < 0.05 * losses[0]
    assert float(tilt.detach()[0, 0]) == pytest.approx(math.radians(35.0), abs=0.03)
