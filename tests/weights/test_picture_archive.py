"""Packages of pictures, repacked as a zip with captions."""

import json
import zipfile
from pathlib import Path

import pytest

from frida_painter.errors import WeightsError
from frida_painter.weights.archive import (
    character_name,
    repack_abcs,
    repack_costumes,
    repack_flashcards,
    repack_fluent,
    repack_furniture,
    repack_gcompris,
    repack_silhouettes,
)
from qt import resource
from small_libraries import debian, tar_of, zip_of


def write_debian(path: Path, files: dict[str, bytes]) -> Path:
    path.write_bytes(debian(files))
    return path


def captions(archive: Path) -> dict[str, list[str]]:
    with zipfile.ZipFile(archive) as opened:
        return json.loads(opened.read("captions.json"))


def test_pictures_are_called_by_their_names_and_folders(tmp_path: Path) -> None:
    below = "usr/share/qabcs/abcs/all/pics/"
    known = ("animals/giant_panda.png", "toys/ursula.png", "food/apple.txt")
    repack_abcs(write_debian(tmp_path / "a.deb", {below + name: b"a" for name in known}), tmp_path / "a.zip")
    assert captions(tmp_path / "a.zip") == {"animals/giant_panda.png": ["giant panda", "animals"]}
    below = "usr/share/games/pysiogame/res/images/art4apps/"
    known = ("fruit_n_veg/pear.jpg", "body/knee.jpg", "transport/mast.jpg", "construction/barn.jpg")
    repack_flashcards(write_debian(tmp_path / "b.deb", {below + name: b"b" for name in known}), tmp_path / "b.zip")
    assert captions(tmp_path / "b.zip") == {
        "cartoon/fruit_n_veg/pear.jpg": ["pear", "fruit and veg"],
        "cartoon/construction/barn.jpg": ["barn", "construction"],
    }


def test_pictures_are_called_as_our_tables_say(tmp_path: Path) -> None:
    below = "usr/share/scratch/Media/Costumes/"
    known = ("People/dan3.gif", "Animals/crab2.gif", "Fantasy/gobo1.gif")
    repack_costumes(write_debian(tmp_path / "c.deb", {below + name: b"c" for name in known}), tmp_path / "c.zip")
    assert captions(tmp_path / "c.zip") == {"People/dan3.gif": ["dancing man"], "cartoon/Animals/crab2.gif": ["crab"]}
    erase = resource({"gcompris": {"src": {"activities": {"erase": {"resource": {"nubian_ibex.webp": b"i"}}}}}})
    match = resource({"babymatch": {"resource": {"images": {"sofa.svg": b"<svg/>", "star.svg": b"<svg/>"}}}})
    below = "usr/share/gcompris-qt/rcc/"
    packed = {f"{below}erase.rcc": erase, f"{below}babymatch.rcc": match, f"{below}menu.rcc": b"no resource"}
    repack_gcompris(write_debian(tmp_path / "g.deb", packed), tmp_path / "g.zip")
    assert captions(tmp_path / "g.zip") == {
        "erase/nubian_ibex.webp": ["ibex"],
        "cartoon/babymatch/images/sofa.svg": ["sofa"],
    }
    with pytest.raises(WeightsError, match=r"erase\.rcc.*damaged Qt resource"):
        repack_gcompris(write_debian(tmp_path / "d.deb", {f"{below}erase.rcc": erase[:-4]}), tmp_path / "d.zip")


def test_modelled_pictures_are_called_by_their_characters(tmp_path: Path) -> None:
    package = tmp_path / "emoji.tgz"
    known = ("1f9a2.webp", "2602-fe0f.webp", "1f474-1f3fb.webp", "../1f600.webp", "notes.txt")
    package.write_bytes(tar_of({f"package/assets/{name}": b"e" for name in known}, "gz"))
    repack_fluent(package, tmp_path / "e.zip")
    assert captions(tmp_path / "e.zip") == {"cartoon/1f9a2.webp": ["swan"], "cartoon/2602-fe0f.webp": ["umbrella"]}


def test_models_of_furniture_are_called_as_our_table_says(tmp_path: Path) -> None:
    below = "usr/share/sweethome3d/furniture/"
    packed = zip_of(
        {
            "scopia/acacia.png": b"a",
            "scopia/garden-faucet.png": b"g",
            "scopia/square_switch.png": b"s",
            "scopia/acacia.obj": b"o",
        }
    )
    repack_furniture(write_debian(tmp_path / "f.deb", {f"{below}Scopia.sh3f": packed}), tmp_path / "f.zip")
    assert captions(tmp_path / "f.zip") == {
        "cartoon/Scopia/scopia/acacia.png": ["acacia tree"],
        "cartoon/Scopia/scopia/garden-faucet.png": ["faucet", "tap"],
    }
    with pytest.raises(WeightsError, match=r"Scopia\.sh3f, which is damaged"):
        repack_furniture(write_debian(tmp_path / "d.deb", {f"{below}Scopia.sh3f": packed[:-9]}), tmp_path / "d.zip")


def test_silhouettes_are_called_by_their_names_and_a_head_is_the_animal(tmp_path: Path) -> None:
    package = tmp_path / "icons.tgz"
    body = '<path fill="currentColor" d="M0 0h9v9z"/>'
    names = ("tree-branch", "walrus-head", "tree-face", "tree", "card-ace-clubs", "dice-target")
    listed = json.dumps({"icons": {name: {"body": body} for name in names}}).encode()
    package.write_bytes(tar_of({"package/icons.json": listed}, "gz"))
    repack_silhouettes(package, tmp_path / "i.zip")
    assert captions(tmp_path / "i.zip") == {
        "tree-branch.svg": ["tree branch"],
        "walrus-head.svg": ["walrus"],
        "tree-face.svg": ["tree face"],
        "tree.svg": ["tree"],
    }
    with zipfile.ZipFile(tmp_path / "i.zip") as opened:
        assert b"currentColor" not in opened.read("tree.svg") and b"M0 0h9v9z" in opened.read("tree.svg")
    for damaged in (b"{", b"{}", json.dumps({"icons": {"tree": {}}}).encode()):
        package.write_bytes(tar_of({"package/icons.json": damaged}, "gz"))
        with pytest.raises(WeightsError, match="damaged package"):
            repack_silhouettes(package, tmp_path / "i.zip")


def test_packages_cut_in_half_and_without_pictures_are_refused(tmp_path: Path) -> None:
    package = tmp_path / "emoji.tgz"
    whole = tar_of({"package/assets/1f9a2.webp": bytes(range(256)) * 40}, "gz")
    package.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(WeightsError, match="damaged package"):
        repack_fluent(package, tmp_path / "e.zip")
    package.write_bytes(tar_of({"package/notes.txt": b"e"}, "gz"))
    with pytest.raises(WeightsError, match="no picture with a caption"):
        repack_fluent(package, tmp_path / "e.zip")


@pytest.mark.parametrize(
    ("code", "name"),
    [("1f353", "strawberry"), ("2602-FE0F", "umbrella"), ("1f474-1f3fb", ""), ("110000", ""), ("xyz", ""), ("", "")],
)
def test_characters_have_names(code: str, name: str) -> None:
    assert character_name(code) == name
