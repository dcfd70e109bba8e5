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
import tifffile
from PIL import Image

from frida_painter import picture_file
from frida_painter.errors import ImageError

ROWS, COLUMNS = 24, 32
HEIC = Path(__file__).parent / "heic"
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


def tiff(stored: np.ndarray, **options: object) -> bytes:
    content = io.BytesIO()
    tifffile.imwrite(content, stored, **options)
    return content.getvalue()


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


def tiffs() -> dict[str, Case]:
    cases: dict[str, Case] = {}
    rgb: dict[str, object] = {"photometric": "rgb"}
    for bits in (8, 16, 32):
        color, grey, opacity = (numbers(values, bits) for values in (SCENE, GREY, OPACITY))
        most = 2.0**bits - 1
        exact, plain, share = color / most, grey / most, opacity / most
        both = np.concatenate((color, opacity), 2)
        held = np.concatenate((numbers(exact * share, bits), opacity), 2)
        greys = np.concatenate((grey, opacity), 2)
        contiguous: dict[str, object] = {"planarconfig": "contig"}
        cases |= {
            f"grey {bits}": (tiff(grey[..., 0], photometric="minisblack"), plain, EXACT),
            f"white is zero {bits}": (tiff(grey[..., 0], photometric="miniswhite"), 1 - plain, EXACT),
            f"rgb {bits}": (tiff(color, **rgb), exact, EXACT),
            f"rgb {bits} in planes": (tiff(color.transpose(2, 0, 1), planarconfig="separate", **rgb), exact, EXACT),
            f"rgb {bits} in tiles": (tiff(color, tile=(16, 16), compression="zlib", **rgb), exact, EXACT),
            f"rgb {bits} predicted": (tiff(color, compression="zlib", predictor=True, **rgb), exact, EXACT),
            f"rgb {bits} big": (tiff(color, bigtiff=True, byteorder=">", **rgb), exact, EXACT),
            f"rgba {bits}": (tiff(both, extrasamples=["unassalpha"], **rgb), on_white(exact, share), EXACT),
            f"rgbx {bits}": (tiff(both, extrasamples=["unspecified"], **rgb), exact, EXACT),
            f"grey {bits} with opacity": (
                tiff(greys, photometric="minisblack", extrasamples=["unassalpha"], **contiguous),
                on_white(plain, share), EXACT,
            ),
        }  # fmt: skip
        if bits < 32:
            content = tiff(held, extrasamples=["assocalpha"], **rgb)
            cases[f"rgba {bits} premultiplied"] = (content, held[..., :3] / most + 1 - share, 2 * EXACT)
            ink = np.concatenate((color, numbers(GREY / 2, bits)), 2)
            printed = (1 - exact) * (1 - ink[..., 3:] / most)
            cases[f"cmyk {bits}"] = (tiff(ink, photometric="separated"), printed, EXACT)
    for kind in (np.float16, np.float32):
        name = np.dtype(kind).name
        color = SCENE.astype(kind)
        cases[f"{name} rgb"] = (tiff(color, **rgb), color.astype(float), 1e-4)
        cases[f"{name} grey"] = (tiff(color[..., 0], photometric="minisblack"), color[..., :1].astype(float), 1e-4)
        white = tiff(color[..., 0], photometric="miniswhite")
        cases[f"{name} white is zero"] = (white, 1 - color[..., :1].astype(float), 1e-4)
    table = np.random.default_rng(4).integers(0, 256, (3, 256)).astype(np.uint16) * 257
    places = numbers(GREY, 8)[..., 0]
    cases["palette"] = (tiff(places, photometric="palette", colormap=table), table.T[places] / 65535, EXACT)
    black = GREY[..., 0] > 0.5
    cases["two tones"] = (tiff(black, photometric="minisblack"), black[..., None] * 1.0, EXACT)
    cases["two tones, white is zero"] = (tiff(black, photometric="miniswhite"), 1.0 - black[..., None], EXACT)
    gamma = profile(b"RGB ", 1.0, SRGB_XYZ)
    deep = numbers(SCENE, 16)
    fractions = [(round(value * 1e4), 10000) for value in (*P3_POINTS[2:], *P3_POINTS[:2])]
    told = [(318, 5, 2, sum(fractions[6:], ()), True), (319, 5, 6, sum(fractions[:6], ()), True)]
    soft = numbers(SCENE * 0.2 + 0.5, 16)
    cases["primaries of P3"] = (tiff(soft, extratags=told, **rgb), of_p3(soft / 65535), 0.004)
    cases["profile"] = (tiff(deep, iccprofile=gamma, **rgb), seen(deep / 65535), 0.004)
    cases["float with profile"] = (tiff(SCENE.astype(np.float32), iccprofile=gamma, **rgb), seen(SCENE), 0.004)
    return cases


def lab() -> dict[str, Case]:
    """CIE L*a*b* as TIFF and the ICC encode it: greys, so that every white point gives the same."""
    lightness = np.broadcast_to(GREY * 100, (ROWS, COLUMNS, 1))
    share = (lightness + 16) / 116
    grey = seen(np.where(lightness > 8, share**3, lightness / 903.3))
    nothing = np.zeros((ROWS, COLUMNS, 2))

    def stored(scale: float, middle: int, kind: type) -> np.ndarray:
        return np.concatenate((np.round(lightness * scale), nothing + middle), 2).astype(kind)

    return {
        "CIE Lab 8": (tiff(stored(2.55, 0, np.uint8), photometric="cielab"), grey, 2 * EXACT),
        "CIE Lab 16": (tiff(stored(655.35, 0, np.uint16), photometric="cielab"), grey, 2 * EXACT),
        "ICC Lab 8": (tiff(stored(2.55, 128, np.uint8), photometric="icclab"), grey, 2 * EXACT),
        "ICC Lab 16": (tiff(stored(652.80, 32768, np.uint16), photometric="icclab"), grey, 2 * EXACT),
    }


