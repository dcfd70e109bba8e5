import os
import shutil
import threading
import time
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from PIL import ExifTags, Image

from frida_painter.errors import CameraError, StaleFrame
from frida_painter_drivers.cameras import FolderCamera


def picture(shade: int, shape: tuple[int, ...] = (40, 60, 3)) -> Image.Image:
    return Image.fromarray(np.full(shape, shade, np.uint8))


def camera_at(path: Path, patience: float = 0.6) -> FolderCamera:
    camera = FolderCamera(path, patience)
    camera.connect()
    return camera


def later(seconds: float, do: Callable[[], object]) -> threading.Thread:
    thread = threading.Timer(seconds, do)
    thread.start()
    return thread


def test_a_picture_that_comes_while_it_is_waited_for_is_taken(tmp_path: Path) -> None:
    picture(10).save(tmp_path / "old.png")
    camera = camera_at(tmp_path, patience=5)
    asked = time.monotonic()
    thread = later(0.2, lambda: picture(200).save(tmp_path / "new.jpg"))
    frame = camera.capture(asked)
    thread.join()
    assert frame.image.shape == (40, 60, 3) and frame.image.dtype == np.uint8
    assert abs(int(frame.image.mean()) - 200) < 2
    assert asked < frame.captured_at <= time.monotonic()


def test_a_picture_written_after_the_motion_is_taken_at_once_and_never_twice(tmp_path: Path) -> None:
    camera = camera_at(tmp_path)
    moved = time.monotonic() - 1
    picture(10).save(tmp_path / "a.png")
    first = camera.capture(moved)
    assert moved < first.captured_at <= time.monotonic()
    with pytest.raises(StaleFrame, match=r"No new picture came .* in 0.6 s; the newest, a.png, is \d s old"):
        camera.capture(moved)
    picture(10).save(tmp_path / "copy.png")  # other name, same bytes
    with pytest.raises(StaleFrame):
        camera.capture(moved)
    picture(30).save(tmp_path / "b.png")
    second = camera.capture(moved)
    assert second.image.mean() == 30 and second.sequence == first.sequence + 1


def test_a_picture_from_before_the_motion_is_stale_and_an_older_one_is_never_gone_back_to(tmp_path: Path) -> None:
    for name, shade, age in (("older.png", 10, 20), ("newer.png", 30, 10)):
        picture(shade).save(tmp_path / name)
        os.utime(tmp_path / name, (time.time() - age,) * 2)
    camera = camera_at(tmp_path)
    with pytest.raises(StaleFrame, match=r"newer.png, is 1\d s old"):
        camera.capture(time.monotonic())
    assert camera.capture(time.monotonic() - 60).image.mean() == 30
    with pytest.raises(StaleFrame):
        camera.capture(time.monotonic() - 60)


def by_its_own_clock(shade: int, path: Path, ago: float, offset: str = "") -> None:
    """A picture that says that it was exposed so many seconds ago."""
    exif = Image.Exif()
    said = exif.get_ifd(ExifTags.IFD.Exif)
    zone = UTC if offset else None
    moment = datetime.fromtimestamp(time.time() - ago, zone)
    said[ExifTags.Base.DateTimeOriginal] = f"{moment:%Y:%m:%d %H:%M:%S}"
    if offset:
        said[ExifTags.Base.OffsetTimeOriginal] = offset
    picture(shade).save(path, exif=exif)


def test_an_old_picture_that_is_moved_in_is_not_taken_for_a_new_one(tmp_path: Path) -> None:
    """B5: what counts is when it was taken, not when its name came."""
    aside, place = tmp_path / "aside.png", tmp_path / "pictures"
    place.mkdir()
    picture(40).save(aside)
    os.utime(aside, (time.time() - 3600,) * 2)
    camera = camera_at(place)
    thread = later(0.1, lambda: aside.rename(place / "new.png"))
    with pytest.raises(StaleFrame, match=r"new.png was written 360\d s before it was looked for\. If that is not so"):
        camera.capture(time.monotonic())
    thread.join()


