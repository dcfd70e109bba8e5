"""The strokes procedure: the robot paints single strokes, and the camera records their marks.

Paper, "Real Data to Simulation": the stroke model is learned from strokes of random thickness, length and bend,
black on white paper, several to a sheet. Dirty strokes are kept and flagged.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter import storage, tensor_file
from frida_painter.brush import MAX_BETWEEN_REFILLS, MAX_STROKES
from frida_painter.brush.kinds import BrushKind
from frida_painter.brush.library import Flaw, StrokeLibrary, clean, estimate_dip, judge, judge_marks
from frida_painter.calibration import Calibration, LearnedFile
from frida_painter.easel.dialogue import Procedure
from frida_painter.errors import CalibrationError, ConfigError, FrameRejected, LibraryError
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.motion import Motion
from frida_painter.sheet import INK, LINE, PAPER, SOFT, WARNING, Grid, Sheet, font
from frida_painter_calibration.procedures.paper import (
    Crop,
    EaselAccess,
    Paper,
    Print,
    Shapes,
    ask_for_paper,
    fill_with_black,
)
from frida_painter_calibration.teaching.bezier import BezierStroke, RibbonShape, fit_bezier

# Recordings: stroke libraries in progress, with every stroke on the disk as soon as it is photographed.
# The strokes are in a folder beside the library until it is complete. After a crash the same call continues.

_FORMAT = "frida-painter recording"
_VERSION = 1


@dataclass(frozen=True)
class RecordingSettings:
    """Settings that identify a recording.

    easel: name of the easel
    kind: kind of brush
    count: number of strokes
    seed: of the random shapes
    refill_every: strokes per dip
    """

    easel: str
    kind: BrushKind
    count: int
    seed: int
    refill_every: int

    def record(self) -> dict[str, object]:
        """Returns the settings as plain values."""
        limits = self.kind.limits
        return {
            "format": _FORMAT,
            "version": _VERSION,
            "easel": self.easel,
            "brush": self.kind.name,
            "width": self.kind.width,
            "lengths": list(limits.length),
            "bends": list(limits.bend),
            "count": self.count,
            "seed": self.seed,
            "refill_every": self.refill_every,
            **({} if limits.family is None else {"family": limits.family.digest}),
        }


class Recording:
    """Strokes of one recording that are painted so far, by number.

    folder: storage of the strokes; None to keep them in memory only
    shape: rows and columns of a mark

    Raises ConfigError if the folder has strokes of another recording, StorageError if it cannot be written or is
    damaged.
    """

    def __init__(self, folder: Path | None, settings: RecordingSettings, shape: tuple[int, int]) -> None:
        self.settings = settings
        self._folder = folder
        self._shape = shape
        self.prints: dict[int, Print] = {}
        if folder is not None and (folder / "order.json").exists():
            self._require_same(folder)
            self.prints = {
                number: kept
                for number in range(settings.count)
                if (kept := self._load_kept(self._path(folder, number)))
            }
        elif folder is not None:
            storage.require_unused(folder)
            storage.write_json(folder / "order.json", settings.record())

    @property
    def missing(self) -> list[int]:
        """Numbers of the strokes that are still to be painted."""
        return [number for number in range(self.settings.count) if number not in self.prints]

    def keep(self, number: int, stroke: Print) -> None:
        """Adds a stroke, stored on the disk first. Raises StorageError."""
        if self._folder is not None:
            mark = {"mark": torch.from_numpy(stroke.mark)}
            words = {"flaw": stroke.flaw.name, "since_dip": repr(stroke.since_dip)}
            tensor_file.write_tensors(self._path(self._folder, number), mark, words)
        self.prints[number] = stroke

    def discard(self, numbers: list[int]) -> None:
        """Forgets strokes that are to be painted again."""
        for number in numbers:
            del self.prints[number]
            if self._folder is not None:
                self._path(self._folder, number).unlink(missing_ok=True)

    def clear_away(self) -> None:
        """Removes the folder after the library is written."""
        if self._folder is None:
            return
        for number in range(self.settings.count):
            self._path(self._folder, number).unlink(missing_ok=True)
        # The settings last: without them the strokes could not be identified.
        (self._folder / "order.json").unlink(missing_ok=True)
        if not any(self._folder.iterdir()):
            self._folder.rmdir()

    @staticmethod
    def _path(folder: Path, number: int) -> Path:
        return folder / f"stroke-{number:05d}.safetensors"

    def _require_same(self, folder: Path) -> None:
        found = storage.read_json(folder / "order.json", "the settings of a recording")
        wanted = self.settings.record()
        differing = [name for name in wanted if found.get(name) != wanted[name]]
        if differing:
            told = ", ".join(f"{name} {found.get(name)} and not {wanted[name]}" for name in differing)
            raise ConfigError(
                f"{folder} holds the strokes of a recording that was broken off, of another kind: {told}. Ask for the "
                "same again to finish it, choose another file with --out, or remove that folder."
            )

    def _load_kept(self, path: Path) -> Print | None:
        """Returns a stored stroke; None if it is missing or damaged, and is then painted again."""
        if not path.exists():
            return None
        try:
            tensors, words = tensor_file.read_tensors(path, "a recorded stroke", LibraryError)
            mark, flaw, since_dip = tensors["mark"].numpy(), Flaw[words["flaw"]], float(words["since_dip"])
        except (LibraryError, KeyError, ValueError):
            return None
        return Print(mark, flaw, since_dip) if mark.shape == self._shape and mark.dtype == np.uint8 else None


# The contact sheet of a stroke library: every stroke on one page, the dirty ones with the reason.

MAX_SHOWN = 600
_WIDTH = 1800
_MARGIN, _GAP = 44, 10
_HEAD = 112
_CAPTION = 18
_SPOILED = (253, 236, 228)


def contact_sheet(library: StrokeLibrary, title: str) -> Tensor:
    """Returns the strokes in the order of their recording, sRGB [3, H, 1800] in [0, 1].

    A dirty stroke has red paper and the reason below. Of more than 600 strokes it shows all dirty ones first, and
    as many others as fit.
    """
    flaws = judge(library)
    shown = _chosen(flaws)
    shown = shown[np.argsort(library.recorded_index[shown], kind="stable")]
    grid = _cells(len(shown), *library.magnitude.shape[1:])
    sheet = Sheet(_WIDTH, grid.bottom(len(shown)) + _CAPTION + _MARGIN)
    _head(sheet, flaws, len(shown), title)
    for index, (left, top) in zip(shown, grid.corners(len(shown)), strict=True):
        flaw = Flaw(flaws[index])
        sheet.paste(_cell(library.magnitude[index], grid, flaw), (left, top))
        frame = (left - 1, top - 1, left + grid.width, top + grid.height)
        sheet.draw.rectangle(frame, outline=LINE if flaw is Flaw.NONE else WARNING, width=1)
        _caption(sheet, library.recorded_index[index], flaw, left, top + grid.height + 3, grid.width)
    return sheet.tensor()


def _cells(count: int, rows: int, columns: int) -> Grid:
    """Returns cells from 96 to 260 pixels wide for `count` marks of this shape, so that the page is about square."""
    room = _WIDTH - 2 * _MARGIN
    aspect = rows / columns
    wanted = np.sqrt(room * room / max(count, 1) / max(aspect, 0.2))
    across = round(room / float(np.clip(wanted, 96, 260)))
    grid = Grid.divide(room, _MARGIN, _HEAD, across, 0, across=_GAP, down=_CAPTION + _GAP)
    return replace(grid, height=max(24, round(grid.width * aspect)))


def _chosen(flaws: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Returns the indices of the strokes to show."""
    if len(flaws) <= MAX_SHOWN:
        return np.arange(len(flaws))
    dirty = np.flatnonzero(flaws)[:MAX_SHOWN]
    clean = np.flatnonzero(flaws == Flaw.NONE)
    some = clean[np.linspace(0, len(clean) - 1, MAX_SHOWN - len(dirty)).round().astype(int)] if len(clean) else clean
    return np.unique(np.concatenate([dirty, some]))


