"""Colour calibration with a colour checker, and palettes from pictures and photographs.

The affine map of linear light converts perceived to true colours. Overlapping filters mix the bands of light,
and stray light adds to them. Both are linear in light, not in sRGB.
"""

import contextlib
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from torch import Tensor

from frida_painter.calibration import Calibration
from frida_painter.errors import ConfigError, FrameRejected, ImageError
from frida_painter.strokes.palette import MAX_COLORS, Palette, difference
from frida_painter.strokes.palette_file import FORMS, is_palette_file, light_of_lab
from frida_painter.system import images, picture_file, storage
from frida_painter.system.images import light_of_bytes, to_linear, to_srgb

# Colour checker: places, readings and true colours of its 24 patches

ACROSS, DOWN = 6, 4
PATCHES = ACROSS * DOWN
Corners = tuple[tuple[float, float], ...]

# CIE L*a*b* (D50, 2 degrees) as published by X-Rite, "New color specifications for ColorChecker SG and Classic
# charts" (2016), for charts made until and since November 2014; row by row from dark skin to black.
_LAB = {
    "until November 2014": (
        (37.986, 13.555, 14.059), (65.711, 18.13, 17.81), (49.927, -4.88, -21.905), (43.139, -13.095, 21.905),
        (55.112, 8.844, -25.399), (70.719, -33.397, -0.199), (62.661, 36.067, 57.096), (40.02, 10.41, -45.964),
        (51.124, 48.239, 16.248), (30.325, 22.976, -21.587), (72.532, -23.709, 57.255), (71.941, 19.363, 67.857),
        (28.778, 14.179, -50.297), (55.261, -38.342, 31.37), (42.101, 53.378, 28.19), (81.733, 4.039, 79.819),
        (51.935, 49.986, -14.574), (51.038, -28.631, -28.638), (96.539, -0.425, 1.186), (81.257, -0.638, -0.335),
        (66.766, -0.734, -0.504), (50.867, -0.153, -0.27), (35.656, -0.421, -1.231), (20.461, -0.079, -0.973),
    ),
    "since November 2014": (
        (37.54, 14.37, 14.92), (64.66, 19.27, 17.5), (49.32, -3.82, -22.54), (43.46, -12.74, 22.72),
        (54.94, 9.61, -24.79), (70.48, -32.26, -0.37), (62.73, 35.83, 56.5), (39.43, 10.75, -45.17),
        (50.57, 48.64, 16.67), (30.1, 22.54, -20.87), (71.77, -24.13, 58.19), (71.51, 18.24, 67.37),
        (28.37, 15.42, -49.8), (54.38, -39.72, 32.27), (42.43, 51.05, 28.62), (81.8, 2.67, 80.41),
        (50.63, 51.28, -14.12), (49.57, -29.71, -28.32), (95.19, -1.03, 2.93), (81.29, -0.57, 0.44),
        (66.89, -0.75, -0.06), (50.76, -0.13, 0.14), (35.63, -0.46, -0.48), (20.64, 0.07, -0.46),
    ),
}  # fmt: skip
EDITIONS = tuple(_LAB)
NAMES = (
    "dark skin", "light skin", "blue sky", "foliage", "blue flower", "bluish green",
    "orange", "purplish blue", "moderate red", "purple", "yellow green", "orange yellow",
    "blue", "green", "red", "yellow", "magenta", "cyan",
    "white", "neutral 8", "neutral 6.5", "neutral 5", "neutral 3.5", "black",
)  # fmt: skip
# Only the middle of a patch is read: this share of the distance of two patches, in cells of some samples.
_LOOKED_AT = 0.4
_CELLS, _SAMPLES = 4, 5
_BLOWN_OUT = 254
_FAINT = 0.01


def true_colors(edition: str) -> Tensor:
    """Returns the true colours of the patches of an edition: linear light of sRGB in [0, 1], [24, 3] float64."""
    return torch.tensor([light_of_lab(*lab) for lab in _LAB[edition]], dtype=torch.float64).clamp(0, 1)


@dataclass(frozen=True)
class PatchReadings:
    """Readings of the 24 patches, row by row from dark skin to black.

    light [24, 3]: mean linear light
    place [24, 2]: centres, (column, row) in pixels of the photograph
    unevenness [24]: variation of the light within a patch, relative to its mean
    blown_out [24]: share of overexposed samples
    """

    light: Tensor
    place: Tensor
    unevenness: Tensor
    blown_out: Tensor


