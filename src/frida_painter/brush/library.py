"""Stroke library: photographs of single strokes of the robot, cropped to magnitude maps; quality checks; dips."""

import zipfile
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.brush.kinds import Dip, painted_area
from frida_painter.errors import LibraryError
from frida_painter.frames import MapFrame
from frida_painter.registry import Later
from frida_painter.system import storage

if TYPE_CHECKING:
    from frida_painter.canvas_size import AnyCanvas
    from frida_painter.strokes.palette import AnyColor
    from frida_painter.system.images import AnyPicture


class Flaw(IntEnum):
    """Reason why a stroke of a library is dirty and excluded from training; files store the number.

    EMPTY to ASTRAY are visible in the mark itself, MOVED to DISTURBED only in the photographs before cropping.
    """

    NONE = 0
    EMPTY = 1
    TOUCHED = 2
    TORN = 3
    SKIPPED = 4
    ASTRAY = 5
    MOVED = 6
    LIGHT = 7
    DISTURBED = 8

    @property
    def words(self) -> str:
        """Reason in a few words, for a contact sheet."""
        return _REASONS[self][0]

    @property
    def sentence(self) -> str:
        """Reason as part of a sentence: observation and cause."""
        return _REASONS[self][1]


_REASONS = {
    Flaw.NONE: ("clean", "nothing is wrong with it"),
    Flaw.EMPTY: ("nearly empty", "it has far less paint than strokes of its shape: the brush ran out or did not touch"),
    Flaw.TOUCHED: ("touching", "there is paint of something else in its picture"),
    Flaw.TORN: ("torn", "much of its inside is bare: dry paint, or paint that was there before it"),
    Flaw.SKIPPED: ("skipped", "it breaks off on its way"),
    Flaw.ASTRAY: ("astray", "it lies elsewhere than other strokes: the robot, the paper or the camera moved"),
    Flaw.MOVED: ("paper moved", "the paper or the camera moved between its two photographs"),
    Flaw.LIGHT: ("light changed", "the light changed between its two photographs by more than can be taken out"),
    Flaw.DISTURBED: ("disturbed", "something besides it changed between its two photographs: a hand, the arm, a drop"),
}


def resample(maps: Tensor, given: MapFrame, wanted: MapFrame) -> Tensor:
    """Converts maps [n, rows, columns] from the cells of `given` to those of `wanted`; zero outside `given`.

    The paint per area stays the same: larger cells get the mean over their area, smaller ones a linear interpolation.
    """
    columns = _shares(given.left, given.pitch[0], given.columns, wanted.left, wanted.pitch[0], wanted.columns)
    rows = _shares(-given.top, given.pitch[1], given.rows, -wanted.top, wanted.pitch[1], wanted.rows)
    return rows.to(maps) @ maps @ columns.to(maps).T


def _shares(given_start: float, given_pitch: float, given_cells: int, start: float, pitch: float, cells: int) -> Tensor:
    """Returns the weight of each given cell in each wanted cell along one axis: [cells, given_cells]."""
    given_center = given_start + (torch.arange(given_cells, dtype=torch.float64) + 0.5) * given_pitch
    center = start + (torch.arange(cells, dtype=torch.float64) + 0.5) * pitch
    apart = (center[:, None] - given_center).abs()
    if pitch > given_pitch:
        overlap = (pitch + given_pitch) / 2 - apart
        return overlap.clamp(0, given_pitch) / pitch
    return (1 - apart / given_pitch).clamp(min=0)


