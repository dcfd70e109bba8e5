import pytest
import torch
from torch import Tensor

from composites import assert_same, scene, with_gradients
from frida_painter.brush.kinds import MEDIUM
from frida_painter.brush.table import StrokeTable
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import ConfigError, WeightsError
from frida_painter.frames import PixelGrid, pixel_to_map
from frida_painter.render import composite, painting, reference, render, scanline
from frida_painter.render.painting import render_plan
from frida_painter.render.reference import bilinear
from frida_painter.strokes.strokes import Strokes
from frida_painter_calibration.teaching.bezier import BezierStroke
from support.planning import small_table
from support.plans import made_up_plan

SIZE = CanvasSize(0.3, 0.2)


@pytest.fixture
def brush() -> BezierStroke:
    return BezierStroke.typical(MEDIUM)


def strokes(**changes: Tensor) -> Strokes:
    one = Strokes(
        position=torch.tensor([[0.10, 0.12], [0.20, 0.05]]),
        angle=torch.tensor([0.3, -2.0]),
        length=torch.tensor([0.05, 0.04]),
        bend=torch.tensor([0.012, -0.008]),
        thickness=torch.tensor([0.9, 0.4]),
        color=torch.tensor([[0.9, 0.1, 0.1], [0.1, 0.2, 0.8]]),
    )
    return one.with_groups(**changes)


def test_cpu_tensors_take_the_scanlines(monkeypatch: pytest.MonkeyPatch) -> None:
    tensors = scene(3, (4, 4), (6, 6))
    monkeypatch.setattr(reference, "composite", lambda *_: pytest.fail("took the reference"))
    assert torch.equal(composite(*tensors), scanline.composite(*tensors))


def test_without_numba_the_reference_renders(monkeypatch: pytest.MonkeyPatch) -> None:
    tensors = scene(3, (4, 4), (6, 6))
    monkeypatch.setattr(painting, "compiles_for", lambda canvas: False)
    monkeypatch.setattr(scanline, "composite", lambda *_: pytest.fail("took the scanlines"))
    assert_same(with_gradients(composite, tensors), with_gradients(reference.composite, tensors))


def test_paint_lies_along_the_path_the_right_way_up(brush: BezierStroke) -> None:
    some = strokes()
    canvas = torch.ones(3, 200, 300)
    picture = render(some, brush, canvas, SIZE)
    pixel = PixelGrid(SIZE, 200, 300).to_pixels(some.path(torch.tensor([0.35, 0.5, 0.65]))).round().long()  # [2, 3, 2]
    for i, color in enumerate(some.color):
        for column, row in pixel[i].tolist():
            torch.testing.assert_close(picture[:, row, column], color, rtol=0, atol=0.15)
            assert picture[:, 199 - row, column].min() == 1  # nothing on the mirrored side


def test_every_group_of_the_strokes_and_the_canvas_get_a_gradient(brush: BezierStroke) -> None:
    leaves = {name: tensor.clone().requires_grad_() for name, tensor in strokes().arrays().items()}
    canvas = torch.ones(3, 64, 96, requires_grad=True)
    (render(Strokes(**leaves), brush, canvas, SIZE) - 0.3).square().sum().backward()
    for name, leaf in (*leaves.items(), ("canvas", canvas)):
        assert leaf.grad is not None, name
        assert leaf.grad.isfinite().all() and leaf.grad.abs().sum() > 0, name


def test_a_larger_picture_shows_the_same_painting(brush: BezierStroke) -> None:
    with torch.no_grad():
        small = render(strokes(), brush, torch.ones(3, 100, 150), SIZE)
        large = render(strokes(), brush, torch.ones(3, 400, 600), SIZE)
    shrunk = torch.nn.functional.avg_pool2d(large, 4)
    assert (shrunk - small).abs().mean() < 2e-3
    assert (shrunk - small).abs().max() < 0.2


