"""Decoder of picture files from unknown sources.

Size is checked before a pixel is decoded. Each error of a decoder becomes one sentence. The content of the file
counts, not its name: pages, depth, transparency, profiles, orientation. Content that the decoder does not
support is refused by name.

libvips decodes in strips if the format has strips, so a picture of 100 megapixels need not fit in memory.
Pillow decodes BMP, and libheif decodes HEIC. `python -m frida_painter.picture_file NAME PIXELS SIDE 3` decodes its
input, a file, and writes the picture to its output, as numpy.save does (4: with opacity). A process that was forked
from one that has used libvips needs that: the threads of libvips are not there, and it would wait for them for ever.
"""

import io
import logging
import os
import struct
import sys
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import datetime
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
from numpy.typing import NDArray
from PIL import ExifTags, Image

from frida_painter import python_process, storage
from frida_painter.errors import ImageError
from frida_painter.picture_colors import (
    ADOBE_LIGHT,
    COLOR_BANDS,
    SRGB_LIGHT,
    Alpha,
    Bytes,
    Floats,
    LightSource,
    Meaning,
    Space,
    are_primaries,
    lab_of_8_bits,
    lab_of_16_bits,
    light_of_code_points,
    shrink,
    to_srgb,
)

if TYPE_CHECKING:
    import pyvips


SUFFIXES = (
    ".jpg", ".jpeg", ".jpe", ".jfif", ".png", ".webp", ".tif", ".tiff", ".bmp", ".gif",
    ".heic", ".heif", ".hif", ".avif",
)  # fmt: skip
MAX_PIXELS = 100_000_000
MAX_SIDE = 30_000
MIN_SIDE = 16
LONGEST = 4096
WHAT = "a JPEG, PNG, WebP, TIFF, HEIC, AVIF, BMP or GIF picture"
_ADVICE = f"give {WHAT}"
_MAX_BYTES = 2**30
_MAX_PAGES = 1000
_ROWS = 1024  # copied at a time
_REFUSED = 2  # exit status
_READ = ("JPEG", "PNG", "WebP", "TIFF", "GIF", "BMP", "HEIC", "AVIF")

# First bytes of files and their formats (the Library of Congress' list of formats, and the specifications).
_SIGNATURES = (
    (b"\xff\xd8\xff", "JPEG"),
    (b"\x89PNG\r\n\x1a\n", "PNG"),
    (b"GIF87a", "GIF"),
    (b"GIF89a", "GIF"),
    (b"BM", "BMP"),
    (b"II*\0\x10\0\0\0CR", "a camera's raw photograph (CR2)"),
    (b"IIRO", "a camera's raw photograph (ORF)"),
    (b"IIU\0", "a camera's raw photograph (RW2)"),
    (b"FUJIFILMCCD-RAW", "a camera's raw photograph (RAF)"),
    (b"II*\0", "TIFF"),
    (b"MM\0*", "TIFF"),
    (b"II+\0", "TIFF"),
    (b"MM\0+", "TIFF"),
    (b"8BPS", "a PSD (Photoshop) picture"),
    (b"gimp xcf", "an XCF (GIMP) picture"),
    (b"v/1\x01", "an EXR (OpenEXR) picture"),
    (b"#?RADIANCE", "an HDR (Radiance) picture"),
    (b"#?RGBE", "an HDR (Radiance) picture"),
    (b"\xff\x0a", "a JPEG XL picture"),
    (b"\0\0\0\x0cJXL \r\n\x87\n", "a JPEG XL picture"),
    (b"\0\0\0\x0cjP  \r\n\x87\n", "a JPEG 2000 picture"),
    (b"\xff\x4f\xff\x51", "a JPEG 2000 picture"),
    (b"\0\0\x01\0", "an ICO (icon)"),
    (b"\0\0\x02\0", "a CUR (cursor)"),
    (b"icns", "an ICNS (icon)"),
    (b"DDS ", "a DDS (texture) picture"),
    (b"qoif", "a QOI picture"),
    (b"farbfeld", "a farbfeld picture"),
    (b"\x0a\x05\x01", "a PCX picture"),
    (b"\x01\xda", "an SGI picture"),
    (b"SIMPLE  =", "a FITS picture"),
    (b"%PDF", "a PDF"),
    (b"%!PS", "a PostScript page"),
    (b"\xc5\xd0\xd3\xc6", "a PostScript page"),
    (b"AT&TFORM", "a DjVu page"),
    (b"PK\x03\x04", "a ZIP archive, or a document that is one"),
    (b"\x1f\x8b", "a gzip archive"),
    (b"\x1a\x45\xdf\xa3", "a film"),
)
_BRANDS = {  # for files that begin with a box "ftyp" (ISO/IEC 14496-12)
    **dict.fromkeys((b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"msf1", b"heif"), "HEIC"),
    **dict.fromkeys((b"avif", b"avis"), "AVIF"),
    b"crx ": "a camera's raw photograph (CR3)",
    b"jxl ": "a JPEG XL picture",
    b"jp2 ": "a JPEG 2000 picture",
}
_NETPBM = {
    **dict.fromkeys((b"P1", b"P4"), "PBM"), **dict.fromkeys((b"P2", b"P5"), "PGM"),
    **dict.fromkeys((b"P3", b"P6"), "PPM"), b"P7": "PAM", b"PF": "PFM", b"Pf": "PFM",
}  # fmt: skip


