"""Paints from a file: of colours, a picture of them, or a photograph of swatches beside bare white paper."""

import contextlib
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from torch import Tensor

from frida_painter import images, picture_file, storage
from frida_painter.errors import ConfigError, FrameRejected, ImageError
from frida_painter.palette import MOST_COLORS, Palette
from frida_painter.palette_file import FORMS, is_palette_file
from frida_painter.perception.light import to_linear, to_srgb

_PAPER = 0.9  # what white paper reflects
_DIMMEST = 0.08  # linear light of paper in a usable photograph
_INNER = 0.5  # of each field's sides is looked at: edges are ragged, and the cut is by hand
_UNEVEN = 0.13  # sRGB between the lighter and the darker part of one field
_LEAST = 8  # pixels of a field's side


def read_swatches(photograph: Tensor, count: int) -> Palette:
    """The colours of `count` swatches, in the order of the wells.

    photograph [3, H, W] sRGB: cut to the strip, whose fields are equally long and run along its longer
    side, from the left or the top; before the first lies bare white paper, by which the light is taken
    out. Raises FrameRejected, saying which field is not as it must be.
    """
    if not 1 <= count <= MOST_COLORS:
        raise FrameRejected(f"{count} swatches were asked for; a palette has 1 to {MOST_COLORS}.")
    strip = photograph if photograph.shape[2] >= photograph.shape[1] else photograph.transpose(1, 2)
    _, height, width = strip.shape
    pitch = width / (count + 1)
    if min(pitch, height) * _INNER < _LEAST:
        raise FrameRejected(
            f"The strip of {width} x {height} pixels is too small for bare paper and {count} swatches; "
            "photograph it from nearer."
        )
    seen = torch.stack([_field(strip, number, pitch) for number in range(count + 1)])  # [count + 1, 3] linear
    paper, paints = seen[0], seen[1:]
    if not float(paper.min()) >= _DIMMEST or not bool((paints.mean(1) <= 1.15 * paper.mean()).all()):
        raise FrameRejected(
            "The first field of the strip is not bare white paper in enough light; leave a field of paper before the "
            "first swatch, and cut the photograph to the strip."
        )
    return Palette(to_srgb((_PAPER * paints / paper).clamp(0, 1)))


def _field(strip: Tensor, number: int, pitch: float) -> Tensor:
    """Linear light [3] of the inner part of a field. Raises FrameRejected where it is not one colour."""
    height = strip.shape[1]
    rows = slice(round(height * (1 - _INNER) / 2), round(height * (1 + _INNER) / 2))
    columns = slice(round(pitch * (number + (1 - _INNER) / 2)), round(pitch * (number + (1 + _INNER) / 2)))
    inner = strip[:, rows, columns].flatten(1)
    spread = inner.quantile(0.9, 1) - inner.quantile(0.1, 1)
    if not float(spread.max()) <= _UNEVEN:
        name = "the field of paper" if number == 0 else f"swatch {number}"
        raise FrameRejected(
            f"In the photograph {name} is not one even colour; cut it to the strip, and see that its fields are "
            "equally long and nothing shines on them."
        )
    return to_linear(inner.median(1).values)


def read_palette(path: Path, count: int | None) -> Palette:
    """The palette of a file of any form: of colours, a picture of them, or a photograph of `count` swatches.

    A picture of at most 64 different colours, without a blend of them anywhere, shows the paints themselves. Raises
    ConfigError, ImageError and FrameRejected; ConfigError also if there are not `count` paints.
    """
    found = Palette.load(path) if is_palette_file(path) else _pictured(path, count)
    if count is not None and len(found) != count:
        raise ConfigError(f"{path} has {len(found)} paints, and {count} are wanted; give one colour for each.")
    return found


def _pictured(path: Path, count: int | None) -> Palette:
    """The palette of a picture of colours, or of a photograph of `count` swatches."""
    try:
        picture = _picture(path)
    except ImageError as error:
        raise ImageError(f"{str(error).removesuffix('.')}; {FORMS}.") from error
    found = _flat_colors(picture)
    if found is not None and (count is None or len(found) != count + 1):  # then it is not bare paper and the swatches
        return found
    if count is None:
        raise ConfigError(
            f"{path} is a photograph, and how many swatches it shows is not known; say it with --colors, where there "
            f"is one, or write their colours down: {FORMS}."
        )
    return read_swatches(picture, count)


def _picture(path: Path) -> Tensor:
    """A picture of any size, sRGB [3, H, W]; one of a pixel for each colour is smaller than other pictures may be."""
    with (
        storage.opened(path, picture_file.WHAT, storage.MAX_BYTES, ImageError) as file,
        contextlib.suppress(Exception),  # whatever is wrong with it is told below
        Image.open(file, formats=("PNG", "GIF", "BMP", "WEBP", "TIFF")) as picture,
    ):
        if min(picture.size) < picture_file.LEAST_SIDE and max(picture.size) <= picture_file.LONGEST:
            return images.from_uint8(np.asarray(picture.convert("RGB")))
    return images.load(path)


def _flat_colors(picture: Tensor) -> Palette | None:
    """The colours of a picture of few of them, in the order in which one reads; None if there are more."""
    pixels = images.to_uint8(picture).reshape(-1, 3)
    code = (pixels.astype(np.uint32) * np.array([65536, 256, 1], np.uint32)).sum(1)
    if len(np.unique(code[:: max(1, len(code) // 4096)])) > MOST_COLORS:
        return None
    colors, first = np.unique(code, return_index=True)
    if len(colors) > MOST_COLORS:
        return None
    return Palette(torch.from_numpy(pixels[np.sort(first)].astype(np.float32) / 255))
