"""Strokes cut out of photographs of whole sheets, taken by any camera from any place, for a stroke library.

A table says where each stroke starts on its sheet and which shape it was meant to have, as `export --to csv` writes
it. The corners of the sheet give the view; its bare parts give the light; the darkest paint gives full coverage.
"""

import csv
import io
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from frida_painter.calibration import Calibration
from frida_painter.canvas_size import AnyCanvas, CanvasSize
from frida_painter.errors import CalibrationError, FrameRejected, LibraryError
from frida_painter.frames import PixelGrid
from frida_painter.perception.flatfield import FlatField
from frida_painter.perception.rectify import rectify
from frida_painter.perception.snapshot import find_corners, list_turns
from frida_painter.strokes.palette import AnyColor, as_color
from frida_painter.strokes.plan import WHITE
from frida_painter.system import images, storage
from frida_painter.system.images import AnyPicture, as_picture, to_linear, to_srgb

_COLUMNS = {
    "start_x_mm": (0.0, 3000.0, 1e-3),
    "start_y_mm": (0.0, 3000.0, 1e-3),
    "angle_deg": (-3600.0, 3600.0, math.pi / 180),
    "length_mm": (0.5, 1000.0, 1e-3),
    "bend_mm": (-1000.0, 1000.0, 1e-3),
    "thickness": (0.0, 1.0, 1.0),
}
"""Columns of the table: least and greatest value, and the unit; others are ignored, except for `sheet`."""
_MAX_BYTES = 2**24
_MAX_STROKES = 20_000
Numbers = NDArray[np.float64]
_PITCHES = (0.00015, 0.001)  # metres per pixel of the crops: the finest and the coarsest
_POINTS = 48
_NOISE_FLOOR = 0.04
_FULL = 0.02  # share of the pixels on the paths that are darker than full paint
_MIN_CONTRAST = 0.15  # of sRGB between paper and paint