MAX_STROKES = 20_000
MAX_BYTES = 2**31
_KEYS = ("magnitude", "length_m", "bend_m", "thickness", "metres_per_pixel", "origin_px", "recorded_index")
_OPTIONAL_KEYS = ("flaws", "since_dip", "code", "path_m")
_TYPES = {
    "magnitude": np.uint8, "flaws": np.uint8, "recorded_index": np.int32,
    **dict.fromkeys(("length_m", "bend_m", "thickness", "since_dip", "code", "path_m"), np.float32),
}  # fmt: skip
_RANGES = {  # areas in m2, lengths in m
    "flaws": (0, max(Flaw)), "since_dip": (0, 1), "length_m": (0, 1), "bend_m": (-1, 1), "thickness": (0, 1),
}  # fmt: skip
_DAMAGED = (
    OSError, EOFError, ValueError, TypeError, KeyError, SyntaxError, RuntimeError, MemoryError, OverflowError,
    zipfile.BadZipFile, zlib.error,
)  # fmt: skip
_CUT_STROKES = Later("frida_painter_calibration.teaching.photographs:cut_strokes")


@dataclass(frozen=True)
class StrokeLibrary:
    """n recorded strokes with their marks.

    magnitude [n, rows, columns] uint8: 255 full paint, 0 bare canvas, rectified to the canvas plane
    length_m, bend_m [n]: commanded shape in metres; positive bends go towards smaller rows
    thickness [n]: commanded thickness in [0, 1]
    metres_per_pixel: scale of both axes
    origin_px: (row, column) of the commanded start in each crop; the stroke heads towards larger columns

    recorded_index [n]: order of recording
    flaws [n]: `Flaw` of each stroke; None if the strokes were not judged
    since_dip [n]: area in m2 painted since the last dip, 0 for a full brush; None if unknown
    code [n, codes]: shape codes of strokes of a family, whose length is their size; None for a brush's own strokes
    path_m [n, k, 2]: path of each stroke of a family from its start, in metres, x along the stroke's heading

    Its .npz file holds each of these under its name; those that may be None may be missing.
    Raises LibraryError if a part is invalid.

        >>> import frida_painter as fp, numpy as np
        >>> marks, one = np.zeros((1, 20, 60), np.uint8), np.ones(1, np.float32)
        >>> library = fp.StrokeLibrary(marks, 0.04 * one, 0 * one, one, 0.001, (10.0, 5.0), np.zeros(1, np.int32))
        >>> library.save("library.npz")
        >>> len(fp.StrokeLibrary.load("library.npz"))
        1
    """

    magnitude: NDArray[np.uint8]
    length_m: NDArray[np.float32]
    bend_m: NDArray[np.float32]
    thickness: NDArray[np.float32]
    metres_per_pixel: float
    origin_px: tuple[float, float]
    recorded_index: NDArray[np.int32]
    flaws: NDArray[np.uint8] | None = None
    since_dip: NDArray[np.float32] | None = None
    code: NDArray[np.float32] | None = None
    path_m: NDArray[np.float32] | None = None

    def __post_init__(self) -> None:
        if self.magnitude.ndim != 3 or self.magnitude.dtype != np.uint8 or 0 in self.magnitude.shape:
            raise LibraryError(
                f"A stroke library has magnitude maps of shape {self.magnitude.shape} and kind {self.magnitude.dtype}; "
                "they are strokes x rows x columns of whole numbers from 0 to 255, and at least one."
            )
        n = len(self.magnitude)
        if n > MAX_STROKES:
            raise LibraryError(f"A stroke library has {n} strokes; it has at most {MAX_STROKES}.")
        if self.recorded_index.shape != (n,):
            raise LibraryError(f"A stroke library has {len(self.recorded_index)} recorded_index for {n} strokes.")
        code, path = self.code, self.path_m
        if (code is None) != (path is None) or (
            code is not None
            and path is not None
            and not (
                (code.ndim, path.ndim) == (2, 3)
                and len(code) == len(path) == n
                and path.shape[1] >= 2 == path.shape[2]
                and (np.abs(code) <= 10).all()
                and (np.abs(path) <= 1).all()
            )
        ):
            raise LibraryError(
                f"A stroke library has codes and paths that are not those of {n} strokes of a family; "
                "give a library that `frida-painter teach` wrote."
            )
        for name, (least, most) in _RANGES.items():
            values = getattr(self, name)
            if values is not None and (values.shape != (n,) or not ((values >= least) & (values <= most)).all()):
                raise LibraryError(
                    f"A stroke library has {name} that are not {n} numbers from {least:g} to {most:g}; "
                    "give a library that this version of `frida-painter strokes paint` wrote."
                )
        if not 1e-6 <= self.metres_per_pixel <= 0.1:
            raise LibraryError(
                f"A stroke library has {self.metres_per_pixel} metres per pixel; allowed is 1e-6 to 0.1."
            )
        if len(self.origin_px) != 2 or not all(-1e5 <= place <= 1e5 for place in self.origin_px):
            raise LibraryError(f"A stroke library has its strokes start at {self.origin_px}; give (row, column).")

    def __len__(self) -> int:
        return len(self.magnitude)

    def __getitem__(self, index: NDArray[np.int64] | NDArray[np.bool_] | slice) -> "StrokeLibrary":
        """Returns some of the strokes."""
        known = {name: getattr(self, name) for name in _TYPES}
        return replace(self, **{name: part[index] for name, part in known.items() if part is not None})

    @property
    def frame(self) -> MapFrame:
        """Rectangle of the crops with their pixels as cells."""
        _, rows, columns = self.magnitude.shape
        row, column = self.origin_px
        pitch = self.metres_per_pixel
        left, top = -(column + 0.5) * pitch, (row + 0.5) * pitch
        return MapFrame(left, left + columns * pitch, top - rows * pitch, top, rows, columns)

    def maps(self, frame: MapFrame) -> Tensor:
        """Returns the marks on the cells of a stroke model's frame: [n, rows, columns] in [0, 1].

        Cells outside the crops are bare.
        """
        parts = np.array_split(self.magnitude, -(-len(self) // 32))
        return torch.cat([resample(torch.from_numpy(part).float() / 255, self.frame, frame) for part in parts])

    def shapes(self) -> tuple[Tensor, Tensor, Tensor]:
        """Returns thickness, length and bend [n] of the strokes in float32, as inputs of a stroke model.

        Codes [n, codes] are in the place of bend for strokes of a family.
        """
        shape = self.bend_m if self.code is None else self.code
        return tuple(torch.from_numpy(np.asarray(part)) for part in (self.thickness, self.length_m, shape))  # type: ignore[return-value]

    @classmethod
    def from_photographs(
        cls,
        photographs: "str | Path | Sequence[AnyPicture]",
        shapes: str | Path,
        *,
        sheet: "AnyCanvas" = "A4",
        paint: "AnyColor | None" = None,
        around: float = 0.012,
    ) -> "StrokeLibrary":
        """Cuts single strokes out of your own photographs of sheets, taken by any camera from any place.

        photographs: files, a pattern such as "sheets/*.jpg", or pictures; each shows all four corners of a sheet
        shapes: CSV file with a row for each stroke and the columns start_x_mm, start_y_mm, angle_deg, length_mm,
        bend_mm, thickness, as `frida-painter export --to csv` writes it; with several photographs also sheet: the
        name of its photograph, or its number in the order of the names, from 1. The start is measured from the
        bottom-left corner of the sheet.
        sheet: size of the sheets
        paint: colour of full paint. None: the darkest paint of each photograph
        around: distance in metres from the paths to the edge of each crop

        Flawed strokes are marked in `flaws`. Raises LibraryError for a wrong table, CalibrationError if a sheet
        cannot be found in its photograph, ImageError.
        """
        cut = _CUT_STROKES(photographs, shapes, sheet, paint, around)
        made = cls(**cut, recorded_index=np.arange(len(cut["length_m"]), dtype=np.int32))
        return replace(made, flaws=judge_marks(made))

    def save(self, path: str | Path) -> None:
        """Writes an .npz file atomically. Raises StorageError."""
        scale: dict[str, Any] = {
            "metres_per_pixel": np.float64(self.metres_per_pixel), "origin_px": np.array(self.origin_px, np.float32)
        }  # fmt: skip
        known = {name: scale.get(name, getattr(self, name)) for name in (*_KEYS, *_OPTIONAL_KEYS)}
        with storage.replacing(Path(path)) as temporary, temporary.open("wb") as file:
            np.savez_compressed(file, **{name: part for name, part in known.items() if part is not None})

    @classmethod
    def load(cls, path: str | Path) -> "StrokeLibrary":
        """Reads and checks an .npz file; never runs a pickle. Raises LibraryError."""
        path = Path(path)
        arrays = _read(path)
        kinds = {name: array.dtype.kind for name, array in arrays.items()}
        whole = {kinds.get(name, "u") for name in ("recorded_index", "flaws")}
        if not set(kinds.values()) <= set("fiu") or not whole <= set("iu"):
            raise LibraryError(f"{path} is not a stroke library: it holds something else than numbers.")
        if arrays["metres_per_pixel"].size != 1 or arrays["origin_px"].size != 2:
            raise LibraryError(f"{path} is not a stroke library: metres_per_pixel is 1 number and origin_px are 2.")
        row, column = (float(place) for place in arrays["origin_px"].ravel())
        if arrays["magnitude"].dtype != np.uint8:
            raise LibraryError(f"{path} is not a stroke library: its magnitude is not of kind uint8.")
        parts: dict[str, Any] = {name: array.astype(_TYPES[name]) for name, array in arrays.items() if name in _TYPES}
        try:
            scale = float(arrays["metres_per_pixel"].ravel()[0])
            return cls(**parts, metres_per_pixel=scale, origin_px=(row, column))
        except LibraryError as cause:
            raise LibraryError(f"{path}: {cause}") from cause


def _read(path: Path) -> dict[str, NDArray[np.generic]]:
    """Returns the arrays of a library file by name. Raises LibraryError."""
    try:
        with storage.open_checked(path, "a stroke library (.npz)", MAX_BYTES, LibraryError) as file:
            with zipfile.ZipFile(file) as archive:
                unpacked = sum(member.file_size for member in archive.infolist())
            if unpacked > MAX_BYTES:
                raise LibraryError(f"{path} unpacks to {unpacked} bytes; a stroke library has at most {MAX_BYTES}.")
            file.seek(0)
            with np.load(file, allow_pickle=False) as stored:
                missing = [name for name in _KEYS if name not in stored]
                if missing:
                    raise LibraryError(f"{path} is not a stroke library: it has no {', '.join(missing)}.")
                return {name: stored[name] for name in (*_KEYS, *_OPTIONAL_KEYS) if name in stored}
    except _DAMAGED as cause:
        raise LibraryError(
            f"{path} is not a stroke library: it is cut off, damaged or of another kind ({cause}); "
            "give an undamaged .npz that `frida-painter strokes paint` wrote."
        ) from cause


# Detection of dirty strokes from their marks alone
#
# A stroke is compared with its path and with the other strokes of the library. No constant here depends on a brush.
# The statistics are medians, which hold while most strokes are good.

_INKED = 0.3
"""Magnitude above which a cell counts as painted."""
_MIN_PAINT = 0.35  # of the paint of strokes of its shape
_MIN_COVERED = 0.2  # of the way
_MAX_FOREIGN = 0.03  # of the paint of a usual stroke
_MAX_TORN = 0.09  # of the mark's own area
_WIDE_GAP = 0.18  # of the width of a usual mark
_MAX_POROUS = 0.15  # of the mark's area with closed pores
_WIDE_PORE = 0.25  # of the width of a usual mark
_MAX_SKIPPED = 0.05  # of the way
_MAX_ASTRAY = 7.0  # standard deviations
_FEWEST_TO_COMPARE = 12
_PATH_POINTS = 48
_ROUNDS = 20


def judge(library: StrokeLibrary) -> NDArray[np.uint8]:
    """Returns the `Flaw` of each stroke, [n]: those stored in the library, or else those that its marks show."""
    return judge_marks(library) if library.flaws is None else library.flaws


def clean(library: StrokeLibrary) -> StrokeLibrary:
    """Returns the strokes without a flaw. Raises LibraryError if there are none."""
    return library[judge(library) == Flaw.NONE]


def judge_marks(library: StrokeLibrary) -> NDArray[np.uint8]:
    """Returns the `Flaw` of each stroke, [n], from the marks alone."""
    marks = [_Mark.of(library, index) for index in range(len(library))]
    extents = [mark.extent() for mark in marks if mark.paint.any()]
    # Distance from its path in pixels within which paint counts as the stroke's own, with a margin.
    reach = 1.6 * float(np.median(extents)) + 3 if extents else 3.0
    seen = [_Look.at(mark, reach) for mark in marks]
    own = np.array([look.own for look in seen])
    usual = float(np.median(own))
    width = float(np.median([look.width for look in seen]))
    wide = max(2, round(_WIDE_GAP * width))
    torn = np.array([look.torn(wide) for look in seen])
    # The coverage of its way is meaningless for a stroke that is hardly longer than wide.
    covered = np.array([look.covered if look.way >= 2 * width else 1.0 for look in seen])
    flaws = np.zeros(len(library), np.uint8)
    # The most serious reason is written last, because it counts.
    flaws[_astray(np.array([look.offset for look in seen]), own, width)] = Flaw.ASTRAY
    flaws[1 - covered > _MAX_SKIPPED] = Flaw.SKIPPED
    porous = np.array([look.porous(max(1, round(_WIDE_PORE * width / 2))) for look in seen])
    flaws[(torn > _MAX_TORN) | (porous > _MAX_POROUS)] = Flaw.TORN
    flaws[np.array([look.foreign for look in seen]) > _MAX_FOREIGN * usual] = Flaw.TOUCHED
    flaws[(own < _MIN_PAINT * _expected_paint(library, own)) | (own == 0) | (covered < _MIN_COVERED)] = Flaw.EMPTY
    return flaws


@dataclass(frozen=True)
class _Mark:
    """Mark with its path.

    paint [rows, columns]: in [0, 1]
    away [rows, columns]: distance from the path in pixels
    path [k, 2]: (column, row)
    turns: True if the path may turn back and cross itself, as those of families do
    """

    paint: NDArray[np.float32]
    away: NDArray[np.float32]
    path: NDArray[np.float64]
    turns: bool = False

    @classmethod
    def of(cls, library: StrokeLibrary, index: int) -> "_Mark":
        row, column = library.origin_px
        pitch = library.metres_per_pixel
        fraction = np.linspace(0, 1, _PATH_POINTS)
        along, aside = library.length_m[index] * fraction, 3 * fraction * (1 - fraction) * library.bend_m[index]
        if library.path_m is not None:
            along, aside = library.path_m[index].astype(np.float64).T
        path = np.stack((column + along / pitch, row - aside / pitch), -1)
        bare = np.full(library.magnitude.shape[1:], 255, np.uint8)
        cv2.polylines(bare, [np.rint(16 * path).astype(np.int32)], False, 0, 1, cv2.LINE_8, 4)
        away = np.asarray(cv2.distanceTransform(bare, cv2.DIST_L2, 5), np.float32)
        return cls(library.magnitude[index].astype(np.float32) / 255, away, path, library.path_m is not None)

    def extent(self) -> float:
        """Returns the distance from the path in pixels that contains nearly all paint."""
        paint, away = self.paint.ravel(), self.away.ravel()
        order = np.argsort(away)
        total = np.cumsum(paint[order])
        return float(away[order[np.searchsorted(total, 0.95 * total[-1])]])


@dataclass(frozen=True)
class _Look:
    """Measurements of one mark.

    inked [rows, columns]: True at paint of the stroke itself
    own, foreign: paint of the stroke and of other things, in pixels of full paint
    way: pixels from start to end
    covered: share of the way with paint
    width: pixels across
    offset: (column, row) from the centre of the path to that of the paint
    turns: True if the path may turn back, so that gaps across it mean nothing
    """

    inked: NDArray[np.bool_]
    own: float
    foreign: float
    way: float
    covered: float
    width: float
    offset: tuple[float, float]
    turns: bool = False

    @classmethod
    def at(cls, mark: _Mark, reach: float) -> "_Look":
        near = mark.away <= reach
        # A patch of paint belongs to the stroke if any part of it is within reach of the path.
        _, patch = cv2.connectedComponents((mark.paint > _INKED / 2).astype(np.uint8), connectivity=8)
        belongs = np.isin(patch, np.unique(patch[near & (patch > 0)])) | near
        belongs &= mark.away <= 2 * reach  # excludes a neighbour that touches the stroke
        paint = np.where(belongs, mark.paint, 0)
        own = float(paint.sum())
        inked = paint > _INKED
        if mark.turns:
            return cls._along(mark, inked, paint, own)
        first, last = mark.path[0, 0], mark.path[-1, 0]
        margin = 0.1 * (last - first)
        across = inked[:, round(first + margin) : round(last - margin) + 1].sum(0)
        weight = paint / max(own, 1e-6)
        rows, columns = np.indices(paint.shape)
        offset = (
            float((weight * columns).sum() - mark.path[:, 0].mean()),
            float((weight * rows).sum() - mark.path[:, 1].mean()),
        )
        foreign = float(mark.paint.sum()) - own
        covered = float((across > 0).mean()) if len(across) else 0.0
        width = float(np.median(across[across > 0])) if across.any() else 0.0
        return cls(inked, own, foreign, last - first, covered, width, offset)

    @classmethod
    def _along(cls, mark: _Mark, inked: NDArray[np.bool_], paint: NDArray[np.float32], own: float) -> "_Look":
        """Returns the measurements of a mark whose path turns: along the path, instead of column by column."""
        rows, columns = np.indices(paint.shape)
        weight = paint / max(own, 1e-6)
        way = float(np.linalg.norm(np.diff(mark.path, axis=0), axis=1).sum())
        at = np.rint(mark.path).astype(int)
        inside = (at >= 0).all(1) & (at[:, 0] < paint.shape[1]) & (at[:, 1] < paint.shape[0])
        inner = cv2.distanceTransform(inked.astype(np.uint8), cv2.DIST_L2, 5)
        # Twice the distance to the edge, on the path; a brush that trails behind leaves the path a little.
        near = cv2.dilate(inner, np.ones((5, 5), np.uint8))
        wide = 2 * near[at[inside, 1], at[inside, 0]]
        covered = float((wide > 0).sum() / len(at))
        width = float(np.median(wide[wide > 0])) if (wide > 0).any() else 0.0
        drawn_path = np.where(mark.away <= max(1.0, width / 2), 1.0, 0.0)
        middle = drawn_path / max(drawn_path.sum(), 1e-6)
        offset = tuple(float((weight * axis).sum() - (middle * axis).sum()) for axis in (columns, rows))
        foreign = float(mark.paint.sum()) - own
        return cls(inked, own, foreign, way, covered, width, offset, turns=True)  # type: ignore[arg-type]

    def porous(self, radius: int) -> float:
        """Returns the share of the mark that is bare in spots smaller than `radius` pixels, as from a dry brush."""
        inked = self.inked.astype(np.uint8)
        disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
        closed = int(np.count_nonzero(cv2.morphologyEx(inked, cv2.MORPH_CLOSE, disc)))
        return 1 - int(np.count_nonzero(inked)) / closed if closed else 0.0

    def torn(self, wide: int) -> float:
        """Returns the area of gaps of at least `wide` pixels across the stroke, relative to the painted area.

        A path never turns back, so each column crosses it once.
        """
        painted = int(self.inked.sum())
        if painted == 0 or self.turns:
            return 0.0
        bare = 0
        for column in np.flatnonzero(self.inked.any(0)):
            gaps = np.diff(np.flatnonzero(self.inked[:, column])) - 1
            bare += int(gaps[gaps >= wide].sum())
        return bare / painted


def _expected_paint(library: StrokeLibrary, own: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the usual paint of strokes of these shapes in this library, pixels [n]."""
    usual = float(np.median(own))
    if len(library) < _FEWEST_TO_COMPARE or usual == 0:
        return np.full(len(library), usual)
    terms, weight, expected = _terms(library), np.ones(len(library)), np.full(len(library), usual)
    for _ in range(_ROUNDS):  # least absolute deviations, by repeated weighted least squares
        root = np.sqrt(weight)[:, None]
        expected = terms @ np.linalg.lstsq(root * terms, root[:, 0] * own, rcond=None)[0]
        weight = 1 / np.maximum(np.abs(own - expected), 0.01 * usual)
    return np.maximum(expected, 0.1 * usual)


def _astray(offset: NDArray[np.float64], own: NDArray[np.float64], width: float) -> NDArray[np.bool_]:
    """Returns the mask [n] of marks whose offset from the path differs from that of the others."""
    if len(offset) < _FEWEST_TO_COMPARE:
        return np.zeros(len(offset), np.bool_)
    beside = offset - np.median(offset[own > 0], axis=0)
    spread = 1.48 * np.median(np.abs(beside), axis=0)
    # If the strokes are very exact, a small deviation does not count.
    far = np.abs(beside) > np.maximum(_MAX_ASTRAY * spread, 0.2 * width)
    return np.asarray(far.any(1))


_FADED = 0.7  # of the paint of a full brush; important strokes are painted before
_FEWEST = 12  # strokes of a full brush, and the same number of others
# Flaws that a drying brush causes; strokes with other flaws are not used.
_DRY = (Flaw.NONE, Flaw.EMPTY, Flaw.TORN, Flaw.SKIPPED)


def estimate_dip(library: StrokeLibrary, width: float) -> Dip | None:
    """Returns the capacity of one dip from a library that was painted with fewer dips than strokes.

    width: width of the brush's widest mark in metres
    Returns None if the library has no `since_dip`, or too few strokes of a full or a used brush.

    Each stroke has a share of paint, relative to a full brush and its shape. A falling function of the painted
    area is fitted to these shares (isotonic regression). The dip ends where the function falls below 0.7, or at
    the end of the data.
    """
    from scipy.optimize import isotonic_regression  # slow to load

    if library.since_dip is None:
        return None
    usable = np.isin(judge(library), _DRY)
    full = usable & (library.since_dip == 0) & (judge(library) == Flaw.NONE)
    if full.sum() < _FEWEST or (usable & (library.since_dip > 0)).sum() < _FEWEST:
        return None
    paint, terms = library.magnitude.sum((1, 2), dtype=np.int64) / 255, _terms(library)
    known = np.linalg.lstsq(terms[full], paint[full], rcond=None)[0]
    share = paint / np.maximum(terms @ known, 0.1 * np.median(paint[full]))
    thickness, length, _ = library.shapes()
    until = library.since_dip + painted_area(length, thickness, width).double().numpy()
    order = np.argsort(until[usable])
    ends, shares = until[usable][order], share[usable][order]
    kept = isotonic_regression(shares.clip(0, 1.2), increasing=False).x
    lasting = np.flatnonzero(kept >= _FADED)
    if len(lasting) == 0:
        return None
    last = lasting[-1]
    return Dip(float(ends[last]), fades=float(max(0.0, 1 - kept[last])))


def _terms(library: StrokeLibrary) -> NDArray[np.float64]:
    """Returns features of the shapes of strokes, [n, 5]; the usual amount of paint is linear in them."""
    length, press, bend = library.length_m, library.thickness, np.abs(library.bend_m)
    return np.stack((np.ones_like(length), length, press, length * press, bend), 1).astype(np.float64)