@pytest.mark.parametrize("offset", ["", "+00:00"])
def test_a_picture_is_as_old_as_it_says_itself(tmp_path: Path, offset: str) -> None:
    camera = camera_at(tmp_path)
    thread = later(0.1, lambda: by_its_own_clock(40, tmp_path / "a.jpg", 3600, offset))
    with pytest.raises(StaleFrame, match=r"a.jpg was exposed on 20\d\d-.* by the camera's own clock\. If that is not"):
        camera.capture(time.monotonic())
    thread.join()
    by_its_own_clock(60, tmp_path / "b.jpg", 0, offset)
    assert abs(camera.capture(time.monotonic() - 0.5).image.mean() - 60) < 2
    by_its_own_clock(80, tmp_path / "ahead.jpg", -7200, offset)
    assert abs(camera.capture(time.monotonic() - 0.5).image.mean() - 80) < 2, "a date that lies ahead says nothing"


def test_a_copy_of_a_picture_that_lies_there_is_an_old_one(tmp_path: Path) -> None:
    picture(40).save(tmp_path / "hour-old.png")
    os.utime(tmp_path / "hour-old.png", (time.time() - 3600,) * 2)
    camera = camera_at(tmp_path)
    thread = later(0.1, lambda: shutil.copyfile(tmp_path / "hour-old.png", tmp_path / "new.png"))
    with pytest.raises(StaleFrame, match=r"new.png is a copy of hour-old.png\."):
        camera.capture(time.monotonic())
    thread.join()


def test_what_was_photographed_before_the_last_time_is_known_again(tmp_path: Path) -> None:
    camera = camera_at(tmp_path)
    for shade in (10, 20):
        picture(shade).save(tmp_path / "one.png")
        camera.capture(time.monotonic() - 1)
    picture(10).save(tmp_path / "one.png")
    with pytest.raises(StaleFrame, match="byte for byte, what was photographed before"):
        camera.capture(time.monotonic() - 1)


def test_a_date_that_lies_ahead_is_not_believed(tmp_path: Path) -> None:
    picture(10).save(tmp_path / "a.png")
    os.utime(tmp_path / "a.png", (time.time() + 3600,) * 2)
    camera = camera_at(tmp_path)
    with pytest.raises(StaleFrame, match=r"a.png, is dated 3\d\d\d s ahead of this computer's clock"):
        camera.capture(time.monotonic() - 10)


