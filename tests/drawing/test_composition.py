import pytest
import torch

from frida_painter.drawing.arrangement import Known, Placed
from frida_painter.drawing.composition import compose_photograph, compose_scene
from frida_painter.drawing.lights import find_light
from frida_painter.drawing.places import Setting, find_place
from frida_painter.frames import PixelGrid
from support.planning import CANVAS

THING = Known("thing", 1.0, "ground")

GRID = PixelGrid.of_height(CANVAS, 60)


@pytest.mark.parametrize(("rows", "columns"), [(90, 160), (160, 90), (300, 40), (40, 300), (7, 9)])
def test_a_picture_with_a_ground_fills_the_canvas_in_the_light_that_is_named(rows: int, columns: int) -> None:
    night = find_light("night")
    picture = torch.rand(3, rows, columns, generator=torch.Generator().manual_seed(1))
    day, dark = (compose_photograph(picture, Setting(light=light), GRID, 0) for light in (Setting().light, night))
    assert day.picture.shape == (3, GRID.rows, GRID.columns) and not day.is_alone and float(day.where.min()) == 1
    assert float(dark.picture.median()) < 0.7 * float(day.picture.median())


def test_a_thing_in_a_bowl_ends_at_a_round_rim() -> None:
    drawing = torch.ones(4, 40, 40)
    for hidden in (0.0, 0.4):
        inside = [Placed(drawing, THING, hidden=hidden, dip=0.3 * hidden)]
        seen = (
            compose_scene(inside, Setting(find_place("plain paper"), is_named=True), GRID, 0, in_the_air=False).where
            > 0.5
        )
        columns = seen.any(0).nonzero().flatten()
        lowest = [int(seen[:, at].nonzero().max()) for at in columns.tolist()]
        middle = lowest[len(lowest) // 2]
        assert middle - lowest[0] > 2 and middle - lowest[-1] > 2 if hidden else len({*lowest}) == 1


def box(x: float = 0.0, size: float = 1.0) -> Placed:
    drawing = torch.zeros(4, 40, 40)
    drawing[0], drawing[3] = 1, 1
    return Placed(drawing, THING, size=size, x=x, height=size)


def test_a_hill_rises_under_a_thing_and_a_bank_is_in_front_of_water() -> None:
    hills, lake = map(find_place, ("hills", "lake"))
    for place, columns in ((hills, (GRID.columns // 2, 2)), (lake, (GRID.columns // 2, GRID.columns // 2))):
        flat, raised = (Setting(place, is_named=True, is_raised=is_raised) for is_raised in (False, True))
        ground = flat.ground(GRID, 0)
        changed = (raised.raise_land(ground, GRID, 0) - ground).abs().amax(0) > 0.02
        tops = [int(changed[:, at].nonzero().min()) for at in columns]
        assert tops[0] < 0.85 * GRID.rows and (tops[0] < tops[1]) == (place is hills)
        assert torch.equal(flat.raise_land(ground, GRID, 0), ground)
    feet = [
        float(compose_scene([box()], Setting(hills, is_named=True, is_raised=up), GRID, 0, in_the_air=False).where
              .gt(0.5).any(1).nonzero().max())
        for up in (False, True)
    ]  # fmt: skip
    assert feet[1] < 0.75 * feet[0]


def test_what_is_far_is_behind_the_scenery_and_what_is_tiny_is_small() -> None:
    meadow = find_place("meadow")
    scene = compose_scene([], Setting(meadow, is_named=True), GRID, 0, in_the_air=False, far=[box()])
    seen = scene.where > 0.5
    assert bool(seen.any()) and int(seen.any(1).nonzero().max()) <= (meadow.horizon + 0.06) * GRID.rows
    large, tiny = (
        compose_scene([box(size=size)], Setting(), GRID, 0, in_the_air=False).where.gt(0.5).float().mean()
        for size in (1.0, 0.5)
    )
    assert float(tiny) == pytest.approx(0.25 * float(large), rel=0.15)
