import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import PlanError
from frida_painter.strokes.strokes import GROUPS, StrokeLimits, Strokes
from support.plans import CANVAS, LIMITS, made_up_strokes

SEEDS = st.integers(0, 2**31)


def wild_strokes(seed: int, count: int = 20) -> Strokes:
    """Strokes far outside of every limit."""
    random = torch.Generator().manual_seed(seed)
    shapes = {"position": (count, 2), "color": (count, 3)}
    return Strokes(**{name: torch.randn(shapes.get(name, (count,)), generator=random).double() for name in GROUPS})


def test_the_path_is_the_cubic_bezier_of_the_paper() -> None:
    length, bend = 0.06, 0.02
    stroke = Strokes.from_array([[0, 0, 0, length, bend, 0.5, 0, 0, 0]]).to(torch.float64)
    control = torch.tensor([[0, 0], [length / 3, bend], [2 * length / 3, bend], [length, 0]], dtype=torch.float64)
    t = torch.linspace(0, 1, 11, dtype=torch.float64)
    flat = torch.stack(((1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3), -1) @ control
    assert torch.allclose(stroke.path(t)[0], flat, atol=1e-8)
    # Turned by a quarter to the left and moved: x along the canvas becomes y, and the bend goes left.
    turned = stroke.with_groups(
        angle=torch.tensor([math.pi / 2]).double(), position=torch.tensor([[0.1, 0.05]]).double()
    )
    expected = torch.stack((0.1 - flat[:, 1], 0.05 + flat[:, 0]), -1)
    assert torch.allclose(turned.path(t)[0], expected, atol=1e-8)


@given(SEEDS)
def test_projecting_gives_strokes_that_may_be_painted_and_changes_them_no_more(seed: int) -> None:
    wild = wild_strokes(seed)
    projected = wild.project(LIMITS, CANVAS)
    projected.check(LIMITS, CANVAS)
    again = projected.project(LIMITS, CANVAS)
    for name in GROUPS:
        assert torch.allclose(getattr(again, name), getattr(projected, name), atol=1e-12), name
    corner = torch.tensor([CANVAS.width, CANVAS.height]).double()
    assert bool(((projected.extremes() >= -1e-9) & (projected.extremes() <= corner + 1e-9)).all())
    assert torch.equal(projected.angle, wild.angle)
    inside = wild.with_groups(length=projected.length, bend=projected.bend)
    moved = projected.extremes() - inside.extremes()
    assert torch.allclose(moved, moved[:, :1].expand_as(moved), atol=1e-12)


def test_projecting_leaves_alone_what_is_allowed() -> None:
    strokes = made_up_strokes(30)
    projected = strokes.project(LIMITS, CANVAS)
    assert all(torch.allclose(getattr(strokes, name), getattr(projected, name), atol=1e-7) for name in GROUPS)


def test_no_stroke_is_longer_than_a_small_canvas() -> None:
    small = CanvasSize(0.03, 0.5)
    assert LIMITS.within(small) == StrokeLimits(
        (0.01, pytest.approx(0.027)), (pytest.approx(-0.009), pytest.approx(0.009))
    )
    assert LIMITS.within(CANVAS) == LIMITS
    wild_strokes(0).project(LIMITS, small).check(LIMITS, small)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 7.0, -7.0])
@pytest.mark.parametrize("name", ["position", "length", "bend", "thickness", "color", "angle"])
def test_a_stroke_outside_its_limits_is_named(name: str, value: float) -> None:
    if name == "angle":
        value *= 1e4
    strokes = made_up_strokes(5)
    changed = getattr(strokes, name).clone()
    changed[3] = value
    with pytest.raises(PlanError, match=r"^Stroke 3 has \w+ .*allowed is .* on a canvas of 300 x 200 mm"):
        strokes.with_groups(**{name: changed}).check(LIMITS, CANVAS)


def test_no_strokes_are_strokes_too() -> None:
    empty = Strokes.empty()
    assert len(empty) == 0
    empty.project(LIMITS, CANVAS).check(LIMITS, CANVAS)
    assert empty.path(torch.linspace(0, 1, 5)).shape == (0, 5, 2)
    assert len(Strokes.join(empty, made_up_strokes(3))) == 3


def test_picking_and_joining() -> None:
    strokes = made_up_strokes(6)
    joined = Strokes.join(strokes[:2], strokes[2:])
    assert all(torch.equal(getattr(joined, name), getattr(strokes, name)) for name in GROUPS)
    assert torch.equal(strokes[[4, 1]].length, strokes.length[[4, 1]])
    assert len(strokes[strokes.thickness > 0.5]) == int((strokes.thickness > 0.5).sum())


def test_precision_and_graph() -> None:
    strokes = made_up_strokes(2).with_groups(length=torch.full((2,), 0.02, requires_grad=True))
    assert strokes.to(torch.float64).position.dtype == torch.float64
    assert not strokes.detach().length.requires_grad and strokes.length.requires_grad


def test_groups_of_wrong_shape_are_refused() -> None:
    groups = made_up_strokes(4).arrays()
    with pytest.raises(PlanError, match=r"position of shape \(4, 3\); 4 strokes need \(4, 2\)"):
        Strokes(**{**groups, "position": torch.zeros(4, 3)})