def _head(sheet: Sheet, flaws: NDArray[np.uint8], shown: int, title: str) -> None:
    sheet.text((_MARGIN, 26), title, 34, INK)
    counts = Counter(Flaw(flaw) for flaw in flaws if flaw)
    dirty = sum(counts.values())
    clean = f"{len(flaws) - dirty} of {len(flaws)} strokes are clean"
    if shown < len(flaws):
        clean += f" ({shown} are shown)"
    sheet.text((_MARGIN, 72), clean + ("." if not dirty else "; left out: "), 20, SOFT)
    if dirty:
        reasons = ", ".join(f"{count} {flaw.words}" for flaw, count in counts.most_common())
        start = _MARGIN + font(20).getlength(clean + "; left out: ")
        sheet.text((start, 72), reasons, 20, WARNING)


def _caption(sheet: Sheet, number: int, flaw: Flaw, left: int, top: int, width: int) -> None:
    sheet.text((left, top), str(number), 12, SOFT)
    if flaw is not Flaw.NONE:
        sheet.text((left + width, top), flaw.words, 12, WARNING, "ra")


def _cell(mark: NDArray[np.uint8], grid: Grid, flaw: Flaw) -> NDArray[np.uint8]:
    """Returns a mark as black paint on paper, [height, width, 3]."""
    smaller = grid.width < mark.shape[1]
    size = (grid.width, grid.height)
    paint = cv2.resize(mark, size, interpolation=cv2.INTER_AREA if smaller else cv2.INTER_LINEAR)[..., None] / 255.0
    paper = PAPER if flaw is Flaw.NONE else _SPOILED
    return np.rint((1 - paint) * paper + paint * np.array(INK)).astype(np.uint8)


