import threading
import time
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from frida_painter.easel.guard import GuardedCamera
from frida_painter.easel.host import LivePicture, encode_jpeg
from frida_painter.errors import CameraError
from frida_painter.hardware.robot import Frame
from session.easel_errands import until

PATIENCE = 20.0


class StillCamera:
    """Photographs, and has no picture otherwise."""

    def __init__(self) -> None:
        self.glances = 0

    def connect(self) -> None: ...

    def capture(self, newer_than: float) -> Frame:
        return Frame(np.zeros((4, 6, 3), np.uint8), newer_than + 1, 1)

    def close(self) -> None: ...


class Webcam(StillCamera):
    """Its pictures grow brighter; `broken` has each glance fail."""

    broken = False

    def glance(self) -> NDArray[np.uint8]:
        self.glances += 1
        if self.broken:
            raise CameraError("No picture.")
        return np.full((480, 1920, 3), min(255, 20 * self.glances), np.uint8)


def test_a_live_camera_has_its_picture_in_the_file_until_it_is_dismissed(tmp_path: Path) -> None:
    webcam, path = Webcam(), tmp_path / ".camera.jpg"
    live = LivePicture(GuardedCamera(webcam), path, between=0.01)
    until(lambda: webcam.glances > 3)
    with Image.open(path) as picture:
        assert picture.size == (960, 240)
    live.dismiss()
    until(lambda: not path.exists())
    seen = webcam.glances
    time.sleep(0.1)
    assert webcam.glances == seen


def test_what_fails_is_tried_again_and_nobody_else_hears_of_it(tmp_path: Path) -> None:
    webcam, path = Webcam(), tmp_path / ".camera.jpg"
    webcam.broken = True
    guarded = GuardedCamera(webcam)
    live = LivePicture(guarded, path, between=0.01)
    until(lambda: webcam.glances > 3)
    assert not path.exists()
    assert guarded.capture(5.0).captured_at == 6.0
    webcam.broken = False
    until(path.exists)
    live.dismiss()


def test_nobody_glances_at_a_camera_of_single_photographs_or_while_the_painter_photographs(tmp_path: Path) -> None:
    live = LivePicture(GuardedCamera(StillCamera()), tmp_path / ".camera.jpg", between=0.01)
    time.sleep(0.1)
    assert GuardedCamera(StillCamera()).glance() is None and list(tmp_path.iterdir()) == []
    live.dismiss()
    glanced: list[object] = []

    class Busy(Webcam):
        def capture(self, newer_than: float) -> Frame:
            glanced.append(guarded.glance())
            return super().capture(newer_than)

    guarded = GuardedCamera(Busy())
    guarded.capture(0.0)
    assert glanced == [None] and guarded.glance() is not None


@pytest.mark.parametrize("columns", [10, 960, 4000])
def test_a_live_picture_is_at_most_so_wide_and_keeps_its_colours(columns: int, tmp_path: Path) -> None:
    picture = np.zeros((40, columns, 3), np.uint8)
    picture[..., 0] = 200
    (tmp_path / "a.jpg").write_bytes(encode_jpeg(picture))
    with Image.open(tmp_path / "a.jpg") as small:
        assert small.width == min(columns, 960)
        red, green, blue = small.convert("RGB").getpixel((0, 0))  # type: ignore[misc]
    assert abs(red - 200) < 6 and green < 6 and blue < 6


def test_a_picture_that_comes_late_does_not_stay(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("frida_painter.easel.host._LAST", 0.0)
    taking, released = threading.Event(), threading.Event()

    class Slow(Webcam):
        def glance(self) -> NDArray[np.uint8]:
            taking.set()
            released.wait(PATIENCE)
            return super().glance()

    webcam, path = Slow(), tmp_path / ".camera.jpg"
    live = LivePicture(GuardedCamera(webcam), path, between=0.01)
    assert taking.wait(PATIENCE)
    live.dismiss()
    released.set()
    live._thread.join(PATIENCE)
    assert webcam.glances == 1 and not path.exists()
