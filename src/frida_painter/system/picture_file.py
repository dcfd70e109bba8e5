"""Decoder of picture files from unknown sources.

Size is checked before a pixel is decoded. Each error of a decoder becomes one sentence. The content of the file
counts, not its name; content that cannot be read is refused by name. libvips decodes in strips if the format has
strips, so a picture of 100 megapixels need not fit in memory. Pillow decodes BMP, and libheif decodes HEIC.

A process that was forked from one that has used libvips has a picture decoded in another process: the threads of
libvips are not there, and it would wait for them for ever.
"""

import contextlib
import logging
import os
import re
import struct
import tempfile
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import cache, cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import ExifTags, Image, TiffTags
from PIL.TiffImagePlugin import ImageFileDirectory_v2 as Tags

from frida_painter.errors import ImageError, ProcessLost
from frida_painter.system import storage
from frida_painter.system.python_process import in_own_process

if TYPE_CHECKING:
    import pyvips

# Colours of a picture file, converted to sRGB on white paper by libvips
#
# Sources: ITU-T H.273 for code points of primaries and curves; Lindbloom for the matrices of primaries.

Bytes = NDArray[np.uint8]
Floats = NDArray[np.float32]

_D65 = (0.3127, 0.3290)
_SRGB = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, *_D65)
ADOBE = (0.64, 0.33, 0.21, 0.71, 0.15, 0.06, *_D65)
_SMPTE = (0.630, 0.340, 0.310, 0.595, 0.155, 0.070, *_D65)
_PRIMARIES = {  # H.273, table 2
    0: _SRGB, 1: _SRGB, 2: _SRGB, 5: (0.64, 0.33, 0.29, 0.60, 0.15, 0.06, *_D65), 6: _SMPTE, 7: _SMPTE,
    9: (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, *_D65), 12: (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, *_D65),
}  # fmt: skip
_EXPONENTS = {0: None, 1: None, 2: None, 4: 2.2, 5: 2.8, 6: None, 8: 1.0, 13: None, 14: None, 15: None}  # table 3
_FROM_XYZ = np.array(  # to linear sRGB (Lindbloom)
    [[3.2404542, -1.5371385, -0.4985314], [-0.9692660, 1.8760108, 0.0415560], [0.0556434, -0.2040259, 1.0572252]]
)
_SAME = 2 / 255  # a profile that moves no pixel further counts as sRGB


class Light(NamedTuple):
    """Conversion of numbers in [0, 1] to light.

    exponent: exponent of the power law; None for the curve of sRGB, as which one near 2.2 counts
    matrix: from light of the file's primaries to that of sRGB; None if they are the same
    """

    exponent: float | None = None
    matrix: NDArray[np.float64] | None = None


def light_of(exponent: float | None, primaries: Sequence[float]) -> Light:
    """Returns the light that a file states.

    primaries: x, y of red, green, blue and white; if they are not such that span colours, those of sRGB count
    """
    plain = Light(None if exponent is None or 2.1 <= exponent <= 2.3 else exponent)
    if len(primaries) != 8 or not min(primaries[1::2]) > 0.01 or not max(primaries) <= 1:
        return plain
    x, y = np.reshape(primaries, (4, 2)).T
    xyz = np.stack((x / y, np.ones(4), (1 - x - y) / y))
    if np.allclose(primaries, _SRGB, atol=0.002) or abs(np.linalg.det(xyz[:, :3])) < 1e-3:
        return plain
    shares = np.linalg.solve(xyz[:, :3], xyz[:, 3])
    if not (shares > 0).all():
        return plain
    matrix = _FROM_XYZ @ (xyz[:, :3] * shares)
    return Light(plain.exponent, matrix / matrix.sum(1, keepdims=True))  # white becomes white


def light_of_code_points(path: Path, primaries: int, transfer: int) -> Light:
    """Returns the light for H.273 code points of a picture file.

    The curves of television count as that of sRGB, as in viewers of still pictures. Raises ImageError for high
    dynamic range, which has no white, and for unknown code points.
    """
    if transfer not in _EXPONENTS or primaries not in _PRIMARIES:
        kind = {16: "high dynamic range (PQ)", 18: "high dynamic range (HLG)"}.get(transfer, "a kind not known here")
        raise ImageError(
            f"{path} has colours of {kind} (H.273: primaries {primaries}, transfer {transfer}); save it as sRGB."
        )
    return light_of(_EXPONENTS[transfer], _PRIMARIES[primaries])


