import io
from pathlib import Path

import pytest
from PIL import Image

from frida_painter import images
from frida_painter.errors import ImageError
from frida_painter.web import uploads


def picture(width: int = 40, height: int = 30, kind: str = "PNG", **more: object) -> bytes:
    file = io.BytesIO()
    Image.new("RGB", (width, height), (200, 80, 40)).save(file, kind, **more)
    return file.getvalue()


def test_a_picture_is_written_anew(tmp_path: Path) -> None:
    given = picture(kind="JPEG", comment=b"<script>alert(1)</script>") + b"<?php trailing"
    identifier = uploads.keep(given, tmp_path / "pictures")
    kept = tmp_path / "pictures" / f"{identifier}.png"
    assert len(identifier) == 32 and images.load(kept).shape == (3, 30, 40)
    assert b"script" not in kept.read_bytes() and b"php" not in kept.read_bytes()


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "empty"),
        (b"hello", "a text"),
        (b"<svg xmlns='http://www.w3.org/2000/svg'><script/></svg>", "SVG or HTML"),
        (b"%PDF-1.7", "a PDF"),
        (picture()[:60], "damaged"),
        (picture(8, 8), "at least 16"),
        (picture(9000, 9000), "at most"),
    ],
)
def test_what_is_no_picture_is_refused_in_words_that_name_no_path(tmp_path: Path, content: bytes, says: str) -> None:
    with pytest.raises(ImageError, match=says) as caught:
        uploads.keep(content, tmp_path)
    assert "/" not in str(caught.value).replace("SVG or HTML", "")
    assert not list(tmp_path.glob("*.png"))