def find_checker(photograph: NDArray[np.uint8]) -> Corners | None:
    """Returns the centres of the chart's corner patches (dark brown, turquoise, black, white) as (column, row) pixels.

    photograph [rows, columns, 3]: sRGB
    The corners go clockwise from the first patch for any rotation of the chart. Returns None if no chart is found.
    """
    detector = cv2.mcc.CCheckerDetector.create()
    detector.setColorChartType(cv2.mcc.MCC24)
    if not detector.process(np.ascontiguousarray(photograph[..., ::-1]), 1):
        return None
    patches = np.asarray(detector.getBestColorChecker().getColorCharts(), np.float32).reshape(PATCHES, 4, 2)
    view, _ = cv2.findHomography(_lattice(), patches.mean(1).astype(np.float64))
    if view is None or not np.isfinite(view).all():
        return None
    corners = cv2.perspectiveTransform(_corner_middles()[None].astype(np.float64), view)[0]
    return tuple((float(column), float(row)) for column, row in corners)


def read_checker(photograph: NDArray[np.uint8], corners: Corners) -> PatchReadings:
    """Returns the readings of the patches between the corners of `find_checker`."""
    view = np.asarray(cv2.getPerspectiveTransform(_corner_middles(), np.array(corners, np.float32)), np.float64)
    half = _LOOKED_AT / 2
    fine = (np.arange(_CELLS * _SAMPLES) + 0.5) / (_CELLS * _SAMPLES) * _LOOKED_AT - half
    looked_at = _lattice()[:, None, None] + np.stack(np.meshgrid(fine, fine), -1)  # [24, side, side, 2]
    place = _project(view, looked_at).astype(np.float32).reshape(PATCHES, -1, 2)
    column, row = place[..., 0], place[..., 1]
    seen = cv2.remap(photograph, column, row, cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE)  # [24, k, 3]
    light = light_of_bytes(np.asarray(seen, np.uint8))
    mean = light.mean(1)  # [24, 3]
    cells = light.reshape(PATCHES, _CELLS, _SAMPLES, _CELLS, _SAMPLES, 3).mean((2, 4, 5)).reshape(PATCHES, -1)
    return PatchReadings(
        light=torch.from_numpy(mean).double(),
        place=torch.from_numpy(_project(view, _lattice())),
        unevenness=torch.from_numpy(cells.std(1) / (cells.mean(1) + _FAINT)),
        blown_out=torch.from_numpy((seen >= _BLOWN_OUT).any(-1).mean(1)),
    )


def _lattice() -> NDArray[np.float64]:
    """Returns the centres of the patches, (across, down) counted in patches: [24, 2]."""
    across, down = np.meshgrid(np.arange(ACROSS), np.arange(DOWN))
    return np.stack((across, down), -1).reshape(PATCHES, 2).astype(np.float64)


def _corner_middles() -> NDArray[np.float32]:
    return np.array([(0, 0), (ACROSS - 1, 0), (ACROSS - 1, DOWN - 1), (0, DOWN - 1)], np.float32)


def _project(view: NDArray[np.float64], place: NDArray[np.float64]) -> NDArray[np.float64]:
    """Converts places on the chart [..., 2] to places in the photograph."""
    return np.asarray(cv2.perspectiveTransform(place.reshape(1, -1, 2), view), np.float64).reshape(place.shape)


_COLOR_FAINT = 0.03
_WORTH_IT = 0.85


def true_color(picture: Tensor, calibration: Calibration) -> Tensor:
    """Returns the picture [3, H, W] in true sRGB in [0, 1]; correct uneven light first."""
    affine = torch.tensor(calibration.color, dtype=picture.dtype, device=picture.device)  # [3, 4]
    light = torch.einsum("ij,jhw->ihw", affine[:, :3], to_linear(picture)) + affine[:, 3, None, None]
    return to_srgb(light)


@dataclass(frozen=True)
class ColorFit:
    """Fitted map from perceived to true linear light.

    affine [3, 4]: the map, float64
    before, held_out [n]: CIEDE2000 of each fitted colour as perceived, and as mapped by a fit to all others
    """

    affine: Tensor
    before: Tensor
    held_out: Tensor


def fit_color(perceived: Tensor, true: Tensor, *, stray: bool = True) -> ColorFit:
    """Fits the map to n colours, n >= 6.

    perceived, true [n, 3]: linear light
    stray: False if the true colours are too uncertain to tell stray light
    The fit is by least squares with a larger weight for dark colours, as for the eye. The map has an offset
    (stray light) only if that clearly improves held-out colours. Otherwise an offset would follow the errors of
    the few dark patches and spoil darker colours.
    """
    plain = _fit(perceived.double(), true.double(), offset=False)
    if not stray:
        return plain
    moved = _fit(perceived.double(), true.double(), offset=True)
    return moved if float(moved.held_out.mean()) < _WORTH_IT * float(plain.held_out.mean()) else plain