def to_srgb(image: "pyvips.Image", light: Light, longest: int, *, layered: bool) -> Bytes | Floats:
    """Converts a picture to upright sRGB on white, [H, W, 3]: bytes, or float32 in [0, 1] if it has 16 bits.

    image: grey, RGB or CMYK by its interpretation; one channel more is its opacity
    light: what the numbers mean if the picture has no profile that fits
    longest: a picture with a longer side is shrunk to it, by areas
    layered: True for colour and opacity instead, [H, W, 4]
    """
    most = 65535.0 if image.format == "ushort" else 255.0
    # Into memory: the large picture is released, and a turned one is not read from top to bottom.
    image = _shrink(image, longest, most).copy_memory().autorot()
    colors, opacity = (image[:-1], image[-1]) if image.hasalpha() else (image, None)
    seen = _by_profile(colors, most)
    colors = _by_light(colors, light, most) if seen is None else seen
    if layered:
        colors = colors.bandjoin(most if opacity is None else opacity)
    elif opacity is not None:
        share = opacity / most
        colors = _whole(colors * share + share.linear(-most, most), most)
    pixels: Bytes = colors.numpy()
    return pixels if most == 255 else (pixels / np.float32(most)).astype(np.float32, copy=False)


def _whole(image: "pyvips.Image", most: float) -> "pyvips.Image":
    return image.rint().cast("uchar" if most == 255 else "ushort")


def _shrink(image: "pyvips.Image", longest: int, most: float) -> "pyvips.Image":
    """Shrinks to at most `longest` pixels on the longer side; transparent pixels do not affect their neighbours."""
    share = longest / max(image.width, image.height)
    if share >= 1:
        return image
    across, down = (max(1, round(side * share)) / side for side in (image.width, image.height))
    if not image.hasalpha():
        return image.resize(across, vscale=down, kernel="linear")
    smaller = image.premultiply(max_alpha=most).resize(across, vscale=down, kernel="linear")
    return _whole(smaller.unpremultiply(max_alpha=most), most)


def _by_profile(colors: "pyvips.Image", most: float) -> "pyvips.Image | None":
    """Converts by the ICC profile; None if there is none, or one that is damaged, does not fit or is that of sRGB."""
    import pyvips

    if not colors.get_typeof("icc-profile-data"):
        return None
    with contextlib.suppress(pyvips.Error):
        seen = colors.icc_transform("srgb", embedded=True, intent="perceptual", depth=16 if most == 65535 else 8)
        if colors.interpretation == "cmyk" or (seen - colors).abs().max() > _SAME * most:
            return seen
    return None


def _by_light(colors: "pyvips.Image", light: Light, most: float) -> "pyvips.Image":
    """Converts by curve and primaries; CMYK as light that ideal inks leave."""
    if colors.interpretation == "cmyk":
        return _whole(colors[:3].linear(-1, most) * colors[3].linear(-1, most) / most, most)
    kind = "srgb" if most == 255 else "rgb16"
    colors = (colors.bandjoin([colors, colors]) if colors.bands == 1 else colors).copy(interpretation=kind)
    if light.exponent is None and light.matrix is None:
        return colors
    linear = colors.colourspace("scrgb") if light.exponent is None else (colors / most) ** light.exponent
    linear = linear if light.matrix is None else linear.recomb(light.matrix.tolist())
    return linear.copy(interpretation="scrgb").colourspace(kind)


SUFFIXES = (
    ".jpg", ".jpeg", ".jpe", ".jfif", ".png", ".webp", ".tif", ".tiff", ".bmp", ".gif",
    ".heic", ".heif", ".hif", ".avif",
)  # fmt: skip
MAX_PIXELS = 100_000_000
MAX_SIDE = 30_000
MIN_SIDE = 16
LONGEST = 4096
WHAT = "a JPEG, PNG, WebP, TIFF, HEIC, AVIF, BMP or GIF picture"
_MAX_BYTES = 2**30
_MAX_PARTS = 100  # pages of a TIFF, pictures in a page, chunks of a PNG
_OF_PILLOW = ("JPEG", "PNG", "WEBP", "TIFF", "BMP", "GIF", "AVIF")
_DCF = "exif-ifd4-InteroperabilityIndex"  # R03 means Adobe RGB
_READ = ("JPEG", "PNG", "WebP", "TIFF", "GIF", "BMP", "HEIC", "AVIF")

