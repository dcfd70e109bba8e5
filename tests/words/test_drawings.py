"""Pictures that anybody may have made."""

import base64
import io
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import resvg_py
import torch
from PIL import Image

from frida_painter.errors import ImageError
from frida_painter_words import svg_process
from frida_painter_words.libraries import read_picture

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


def test_a_drawing_that_never_ends_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sooner = Path(svg_process.__file__).read_text("utf-8").replace("_BYTES = 10,", "_BYTES = 1,")
    (tmp_path / "sooner.py").write_text(sooner, "utf-8")
    monkeypatch.setattr(svg_process, "__file__", str(tmp_path / "sooner.py"))
    turbulent = (
        '<filter id="f" width="100%" height="100%"><feTurbulence baseFrequency="0.9" numOctaves="2000000000"/>'
        f'</filter><g filter="url(#f)">{SQUARE}</g>'
    )
    with pytest.raises(ImageError, match="it takes too long"):
        read_picture(svg(turbulent), "turbulent.svg")
