import math

import torch
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.canvas_size import CanvasSize
from frida_painter.planning.variables import Paints, Variables, as_palette
from frida_painter.strokes.palette import to_lab
from frida_painter.strokes.strokes import GROUPS, StrokeLimits
from support.planning import some_strokes

F64 = torch.float64
SIZE, LIMITS = CanvasSize(0.3, 0.2), StrokeLimits((0.006, 0.06), (-0.02, 0.02))


def random_paints(strokes: int, colors: int, seed: int) -> Paints:
    chance = torch.Generator().manual_seed(seed)
    color = torch.rand(colors, 3, generator=chance, dtype=F64)
    return Paints(color, torch.randint(colors, (strokes,), generator=chance))


@given(st.integers(1, 20), st.integers(0, 2**31))
def test_strokes_come_back_from_the_variables_as_they_went_in(count: int, seed: int) -> None:
    strokes = some_strokes(count, seed, F64)
    back = Variables(strokes, None, vary_colors=True).strokes()
    for name in GROUPS:
        assert torch.allclose(getattr(back, name), getattr(strokes, name), rtol=0, atol=1e-12), name


@given(st.integers(1, 20), st.integers(1, 5), st.integers(0, 2**31))
def test_with_paints_every_stroke_has_the_colour_of_its_paint(count: int, colors: int, seed: int) -> None:
    strokes, paints = some_strokes(count, seed, F64), random_paints(count, colors, seed)
    variables = Variables(strokes, paints, vary_colors=True)
    assert torch.allclose(variables.strokes().color, paints.color[paints.paint], rtol=0, atol=1e-12)
    kept = variables.paints()
    assert kept is not None and torch.equal(kept.paint, paints.paint)
    assert torch.allclose(kept.color, paints.color, rtol=0, atol=1e-12)


@given(st.integers(1, 20), st.integers(0, 2**31), st.booleans())
def test_the_order_goes_from_light_to_dark_and_keeps_equals_as_they_were(
    count: int, seed: int, with_paints: bool
) -> None:
    strokes = some_strokes(count, seed)[torch.randperm(count, generator=torch.Generator().manual_seed(seed))]
    chosen = random_paints(count, 3, seed)
    paints = Paints(chosen.color.float(), chosen.paint) if with_paints else None
    variables = Variables(strokes, paints, vary_colors=True)
    order = variables.order()
    assert sorted(order.tolist()) == list(range(count))
    # What the planner sorts by is the lightness of each paint, which float32 gives to a few millionths.
    lightness = to_lab(variables.strokes().detach().color)[order, 0]
    assert bool((lightness.diff() <= 1e-4).all())
    if with_paints:
        for paint in range(3):
            mine = order[chosen.paint[order] == paint]
            assert bool((mine.diff() > 0).all())


def test_gradients_arrive_in_every_variable() -> None:
    variables = Variables(some_strokes(4, dtype=F64), None, vary_colors=True)

    def everything(shape: torch.Tensor, color: torch.Tensor) -> tuple[torch.Tensor, ...]:
        variables.shape, variables.color = shape, color
        return tuple(variables.strokes().arrays().values())

    leaves = [leaf.detach().clone().requires_grad_() for leaf in variables.leaves]
    assert torch.autograd.gradcheck(everything, tuple(leaves))


def test_turning_a_stroke_leaves_its_middle_where_it_is() -> None:
    strokes = some_strokes(6, dtype=F64)
    variables = Variables(strokes, None, vary_colors=True)
    with torch.no_grad():
        variables.shape[:, 2] += 5
        variables.shape[:, 3] += 2
    half = torch.tensor([0.5], dtype=F64)

    def middle(of):  # half of the bend, where the variables hold a stroke, and not three quarters, where its path is
        aside = torch.stack((-of.angle.sin(), of.angle.cos()), -1)
        return of.path(half)[:, 0] - aside * of.bend[:, None] / 4

    assert torch.allclose(middle(variables.strokes()), middle(strokes), rtol=0, atol=1e-12)


