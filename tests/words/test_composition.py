"""Scenes: one large subject or a group, on a ground that is calm behind it."""

import pytest
import torch

from frida_painter.canvas_size import CanvasSize
from frida_painter.frames import PixelGrid
from frida_painter.strokes.palette import to_lab
from frida_painter_words.composition import compose_scene, lay_in, paint_of, recolor

GRID = PixelGrid.of_height(CanvasSize.parse("40x30cm"), 90)


def disc(*color: float, rows: int = 60, columns: int = 60) -> torch.Tensor:
    y, x = torch.meshgrid(torch.linspace(-1, 1, rows), torch.linspace(-1, 1, columns), indexing="ij")
    return torch.cat((torch.tensor(color)[:, None, None].expand(3, rows, columns), (x**2 + y**2 <= 1).float()[None]))


@pytest.mark.parametrize(("rows", "columns"), [(60, 60), (120, 30), (30, 150)])
def test_a_subject_is_large_and_inside(rows: int, columns: int) -> None:
    for ground in (None, torch.rand(3, 48, 64)):
        scene = compose_scene([disc(0.8, 0.1, 0.1, rows=rows, columns=columns)], ground, GRID)
        where = scene.where > 0.5
        down, across = where.any(1).float().mean(), where.any(0).float().mean()
        assert 0.55 <= max(float(down), float(across)) <= 0.9
        assert not bool(where[0].any() | where[-1].any() | where[:, 0].any() | where[:, -1].any())


@pytest.mark.parametrize("count", [2, 3, 5])
def test_a_group_stands_side_by_side(count: int) -> None:
    scene = compose_scene([disc(0.8, 0.1, 0.1)] * count, None, GRID)
    row = (scene.where > 0.5).any(0).int()
    assert float(scene.where.sum()) > 0.6 * count * (60 * 60 * 0.78) * (0.84 * 120 / count / 60) ** 2
    assert bool((row[8:-8] == 1).any()) and bool(scene.picture.isfinite().all())
    assert float(compose_scene([], None, GRID).picture.std(2).max()) < 0.02, "without all, a tone"


def test_a_subject_is_told_from_its_ground_and_the_ground_is_calm_behind_it() -> None:
    busy = (0.35 + 0.3 * (torch.arange(120) // 4 % 2)).expand(3, 90, -1).contiguous()
    scene = compose_scene([disc(0.5, 0.5, 0.5)], busy, GRID)
    light = to_lab(scene.picture.permute(1, 2, 0))[..., 0]
    near = torch.nn.functional.max_pool2d(scene.where[None, None], 9, 1, 4)[0, 0] > 0.5
    ring = near & (scene.where < 0.01)
    assert abs(float(light[scene.where > 0.99].median() - light[ring].median())) > 4
    rough = (light - light.roll(1, 1)).abs()
    assert float(rough[ring].mean()) < 0.7 * float(rough[~near].mean())


def test_subjects_take_on_the_light_of_their_ground() -> None:
    bright = [compose_scene([disc(0.9, 0.8, 0.7)], torch.full((3, 9, 12), tone), GRID) for tone in (0.1, 0.8)]
    night, day = (float(scene.picture[:, scene.where > 0.99].mean()) for scene in bright)
    assert night < 0.85 * day


BLUE = torch.tensor([0.2, 0.3, 0.7])


def test_a_thing_is_recoloured_with_its_shades_but_for_its_outline() -> None:
    thing = disc(0.85, 0.15, 0.15)
    thing[:3, :30] *= 0.8
    thing[:3, 28:32] = 0.02
    blue = recolor(thing, BLUE)
    top, bottom = blue[:, 15, 30], blue[:, 45, 30]
    assert top[2] > 1.5 * top[0] and bottom[2] > 1.5 * bottom[0] and float(top.sum()) < float(bottom.sum())
    assert float(blue[:3, 30, 30].max()) < 0.15 and torch.equal(blue[3], thing[3])
    assert torch.equal(recolor(thing, torch.tensor([0.85, 0.15, 0.15])), thing), "it has that colour already"


def test_of_a_drawing_in_many_colours_all_changes() -> None:
    thing = torch.ones(4, 40, 40)
    for at, color in enumerate(((0.8, 0.2, 0.2), (0.2, 0.7, 0.2), (0.8, 0.8, 0.2), (0.6, 0.2, 0.7))):
        thing[:3, 10 * at : 10 * at + 10] = torch.tensor(color)[:, None, None]
    assert bool((recolor(thing, BLUE)[2] > recolor(thing, BLUE)[0]).all())
    assert float(paint_of("dark blue").sum()) < float(paint_of("blue").sum())


@pytest.mark.parametrize("own", [0.0, 0.5, 1.0])
def test_a_thing_stands_where_a_picture_is_calm_and_stands_out(own: float) -> None:
    """Bars to the left, and a pale calm place to the right."""
    picture = torch.full((3, 96, 128), 0.9)
    picture[:, :, :64] = (torch.arange(96) // 12 % 2).float()[:, None]
    thing = torch.cat((torch.tensor([0.9, 0.1, 0.1])[:, None, None].expand(3, 30, 30), torch.ones(1, 30, 30)))
    shown, where = lay_in(thing, picture, own)
    inside = where > 0.99
    assert torch.equal(shown[:, where == 0], picture[:, where == 0])
    columns, rows = inside.any(0).nonzero().flatten(), inside.any(1).nonzero().flatten()
    assert int(columns[0]) >= 60 and int(rows[-1]) > 60 and abs(len(rows) - 0.65 * 96) <= 2
    light = to_lab(shown.permute(1, 2, 0))[..., 0]
    assert abs(float(light[inside].median() - light[4, 100])) > 15
    assert (float(shown[0, inside].mean() - shown[1, inside].mean()) > 0.3) == (own > 0)