def decode(path: Path, *, most_pixels: int = MAX_PIXELS, longest: int = LONGEST) -> Bytes | Floats:
    """Decodes a picture file to upright, opaque sRGB [H, W, 3]: bytes, or float32 in [0, 1] for more than 8 bits.

    most_pixels: largest allowed number of pixels
    longest: a picture with a longer side than this is shrunk to it

    The orientation of the file is applied (EXIF, TIFF, HEIC). Colours are converted by the ICC profile, or by
    the stated gamma and primaries. Transparency is put on white. Of an animation the first frame is read; of
    several pages the first that is not a thumbnail or mask. Floats count as sRGB from 0 to 1 unless a profile
    says otherwise.
    Raises ImageError if the file is no such picture, has more than `most_pixels`, or has a side above 30,000 or
    below 16 pixels.
    """
    with storage.open_checked(path, WHAT, _MAX_BYTES, ImageError) as file:
        return _decode_open(path, file, most_pixels, longest, layered=False)


def decode_with_opacity(content: bytes, name: str, *, longest: int) -> Bytes | Floats:
    """Decodes the content of a picture file as `decode` does, but with its opacity: [H, W, 4].

    name: of the file, for messages
    """
    try:
        with tempfile.TemporaryFile(buffering=0) as file:  # libvips moves the position too
            file.write(content)
            return _decode_open(Path(name), file, MAX_PIXELS, longest, layered=True)
    except OSError as cause:
        raise storage.cannot_write(Path(tempfile.gettempdir()), cause) from cause


def _decode_open(path: Path, file: BinaryIO, most_pixels: int, longest: int, *, layered: bool) -> Bytes | Floats:
    """Decodes an open file; layered: True for colour and opacity."""
    name = require_format(path, file)
    if _process_of_libvips.cache_info().currsize and _process_of_libvips() != os.getpid():
        return _decode_in_new_process(path, file, most_pixels, longest, layered=layered)
    with _tell_as_sentence(path, name):
        image, meaning, orientation = _READERS.get(name, _read_strips)(_Given(path, file, name, most_pixels, longest))
        image, meaning = shrink(image[: meaning.bands] if image.bands > meaning.bands else image, meaning, longest)
        image = _load_pixels(image)  # the large picture is released here
        return _upright(to_srgb(image, meaning, layered=layered), orientation)


@cache
def _process_of_libvips() -> int:
    """Returns the number of the process that was the first to use libvips."""
    return os.getpid()


def _decode_in_new_process(
    path: Path, file: BinaryIO, most_pixels: int, longest: int, *, layered: bool
) -> Bytes | Floats:
    """Decodes a picture as `_decode_open` does, in a process that was not forked."""
    made = python_process.run("-m", __name__, path, most_pixels, longest, "4" if layered else "3", stdin=file)
    if made.returncode == 0:
        return np.asarray(np.load(io.BytesIO(made.stdout), allow_pickle=False))
    said = made.stderr.decode("utf-8", "replace").strip()
    if made.returncode == _REFUSED and said:
        raise ImageError(said)
    raise ImageError(f"{path} could not be decoded in a process of its own ({one_line(OSError(said))}); try again.")


