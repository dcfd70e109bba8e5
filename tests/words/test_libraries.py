"""Libraries of pictures: a person's own folder, and fetched archives."""

import json
import zipfile
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from PIL import Image, ImageColor
from torch import Tensor

from frida_painter import weights
from frida_painter.errors import ConfigError, ImageError, WeightsError
from frida_painter.weights.catalogue import NamedWeights
from frida_painter.words.libraries import SHIPPED, PictureArchive, PictureFolder, libraries_at_hand
from plugins import install
from small_libraries import DISC, MAKERS, SILHOUETTE
from tiny_weights import original

PHOTOGRAPHS = "animals/dogs/dalmatian.png", "animals/giant_panda.png", "People/dan3.gif", "erase/nubian_ibex.webp"
MIN = {"openclipart": 1500, "stamps": 600, "abcs": 250, "fluent": 1100, "flashcards": 350}


def painted(path: Path, color: str = "red") -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.new("RGB", (40, 40), color).save(path)
    return path


def test_own_pictures_are_called_by_the_text_beside_them_or_by_their_names(tmp_path: Path) -> None:
    painted(tmp_path / "red-fox_2.png")
    painted(tmp_path / "below" / "OldBoat.JPG")
    painted(tmp_path / "IMG_0042.png").with_suffix(".txt").write_text("  my   cat\nmore\n")
    painted(tmp_path / "IMG_0043.png")
    painted(tmp_path / "renard 狐.png")
    painted(tmp_path / "grey owl.png").with_suffix(".txt").write_text("灰色の梟\n", "utf-8")
    painted(tmp_path / "狐.png").with_suffix(".txt").write_bytes(b"\xff\xfe\x00")
    painted(tmp_path / ".hidden.png")
    (tmp_path / "notes.pdf").write_text("no picture")
    (tmp_path / "loop").symlink_to(tmp_path, target_is_directory=True)
    library = PictureFolder(tmp_path)
    said = {Path(one.file).name: one.captions for one in library.list_captioned()}
    assert said == {
        "red-fox_2.png": ("red fox",), "OldBoat.JPG": ("old boat",), "IMG_0042.png": ("my cat",),
        "renard 狐.png": ("renard",), "grey owl.png": ("grey owl",),
    }  # fmt: skip
    assert library.unnamed == 2, "IMG_0043.png and 狐.png"
    (picture,) = library.pictures(str(tmp_path / "red-fox_2.png"))
    assert picture.shape == (4, 40, 40)


def test_a_folder_without_pictures_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="is no folder"):
        PictureFolder(tmp_path / "missing")
    with pytest.raises(ConfigError, match="holds no picture with a name"):
        PictureFolder(tmp_path).list_captioned()


def test_a_folder_of_too_many_pictures_is_refused_before_their_captions_are_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("frida_painter.words.libraries._MAX_FILES", 3)
    for number in range(3):
        painted(tmp_path / f"fox {'abc'[number]}.png")
    assert len(PictureFolder(tmp_path).list_captioned()) == 3
    painted(tmp_path / "below" / "fox d.png")
    with pytest.raises(ConfigError, match=r"holds more than 3 pictures.*give a folder with those"):
        PictureFolder(tmp_path).list_captioned()


def test_a_library_of_which_a_byte_was_lost_is_told(tmp_path: Path) -> None:
    archive = tmp_path / "pictures.zip"
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as packed:
        packed.write(painted(tmp_path / "fox.png"), "fox.png")
        packed.writestr("captions.json", json.dumps({"fox.png": ["a fox"], "hen.png": ["a hen"]}))
    content = bytearray(archive.read_bytes())
    content[50] ^= 0xFF
    archive.write_bytes(content)
    library = PictureArchive("stamps", "somebody", archive)
    for one in library.list_captioned():
        with pytest.raises(WeightsError, match=r"is damaged.*fetch stamps again"):
            library.pictures(one.file)


def test_pictures_that_went_away_or_are_links_to_nothing(tmp_path: Path) -> None:
    (tmp_path / "cat.png").symlink_to(tmp_path / "nothing.png")
    library = PictureFolder(tmp_path)
    (cat,) = library.list_captioned()
    with pytest.raises(ImageError, match="does not exist"):
        library.pictures(cat.file)


