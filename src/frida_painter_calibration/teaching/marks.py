"""Teaching: marks of a person's hand, read from files, become a stroke family.

A mark is a trajectory with pressures. It is resampled evenly along its way, fitted by a spline, and laid over the
other marks of its family (turned, moved and scaled; generalised Procrustes). The principal components of the splines
are the modes of the family. docs/lab/families.md compares them with a small variational network.
"""

import csv
import io
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from frida_painter.errors import FamilyError
from frida_painter.strokes.family import CODE_REACH, MAX_CODES, MAX_SIZE, MIN_SIZE, StrokeFamily, spline_matrix
from frida_painter.system import storage

MIN_MARKS, MAX_MARKS = 10, 1000
"""Smallest and largest number of marks of a family."""
MIN_POINTS, MAX_POINTS = 4, 5000
"""Smallest and largest number of points of a mark."""
_MAX_BYTES = 2**26
_ENDINGS = (".json", ".csv")
_UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
_FARTHEST = 10.0  # metres
_SAME = 1e-6  # metres between two points that count as one
_CONTROLS = 48
_SAMPLES = 193
_ROUNDS = 8
_WEIGHTS = np.array([1.0, 1.0, 0.2])  # of x, y and pressure in the components
_WORTHWHILE = 0.9  # a further mode lowers the held-out error at least to this share
_MAX_UNLIKE = 0.2  # spread of marks of one kind, as a share of their size
_ROOM = 1.3  # factor between the taught sizes and the limits of the size
_NAMES = {
    "x": ("x", "x_m", "x_mm", "x_cm"),
    "y": ("y", "y_m", "y_mm", "y_cm"),
    "height": ("height", "z", "height_m", "height_mm", "z_m", "z_mm"),
    "pressure": ("pressure", "thickness", "p"),
    "time": ("time", "t", "time_s"),
}