# First bytes of files and their formats (the Library of Congress' list of formats, and the specifications).
_SIGNATURES = {
    b"\xff\xd8\xff": "JPEG", b"\x89PNG\r\n\x1a\n": "PNG", b"GIF87a": "GIF", b"GIF89a": "GIF", b"BM": "BMP",
    b"II*\0\x10\0\0\0CR": "a camera's raw photograph (CR2)", b"IIRO": "a camera's raw photograph (ORF)",
    b"IIU\0": "a camera's raw photograph (RW2)", b"FUJIFILMCCD-RAW": "a camera's raw photograph (RAF)",
    b"II*\0": "TIFF", b"MM\0*": "TIFF", b"II+\0": "TIFF", b"MM\0+": "a BigTIFF (big-endian) picture",
    b"8BPS": "a PSD (Photoshop) picture", b"gimp xcf": "an XCF (GIMP) picture", b"v/1\x01": "an EXR (OpenEXR) picture",
    b"#?RADIANCE": "an HDR (Radiance) picture", b"#?RGBE": "an HDR (Radiance) picture",
    b"\xff\x0a": "a JPEG XL picture", b"\0\0\0\x0cJXL \r\n\x87\n": "a JPEG XL picture",
    b"\xff\x4f\xff\x51": "a JPEG 2000 picture", b"\0\0\0\x0cjP  \r\n\x87\n": "a JPEG 2000 picture",
    b"\0\0\x01\0": "an ICO (icon)", b"%PDF": "a PDF", b"%!PS": "a PostScript page", b"\x1a\x45\xdf\xa3": "a film",
    b"PK\x03\x04": "a ZIP archive, or a document that is one", b"\x1f\x8b": "a gzip archive",
}  # fmt: skip
_BRANDS = {  # for files that begin with a box "ftyp" (ISO/IEC 14496-12)
    **dict.fromkeys((b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"msf1", b"heif"), "HEIC"),
    b"avif": "AVIF", b"avis": "AVIF", b"crx ": "a camera's raw photograph (CR3)",
    b"jxl ": "a JPEG XL picture", b"jp2 ": "a JPEG 2000 picture",
}  # fmt: skip


def decode(path: Path, *, most_pixels: int = MAX_PIXELS, longest: int = LONGEST) -> Bytes | Floats:
    """Decodes a picture file to upright, opaque sRGB [H, W, 3]: bytes, or float32 in [0, 1] for more than 8 bits.

    most_pixels: largest allowed number of pixels
    longest: a picture with a longer side than this is shrunk to it

    The orientation of the file is applied (EXIF, TIFF, HEIC). Colours are converted by the ICC profile, or by
    the stated gamma and primaries. Transparency is put on white. Of an animation the first frame is read; of
    several pages the first that is not a thumbnail or mask. Raises ImageError if the file is no such picture, has
    more than `most_pixels`, or has a side above 30,000 or below 16 pixels.
    """
    with storage.open_checked(path, WHAT, _MAX_BYTES, ImageError) as file:
        return _decode(_Given(path, file, most_pixels, longest))


def decode_with_opacity(content: bytes, name: str, *, longest: int) -> Bytes | Floats:
    """Decodes the content of a picture file as `decode` does, but with its opacity: [H, W, 4].

    name: of the file, for messages
    """
    try:
        with tempfile.TemporaryFile(buffering=0) as file:  # libvips moves the position too
            file.write(content)
            return _decode(_Given(Path(name), file, MAX_PIXELS, longest, layered=True))
    except OSError as cause:
        raise storage.cannot_write(Path(tempfile.gettempdir()), cause) from cause


def _decode(given: "_Given") -> Bytes | Floats:
    path, name = given.path, given.format
    if name not in _READ:
        raise ImageError(f"{path} is {name}, not a picture that can be read; give {WHAT}.")
    if _process_of_libvips.cache_info().currsize and _process_of_libvips() != os.getpid():
        try:
            return decode_alone(path, given.file, given.most_pixels, given.longest, given.layered)
        except ProcessLost as lost:
            raise ImageError(f"{path} could not be decoded in a process of its own ({lost}); try again.") from lost
    try:
        with warnings.catch_warnings():  # Pillow's, about metadata and large pictures, are of no use to a painter
            warnings.simplefilter("ignore")
            image, light = _READERS.get(name, _read_strips)(given)
            return to_srgb(image, light, given.longest, layered=given.layered)
    except ImageError:
        raise
    except MemoryError as cause:
        raise ImageError(f"{path} needs more memory than this machine has; make it smaller first.") from cause
    except Exception as cause:  # decoders raise any error for a damaged file
        if isinstance(cause, OSError) and cause.errno is not None:
            raise
        raise ImageError(f"{path} is a damaged {name} picture ({one_line(cause)}); take an undamaged copy.") from cause