def cut_strokes(
    photographs: str | Path | Sequence[AnyPicture],
    shapes: str | Path,
    sheet: AnyCanvas,
    paint: AnyColor | None,
    around: float,
) -> dict[str, Any]:
    """Returns the parts of a `StrokeLibrary` by name, as photographed sheets show them.

    The arguments are those of `StrokeLibrary.from_photographs`.
    Raises LibraryError, CalibrationError if a sheet cannot be found in its photograph, ImageError.
    """
    size, found = CanvasSize.of(sheet), _list_photographs(photographs)
    if not 0.001 <= around <= 0.2:
        raise LibraryError(f"Crops {1000 * around:g} mm around their paths were asked for; give from 1 to 200 mm.")
    meant, sheets = _read_shapes(Path(shapes), [name for name, _ in found])
    seen = [images.to_uint8(as_picture(picture)) for _, picture in found]
    finest = min(size.width / max(one.shape[1], 1) for one in seen)
    pitch = min(max(finest, _PITCHES[0]), _PITCHES[1])
    grid = PixelGrid(size, max(8, round(size.height / pitch)), max(8, round(size.width / pitch)))
    x, y, turn, length, bend, thickness = meant.T
    left, right = math.ceil(around / pitch), math.ceil((length.max() + around) / pitch)
    above = math.ceil((0.75 * np.abs(bend).max() + around) / pitch)
    crop = np.meshgrid(np.arange(-left, right + 1), np.arange(above, -above - 1, -1))
    fraction = np.linspace(0, 1, _POINTS)

    def place(
        stroke: NDArray[np.intp] | np.intp, along: NDArray[np.float64], aside: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Returns places on the sheet [..., 2] from places along and beside strokes; all in metres."""
        cos, sin = np.cos(turn[stroke, None]), np.sin(turn[stroke, None])
        return np.stack((x[stroke, None] + cos * along - sin * aside, y[stroke, None] + sin * along + cos * aside), -1)

    marks = np.zeros((len(meant), 2 * above + 1, left + right + 1), np.uint8)
    for number, ((name, _), photograph) in enumerate(zip(found, seen, strict=True)):
        which = np.flatnonzero(sheets == number)
        if not len(which):
            raise LibraryError(f"{name} is a photograph of no stroke in {shapes}; leave it out, or name its strokes.")
        paths = place(which, length[which, None] * fraction, 3 * fraction * (1 - fraction) * bend[which, None])
        coverage = _read_sheet(name, photograph, size, grid, paths, paint, around)
        for index in which:
            pixel = grid.to_pixels(torch.from_numpy(place(index, *(pitch * part for part in crop)))).float().numpy()
            column, row = np.ascontiguousarray(pixel.transpose(2, 0, 1))
            mark = cv2.remap(coverage, column, row, cv2.INTER_LINEAR, borderValue=0)
            marks[index] = np.rint(255 * np.where(mark < _NOISE_FLOOR, 0, mark).clip(0, 1))
    return {
        "magnitude": marks,
        "length_m": length.astype(np.float32),
        "bend_m": bend.astype(np.float32),
        "thickness": thickness.astype(np.float32),
        "metres_per_pixel": pitch,
        "origin_px": (float(above), float(left)),
    }


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


def _read_shapes(path: Path, names: list[str]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Returns the strokes of a table [n, 6], in metres and radians, and the number of each one's photograph, from 0.

    A row names its photograph by the file, or by its place, from 1. Raises LibraryError, which names the line and the
    column of a fault.
    """
    text = storage.read_bytes(path, "a table of strokes (CSV)", _MAX_BYTES, LibraryError).decode("utf-8-sig", "replace")
    rows = csv.DictReader(io.StringIO(text))
    missing = [name for name in _COLUMNS if name not in (rows.fieldnames or ())]
    if missing:
        raise LibraryError(f"{path} has no column {missing[0]}; its columns are {', '.join(_COLUMNS)} and sheet.")
    values, sheets = [], []
    for line, row in enumerate(rows, 2):
        for name, (least, most, unit) in _COLUMNS.items():
            try:
                value = float(row[name] or "")
            except ValueError:
                value = math.nan
            if not least <= value <= most:
                raise LibraryError(
                    f"{path} says {name} {str(row[name])[:20]!r} in line {line}; it is a number from {least:g} to "
                    f"{most:g}."
                )
            values.append(unit * value)
        said = (row.get("sheet") or "").strip()
        if said in names:
            sheets.append(names.index(said))
        elif not said and len(names) == 1:
            sheets.append(0)
        elif said.isascii() and said.isdigit() and 1 <= int(said) <= len(names):
            sheets.append(int(said) - 1)
        else:
            raise LibraryError(
                f"{path} says sheet {said[:40]!r} in line {line}; write the file of its photograph or a number from 1 "
                f"to {len(names)}."
            )
        if len(sheets) > _MAX_STROKES:
            raise LibraryError(f"{path} has more than {_MAX_STROKES} strokes; give fewer of them.")
    if not sheets:
        raise LibraryError(f"{path} names no stroke; give a row for each stroke on the sheets.")
    return np.array(values).reshape(-1, len(_COLUMNS)), np.array(sheets)


def _read_sheet(
    name: str,
    photograph: NDArray[np.uint8],
    size: CanvasSize,
    grid: PixelGrid,
    paths: NDArray[np.float64],
    paint: AnyColor | None,
    around: float,
) -> NDArray[np.float32]:
    """Returns the coverage of a sheet, [rows, columns] in [0, 1], with the side up on which the strokes lie.

    paths [n, points, 2]: of the strokes, metres from the sheet's bottom left
    """
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
    pictures = []
    for turned in list_turns(corners, size):
        view = Calibration("sheet", "any", turned, photograph.shape[:2], touch_height=0.0, press_height=-1.0)
        try:
            light = to_linear(rectify(photograph, view, grid))
        except FrameRejected as reason:
            raise LibraryError(f"{name}: {reason}") from reason
        field = FlatField.even().refit(light, torch.from_numpy(~near), WHITE)
        pictures.append(to_srgb(light / field.light(grid.rows, grid.columns)).clamp(0, 1).mean(0))
    dark = min(pictures, key=lambda one: float(one[on_path].mean()))
    full = float(dark[on_path].quantile(_FULL)) if paint is None else sum(as_color(paint)) / 3
    if not full <= 1 - _MIN_CONTRAST:
        raise LibraryError(
            f"{name} shows no paint where its strokes should be; give the table of this sheet, and paint in a dark "
            "colour."
        )
    return np.ascontiguousarray(((1 - dark) / (1 - full)).clamp(0, 1).numpy(), np.float32)
