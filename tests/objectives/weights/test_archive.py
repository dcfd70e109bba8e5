"""Packages of pictures that cannot be repacked; tests/words/test_libraries.py repacks one of each kind."""

import json
import zipfile
from pathlib import Path

import pytest

from frida_painter.errors import WeightsError
from frida_painter.objectives import weights
from frida_painter.objectives.weights.archive import CAPTIONS, repack
from small_libraries import debian, tar_of

WEBP = {"package/assets/1f9a2.webp": bytes(range(256)) * 40}
PNG = {"usr/share/qabcs/abcs/all/pics/animals/fox.png": bytes(range(256)) * 40}


@pytest.mark.parametrize(
    ("library", "content", "says"),
    [
        ("fluent", tar_of(WEBP, "gz")[:-200], "damaged package"),
        ("fluent", tar_of({"package/notes.txt": b"e"}, "gz"), "no picture with a caption"),
        ("abcs", debian(PNG)[:-200], "damaged package"),
        ("abcs", debian(PNG)[:100], "damaged package"),
        ("abcs", b"", "damaged package"),
    ],
)
def test_packages_cut_off_and_without_pictures_are_refused(
    tmp_path: Path, library: str, content: bytes, says: str
) -> None:
    (tmp_path / "package").write_bytes(content)
    with pytest.raises(WeightsError, match=says):
        repack(tmp_path / "package", tmp_path / "pictures.zip", weights.find_weights(library).pictures)


def test_characters_have_names(tmp_path: Path) -> None:
    codes = ("1f353", "2602-FE0F", "1f474-1f3fb", "110000", "xyz")
    (tmp_path / "package").write_bytes(tar_of({f"package/assets/{code}.webp": b"picture" for code in codes}, "gz"))
    repack(tmp_path / "package", tmp_path / "pictures.zip", weights.find_weights("fluent").pictures)
    with zipfile.ZipFile(tmp_path / "pictures.zip") as packed:
        captions = json.loads(packed.read(CAPTIONS))
    assert captions == {"cartoon/1f353.webp": ["strawberry"], "cartoon/2602-FE0F.webp": ["umbrella"]}
