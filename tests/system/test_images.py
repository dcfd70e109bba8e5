import io
import os
import time
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from frida_painter.errors import ImageError, StorageError
from frida_painter.system import images

ROWS, COLUMNS = 40, 60


@pytest.fixture
def scene() -> np.ndarray:
    """A smooth picture without symmetry: red grows to the right, green downwards, blue falls."""
    down, right = np.mgrid[0:ROWS, 0:COLUMNS]
    return np.stack((right * 4, down * 5, 240 - right * 2 - down), -1).astype(np.uint8)


def mean_difference(image: torch.Tensor, scene: np.ndarray) -> float:
    return float((image - images.from_uint8(scene)).abs().mean())


@pytest.mark.parametrize("orientation", range(1, 9))
def test_exif_turns_a_photograph_upright(tmp_path: Path, scene: np.ndarray, orientation: int) -> None:
    """How a camera stores an upright scene when it notes each orientation (EXIF 2.32, tag 0x0112). Fault F24."""
    stored = {
        1: scene,
        2: scene[:, ::-1],
        3: scene[::-1, ::-1],
        4: scene[::-1],
        5: scene.transpose(1, 0, 2),
        6: np.rot90(scene, 1),
        7: scene.transpose(1, 0, 2)[::-1, ::-1],
        8: np.rot90(scene, -1),
    }[orientation]
    note = Image.Exif()
    note[0x0112] = orientation
    Image.fromarray(np.ascontiguousarray(stored)).save(tmp_path / "scene.png", exif=note)
    assert mean_difference(images.load(tmp_path / "scene.png"), scene) == 0


def test_of_an_animation_the_first_frame_counts(tmp_path: Path) -> None:
    first, second = Image.new("RGB", (32, 32), "red"), Image.new("RGB", (32, 32), "blue")
    for suffix in ("gif", "webp", "png"):
        first.save(tmp_path / f"moving.{suffix}", save_all=True, append_images=[second], duration=100)
        red = images.load(tmp_path / f"moving.{suffix}").mean((1, 2))
        assert red[0] > 0.95 and red[1:].max() < 0.05


def test_a_large_photograph_is_made_smaller(tmp_path: Path) -> None:
    halves = np.zeros((1200, 2400, 3), np.uint8)
    halves[:, 1200:] = 255
    for suffix in ("jpg", "png"):
        Image.fromarray(halves).save(tmp_path / f"halves.{suffix}")
        image = images.load(tmp_path / f"halves.{suffix}", longest=300)
        assert image.shape == (3, 150, 300)
        assert image[..., :145].max() < 0.02 and image[..., 155:].min() > 0.98


# What is refused


def wide_png(width: int, height: int) -> bytes:
    """A PNG that says it is width x height and is otherwise empty: a decompression bomb in 60 bytes."""
    import struct
    import zlib

    def chunk(kind: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(b"0")) + chunk(b"IEND", b"")


def png(columns: int, rows: int) -> bytes:
    content = io.BytesIO()
    Image.new("RGB", (columns, rows), "red").save(content, format="PNG")
    return content.getvalue()


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "0 bytes"),
        (b"Dear Sir or Madam,", "is a text"),
        (b'<svg xmlns="http://www.w3.org/2000/svg"/>', "SVG or HTML"),
        (b"  <!DOCTYPE html><html></html>", "SVG or HTML"),
        (b"\0\0\0\x18ftypheic\0\0\0\0", "HEIC"),
        (b"%PDF-1.7\n", "PDF"),
        (bytes(range(1, 200)), "unknown kind"),
        (png(1, 1), "1 x 1 pixels; a picture has at least 16"),
        (png(200, 15), "at least 16"),
        (wide_png(40_000, 1_000), "40000 x 1000 pixels; a picture has at most 30000"),
        (wide_png(12_000, 12_000), "12000 x 12000 pixels.*100 million"),
        (wide_png(40_000, 30_000), "40000 x 30000 pixels.*100 million"),
        (wide_png(64, 64), "damaged"),
        (png(64, 64)[:80], "damaged"),
    ],
)
def test_what_is_not_a_picture_is_refused_in_one_sentence(tmp_path: Path, content: bytes, says: str) -> None:
    path = tmp_path / "photo.jpg"
    path.write_bytes(content)
    began = time.process_time()
    with pytest.raises(ImageError, match=says) as refusal:
        images.load(path)
    assert time.process_time() - began < 1
    message = str(refusal.value)
    assert "photo.jpg" in message and message.endswith(".") and "\n" not in message


def test_a_cut_off_photograph_is_refused(tmp_path: Path, scene: np.ndarray) -> None:
    """Fault F24: a damaged or unusual picture file."""
    for suffix in ("jpg", "webp", "bmp", "tif"):
        path = tmp_path / f"cut.{suffix}"
        Image.fromarray(scene).resize((600, 400)).save(path)
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
        with pytest.raises(ImageError, match=r"damaged|not a picture"):
            images.load(path)


def test_what_is_not_a_file_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for name, says in (("missing.jpg", "does not exist"), (".", "folder"), ("pipe", "not a plain file")):
        with pytest.raises(ImageError, match=says):
            images.load(tmp_path / name)
    for name in ("a" * 5000, "nul\0byte"):
        with pytest.raises(ImageError):
            images.load(tmp_path / name)


