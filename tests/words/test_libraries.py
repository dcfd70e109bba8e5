"""Picture libraries, and pictures that anybody may have made."""

import base64
import io
import json
import time
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import resvg_py
import torch
from PIL import Image, ImageColor

from frida_painter.errors import ConfigError, ImageError, PluginError, WeightsError
from frida_painter.objectives import weights
from frida_painter.system.python_process import ProcessLimits
from frida_painter_words import svg_process
from frida_painter_words.libraries import SHIPPED, PictureArchive, PictureFolder, libraries_at_hand, read_picture
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
    monkeypatch.setattr("frida_painter.objectives.weights.catalogue.all_weights", lambda: (*others, entry))
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


SQUARE = '<rect x="10" y="10" width="20" height="20" fill="#ff0000"/>'


def svg(inner: str = SQUARE, attributes: str = 'viewBox="0 0 72 72"') -> bytes:
    links = 'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'
    return f"<svg {attributes} {links}>{inner}</svg>".encode()


def png(picture: Image.Image, **more: object) -> bytes:
    content = io.BytesIO()
    picture.save(content, "PNG", **more)
    return content.getvalue()


@pytest.mark.parametrize(
    "attributes",
    ['viewBox="0 0 72 72"', 'width="72" height="72"', 'width="25.4mm" height="1in"', 'width="100%" viewBox="0,0,72,72"',
     'viewBox="-30 5 72 72"', 'width="9cm" height="90mm" viewBox="5,-30,72,72"', "", 'width="1e400" height="nan"'],
)  # fmt: skip
def test_a_drawing_is_cut_to_what_is_drawn_whatever_its_size_is_given_in(attributes: str) -> None:
    drawing = read_picture(svg(attributes=attributes), "square.svg")
    assert drawing.shape[0] == 4 and drawing.shape[1] == pytest.approx(drawing.shape[2], abs=2)
    assert torch.allclose(drawing[:, 50, 50], torch.tensor([1.0, 0, 0, 1]), atol=1e-3)


@pytest.mark.parametrize(
    ("page", "left", "top"), [('viewBox="0 0 72 72"', 0, 0), ('viewBox="-40 -50 72 72"', -40, -50)]
)
def test_what_goes_beyond_the_page_is_drawn(page: str, left: int, top: int) -> None:
    wide = read_picture(svg(f'<rect x="{left - 10}" y="{top + 30}" width="90" height="10"/>', page), "beyond.svg")
    assert wide.shape[2] / wide.shape[1] == pytest.approx(9, rel=0.1)


def test_cut_outs_of_any_kind_keep_their_colour_up_to_the_edge() -> None:
    indexed = Image.fromarray(np.repeat(np.repeat([[0, 1]], 40, 0), 40, 1).astype(np.uint8), "P")
    indexed.putpalette([255, 0, 255, 0, 128, 0])
    drawing = read_picture(png(indexed, transparency=0), "leaf.png")
    assert drawing.shape[1:] == (40, 40) and float(drawing[3].min()) == 1
    assert torch.allclose(drawing[:3].mean((1, 2)), torch.tensor([0, 128 / 255, 0]), atol=1e-3)
    pixels = np.zeros((1500, 1000, 4), np.uint8)
    pixels[300:1200, 300:700] = (255, 0, 0, 255)
    drawing = read_picture(png(Image.fromarray(pixels, "RGBA")), "large.png")
    assert max(drawing.shape[1:]) <= 512 and float(drawing[0][drawing[3] > 0.1].min()) > 0.98
    blue = base64.b64encode(png(Image.new("RGB", (40, 40), "blue"))).decode()
    drawing = read_picture(svg(f'<image href="data:image/png;base64,{blue}" width="50" height="50"/>'), "inside.svg")
    assert torch.allclose(drawing[:, 50, 50], torch.tensor([0.0, 0, 1, 1]), atol=1e-3)


def test_a_plain_ground_around_a_thing_is_taken_away() -> None:
    pixels = np.full((80, 80, 3), 250, np.uint8)
    pixels[20:60, 30:50] = (200, 30, 30)
    pixels[35:40, 38:42] = 250  # inside the thing: it stays
    drawing = read_picture(png(Image.fromarray(pixels)), "scanned.png")
    assert drawing.shape[1:] == (40, 20) and float(drawing[3].min()) == 1
    photo = np.random.default_rng(0).integers(0, 255, (80, 80, 3)).astype(np.uint8)
    assert float(read_picture(png(Image.fromarray(photo)), "photo.png")[3].min()) == 1, "no plain ground: all of it"


