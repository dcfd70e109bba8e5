"""A stroke library: photographs of single strokes that the robot painted, cut out as magnitude maps."""

import zipfile
import zlib
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter import storage
from frida_painter.brush.kinds import Dip, painted_area
from frida_painter.errors import LibraryError
from frida_painter.frames import MapFrame

# What can be wrong with a recorded stroke, so that nobody should learn from it.


class Flaw(IntEnum):
    """Why a stroke of a library is dirty; its number stands in the library's file.

    EMPTY to ASTRAY show in the mark itself, MOVED to DISTURBED only in the photographs that it was
    cut out of.
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
        """The reason in a few words, for a contact sheet."""
        return _REASONS[self][0]

    @property
    def sentence(self) -> str:
        """The reason as part of a sentence: what is seen, and what it comes from."""
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


# Magnitude maps from one frame to another: as much paint per area, on other cells.


def resample(maps: Tensor, given: MapFrame, wanted: MapFrame) -> Tensor:
    """maps [n, rows, columns] on the cells of `given` -> on the cells of `wanted`; zero beyond the given ones.

    Along each axis: onto larger cells their mean over the area, onto smaller ones linear interpolation.
    """
    columns = _shares(given.left, given.pitch[0], given.columns, wanted.left, wanted.pitch[0], wanted.columns)
    rows = _shares(-given.top, given.pitch[1], given.rows, -wanted.top, wanted.pitch[1], wanted.rows)
    return rows.to(maps) @ maps @ columns.to(maps).T


def _shares(given_start: float, given_pitch: float, given_cells: int, start: float, pitch: float, cells: int) -> Tensor:
    """How much each given cell counts in each wanted one along one axis, [cells, given_cells]."""
    given_center = given_start + (torch.arange(given_cells, dtype=torch.float64) + 0.5) * given_pitch
    center = start + (torch.arange(cells, dtype=torch.float64) + 0.5) * pitch
    apart = (center[:, None] - given_center).abs()
    if pitch > given_pitch:
        overlap = (pitch + given_pitch) / 2 - apart
        return overlap.clamp(0, given_pitch) / pitch
    return (1 - apart / given_pitch).clamp(min=0)


MOST_STROKES = 20_000
MOST_BYTES = 2**31
_KEYS = ("magnitude", "length_m", "bend_m", "thickness", "metres_per_pixel", "origin_px", "recorded_index")
_OPTIONAL_KEYS = ("flaws", "since_dip")
_DAMAGED = (
    OSError,
    EOFError,
    ValueError,
    TypeError,
    KeyError,
    SyntaxError,
    RuntimeError,
    MemoryError,
    OverflowError,
    zipfile.BadZipFile,
    zlib.error,
)


@dataclass(frozen=True)
class StrokeLibrary:
    """n strokes and the marks that they left.

    magnitude [n, rows, columns] uint8: 255 full paint, 0 bare canvas, rectified to the canvas plane;
    length_m, bend_m [n] metres and thickness [n] in [0, 1]: what the robot was asked to paint, bends
    above 0 towards smaller rows; metres_per_pixel: scale of both axes; origin_px: (row, column) of
    the crop where each stroke was asked to start, heading towards larger columns;
    recorded_index [n]: order of recording; flaws [n] of `Flaw`: what is wrong with each stroke, None
    where nobody has judged them; since_dip [n]: square metres that the brush had painted since it was
    dipped, 0 for a full one, None where that is not known. Raises LibraryError where the parts cannot be true.
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

    def __post_init__(self) -> None:
        if self.magnitude.ndim != 3 or self.magnitude.dtype != np.uint8 or 0 in self.magnitude.shape:
            raise LibraryError(
                f"A stroke library has magnitude maps of shape {self.magnitude.shape} and kind {self.magnitude.dtype}; "
                "they are strokes x rows x columns of whole numbers from 0 to 255, and at least one."
            )
        n = len(self.magnitude)
        if n > MOST_STROKES:
            raise LibraryError(f"A stroke library has {n} strokes; it has at most {MOST_STROKES}.")
        if self.recorded_index.shape != (n,):
            raise LibraryError(f"A stroke library has {len(self.recorded_index)} recorded_index for {n} strokes.")
        if self.flaws is not None and (self.flaws.shape != (n,) or not (self.flaws <= max(Flaw)).all()):
            raise LibraryError(
                f"A stroke library has flaws that are not {n} numbers from 0 to {max(Flaw):d}; "
                "give a library that this version of `frida-painter strokes paint` wrote."
            )
        if self.since_dip is not None and not (
            self.since_dip.shape == (n,) and ((self.since_dip >= 0) & (self.since_dip <= 1)).all()
        ):
            raise LibraryError(
                f"A stroke library has since_dip that are not {n} areas from 0 to 1 m2; "
                "give a library that `frida-painter strokes paint` wrote."
            )
        ranges = {"length_m": (0.0, 1.0), "bend_m": (-1.0, 1.0), "thickness": (0.0, 1.0)}
        for name, (least, most) in ranges.items():
            values = getattr(self, name)
            if values.shape != (n,) or not ((values >= least) & (values <= most)).all():
                raise LibraryError(
                    f"A stroke library has {name} that are not {n} numbers from {least:g} to {most:g}; "
                    "give a library that `frida-painter strokes paint` wrote."
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
        """Some of the strokes."""
        return StrokeLibrary(
            self.magnitude[index],
            self.length_m[index],
            self.bend_m[index],
            self.thickness[index],
            self.metres_per_pixel,
            self.origin_px,
            self.recorded_index[index],
            None if self.flaws is None else self.flaws[index],
            None if self.since_dip is None else self.since_dip[index],
        )

    @property
    def frame(self) -> MapFrame:
        """The rectangle that the crops cover, with the cells that they have."""
        _, rows, columns = self.magnitude.shape
        row, column = self.origin_px
        pitch = self.metres_per_pixel
        left, top = -(column + 0.5) * pitch, (row + 0.5) * pitch
        return MapFrame(left, left + columns * pitch, top - rows * pitch, top, rows, columns)

    def maps(self, frame: MapFrame) -> Tensor:
        """The marks on the cells of a stroke model's frame, [n, rows, columns] in [0, 1]; bare beyond the crops."""
        return torch.cat([resample(torch.from_numpy(part).float() / 255, self.frame, frame) for part in self._parts()])

    def shapes(self) -> tuple[Tensor, Tensor, Tensor]:
        """Thickness, length and bend [n] of the strokes, float32, as a stroke model takes them."""
        return tuple(torch.from_numpy(np.asarray(part)) for part in (self.thickness, self.length_m, self.bend_m))  # type: ignore[return-value]

    def _parts(self) -> list[NDArray[np.uint8]]:
        return np.array_split(self.magnitude, -(-len(self) // 32))

    def save(self, path: Path) -> None:
        """Writes an .npz, atomically. Raises StorageError."""
        known = {"flaws": self.flaws, "since_dip": self.since_dip}
        optional: dict[str, Any] = {name: part for name, part in known.items() if part is not None}
        with storage.replacing(path) as temporary, temporary.open("wb") as file:
            np.savez_compressed(
                file,
                magnitude=self.magnitude,
                length_m=self.length_m,
                bend_m=self.bend_m,
                thickness=self.thickness,
                metres_per_pixel=np.float64(self.metres_per_pixel),
                origin_px=np.array(self.origin_px, np.float32),
                recorded_index=self.recorded_index,
                **optional,
            )

    @classmethod
    def load(cls, path: Path) -> "StrokeLibrary":
        """Reads an .npz and checks all of it; a pickle inside is never run. Raises LibraryError."""
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
        try:
            return cls(
                magnitude=arrays["magnitude"].astype(np.uint8),
                length_m=arrays["length_m"].astype(np.float32),
                bend_m=arrays["bend_m"].astype(np.float32),
                thickness=arrays["thickness"].astype(np.float32),
                metres_per_pixel=float(arrays["metres_per_pixel"].ravel()[0]),
                origin_px=(row, column),
                recorded_index=arrays["recorded_index"].astype(np.int32),
                flaws=arrays["flaws"].astype(np.uint8) if "flaws" in arrays else None,
                since_dip=arrays["since_dip"].astype(np.float32) if "since_dip" in arrays else None,
            )
        except LibraryError as cause:
            raise LibraryError(f"{path}: {cause}") from cause


def _read(path: Path) -> dict[str, NDArray[np.generic]]:
    """The arrays of a library's file by name. Raises LibraryError."""
    try:
        with storage.opened(path, "a stroke library (.npz)", MOST_BYTES, LibraryError) as file:
            with zipfile.ZipFile(file) as archive:
                unpacked = sum(member.file_size for member in archive.infolist())
            if unpacked > MOST_BYTES:
                raise LibraryError(f"{path} unpacks to {unpacked} bytes; a stroke library has at most {MOST_BYTES}.")
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


# Telling good strokes of a library from dirty ones by their marks alone.
#
# A stroke is compared with where its path lies and with the other strokes of the library; no figure
# here belongs to a brush. Statistics are medians, so that they hold while most strokes are good.

_INKED = 0.3
"""Magnitude from which on a cell counts as painted."""
_LEAST_PAINT = 0.35  # of what strokes of its shape have
_LEAST_COVERED = 0.2  # of the way
_MOST_FOREIGN = 0.03  # of the paint of a usual stroke
_MOST_TORN = 0.09  # of the mark's own area
_WIDE_GAP = 0.18  # of the width of a usual mark
_MOST_POROUS = 0.15  # of the mark's area when its pores are closed
_WIDE_PORE = 0.25  # of the width of a usual mark
_MOST_SKIPPED = 0.05  # of the way
_MOST_ASTRAY = 7.0  # standard deviations
_FEWEST_TO_COMPARE = 12
_PATH_POINTS = 48
_ROUNDS = 20


def judge(library: StrokeLibrary) -> NDArray[np.uint8]:
    """What is wrong with each stroke, [n] of `Flaw`.

    A library that was judged when it was painted keeps that judgement; of others the marks tell.
    """
    if library.flaws is not None:
        return library.flaws
    return judge_marks(library)


def clean(library: StrokeLibrary) -> StrokeLibrary:
    """The strokes to learn from: those without a flaw. Raises LibraryError where none is left."""
    return library[judge(library) == Flaw.NONE]


def judge_marks(library: StrokeLibrary) -> NDArray[np.uint8]:
    """What the marks tell about each stroke, [n] of `Flaw`, whatever was known before."""
    marks = [_Mark.of(library, index) for index in range(len(library))]
    reach = _reach(marks)
    seen = [_Look.at(mark, reach) for mark in marks]
    own = np.array([look.own for look in seen])
    usual = float(np.median(own))
    width = float(np.median([look.width for look in seen]))
    wide = max(2, round(_WIDE_GAP * width))
    torn = np.array([look.torn(wide) for look in seen])
    # Of a stroke that is hardly longer than wide, the way says nothing.
    covered = np.array([look.covered if look.way >= 2 * width else 1.0 for look in seen])
    flaws = np.zeros(len(library), np.uint8)
    # The gravest reason is named, hence written last.
    flaws[_astray(np.array([look.offset for look in seen]), own, width)] = Flaw.ASTRAY
    flaws[1 - covered > _MOST_SKIPPED] = Flaw.SKIPPED
    porous = np.array([look.porous(max(1, round(_WIDE_PORE * width / 2))) for look in seen])
    flaws[(torn > _MOST_TORN) | (porous > _MOST_POROUS)] = Flaw.TORN
    flaws[np.array([look.foreign for look in seen]) > _MOST_FOREIGN * usual] = Flaw.TOUCHED
    flaws[(own < _LEAST_PAINT * _expected(library, own)) | (own == 0) | (covered < _LEAST_COVERED)] = Flaw.EMPTY
    return flaws


@dataclass(frozen=True)
class _Mark:
    """A mark and its path.

    paint [rows, columns] in [0, 1]; away [rows, columns]: pixels from the path; path [k, 2]: its
    (column, row).
    """

    paint: NDArray[np.float32]
    away: NDArray[np.float32]
    path: NDArray[np.float64]

    @classmethod
    def of(cls, library: StrokeLibrary, index: int) -> "_Mark":
        row, column = library.origin_px
        pitch = library.metres_per_pixel
        fraction = np.linspace(0, 1, _PATH_POINTS)
        along, aside = library.length_m[index] * fraction, 3 * fraction * (1 - fraction) * library.bend_m[index]
        path = np.stack((column + along / pitch, row - aside / pitch), -1)
        bare = np.full(library.magnitude.shape[1:], 255, np.uint8)
        import cv2  # which a planner does not load

        cv2.polylines(bare, [np.rint(16 * path).astype(np.int32)], False, 0, 1, cv2.LINE_8, 4)
        away = np.asarray(cv2.distanceTransform(bare, cv2.DIST_L2, 5), np.float32)
        return cls(library.magnitude[index].astype(np.float32) / 255, away, path)

    def extent(self) -> float:
        """Within how many pixels of the path nearly all paint lies."""
        paint, away = self.paint.ravel(), self.away.ravel()
        order = np.argsort(away)
        total = np.cumsum(paint[order])
        return float(away[order[np.searchsorted(total, 0.95 * total[-1])]])


@dataclass(frozen=True)
class _Look:
    """What is seen of one mark.

    inked [rows, columns]: where the stroke itself left paint; own, foreign: paint of the stroke and of
    something else, in pixels of full paint; way: pixels from start to end; covered: share of the way
    that has paint; width: pixels across; offset (column, row): of the paint's centre from the path's.
    """

    inked: NDArray[np.bool_]
    own: float
    foreign: float
    way: float
    covered: float
    width: float
    offset: tuple[float, float]

    @classmethod
    def at(cls, mark: _Mark, reach: float) -> "_Look":
        near = mark.away <= reach
        # A patch of paint belongs to the stroke where any of it is within reach of the path.
        import cv2  # which a planner does not load

        _, patch = cv2.connectedComponents((mark.paint > _INKED / 2).astype(np.uint8), connectivity=8)
        belongs = np.isin(patch, np.unique(patch[near & (patch > 0)])) | near
        belongs &= mark.away <= 2 * reach  # a neighbour that touches the stroke is no part of it
        paint = np.where(belongs, mark.paint, 0)
        own = float(paint.sum())
        inked = paint > _INKED
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

    def porous(self, radius: int) -> float:
        """The share of the mark that is bare in spots of less than `radius` pixels: dry brush."""
        inked = self.inked.astype(np.uint8)
        import cv2  # which a planner does not load

        disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
        closed = int(np.count_nonzero(cv2.morphologyEx(inked, cv2.MORPH_CLOSE, disc)))
        return 1 - int(np.count_nonzero(inked)) / closed if closed else 0.0

    def torn(self, wide: int) -> float:
        """Area of gaps of at least `wide` pixels across the stroke, as a share of what is painted.

        A path never turns back, so that each column crosses it once.
        """
        painted = int(self.inked.sum())
        if painted == 0:
            return 0.0
        bare = 0
        for column in np.flatnonzero(self.inked.any(0)):
            gaps = np.diff(np.flatnonzero(self.inked[:, column])) - 1
            bare += int(gaps[gaps >= wide].sum())
        return bare / painted


def _reach(marks: list[_Mark]) -> float:
    """How many pixels from its path a stroke's own paint lies, generously."""
    extents = [mark.extent() for mark in marks if mark.paint.any()]
    return 1.6 * float(np.median(extents)) + 3 if extents else 3.0


def _expected(library: StrokeLibrary, own: NDArray[np.float64]) -> NDArray[np.float64]:
    """The paint that strokes of these shapes have in this library, pixels, [n]."""
    usual = float(np.median(own))
    if len(library) < _FEWEST_TO_COMPARE or usual == 0:
        return np.full(len(library), usual)
    length, bend, press = library.length_m, np.abs(library.bend_m), library.thickness
    terms = np.stack((np.ones_like(length), length, press, length * press, bend), 1).astype(np.float64)
    weight = np.ones(len(library))
    expected = np.full(len(library), usual)
    for _ in range(_ROUNDS):  # least absolute deviations, by least squares weighed again and again
        root = np.sqrt(weight)[:, None]
        expected = terms @ np.linalg.lstsq(root * terms, root[:, 0] * own, rcond=None)[0]
        weight = 1 / np.maximum(np.abs(own - expected), 0.01 * usual)
    return np.maximum(expected, 0.1 * usual)


def _astray(offset: NDArray[np.float64], own: NDArray[np.float64], width: float) -> NDArray[np.bool_]:
    """Which marks lie far from where the others lie beside their paths, [n]."""
    if len(offset) < _FEWEST_TO_COMPARE:
        return np.zeros(len(offset), np.bool_)
    beside = offset - np.median(offset[own > 0], axis=0)
    spread = 1.48 * np.median(np.abs(beside), axis=0)
    # Where the strokes lie as if on rails, a small deviation is none.
    far = np.abs(beside) > np.maximum(_MOST_ASTRAY * spread, 0.2 * width)
    return np.asarray(far.any(1))


# What one dip of a brush paints, and how marks fade meanwhile, as far as a stroke library shows it.

_FADED = 0.7  # of the paint that a stroke of a full brush has; those that matter are painted before
_FEWEST = 12  # strokes of a full brush, and as many of others
# What a brush that runs out does to a stroke; other flaws tell nothing of it.
_DRY = (Flaw.NONE, Flaw.EMPTY, Flaw.TORN, Flaw.SKIPPED)


def dip_shown(library: StrokeLibrary, width: float) -> Dip | None:
    """What one dip paints before marks are faint, as a library shows that was painted with fewer dips than strokes.

    width: of the brush's widest mark, metres. None where the library does not tell how much had been
    painted since the dip before each stroke, or has too few strokes of a brush that was no longer full.
    What a stroke has of the paint that the full brush leaves in strokes of its shape is fitted, over what
    was painted until its end, by what can only fall (isotonic regression); a dip is over where that falls
    below 70 %, or where the library ends.
    """
    from sklearn.isotonic import IsotonicRegression  # slow to load

    if library.since_dip is None:
        return None
    usable = np.isin(judge(library), _DRY)
    full = usable & (library.since_dip == 0) & (judge(library) == Flaw.NONE)
    if full.sum() < _FEWEST or (usable & (library.since_dip > 0)).sum() < _FEWEST:
        return None
    share = _paint(library) / _usual_paint(library, full)
    thickness, length, _ = library.shapes()
    until = library.since_dip + painted_area(length, thickness, width).double().numpy()
    order = np.argsort(until[usable])
    ends, shares = until[usable][order], share[usable][order]
    kept = IsotonicRegression(increasing=False).fit_transform(ends, shares.clip(0, 1.2))
    lasting = np.flatnonzero(kept >= _FADED)
    if len(lasting) == 0:
        return None
    last = lasting[-1]
    return Dip(float(ends[last]), fades=float(max(0.0, 1 - kept[last])))


def _paint(library: StrokeLibrary) -> NDArray[np.float64]:
    """Paint in each mark, in pixels of full paint, [n]."""
    return library.magnitude.sum((1, 2), dtype=np.int64) / 255


def _usual_paint(library: StrokeLibrary, full: NDArray[np.bool_]) -> NDArray[np.float64]:
    """The paint that a full brush leaves in strokes of these shapes, [n]; full [n]: which ones it painted."""
    length, press, bend = library.length_m, library.thickness, np.abs(library.bend_m)
    terms = np.stack((np.ones_like(length), length, press, length * press, bend), 1).astype(np.float64)
    paint = _paint(library)
    known = np.linalg.lstsq(terms[full], paint[full], rcond=None)[0]
    return np.asarray(np.maximum(terms @ known, 0.1 * np.median(paint[full])))