@given(st.integers(1, 30), st.integers(1, 6), st.integers(0, 2**31))
def test_as_palette_renumbers_paints_from_light_to_dark_and_loses_no_stroke(count: int, colors: int, seed: int) -> None:
    strokes, chosen = some_strokes(count, seed), random_paints(count, colors, seed)
    paints = Paints(chosen.color.float(), chosen.paint)
    ordered, palette, paint = as_palette(strokes, paints)
    lightness = palette.lab()[:, 0]
    assert bool((lightness.diff() <= 0).all()) and bool((paint.diff() >= 0).all())
    assert torch.equal(ordered.color, palette.color[paint])
    before = sorted(zip(strokes.length.tolist(), paints.color[paints.paint].tolist(), strict=True))
    after = sorted(zip(ordered.length.tolist(), ordered.color.tolist(), strict=True))
    assert before == after


@given(st.integers(1, 20), st.integers(1, 5), st.integers(0, 2**31))
def test_colours_that_may_change_become_those_of_paint_and_mixed_ones_stay(count: int, colors: int, seed: int) -> None:
    strokes, paints = some_strokes(count, seed, F64), random_paints(count, colors, seed)
    for given_paints, may_change in ((None, True), (paints, True), (paints, False)):
        variables = Variables(strokes, given_paints, vary_colors=may_change)
        before = variables.strokes()
        variables.bring_inside(LIMITS, SIZE, lambda color: color.clamp(min=0.25))
        wanted = before.color.clamp(min=0.25) if may_change else before.color
        assert torch.allclose(variables.strokes().color, wanted, rtol=0, atol=1e-12)


class Plain(Variables):
    """Without compiled loops."""

    _compiled = False


@given(st.integers(1, 20), st.integers(0, 2**31), st.sampled_from((F64, torch.float32)), st.booleans())
def test_compiled_strokes_and_their_slopes_are_the_plain_ones(
    count: int, seed: int, dtype: torch.dtype, with_paints: bool
) -> None:
    chance, strokes = torch.Generator().manual_seed(seed), some_strokes(count, seed, dtype)
    chosen = random_paints(count, 3, seed)
    paints = Paints(chosen.color.to(dtype), chosen.paint) if with_paints else None
    order = torch.randperm(count, generator=chance)
    upstream = {name: torch.randn(part.shape, generator=chance).to(part) for name, part in strokes.arrays().items()}
    found = []
    for kind in (Variables, Plain):
        variables = kind(strokes, paints, vary_colors=True)
        back = variables.strokes(order)
        total = sum((part * upstream[name]).sum() for name, part in back.arrays().items())
        found.append((back.detach(), *torch.autograd.grad(total, variables.leaves)))
    (strokes, *slopes), (plain, *plain_slopes) = found
    for one, other in zip(
        (*strokes.arrays().values(), *slopes), (*plain.arrays().values(), *plain_slopes), strict=True
    ):
        torch.testing.assert_close(one, other, atol=1e-12 if dtype == F64 else 1e-6, rtol=1e-6)


@given(st.integers(1, 20), st.integers(0, 2**31), st.floats(0.01, 50))
def test_strokes_are_brought_inside_as_they_are_projected(count: int, seed: int, astray: float) -> None:
    strokes, chance = some_strokes(count, seed, F64), torch.Generator().manual_seed(seed)
    found = []
    wild = astray * torch.randn(count, 6, generator=chance, dtype=F64)
    wild[: count // 2, 4] *= chance.initial_seed() % 2  # some that are straight
    for kind in (Variables, Plain):
        variables = kind(strokes, None, vary_colors=False)
        with torch.no_grad():
            variables.shape += wild
        wanted = variables.strokes().detach().project(LIMITS, SIZE)
        variables.bring_inside(LIMITS, SIZE, lambda color: color)
        inside = variables.strokes().detach()
        inside.check(LIMITS, SIZE)
        for name in GROUPS:
            assert torch.allclose(getattr(inside, name), getattr(wanted, name), rtol=0, atol=1e-10), name
        found.append(variables.shape.detach())
    torch.testing.assert_close(*found, atol=1e-9, rtol=0)


def test_a_shape_that_is_not_finite_stays_so() -> None:
    for kind in (Variables, Plain):
        variables = kind(some_strokes(3), None, vary_colors=False)
        with torch.no_grad():
            variables.shape[1, 3] = math.nan
        variables.bring_inside(LIMITS, SIZE, lambda color: color)
        assert variables.shape.isfinite().all(1).tolist() == [True, False, True]