def test_nothing_is_read_from_elsewhere(tmp_path: Path) -> None:
    """The first link is read where it may be: resvg follows paths of files, in pictures and in filters."""
    secret = tmp_path / "secret.png"
    secret.write_bytes(png(Image.new("RGB", (40, 40), "blue")))

    def linked(link: str) -> str:
        whole = f'xlink:href="{link}" href="{link}" x="20" y="20" width="50" height="50"'
        filtered = f'<filter id="f"><feImage {whole}/></filter><g filter="url(#f)">{SQUARE}</g>'
        return f"{SQUARE}<image {whole}/>{filtered}<script>1</script>"

    free = resvg_py.svg_to_bytes(svg(linked(str(secret))).decode(), skip_system_fonts=True)
    assert np.asarray(Image.open(io.BytesIO(bytes(free))))[..., 2].max() == 255
    within = base64.b64encode(svg(linked(str(secret)))).decode()
    for link in (str(secret), secret.as_uri(), "http://127.0.0.1:9/x.png", f"data:image/svg+xml;base64,{within}"):
        drawing = read_picture(svg(linked(link)), "linked.svg")
        assert float((drawing[2] * drawing[3]).max()) < 0.1, link


def test_photographs_of_a_telephone_and_of_many_bits_are_things_too() -> None:
    heic = (Path(__file__).parent.parent / "heic" / "alpha.heic").read_bytes()
    assert float(read_picture(heic, "alpha.heic")[3].min()) < 0.2
    deep = cv2.imencode(".png", np.random.default_rng(0).integers(0, 2**16, (40, 40, 4)).astype(np.uint16))[1].tobytes()
    content = io.BytesIO()
    Image.new("CMYK", (40, 40), (0, 255, 255, 0)).save(content, "JPEG")
    assert read_picture(deep, "deep.png").shape == read_picture(content.getvalue(), "printed.jpg").shape == (4, 40, 40)


def bomb() -> str:
    levels = "".join(f'<g id="a{n}">' + f'<use xlink:href="#a{n - 1}"/>' * 10 + "</g>" for n in range(1, 9))
    return f'<defs><g id="a0">{SQUARE}</g>{levels}</defs><use xlink:href="#a8"/>'


def entities() -> bytes:
    deep = "".join(f'<!ENTITY {chr(98 + n)} "' + f"&{chr(97 + n)};" * 10 + '">' for n in range(12))
    return f'<!DOCTYPE svg [<!ENTITY a "aaaaaaaaaa">{deep}]>'.encode() + svg("<text>&m;</text>")


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (lambda: svg(bomb()), "nodes limit"),
        (entities, "cannot be drawn .*entities"),
        (lambda: svg('<g id="a"><use xlink:href="#b"/></g><g id="b"><use xlink:href="#a"/></g>'), "nodes limit"),
        (lambda: svg("<g>" * 5000 + "</g>" * 5000), "cannot be drawn"),
        (lambda: svg("<g>" * 500 + "</g>" * 500), "too long, or too much memory"),
        (lambda: svg(attributes='viewBox="0 0 1e30 1e30"'), "shows nothing"),
        (lambda: svg(attributes='viewBox="0 0 1e7 1"'), "at least 16"),
        (lambda: svg(""), "shows nothing"),
        (lambda: b"<html></html>", "cannot be drawn .*root"),
        (lambda: png(Image.new("RGBA", (40, 40), (1, 2, 3, 0))), "shows nothing"),
        (lambda: png(Image.new("RGB", (40, 40)))[:60], "damaged PNG picture"),
        (lambda: png(Image.new("1", (12_000, 10_000))), "at most"),
        (lambda: b"", "is empty"),
        (lambda: b"no picture", "is a text, not a picture"),
    ],
)
def test_what_is_no_picture_is_refused_soon(content: Callable[[], bytes], says: str) -> None:
    given, begun = content(), time.process_time()
    with pytest.raises(ImageError, match=says):
        read_picture(given, "given.svg")
    assert time.process_time() - begun < 5


def test_a_drawing_that_never_ends_is_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(svg_process, "draw", replace(svg_process.draw, limits=ProcessLimits(processor=1)))
    turbulent = (
        '<filter id="f" width="100%" height="100%"><feTurbulence baseFrequency="0.9" numOctaves="2000000000"/>'
        f'</filter><g filter="url(#f)">{SQUARE}</g>'
    )
    with pytest.raises(ImageError, match=r"takes too long.*SIG(XCPU|KILL)"):
        read_picture(svg(turbulent), "turbulent.svg")
