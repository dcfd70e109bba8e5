"""Pictures over depth, colour, transparency, profile, page and orientation, written here from their specifications.

What should be seen is computed from the array that was written by formulas of this file's own: the curve of
sRGB, matrices of primaries, the weight of alpha over white. Other libraries read the file back, so that it is known to
be what the test believes.
"""

import io
import struct
import subprocess
import sys
import zlib
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import pyvips
from PIL import Image

from frida_painter.errors import ImageError
from frida_painter.system import picture_file

ROWS, COLUMNS = 24, 32
HEIC = Path(__file__).parents[1] / "heic"
Floats = np.ndarray

down, right = np.mgrid[0:ROWS, 0:COLUMNS]
SCENE = np.stack((right / (COLUMNS - 1), down / (ROWS - 1), 1 - (right + down) / (ROWS + COLUMNS - 2)), -1)
GREY = SCENE[..., :1]
OPACITY = (np.clip(down, 4, ROWS - 4) - 4)[..., None] / (ROWS - 8)  # nothing above, all below

# The other side: what the numbers mean


def light(values: Floats) -> Floats:
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def seen(linear: Floats) -> Floats:
    linear = np.clip(linear, 0, 1)
    return np.where(linear <= 0.0031308, linear * 12.92, 1.055 * linear ** (1 / 2.4) - 0.055)


# IEC 61966-2-1 and SMPTE EG 432-1: linear RGB to XYZ for D65, as printed there
SRGB_XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
P3_XYZ = np.array([[0.48657, 0.26567, 0.19822], [0.22897, 0.69174, 0.07929], [0.0, 0.04511, 1.04394]])
P3_IN_SRGB = np.linalg.inv(SRGB_XYZ) @ P3_XYZ
P3_POINTS = (0.3127, 0.3290, 0.680, 0.320, 0.265, 0.690, 0.150, 0.060)


def of_p3(values: Floats, exponent: float | None = None) -> Floats:
    return seen((light(values) if exponent is None else values**exponent) @ P3_IN_SRGB.T)


def on_white(values: Floats, opacity: Floats) -> Floats:
    return values * opacity + 1 - opacity


def numbers(values: Floats, bits: int) -> np.ndarray:
    return np.round(values * (2**bits - 1)).astype(np.uint8 if bits <= 8 else np.uint16 if bits <= 16 else np.uint32)


def rounded(values: Floats, bits: int) -> Floats:
    return numbers(values, bits) / (2.0**bits - 1)


def profile(space: bytes, curve: float, matrix: np.ndarray | None = None, name: str = "sRGB IEC61966-2.1") -> bytes:
    """An ICC profile, version 2, with a power law; its name says nothing true. ICC.1:2001-04, 6."""

    def point(*values: float) -> bytes:
        return b"XYZ \0\0\0\0" + b"".join(struct.pack(">i", round(value * 65536)) for value in values)

    text = name.encode() + b"\0"
    described = b"desc\0\0\0\0" + struct.pack(">I", len(text)) + text + b"\0" * 78
    tone = b"curv\0\0\0\0" + struct.pack(">IH", 1, round(curve * 256))
    tags = {b"desc": described, b"cprt": b"text\0\0\0\0none\0", b"wtpt": point(0.9642, 1.0, 0.8249)}
    if matrix is None:
        tags[b"kTRC"] = tone
    else:  # adapted to D50 by the matrix that sRGB's own profiles state (chad)
        adapted = np.array([[1.0479, 0.0229, -0.0502], [0.0296, 0.9904, -0.0171], [-0.0092, 0.0151, 0.7519]]) @ matrix
        tags |= {name: point(*adapted[:, at]) for at, name in enumerate((b"rXYZ", b"gXYZ", b"bXYZ"))}
        tags |= dict.fromkeys((b"rTRC", b"gTRC", b"bTRC"), tone)
    table, content, at = struct.pack(">I", len(tags)), b"", 128 + 4 + 12 * len(tags)
    for tag, value in tags.items():
        value += b"\0" * (-len(value) % 4)
        table += tag + struct.pack(">II", at + len(content), len(value))
        content += value
    head = struct.pack(">I4sI4s4s4s", at + len(content), b"none", 0x02100000, b"mntr", space, b"XYZ ")
    head += struct.pack(">6H4s", 2020, 1, 1, 0, 0, 0, b"acsp") + b"\0" * 28
    return (head + struct.pack(">3i", 63190, 65536, 54061)).ljust(128, b"\0") + table + content


