"""The strokes procedure: the robot paints single strokes, and the camera records their marks.

Paper, "Real Data to Simulation": the stroke model is learned from strokes of random thickness, length and bend,
black on white paper, several to a sheet. Dirty strokes are kept and flagged.
"""

from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.brush import MAX_BETWEEN_REFILLS, MAX_STROKES
from frida_painter.brush.kinds import BrushKind
from frida_painter.brush.library import Flaw, StrokeLibrary, estimate_dip, judge, judge_marks
from frida_painter.calibration import LearnedFile
from frida_painter.easel.dialogue import Procedure
from frida_painter.errors import CalibrationError, ConfigError, FrameRejected, LibraryError
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.motion import Motion
from frida_painter.strokes.strokes import Strokes
from frida_painter.system import storage, tensor_file
from frida_painter.system.sheet import INK, LINE, PAPER, SOFT, WARNING, Grid, Sheet, font
from frida_painter_calibration.procedures.paper import (
    Crop,
    EaselAccess,
    Paper,
    Print,
    ask_for_paper,
    fill_with_black,
    sample_strokes,
)

_MAX_DIRTY_RUNNING = 8
_MIN_CLEAN = 0.5
_MIN_PAINT = 0.1  # share of length times brush width; less counts as an empty stroke
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
class RecordedStrokes:
    """Result of the strokes procedure: a judged stroke library, to learn a stroke model from.

    file: of the library; None if it was not saved
    sentence: result in plain words
    """

    library: StrokeLibrary
    file: LearnedFile | None
    sentence: str