def _load_pixels(image: Any) -> Any:
    """Computes the picture and returns it in memory that does not depend on the file."""
    return _libvips().Image.new_from_memory(
        image.write_to_memory(), image.width, image.height, image.bands, image.format
    )


def is_picture(name: str) -> bool:
    """Returns True if the name from `format_of` is a picture format, supported or not."""
    return name in _READ or name.endswith(" picture") or name.startswith("a camera's raw photograph")


def require_format(path: Path, file: BinaryIO) -> str:
    """Returns the format of an open file ("PNG"). Raises ImageError if it is not supported."""
    file.seek(0)
    start = file.read(512)
    file.seek(0)
    if not start:
        raise ImageError(f"{path} is empty (0 bytes); {_ADVICE}.")
    name = format_of(start)
    if name not in _READ:
        raise ImageError(f"{path} is {name}, not a picture that can be read; {_ADVICE}.")
    return name


def format_of(start: bytes) -> str:
    """Returns the format of a file from its first bytes (512 are enough): "PNG", or "a PDF" if it is not supported."""
    if start[4:8] == b"ftyp":
        length = int.from_bytes(start[:4], "big")
        brands = [start[8:12], *(start[at : at + 4] for at in range(16, min(length, len(start)), 4))]
        first = [_BRANDS[brand] for brand in brands if brand in _BRANDS]
        # A file of the general brand ("mif1") lists its real brand among the compatible ones.
        return next((name for name in first if name == "AVIF"), first[0]) if first else "a film"
    if start[:4] == b"RIFF":
        return "WebP" if start[8:12] == b"WEBP" else "a sound or a film"
    for signature, name in _SIGNATURES:
        if start.startswith(signature):
            return name
    if start[:2] in _NETPBM and start[2:3].isspace():
        return f"a {_NETPBM[start[:2]]} picture"
    text = start.removeprefix(b"\xef\xbb\xbf").lstrip()
    if text[:1] == b"<":
        return "an SVG or HTML page"
    return "a text" if b"\0" not in start and start.isascii() else "of an unknown kind"


@contextmanager
def _tell_as_sentence(path: Path, name: str) -> Iterator[None]:
    """Turns each error of a decoder into an ImageError of one sentence, and hides warnings."""
    try:
        # Pillow's warnings about metadata and large pictures are of no use to a painter.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except ImageError:
        raise
    except MemoryError as cause:
        raise ImageError(f"{path} needs more memory than this machine has; make it smaller first.") from cause
    except Exception as cause:  # decoders raise any error for a damaged file
        if isinstance(cause, OSError) and cause.errno is not None:
            raise
        raise ImageError(f"{path} is a damaged {name} picture ({one_line(cause)}); take an undamaged copy.") from cause


def exposure_time(path: Path) -> float | None:
    """Returns when a photograph was taken, in seconds since 1970, from its EXIF data; None if unknown.

    EXIF counts whole seconds, and the end of that second is returned. Without an offset the time counts as
    local time of this computer. Raises ImageError if there is no such file.
    """
    with storage.open_checked(path, WHAT, _MAX_BYTES, ImageError) as content:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                said = _exif(content).get_ifd(ExifTags.IFD.Exif)
            moment = datetime.strptime(str(said[ExifTags.Base.DateTimeOriginal]).strip("\0 "), "%Y:%m:%d %H:%M:%S")
            offset = str(said.get(ExifTags.Base.OffsetTimeOriginal, "")).strip("\0 ")
            zoned = datetime.strptime(offset, "%z").tzinfo if offset else None
            return moment.replace(tzinfo=zoned).timestamp() + 1
        except Exception:  # decoders raise any error; `decode` reports it
            return None


