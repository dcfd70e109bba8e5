import pytest
import torch
from torch import Tensor

from frida_painter.frames import PixelGrid
from frida_painter.words.composition import compose_photograph
from frida_painter.words.places import LIGHTS, Setting
from support.planning import CANVAS

GRID = PixelGrid.of_height(CANVAS, 60)


def photograph(rows: int, columns: int, *, tower: int) -> tuple[Tensor, Tensor]:
    """Sky over grass, and a dark tower around that column; and where the tower is."""
    picture, where = torch.ones(3, rows, columns), torch.zeros(rows, columns)
    picture[:] = torch.tensor([0.6, 0.8, 0.95])[:, None, None]
    picture[:, rows // 2 :] = torch.tensor([0.3, 0.6, 0.2])[:, None, None]
    half = max(1, columns // 20)
    where[rows // 5 : -(rows // 5), tower - half : tower + half] = 1
    return torch.where(where > 0, torch.full_like(picture, 0.1), picture), where


@pytest.mark.parametrize(("rows", "columns"), [(90, 160), (160, 90), (100, 130), (300, 40), (40, 300), (7, 9)])
def test_a_picture_with_a_ground_fills_the_canvas(rows: int, columns: int) -> None:
    scene = compose_photograph(*photograph(rows, columns, tower=columns // 2), Setting(), GRID, 0)
    assert scene.picture.shape == (3, GRID.rows, GRID.columns) and not scene.is_alone
    assert bool(torch.isfinite(scene.picture).all()) and float((scene.picture > 0.97).all(0).float().mean()) == 0
    assert scene.where.shape == (GRID.rows, GRID.columns) and float(scene.where.max()) > 0.4


@pytest.mark.parametrize("tower", [30, 130])
def test_what_stands_at_a_side_is_not_cut_off(tower: int) -> None:
    scene = compose_photograph(*photograph(90, 160, tower=tower), Setting(), GRID, 0)
    dark = (scene.picture.mean(0) < 0.2).any(0).nonzero().flatten()
    assert len(dark) > 3 and int(dark.min()) > 0 and int(dark.max()) < GRID.columns - 1


def test_of_a_tall_picture_the_ground_goes_on_to_the_sides() -> None:
    scene = compose_photograph(*photograph(160, 60, tower=30), Setting(), GRID, 0)
    left, right = scene.picture[:, :, 0], scene.picture[:, :, -1]
    assert float((left - right).abs().max()) < 0.05
    assert float(left[2, 2]) > 0.8 and float(left[1, -3]) > left[2, -3] + 0.2, "sky above, grass below"
    assert bool((scene.picture.mean(0) < 0.2).any()), "the tower is there"


def test_the_ground_is_soft_and_the_thing_is_sharp() -> None:
    picture, _where = photograph(90, 120, tower=60)
    picture = torch.where(torch.rand(90, 120, generator=torch.Generator().manual_seed(3)) < 0.5, picture, 1 - picture)
    scene = compose_photograph(
        picture, torch.where(torch.arange(120) < 60, 1.0, 0.0).expand(90, 120), Setting(), GRID, 0
    )
    rough = scene.picture.diff(dim=2).abs().mean((0, 1))
    assert float(rough[: GRID.columns // 3].mean()) > 3 * float(rough[-GRID.columns // 3 :].mean())


def test_it_is_seen_in_the_light_that_is_named() -> None:
    night = next(light for light in LIGHTS if light.name == "night")
    day, dark = (
        compose_photograph(*photograph(90, 120, tower=60), Setting(light=light), GRID, 0).picture.median()
        for light in (Setting().light, night)
    )
    assert float(dark) < 0.7 * float(day)
