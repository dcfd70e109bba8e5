import threading
import time
from pathlib import Path

import cv2
import numpy as np
import pytest

from frida_painter.errors import CameraError, StaleFrame
from frida_painter_drivers.cameras import OpencvCamera


class FakeDevice:
    """Holds four frames back like V4L2; number of a frame is its shade. `behave` says what a read does."""

    def __init__(self, device: int | str) -> None:
        self.device, self.grabs, self.released = device, 0, False
        self.behave = "well"
        self.set_to: dict[int, float] = {}

    def isOpened(self) -> bool:
        return self.device != 7

    def set(self, name: int, value: float) -> bool:
        self.set_to[name] = value
        return True

    def grab(self) -> bool:
        self.grabs += 1
        return True

    def read(self) -> tuple[bool, object]:
        self.grabs += 1
        match self.behave:
            case "gone":
                return False, None
            case "hangs":
                threading.Event().wait(30)
            case "raises":
                raise cv2.error("select timeout")
            case "frozen":
                return True, np.zeros((4, 6, 3), np.uint8)
            case "unlike":
                return True, "a picture"
        image = np.zeros((4, 6, 3), np.uint8)
        image[..., 2] = self.grabs % 256  # BGR: red
        return True, image

    def release(self) -> None:
        self.released = True


@pytest.fixture
def devices(monkeypatch: pytest.MonkeyPatch) -> list[FakeDevice]:
    opened: list[FakeDevice] = []

    def open_device(device: int | str) -> FakeDevice:
        opened.append(FakeDevice(device))
        return opened[-1]

    monkeypatch.setattr(cv2, "VideoCapture", open_device)
    monkeypatch.setattr(OpencvCamera, "looking", 0.3)
    return opened


def test_frames_that_were_held_back_are_passed_over_and_colours_are_rgb(devices: list[FakeDevice]) -> None:
    camera = OpencvCamera()
    camera.connect()
    before = time.monotonic()
    first = camera.capture(before - 1e-3)
    second = camera.capture(first.captured_at)
    assert before <= first.captured_at <= second.captured_at <= time.monotonic()
    assert second.image[0, 0, 0] - first.image[0, 0, 0] > 4
    assert (first.image[..., 1:] == 0).all()
    assert second.sequence == first.sequence + 1
    with pytest.raises(StaleFrame, match="before the arm's last motion"):
        camera.capture(time.monotonic() + 5)
    camera.close()
    assert devices[0].released


@pytest.mark.parametrize(
    ("behave", "error", "says"),
    [
        ("gone", CameraError, "gives no picture any more"),
        ("hangs", CameraError, "did not answer within 0 s"),
        ("raises", CameraError, "failed .*select timeout"),
        ("frozen", StaleFrame, "same photograph again"),
        ("unlike", CameraError, "no picture"),
    ],
)
def test_what_goes_wrong_is_told_in_a_sentence(
    devices: list[FakeDevice], behave: str, error: type[CameraError], says: str
) -> None:
    camera = OpencvCamera()
    camera.connect()
    devices[0].behave = behave
    with pytest.raises(error, match=says):
        for _ in range(2):
            camera.capture(0.0)
    if behave == "hangs":
        devices[0].behave = "well"
        with pytest.raises(CameraError, match="did not answer the last time"):
            camera.capture(0.0)
    camera.close()
    devices[0].behave = "well"
    camera.connect()
    assert camera.capture(0.0).image.shape == (4, 6, 3)


def test_a_camera_that_is_not_there_is_told_and_let_go(devices: list[FakeDevice]) -> None:
    camera = OpencvCamera(7)
    with pytest.raises(CameraError, match="There is no camera 7, or another program uses it"):
        camera.connect()
    assert devices[0].released
    with pytest.raises(CameraError, match="not connected"):
        camera.capture(0.0)


def test_a_camera_that_opens_but_shows_nothing_is_let_go(
    devices: list[FakeDevice], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(FakeDevice, "read", lambda self: (False, None))
    camera = OpencvCamera()
    with pytest.raises(CameraError, match="no picture any more"):
        camera.connect()
    assert devices[0].released
    assert devices[0].set_to[cv2.CAP_PROP_FRAME_WIDTH] >= 1920


def test_a_real_stream_is_read_until_it_ends(tmp_path: Path) -> None:
    path = tmp_path / "stream.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 25, (64, 48))
    for shade in range(0, 140, 10):
        writer.write(np.full((48, 64, 3), (0, 0, 100 + shade), np.uint8))
    writer.release()
    camera = OpencvCamera(str(path))
    camera.connect()
    frame = camera.capture(0.0)
    assert frame.image.shape == (48, 64, 3)
    assert abs(int(frame.image[..., 0].mean()) - 210) < 6 and frame.image[..., 2].mean() < 6
    with pytest.raises(CameraError, match="no picture any more"):
        camera.capture(0.0)
    camera.close()


def test_a_glance_changes_nothing_for_photographs(devices: list[FakeDevice]) -> None:
    camera = OpencvCamera()
    with pytest.raises(CameraError, match="not connected"):
        camera.glance()
    camera.connect()
    device = devices[0]
    before = camera.capture(float("-inf"))
    assert camera.glance()[0, 0].tolist() == [device.grabs % 256, 0, 0]
    assert camera.capture(before.captured_at).sequence == before.sequence + 1
    device.behave = "gone"
    with pytest.raises(CameraError, match="no picture"):
        camera.glance()
