import asyncio
import io
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from PIL import Image

from frida_painter.errors import ImageError, Interrupted
from frida_painter.system import images
from frida_painter.system.python_process import ProcessLimits
from frida_painter_studio import store as uploads
from frida_painter_studio.reader import decode_upload
from frida_painter_studio.store import PaintingStore


def picture(width: int = 40, height: int = 30, kind: str = "PNG", mode: str = "RGB", **more: object) -> bytes:
    file = io.BytesIO()
    Image.new("RGB", (1, 1), (200, 80, 40)).convert(mode).resize((width, height)).save(file, kind, **more)
    return file.getvalue()


def test_a_picture_is_written_anew(tmp_path: Path) -> None:
    given = picture(kind="JPEG", comment=b"<script>alert(1)</script>") + b"<?php trailing"
    identifier = uploads.keep(given, tmp_path / "pictures")
    kept = tmp_path / "pictures" / f"{identifier}.png"
    assert len(identifier) == 32 and images.load(kept).shape == (3, 30, 40)
    assert b"script" not in kept.read_bytes() and b"php" not in kept.read_bytes()


@pytest.mark.parametrize(
    ("made", "says"),
    [
        (lambda: b"", "empty"),
        (lambda: b"hello", "a text"),
        (lambda: b"<svg xmlns='http://www.w3.org/2000/svg'><script/></svg>", "SVG or HTML"),
        (lambda: b"%PDF-1.7", "a PDF"),
        (lambda: picture()[:60], "damaged"),
        (lambda: picture(8, 8), "at least 16"),
        (lambda: picture(9000, 9000, mode="1"), "at most"),
    ],
)
def test_what_is_no_picture_is_refused_in_words_that_name_no_path(
    tmp_path: Path, made: Callable[[], bytes], says: str
) -> None:
    with pytest.raises(ImageError, match=says) as caught:
        uploads.keep(made(), tmp_path)
    assert "/" not in str(caught.value).replace("SVG or HTML", "")
    assert not list(tmp_path.glob("*.png"))


def test_a_decoder_has_so_much_memory_and_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is the system that ends it: a picture that a decoder does not get through with takes nothing from others."""
    with pytest.raises(ImageError, match="memory or time"):
        monkeypatch.setattr(uploads, "decode_upload", replace(decode_upload, limits=ProcessLimits(seconds=0.01)))
        uploads.keep(picture(), tmp_path)
    monkeypatch.undo()
    limits = "from frida_painter_studio import reader; reader.decode_upload.limits.apply(); bytearray(3 * 2**30)"
    done = subprocess.run([sys.executable, "-c", limits], capture_output=True, text=True)
    assert done.returncode == 1 and "MemoryError" in done.stderr
    assert not list(tmp_path.iterdir())


def test_pictures_are_for_their_owner_alone(tmp_path: Path) -> None:
    store = PaintingStore(tmp_path / "paintings")
    identifier = uploads.keep(picture(), store.pictures)
    for path in (store.root, store.pictures, store.begin("A painting").folder.path):
        assert path.stat().st_mode & 0o077 == 0
    assert (store.pictures / f"{identifier}.png").stat().st_mode & 0o777 == 0o600


def test_pictures_are_taken_in_one_after_another_and_only_so_many_wait(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    at_once: list[int] = []
    busy = [0]

    def keep(content: bytes, folder: Path) -> str:
        busy[0] += 1
        at_once.append(busy[0])
        time.sleep(0.02)
        busy[0] -= 1
        return "id"

    async def many() -> list[str | BaseException]:
        taking = uploads.Uploads(tmp_path)
        return await asyncio.gather(*(taking.keep(b"x") for _ in range(12)), return_exceptions=True)

    monkeypatch.setattr(uploads, "keep", keep)
    found = asyncio.run(many())
    assert found[:8] == ["id"] * 8 and all(isinstance(each, Interrupted) for each in found[8:])
    assert max(at_once) == 1
