"""A picture file that anybody may have given, decoded with care.

A file is untrusted: its size is checked before a pixel is decoded, and whatever goes wrong inside a
decoder becomes one sentence.
"""

import io
import re
import warnings
from datetime import datetime
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray
from PIL import ExifTags, Image, ImageCms, ImageOps, UnidentifiedImageError

from frida_painter import storage
from frida_painter.errors import ImageError

FORMATS = ("JPEG", "PNG", "WEBP", "TIFF", "BMP", "GIF")
MOST_PIXELS = 100_000_000
MOST_SIDE = 30_000
LEAST_SIDE = 16
LONGEST = 4096
WHAT = "a JPEG, PNG, WebP, TIFF, BMP or GIF picture"
_ADVICE = f"give {WHAT}"
_MOST_BYTES = 2**30


def decode(path: Path, *, most_pixels: int = MOST_PIXELS, longest: int = LONGEST) -> Image.Image:
    """A picture file as Pillow's "RGB" in sRGB, upright and opaque; as "F" in [0, 1] where it is grey of 16 bits.

    The photograph is turned as its EXIF says, brought to sRGB by its ICC profile, and laid on white
    where it is transparent; of an animation the first frame counts. A picture whose longer side has
    more than `longest` pixels is made smaller. Raises ImageError for everything that is not such a
    picture, or has more than `most_pixels`, a side above 30,000 or one below 16 pixels.
    """
    with storage.opened(path, WHAT, _MOST_BYTES, ImageError) as file:
        start = file.read(512)
        if not start:
            raise ImageError(f"{path} is empty (0 bytes); {_ADVICE}.")
        file.seek(0)
        return _opened(path, file, start, most_pixels, longest)


def _opened(path: Path, content: BinaryIO, start: bytes, most_pixels: int, longest: int) -> Image.Image:
    """The picture in an open file, which begins with `start`."""
    try:
        # Pillow warns about odd metadata and large pictures, neither of which a painter can act upon.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with Image.open(content, formats=FORMATS) as file:
                require_size(path, *file.size, most_pixels)
                return _decode(path, file, longest)
    except ImageError:
        raise
    except UnidentifiedImageError as cause:
        raise ImageError(f"{path} is {_looks_like(start)}, not a picture that can be read; {_ADVICE}.") from cause
    except Image.DecompressionBombError as cause:
        count = int(re.findall(r"\d+", f"{cause} 0")[0])
        raise ImageError(
            f"{path} has {count / 1e6:.0f} million pixels; a picture has at most {most_pixels / 1e6:g} million; "
            "make it smaller first."
        ) from cause
    except MemoryError as cause:
        raise ImageError(f"{path} needs more memory than this machine has; make it smaller first.") from cause
    except Exception as cause:  # decoders raise whatever they stumble over in a damaged file
        raise ImageError(f"{path} is a damaged picture ({one_line(cause)}); take an undamaged copy.") from cause


def exposure_time(path: Path) -> float | None:
    """When a photograph was exposed by its own account (EXIF), as the end of that second since 1970; None if unsaid.

    Without an offset it is taken for this computer's local time. Raises ImageError where there is no such file.
    """
    with storage.opened(path, WHAT, _MOST_BYTES, ImageError) as content:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                with Image.open(content, formats=FORMATS) as file:
                    said = file.getexif().get_ifd(ExifTags.IFD.Exif)
            moment = datetime.strptime(str(said[ExifTags.Base.DateTimeOriginal]).strip("\0 "), "%Y:%m:%d %H:%M:%S")
            offset = str(said.get(ExifTags.Base.OffsetTimeOriginal, "")).strip("\0 ")
            zoned = datetime.strptime(offset, "%z").tzinfo if offset else None
            return moment.replace(tzinfo=zoned).timestamp() + 1
        except Exception:  # decoders raise whatever they stumble over; who decodes the picture is told
            return None