def test_leaving_out_the_gradient_to_bare_cells_changes_none_of_a_table(brush: BezierStroke) -> None:
    table = StrokeTable.of(brush)
    some, canvas = strokes(), torch.full((3, 100, 150), 0.7)
    grid = PixelGrid(SIZE, 100, 150)

    def gradients(whole: bool) -> list[Tensor]:
        leaves = {name: tensor.clone().requires_grad_() for name, tensor in some.arrays().items()}
        copy = Strokes(**leaves)
        if whole:
            magnitude = table(copy.thickness, copy.length, copy.bend)
            affine = pixel_to_map(copy.position, copy.angle, grid, table.frame)
            picture = composite(magnitude, affine, copy.color, canvas)
        else:
            picture = render(copy, table, canvas, SIZE)
        (picture - 0.3).square().sum().backward()
        return [leaf.grad for leaf in leaves.values()]

    for lean, whole in zip(gradients(False), gradients(True), strict=True):
        torch.testing.assert_close(lean, whole, rtol=1e-4, atol=1e-4 * float(whole.abs().max()))


def test_gradients_to_painted_boxes_are_those_of_the_reference() -> None:
    magnitude, *others = scene(4, (8, 8), (20, 24))
    magnitude = magnitude.double().clone()
    magnitude[:, :, 5:] = 0
    tensors = (magnitude, *(part.double() for part in others))
    lean = with_gradients(lambda *parts: scanline.composite(*parts, bare_cells_answer=False), tensors)
    whole = with_gradients(reference.composite, tensors)
    painted = whole[1] * (magnitude != 0)
    torch.testing.assert_close(lean[1] * (magnitude != 0), painted, rtol=0, atol=1e-9)
    assert (lean[1][:, :, 6:] == 0).all()
    for one, other in zip((lean[0], *lean[2:]), (whole[0], *whole[2:]), strict=True):
        torch.testing.assert_close(one, other, rtol=0, atol=1e-9)


F64 = torch.float64


def test_a_full_mark_on_whole_pixels_replaces_the_canvas_by_its_color() -> None:
    magnitude = torch.ones(1, 2, 3, dtype=F64)
    affine = torch.tensor([[[1.0, 0.0, -4.0], [0.0, 1.0, -1.0]]], dtype=F64)
    color = torch.tensor([[0.1, 0.5, 0.9]], dtype=F64)
    canvas = torch.ones(3, 5, 8, dtype=F64)
    picture = reference.composite(magnitude, affine, color, canvas)
    expected = canvas.clone()
    expected[:, 1:3, 4:7] = color[0, :, None, None]
    torch.testing.assert_close(picture, expected)


def test_coverage_mixes_and_later_strokes_lie_on_top() -> None:
    magnitude = torch.full((2, 1, 1), 0.5, dtype=F64)
    affine = torch.tensor([[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]], dtype=F64).expand(2, 2, 3)
    color = torch.tensor([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], dtype=F64)
    picture = reference.composite(magnitude, affine, color, torch.zeros(3, 1, 1, dtype=F64))
    assert picture.flatten().tolist() == [0.25, 0.0, 0.5]


def test_samples_between_cells_and_beyond_the_rim_are_bilinear() -> None:
    mark = torch.tensor([[1.0, 2.0], [3.0, 5.0]], dtype=F64)
    column = torch.tensor([0.5, 0.25, -0.5, 1.75, -1.0, 2.0], dtype=F64)
    row = torch.tensor([0.5, 0.0, 0.0, 1.0, 0.0, 0.0], dtype=F64)
    assert bilinear(mark, column, row).tolist() == [2.75, 1.25, 0.5, 1.25, 0.0, 0.0]


def test_a_plan_is_drawn_on_its_own_ground() -> None:
    plan = made_up_plan()
    drawn = render_plan(plan, 90, {"medium": small_table()})
    ground = torch.tensor(plan.ground)[:, None, None].expand_as(drawn).contiguous()
    assert drawn.shape[:2] == (3, 90)
    assert torch.equal(drawn, render(plan.strokes, small_table(), ground, plan.canvas))
    assert not torch.equal(drawn, ground)


@pytest.mark.parametrize("height", [0, 15, 10_001])
def test_sizes_that_nobody_can_use_are_refused(height: int) -> None:
    with pytest.raises(ConfigError, match="16 to 10000"):
        render_plan(made_up_plan(), height, {"medium": small_table()})


def test_the_brush_of_the_plan_has_to_be_known() -> None:
    from dataclasses import replace

    with pytest.raises(WeightsError):
        plan = made_up_plan()
        render_plan(replace(plan, layers=(replace(plan.layers[0], brush="nowhere"),)), 90)
