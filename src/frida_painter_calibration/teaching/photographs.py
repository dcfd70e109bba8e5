"""Strokes cut out of photographs of whole sheets, taken by any camera from any place, for a stroke library.

A table says where each stroke starts on its sheet and which shape it was meant to have, as `export --to csv` writes
it. The corners of the sheet give the view; its bare parts give the light; the darkest paint gives full coverage.
"""

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter import images, storage
from frida_painter.calibration import Calibration, Corners
from frida_painter.canvas_size import AnyCanvas, CanvasSize
from frida_painter.errors import CalibrationError, FrameRejected, LibraryError
from frida_painter.frames import PixelGrid
from frida_painter.images import AnyPicture, as_picture, to_linear, to_srgb
from frida_painter.palette import AnyColor, as_color
from frida_painter.perception.flatfield import FlatField
from frida_painter.perception.rectify import rectify
from frida_painter.perception.snapshot import find_corners, list_turns
from frida_painter.plan import WHITE

_COLUMNS = {
    "start_x_mm": (0.0, 3000.0),
    "start_y_mm": (0.0, 3000.0),
    "angle_deg": (-3600.0, 3600.0),
    "length_mm": (0.5, 1000.0),
    "bend_mm": (-1000.0, 1000.0),
    "thickness": (0.0, 1.0),
}
"""Columns of the table with their least and greatest values; others are ignored, except for `sheet`."""
_MAX_BYTES = 2**24
_MAX_STROKES = 20_000
_PITCHES = (0.00015, 0.001)  # metres per pixel of the crops: the finest and the coarsest
_POINTS = 48
_NOISE_FLOOR = 0.04
_FULL = 0.02  # share of the pixels on the paths that are darker than full paint
_MIN_CONTRAST = 0.15  # of sRGB between paper and paint


@dataclass(frozen=True)
class CutStrokes:
    """Marks of n strokes, as `library.StrokeLibrary` has them; lengths and bends in metres."""

    magnitude: NDArray[np.uint8]
    length_m: NDArray[np.float32]
    bend_m: NDArray[np.float32]
    thickness: NDArray[np.float32]
    metres_per_pixel: float
    origin_px: tuple[float, float]


@dataclass(frozen=True)
class _Meant:
    """Strokes as they were meant, one row each.

    values [n, 6]: in the order of `_COLUMNS`
    sheet [n]: number of the photograph, from 0
    """

    values: NDArray[np.float64]
    sheet: NDArray[np.int64]

    def paths(self, sheet: int) -> NDArray[np.float64]:
        """Returns points on the paths of the strokes of a sheet, [n, points, 2] in metres from its bottom left."""
        x, y, angle, length, bend, _ = self.values[self.sheet == sheet].T[..., None]
        fraction = np.linspace(0, 1, _POINTS)
        along, aside = length * fraction / 1000, 3 * fraction * (1 - fraction) * bend / 1000
        turn = np.radians(angle)
        cos, sin = np.cos(turn), np.sin(turn)
        return np.stack((x / 1000 + cos * along - sin * aside, y / 1000 + sin * along + cos * aside), -1)