def require_size(path: Path, width: int, height: int, most_pixels: int = MOST_PIXELS) -> None:
    """Raises ImageError unless a picture of these pixels, read from `path`, is neither too large nor too small."""
    given = f"{path} is {width} x {height} pixels"
    if min(width, height) < LEAST_SIDE:
        raise ImageError(f"{given}; a picture has at least {LEAST_SIDE} pixels a side; give a larger one.")
    if max(width, height) > MOST_SIDE or width * height > most_pixels:
        raise ImageError(
            f"{given}; a picture has at most {MOST_SIDE} pixels a side and {most_pixels / 1e6:g} million in all; "
            "make it smaller first."
        )


def one_line(cause: BaseException) -> str:
    """What a decoder complains of, in one short line."""
    return " ".join(str(cause).split())[:120] or type(cause).__name__


def _decode(path: Path, file: Image.Image, longest: int) -> Image.Image:
    share = longest / max(file.size)
    if share < 1:
        # A JPEG can be decoded at a half, a quarter or an eighth of its size, without ever being whole in memory.
        file.draft(None, (round(file.size[0] * share), round(file.size[1] * share)))
    file.load()
    upright = ImageOps.exif_transpose(file)
    deep = _deep_gray(path, upright)
    if deep is not None:
        return _shrunk(Image.fromarray(deep), longest)
    if upright.has_transparency_data:
        layered = _shrunk(upright.convert("RGBA"), longest)
        paper = Image.new("RGB", layered.size, "white")
        paper.paste(_to_srgb(layered.convert("RGB"), upright.info), mask=layered.getchannel("A"))
        return paper
    plain = upright.convert("RGB" if upright.mode == "P" else "L") if upright.mode in ("P", "1") else upright
    return _to_srgb(_shrunk(plain, longest), upright.info)


def _deep_gray(path: Path, picture: Image.Image) -> NDArray[np.float32] | None:
    """Grey [H, W] in [0, 1] of a picture with 16 bits or floating-point values; None for all others."""
    if picture.mode == "F":
        most, values = 1.0, np.asarray(picture, dtype=np.float64)
    elif picture.mode.startswith("I"):
        most, values = 65535.0, np.asarray(picture, dtype=np.float64)
    else:
        return None
    if not (np.isfinite(values).all() and values.min() >= 0 and values.max() <= most):
        raise ImageError(
            f"{path} has grey values from {values.min():g} to {values.max():g}; "
            f"pictures of its kind (mode {picture.mode}) have values from 0 to {most:g}; save it as 8-bit PNG."
        )
    return (values / most).astype(np.float32)


def _shrunk(picture: Image.Image, longest: int) -> Image.Image:
    share = longest / max(picture.size)
    if share >= 1:
        return picture
    width, height = (max(1, round(side * share)) for side in picture.size)
    return picture.resize((width, height), Image.Resampling.BOX, reducing_gap=2.0)


def _to_srgb(picture: Image.Image, info: dict[str | tuple[int, int], object]) -> Image.Image:
    """The picture in sRGB by its own profile; as plain RGB where it has none that fits its channels."""
    standard = ImageCms.createProfile("sRGB")
    if picture.mode == "LAB":
        converted = ImageCms.profileToProfile(picture, ImageCms.createProfile("LAB"), standard, outputMode="RGB")
        return converted if converted is not None else picture
    embedded = info.get("icc_profile")
    if isinstance(embedded, bytes) and embedded:
        try:
            profile = ImageCms.ImageCmsProfile(io.BytesIO(embedded))
            if "sRGB" not in ImageCms.getProfileDescription(profile):
                converted = ImageCms.profileToProfile(picture, profile, standard, outputMode="RGB")
                picture = converted if converted is not None else picture
        except (ImageCms.PyCMSError, OSError, ValueError):
            pass  # a foreign or damaged profile says nothing about the colours
    return picture.convert("RGB")


def _looks_like(start: bytes) -> str:
    if start[4:8] == b"ftyp":
        return "a HEIC photograph or a film"
    if start.lstrip()[:1] == b"<":
        return "an SVG or HTML page"
    if start[:4] == b"%PDF":
        return "a PDF"
    return "a text" if b"\0" not in start and start.isascii() else "of an unknown kind"
