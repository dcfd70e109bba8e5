"""Pictures that anybody may have made."""

import io
import time
from collections.abc import Callable

import numpy as np
import pytest
import torch
from PIL import Image

from frida_painter.errors import ImageError
from frida_painter.words.libraries import read_picture

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
    [
        'viewBox="0 0 72 72"',
        'width="72" height="72"',
        'width="25.4mm" height="1in"',
        'width="100%" viewBox="0,0,72,72"',
    ],
)
def test_a_drawing_is_cut_to_what_is_drawn_whatever_its_size_is_given_in(attributes: str) -> None:
    drawing = read_picture(svg(attributes=attributes), "square.svg")
    assert drawing.shape[0] == 4 and drawing.shape[1] == pytest.approx(drawing.shape[2], abs=2)
    assert torch.allclose(drawing[:, 50, 50], torch.tensor([1.0, 0, 0, 1]), atol=1e-3)


def test_what_goes_beyond_the_page_is_drawn() -> None:
    wide = read_picture(svg('<rect x="-10" y="30" width="90" height="10"/>'), "beyond.svg")
    assert wide.shape[2] / wide.shape[1] == pytest.approx(9, rel=0.1)


def test_a_palette_has_no_colour_where_it_is_transparent() -> None:
    indexed = Image.fromarray(np.repeat(np.repeat([[0, 1]], 40, 0), 40, 1).astype(np.uint8), "P")
    indexed.putpalette([255, 0, 255, 0, 128, 0])
    drawing = read_picture(png(indexed, transparency=0), "leaf.png")
    assert drawing.shape[1:] == (40, 40) and float(drawing[3].min()) == 1
    assert torch.allclose(drawing[:3].mean((1, 2)), torch.tensor([0, 128 / 255, 0]), atol=1e-3)


def test_large_cut_outs_keep_their_colour_up_to_the_edge() -> None:
    pixels = np.zeros((1500, 1000, 4), np.uint8)
    pixels[300:1200, 300:700] = (255, 0, 0, 255)
    drawing = read_picture(png(Image.fromarray(pixels, "RGBA")), "large.png")
    assert max(drawing.shape[1:]) <= 512 and float(drawing[0][drawing[3] > 0.1].min()) > 0.98


def test_a_plain_ground_around_a_thing_is_taken_away() -> None:
    pixels = np.full((80, 80, 3), 250, np.uint8)
    pixels[20:60, 30:50] = (200, 30, 30)
    pixels[35:40, 38:42] = 250  # inside the thing: it stays
    drawing = read_picture(png(Image.fromarray(pixels)), "scanned.png")
    assert drawing.shape[1:] == (40, 20) and float(drawing[3].min()) == 1
    photo = np.random.default_rng(0).integers(0, 255, (80, 80, 3)).astype(np.uint8)
    assert float(read_picture(png(Image.fromarray(photo)), "photo.png")[3].min()) == 1, "no plain ground: all of it"


def test_nothing_is_read_from_elsewhere(tmp_path) -> None:
    secret = tmp_path / "secret.png"
    secret.write_bytes(png(Image.new("RGB", (40, 40), "blue")))
    for link in (str(secret), secret.as_uri(), "http://127.0.0.1:9/x.png", "data:image/svg+xml;base64,PHN2Zy8+"):
        inner = (
            f'{SQUARE}<image xlink:href="{link}" href="{link}" x="20" y="20" width="50" height="50"/><script>1</script>'
        )
        drawing = read_picture(svg(inner), "linked.svg")
        assert float(drawing[2].max()) < 0.1, link


def bomb(depth: int) -> str:
    levels = "".join(f'<g id="a{n}">' + f'<use xlink:href="#a{n - 1}"/>' * 10 + "</g>" for n in range(1, depth))
    return f'<defs><g id="a0">{SQUARE}</g>{levels}</defs><use xlink:href="#a{depth - 1}"/>'


ENTITIES = (
    b'<!DOCTYPE svg [<!ENTITY a "aaaaaaaaaa">'
    + b"".join(b'<!ENTITY %c "%b">' % (98 + n, b"&%c;" % (97 + n) * 10) for n in range(12))
    + b']><svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9"><text>&m;</text></svg>'
)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (lambda: svg(bomb(9)), "nodes limit"),
        (lambda: ENTITIES, "damaged SVG"),
        (lambda: svg('<g id="a"><use xlink:href="#b"/></g><g id="b"><use xlink:href="#a"/></g>'), "nodes limit"),
        (lambda: svg("<g>" * 5000 + "</g>" * 5000), "too deep|cannot be drawn|damaged"),
        (lambda: svg(attributes=""), "does not say how large"),
        (lambda: svg(attributes='width="1e400" height="nan"'), "does not say how large"),
        (lambda: svg(""), "shows nothing"),
        (lambda: b"<html></html>", "no SVG"),
        (lambda: svg()[:90], "damaged SVG"),
        (lambda: png(Image.new("RGBA", (40, 40), (1, 2, 3, 0))), "shows nothing"),
        (lambda: png(Image.new("RGB", (40, 40)))[:60], "damaged picture"),
        (lambda: png(Image.new("1", (12_000, 10_000))), "at most"),
        (lambda: b"", "damaged picture"),
        (lambda: b"no picture", "damaged picture"),
    ],
)
def test_what_is_no_picture_is_refused_soon(content: Callable[[], bytes], says: str) -> None:
    given, begun = content(), time.process_time()
    with pytest.raises(ImageError, match=says):
        read_picture(given, "given.svg")
    assert time.process_time() - begun < 5


def test_a_drawing_that_never_ends_is_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("frida_painter.words.libraries._PATIENCE", 1.0)
    turbulent = (
        '<filter id="f" width="100%" height="100%"><feTurbulence baseFrequency="0.9" numOctaves="2000000000"/>'
        f'</filter><g filter="url(#f)">{SQUARE}</g>'
    )
    with pytest.raises(ImageError, match="takes more than 1 s"):
        read_picture(svg(turbulent), "turbulent.svg")
