"""Libraries of pictures: a person's own folder, fetched archives, and those of packages."""

import json
import zipfile
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from PIL import Image, ImageColor

from frida_painter import weights
from frida_painter.errors import ConfigError, ImageError, PluginError, WeightsError
from frida_painter_words.libraries import SHIPPED, PictureArchive, PictureFolder, libraries_at_hand
from plugins import install
from small_libraries import DISC, MAKERS
from tiny_weights import original


def painted(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.new("RGB", (40, 40), "red").save(path)
    return path


def test_own_pictures_are_called_by_the_text_beside_them_or_by_their_names(tmp_path: Path) -> None:
    for name in ("red-fox_2.png", "below/OldBoat.JPG", "IMG_0043.png", "renard 狐.png", ".hidden.png"):
        painted(tmp_path / name)
    painted(tmp_path / "IMG_0042.png").with_suffix(".txt").write_text("  my   cat\nmore\n")
    painted(tmp_path / "grey owl.png").with_suffix(".txt").write_text("灰色の梟\n", "utf-8")
    painted(tmp_path / "狐.png").with_suffix(".txt").write_bytes(b"\xff\xfe\x00")
    (tmp_path / "notes.pdf").write_text("no picture")
    (tmp_path / "loop").symlink_to(tmp_path, target_is_directory=True)
    library = PictureFolder(tmp_path)
    assert {Path(file).name: said for file, (said,) in library.captions().items()} == {
        "red-fox_2.png": "red fox", "OldBoat.JPG": "old boat", "IMG_0042.png": "my cat", "renard 狐.png": "renard",
        "grey owl.png": "grey owl",
    }  # fmt: skip
    assert library.unnamed == 2, "IMG_0043.png and 狐.png"
    assert library.picture(str(tmp_path / "red-fox_2.png")).shape == (4, 40, 40)


def test_a_folder_without_pictures_or_with_too_many_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ConfigError, match="is no folder"):
        PictureFolder(tmp_path / "missing")
    with pytest.raises(ConfigError, match="holds no picture with a name"):
        PictureFolder(tmp_path).captions()
    monkeypatch.setattr("frida_painter_words.libraries._MAX_FILES", 2)
    for name in ("fox a.png", "fox b.png", "below/fox c.png"):
        painted(tmp_path / name)
    with pytest.raises(ConfigError, match="holds more than 2 pictures"):
        PictureFolder(tmp_path).captions()


def test_pictures_that_went_away_or_are_links_to_nothing(tmp_path: Path) -> None:
    (tmp_path / "cat.png").symlink_to(tmp_path / "nothing.png")
    library = PictureFolder(tmp_path)
    (cat,) = library.captions()
    with pytest.raises(ImageError, match="does not exist"):
        library.picture(cat)


def test_an_archive_has_its_captions_with_it_and_damage_is_told(tmp_path: Path) -> None:
    archive = tmp_path / "pictures.zip"
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as packed:
        packed.write(painted(tmp_path / "fox.png"), "a/fox.png")
        packed.writestr("captions.json", json.dumps({"a/fox.png": ["a fox", "animals"], "hen.png": ["a hen"]}))
    library = PictureArchive("stamps", "somebody", archive)
    assert library.captions()["a/fox.png"] == ["a fox", "animals"] and library.picture("a/fox.png").shape == (4, 40, 40)
    content = bytearray(archive.read_bytes())
    content[50] ^= 0xFF
    archive.write_bytes(content)
    for file in library.captions():  # one is damaged, one is missing
        with pytest.raises(WeightsError, match=r"is damaged.*fetch stamps again"):
            library.picture(file)
    archive.write_bytes(content[:100])
    with pytest.raises(WeightsError, match="fetch stamps again"):
        library.captions()


def test_what_is_at_hand_begins_with_the_own_pictures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    painted(tmp_path / "own" / "fox.png")
    assert [one.name for one in libraries_at_hand(tmp_path / "cache")] == [SHIPPED]
    assert [one.name for one in libraries_at_hand(tmp_path / "cache", tmp_path / "own")] == ["your pictures", SHIPPED]
    module = f"""from pathlib import Path
from frida_painter_words.libraries import PictureFolder
def mine(): return PictureFolder(Path({str(tmp_path / "own")!r}))
"""
    group = "frida_painter.picture_libraries"
    install(tmp_path / "package", monkeypatch, "more-pictures", {group: {"mine": "more:mine"}}, {"more": module})
    assert len(libraries_at_hand(tmp_path / "cache", tmp_path / "own")) == 3
    install(tmp_path / "worse", monkeypatch, "bad-pictures", {group: {"bad": "more:broken"}})
    with pytest.raises(PluginError, match="'bad'"):
        libraries_at_hand(tmp_path / "cache")


@pytest.mark.parametrize("name", MAKERS)
def test_a_package_becomes_a_library(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The catalogue's entry, as if this small package had been published in place of its file."""
    small, entry = MAKERS[name](), weights.find_weights(name)
    published = entry.files[0].name  # of npm, files have the names that are known; packages of Debian any version
    entry = replace(entry, files=(original(published, small.content),))
    others = [other for other in weights.all_weights() if other.name != name]
    monkeypatch.setattr("frida_painter.weights.catalogue.all_weights", lambda: (*others, entry))
    (tmp_path / "brought").mkdir()
    (tmp_path / "brought" / (published if published.endswith(".tgz") else small.file)).write_bytes(small.content)
    weights.fetch(name, tmp_path / "cache", offline=True, origin=tmp_path / "brought")
    _, library = libraries_at_hand(tmp_path / "cache")
    assert library.name == name and library.credit == f"{entry.credit}, {entry.licence}"
    known = library.captions()
    assert {file: tuple(said) for file, said in known.items()} == small.captions
    color = torch.tensor(ImageColor.getrgb(DISC)) / 255
    for file in known:
        picture = library.picture(file)
        seen = picture[3] > 0.99
        assert 0.7 < float(seen.float().mean()) < 0.85, "a disc fills pi / 4 of the square around it"
        assert float((picture[:3, seen].mean(1) - color).abs().max()) < 0.05, file


def test_the_shipped_library_is_whole(tmp_path: Path) -> None:
    (library,) = libraries_at_hand(tmp_path)
    known = [*library.captions()]
    assert len(known) > 1000 and all(library.picture(file).shape[0] == 4 for file in known[::100])
