"""The grid of drawn sheets: where cells stand, and what is drawn in one."""

import itertools

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from frida_painter.system.sheet import LINE, PAPER, Grid, Sheet

sides = st.integers(1, 300)
grids = st.builds(
    Grid,
    left=st.integers(0, 99),
    top=st.integers(0, 99),
    columns=st.integers(1, 9),
    width=sides,
    height=sides,
    across=st.integers(0, 50),
    down=st.integers(0, 50),
)


@given(grids, st.integers(1, 40))
def test_cells_stand_apart_in_rows_between_the_edges(grid: Grid, count: int) -> None:
    corners = list(grid.corners(count))
    assert corners[0] == (grid.left, grid.top) and len(set(corners)) == count
    for (x, y), (other_x, other_y) in itertools.pairwise(corners):
        if other_y == y:
            assert other_x == x + grid.width + grid.across
        else:
            assert (other_x, other_y) == (grid.left, y + grid.height + grid.down)
            assert x + grid.width == grid.right, "a row is full before the next one begins"
    assert max(y for _, y in corners) + grid.height == grid.bottom(count)
    assert grid.rows(count) == len({y for _, y in corners})


@given(st.integers(400, 2000), st.integers(1, 9), st.integers(0, 40))
def test_columns_share_the_room_but_for_less_than_a_pixel_each(room: int, columns: int, across: int) -> None:
    grid = Grid.divide(room, 30, 0, columns, 10, across=across)
    assert room - columns < grid.right - 30 <= room


def test_a_cell_is_its_picture_with_a_frame_on_its_edge_and_a_caption_below() -> None:
    red = Image.new("RGB", (40, 20), (200, 0, 0))
    plain, told = Sheet(100, 80), Sheet(100, 80)
    plain.cell((10, 15), red, frame=LINE)
    told.cell((10, 15), red, "a caption", frame=LINE)
    drawn = np.asarray(plain.image)
    assert (drawn[16:34, 11:49] == (200, 0, 0)).all() and (drawn[15, 10:50] == LINE).all()
    outside = np.ones((80, 100), bool)
    outside[15:35, 10:50] = False
    assert (drawn[outside] == PAPER).all()
    apart = (np.asarray(told.image) != drawn).any(-1)
    rows, columns = np.nonzero(apart)
    assert rows.min() >= 35 and abs((columns.min() + columns.max()) / 2 - 30) <= 2, "below, and in the middle"