@cache
def _process_of_libvips() -> int:
    """Returns the number of the process that was the first to use libvips."""
    return os.getpid()


@in_own_process()
def decode_alone(path: Path, file: BinaryIO, most_pixels: int, longest: int, layered: bool) -> NDArray[Any]:
    """Decodes an open picture file like `decode`, or with its opacity, in a process of its own."""
    return _decode(_Given(path, file, most_pixels, longest, layered))


def is_picture(name: str) -> bool:
    """Returns True if the name from `format_of` is a picture format, supported or not."""
    return name in _READ or name.endswith(" picture") or name.startswith("a camera's raw photograph")


def format_of(start: bytes) -> str:
    """Returns the format of a file from its first bytes (512 are enough): "PNG", or "a PDF" if it is not supported."""
    if not start:
        return "empty (0 bytes)"
    if start[4:8] == b"ftyp":
        length = int.from_bytes(start[:4], "big")
        brands = [start[8:12], *(start[at : at + 4] for at in range(16, min(length, len(start)), 4))]
        names = [_BRANDS[brand] for brand in brands if brand in _BRANDS]
        # A file of the general brand ("mif1") lists its real brand among the compatible ones.
        return "AVIF" if "AVIF" in names else names[0] if names else "a film"
    if start[:4] == b"RIFF":
        return "WebP" if start[8:12] == b"WEBP" else "a sound or a film"
    for signature, name in _SIGNATURES.items():
        if start.startswith(signature):
            return name
    if re.match(rb"P[1-7Ff]\s", start):
        return "a PPM, PGM, PBM, PAM or PFM picture"
    text = start.removeprefix(b"\xef\xbb\xbf").lstrip()
    if text[:1] == b"<":
        return "an SVG or HTML page"
    return "a text" if b"\0" not in start and start.isascii() else "of an unknown kind"


def exposure_time(path: Path) -> float | None:
    """Returns when a photograph was taken, in seconds since 1970, from its EXIF data; None if unknown.

    EXIF counts whole seconds, and the end of that second is returned. Without an offset the time counts as
    local time of this computer. Raises ImageError if there is no such file.
    """
    from pi_heif import HeifImageFile

    with storage.open_checked(path, WHAT, _MAX_BYTES, ImageError) as content:
        try:
            is_heic = format_of(content.read(512)) == "HEIC"
            content.seek(0)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                photograph = HeifImageFile(content) if is_heic else Image.open(content, formats=_OF_PILLOW)
                said = photograph.getexif().get_ifd(ExifTags.IFD.Exif)
            moment = datetime.strptime(str(said[ExifTags.Base.DateTimeOriginal]).strip("\0 "), "%Y:%m:%d %H:%M:%S")
            offset = str(said.get(ExifTags.Base.OffsetTimeOriginal, "")).strip("\0 ")
            zoned = datetime.strptime(offset, "%z").tzinfo if offset else None
            return moment.replace(tzinfo=zoned).timestamp() + 1
        except Exception:  # decoders raise any error; `decode` reports it
            return None


def require_size(path: Path, width: int, height: int, most_pixels: int = MAX_PIXELS) -> None:
    """Raises ImageError if a picture of this size, read from `path`, is too large or too small."""
    given = f"{path} is {width} x {height} pixels"
    if min(width, height) < MIN_SIDE:
        raise ImageError(f"{given}; a picture has at least {MIN_SIDE} pixels a side; give a larger one.")
    if max(width, height) > MAX_SIDE or width * height > most_pixels:
        raise ImageError(
            f"{given}; a picture has at most {MAX_SIDE} pixels a side and {most_pixels / 1e6:g} million in all; "
            "make it smaller first."
        )


def one_line(cause: BaseException) -> str:
    """Returns the message of a decoder's error in one short line."""
    told = re.sub(r"\Aunable to .*\n", "", str(cause))  # libvips names its function first
    return " ".join(told.split())[:120] or type(cause).__name__