def cut_strokes(
    photographs: str | Path | Sequence[AnyPicture],
    shapes: str | Path,
    sheet: AnyCanvas,
    paint: AnyColor | None,
    around: float,
) -> CutStrokes:
    """Returns the strokes of photographed sheets; arguments as in `StrokeLibrary.from_photographs`.

    Raises LibraryError, CalibrationError if a sheet cannot be found in its photograph, ImageError.
    """
    size, found = CanvasSize.of(sheet), _list_photographs(photographs)
    if not 0.001 <= around <= 0.2:
        raise LibraryError(f"Crops {1000 * around:g} mm around their paths were asked for; give from 1 to 200 mm.")
    meant = _read_shapes(Path(shapes), [name for name, _ in found])
    seen = [images.to_uint8(as_picture(picture)) for _, picture in found]
    finest = min(size.width / max(one.shape[1], 1) for one in seen)
    pitch = min(max(finest, _PITCHES[0]), _PITCHES[1])
    grid = PixelGrid(size, max(8, round(size.height / pitch)), max(8, round(size.width / pitch)))
    longest, aside = meant.values[:, 3].max() / 1000, 0.75 * np.abs(meant.values[:, 4]).max() / 1000
    left, above = math.ceil(around / pitch), math.ceil((aside + around) / pitch)
    right = math.ceil((longest + around) / pitch)
    marks = np.zeros((len(meant.values), 2 * above + 1, left + right + 1), np.uint8)
    for number, ((name, _), photograph) in enumerate(zip(found, seen, strict=True)):
        which = np.flatnonzero(meant.sheet == number)
        if not len(which):
            raise LibraryError(f"{name} is a photograph of no stroke in {shapes}; leave it out, or name its strokes.")
        coverage = _read_sheet(name, photograph, size, grid, meant.paths(number), paint, around)
        for index in which:
            places = _places_around(meant.values[index], grid, (left, right, above), pitch)
            mark = cv2.remap(coverage, *places, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=0)
            marks[index] = np.rint(255 * np.where(mark < _NOISE_FLOOR, 0, mark).clip(0, 1))
    length, bend, thickness = meant.values[:, 3] / 1000, meant.values[:, 4] / 1000, meant.values[:, 5]
    return CutStrokes(
        marks,
        length.astype(np.float32),
        bend.astype(np.float32),
        thickness.astype(np.float32),
        pitch,
        (float(above), float(left)),
    )


def _list_photographs(given: str | Path | Sequence[AnyPicture]) -> list[tuple[str, AnyPicture]]:
    """Returns the photographs with their names: a file, a pattern such as "sheets/*.jpg", or a list."""
    if isinstance(given, str | Path):
        path = Path(given)
        files = sorted(path.parent.glob(path.name)) if "*" in path.name else [path]
        if not files:
            raise LibraryError(f"No file is called {str(given)[:80]}; give photographs of sheets with strokes.")
        return [(file.name, file) for file in files]
    several: list[AnyPicture] = list(given)
    if not several:
        raise LibraryError("No photograph was given; give at least one photograph of a sheet with strokes.")
    return [
        (Path(one).name if isinstance(one, str | Path) else f"photograph {number}", one)
        for number, one in enumerate(several, 1)
    ]


def _read_shapes(path: Path, names: list[str]) -> _Meant:
    """Returns the strokes of a table. Raises LibraryError, which names the line and the column of a fault."""
    text = storage.read_bytes(path, "a table of strokes (CSV)", _MAX_BYTES, LibraryError).decode("utf-8-sig", "replace")
    rows = csv.DictReader(io.StringIO(text))
    missing = [name for name in _COLUMNS if name not in (rows.fieldnames or ())]
    if missing:
        raise LibraryError(f"{path} has no column {missing[0]}; its columns are {', '.join(_COLUMNS)} and sheet.")
    values, sheets = [], []
    for line, row in enumerate(rows, 2):
        values.append([_number(path, line, name, row[name]) for name in _COLUMNS])
        sheets.append(_sheet_number(path, line, row.get("sheet"), names))
        if len(values) > _MAX_STROKES:
            raise LibraryError(f"{path} has more than {_MAX_STROKES} strokes; give fewer of them.")
    if not values:
        raise LibraryError(f"{path} names no stroke; give a row for each stroke on the sheets.")
    return _Meant(np.array(values), np.array(sheets))


def _number(path: Path, line: int, name: str, written: str | None) -> float:
    least, most = _COLUMNS[name]
    try:
        value = float(written or "")
    except ValueError:
        value = math.nan
    if not least <= value <= most:
        raise LibraryError(
            f"{path} says {name} {str(written)[:20]!r} in line {line}; it is a number from {least:g} to {most:g}."
        )
    return value


