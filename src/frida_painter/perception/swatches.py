"""What was really mixed, read from a photograph of a strip of swatches whose first field is bare white paper."""

from pathlib import Path

import torch
from torch import Tensor

from frida_painter import images
from frida_painter.errors import ConfigError, FrameRejected
from frida_painter.palette import MOST_COLORS, Palette
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
    """The palette of a JSON file, or of a photograph of `count` swatches.

    Raises ConfigError, ImageError and FrameRejected; ConfigError also where it has not `count` paints.
    """
    if path.suffix.lower() == ".json":
        palette = Palette.load(path)
        if count is not None and len(palette) != count:
            raise ConfigError(f"{path} has {len(palette)} paints, and {count} are wanted; give one colour for each.")
        return palette
    if count is None:
        raise ConfigError(f"How many swatches {path} shows is not known; say it with --colors.")
    return read_swatches(images.load(path), count)