def _exif(content: BinaryIO) -> Image.Exif:
    if format_of(content.read(512)) == "HEIC":
        import pi_heif

        content.seek(0)
        exif = Image.Exif()
        exif.load(pi_heif.open_heif(content).info["exif"] or b"")
        return exif
    content.seek(0)
    with Image.open(content, formats=("JPEG", "PNG", "WEBP", "TIFF", "BMP", "GIF", "AVIF")) as file:
        return file.getexif()


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
    lines = [line.strip() for line in str(cause).splitlines() if line.strip()]
    if len(lines) > 1 and lines[0].startswith("unable to "):  # libvips: the name of its function, then the message
        lines = lines[1:2]
    return " ".join(" ".join(lines).split())[:120] or type(cause).__name__


@dataclass(frozen=True)
class _Given:
    """Open picture file, with limits for its size."""

    path: Path
    file: BinaryIO
    format: str
    most_pixels: int
    longest: int

    def strips(self, **options: Any) -> "pyvips.Image":
        """Returns the picture as libvips reads it, once from top to bottom. Only the header is read here."""
        library = _libvips()
        source = library.Source.new_from_descriptor(self.file.fileno())
        self.file.seek(0)
        loader = getattr(library.Image, f"{'heif' if self.format == 'AVIF' else self.format.lower()}load_source")
        return loader(source, access="sequential", fail_on="error", **options)

    def require_size(self, width: int, height: int) -> None:
        """Raises ImageError if a picture may not have this size."""
        require_size(self.path, width, height, self.most_pixels)

    def refuse(self, what: str) -> ImageError:
        """Returns the error for an unsupported kind of picture."""
        return ImageError(
            f"{self.path} is a {self.format} of a kind that cannot be read ({what}); save it as sRGB with 8 or 16 bits."
        )


def _libvips() -> Any:
    """Returns the pyvips module, with its log and its cache switched off."""
    import pyvips

    _process_of_libvips()
    logging.getLogger("pyvips").setLevel(logging.CRITICAL + 1)
    if pyvips.API_mode:  # pyvips' own handler fails at warnings that are not text, as for damaged files
        pyvips.ffi.def_extern(name="_log_handler_callback")(lambda *_warning: None)
    pyvips.cache_set_max(0)
    return pyvips


def _upright(pixels: NDArray[Any], orientation: int) -> Bytes | Floats:
    """Returns the pixels after rotation and mirroring by their EXIF 2.32 orientation (tag 0x0112)."""
    if orientation in (5, 6, 7, 8):
        pixels = pixels.transpose(1, 0, 2)
    if orientation in (3, 4, 7, 8):
        pixels = pixels[::-1]
    if orientation in (2, 3, 6, 7):
        pixels = pixels[:, ::-1]
    return np.array(pixels, order="C")


# Readers of the formats: each returns the picture, its meaning and its EXIF orientation.

_Stored = tuple["pyvips.Image", Meaning, int]


def _read_strips(given: _Given) -> _Stored:
    """Reads JPEG, PNG, WebP and GIF."""
    image = given.strips()
    given.require_size(image.width, image.height)
    profile, light = _field(image, "icc-profile-data", b""), SRGB_LIGHT
    if given.format == "PNG":
        profile, light = _word_of_png(given, profile)
    elif _field(image, "exif-ifd4-InteroperabilityIndex", "").startswith("R03"):  # DCF: this index means Adobe RGB
        light = ADOBE_LIGHT
    share = given.longest / max(image.width, image.height)
    # JPEG and WebP can be decoded directly at a half, a quarter or an eighth of their size.
    factor = next((factor for factor in (8, 4, 2) if share * factor <= 1), 1)
    if factor > 1 and given.format == "JPEG":
        image = given.strips(shrink=factor)
    elif factor > 1 and given.format == "WebP":
        image = given.strips(scale=1 / factor)
    space: Space = "cmyk" if image.interpretation == "cmyk" else "grey" if image.bands < 3 else "rgb"
    most = 65535.0 if image.format == "ushort" else 255.0
    alpha: Alpha = "straight" if image.bands > COLOR_BANDS[space] else "none"
    return image, Meaning(space, most, alpha, light, profile), _field(image, "orientation", 1)


def _field(image: "pyvips.Image", name: str, otherwise: Any) -> Any:
    return image.get(name) if image.get_typeof(name) else otherwise