def _sheet_number(path: Path, line: int, written: str | None, names: list[str]) -> int:
    """Returns the number, from 0, of the photograph that a row names by its file or by its place, from 1."""
    said = (written or "").strip()
    if said in names:
        return names.index(said)
    if not said and len(names) == 1:
        return 0
    if said.isascii() and said.isdigit() and 1 <= int(said) <= len(names):
        return int(said) - 1
    raise LibraryError(
        f"{path} says sheet {said[:40]!r} in line {line}; write the file of its photograph or a number from 1 to "
        f"{len(names)}."
    )


def _read_sheet(
    name: str,
    photograph: NDArray[np.uint8],
    size: CanvasSize,
    grid: PixelGrid,
    paths: NDArray[np.float64],
    paint: AnyColor | None,
    around: float,
) -> NDArray[np.float32]:
    """Returns the coverage of a sheet, [rows, columns] in [0, 1], with the side up on which the strokes lie."""
    off = (paths < 0) | (paths > np.array([size.width, size.height]))
    if off.any():
        first = int(np.flatnonzero(off.any((1, 2)))[0]) + 1
        raise LibraryError(
            f"Stroke {first} of {name} leaves its sheet of {size}; say the size of the sheet, and starts from its "
            "bottom-left corner."
        )
    try:
        corners = find_corners(photograph, size)
    except CalibrationError as unseen:
        raise CalibrationError(f"{name}: {str(unseen).replace('The canvas', 'The sheet')}") from unseen
    columns, rows = grid.to_pixels(torch.from_numpy(paths)).round().long().unbind(-1)
    on_path = torch.zeros(grid.rows, grid.columns, dtype=torch.bool)
    on_path[rows.clamp(0, grid.rows - 1), columns.clamp(0, grid.columns - 1)] = True
    near = cv2.distanceTransform((~on_path).numpy().astype(np.uint8), cv2.DIST_L2, 5) * grid.pitch[0] <= around / 2
    try:
        pictures = [_even_light(photograph, turned, grid, near) for turned in list_turns(corners, size)]
    except FrameRejected as reason:
        raise LibraryError(f"{name}: {reason}") from reason
    picture = min(pictures, key=lambda one: float(one.mean(0)[on_path].mean()))
    dark = picture.mean(0)
    full = float(dark[on_path].quantile(_FULL)) if paint is None else sum(as_color(paint)) / 3
    if not full <= 1 - _MIN_CONTRAST:
        raise LibraryError(
            f"{name} shows no paint where its strokes should be; give the table of this sheet, and paint in a dark "
            "colour."
        )
    return np.ascontiguousarray(((1 - dark) / (1 - full)).clamp(0, 1).numpy(), np.float32)


def _even_light(photograph: NDArray[np.uint8], corners: Corners, grid: PixelGrid, near: NDArray[np.bool_]) -> Tensor:
    """Returns the sheet [3, rows, columns] as in even white light, sRGB; `near` is the mask of possible paint."""
    view = Calibration("sheet", "any", corners, photograph.shape[:2], touch_height=0.0, press_height=-1.0)
    light = to_linear(rectify(photograph, view, grid))
    field = FlatField(torch.zeros(3, 15)).refit(light, torch.from_numpy(~near), WHITE)
    return to_srgb(light / field.light(grid.rows, grid.columns)).clamp(0, 1)


def _places_around(
    stroke: NDArray[np.float64], grid: PixelGrid, reach: tuple[int, int, int], pitch: float
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Returns column and row in the sheet's picture of each pixel of a stroke's crop, which heads to the right."""
    left, right, above = reach
    x, y, angle = stroke[0] / 1000, stroke[1] / 1000, math.radians(stroke[2])
    along, up = np.meshgrid(np.arange(-left, right + 1) * pitch, np.arange(above, -above - 1, -1) * pitch)
    place = np.stack(
        (x + math.cos(angle) * along - math.sin(angle) * up, y + math.sin(angle) * along + math.cos(angle) * up), -1
    )
    pixel = grid.to_pixels(torch.from_numpy(place)).numpy().astype(np.float32)
    return np.ascontiguousarray(pixel[..., 0]), np.ascontiguousarray(pixel[..., 1])
