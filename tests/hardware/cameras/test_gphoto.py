import io
import sys
import threading
import types
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from frida_painter.errors import CameraError
from frida_painter_drivers.cameras import GphotoCamera


class GPhoto2Error(Exception):
    def __init__(self, code: int, text: str) -> None:
        super().__init__(f"[{code}] {text}")
        self.code = code


@dataclass
class Place:
    folder: str = "/store_00010001/DCIM/100CANON"
    name: str = "IMG_0001.JPG"


class FakeCamera:
    """Speaks the calls of python-gphoto2 that are used."""

    behave = "well"

    def __init__(self) -> None:
        self.shots, self.exited = 0, False

    def init(self) -> None:
        if self.behave == "absent":
            raise GPhoto2Error(-105, "Unknown model")
        if self.behave == "claimed":
            raise GPhoto2Error(-53, "Could not claim the USB device")

    def capture(self, kind: int) -> Place:
        assert kind == 0
        self.shots += 1
        if self.behave == "odd":
            raise RuntimeError("never heard of")
        if self.behave == "hangs":
            threading.Event().wait(30)
        return Place()

    def file_get(self, folder: str, name: str, kind: int) -> "FakeCamera":
        assert (folder, name, kind) == (Place.folder, Place.name, 1)
        return self

    def save(self, path: str) -> None:
        content = io.BytesIO()
        Image.fromarray(np.full((40, 60, 3), self.shots * 20, np.uint8)).save(content, "jpeg")
        Path(path).write_bytes(b"II*\0 raw" if self.behave == "raw" else content.getvalue())

    def exit(self) -> None:
        self.exited = True


@pytest.fixture
def library(monkeypatch: pytest.MonkeyPatch) -> type[FakeCamera]:
    class Fresh(FakeCamera):
        pass

    module = types.ModuleType("gphoto2")
    module.Camera, module.GPhoto2Error = Fresh, GPhoto2Error
    module.GP_CAPTURE_IMAGE, module.GP_FILE_TYPE_NORMAL = 0, 1
    monkeypatch.setitem(sys.modules, "gphoto2", module)
    return Fresh


@pytest.mark.usefixtures("library")
def test_each_photograph_is_a_new_one() -> None:
    camera = GphotoCamera()
    camera.connect()
    first, second = camera.capture(0.0), camera.capture(0.0)
    assert first.image.shape == (40, 60, 3)
    assert abs(int(first.image.mean()) - 20) < 2 and abs(int(second.image.mean()) - 40) < 2
    assert second.captured_at >= first.captured_at and second.sequence == first.sequence + 1
    camera.close()
    with pytest.raises(CameraError, match="not connected"):
        camera.capture(0.0)


@pytest.mark.parametrize(
    ("behave", "says"),
    [
        ("absent", r"connect: no camera was found over USB; switch it on.*\[-105\]"),
        ("claimed", "another program has the camera"),
        ("raw", "'IMG_0001.JPG', which is no picture that can be read; set it to JPEG"),
        ("odd", "photograph: the camera at gphoto2 failed .*never heard of"),
        ("hangs", "did not answer"),
    ],
)
def test_what_goes_wrong_says_what_to_do(
    library: type[FakeCamera], behave: str, says: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    library.behave = behave
    camera = GphotoCamera()
    with monkeypatch.context() as patch, pytest.raises(CameraError, match=says):
        if behave == "hangs":
            patch.setattr(GphotoCamera, "looking", 0.3)
        camera.connect()
        camera.capture(0.0)
    library.behave = "well"
    camera.connect()
    assert camera.capture(0.0).image.shape == (40, 60, 3)


def test_without_the_package_a_sentence_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "gphoto2", None)
    with pytest.raises(CameraError, match='extra "gphoto"'):
        GphotoCamera().connect()