@dataclass(frozen=True)
class TaughtMark:
    """One mark of a person's hand.

    place [k, 2]: metres, y up
    pressure [k]: in [0, 1], 0 above the canvas
    seconds: time that it took; 0 if unknown
    Raises FamilyError if it is no mark: fewer than 4 or more than 5,000 points, a number that is not finite, a lift
    in its middle, or a size outside of 3 mm to 0.5 m. `name` stands in the message.
    """

    place: NDArray[np.float64]
    pressure: NDArray[np.float64]
    seconds: float = 0.0
    name: str = "the mark"

    def __post_init__(self) -> None:
        if (fault := self._find_fault()) is not None:
            raise FamilyError(f"{self.name[:80]} {fault}")

    def _find_fault(self) -> str | None:
        count = len(self.place)
        if count > MAX_POINTS:
            every = math.ceil(count / MAX_POINTS)
            return f"has {count:,} points; a mark has at most {MAX_POINTS:,}: keep every {every}. point."
        if self.place.shape != (count, 2) or self.pressure.shape != (count,):
            return f"has {count} places and {len(self.pressure)} pressures; give one of each a point."
        if not (np.abs(self.place) <= _FARTHEST).all():
            return f"has a place that is not a number within {_FARTHEST:g} m; leave that point out, or give a unit."
        if not ((self.pressure >= 0) & (self.pressure <= 1)).all():
            return "has a pressure that is not a number from 0 to 1; scale it, or leave it out."
        down = np.flatnonzero(self.pressure > 0)
        if len(down) < MIN_POINTS:
            points = "1 point" if len(down) == 1 else f"{len(down)} points"
            return f"has {points} on the canvas; a mark is a way of at least {MIN_POINTS}."
        if not (self.pressure[down[0] : down[-1] + 1] > 0).all():
            return "lifts the brush in its middle; teach the parts as marks of two families."
        if not MIN_SIZE <= self.size <= MAX_SIZE:
            return (
                f"is {1000 * self.size:.1f} mm large; a mark is from {1000 * MIN_SIZE:g} to {1000 * MAX_SIZE:g} mm: "
                "draw it at another size, or give its unit."
            )
        return None

    @cached_property
    def size(self) -> float:
        """Greatest distance between two of its places in metres."""
        from scipy.spatial.distance import pdist

        place = self._on_canvas[0]
        hull = cv2.convexHull(place.astype(np.float32), returnPoints=False)[:, 0]
        return float(pdist(place[hull]).max(initial=0.0))

    @property
    def _on_canvas(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Places and pressures from the first touch to the last, without repeated places."""
        down = np.flatnonzero(self.pressure > 0)
        place, pressure = self.place[down[0] : down[-1] + 1], self.pressure[down[0] : down[-1] + 1]
        moved = np.r_[True, np.linalg.norm(np.diff(place, axis=0), axis=1) > _SAME]
        return place[moved], pressure[moved]

    def resample(self, count: int = _SAMPLES) -> NDArray[np.float64]:
        """Returns x, y and pressure at `count` places, evenly along the way: [count, 3]."""
        place, pressure = self._on_canvas
        way = np.r_[0, np.cumsum(np.linalg.norm(np.diff(place, axis=0), axis=1))]
        at = np.linspace(0, way[-1], count)
        return np.stack([np.interp(at, way, part) for part in (*place.T, pressure)], 1)


# Files of marks: JSON ({"unit": "mm", "marks": [{"x": [...], "y": [...], "pressure": [...], "time": [...]}]}, or a
# list of marks, or of points [x, y, pressure, time]) and CSV (a header row; a column "mark" parts several marks).


def read_marks(path: Path, unit: str = "mm") -> list[TaughtMark]:
    """Returns the marks of a file (.json or .csv), or of all such files of a folder, by name.

    unit: unit of the places and heights if the file does not say: m, cm or mm
    Raises FamilyError that names the file and the mark.
    """
    if unit not in _UNITS:
        raise FamilyError(f"The unit {unit[:20]!r} is not known; give {', '.join(_UNITS)}.")
    if path.is_dir():
        files = sorted(one for one in path.iterdir() if one.suffix.lower() in _ENDINGS)
        if not files:
            raise FamilyError(f"{storage.abridge(path)} has no marks; put .json or .csv files of trajectories into it.")
        return [mark for file in files for mark in read_marks(file, unit)]
    if path.suffix.lower() not in _ENDINGS:
        raise FamilyError(
            f"{storage.abridge(path)} is no file of marks; give a .json or .csv file, or a folder of them."
        )
    content = storage.read_bytes(path, "marks of a stroke family", _MAX_BYTES, FamilyError)
    try:
        text = content.decode("utf-8-sig")
        tables = _of_json(json.loads(text), unit) if path.suffix.lower() == ".json" else _of_csv(text, unit)
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError, csv.Error) as cause:
        raise FamilyError(
            f"{storage.abridge(path)} holds no marks ({' '.join(str(cause).split())[:120]}); a mark has the columns x, "
            "y and pressure or height, and may have time."
        ) from cause
    if len(tables) > MAX_MARKS:
        raise FamilyError(f"{storage.abridge(path)} has {len(tables):,} marks; a family has at most {MAX_MARKS:,}.")
    deepest = max((float(-table["height"].min()) for table in tables if len(table.get("height", ()))), default=0.0)
    return [
        _mark(table, deepest, path.name if len(tables) == 1 else f"Mark {number} of {path.name}")
        for number, table in enumerate(tables, 1)
    ]


Table = dict[str, NDArray[np.float64]]


def _mark(table: Table, deepest: float, name: str) -> TaughtMark:
    """Returns the mark of a table in metres; `deepest` is the depth that counts as a pressure of 1."""
    place = np.stack((table["x"], table["y"]), 1)
    pressure = table.get("pressure", np.full(len(place), 0.5))
    if "pressure" not in table and "height" in table:
        if not deepest > 0:
            raise FamilyError(f"{name} never goes below the canvas (height 0); give heights above the lightest touch.")
        pressure = np.clip(-table["height"] / deepest, 0, 1)  # keeps NaN
    time = table.get("time", np.zeros(0))
    seconds = float(time[-1] - time[0]) if len(time) > 1 else 0.0
    return TaughtMark(place, pressure, seconds if math.isfinite(seconds) else 0.0, name)


def _of_json(content: Any, unit: str) -> list[Table]:
    """Returns the tables of a JSON document. Raises ValueError, KeyError or TypeError."""
    if isinstance(content, dict) and "marks" in content:
        unit, content = str(content.get("unit", unit)), content["marks"]
    marks = content if isinstance(content, list) else [content]
    if marks and all(isinstance(one, list | tuple) and one and isinstance(one[0], int | float) for one in marks):
        marks = [marks]  # one mark as a list of points
    found = []
    for mark in marks:
        while isinstance(mark, dict) and "points" in mark:
            mark = mark["points"]
        if not isinstance(mark, dict):
            if len({len(point) for point in mark}) != 1 or not 2 <= len(mark[0]) <= 4:
                raise ValueError("a point is x, y, pressure and time")
            mark = dict(zip(("x", "y", "pressure", "time"), zip(*mark, strict=True), strict=False))
        found.append(_table(mark, unit))
    return found


def _of_csv(text: str, unit: str) -> list[Table]:
    """Returns the tables of a CSV file. Raises ValueError or KeyError."""
    parts: dict[str, dict[str, list[str]]] = {}
    for row in csv.DictReader(io.StringIO(text), skipinitialspace=True):
        columns = parts.setdefault(str(row.get("mark", "")), {})
        for name, value in row.items():
            if name is not None and name != "mark":
                columns.setdefault(name.strip().lower(), []).append(value)
    return [_table(columns, unit) for columns in parts.values()]


def _table(columns: Mapping[str, Any], unit: str) -> Table:
    """Returns the known columns of a mark as arrays in metres and seconds."""
    found: Table = {}
    for kind, names in _NAMES.items():
        name = next((name for name in names if name in columns), None)
        if name is not None:
            own = name.rsplit("_", 1)[-1] if "_" in name else unit
            scale = 1.0 if kind in ("pressure", "time") else _UNITS[own]
            found[kind] = scale * np.array([math.nan if one in (None, "") else float(one) for one in columns[name]])
    if len({len(found["x"]), *map(len, found.values())}) != 1 or "y" not in found:
        raise ValueError("its columns x and y are not equally long")
    return found


# From marks to a family


def align_marks(marks: Sequence[TaughtMark]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns marks laid over each other, [n, samples, 3], with a mean of size 1, and their sizes in metres [n].

    Each is turned, moved and scaled onto the mean. The mean points along x from its start to its end, or along its
    longest side if it ends near its start.
    """
    curves = np.stack([mark.resample() for mark in marks])
    flat = curves[..., 0] + 1j * curves[..., 1]  # [n, samples]
    flat = flat - flat.mean(1, keepdims=True)
    scale = np.sqrt((np.abs(flat) ** 2).mean(1))
    flat = flat / scale[:, None]
    mean = flat[0]
    for _ in range(_ROUNDS):
        turn = (flat.conj() * mean).sum(1)
        flat = flat * (turn / np.abs(turn))[:, None]
        mean = flat.mean(0)
        mean = mean / np.sqrt((np.abs(mean) ** 2).mean())
    heading = mean[-1] - mean[0]
    if abs(heading) < 0.2 * np.abs(mean).max():
        values, vectors = np.linalg.eigh(np.cov(mean.real, mean.imag))
        heading = complex(*vectors[:, int(values.argmax())])
    size = float(np.abs(mean[:, None] - mean[None]).max())
    flat = flat * (heading.conjugate() / abs(heading)) / size
    # How hard a mark is pressed is a parameter of the stroke; the family keeps how the pressure changes.
    aligned = np.stack((flat.real, flat.imag, curves[..., 2] / curves[..., 2].max(1, keepdims=True)), -1)
    return aligned, scale * size


def learn_family(marks: Sequence[TaughtMark], name: str, size: tuple[float, float] | None = None) -> StrokeFamily:
    """Learns a family from ten or more marks. It has a second mode only if that explains held-out marks clearly better.

    size: limits of the size in metres. None: those of the marks, with room.
    Raises FamilyError if there are fewer than 10 marks, or they are all the same or nothing alike.
    """
    if not MIN_MARKS <= len(marks) <= MAX_MARKS:
        raise FamilyError(
            f"{len(marks)} {'mark was' if len(marks) == 1 else 'marks were'} given; a family is learned from "
            f"{MIN_MARKS} to {MAX_MARKS:,} marks of one kind."
        )
    aligned, sizes = align_marks(marks)
    codes = 1
    while codes < MAX_CODES and held_out_error(aligned, codes + 1) < _WORTHWHILE * held_out_error(aligned, codes):
        codes += 1
    mean, modes = find_modes(aligned, codes)
    spread = np.sqrt(((aligned - mean)[..., :2] ** 2).sum(-1).mean())
    if not spread < _MAX_UNLIKE:
        raise FamilyError(
            f"The {len(marks)} marks are nothing alike (they differ by {100 * spread:.0f} % of their size); teach "
            "marks of one kind, each in the same direction."
        )
    if size is None:
        size = max(MIN_SIZE, float(sizes.min()) / _ROOM), min(MAX_SIZE, float(sizes.max()) * _ROOM)
    return StrokeFamily(name, _controls(mean), _controls(modes), size)


def find_modes(aligned: NDArray[np.float64], codes: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns the mean [samples, 3] and the modes [codes, samples, 3], each for one standard deviation.

    They are the principal components of the aligned marks [n, samples, 3].
    """
    mean = aligned.mean(0)
    apart = ((aligned - mean) * _WEIGHTS).reshape(len(aligned), -1)
    _, values, vectors = np.linalg.svd(apart, full_matrices=False)
    deviation = values[:codes] / math.sqrt(max(1, len(aligned) - 1))
    return mean, (deviation[:, None] * vectors[:codes]).reshape(codes, *mean.shape) / _WEIGHTS


def held_out_error(aligned: NDArray[np.float64], codes: int) -> float:
    """Returns the mean distance between each mark and the nearest shape of the family of the others.

    It is a share of their size. Shapes are those within the reach of the codes.
    """
    errors = []
    for one, mark in enumerate(aligned):
        mean, modes = find_modes(np.delete(aligned, one, 0), codes)
        flat = (_WEIGHTS * modes).reshape(codes, -1)
        code = flat @ (_WEIGHTS * (mark - mean)).ravel() / np.maximum((flat**2).sum(1), 1e-12)
        nearest = mean + np.tensordot(code.clip(-CODE_REACH, CODE_REACH), modes, 1)
        errors.append(float(np.linalg.norm((nearest - mark)[:, :2], axis=-1).mean()))
    return float(np.mean(errors))


def _controls(curves: NDArray[np.float64]) -> torch.Tensor:
    """Returns the control points of splines [..., controls, 3] for curves [..., samples, 3], from their start."""
    matrix = spline_matrix(torch.linspace(0, 1, curves.shape[-2], dtype=torch.float64), _CONTROLS)
    controls = torch.linalg.pinv(matrix) @ torch.from_numpy(np.ascontiguousarray(curves))
    start = (matrix[:1] @ controls)[..., :2]
    controls[..., :2] -= start
    return controls.float()


# Marks from the way of a tip that a person guides over the canvas: cut by its height, and kept in a file
#
# A mark begins if the tip comes down to the lightest touch, and ends if it rises well above that, because a hand
# trembles. The file is one of those that `read_marks` reads.

_LIFTED = 0.002  # metres above the lightest touch at which a mark has ended
_APART = 0.0003  # metres between two kept places, so that a hand that rests adds no way
_LIGHTEST = 0.02  # pressure of a tip that trembles above the canvas within a mark
Mark = NDArray[np.float64]


class MarkCutter:
    """Cuts the way of a tip into marks, sample by sample.

    press: metres from the lightest touch down to the hardest press
    marks: finished marks [k, 4] with x and y on the canvas in metres, metres below the lightest touch, and seconds
    """

    def __init__(self, press: float) -> None:
        self.press = press
        self.marks: list[Mark] = []
        self._touching: list[tuple[float, float, float, float]] = []

    def add(self, place: NDArray[np.float64], height: float, at: float) -> None:
        """Adds a sample of the tip.

        place [2]: on the canvas, metres
        height: metres above the lightest touch; below 0 on the canvas
        at: seconds
        """
        if height <= 0 or (self._touching and height <= _LIFTED):
            self._touching.append((float(place[0]), float(place[1]), -height, at))
        elif self._touching:
            self.finish()

    def finish(self) -> None:
        """Ends a mark that is not ended yet."""
        if not self._touching:
            return
        mark, self._touching = np.array(self._touching), []
        mark = mark[: 1 + int(np.flatnonzero(mark[:, 2] >= 0)[-1])]  # without the way up
        kept = [mark[0]]
        for sample in mark[1:]:
            if float(np.linalg.norm(sample[:2] - kept[-1][:2])) >= _APART:
                kept.append(sample)
        self.marks.append(np.array(kept))

    def save(self, path: Path) -> list[str]:
        """Writes the marks as a file of marks; returns a sentence about each touch that is no mark.

        The deepest place of all, or the hardest press if that is deeper, is a pressure of 1.
        Raises FamilyError if there is no mark or there are too many, StorageError.
        """
        deepest = max([self.press, *(float(mark[:, 2].max()) for mark in self.marks)])
        kept, left_out = [], []
        for number, mark in enumerate(self.marks, 1):
            pressure = np.clip(mark[:, 2] / deepest, _LIGHTEST, 1)
            try:
                TaughtMark(mark[:, :2], pressure, name=f"Touch {number}")
            except FamilyError as because:
                left_out.append(f"Left out: {because}")
                continue
            columns = {"x": 1000 * mark[:, 0], "y": 1000 * mark[:, 1], "pressure": pressure}
            columns["time"] = mark[:, 3] - mark[0, 3]
            kept.append({name: np.round(column, 4).tolist() for name, column in columns.items()})
        if not 1 <= len(kept) <= MAX_MARKS:
            raise FamilyError(
                f"{len(self.marks)} touches of the canvas were recorded, and {len(kept)} of them are marks; guide the "
                f"tip down to the canvas for each mark, up to {MAX_MARKS:,} of them, and lift it in between."
            )
        storage.write_text(path, json.dumps({"unit": "mm", "marks": kept}) + "\n")
        return left_out