def _word_of_png(given: _Given, profile: bytes) -> tuple[bytes, LightSource]:
    """Returns the profile and the light of a PNG: the first of cICP, iCCP, sRGB, gAMA with cHRM counts."""
    chunks = _chunks_of_png(given.file)
    if len(points := chunks.get(b"cICP", b"")) == 4:
        return b"", light_of_code_points(str(given.path), points[0], points[1])
    light = SRGB_LIGHT
    if b"sRGB" not in chunks:
        if len(content := chunks.get(b"gAMA", b"")) == 4 and 0.1 <= (gamma := _be(content, "I")[0] / 1e5) <= 10:
            light = replace(light, exponent=1 / gamma)
        if len(content := chunks.get(b"cHRM", b"")) == 32:
            white, *colors = np.array(_be(content, "8I")).reshape(4, 2) / 1e5
            primaries = tuple((float(x), float(y)) for x, y in (*colors, white))
            light = replace(light, primaries=primaries) if are_primaries(primaries) else light
    return profile, light


def _be(content: bytes, form: str) -> tuple[int, ...]:
    return struct.unpack(f">{form}", content)


def _chunks_of_png(file: BinaryIO) -> dict[bytes, bytes]:
    """Returns the colour chunks of a PNG before its pixels."""
    file.seek(8)
    found: dict[bytes, bytes] = {}
    for _ in range(_MAX_PAGES):
        head = file.read(8)
        kind = head[4:]
        if len(head) < 8 or kind == b"IDAT":
            break
        length = _be(head[:4], "I")[0]
        if kind in (b"cICP", b"sRGB", b"gAMA", b"cHRM") and length <= 32:
            found.setdefault(kind, file.read(length))
            length = 0
        file.seek(length + 4, 1)
    return found


# TIFF 6.0 and its supplements: photometric interpretations by name, and the space of those that are supported.
_PHOTOMETRIC: dict[int, tuple[str, Space | None]] = {
    0: ("grey, white is zero", "grey"), 1: ("grey", "grey"), 2: ("RGB", "rgb"), 3: ("palette", "rgb"),
    4: ("transparency mask", None), 5: ("CMYK", "cmyk"), 6: ("YCbCr", "rgb"), 8: ("CIE Lab", "lab"),
    9: ("ICC Lab", "lab"), 10: ("ITU Lab", None), 32803: ("raw photograph of a camera", None),
    32844: ("LogL", None), 32845: ("LogLuv", None), 34892: ("raw photograph of a camera", None),
}  # fmt: skip
_SAMPLES = {1: "unsigned", 2: "signed", 3: "float", 4: "undefined", 5: "complex integer", 6: "complex"}
_TAGS = {254, 255, 258, 262, 274, 277, 318, 319, 332, 338, 339, 50706}
_REDUCED, _MASK = 1, 4


@dataclass(frozen=True)
class _Page:
    """Page of a TIFF by its tags."""

    number: int
    tags: dict[int, Any]

    def tag(self, number: int, otherwise: int) -> int:
        """Returns the value of a tag, the first if there is one for each sample; `otherwise` if the tag is missing."""
        values = self.tags.get(number, otherwise)
        if isinstance(values, tuple):
            return values[0] if values else otherwise
        return values

    @property
    def is_picture(self) -> bool:
        """True if the page is marked neither as a thumbnail nor as a mask (NewSubfileType, and the old SubfileType)."""
        return not self.tag(254, 0) & (_REDUCED | _MASK) and self.tag(255, 1) != 2

    @property
    def count(self) -> int:
        """Number of samples of each pixel."""
        return self.tag(277, 1)

    def name(self) -> str:
        """Returns the kind of the page in words ("32-bit float RGB")."""
        photometric = _PHOTOMETRIC.get(self.tag(262, -1), (f"photometric interpretation {self.tag(262, -1)}", None))[0]
        bits = self.tags.get(258, (1,))
        bits = "/".join(map(str, dict.fromkeys(bits if isinstance(bits, tuple) else (bits,))))
        return f"{bits}-bit {_SAMPLES.get(self.tag(339, 1), 'unknown')} {photometric}"