def _fit(perceived: Tensor, true: Tensor, *, offset: bool) -> ColorFit:
    affine, known, alone = _affine(perceived, true, offset), to_srgb(true), []
    for rest, one in zip(~torch.eye(len(true), dtype=torch.bool), perceived, strict=True):
        without = _affine(perceived[rest], true[rest], offset)
        alone.append(one @ without[:, :3].T + without[:, 3])
    return ColorFit(affine, difference(to_srgb(perceived), known), difference(to_srgb(torch.stack(alone)), known))


def _affine(perceived: Tensor, true: Tensor, offset: bool) -> Tensor:
    """Returns the best map [3, 4]; its last column is 0 without an offset."""
    columns = torch.cat((perceived, torch.ones_like(perceived[:, :1])), 1)[:, : 4 if offset else 3]
    # Slope of lightness over light: its power -2/3, bounded for faint light.
    weight = (true.mean(1, keepdim=True) + _COLOR_FAINT) ** (-2 / 3)
    solution = torch.linalg.lstsq(weight * columns, weight * true).solution.T
    return torch.nn.functional.pad(solution, (0, 4 - solution.shape[1]))


# Palettes from files: lists of colours, pictures of colours, or photographs of swatches beside white paper

_PAPER = 0.9  # reflectance of white paper
_DIMMEST = 0.08  # linear light of paper in a usable photograph
_INNER = 0.5  # share of each field's sides that is read, because edges are ragged and the crop is made by hand
_UNEVEN = 0.13  # largest sRGB difference within one field
_MIN = 8  # smallest side of a field in pixels


def read_swatches(photograph: Tensor, count: int) -> Palette:
    """Returns the colours of `count` swatches in the order of the wells.

    photograph [3, H, W]: sRGB, cropped to the strip. Its fields have equal lengths and run along the longer
    side, from the left or the top. The first field is bare white paper, which gives the colour of the light.
    Raises FrameRejected that names the bad field.
    """
    if not 1 <= count <= MAX_COLORS:
        raise FrameRejected(f"{count} swatches were asked for; a palette has 1 to {MAX_COLORS}.")
    strip = photograph if photograph.shape[2] >= photograph.shape[1] else photograph.transpose(1, 2)
    _, height, width = strip.shape
    pitch = width / (count + 1)
    if min(pitch, height) * _INNER < _MIN:
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
    """Returns linear light [3] of the inner part of a field. Raises FrameRejected if it is not one colour."""
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
    """Reads the palette of a list of colours, a picture of colours, or a photograph of `count` swatches.

    A picture with at most 64 different colours counts as a picture of the paints. Raises ConfigError,
    ImageError and FrameRejected; ConfigError also if there are not `count` paints.
    """
    found = Palette.load(path) if is_palette_file(path) else _read_picture(path, count)
    if count is not None and len(found) != count:
        raise ConfigError(f"{path} has {len(found)} paints, and {count} are wanted; give one colour for each.")
    return found


def _read_picture(path: Path, count: int | None) -> Palette:
    """Returns the palette of a picture of colours, or of a photograph of `count` swatches."""
    picture = None
    try:
        with (
            storage.open_checked(path, picture_file.WHAT, storage.MAX_BYTES, ImageError) as file,
            contextlib.suppress(Exception),  # `images.load` below reports any fault
            Image.open(file, formats=("PNG", "GIF", "BMP", "WEBP", "TIFF")) as small,
        ):
            # Also a very small picture, with one pixel for each colour.
            if min(small.size) < picture_file.MIN_SIDE and max(small.size) <= picture_file.LONGEST:
                picture = images.from_uint8(np.asarray(small.convert("RGB")))
        picture = images.load(path) if picture is None else picture
    except ImageError as error:
        raise ImageError(f"{str(error).removesuffix('.')}; {FORMS}.") from error
    found = _flat_colors(picture)
    if found is not None and (count is None or len(found) != count + 1):  # else paper and swatches
        return found
    if count is None:
        raise ConfigError(
            f"{path} is a photograph, and how many swatches it shows is not known; say it with --colors, where there "
            f"is one, or write their colours down: {FORMS}."
        )
    return read_swatches(picture, count)


def _flat_colors(picture: Tensor) -> Palette | None:
    """Returns the colours of a picture with few colours, in reading order; None if there are too many."""
    pixels = images.to_uint8(picture).reshape(-1, 3)
    code = (pixels.astype(np.uint32) * np.array([65536, 256, 1], np.uint32)).sum(1)
    if len(np.unique(code[:: max(1, len(code) // 4096)])) > MAX_COLORS:
        return None
    colors, first = np.unique(code, return_index=True)
    if len(colors) > MAX_COLORS:
        return None
    return Palette(torch.from_numpy(pixels[np.sort(first)].astype(np.float32) / 255))
