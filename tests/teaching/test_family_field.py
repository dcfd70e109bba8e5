"""Stroke models of families, their tables, and a plan with them: values and gradients against plain twins."""

import pytest
import torch

from frida_painter.brush.kinds import FINE, growth_of, kind_of, mark_width
from frida_painter.brush.table import StrokeTable, TableDetail
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import PlanError
from frida_painter.frames import PixelGrid, pixel_to_map, scale_maps
from frida_painter.planning.variables import Variables
from frida_painter.render import reference
from frida_painter.render.painting import marks_of, render
from frida_painter.strokes.family import Taught
from frida_painter.strokes.strokes import Strokes
from frida_painter_calibration.teaching.families import FamilyField, FamilyRibbon, TracedPaths
from marks import wave_family

FAMILY = wave_family()
KIND = FINE.of_family(FAMILY)
SIZE = CanvasSize(0.12, 0.09)
DETAIL = TableDetail((2, 2, 2), rank=8, parts=(1, 1))


def some(count: int, dtype: torch.dtype = torch.float32) -> Strokes:
    luck = torch.Generator().manual_seed(4)
    part = torch.rand(count, 5, generator=luck, dtype=dtype)
    position = 0.02 + part[:, :2] * 0.03
    strokes = Strokes(
        position, part[:, 2], 0.02 + 0.03 * part[:, 3], 0 * part[:, 0], 0.3 + 0.5 * part[:, 4],
        torch.rand(count, 3, generator=luck, dtype=dtype), Taught.of(FAMILY, 3 * part[:, :1] - 1.5),
    )  # fmt: skip
    return strokes.project(KIND.limits, SIZE)


def test_the_ribbon_covers_its_path_and_nothing_far_from_it():
    model, strokes = FamilyRibbon(KIND), some(3)
    grid = PixelGrid.of_height(SIZE, 180)
    picture = render(strokes.with_groups(color=torch.zeros(3, 3)), model, torch.ones(3, grid.rows, grid.columns), SIZE)
    at = grid.to_pixels(strokes.path(torch.linspace(0.05, 0.95, 30))).flatten(0, 1).round().long()
    assert float(picture[0, at[:, 1], at[:, 0]].amax()) < 0.4
    column, row = torch.meshgrid(torch.arange(grid.columns), torch.arange(grid.rows), indexing="xy")
    place = grid.to_canvas(torch.stack((column, row), -1).float()).flatten(0, 1)
    away = torch.cdist(place, strokes.path(torch.linspace(0, 1, 200)).flatten(0, 1)).amin(1)
    far = (away > 0.75 * KIND.width).view(grid.rows, grid.columns)
    assert far.any()
    assert float(picture[:, far].amin()) == 1


def test_scaled_frames_show_a_mark_where_its_metres_are():
    model, strokes = FamilyRibbon(KIND), some(2)
    grid = PixelGrid.of_height(SIZE, 60)
    plain = pixel_to_map(strokes.position, strokes.angle, grid, model.frame)
    growth = growth_of(model, strokes.length)
    direct = torch.cat([
        pixel_to_map(strokes.position[[k]], strokes.angle[[k]], grid, model.frame.scale(float(growth[k])))
        for k in range(2)
    ])  # fmt: skip
    torch.testing.assert_close(scale_maps(plain, model.frame, growth), direct, atol=1e-4, rtol=1e-4)


def test_slopes_of_a_field_and_of_a_placed_mark_are_those_of_their_values():
    with torch.random.fork_rng():
        torch.manual_seed(0)
        frame = KIND.frame.resize(12, 16)
        model = FamilyField("fine", frame, KIND.limits).double()
    strokes = some(2, torch.float64)
    model.reach.fill_(0.02)
    inputs = [part.clone().requires_grad_() for part in (strokes.thickness, strokes.length, strokes.taught.code)]
    assert torch.autograd.gradcheck(lambda h, x, c: model(h, x, c), inputs, eps=1e-7, atol=1e-3, rtol=1e-2)
    assert model.half_width == pytest.approx(FINE.width / 2, rel=1e-4)
    assert mark_width(model) == pytest.approx(FINE.width, rel=1e-4)


def test_a_table_stands_in_for_its_model_and_its_loops_for_pytorch():
    model = FamilyRibbon(KIND)
    table = StrokeTable.of(model, detail=TableDetail((3, 3, 4), parts=(1, 1)))
    strokes = some(16)
    shape = strokes.thickness, strokes.length, strokes.shape
    wanted = model(*shape)
    assert float((table(*shape) - wanted).abs().mean()) < 0.1 * float(wanted.mean())
    given = [part.clone().requires_grad_() for part in shape]
    again = [part.clone().requires_grad_() for part in shape]
    fast, plain = table.windows(*given)[0], table.plainly(table.places(*again).clamp(0, 1))[0]
    torch.testing.assert_close(fast, plain, atol=2e-6, rtol=0)
    weight = torch.rand(fast.shape, generator=torch.Generator().manual_seed(0))
    (fast * weight).sum().backward()
    (plain * weight).sum().backward()
    for one, other in zip(given, again, strict=True):
        torch.testing.assert_close(one.grad, other.grad, atol=2e-3, rtol=2e-3)


def test_variables_give_back_strokes_and_their_slopes():
    strokes = some(4)
    variables = Variables(strokes, None, vary_colors=True)
    found = variables.strokes()
    torch.testing.assert_close(found.path(torch.linspace(0, 1, 9)), strokes.path(torch.linspace(0, 1, 9)))
    found.path(torch.tensor([0.3, 0.9])).square().sum().backward()
    assert bool((variables.shape.grad[:, [0, 1, 2, 3, 6]] != 0).all())
    with torch.no_grad():
        variables.shape[:, 6] += 100
    variables.bring_inside(KIND.limits, SIZE, lambda color: color)
    variables.strokes().check(KIND.limits, SIZE)


def test_pictures_equal_those_of_the_reference():
    table, strokes = StrokeTable.of(FamilyRibbon(KIND), detail=DETAIL), some(3)
    grid = PixelGrid.of_height(SIZE, 40)
    white = torch.ones(3, grid.rows, grid.columns)
    marks = marks_of(strokes, table, grid)
    torch.testing.assert_close(
        render(strokes, table, white, SIZE), reference.composite(*marks, strokes.color, white), atol=1e-5, rtol=0
    )
    assert kind_of(table) == "fine+wave"


def test_a_model_refuses_strokes_of_another_family():
    model, grid = FamilyRibbon(FINE.of_family(wave_family("other"))), PixelGrid.of_height(SIZE, 20)
    with pytest.raises(PlanError, match="plan anew"):
        marks_of(some(1), model, grid)


def test_of_two_parts_at_one_distance_the_harder_pressed_one_is_nearest():
    paths = TracedPaths.of(FAMILY, torch.tensor([0.04]), torch.zeros(1, 1))
    place = (paths.point[0, 20] + paths.point[0, 80]) / 2
    wide = torch.full_like(paths.pressure, 0.0)
    wide[0, 80] = 0.03
    assert paths.nearest(place[None], torch.tensor([0]), wide).tolist() == [80]
