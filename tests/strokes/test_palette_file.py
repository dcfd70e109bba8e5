"""Palettes as painters have them. The Adobe file was written by the package swatch."""

import base64
import io
import json
import struct
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import assume, given
from hypothesis import strategies as st
from PIL import GimpPaletteFile, Image, ImageCms

from frida_painter.errors import ConfigError, FridaError, ImageError
from frida_painter.perception.color import read_palette
from frida_painter.runs.spec import RunSpec
from frida_painter.strokes.palette import Palette, to_hex
from frida_painter.strokes.palette_file import read_colors

PAINTS = ["#f2e9dc", "#b97f2c", "#3b2f2a", "#1d4e89"]
BARE = [text[1:] for text in PAINTS]
RGB = [tuple(int(text[at : at + 2], 16) for at in (0, 2, 4)) for text in BARE]
ASE = base64.b64decode(
    "QVNFRgABAAAAAAAGwAEAAAAMAAUAbQBpAG4AZQAAAAEAAAAgAAYAUABhAHAAZQByAABSR0IgP3Ly8z9p6eo/XNzdAAAAAQAAABoAAwDWAGwAAFJHQiA/"
    "Obm6Pv7+/z4wsLEAAMACAAAAAAABAAAAIAAGAFUAbQBiAGUAcgAAUkdCID5s7O0+PLy9PiioqQAAAAEAAAAeAAUAQgBsAHUAZQAAUkdCID3o6Ok+nJyd"
    "PwmJigAA"
)
GPL = "GIMP Palette\nName: mine\nColumns: 4\n#\n" + "\n".join(f"{r:3d} {g:3d} {b:3d}\tname 12 of it" for r, g, b in RGB)


@pytest.mark.parametrize(
    ("name", "content"),
    {
        "gpl": GPL,
        "gpl.of.windows.txt": GPL.replace("\n", "\r\n") + "\r\n",
        "gpl-channels.gpl": GPL.replace("Columns: 4", "Channels: RGBA").replace("\t", "\t255\t"),
        "ase": ASE,
        "hex": "\n".join(BARE) + "\n",
        "hex.txt": "\n".join(PAINTS),
        "upper.hex": "\r\n\r\n".join(BARE).upper(),
        "one-line.txt": ", ".join(PAINTS),
        "short.css": "\n".join(f"--paint-{at}: {text};" for at, text in enumerate(PAINTS)),
        "c.h": "\n".join(f"0x{text}," for text in BARE),
        "named.txt": "\n".join(f"{text} a facade in 1900" for text in BARE),
        "names-first.txt": "# my paints\n; and more\n" + "\n".join(f"paper white 3 {text}" for text in PAINTS),
        "ours.json": json.dumps({"paints": PAINTS}),
        "list.json": json.dumps(PAINTS),
        "lospec.json": json.dumps({"name": "x", "author": "", "colors": BARE}),
        "entries.json": json.dumps({"palette": {"colors": [{"name": "x", "hex": text} for text in PAINTS]}}),
        "named.json": json.dumps({f"paint {at}": text for at, text in enumerate(PAINTS)}),
        "utf-8-bom.hex": "\ufeff" + "\n".join(BARE),
        "utf-16.txt": "\n".join(PAINTS).encode("utf-16"),
        "latin-1.gpl": GPL.replace("name 12 of it", "Gr\u00fcn").encode("latin-1"),
    }.items(),
)  # fmt: skip
def test_a_palette_is_read_in_whatever_form_it_is(name: str, content: str | bytes, tmp_path: Path) -> None:
    path = tmp_path / (name if "." in name else f"palette.{name}")
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    assert [to_hex(color) for color in read_palette(path, None).color] == PAINTS
    assert RunSpec.of(palette=path).colors == 4


@given(st.lists(st.tuples(*[st.integers(0, 255)] * 3), min_size=1, max_size=64))
def test_palettes_of_gimp_are_read_as_pillow_reads_them(tmp_path_factory: pytest.TempPathFactory, colors) -> None:
    text = "GIMP Palette\n#\n" + "".join(f"{r} {g}\t{b} x\n" for r, g, b in colors)
    path = tmp_path_factory.getbasetemp() / "pillow.gpl"
    path.write_text(text)
    known = GimpPaletteFile.GimpPaletteFile(io.BytesIO(text.encode())).palette[: 3 * len(colors)]
    assert [round(255 * band) for color in read_colors(path) for band in color] == list(known)