def strokes(
    easel: Easel,
    kind: BrushKind,
    out: Path | None = None,
    *,
    count: int = 200,
    seed: int = 0,
    refill_every: int = 1,
    notify: Callable[[StrokesProgress], None] = lambda progress: None,
) -> Procedure[RecordedStrokes]:
    """Paints strokes drawn uniformly from the brush's limits, and cuts out their marks.

    easel: with a calibrated placement; otherwise its error is learned with the brush
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
    if not 1 <= count <= MAX_STROKES:
        raise ConfigError(
            f"{count} strokes were asked for the library; it takes 1 to {MAX_STROKES}, and about 200 are enough."
        )
    if not 1 <= refill_every <= MAX_BETWEEN_REFILLS:
        raise ConfigError(
            f"A refill every {refill_every} strokes was asked for; allowed is 1 to {MAX_BETWEEN_REFILLS}, and what "
            "a brushful paints is learned best with 1."
        )
    shapes, crop = sample_strokes(kind, count, seed), Crop.covering(kind.frame)
    order = order_of(easel.calibration.easel, kind, count, seed, refill_every)
    recording = Recording(unfinished_folder(out) if out else None, order, crop.shape)
    access = EaselAccess(easel)
    paper: Paper | None = None
    sheets, on_brush, since_dip = 0, 0, 0.0
    running: list[int] = []  # the latest strokes, if they are dirty
    for number in range(count):
        if number in recording.prints:
            continue
        if paper is None:
            fill_with_black(easel)
        if paper is None or paper.is_used_up:
            paper = yield from _lay_paper(access, kind, paper, len(recording.prints))
            sheets, on_brush = sheets + 1, 0
        stroke = shapes[number]
        since_dip = 0.0 if on_brush == 0 else since_dip
        painted = replace(paper.paint(stroke, refill=on_brush == 0), since_dip=since_dip)
        on_brush = (on_brush + 1) % refill_every
        since_dip += float(kind.area(stroke))
        recording.keep(number, painted)
        area = float(painted.mark.sum(dtype=np.int64)) / 255 * crop.pitch**2
        least = _MIN_PAINT * kind.width * float(stroke.way()) * (0.2 + 0.8 * float(stroke.thickness))
        flaw = painted.flaw or (Flaw.EMPTY if area < least else Flaw.NONE)
        running = [*running, number] if flaw and flaw is not Flaw.MOVED else []
        notify(StrokesProgress(len(recording.prints), count, sheets, flaw))
        if len(running) >= _MAX_DIRTY_RUNNING:
            recording.discard(running)
            raise CalibrationError(
                f"The last {len(running)} strokes are all dirty; of the last one: {flaw.sentence}. Look at paint, "
                f"brush, paper, camera and light, then repeat strokes; {len(recording.prints)} strokes are kept."
            )
    if paper is not None:
        motion = Motion(easel.workspace, easel.calibration)
        access.gateway.perform((motion.rinse(), motion.wipe()))  # paint must not dry in the brush
    library = _make_library(shapes, crop, [recording.prints[number] for number in range(count)])
    file = None
    if out is not None:
        library.save(out)
        file = LearnedFile(str(out), storage.sha256(out, "the stroke library"))
        recording.clear_away()
    return _judge_library(kind, library, file)


def unfinished_folder(out: Path) -> Path:
    """Returns the folder of an unfinished library."""
    return out.with_name(out.name + ".unfinished")


def _lay_paper(access: EaselAccess, kind: BrushKind, last: Paper | None, kept: int) -> Procedure[Paper]:
    """Asks for a bare sheet until one is in place, and returns it."""
    why = f"The paper moved by {last.moved * 1000:.1f} mm, so it is given up. " if last and last.moved else ""
    for attempt in range(_TRIES):
        yield from ask_for_paper(
            access.easel,
            f"{why}Put a fresh white paper of {access.easel.canvas} on the easel, just where the canvas was "
            "calibrated, and black paint into the first well. Is it there?",
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


def _make_library(shapes: Strokes, crop: Crop, prints: list[Print]) -> StrokeLibrary:
    """Returns the library of these prints, with the flaws that their photographs or their marks show."""
    taught = shapes.taught
    library = StrokeLibrary(
        magnitude=np.stack([stroke.mark for stroke in prints]),
        length_m=shapes.length.numpy(),
        bend_m=shapes.bend.numpy(),
        thickness=shapes.thickness.numpy(),
        metres_per_pixel=crop.pitch,
        origin_px=(float(crop.above), float(crop.left)),
        recorded_index=np.arange(len(prints), dtype=np.int32),
        since_dip=np.array([stroke.since_dip for stroke in prints], np.float32),
        code=None if taught is None else taught.code.numpy(),
        path_m=None if taught is None else shapes.path(torch.linspace(0, 1, _PATH_POINTS)).numpy(),
    )
    seen = np.array([stroke.flaw for stroke in prints], np.uint8)
    return replace(library, flaws=np.where(seen > 0, seen, judge_marks(library)).astype(np.uint8))


def _judge_library(kind: BrushKind, library: StrokeLibrary, file: LearnedFile | None) -> RecordedStrokes:
    """Returns the result. Raises CalibrationError if most strokes are dirty."""
    dirty, reasons = _count_flaws(judge(library))
    left_out = f"; {dirty} {'is' if dirty == 1 else 'are'} left out ({reasons})" if dirty else ", all of them clean"
    dip = estimate_dip(library, kind.width)
    shown = "" if dip is None else f"; one dip paints {dip}"
    sentence = f"{len(library)} strokes of brush {kind.name}{left_out}{shown}"
    if not 1 - dirty / len(library) >= _MIN_CLEAN:
        raise CalibrationError(
            f"Most strokes are dirty: {sentence}. Nothing is learned from them; look at the contact sheet "
            "(`frida-painter strokes inspect`), mend what spoils them, and repeat strokes."
        )
    return RecordedStrokes(library, file, sentence)


def _count_flaws(flaws: NDArray[np.uint8]) -> tuple[int, str]:
    """Returns the number of dirty strokes, and how many there are for each reason, in words."""
    counts = Counter(Flaw(flaw) for flaw in flaws if flaw)
    return sum(counts.values()), ", ".join(f"{count} {flaw.words}" for flaw, count in counts.most_common())


# Recordings: stroke libraries in progress, with every stroke on the disk as soon as it is photographed.
# The strokes are in a folder beside the library until it is complete. After a crash the same call continues.

_ORDER = "order.json"


def order_of(easel: str, kind: BrushKind, count: int, seed: int, refill_every: int) -> dict[str, Any]:
    """Returns the settings that identify a recording, as plain values."""
    limits = kind.limits
    return {
        "format": "frida-painter recording",
        "version": 1,
        "easel": easel,
        "brush": kind.name,
        "width": kind.width,
        "lengths": list(limits.length),
        "bends": list(limits.bend),
        "count": count,
        "seed": seed,
        "refill_every": refill_every,
        **({} if limits.family is None else {"family": limits.family.digest}),
    }


class Recording:
    """Strokes of one recording that are painted so far, by number.

    folder: storage of the strokes; None to keep them in memory only
    order: settings from `order_of`
    shape: rows and columns of a mark; a stroke on the disk that is damaged is painted again

    Raises ConfigError if the folder has strokes of another recording, StorageError if it cannot be written or is
    damaged.
    """

    def __init__(self, folder: Path | None, order: Mapping[str, Any], shape: tuple[int, int]) -> None:
        self._folder, self._count, self.prints = folder, order["count"], dict[int, Print]()
        if folder is None:
            return
        if not (folder / _ORDER).exists():
            storage.require_unused(folder)
            storage.write_json(folder / _ORDER, order)
            return
        found = storage.read_json(folder / _ORDER, "the settings of a recording")
        differing = [name for name in order if found.get(name) != order[name]]
        if differing:
            told = ", ".join(f"{name} {found.get(name)} and not {order[name]}" for name in differing)
            raise ConfigError(
                f"{folder} holds the strokes of a recording that was broken off, of another kind: {told}. Ask for the "
                "same again to finish it, choose another file with --out, or remove that folder."
            )
        for number in range(self._count):
            if (path := _stroke_file(folder, number)).exists():
                with suppress(LibraryError, KeyError, ValueError):
                    tensors, words = tensor_file.read_tensors(path, "a recorded stroke", LibraryError)
                    stroke = Print(tensors["mark"].numpy(), Flaw[words["flaw"]], float(words["since_dip"]))
                    if stroke.mark.shape == shape and stroke.mark.dtype == np.uint8:
                        self.prints[number] = stroke

    def keep(self, number: int, stroke: Print) -> None:
        """Adds a stroke, stored on the disk first. Raises StorageError."""
        if self._folder is not None:
            words = {"flaw": stroke.flaw.name, "since_dip": repr(stroke.since_dip)}
            path = _stroke_file(self._folder, number)
            tensor_file.write_tensors(path, {"mark": torch.from_numpy(stroke.mark)}, words)
        self.prints[number] = stroke

    def discard(self, numbers: list[int]) -> None:
        """Forgets strokes that are to be painted again."""
        for number in numbers:
            self.prints.pop(number, None)
            if self._folder is not None:
                _stroke_file(self._folder, number).unlink(missing_ok=True)

    def clear_away(self) -> None:
        """Removes the folder after the library is written."""
        if self._folder is None:
            return
        self.discard(list(range(self._count)))
        # The settings last: without them the strokes could not be identified.
        (self._folder / _ORDER).unlink(missing_ok=True)
        if not any(self._folder.iterdir()):
            self._folder.rmdir()


def _stroke_file(folder: Path, number: int) -> Path:
    return folder / f"stroke-{number:05d}.safetensors"


# The contact sheet of a stroke library: every stroke on one page, the dirty ones with the reason.

MAX_SHOWN = 600
_WIDTH = 1800
_MARGIN, _GAP = 44, 10
_HEAD = 112
_CAPTION = 18
_SPOILED = (253, 236, 228)


def contact_sheet(library: StrokeLibrary, title: str) -> Tensor:
    """Returns the strokes in the order of their recording, sRGB [3, H, 1800] in [0, 1].

    A dirty stroke has red paper and the reason below. Of more than 600 strokes it shows the dirty ones, and as
    many others as fit.
    """
    flaws = judge(library)
    shown = np.argsort(flaws == Flaw.NONE, kind="stable")[:MAX_SHOWN]
    shown = shown[np.argsort(library.recorded_index[shown], kind="stable")]
    rows, columns = library.magnitude.shape[1:]
    room, aspect = _WIDTH - 2 * _MARGIN, rows / columns
    # Cells from 96 to 260 pixels wide, so that the page is about square.
    wanted = np.sqrt(room * room / max(len(shown), 1) / max(aspect, 0.2))
    across = round(room / float(np.clip(wanted, 96, 260)))
    grid = Grid.divide(room, _MARGIN, _HEAD, across, 0, across=_GAP, down=_CAPTION + _GAP)
    grid = replace(grid, height=max(24, round(grid.width * aspect)))
    sheet = Sheet(_WIDTH, grid.bottom(len(shown)) + _CAPTION + _MARGIN)
    sheet.text((_MARGIN, 26), title, 34, INK)
    dirty, reasons = _count_flaws(flaws)
    some = f" ({len(shown)} are shown)" if len(shown) < len(flaws) else ""
    told = f"{len(flaws) - dirty} of {len(flaws)} strokes are clean{some}" + ("; left out: " if dirty else ".")
    sheet.text((_MARGIN, 72), told, 20, SOFT)
    sheet.text((_MARGIN + font(20).getlength(told), 72), reasons, 20, WARNING)
    for index, (left, top) in zip(shown, grid.corners(len(shown)), strict=True):
        flaw, mark = Flaw(flaws[index]), library.magnitude[index]
        size, way = (grid.width, grid.height), cv2.INTER_AREA if grid.width < columns else cv2.INTER_LINEAR
        paint = cv2.resize(mark, size, interpolation=way)[..., None] / 255.0
        paper = _SPOILED if flaw else PAPER
        sheet.paste(np.rint((1 - paint) * paper + paint * np.array(INK)).astype(np.uint8), (left, top))
        frame = (left - 1, top - 1, left + grid.width, top + grid.height)
        sheet.draw.rectangle(frame, outline=WARNING if flaw else LINE, width=1)
        sheet.text((left, top + grid.height + 3), str(library.recorded_index[index]), 12, SOFT)
        if flaw:
            sheet.text((left + grid.width, top + grid.height + 3), flaw.words, 12, WARNING, "ra")
    return sheet.tensor()