def paged() -> dict[str, Case]:
    """TIFF of several pages, and turned ones."""
    color = numbers(SCENE, 8)
    small, other = 255 - color[::2, ::2], 255 - color

    def pages(*written: tuple[np.ndarray, int]) -> bytes:
        content = io.BytesIO()
        with tifffile.TiffWriter(content) as file:
            for page, kind in written:
                file.write(page, photometric="mask" if kind == 4 else "rgb", subfiletype=kind)
        return content.getvalue()

    turned = {
        1: color, 2: color[:, ::-1], 3: color[::-1, ::-1], 4: color[::-1],
        5: color.transpose(1, 0, 2), 6: np.rot90(color, 1), 7: color.transpose(1, 0, 2)[::-1, ::-1],
        8: np.rot90(color, -1),
    }  # fmt: skip
    cases = {
        f"orientation {number}": (
            tiff(np.ascontiguousarray(stored), photometric="rgb", extratags=[(274, 3, 1, number, False)]),
            color / 255, EXACT,
        )
        for number, stored in turned.items()
    }  # fmt: skip
    return cases | {
        "thumbnail first": (pages((small, 1), (color, 0)), color / 255, EXACT),
        "thumbnail last": (pages((color, 0), (small, 1)), color / 255, EXACT),
        "mask first": (pages((color[..., 0] > 99, 4), (color, 0)), color / 255, EXACT),
        "two pages": (pages((color, 2), (other, 2)), color / 255, EXACT),
        "nothing but a thumbnail": (pages((color, 1)), color / 255, EXACT),
    }


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
        "AVIF": (pillow(color, "AVIF", **full), exact, LOSSY),
        "AVIF with opacity": (pillow(both, "AVIF", **full), veiled, LOSSY),
        "AVIF turned": (pillow(quarter, "AVIF", exif=note, **full), exact, LOSSY),
        "AVIF with profile": (pillow(color // 2 + 100, "AVIF", icc_profile=linear, **full),
                              seen((color // 2 + 100) / 255), LOSSY),
    }  # fmt: skip


CORPUS = {
    f"{family.__name__}: {name}": case
    for family in (pngs, colored, tiffs, lab, paged, others)
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


@pytest.mark.parametrize("name", [name for name in CORPUS if name.startswith(("tiffs", "pngs"))])
def test_the_files_are_what_this_test_believes(name: str) -> None:
    """OpenCV and tifffile read the numbers back that the formulas begin with, if neither adds a meaning of its own."""
    content, right, _ = CORPUS[name]
    if name.startswith("tiffs"):
        with tifffile.TiffFile(io.BytesIO(content)) as file:
            assert file.pages[0].imagelength == ROWS and file.pages[0].imagewidth == COLUMNS
            stored = file.asarray()
    else:
        stored = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    if stored.shape == right.shape and stored.shape[2] == 3 and not {"hole", "profile", "P3"} & set(name.split()):
        stored = stored[..., ::-1] if name.startswith("pngs") else stored
        most = 1.0 if stored.dtype.kind == "f" else np.iinfo(stored.dtype).max
        assert np.abs(stored / most - right).max() < EXACT
    assert stored.shape[:2] == (ROWS, COLUMNS) or stored.shape[1:] == (ROWS, COLUMNS)


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
        (b"P6 32 24 255\n", "a PPM picture"),
        (b"Pf\n32 24\n", "a PFM picture"),
        (b"\0\0\x01\0\x01\0", "an ICO"),
        (b"\0\0\0\x18ftypisom\0\0\0\0", "a film"),
        (b"\0\0\0\x18ftypcrx \0\0\0\0", "raw photograph"),
        (b"\0\0\0\x18ftypavif\0\0\0\0", "a damaged AVIF picture"),
        (b"\0\0\0\x18ftypheic\0\0\0\0", "a damaged HEIC picture"),
        (b"\0\0\0\x1cftypmif1\0\0\0\0mif1avif", "a damaged AVIF picture"),
        (b"RIFF\0\0\0\0WAVE", "a sound"),
        (tiff(SCENE, photometric="rgb"), r"TIFF of a kind that cannot be read \(64-bit float RGB\)"),
        (tiff(numbers(GREY, 8)[..., 0].astype(np.int16), photometric="minisblack"), "16-bit signed grey"),
        (
            tiff(
                np.concatenate((numbers(SCENE, 32), numbers(OPACITY, 32)), 2),
                photometric="rgb",
                extrasamples=["assocalpha"],
            ),
            "premultiplied opacity",
        ),
        (tiff(SCENE.astype(np.float32) * 3, photometric="rgb"), r"32-bit float RGB\) with values from 0 to 3"),
        (tiff(np.full((ROWS, COLUMNS), np.nan, np.float32)), "no numbers"),
        (tiff(numbers(GREY, 16)[..., 0], photometric="cfa", extratags=[(50706, 1, 4, b"\1\4\0\0", False)]), "DNG"),
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
from frida_painter import picture_file
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


@pytest.mark.slow
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