@given(st.tuples(st.integers(13, 242).map(lambda code: code / 2.55), st.integers(-60, 60), st.integers(-60, 60)))
def test_lab_of_adobe_is_what_little_cms_makes_of_it(tmp_path_factory: pytest.TempPathFactory, lab) -> None:
    place = tmp_path_factory.getbasetemp()
    name = struct.pack(">H2s", 1, b"\0\0")
    block = name + b"LAB " + struct.pack(">3fH", lab[0] / 100, lab[1], lab[2], 0)
    (place / "lab.ase").write_bytes(b"ASEF\0\1\0\0" + struct.pack(">IHI", 1, 1, len(block)) + block)
    profile = ImageCms.createProfile("LAB")
    rounded = np.array([round(lab[0] * 2.55), round(lab[1]) + 128, round(lab[2]) + 128], np.uint8)
    coded = Image.frombytes("LAB", (1, 1), bytes(rounded ^ np.array([0, 128, 128], np.uint8)))
    exactly = ImageCms.Flags.NOOPTIMIZE  # else it interpolates in a coarse table
    made = ImageCms.profileToProfile(coded, profile, ImageCms.createProfile("sRGB"), outputMode="RGB", flags=exactly)
    wanted = np.array(made.getpixel((0, 0))) / 255
    assume(wanted.min() > 0.02 and wanted.max() < 0.98)  # outside of sRGB each clips in its own way
    (found,) = read_colors(place / "lab.ase")
    assert np.abs(np.array(found) - wanted).max() < 0.006, lab


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("a.txt", "stroks = 300", "line 1: 'stroks = 300' is not a colour"),
        ("a.txt", "#f2e9dc\n#b97f2\n#12345g", "line 2: '#b97f2' is not a colour; write it like #b97f2c. line 3"),
        ("a.txt", "f2e9dc80", "'f2e9dc80' is not a colour"),
        ("a.txt", "#f2e9dc80", "'#f2e9dc80' is not opaque"),
        ("a.txt", "facade decade 12", "is not a colour"),
        ("a.txt", "1 2 250", "line 1: '1 2 250' is not a colour"),
        ("a.json", '{"colors": [[1, 2, 3]]}', "paint 1: '[1, 2, 3]' is not a colour"),
        ("a.txt", "", "has 0 paints; a palette has 1 to 64"),
        ("a.gpl", "GIMP Palette\nName: x\n1 2 300 x\n", "line 3: '1 2 300 x' is not a colour"),
        ("a.gpl", "GIMP Palette\n" + "1 2 3\n" * 65, "has 65 paints; a palette has 1 to 64"),
        ("a.json", '{"colors": ["#111111"], "swatches": ["#222222"]}', "is not a palette"),
        ("a.json", '{"x": 5}', "a.json is not a palette; a palette is"),
        ("a.json", "[" * 100_000, "is not JSON"),
        ("a.json", '{"colors": [{"name": "x"}]}', "paint 1: 'None' is not a colour"),
        ("a.ase", ASE[:70], "is damaged or cut off"),
        ("a.ase", bytes.fromhex(
            "41534546000100000000000100010000001c0002004c0000434d594b3f0000003e4ccccd000000003dcccccd0000"
        ), "has paint 1 in CMYK, which is no colour without its printer's profile; save the swatches as RGB or Lab"),
    ],
)  # fmt: skip
def test_what_is_no_palette_says_what_one_is(name: str, content: str | bytes, says: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(ConfigError) as refused:
        Palette.load(tmp_path / name)
    told = str(refused.value)
    assert says in told and name in told
    assert "a palette is a JSON file like" in told or "1 to 64" in told or "undamaged copy" in told


@given(st.binary(max_size=200), st.sampled_from([b"", b"ASEF", b"PK\3\4", b"[", b"GIMP Palette\n"]))
def test_any_file_is_a_palette_or_refused(
    tmp_path_factory: pytest.TempPathFactory, content: bytes, start: bytes
) -> None:
    path = tmp_path_factory.getbasetemp() / "anything.pal"
    path.write_bytes(start + content)
    try:
        assert 1 <= len(read_palette(path, None)) <= 64
    except FridaError as refused:
        assert str(refused).endswith(".")


@given(st.integers(0, 2**31), st.sampled_from([ASE, GPL.encode()]))
def test_a_damaged_palette_is_read_or_refused(
    tmp_path_factory: pytest.TempPathFactory, seed: int, whole: bytes
) -> None:
    chance = np.random.default_rng(seed)
    damaged = bytearray(whole)
    for at in chance.integers(0, len(whole), 3):
        damaged[at] = chance.integers(256)
    path = tmp_path_factory.getbasetemp() / "damaged.pal"
    path.write_bytes(bytes(damaged))
    try:
        colors = torch.tensor(read_colors(path))
    except ConfigError as refused:
        assert str(refused).endswith(".")
    else:
        assert colors.numel() == 0 or bool(((colors >= 0) & (colors <= 1)).all())


def strip(colors: list[tuple[int, int, int]], side: int, *, upright: bool = False) -> Image.Image:
    fields = np.array(colors, np.uint8)[None].repeat(side, 0).repeat(side, 1)
    return Image.fromarray(fields.swapaxes(0, 1) if upright else fields)


@pytest.mark.parametrize("side", [1, 3, 40, 900])
@pytest.mark.parametrize("upright", [False, True])
@pytest.mark.parametrize("kind", ["png", "gif", "bmp"])
def test_a_picture_of_few_colours_shows_them_in_the_order_of_reading(
    tmp_path: Path, side: int, upright: bool, kind: str
) -> None:
    path = tmp_path / f"palette.{kind}"
    strip(RGB, side, upright=upright).save(path)
    assert [to_hex(color) for color in read_palette(path, None).color] == PAINTS
    assert RunSpec.of(palette=path).colors == 4 and len(read_palette(path, 4)) == 4
    with pytest.raises(ConfigError, match="has 4 paints, and 7 are wanted"):
        read_palette(path, 7)


def test_a_photograph_says_nothing_of_how_many_swatches_it_shows(tmp_path: Path) -> None:
    noise = np.random.default_rng(0).integers(0, 12, (60, 300, 3))
    fields = np.asarray(strip([(235, 235, 235), *RGB], 60), int) - noise
    Image.fromarray(fields.clip(0).astype(np.uint8)).save(tmp_path / "strip.png")
    with pytest.raises(ConfigError, match="say it with --colors"):
        RunSpec.of(palette=tmp_path / "strip.png")
    assert len(read_palette(tmp_path / "strip.png", 4)) == 4
    for content in (b"\x89PNG\r\n\x1a\n\0\0\0\0", bytes(range(256))):
        (tmp_path / "odd.png").write_bytes(content)
        with pytest.raises(ImageError, match="a palette is a JSON file"):
            read_palette(tmp_path / "odd.png", 4)