def test_the_cap_can_be_lowered(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(png(100, 100))
    assert images.load(tmp_path / "a.png", most_pixels=10_000).shape == (3, 100, 100)
    with pytest.raises(ImageError, match="at most"):
        images.load(tmp_path / "a.png", most_pixels=9_999)


# Saving, bytes, fitting


@pytest.mark.parametrize(("suffix", "allowed"), [("png", 1 / 510 + 1e-6), ("jpg", 0.06)])
def test_what_is_saved_is_read_back(tmp_path: Path, suffix: str, allowed: float) -> None:
    down, right = torch.meshgrid(torch.linspace(0, 1, 50), torch.linspace(0, 1, 70), indexing="ij")
    image = torch.stack((down, right, 1 - down * right))
    path = tmp_path / "new" / f"picture.{suffix}"
    images.save(image, path)
    assert (images.load(path) - image).abs().max() <= allowed
    assert [file.name for file in path.parent.iterdir()] == [path.name]


def test_a_picture_that_cannot_be_written_is_said_so(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(StorageError, match="cannot be written"):
        images.save(torch.zeros(3, 20, 20), tmp_path / "file" / "picture.png")


def test_bytes_and_back() -> None:
    every = np.arange(256, dtype=np.uint8).repeat(3).reshape(16, 16, 3)
    assert np.array_equal(images.to_uint8(images.from_uint8(every)), every)
    assert images.to_uint8(torch.tensor([-1.0, 0.5, 2.0]).reshape(3, 1, 1)).flatten().tolist() == [0, 128, 255]


@given(*(st.integers(1, 60) for _ in range(4)), st.integers(0, 2**31))
def test_fit_has_the_asked_shape_and_keeps_the_range(
    height: int, width: int, rows: int, columns: int, seed: int
) -> None:
    image = torch.rand(3, height, width, generator=torch.Generator().manual_seed(seed))
    fitted = images.fit(image, rows, columns)
    assert fitted.shape == (3, rows, columns)
    assert fitted.min() >= image.min() - 1e-5 and fitted.max() <= image.max() + 1e-5


def test_fit_crops_the_middle_and_keeps_proportions() -> None:
    image = torch.zeros(3, 60, 120)
    image[:, 20:40, 50:70] = 1  # a square in the middle
    image[:, :, :20] = 0.5  # at the left, outside the middle square
    fitted = images.fit(image, 30, 30)
    assert not bool((fitted == 0.5).any())
    assert torch.equal(fitted[0, 11:19, 11:19], torch.ones(8, 8)) and fitted[0, :8].max() == 0


@given(st.lists(st.floats(0, 1), min_size=4, max_size=4), st.integers(1, 40), st.integers(1, 40))
def test_a_crop_lies_inside_and_crops_that_tile_a_picture_cover_it_once(
    shares: list[float], rows: int, columns: int
) -> None:
    image = torch.rand(3, rows, columns)
    left, top, width, height = shares
    part = images.crop(image, (left, top, min(width, 1 - left), min(height, 1 - top)))
    assert 1 <= part.shape[1] <= rows and 1 <= part.shape[2] <= columns
    assert torch.equal(images.crop(image, (0, 0, 1, 1)), image)
    if columns >= 2:
        halves = [images.crop(image, (start, 0, 0.5, 1)) for start in (0, 0.5)]
        assert torch.equal(torch.cat(halves, 2), image)


def test_fit_averages_over_area_when_it_makes_smaller() -> None:
    checks = (torch.arange(400)[:, None] + torch.arange(400)).remainder(2).float().expand(3, -1, -1)
    assert (images.fit(checks, 50, 50) - 0.5).abs().max() < 0.01


@given(*(st.integers(1, 40) for _ in range(2)), *(st.integers(1, 5) for _ in range(2)), st.integers(0, 2**31))
def test_averaged_pixels_are_the_means_of_their_areas(
    rows: int, columns: int, taller: int, wider: int, seed: int
) -> None:
    image = torch.rand(3, rows * taller, columns * wider, generator=torch.Generator().manual_seed(seed))
    times = min(taller, wider)
    top, left = (rows * (taller - times)) // 2, (columns * (wider - times)) // 2
    middle = image[:, top : top + rows * times, left : left + columns * times]
    areas = middle.reshape(3, rows, times, columns, times).mean((2, 4))
    assert (images.resize_by_area(image, rows, columns) - areas).abs().max() < 1e-5


@given(*(st.integers(1, 60) for _ in range(4)), st.integers(0, 2**31))
def test_averaged_has_the_shape_and_the_range_of_fit(
    height: int, width: int, rows: int, columns: int, seed: int
) -> None:
    image = torch.rand(3, height, width, generator=torch.Generator().manual_seed(seed))
    found = images.resize_by_area(image, rows, columns)
    assert found.shape == (3, rows, columns)
    assert found.min() >= image.min() - 1e-5 and found.max() <= image.max() + 1e-5


def test_averaging_keeps_detail_that_fit_softens() -> None:
    image = torch.rand(3, 300, 300, generator=torch.Generator().manual_seed(1))
    assert images.resize_by_area(image, 100, 100).std() > 1.2 * images.fit(image, 100, 100).std()