@dataclass(frozen=True)
class _Given:
    """Open picture file, with limits for its size."""

    path: Path
    file: BinaryIO
    most_pixels: int
    longest: int
    layered: bool = False  # True for colour and opacity

    @cached_property
    def format(self) -> str:
        """Name of the format, as `format_of` gives it."""
        self.file.seek(0)
        return format_of(self.file.read(512))

    def strips(self, **options: Any) -> "pyvips.Image":
        """Returns the picture as libvips reads it, once from top to bottom. Only the header is read here."""
        library = _libvips()
        source = library.Source.new_from_descriptor(self.file.fileno())
        self.file.seek(0)
        loader = getattr(library.Image, f"{'heif' if self.format == 'AVIF' else self.format.lower()}load_source")
        return loader(source, access="sequential", fail_on="error", **options)


def _libvips() -> Any:
    """Returns the pyvips module, with its log and its cache switched off."""
    import pyvips

    _process_of_libvips()
    logging.getLogger("pyvips").setLevel(logging.CRITICAL + 1)
    if pyvips.API_mode:  # pyvips' own handler fails at warnings that are not text, as for damaged files
        pyvips.ffi.def_extern(name="_log_handler_callback")(lambda *_warning: None)
    pyvips.cache_set_max(0)
    return pyvips


# Readers of the formats: each returns the picture as `to_srgb` takes it, and the light of its numbers.

_Stored = tuple["pyvips.Image", Light]


def _read_strips(given: _Given) -> _Stored:
    """Reads JPEG, PNG, WebP and GIF."""
    image, light = given.strips(), Light()
    require_size(given.path, image.width, image.height, given.most_pixels)
    if given.format == "PNG":
        light = _light_of_png(given, image)
    elif image.get_typeof(_DCF) and image.get(_DCF).startswith("R03"):
        light = light_of(563 / 256, ADOBE)
    # JPEG and WebP can be decoded directly at a half, a quarter or an eighth of their size.
    share = given.longest / max(image.width, image.height)
    factor = next((factor for factor in (8, 4, 2) if share * factor <= 1), 1)
    if factor > 1 and given.format in ("JPEG", "WebP"):
        image = given.strips(**({"shrink": factor} if given.format == "JPEG" else {"scale": 1 / factor}))
    return image, light


def _light_of_png(given: _Given, image: "pyvips.Image") -> Light:
    """Returns the light of a PNG: the first of cICP, iCCP, sRGB, gAMA with cHRM counts."""
    chunks: dict[bytes, bytes] = {}
    given.file.seek(8)
    for _ in range(_MAX_PARTS):
        length, kind = struct.unpack(">I4s", given.file.read(8).ljust(8, b"\0"))
        if kind in (b"IDAT", bytes(4)):
            break
        chunks.setdefault(kind, given.file.read(min(length, 32)))
        given.file.seek(max(length - 32, 0) + 4, os.SEEK_CUR)
    if len(points := chunks.get(b"cICP", b"")) == 4:
        image.remove("icc-profile-data")
        return light_of_code_points(given.path, points[0], points[1])
    if b"sRGB" in chunks:
        return Light()
    gamma, points = (chunks.get(name, b"").ljust(32, b"\0") for name in (b"gAMA", b"cHRM"))
    exponent = 1e5 / number if 1e4 <= (number := int.from_bytes(gamma[:4], "big")) <= 1e6 else None
    white_x, white_y, *colors = (number / 1e5 for number in struct.unpack(">8I", points))
    return light_of(exponent, (*colors, white_x, white_y))


def _values(tags: Tags, number: int, *otherwise: int) -> tuple[Any, ...]:
    values = tags.get(number, otherwise)
    return values if isinstance(values, tuple) else (values,)


def _find_picture(file: BinaryIO) -> tuple[int, int, Tags]:
    """Returns page, SubIFD (-1: none) and tags of the picture in a TIFF.

    It is the largest of the first page that holds more than thumbnails and masks.
    """

    def tags_at(offset: int) -> Tags:
        tags = Tags(head, group=0)  # of no known group: else Pillow cuts values to the length that it expects
        file.seek(offset)
        tags.load(file)
        return tags

    file.seek(0)
    start = file.read(16)
    head = start if start[2] == 43 else start[:8]
    page, seen = Tags(head), list[tuple[int, int, Tags]]()
    for number in range(_MAX_PARTS):
        page = tags_at(page.next)
        parts = [
            (number, -1, page),
            *((number, at, tags_at(to)) for at, to in enumerate(_values(page, 330)[:_MAX_PARTS])),
        ]
        seen += parts
        if pictures := [part for part in parts if not _values(part[2], 254, 0)[0] & 5]:  # 1 a thumbnail, 4 a mask
            return max(pictures, key=lambda part: _values(part[2], 256, 0)[0] * _values(part[2], 257, 0)[0])
        if not page.next:
            break
    return seen[0]