# Writers


def png(stored: np.ndarray, bits: int, kind: int, *chunks: tuple[bytes, bytes]) -> bytes:
    """A PNG of numbers [H, W, channels] of so many bits and a colour type; PNG, third edition, 5 and 7.2."""

    def chunk(name: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))

    rows, columns, channels = stored.shape
    if bits == 16:
        lines = stored.astype(">u2").reshape(rows, -1).view(np.uint8)
    elif bits == 8:
        lines = stored.astype(np.uint8).reshape(rows, -1)
    else:
        single = np.unpackbits(stored.astype(np.uint8).reshape(rows, columns * channels, 1), axis=2)[..., 8 - bits :]
        lines = np.packbits(single.reshape(rows, -1), axis=1)
    head = struct.pack(">IIBBBBB", columns, rows, bits, kind, 0, 0, 0)
    content = zlib.compress(b"".join(b"\0" + line.tobytes() for line in lines))
    extra = b"".join(chunk(*one) for one in chunks)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + extra + chunk(b"IDAT", content) + chunk(b"IEND", b"")


Tag = int | bytes | tuple[int, ...]
Page = tuple[np.ndarray, int, dict[int, Tag]]  # numbers [H, W, channels], photometric interpretation, further tags


def tiff(*pages: Page, inside: tuple[Page, ...] = ()) -> bytes:
    """A TIFF of these pages, the first with SubIFDs `inside`; TIFF 6.0, section 2, and its supplement 1.

    A tag is a short, several, fractions (the chromaticities), places (of SubIFDs) or bytes; 284: 2 stores planes.
    """
    content = bytearray(b"II*\0" + bytes(4))

    def place(data: bytes) -> int:
        at = len(content)
        content.extend(data + b"\0" * (len(data) % 2))
        return at

    def write(stored: np.ndarray, photometric: int, tags: dict[int, Tag], link: int) -> int:
        """Writes a page, its place to `link`, and returns where the place of the next one stands."""
        rows, columns, channels = stored.shape
        strips = [stored[..., at] for at in range(channels)] if tags.get(284) == 2 else [stored]
        bits = 1 if stored.dtype == bool else 8 * stored.itemsize
        data = [np.packbits(strip, 1).tobytes() if bits == 1 else strip.tobytes() for strip in strips]
        sizes, places = tuple(map(len, data)), tuple(map(place, data))
        sample = {"b": 1, "u": 1, "i": 2, "f": 3}[stored.dtype.kind]
        told: dict[int, Tag] = {256: columns, 257: rows, 258: (bits,) * channels, 259: 1, 262: photometric}
        told |= {273: places, 277: channels, 278: rows, 279: sizes, 339: (sample,) * channels} | tags
        entries = b""
        for number, value in sorted(told.items()):
            if isinstance(value, int):
                entries += struct.pack("<HHIHH", number, 3, 1, value, 0)
                continue
            kind = 7 if isinstance(value, bytes) else {273: 4, 279: 4, 318: 5, 319: 5, 330: 4}.get(number, 3)
            packed = value if kind == 7 else struct.pack(f"<{len(value)}{'H' if kind == 3 else 'I'}", *value)
            field = packed.ljust(4, b"\0") if len(packed) <= 4 else struct.pack("<I", place(packed))
            entries += struct.pack("<HHI", number, kind, len(value) // (2 if kind == 5 else 1)) + field
        at = place(struct.pack("<H", len(told)) + entries + bytes(4))
        content[link : link + 4] = struct.pack("<I", at)
        return at + 2 + len(entries)

    link, links = 4, tuple(place(bytes(4)) for _ in inside)
    for page, at in zip(inside, links, strict=True):
        write(*page, at)
    for number, (stored, photometric, tags) in enumerate(pages):
        of_first: dict[int, Tag] = {}
        if inside and number == 0:
            of_first = {330: tuple(int.from_bytes(content[at : at + 4], "little") for at in links)}
        link = write(stored, photometric, tags | of_first, link)
    return bytes(content)


def vips(stored: np.ndarray, **options: object) -> bytes:
    return bytes(pyvips.Image.new_from_array(stored, interpretation="auto").tiffsave_buffer(**options))


def pillow(stored: np.ndarray, kind: str, **options: object) -> bytes:
    content = io.BytesIO()
    Image.fromarray(stored).save(content, format=kind, **options)
    return content.getvalue()


# name: the file, what should be seen, how far from it
Case = tuple[bytes, Floats, float]
EXACT, LOSSY = 1.01 / 255, 5 / 255


def pngs() -> dict[str, Case]:
    cases: dict[str, Case] = {}
    for bits in (1, 2, 4, 8, 16):
        grey, most = numbers(GREY, bits), 2**bits - 1
        cases[f"grey {bits}"] = (png(grey, bits, 0), grey / most, EXACT)
        key = int(grey[5, 9, 0])
        hole = (png(grey, bits, 0, (b"tRNS", struct.pack(">H", key))), np.where(grey == key, 1, grey / most), EXACT)
        cases[f"grey {bits} with a hole"] = hole
    table = np.random.default_rng(3).integers(0, 256, (256, 3), np.uint8)
    weights = np.linspace(0, 255, 256).astype(np.uint8)
    for bits in (1, 2, 4, 8):
        places, count = numbers(GREY, bits), 2**bits
        palette = (b"PLTE", table[:count].tobytes())
        colors = table[places[..., 0]] / 255
        cases[f"palette {bits}"] = (png(places, bits, 3, palette), colors, EXACT)
        some = weights[:count] if bits == 8 else np.linspace(0, 255, count).astype(np.uint8)
        veiled = on_white(colors, some[places] / 255)
        cases[f"palette {bits} with opacity"] = (
            png(places, bits, 3, palette, (b"tRNS", some.tobytes())),
            veiled,
            EXACT,
        )
    for bits in (8, 16):
        most = 2**bits - 1
        color, opacity = numbers(SCENE, bits), numbers(OPACITY, bits)
        share = opacity / most
        key = color[5, 9]
        hole = np.where((color == key).all(-1, keepdims=True), 1, color / most)
        cases[f"rgb {bits}"] = (png(color, bits, 2), color / most, EXACT)
        cases[f"rgb {bits} with a hole"] = (png(color, bits, 2, (b"tRNS", struct.pack(">3H", *key))), hole, EXACT)
        both = np.concatenate((color, opacity), 2)
        cases[f"rgb {bits} with opacity"] = (png(both, bits, 6), on_white(color / most, share), EXACT)
        both = np.concatenate((numbers(GREY, bits), opacity), 2)
        cases[f"grey {bits} with opacity"] = (png(both, bits, 4), on_white(rounded(GREY, bits), share), EXACT)
    return cases


def colored() -> dict[str, Case]:
    """PNG, whose chunks say what the numbers mean."""
    color, deep = numbers(SCENE, 8), numbers(SCENE, 16)
    exact, fine = color / 255, deep / 65535

    def gamma(value: float) -> tuple[bytes, bytes]:
        return b"gAMA", struct.pack(">I", round(value * 1e5))

    def embedded(content: bytes) -> tuple[bytes, bytes]:
        return b"iCCP", b"any name\0\0" + zlib.compress(content)

    points = (b"cHRM", struct.pack(">8I", *(round(value * 1e5) for value in P3_POINTS)))
    linear, p3 = profile(b"RGB ", 1.0, SRGB_XYZ), profile(b"RGB ", 2.2, P3_XYZ)
    soft = numbers(SCENE * 0.2 + 0.5, 16)  # inside of sRGB, too
    near = 2.5 / 255  # the curve of 2.2 against that of sRGB in the dark, eight bits inside a profile
    return {
        "gamma 1": (png(color, 8, 2, gamma(1)), seen(exact), EXACT),
        "gamma 1, 16 bits": (png(deep, 16, 2, gamma(1)), seen(fine), 0.001),
        "gamma 1, grey": (png(numbers(GREY, 16), 16, 0, gamma(1)), seen(rounded(GREY, 16)), 0.001),
        "gamma 1/1.8": (png(color, 8, 2, gamma(1 / 1.8)), seen(exact**1.8), EXACT),
        "gamma of sRGB": (png(color, 8, 2, gamma(0.45455)), exact, EXACT),
        "sRGB before gamma": (png(color, 8, 2, (b"sRGB", b"\0"), gamma(1)), exact, EXACT),
        "primaries of P3": (png(color, 8, 2, points), of_p3(exact), near),
        "gamma and primaries": (png(deep, 16, 2, gamma(1), points), of_p3(fine, 1), 0.003),
        "code points of P3": (png(color, 8, 2, (b"cICP", bytes((12, 13, 0, 1)))), of_p3(exact), near),
        "code points before gamma": (png(color, 8, 2, gamma(1), (b"cICP", bytes((1, 13, 0, 1)))), exact, EXACT),
        "linear profile": (png(color, 8, 2, embedded(linear)), seen(exact), near),
        "linear profile, 16 bits": (png(deep, 16, 2, embedded(linear)), seen(fine), 0.004),
        "profile before gamma": (png(color, 8, 2, gamma(2), embedded(linear)), seen(exact), near),
        "profile of P3": (png(soft, 16, 2, embedded(p3)), of_p3(soft / 65535, 2.2), 0.006),
        "grey profile": (png(numbers(GREY, 8), 8, 0, embedded(profile(b"GRAY", 1.0))), seen(rounded(GREY, 8)), near),
        "profile of grey on colour": (png(color, 8, 2, embedded(profile(b"GRAY", 1.0))), exact, EXACT),
        "damaged profile": (png(color, 8, 2, embedded(linear[:200])), exact, EXACT),
        "profile and opacity": (
            png(np.concatenate((deep, numbers(OPACITY, 16)), 2), 16, 6, embedded(linear)),
            on_white(seen(fine), rounded(OPACITY, 16)), 0.004,
        ),
    }  # fmt: skip


GREY_KIND, WHITE_IS_ZERO, RGB, PALETTE, MASK, CMYK, LAB = 1, 0, 2, 3, 4, 5, 8  # photometric interpretations


def tiffs() -> dict[str, Case]:
    cases: dict[str, Case] = {}
    for bits in (8, 16):
        color, grey, opacity = (numbers(values, bits) for values in (SCENE, GREY, OPACITY))
        most = 2.0**bits - 1
        exact, plain, share = color / most, grey / most, opacity / most
        both, greys = np.concatenate((color, opacity), 2), np.concatenate((grey, opacity), 2)
        held = np.concatenate((numbers(exact * share, bits), opacity), 2)
        ink = np.concatenate((color, numbers(GREY / 2, bits)), 2)
        cases |= {
            f"grey {bits}": (tiff((grey, GREY_KIND, {})), plain, EXACT),
            f"white is zero {bits}": (tiff((grey, WHITE_IS_ZERO, {})), 1 - plain, EXACT),
            f"rgb {bits}": (tiff((color, RGB, {})), exact, EXACT),
            f"rgb {bits} in planes": (tiff((color, RGB, {284: 2})), exact, EXACT),
            f"rgb {bits} in tiles": (vips(color, tile=True, tile_width=16, tile_height=16), exact, EXACT),
            f"rgb {bits} predicted": (vips(color, compression="deflate", predictor="horizontal"), exact, EXACT),
            f"rgb {bits} big": (vips(color, bigtiff=True), exact, EXACT),
            f"rgba {bits}": (tiff((both, RGB, {338: 2})), on_white(exact, share), EXACT),
            f"rgbx {bits}": (tiff((both, RGB, {338: 0})), exact, EXACT),
            f"rgba {bits} premultiplied": (tiff((held, RGB, {338: 1})), held[..., :3] / most + 1 - share, 2 * EXACT),
            f"grey {bits} with opacity": (tiff((greys, GREY_KIND, {338: 2})), on_white(plain, share), EXACT),
            f"grey {bits} and another": (tiff((both, GREY_KIND, {338: (0, 0, 0)})), exact[..., :1], EXACT),
            f"cmyk {bits}": (tiff((ink, CMYK, {})), (1 - exact) * (1 - ink[..., 3:] / most), EXACT),
        }  # fmt: skip
    table = np.random.default_rng(4).integers(0, 256, (3, 256)) * 257
    places, black = numbers(GREY, 8), GREY > 0.5
    colors = table.T[places[..., 0]] / 65535
    cases["palette"] = (tiff((places, PALETTE, {320: tuple(table.ravel().tolist())})), colors, EXACT)
    cases["two tones"] = (tiff((black, GREY_KIND, {})), black * 1.0, EXACT)
    cases["two tones, white is zero"] = (tiff((black, WHITE_IS_ZERO, {})), 1.0 - black, EXACT)
    deep, soft = numbers(SCENE, 16), numbers(SCENE * 0.2 + 0.5, 16)
    told = [part for value in P3_POINTS for part in (round(value * 1e4), 10000)]
    primaries: dict[int, Tag] = {318: tuple(told[:4]), 319: tuple(told[4:])}
    cases["primaries of P3"] = (tiff((soft, RGB, primaries)), of_p3(soft / 65535), 0.004)
    cases["profile"] = (tiff((deep, RGB, {34675: profile(b"RGB ", 1.0, SRGB_XYZ)})), seen(deep / 65535), 0.004)
    return cases


def paged() -> dict[str, Case]:
    """TIFF of several pages and SubIFDs, and turned ones."""
    color = numbers(SCENE, 8)
    full, small, other = (color, RGB), (255 - color[::2, ::2], RGB), (255 - color, RGB)
    mask, thumbnail = (color[..., :1] > 99, MASK, {254: 4}), {254: 1}
    turned = {
        1: color, 2: color[:, ::-1], 3: color[::-1, ::-1], 4: color[::-1],
        5: color.transpose(1, 0, 2), 6: np.rot90(color, 1), 7: color.transpose(1, 0, 2)[::-1, ::-1],
        8: np.rot90(color, -1),
    }  # fmt: skip
    files = {f"orientation {number}": tiff((stored, RGB, {274: number})) for number, stored in turned.items()}
    files |= {
        "thumbnail first": tiff((*small, thumbnail), (*full, {})),
        "thumbnail last": tiff((*full, {}), (*small, thumbnail)),
        "mask first": tiff(mask, (*full, {})),
        "two pages": tiff((*full, {}), (*other, {})),
        "nothing but a thumbnail": tiff((*full, thumbnail)),
        "thumbnail with the picture inside": tiff((*small, thumbnail), inside=(mask, (*full, {}))),
        "unmarked thumbnail with the picture inside": tiff((*small, {}), inside=((*full, {}),)),
        "thumbnail inside the picture": tiff((*full, {}), (*other, {}), inside=((*small, thumbnail),)),
        "thumbnail of the same size first": tiff((*other, thumbnail), inside=((*full, {}), (*small, {}))),
    }
    return {name: (content, color / 255, EXACT) for name, content in files.items()}


def others() -> dict[str, Case]:
    color, opacity = numbers(SCENE, 8), numbers(OPACITY, 8)
    both, exact = np.concatenate((color, opacity), 2), color / 255
    veiled = on_white(exact, opacity / 255)
    linear = profile(b"RGB ", 1.0, SRGB_XYZ)
    note = Image.Exif()
    note[0x0112] = 6
    quarter = np.ascontiguousarray(np.rot90(color, 1))
    smooth = {"quality": 100, "subsampling": 0}
    full = {"quality": 100, "subsampling": "4:4:4"}
    adobe = Image.fromarray(np.concatenate((color, numbers(GREY / 2, 8)), 2), "CMYK")
    ink = io.BytesIO()
    adobe.save(ink, format="JPEG", quality=100)
    printed = (1 - exact) * (1 - rounded(GREY / 2, 8))
    return {
        "JPEG": (pillow(color, "JPEG", **smooth), exact, LOSSY),
        "JPEG grey": (pillow(color[..., 0], "JPEG", quality=100), exact[..., :1], LOSSY),
        "JPEG progressive, turned": (pillow(quarter, "JPEG", exif=note, progressive=True, **smooth), exact, LOSSY),
        "JPEG CMYK": (ink.getvalue(), printed, LOSSY),
        "JPEG with profile": (pillow(color // 2 + 100, "JPEG", icc_profile=linear, **smooth),
                              seen((color // 2 + 100) / 255), LOSSY),
        "WebP": (pillow(color, "WEBP", lossless=True), exact, EXACT),
        "WebP with opacity": (pillow(both, "WEBP", lossless=True, exact=True), veiled, EXACT),
        "WebP with profile, turned": (pillow(quarter, "WEBP", lossless=True, icc_profile=linear, exif=note),
                                      seen(exact), LOSSY),
        "BMP": (pillow(color, "BMP"), exact, EXACT),
        "BMP grey": (pillow(color[..., 0], "BMP"), exact[..., :1], EXACT),
        "GIF grey": (pillow(color[..., 0], "GIF"), exact[..., :1], EXACT),
        "AVIF": (pillow(color, "AVIF", **full), exact, LOSSY),
        "AVIF with opacity": (pillow(both, "AVIF", **full), veiled, LOSSY),
        "AVIF turned": (pillow(quarter, "AVIF", exif=note, **full), exact, LOSSY),
        "AVIF with profile": (pillow(color // 2 + 100, "AVIF", icc_profile=linear, **full),
                              seen((color // 2 + 100) / 255), LOSSY),
    }  # fmt: skip


CORPUS = {
    f"{family.__name__}: {name}": case
    for family in (pngs, colored, tiffs, paged, others)
    for name, case in family().items()
}


def decoded(content: bytes, path: Path, **options: int) -> Floats:
    path.write_bytes(content)
    pixels = picture_file.decode(path, **options)
    return pixels / 255.0 if pixels.dtype == np.uint8 else pixels.astype(float)


@pytest.mark.parametrize("name", CORPUS)
def test_what_a_file_says_of_itself_is_seen(tmp_path: Path, name: str, capfd: pytest.CaptureFixture[str]) -> None:
    content, right, allowed = CORPUS[name]
    pixels = decoded(content, tmp_path / "picture.jpg")
    assert pixels.shape == (ROWS, COLUMNS, 3)
    assert np.abs(pixels - right).max() <= allowed
    assert capfd.readouterr() == ("", "")
    layered = picture_file.decode_with_opacity(content, "picture.jpg", longest=picture_file.LONGEST)
    layered = layered / 255.0 if layered.dtype == np.uint8 else layered.astype(float)
    assert np.abs(on_white(layered[..., :3], layered[..., 3:]) - pixels).max() < 1.6 / 255
    if "opacity" in name:
        assert layered[..., 3].min() < 0.5
    small = decoded(content, tmp_path / "picture.jpg", longest=16)
    assert small.shape == (12, 16, 3)
    assert np.abs(small.mean((0, 1)) - np.broadcast_to(right, pixels.shape).mean((0, 1))).max() < 0.05
    assert capfd.readouterr() == ("", "")


OPENCV_CANNOT = {"planes", "tiles", "cmyk"}


@pytest.mark.parametrize(
    "name", [name for name in CORPUS if name.startswith(("tiffs", "pngs")) and not OPENCV_CANNOT & set(name.split())]
)
def test_the_files_are_what_this_test_believes(name: str) -> None:
    """OpenCV reads the numbers back that the formulas begin with, if it adds no meaning of its own."""
    content, right, _ = CORPUS[name]
    stored = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    if stored.shape == right.shape and stored.shape[2] == 3 and not {"hole", "profile", "P3"} & set(name.split()):
        assert np.abs(stored[..., ::-1] / np.iinfo(stored.dtype).max - right).max() < EXACT
    assert stored.shape[:2] == (ROWS, COLUMNS)


# HEIC, of which there is no encoder here


def heic_scene() -> Floats:
    rows, columns = np.mgrid[0:48, 0:64]
    return np.stack((columns * 4, rows * 5, 255 - columns * 2 - rows), -1) / 255


@pytest.mark.parametrize(
    ("name", "right"),
    [
        ("plain", lambda scene: scene),
        ("ten", lambda scene: scene),
        ("grey", lambda scene: scene[..., :1]),
        ("alpha", lambda scene: on_white(scene, scene[..., :1])),
        ("p3nclx", of_p3),
        ("swapped", lambda scene: scene),
        ("turned", lambda scene: np.rot90(scene, 1)),
        ("large", lambda scene: scene.repeat(16, 0).repeat(16, 1)),
    ],
)
def test_a_photograph_of_a_telephone_is_read(name: str, right: Callable[[Floats], Floats]) -> None:
    pixels = picture_file.decode(HEIC / f"{name}.heic")
    scaled = pixels / 255.0 if pixels.dtype == np.uint8 else pixels
    expected = np.broadcast_to(right(heic_scene()), scaled.shape)
    assert (pixels.dtype == np.uint8) == (name != "ten")
    off = np.abs(scaled - expected)
    assert off.mean() < 0.006
    assert off.max() < 0.04, "no pixel is another's, which the mean does not tell"


def test_a_telephone_says_when_it_took_a_photograph() -> None:
    said = picture_file.exposure_time(HEIC / "turned.heic")
    assert said is not None and 1577836800 < said < 1578100000
    assert picture_file.exposure_time(HEIC / "plain.heic") is None


# What is refused, by its name


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"8BPS\0\1", "a PSD"),
        (b"v/1\x01", "OpenEXR"),
        (b"#?RADIANCE\n", "Radiance"),
        (b"\0\0\0\x0cjP  \r\n\x87\n", "JPEG 2000"),
        (b"\xff\x0a", "JPEG XL"),
        (b"P6 32 24 255\n", "a PPM, PGM"),
        (b"\0\0\x01\0\x01\0", "an ICO"),
        (b"\0\0\0\x18ftypisom\0\0\0\0", "a film"),
        (b"\0\0\0\x18ftypcrx \0\0\0\0", "raw photograph"),
        (b"\0\0\0\x18ftypavif\0\0\0\0", "a damaged AVIF picture"),
        (b"\0\0\0\x18ftypheic\0\0\0\0", "a damaged HEIC picture"),
        (b"\0\0\0\x1cftypmif1\0\0\0\0mif1avif", "a damaged AVIF picture"),
        (b"RIFF\0\0\0\0WAVE", "a sound"),
        (tiff((SCENE, RGB, {})), r"TIFF of a kind that cannot be read \(64-bit float RGB\)"),
        (tiff((SCENE.astype(np.float32), RGB, {})), "32-bit float RGB"),
        (tiff((numbers(GREY, 8).astype(np.int16), GREY_KIND, {})), "16-bit signed BlackIsZero"),
        (tiff((numbers(SCENE, 32), RGB, {})), "32-bit unsigned RGB"),
        (tiff((numbers(SCENE, 8), RGB, {258: (5, 6, 5)})), "5/6-bit"),
        (tiff((numbers(SCENE, 8), LAB, {})), "CieLAB"),
        (tiff((numbers(SCENE, 8), RGB, {254: 1}), inside=((numbers(GREY, 16), 32803, {}),)), "unsigned CFA"),
        (b"MM\0+\0\x08\0\0", "BigTIFF"),
        (png(numbers(SCENE, 8), 8, 2, (b"cICP", bytes((9, 16, 0, 1)))), r"high dynamic range \(PQ\)"),
        ((HEIC / "pq.heic").read_bytes(), "high dynamic range"),
        ((HEIC / "plain.heic").read_bytes()[:600], "damaged HEIC"),
    ],
)
def test_what_cannot_be_obeyed_is_refused_by_its_name(
    tmp_path: Path, content: bytes, says: str, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "photo.jpg").write_bytes(content)
    with pytest.raises(ImageError, match=says) as refusal:
        picture_file.decode(tmp_path / "photo.jpg")
    assert "\n" not in str(refusal.value) and str(refusal.value).endswith(".")
    assert capfd.readouterr() == ("", "")


_READ_ALL = """
import sys
from pathlib import Path
from frida_painter.system import picture_file
from frida_painter.errors import ImageError
read = refused = 0
for path in sorted(Path(sys.argv[1]).iterdir()):
    try:
        pixels = picture_file.decode(path, most_pixels=1_000_000)
        assert pixels.shape[2] == 3 and pixels.min() >= 0 and pixels.max() <= 255, path
        read += 1
    except ImageError as refusal:
        assert len(str(refusal).splitlines()) == 1, refusal
        refused += 1
print(read, refused)
"""


def test_a_thousand_damaged_pictures_give_a_picture_or_a_sentence(tmp_path: Path) -> None:
    """In a process of its own, so that a crash is seen; nothing is said to the standard error. Fault F24."""
    contents = [case[0] for case in CORPUS.values()] + [path.read_bytes() for path in sorted(HEIC.glob("*.heic"))]
    chance = np.random.default_rng(31)
    for number in range(1200):
        damaged = np.frombuffer(contents[number % len(contents)], np.uint8).copy()
        # Most of what can go wrong stands at the beginning and, in a TIFF, at the end.
        near = chance.exponential(60, chance.integers(1, 7)).astype(int) % len(damaged)
        at = near if chance.random() < 0.7 else -1 - near
        damaged[at] = chance.integers(0, 256, len(at))
        kept = len(damaged) if chance.random() < 0.6 else chance.integers(1, len(damaged))
        (tmp_path / f"{number:04}.jpg").write_bytes(damaged[:kept].tobytes())
    done = subprocess.run([sys.executable, "-c", _READ_ALL, str(tmp_path)], capture_output=True, text=True, timeout=250)
    assert (done.returncode, done.stderr) == (0, "")
    read, refused = map(int, done.stdout.split())
    assert read + refused == 1200 and read > 100 and refused > 300
