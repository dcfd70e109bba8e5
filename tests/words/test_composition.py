import pytest
import torch

from frida_painter.frames import PixelGrid
from frida_painter.words.arrangement import Placed
from frida_painter.words.composition import compose_photograph, compose_scene
from frida_painter.words.places import LIGHTS, PAPER, Setting
from support.planning import CANVAS

GRID = PixelGrid.of_height(CANVAS, 60)


@pytest.mark.parametrize(("rows", "columns"), [(90, 160), (160, 90), (300, 40), (40, 300), (7, 9)])
def test_a_picture_with_a_ground_fills_the_canvas_in_the_light_that_is_named(rows: int, columns: int) -> None:
    night = next(light for light in LIGHTS if light.name == "night")
    picture = torch.rand(3, rows, columns, generator=torch.Generator().manual_seed(1))
    day, dark = (compose_photograph(picture, Setting(light=light), GRID, 0) for light in (Setting().light, night))
    assert day.picture.shape == (3, GRID.rows, GRID.columns) and not day.is_alone and float(day.where.min()) == 1
    assert float(dark.picture.median()) < 0.7 * float(day.picture.median())


def test_a_thing_in_a_bowl_ends_at_a_round_rim() -> None:
    drawing = torch.ones(4, 40, 40)
    for hidden in (0.0, 0.4):
        inside = [Placed(drawing, 0, 0, 1, hidden=hidden)]
        seen = compose_scene(inside, Setting(PAPER, is_named=True), GRID, 0, in_the_air=False).where > 0.5
        columns = seen.any(0).nonzero().flatten()
        lowest = [int(seen[:, at].nonzero().max()) for at in columns.tolist()]
        middle = lowest[len(lowest) // 2]
        assert middle - lowest[0] > 2 and middle - lowest[-1] > 2 if hidden else len({*lowest}) == 1