_GREY, _RGB = ("b-w", "grey16"), ("srgb", "rgb16")
_TIFFS = {  # photometric interpretations of TIFF 6.0: depths that are read, number of colours, their kind in libvips
    0: ((1, 2, 4, 8, 16), 1, _GREY), 1: ((1, 2, 4, 8, 16), 1, _GREY), 2: ((8, 16), 3, _RGB), 3: ((1, 2, 4, 8), 3, _RGB),
    5: ((8, 16), 4, ("cmyk", "cmyk")), 6: ((8,), 3, _RGB),
}  # fmt: skip


def _read_tiff(given: _Given) -> _Stored:
    page, part, tags = _find_picture(given.file)
    photometric, sample, bits = _values(tags, 262, -1)[0], _values(tags, 339, 1)[0], _values(tags, 258, 1)
    depths, count, kinds = _TIFFS.get(photometric, ((), 0, ("", "")))
    if set(bits) - {bits[0]} or bits[0] not in depths or sample != 1 or _values(tags, 332, 1)[0] != 1:  # InkSet
        names = {number: name for name, number in TiffTags.lookup(262).enum.items()}
        name = names.get(photometric, f"photometric interpretation {photometric}")
        sign = {1: "unsigned", 2: "signed", 3: "float"}.get(sample, "unknown")
        raise ImageError(
            f"{given.path} is a TIFF of a kind that cannot be read ({'/'.join(map(str, dict.fromkeys(bits)))}-bit "
            f"{sign} {name}); save it as sRGB with 8 or 16 bits."
        )
    image = given.strips(page=page, subifd=part)
    require_size(given.path, image.width, image.height, given.most_pixels)
    count += _values(tags, 338, 0)[0] in (1, 2)  # other further channels are no opacity
    image = image[:count] if image.bands > count else image
    primaries = [float(number) for number in (*_values(tags, 319), *_values(tags, 318))]
    return image.copy(interpretation=kinds[image.format == "ushort"]), light_of(None, primaries)


def _read_bmp(given: _Given) -> _Stored:
    given.file.seek(0)
    with Image.open(given.file, formats=("BMP",)) as file:
        require_size(given.path, *file.size, given.most_pixels)
        picture = file if file.mode in ("L", "RGB", "RGBA") else file.convert("L" if file.mode == "1" else "RGB")
        return _libvips().Image.new_from_array(np.asarray(picture), interpretation="auto"), Light()


def _read_heif(given: _Given) -> _Stored:
    """Reads HEIC and AVIF. The container turns them upright and may state code points of the colours."""
    import pi_heif

    given.file.seek(0)
    head = pi_heif.open_heif(given.file, convert_hdr_to_8bit=False)
    width, height = head.size
    require_size(given.path, width, height, given.most_pixels)
    light, profile, points = Light(), head.info.get("icc_profile"), head.info.get("nclx_profile")
    if points is not None and profile is None:
        light = light_of_code_points(given.path, points["color_primaries"], points["transfer_characteristics"])
    # A copy: the array that it shows is libheif's memory, which ends with `head`.
    image = (
        given.strips()
        if given.format == "AVIF"
        else _libvips().Image.new_from_array(np.array(head), interpretation="auto")
    )
    if image.format == "ushort":  # 10 and 12 bits are stored in the upper bits
        bits = int(head.info["bit_depth"])
        image = (image * (65535 / ((2**bits - 1) << (16 - bits)))).rint().cast("ushort")
    if head.premultiplied_alpha:
        image = image.unpremultiply().rint().cast(image.format)
    if profile:
        image = image.copy()
        image.set_type(_libvips().GValue.blob_type, "icc-profile-data", profile)
    return image, light


_READERS = {"TIFF": _read_tiff, "BMP": _read_bmp, "HEIC": _read_heif, "AVIF": _read_heif}