def test_an_archive_has_its_captions_with_it(tmp_path: Path) -> None:
    archive = tmp_path / "pictures.zip"
    with zipfile.ZipFile(archive, "w") as packed:
        packed.write(painted(tmp_path / "fox.png"), "a/fox.png")
        packed.writestr("captions.json", json.dumps({"a/fox.png": ["a fox", "animals"]}))
    library = PictureArchive("stamps", "somebody", archive)
    (fox,) = library.list_captioned()
    assert fox.captions == ("a fox", "animals") and library.pictures(fox.file)[0].shape == (4, 40, 40)
    archive.write_bytes(archive.read_bytes()[:100])
    with pytest.raises(WeightsError, match="fetch stamps again"):
        library.list_captioned()


def test_what_is_at_hand_begins_with_the_own_pictures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    painted(tmp_path / "own" / "fox.png")
    assert [one.name for one in libraries_at_hand(tmp_path / "cache")] == [SHIPPED]
    assert [one.name for one in libraries_at_hand(tmp_path / "cache", tmp_path / "own")] == ["your pictures", SHIPPED]
    module = f"""from pathlib import Path
from frida_painter.words.libraries import PictureFolder
def mine(): return PictureFolder(Path({str(tmp_path / "own")!r}))
def broken(): return 1 / 0
"""
    group = "frida_painter.picture_libraries"
    install(tmp_path / "package", monkeypatch, "more-pictures", {group: {"mine": "more:mine"}}, {"more": module})
    assert len(libraries_at_hand(tmp_path / "cache", tmp_path / "own")) == 3
    install(tmp_path / "worse", monkeypatch, "bad-pictures", {group: {"bad": "more:broken"}})
    with pytest.raises(WeightsError, match="'bad' cannot be used"):
        libraries_at_hand(tmp_path / "cache")


def publish(monkeypatch: pytest.MonkeyPatch, name: str, *contents: bytes) -> NamedWeights:
    """The catalogue's entry, as if these had been published in place of its files; all else stays."""
    entry = weights.find_weights(name)
    kept = tuple(
        replace(file, original=original(file.original.path, content))
        for file, content in zip(entry.kept, contents, strict=True)
    )
    others = [other for other in weights.all_weights() if other.name != name]
    monkeypatch.setattr("frida_painter.weights.catalogue.all_weights", lambda: (*others, replace(entry, kept=kept)))
    return entry


def disc_in(picture: Tensor) -> Tensor:
    """The mean colour of a disc that fills a picture [4, h, w] from edge to edge."""
    seen = picture[3] > 0.99
    assert 0.7 < float(seen.float().mean()) < 0.85, "a disc fills pi / 4 of the square around it"
    return picture[:3, seen].mean(1)


@pytest.mark.parametrize("name", MAKERS)
def test_a_package_becomes_a_library(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    small = MAKERS[name]()
    entry = publish(monkeypatch, name, small.content)
    published = entry.originals[0].name  # of npm, files have the names that are known; packages of Debian any version
    (tmp_path / "brought").mkdir()
    (tmp_path / "brought" / (published if published.endswith(".tgz") else small.file)).write_bytes(small.content)
    weights.fetch(name, tmp_path / "cache", offline=True, origin=tmp_path / "brought")
    library, _ = libraries_at_hand(tmp_path / "cache")
    assert library.name == name and library.credit == f"{entry.credit}, {entry.licence}"
    known = {one.file: one for one in library.list_captioned()}
    assert {file: one.captions for file, one in known.items()} == small.captions
    color = torch.tensor(ImageColor.getrgb(SILHOUETTE if name == "silhouettes" else DISC)) / 255
    for file, one in known.items():
        (picture,) = library.pictures(file)
        assert float((disc_in(picture) - color).abs().max()) < 0.05, file
        assert (one.realism == 0.8) == (file in PHOTOGRAPHS), file


def test_libraries_that_a_person_has_fetched_hold_what_was_published() -> None:
    """Tests do not fetch them: the small ones above are read in any case."""
    for library in libraries_at_hand():
        known = library.list_captioned()
        assert len(known) >= MIN.get(library.name, 1) and bool(library.credit) == (library.name != SHIPPED)
        read = 0
        for one in known[:: max(1, len(known) // 12)]:
            with suppress(ImageError):
                read += all(picture.shape[0] == 4 for picture in library.pictures(one.file))
        assert read >= 11