_MAX_DIRTY_RUNNING = 8
_MIN_CLEAN = 0.5
_MIN_PAINT = 0.1  # share of length times brush width; less counts as an empty stroke
_FIT_STEPS = 60
_TRIES = 3
_PATH_POINTS = 193  # of the path of a stroke of a family


@dataclass(frozen=True)
class StrokesProgress:
    """Progress of the strokes procedure: one stroke is painted and photographed.

    done, of: number of strokes so far, and in total
    sheet: number of the sheet in this call, from 1
    flaw: of the stroke
    """

    done: int
    of: int
    sheet: int
    flaw: Flaw


@dataclass(frozen=True)
class StrokesFinding:
    """Result of the strokes procedure: a judged stroke library. Implements dialogue.Finding.

    file: of the library; None if it was not saved
    """

    kind: BrushKind
    library: StrokeLibrary
    file: LearnedFile | None

    @property
    def sentence(self) -> str:
        """Number of strokes, the reasons for omitted ones, and the capacity of a dip if it is visible."""
        assert self.library.flaws is not None
        counts = Counter(Flaw(flaw) for flaw in self.library.flaws if flaw)
        dirty = sum(counts.values())
        reasons = ", ".join(f"{count} {flaw.words}" for flaw, count in counts.most_common())
        left_out = f"; {dirty} {'is' if dirty == 1 else 'are'} left out ({reasons})" if dirty else ", all of them clean"
        dip = estimate_dip(self.library, self.kind.width)
        shown = "" if dip is None else f"; one dip paints {dip}"
        where = f": {self.file.path}" if self.file else ""
        return f"{len(self.library)} strokes of brush {self.kind.name}{left_out}{shown}{where}"

    @property
    def picture(self) -> Tensor:
        """Contact sheet."""
        return contact_sheet(self.library, f"Strokes of the {self.kind.name} brush")

    def residual(self) -> float:
        """Returns the residual of the analytic stroke model: the mean absolute error of its magnitude maps.

        The model is fitted to the clean strokes, which takes some seconds. A learned stroke model has to be better.
        """
        kind, frame = self.kind, self.kind.frame.resize(self.kind.frame.rows // 2, self.kind.frame.columns // 2)
        model = BezierStroke(kind.name, frame, kind.limits, RibbonShape.typical(kind.width))
        return fit_bezier(model, clean(self.library), steps=_FIT_STEPS)

    def enter(self, record: Calibration) -> Calibration:
        """Returns the calibration with this library. Raises CalibrationError if it was not saved."""
        if self.file is None:
            raise CalibrationError("The stroke library was not saved; give a file for it, and repeat strokes.")
        return record.with_strokes(self.file, residual=self.residual())


def strokes(
    easel: Easel,
    kind: BrushKind,
    out: Path | None = None,
    *,
    count: int = 200,
    seed: int = 0,
    refill_every: int = 1,
    notify: Callable[[StrokesProgress], None] | None = None,
) -> Procedure[StrokesFinding]:
    """Paints strokes drawn uniformly from the brush's limits, and cuts out their marks.

    easel: with a calibrated placement; otherwise its error is learned with the brush
    kind: kind of brush
    out: library to write (.npz); the strokes of an unfinished library are stored beside it, and a call with the
        same arguments continues
    count: number of strokes
    seed: of the random shapes
    refill_every: strokes per dip
    notify: called after each stroke

    The procedure asks for fresh paper whenever a sheet is used up. It keeps the painted strokes after an error.
    Raises ConfigError if an argument is out of range, the paper is too small for one stroke, or another recording
    is unfinished there.
    Raises CalibrationError if most strokes are dirty, FrameRejected if the camera cannot see the paper well,
    RobotError, CameraError and their subclasses.
    """
    _check(count, refill_every)
    shapes = Shapes.sample(kind, count, seed)
    crop = Crop.covering(kind.frame)
    settings = RecordingSettings(easel.calibration.easel, kind, count, seed, refill_every)
    recording = Recording(unfinished_folder(out) if out else None, settings, crop.shape)
    access = EaselAccess(easel)
    paper: Paper | None = None
    sheets, on_brush, since_dip = 0, 0, 0.0
    running: list[int] = []  # the latest strokes, if they are dirty
    for number in recording.missing:
        if paper is None:
            fill_with_black(easel)
        if paper is None or paper.is_used_up:
            paper = yield from _fresh_paper(access, kind, paper, len(recording.prints))
            sheets, on_brush = sheets + 1, 0
        since_dip = 0.0 if on_brush == 0 else since_dip
        stroke = replace(paper.paint(shapes[number], refill=on_brush == 0), since_dip=since_dip)
        on_brush = (on_brush + 1) % refill_every
        since_dip += float(kind.area(shapes[number].strokes(torch.zeros(1, 2))))
        recording.keep(number, stroke)
        flaw = stroke.flaw or _seems_empty(stroke, shapes[number], kind, crop.pitch)
        running = [*running, number] if flaw and flaw is not Flaw.MOVED else []
        if notify is not None:
            notify(StrokesProgress(len(recording.prints), count, sheets, flaw))
        if len(running) >= _MAX_DIRTY_RUNNING:
            recording.discard(running)
            raise CalibrationError(
                f"The last {len(running)} strokes are all dirty; of the last one: {flaw.sentence}. Look at paint, "
                f"brush, paper, camera and light, then repeat strokes; {len(recording.prints)} strokes are kept."
            )
    if paper is not None:
        motion = Motion(easel.workspace, easel.calibration)
        access.perform((motion.rinse(), motion.wipe()))  # paint must not dry in the brush
    return _finding(kind, shapes, crop, recording, out)


def unfinished_folder(out: Path) -> Path:
    """Returns the folder of an unfinished library."""
    return out.with_name(out.name + ".unfinished")


def _check(count: int, refill_every: int) -> None:
    if not 1 <= count <= MAX_STROKES:
        raise ConfigError(
            f"{count} strokes were asked for the library; it takes 1 to {MAX_STROKES}, and about 200 are enough."
        )
    if not 1 <= refill_every <= MAX_BETWEEN_REFILLS:
        raise ConfigError(
            f"A refill every {refill_every} strokes was asked for; allowed is 1 to {MAX_BETWEEN_REFILLS}, and what "
            "a brushful paints is learned best with 1."
        )


def _fresh_paper(access: EaselAccess, kind: BrushKind, last: Paper | None, kept: int) -> Procedure[Paper]:
    """Asks for a bare sheet until one is in place, and returns it."""
    easel = access.easel
    moved = last.moved * 1000 if last is not None else 0.0
    why = f"The paper moved by {moved:.1f} mm, so it is given up. " if moved else ""
    for attempt in range(_TRIES):
        yield from ask_for_paper(
            easel,
            f"{why}Put a fresh white paper of {easel.canvas} on the easel, just where the canvas was calibrated, and "
            "black paint into the first well. Is it there?",
            f"No fresh paper was put on the easel; {kept} strokes are kept, and strokes goes on from there when it is "
            "repeated.",
        )
        try:
            return Paper(access, kind)
        except (CalibrationError, FrameRejected) as trouble:
            if attempt == _TRIES - 1:
                raise
            why = f"{trouble} "
    raise AssertionError("the last try returns or raises")


def _seems_empty(stroke: Print, shape: Shapes, kind: BrushKind, pitch: float) -> Flaw:
    """Returns Flaw.EMPTY if there is almost no paint, judged without the other strokes."""
    area = float(stroke.mark.sum(dtype=np.int64)) / 255 * pitch**2
    least = _MIN_PAINT * kind.width * float(shape.strokes(torch.zeros(1, 2)).way())
    return Flaw.EMPTY if area < least * (0.2 + 0.8 * float(shape.thickness)) else Flaw.NONE


def _taught(shapes: Shapes) -> tuple[NDArray[np.float32] | None, NDArray[np.float32] | None]:
    """Returns codes and paths of strokes of a family for their library; None for plain strokes."""
    if shapes.taught is None:
        return None, None
    strokes = shapes.strokes(torch.zeros(len(shapes.length), 2))
    path = strokes.path(torch.linspace(0, 1, _PATH_POINTS))
    return shapes.taught.code.numpy(), path.numpy()


def _finding(
    kind: BrushKind, shapes: Shapes, crop: Crop, recording: Recording, out: Path | None
) -> StrokesFinding:  # fmt: skip
    count = recording.settings.count
    prints = [recording.prints[number] for number in range(count)]
    code, path = _taught(shapes)
    library = StrokeLibrary(
        magnitude=np.stack([stroke.mark for stroke in prints]),
        length_m=shapes.length.numpy(),
        bend_m=shapes.bend.numpy(),
        thickness=shapes.thickness.numpy(),
        metres_per_pixel=crop.pitch,
        origin_px=(float(crop.above), float(crop.left)),
        recorded_index=np.arange(count, dtype=np.int32),
        since_dip=np.array([stroke.since_dip for stroke in prints], np.float32),
        code=code,
        path_m=path,
    )
    seen = np.array([stroke.flaw for stroke in prints], np.uint8)
    library = replace(library, flaws=np.where(seen > 0, seen, judge_marks(library)).astype(np.uint8))
    file = None
    if out is not None:
        library.save(out)
        file = LearnedFile(str(out), storage.sha256(out, "the stroke library"))
        recording.clear_away()
    finding = StrokesFinding(kind, library, file)
    share = float((library.flaws == Flaw.NONE).mean()) if library.flaws is not None else 0.0
    if not share >= _MIN_CLEAN:
        raise CalibrationError(
            f"Most strokes are dirty: {finding.sentence}. Nothing is learned from them; look at the contact sheet "
            "(`frida-painter strokes inspect`), mend what spoils them, and repeat strokes."
        )
    return finding