def test_a_half_written_picture_is_waited_for(tmp_path: Path) -> None:
    whole = tmp_path / "whole.bin"
    Image.fromarray(np.random.default_rng(0).integers(0, 255, (80, 120, 3), np.uint8)).save(whole, "jpeg")
    content = whole.read_bytes()
    target = tmp_path / "shot.jpg"

    def write() -> None:
        with target.open("wb") as file:
            for start in range(0, len(content), len(content) // 4):
                file.write(content[start : start + len(content) // 4])
                file.flush()
                time.sleep(0.15)

    camera = camera_at(tmp_path, patience=5)
    thread = later(0.0, write)
    frame = camera.capture(time.monotonic() - 1)
    thread.join()
    assert np.array_equal(frame.image, np.asarray(Image.open(target).convert("RGB")))


def test_a_damaged_picture_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("frida_painter_drivers.cameras._WRITING", 0.5)
    (tmp_path / "shot.jpg").write_bytes(b"\xff\xd8\xff\xe0 cut off")
    with pytest.raises(CameraError, match=r"newest picture cannot be used: .*shot.jpg"):
        camera_at(tmp_path, patience=3).capture(time.monotonic() - 1)


def test_one_file_that_is_overwritten_is_enough_and_other_files_do_not_count(tmp_path: Path) -> None:
    shot = tmp_path / "latest.png"
    camera = camera_at(shot, patience=3)
    picture(10).save(shot)
    assert camera.capture(time.monotonic() - 1).image.mean() == 10
    for name in ("notes.txt", ".hidden.png", "shot.jpg.part"):
        (tmp_path / name).write_bytes(b"x")
    thread = later(0.1, lambda: picture(20).save(shot))
    assert camera.capture(time.monotonic() - 1).image.mean() == 20
    thread.join()


def test_turned_and_deep_pictures_become_upright_bytes(tmp_path: Path) -> None:
    camera = camera_at(tmp_path, patience=3)
    half = np.zeros((40, 60, 3), np.uint8)
    half[:, :30] = 255  # bright on the left
    exif = Image.Exif()
    exif[0x0112] = 6  # to be turned a quarter clockwise
    Image.fromarray(half).save(tmp_path / "a.png", exif=exif)
    image = camera.capture(time.monotonic() - 1).image
    assert image.shape == (60, 40, 3) and image[:30].mean() == 255 and image[30:].mean() == 0
    Image.fromarray(np.full((40, 60), 65535 // 2, np.uint16)).save(tmp_path / "b.png")
    image = camera.capture(time.monotonic() - 1).image
    assert image.shape == (40, 60, 3) and abs(image.mean() - 127.5) < 1


def test_what_is_no_folder_is_refused_and_a_folder_that_vanishes_is_told(tmp_path: Path) -> None:
    for path in (tmp_path / "none", tmp_path / "none" / "a.jpg", tmp_path / "a.txt"):
        with pytest.raises(CameraError, match="is no folder, nor a picture in one"):
            camera_at(path)
    (tmp_path / "shots").mkdir()
    camera = camera_at(tmp_path / "shots")
    (tmp_path / "shots").rmdir()
    with pytest.raises(StaleFrame, match="there is none"):
        camera.capture(0.0)
    camera.close()
    with pytest.raises(CameraError, match="not connected"):
        camera.capture(0.0)


@pytest.mark.parametrize("name", ["IMG_1.HEIC", "IMG_1.jfif", "IMG_1.avif"])
def test_what_telephones_save_is_taken(tmp_path: Path, name: str) -> None:
    camera = camera_at(tmp_path, patience=5)
    kind = {"HEIC": None, "jfif": "JPEG", "avif": "AVIF"}[name.partition(".")[2]]
    if kind is None:
        sample = Path(__file__).parents[2] / "heic" / "plain.heic"
        thread = later(0.1, lambda: (tmp_path / name).write_bytes(sample.read_bytes()))
    else:
        thread = later(0.1, lambda: picture(120).save(tmp_path / name, format=kind))
    frame = camera.capture(time.monotonic())
    thread.join()
    assert abs(float(frame.image.mean()) - (137 if kind is None else 120)) < 2


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("IMG_1.CR2", b"II*\0\x10\0\0\0CR\2\0", r"IMG_1.CR2 came and cannot be used: it is a camera's raw photograph"),
        ("IMG_1.psd", b"8BPS\0\1", r"IMG_1.psd .*\(Photoshop\).*set the camera or the telephone to JPEG"),
        ("IMG_1.bin", b"\xff\xd8\xff\xe0", "IMG_1.bin .* JPEG picture by its content and not by its name"),
    ],
)
def test_a_picture_that_came_and_cannot_be_used_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, content: bytes, says: str
) -> None:
    monkeypatch.setattr("frida_painter_drivers.cameras._WRITING", 0.3)
    (tmp_path / "old.CR2").write_bytes(b"II*\0\x10\0\0\0CR\2\0")  # lay there before
    camera = camera_at(tmp_path, patience=20)
    thread = later(0.1, lambda: (tmp_path / name).write_bytes(content))
    began = time.monotonic()
    with pytest.raises(CameraError, match=says):
        camera.capture(began)
    thread.join()
    assert time.monotonic() - began < 15, "it is named long before the patience ends"


def test_what_comes_beside_a_picture_is_not_in_its_way(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("frida_painter_drivers.cameras._WRITING", 0.2)
    camera = camera_at(tmp_path, patience=1)
    (tmp_path / "notes.txt").write_text("a text")
    (tmp_path / "IMG_2.mov").write_bytes(b"\0\0\0\x14ftypqt  ")
    thread = later(0.2, lambda: (tmp_path / "notes2.txt").write_text("another"))
    with pytest.raises(StaleFrame):
        camera.capture(time.monotonic())
    thread.join()
    picture(90).save(tmp_path / "IMG_3.jpg")
    (tmp_path / "IMG_3.CR2").write_bytes(b"II*\0\x10\0\0\0CR\2\0")  # the same photograph, raw
    assert camera.capture(time.monotonic() - 1).image.shape == (40, 60, 3)
