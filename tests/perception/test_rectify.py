import cv2
import numpy as np
import pytest
import torch

from frida_painter.errors import FrameRejected
from frida_painter.frames import Lens, PixelGrid
from frida_painter.perception.rectify import rectified_pixels, rectify
from photographs import COLUMNS, CORNERS, ROWS, SIZE, across_and_down, calibration


def photograph(paint) -> np.ndarray:
    """paint(across, down) -> sRGB in [0, 1], where the canvas is; grey elsewhere."""
    across, down = across_and_down()
    inside = (across > -0.02) & (across < 1.02) & (down > -0.02) & (down < 1.02)
    image = np.where(inside[..., None], paint(across, down), 0.4)
    return np.rint(255 * image).astype(np.uint8)


def bands(across, down) -> np.ndarray:
    return np.stack((across.clip(0, 1), down.clip(0, 1), np.full_like(down, 0.5)), -1)


@pytest.mark.parametrize("rows", [30, 90, 300])
def test_every_pixel_shows_its_place_on_the_canvas(rows):
    grid = PixelGrid.of_height(SIZE, rows)
    picture = rectify(photograph(bands), calibration(), grid)
    assert picture.shape == (3, grid.rows, grid.columns)
    assert picture.dtype == torch.float32
    across = (torch.arange(grid.columns) + 0.5) / grid.columns
    down = (torch.arange(grid.rows) + 0.5) / grid.rows
    inside = slice(1, -1)
    assert (picture[0] - across)[inside, inside].abs().max() < 0.02
    assert (picture[1] - down[:, None])[inside, inside].abs().max() < 0.02


def test_the_canvass_top_left_is_at_row_0_column_0_and_nothing_is_mirrored():
    def corner(across, down):
        return np.where(((across < 0.3) & (down < 0.2))[..., None], 0.1, 1.0) * np.ones(3)

    picture = rectify(photograph(corner), calibration(), PixelGrid.of_height(SIZE, 60))
    assert picture[:, :10, :20].max() < 0.2
    assert picture[:, 15:].min() > 0.8
    assert picture[:, :, 28:].min() > 0.8


def test_fine_stripes_become_the_mean_of_their_light_and_do_not_alias():
    def stripes(across, down):
        return (np.floor(across * 125) % 2)[..., None] * np.ones(3)

    picture = rectify(photograph(stripes), calibration(), PixelGrid.of_height(SIZE, 15))[:, 1:-1, 1:-1]
    assert picture.std() < 0.06
    assert float(picture.mean()) == pytest.approx(0.735, abs=0.03)  # half of the light, in sRGB


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((240, 320), np.uint8),
        np.zeros((100, 320, 3), np.uint8),
        np.zeros((240, 320, 4), np.uint8),
        np.full((240, 320, 3), 0.5, np.float32),
    ],
)
def test_a_photograph_of_another_camera_is_refused(image):
    with pytest.raises(FrameRejected, match="calibration"):
        rectify(image, calibration(), PixelGrid.of_height(SIZE, 30))


def test_a_black_photograph_is_refused():
    with pytest.raises(FrameRejected, match="dark"):
        rectify(np.zeros((240, 320, 3), np.uint8), calibration(), PixelGrid.of_height(SIZE, 30))


def test_a_canvas_that_was_painted_black_is_seen_as_black():
    black = photograph(lambda across, down: np.zeros((*across.shape, 3)))
    picture = rectify(black, calibration(), PixelGrid.of_height(SIZE, 30))
    assert float(picture.max()) < 0.02


def test_a_canvas_beyond_the_photograph_is_refused():
    corners = ((-40.0, 30.0), *CORNERS[1:])
    with pytest.raises(FrameRejected, match="40 pixels beyond"):
        rectify(np.full((240, 320, 3), 200, np.uint8), calibration(corners), PixelGrid.of_height(SIZE, 30))


def test_what_the_lens_has_bent_is_straightened():
    lens = Lens((200.0, 200.0), (159.5, 119.5), (-0.12, 0.0, 0.0, 0.0, 0.0))
    straight = photograph(bands)
    pixels = np.stack(np.meshgrid(np.arange(COLUMNS), np.arange(ROWS)), -1).reshape(-1, 2)
    places = lens.undistort(pixels).reshape(ROWS, COLUMNS, 2).astype(np.float32)
    bent = cv2.remap(straight, places, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    seen = tuple(map(tuple, lens.distort(np.array(CORNERS)).tolist()))
    grid = PixelGrid.of_height(SIZE, 90)
    inside = np.s_[:, 2:-2, 2:-2]
    wanted = rectify(straight, calibration(), grid)[inside]
    assert (rectify(bent, calibration(seen, lens=lens), grid)[inside] - wanted).abs().max() < 0.02
    assert (rectify(bent, calibration(seen), grid)[inside] - wanted).abs().max() > 0.025, "it is needed"


@pytest.mark.parametrize("bow", [None, -0.12])
def test_a_place_of_the_photograph_is_found_in_the_picture(bow):
    lens = None if bow is None else Lens((200.0, 200.0), (159.5, 119.5), (bow, 0.0, 0.0, 0.0, 0.0))

    def seen(places):
        return places if lens is None else lens.distort(places)

    record = calibration(tuple(map(tuple, seen(np.array(CORNERS)).tolist())), lens=lens)
    grid = PixelGrid.of_height(SIZE, 90)
    to_photograph = cv2.getPerspectiveTransform(
        np.array([(0, 0), (1, 0), (1, 1), (0, 1)], np.float32), np.array(CORNERS, np.float32)
    )
    shares = np.array([(0.5, 0.0), (0.1, 0.9), (0.75, 0.5)])
    places = seen(cv2.perspectiveTransform(shares[None], to_photograph)[0])
    found = rectified_pixels(places, record, grid)
    np.testing.assert_allclose(found, shares * (grid.columns, grid.rows) - 0.5, atol=0.01)


@pytest.mark.parametrize("rows", [60, 400])
def test_no_line_of_the_table_is_left_along_the_edge(rows):
    across, down = across_and_down()
    inside = (across > 0.0015) & (across < 0.9985) & (down > 0.0015) & (down < 0.9985)
    image = np.rint(255 * np.where(inside[..., None], 0.9, 0.2) * np.ones(3)).astype(np.uint8)
    assert rectify(image, calibration(), PixelGrid.of_height(SIZE, rows)).min() > 0.88
