import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.canvas_size import CanvasSize
from frida_painter.frames import PixelGrid
from frida_painter.perception.landmarks import find_dots, match_dots

SIZE = CanvasSize(0.20, 0.15)
GRID = PixelGrid.of_height(SIZE, 600)
PLACES = np.array([(0.02, 0.02), (0.1, 0.03), (0.17, 0.02), (0.03, 0.08), (0.11, 0.07), (0.18, 0.09), (0.05, 0.13)])
NEAR = {"reach": 0.02, "tolerance": 0.002}


def dotted(places: np.ndarray, radius: float = 0.002, ground: float = 0.8, ink: float = 0.1) -> torch.Tensor:
    rows, columns = torch.meshgrid(torch.arange(GRID.rows), torch.arange(GRID.columns), indexing="ij")
    canvas = GRID.to_canvas(torch.stack((columns, rows), -1).double()).numpy()
    picture = np.full((GRID.rows, GRID.columns), ground)
    for place in places:
        away = np.linalg.norm(canvas - place, axis=-1)
        picture += np.clip((radius - away) / 0.00025 + 0.5, 0, 1) * (ink - picture)
    return torch.from_numpy(picture).float().expand(3, -1, -1).clone()


def test_dots_are_found_where_they_are() -> None:
    found = find_dots(dotted(PLACES[:0]), dotted(PLACES), GRID)
    assert len(found) == len(PLACES)
    away = np.linalg.norm(found[None] - PLACES[:, None], axis=-1).min(1)
    assert away.max() < 0.00005


def test_what_was_there_before_lines_and_specks_are_no_dots() -> None:
    before = dotted(np.array([(0.15, 0.12), (0.08, 0.1)]), radius=0.006, ink=0.3)
    after = torch.minimum(before, dotted(PLACES))
    after[:, 400:403, 50:500] = 0.1  # a scratch
    after[:, 20:22, 20:21] = 0.1  # a speck
    after[:, 100:220, 500:620] = 0.1  # a blot
    found = find_dots(before, after, GRID)
    assert len(found) == len(PLACES)


def test_an_unchanged_canvas_holds_no_dots() -> None:
    assert find_dots(dotted(PLACES), dotted(PLACES), GRID).shape == (0, 2)


def moved(places: np.ndarray, shift: tuple[float, float], turn: float, middle: tuple[float, float]) -> np.ndarray:
    cos, sin = math.cos(turn), math.sin(turn)
    return (places - middle) @ np.array([[cos, sin], [-sin, cos]]) + middle + shift


@given(
    st.floats(-0.006, 0.006),
    st.floats(-0.006, 0.006),
    st.floats(-0.06, 0.06),
    st.sets(st.integers(0, 6), max_size=2),
    st.lists(st.tuples(st.floats(0, 0.2), st.floats(0, 0.15)), max_size=6),
    st.randoms(),
)
def test_dots_are_told_from_strangers_and_missing_ones_are_survived(x, y, turn, missing, strangers, chance) -> None:
    there = [number for number in range(len(PLACES)) if number not in missing]
    true = moved(PLACES, (x, y), turn, (0.1, 0.075))
    strange = np.array([place for place in strangers if np.linalg.norm(true - place, axis=1).min() > 0.006])
    seen = np.concatenate([true[there], strange.reshape(-1, 2)])
    order = list(range(len(seen)))
    chance.shuffle(order)
    match = match_dots(PLACES, seen[order], **NEAR)
    assert len(match.meant) >= len(there)
    right = np.linalg.norm(seen[order][match.seen] - true[match.meant], axis=1) < 1e-9
    assert right.sum() >= len(there) - 1
    if not len(strange):
        assert right.all() and sorted(match.meant) == there


@pytest.mark.parametrize("seen", [np.empty((0, 2)), PLACES[:1], PLACES + 0.05])
def test_where_nothing_fits_nothing_is_matched(seen: np.ndarray) -> None:
    assert len(match_dots(PLACES, seen, **NEAR).meant) <= 3


def test_a_mirror_image_is_not_matched() -> None:
    assert len(match_dots(PLACES, (0.2, 0) + PLACES * (-1, 1), **NEAR).meant) <= 3
