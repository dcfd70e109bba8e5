import cv2
import numpy as np
import pytest

from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import CalibrationError
from frida_painter.frames import Lens
from frida_painter.perception.landmarks import find_canvas, trace_outline
from frida_painter.virtual.studio import open_studio

SIZE = CanvasSize(0.4, 0.3)
ROWS, COLUMNS = 480, 640
CORNERS = np.array([(83.3, 61.7), (561.2, 44.9), (583.8, 431.4), (61.9, 409.6)])
BARREL = Lens((400.0, 400.0), (319.5, 239.5), (-0.03, 0.0, 0.0, 0.0, 0.0))
_FINER = 8


def photograph(
    corners: np.ndarray = CORNERS,
    lens: Lens | None = None,
    canvas: float = 0.85,
    table: float = 0.15,
    noise: float = 0.005,
    on_canvas=(),
    on_table=(),
) -> np.ndarray:
    """A canvas on a table (linear light), lit from the left, its edges blended over the pixels that they cross."""
    edge = np.concatenate(
        [np.linspace(a, b, 200, endpoint=False) for a, b in zip(corners, np.roll(corners, -1, 0), strict=True)]
    )
    outline = edge if lens is None else lens.distort(edge)

    light = np.full((ROWS, COLUMNS, 3), table, np.float32)
    for polygon, color in (*on_table, (outline, 3 * (canvas,)), *on_canvas):
        cover = np.zeros((ROWS * _FINER, COLUMNS * _FINER), np.uint8)
        fine = np.rint((np.array(polygon, float) + 0.5) * _FINER - 0.5).astype(np.int32)
        cover = cv2.resize(cv2.fillPoly(cover, [fine], 255), (COLUMNS, ROWS), interpolation=cv2.INTER_AREA)
        light += cover[..., None] / 255 * (np.array(color, np.float32) - light)
    light *= np.linspace(1.0, 0.6, COLUMNS, dtype=np.float32)[None, :, None] * np.array((1.0, 0.9, 0.75), np.float32)
    light += noise * np.random.default_rng(5).standard_normal(light.shape)
    light = light.clip(0, 1)
    srgb = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return np.rint(255 * srgb).astype(np.uint8)


def off(corners, truth: np.ndarray = CORNERS) -> float:
    return float(np.linalg.norm(np.array(corners) - truth, axis=1).max())


PAINTED = [
    ([(60, 50), (150, 50), (150, 200), (60, 180)], (0.4, 0.02, 0.02)),  # across the corner and onto the table
    ([(300, 380), (480, 395), (480, 460), (300, 450)], (0.02, 0.03, 0.2)),
    ([(530, 100), (557, 100), (568, 300), (535, 300)], (0.02, 0.02, 0.02)),  # along the edge, inside
    ([(200, 150), (450, 150), (450, 350), (200, 350)], (0.03, 0.2, 0.05)),
]
CLUTTERED = [
    ([(5, 440), (240, 450), (235, 478), (5, 470)], (0.8, 0.8, 0.8)),  # a sheet of paper
    ([(600, 20), (635, 20), (635, 300), (600, 300)], (0.5, 0.05, 0.05)),  # a box
    ([(20, 20), (30, 12), (45, 200), (35, 205)], (0.9, 0.9, 0.9)),  # a pencil
]


@pytest.mark.parametrize(
    "drawn",
    [
        {},
        {"table": 0.45},
        {"canvas": 0.3, "table": 0.6},  # a dark canvas on a bright table
        {"noise": 0.03},
        {"on_canvas": PAINTED[1:]},
        {"on_table": CLUTTERED},
        {"on_canvas": PAINTED[1:], "on_table": CLUTTERED},
    ],
    ids=["plain", "bright table", "dark canvas", "noisy", "painted", "cluttered", "painted and cluttered"],
)
def test_the_corners_are_found_to_a_part_of_a_pixel(drawn) -> None:
    outline = find_canvas(photograph(**drawn), SIZE)
    assert off(outline.corners) < 0.3
    assert outline.lens is None, "its edges are straight"
    assert outline.support > 0.5


def test_paint_beyond_a_corner_costs_little() -> None:
    assert off(find_canvas(photograph(on_canvas=PAINTED), SIZE).corners) < 1.0


def test_edges_that_are_bowed_tell_the_lens() -> None:
    outline = find_canvas(photograph(lens=BARREL), SIZE)
    assert outline.lens is not None
    assert off(outline.corners, BARREL.distort(CORNERS)) < 0.3
    grid = np.stack(np.meshgrid(np.linspace(80, 560, 9), np.linspace(60, 420, 7)), -1).reshape(-1, 2)
    seen = BARREL.distort(grid)
    # A homography may take the rest: it is in the corners.
    map_to_truth, _ = cv2.findHomography(outline.lens.undistort(seen), grid)
    left = cv2.perspectiveTransform(outline.lens.undistort(seen)[None], map_to_truth)[0] - grid
    bowed, _ = cv2.findHomography(seen, grid)
    without = cv2.perspectiveTransform(seen[None], bowed)[0] - grid
    assert np.abs(left).max() < 0.15 < 0.5 < np.abs(without).max()


@pytest.mark.parametrize(
    ("drawn", "size"),
    [
        ({"canvas": 0.15}, SIZE),  # a canvas of the table's colour
        ({}, CanvasSize(0.3, 0.4)),  # what shows has another shape
        ({}, CanvasSize(0.4, 0.1)),
        ({"corners": CORNERS * (1.25, 1) - (150, 0)}, SIZE),  # two corners are out of sight
    ],
)
def test_it_says_when_the_canvas_cannot_be_told(drawn, size) -> None:
    with pytest.raises(CalibrationError, match="point at the four corners yourself"):
        find_canvas(photograph(**drawn), size)


@pytest.mark.parametrize("brightness", [0, 128, 255])
def test_a_photograph_of_nothing_holds_no_canvas(brightness: int) -> None:
    with pytest.raises(CalibrationError, match="cannot be told"):
        find_canvas(np.full((ROWS, COLUMNS, 3), brightness, np.uint8), SIZE)


def test_corners_that_a_person_points_at_roughly_become_exact() -> None:
    rough = CORNERS + np.array([(3, -2), (-4, 1), (2, 3), (-1, -3)])
    outline = trace_outline(photograph(), tuple(map(tuple, rough.tolist())), reach=8)
    assert outline is not None and off(outline.corners) < 0.3 and outline.residual < 0.3
    nowhere = tuple(map(tuple, (CORNERS * 0.2 + 200).tolist()))
    assert trace_outline(photograph(noise=0.0), nowhere, reach=8) is None


@pytest.mark.parametrize("seed", [0, 7])
def test_in_the_virtual_studio(seed: int) -> None:
    studio = open_studio(CanvasSize.parse("14x11in"), seed=seed)
    studio.easel.robot.connect()
    studio.easel.camera.connect()
    frame = studio.easel.camera.capture(studio.easel.robot.home().finished_at)
    outline = find_canvas(frame.image, studio.easel.canvas)
    assert off(outline.corners, np.array(studio.camera.corners)) < 0.6
    assert outline.lens is not None, "its lens is a slight barrel"