def _pages(given: _Given) -> list[_Page]:
    """Returns the pages in the chain of a TIFF. Raises TiffFileError and other errors if it is damaged."""
    import tifffile

    logging.getLogger("tifffile").setLevel(logging.CRITICAL + 1)
    given.file.seek(0)
    # Only needed tags are kept: integers, and the fractions of the chromaticities.
    pages = tifffile.TiffFile(given.file, name=given.path.name).pages
    tags = [page.aspage().tags for page, _ in zip(pages, range(_MAX_PAGES), strict=False)]
    return [
        _Page(number, {tag.code: tag.value for tag in page if tag.code in _TAGS}) for number, page in enumerate(tags)
    ]


def _read_tiff(given: _Given) -> _Stored:
    """Reads the first page that is a picture."""
    pages = _pages(given)
    page = next((page for page in pages if page.is_picture), pages[0])
    if 50706 in page.tags:
        raise ImageError(f"{given.path} is a camera's raw photograph (DNG), not a picture that can be read; {_ADVICE}.")
    space = _PHOTOMETRIC.get(page.tag(262, -1), ("", None))[1]
    sample = page.tag(339, 1)
    bits, extra = page.tags.get(258, (1,)), page.tags.get(338, ())
    bits = bits if isinstance(bits, tuple) else (bits,)
    extra = extra if isinstance(extra, tuple) else (extra,)
    depths = {"grey": (1, 2, 4, 8, 16, 32), "rgb": (8, 16, 32), "cmyk": (8, 16), "lab": (8, 16)}
    known = {1: depths.get(space or "", ()), 3: (16, 32) if space in ("grey", "rgb") else ()}
    stored = COLOR_BANDS[space] if space else 0
    if page.tag(262, 0) == 3:
        known, stored = {1: (1, 2, 4, 8)}, 1
    is_known = len(set(bits)) == 1 and bits[0] in known.get(sample, ()) and page.count >= stored
    if space is None or not is_known or (space == "cmyk" and page.tag(332, 1) != 1):  # InkSet
        raise given.refuse(page.name())
    if page.tag(262, 0) == 8 and bits[0] == 8:
        return _read_lab_of_bytes(given)
    image = given.strips(page=page.number)
    given.require_size(image.width, image.height)
    # libvips does not undo premultiplied opacity for these kinds.
    if extra[:1] == (1,) and (image.format == "uint" or (sample == 3 and space == "grey")):
        raise given.refuse(f"{page.name()} with premultiplied opacity")
    alpha: Alpha = "straight" if extra[:1] in ((1,), (2,)) else "none"
    if image.bands < COLOR_BANDS[space] + (alpha != "none"):
        alpha = "none"
    most = {"uchar": 255.0, "ushort": 65535.0, "short": 65535.0, "uint": 65535.0, "float": 1.0}[image.format]
    if image.format == "uint":
        image = (image / 65537).rint().cast("ushort")
    meaning = Meaning(space, most, alpha, _light_of_tiff(page), _field(image, "icc-profile-data", b""))
    if sample == 3:
        _require_unit(given, page, image[: meaning.bands])
        image = given.strips(page=page.number)
        if page.tag(262, 1) == 0:  # libvips inverts only integers
            negative = image[0].linear(-1, 1)
            image = negative.bandjoin(image[1]) if alpha != "none" else negative
    if space == "lab":
        image = lab_of_16_bits(image, icc=page.tag(262, 8) == 9) if bits[0] == 16 else lab_of_8_bits(image)
    return image, meaning, page.tag(274, 1)


def _require_unit(given: _Given, page: _Page, image: "pyvips.Image") -> None:
    """Raises ImageError unless all floats are from 0 to 1; reads the file once."""
    if ((image >= 0) & (image <= 1)).min() == 255:
        return
    image = given.strips(page=page.number)[: image.bands]
    extremes = image.stats().numpy()[0]
    raise ImageError(
        f"{given.path} is a TIFF ({page.name()}) with values from {extremes[0]:g} to {extremes[1]:g}, or that are no "
        "numbers; such pictures have values from 0 to 1; save it with 8 or 16 bits."
    )


def _light_of_tiff(page: _Page) -> LightSource:
    """Returns the primaries and white that a TIFF states, with the curve of sRGB, as viewers do."""
    colors, white = page.tags.get(319, ()), page.tags.get(318, ())
    if not (isinstance(colors, tuple) and isinstance(white, tuple) and len(colors) == 12 and len(white) == 4):
        return SRGB_LIGHT
    fractions = np.array([*colors, *white], float).reshape(-1, 2)
    if not (fractions[:, 1] > 0).all():
        return SRGB_LIGHT
    points = (fractions[:, 0] / fractions[:, 1]).reshape(4, 2)
    primaries = tuple((float(x), float(y)) for x, y in points)
    return LightSource(None, primaries) if are_primaries(primaries) else SRGB_LIGHT


def _read_lab_of_bytes(given: _Given) -> _Stored:
    """Reads a TIFF of CIE Lab with bytes, which libvips cannot read."""
    given.file.seek(0)
    with Image.open(given.file, formats=("TIFF",)) as file:
        given.require_size(*file.size)
        if file.mode != "LAB":
            raise given.refuse("8-bit CIE Lab beside other pages")
        file.load()
        orientation = file.getexif().get(ExifTags.Base.Orientation, 1)
        stored = np.array(file)
        stored[..., 1:] ^= 128  # a and b have a sign here
        image = _libvips().Image.new_from_array(stored)
    return lab_of_8_bits(image), Meaning("lab", 255.0), orientation


def _read_bmp(given: _Given) -> _Stored:
    given.file.seek(0)
    with Image.open(given.file, formats=("BMP",)) as file:
        given.require_size(*file.size)
        file.load()
        picture = file if file.mode in ("L", "RGB", "RGBA") else file.convert("L" if file.mode == "1" else "RGB")
        stored = np.empty((picture.height, picture.width, len(picture.getbands())), np.uint8)
        for top in range(0, picture.height, _ROWS):
            part = picture.crop((0, top, picture.width, min(top + _ROWS, picture.height)))
            stored[top : top + _ROWS] = np.asarray(part).reshape(part.height, part.width, -1)
    image = _libvips().Image.new_from_array(stored)
    return image, Meaning("rgb" if image.bands > 2 else "grey", 255.0, _straight(image.bands)), 1


def _straight(bands: int) -> Alpha:
    return "straight" if bands in (2, 4) else "none"


def _read_heif(given: _Given) -> _Stored:
    """Reads HEIC and AVIF. The container turns them upright and may state code points of the colours."""
    import pi_heif

    given.file.seek(0)
    head = pi_heif.open_heif(given.file, convert_hdr_to_8bit=False)
    given.require_size(*head.size)
    light, points = SRGB_LIGHT, head.info.get("nclx_profile")
    if points is not None and "icc_profile" not in head.info:
        light = light_of_code_points(
            str(given.path), int(points["color_primaries"]), int(points["transfer_characteristics"])
        )
    # A copy: the array that it shows is libheif's memory, which ends with `head`.
    image = given.strips() if given.format == "AVIF" else _libvips().Image.new_from_array(np.array(head))
    deep = image.format == "ushort"
    bits = int(head.info["bit_depth"])
    most = float((2**bits - 1) << (16 - bits)) if deep else 255.0  # 10 and 12 bits are stored in the upper bits
    alpha: Alpha = "premultiplied" if head.premultiplied_alpha else _straight(image.bands)
    profile = head.info.get("icc_profile", b"")
    return image, Meaning("rgb" if image.bands > 2 else "grey", most, alpha, light, profile), 1


_READERS = {"TIFF": _read_tiff, "BMP": _read_bmp, "HEIC": _read_heif, "AVIF": _read_heif}


if __name__ == "__main__":
    try:
        _, given, pixels, side, channels = sys.argv
        decoded = _decode_open(Path(given), sys.stdin.buffer, int(pixels), int(side), layered=channels == "4")
        np.save(sys.stdout.buffer, decoded)
    except ImageError as refused:
        print(refused, file=sys.stderr)
        sys.exit(_REFUSED)
