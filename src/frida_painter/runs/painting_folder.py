"""Folder of a painting: its description, copies of its pictures, its journal and its results.

Resuming needs these files, and nothing can make them again:

settings.json: the RunSpec.
goal/: the goal (TOML) with copies of its pictures, and the record of those that were made from words; changes/N/goal
if it was changed midway.
journal: every stroke, motion, plan and photograph.
plan.json, plan-*.safetensors: the plan of all strokes.
photographs/: the photographs for decisions.
studio.diary: the log of a simulated studio.
calibration.json: the calibration of the easel at the time of the painting.
sketchbook/: timelapse frames and looks, for film and page.

`resume` can make the results for a person again: film.mp4, painting.png, index.html, result.json, palette.png,
mixing.png, shopping.png, shopping.txt, strokes.svg and strokes.csv.
"""

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path
from typing import Any, Self

from torch import Tensor

from frida_painter.brush.weights import weights_of
from frida_painter.calibration import Calibration, WetPaint
from frida_painter.easel.kinds import ARM_FILM, JOURNAL, SIMULATION_LOG
from frida_painter.errors import ConfigError, FridaError, StorageError
from frida_painter.planning.fields import brush_file
from frida_painter.planning.placement import Placement
from frida_painter.report.film import SKETCHBOOK
from frida_painter.runs.goal_item import MAKING, making_file, read_goal_file, read_making
from frida_painter.runs.spec import FILES, RunSpec
from frida_painter.session.fold import PaintingState
from frida_painter.session.journal import PHOTOGRAPHS, Journal
from frida_painter.session.progress import Painting
from frida_painter.system import provenance, storage

# Placement, touch heights and wet paint that a painting learned are kept in the calibration record for the next one.


def keep_learned(
    spec: RunSpec, begun: Calibration | None, learned: Placement, painting: Painting, wet: Callable[[], WetPaint | None]
) -> Path | None:
    """Writes what a finished painting taught into its calibration record: placement, touch heights and wet paint.

    wet: called if the record is written; returns how wet paint mixed, or None to keep what is known of it.
    begun: record at the beginning of the painting. If the file has changed since, it stays as it is, because a
    newer calibration is better. The old record is kept beside the new one, as by Calibration.save.
    Returns the file of the record, or None if nothing was written.
    Raises CalibrationError and StorageError.
    """
    record, finished = spec.calibration, painting.rest is not None and len(painting.rest) == 0
    if record is None or begun is None or spec.by_hand or not spec.has_camera or not finished:
        return None
    if Calibration.load(record) != begun:
        return None
    corrected = learned.correct(begun, spec.canvas)
    replace(corrected, wet=wet() or corrected.wet).save(record)
    return record


SETTINGS = "settings.json"
GOAL = "goal"
CALIBRATION = "calibration.json"
"""Copy of the easel's calibration at the time of the painting, for reading its photographs again."""
NOW = "now.png"
"""Picture of the canvas when the painting was resumed, or of a canvas that was not bare at the beginning."""
CALIBRATION_RECORD = "calibration record"
"""Key of the calibration record in `rests_on`."""
PAINTINGS = Path("paintings")
"""Folder of the paintings for which no folder is named."""


def new_folder(out: Path | None, name: str, needed: int) -> Path:
    """Makes a new, empty folder with room for `needed` bytes.

    The folder is `out`, or one under "paintings" that is named after the painting and the time.
    """
    folder = out or PAINTINGS / storage.file_name(f"{name}-{datetime.now():%Y%m%d-%H%M%S}")
    storage.require_space(folder, needed, "this painting")
    storage.new_folder(folder)
    return folder


def read_spec(folder: Path) -> RunSpec:
    """Reads the current description from the folder. Raises ConfigError."""
    return RunSpec.read(folder / SETTINGS)


def spec_beside(plan: Path) -> RunSpec:
    """Returns the description of the painting that a plan (file or folder) belongs to; else that with all defaults."""
    try:
        return read_spec(plan if plan.is_dir() else plan.parent)
    except ConfigError:
        return RunSpec.of()


def history_of(folder: Path) -> PaintingState:
    """Reads the history of a painting, then releases its journal. Raises StorageError."""
    journal, history = Journal.reopen(folder)
    journal.close()
    return history


def keep_goal(spec: RunSpec, folder: Path) -> None:
    """Copies the goal with its pictures and weights into the folder. Raises StorageError."""
    lines: list[str] = []
    tables = [("goal", item) for item in spec.goal] + [("initial", item) for item in spec.initial]
    for number, (table, item) in enumerate(tables, 1):
        value = item.value
        if item.path is not None:
            copy = Path(str(number), storage.file_name(item.path.name))
            record = making_file(item.path) if read_making(item.path) is not None else None
            for source, name in ((item.path, copy), (record, copy.parent / MAKING)):
                if source is not None:
                    storage.copy(source, folder / GOAL / name, "a picture of the goal", storage.MAX_BYTES)
            value = copy.as_posix()
        quoted = json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
        lines += [f"[[{table}]]", f"{item.kind} = {quoted}", f"weight = {item.weight!r}"]
        lines += [""] if item.crop is None else [f"crop = {list(item.crop)!r}", ""]
    storage.write_text(folder / GOAL / "goal.toml", "\n".join(lines))


def read_goal(folder: Path) -> dict[str, Any]:
    """Reads the goal from the folder, in the form of RunSpec. Raises ConfigError."""
    return read_goal_file(folder / GOAL / "goal.toml")


def input_hashes(spec: RunSpec, folder: Path) -> dict[str, str]:
    """Returns the hashes, by name, of all files that decide how a painting goes on. Raises StorageError."""
    files = {
        "goal": folder / GOAL,
        CALIBRATION_RECORD: spec.calibration,
        CALIBRATION: folder / CALIBRATION,
        "workspace": spec.workspace,
        **({} if spec.studio_canvas is None else {"studio canvas": spec.studio_canvas}),
        "brush": None,
    }
    for number, name in enumerate(spec.brush_names):
        path = brush_file(name)
        if path is not None:
            files[f"brush {number + 1}" if number else "brush"] = path
    return {what: "none" if path is None else content_hash(path) for what, path in files.items()}


def are_there(folder: Path, strokes: int) -> bool:
    """Returns True if the folder holds all results of a finished painting with this number of strokes."""
    path, what = folder / "result.json", "the figures of a painting"
    try:
        result = storage.read_json(path, what)
        with storage.understanding(path, what):
            done = result.get("strokes_painted", 0) + len(result.get("strokes_given_up", ()))
            is_done = done >= strokes and result.get("stopped") is False
    except StorageError:
        return False
    filmed = (folder / "film.mp4").exists() or not any((folder / SKETCHBOOK).glob("glimpse-*"))
    names = ("painting.png", "index.html", "strokes.svg", "strokes.csv", "palette.png", "plan.png")
    return is_done and filmed and all((folder / name).exists() for name in names)


_FILES = (
    "index.html", "painting.png", "canvas.png", "card.jpg", "film.mp4", ARM_FILM, ".arm/*", "palette*.png",
    "mixing*.png", "plan.png", NOW, "target.jpg", "look-*.jpg", "shopping.*", "painters.*", "strokes.*", "result.json",
    SETTINGS, "plan.json", "plan-*.safetensors", CALIBRATION, JOURNAL, f".{JOURNAL}-tally", SIMULATION_LOG,
    f".{SIMULATION_LOG}-tally", f"{GOAL}/**/*", "changes/**/*", "regions/*", f"{PHOTOGRAPHS}/*", f"{SKETCHBOOK}/*",
)  # fmt: skip


def hash_files(folder: Path) -> dict[str, str]:
    """Returns the hash of each file of a painting or a plan by its path in the folder; a person's files do not count.

    Raises StorageError if a file cannot be read.
    """
    found = {file for pattern in _FILES for file in folder.glob(pattern) if not file.name.startswith(storage.PART)}
    return {
        file.relative_to(folder).as_posix(): storage.sha256(file, "a file of a painting")
        for file in sorted(found)
        if file.is_file()
    }


def content_hash(path: Path) -> str:
    """Returns the sha256 of a file, or of the names and contents of all files in a folder; "gone" if it is missing.

    Raises StorageError if a file cannot be read.
    """
    content = hashlib.sha256()
    if not path.exists():
        return "gone"
    try:
        for file in sorted(path.rglob("*")) if path.is_dir() else [path]:
            if file.is_file():
                content.update(str(file.relative_to(path)).encode() + b"\0")
                with storage.open_checked(file, "what decides how the painting goes on", storage.MAX_BYTES) as opened:
                    while piece := opened.read(2**20):
                        content.update(piece)
    except OSError as error:
        raise StorageError(f"{path} cannot be read ({error.strerror}); it decides how the painting goes on.") from error
    return content.hexdigest()


# Record of how a plan or a painting was made, and whether it can be made again here: `record.json` in its folder holds
# the facts of provenance.py, the settings before anything was chosen, and the hashes of all input files, of the results
# and of every file in the folder that the program wrote.

RECORD = "record.json"
_RECORD_FORMAT, _RECORD_VERSION = "frida-painter record", 1
_PROMISED = "cpu"  # the device on which equal settings give equal bytes
_MAX_TOLD = 12
_GONE = "gone"
_WEIGHTS = "weights of "
_PLAN_GIVEN = "It was painted from a plan that was given; verify the folder of that plan."
_UNFINISHED = "It was never finished, so there is nothing to compare with; finish it first."
NO_RECORD = f"Its folder holds no {RECORD}: that was taken away, or an older version of the program kept none."
_AS_LEFT = "Every file in its folder is as it was left."
NO_HASHES = "An older version made it and kept no hashes of its files, so nobody can say if they were changed."


@dataclass(frozen=True)
class RecordCheck:
    """Answer to the question if something can be made again here.

    obstacle: sentence that says why it cannot be made again at all; "" if nothing stands in the way
    differences: phrases about what has changed since, each of which may change the result
    files: phrases about files in its folder that are not as they were left
    remark: one more sentence; ""
    same: True if it was made again and is the same, False if it is not, None if it was not made again
    """

    obstacle: str = ""
    differences: tuple[str, ...] = ()
    same: bool | None = None
    files: tuple[str, ...] = ()
    remark: str = ""

    @property
    def can_be_made_again(self) -> bool:
        """True if nothing stands in the way and nothing has changed."""
        return not (self.obstacle or self.differences or self.files)

    @property
    def passed(self) -> bool:
        """True if it can be made again, or was made again and is the same."""
        return self.can_be_made_again if self.same is None else self.same

    def __str__(self) -> str:
        more = len(self.differences) - _MAX_TOLD
        changed = "; ".join((*self.differences[:_MAX_TOLD], *([f"and {more} more"] if more > 0 else [])))
        told, since = self.obstacle, f"Changed since: {changed}." if changed else ""
        if not told and self.same is None:
            told = "" if changed else "It can be made again here: nothing that decides it has changed."
            since = f"It may come out differently here: {changed}." if changed else ""
        elif not told:
            told = f"It was made again, and {'is the same to the last bit' if self.same else 'differs'}."
        files = f"Its folder is not as it was left: {'; '.join(self.files)}." if self.files else ""
        return " ".join(filter(None, (files, told, since, self.remark)))


@dataclass(frozen=True)
class RunRecord:
    """Record of a plan or a painting.

    folder: folder of the plan or painting
    kind: "plan" or "painting"
    made_with: facts of provenance.py
    settings: settings of its RunSpec before anything was chosen; its goal lies in the folder
    inputs: hashes of the files that went in, by path or by name
    results: hashes of the results by name; empty if it was never finished
    obstacle: sentence that says why it cannot be made again; ""
    files: hashes of the files in the folder by path; empty if it was never finished, or in a record of an older version
    """

    folder: Path
    kind: str
    made_with: Mapping[str, str]
    settings: Mapping[str, Any]
    inputs: Mapping[str, str]
    results: Mapping[str, str]
    obstacle: str = ""
    files: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def begin(
        cls, folder: Path, kind: str, spec: RunSpec, brushes: tuple[str, ...], device: str, *, given: bool = False
    ) -> "RunRecord":
        """Writes the record at the beginning, in a folder that has its goal. Raises StorageError.

        spec: description before anything was chosen
        brushes: names or files of the brushes
        given: True if a plan was given, and is not made again
        """
        obstacle = _PLAN_GIVEN if given else ""
        if not spec.simulated:
            obstacle = f"It was painted by {spec.robot}, and no program makes real paint again."
        made = cls(
            folder, kind, provenance.describe_here(device), spec.record(), _hash_inputs(spec, brushes, folder), {},
            obstacle,
        )  # fmt: skip
        made.save()
        return made

    def finish(
        self, painted: PaintingState | None = None, before: Mapping[str, str] | None = None, **results: str
    ) -> None:
        """Writes what came out, with the hashes of all files. Raises StorageError.

        painted: final state of a painting, which tells whether a person led it; None for a plan.
        before: hashes of the files before some were made again. Files that are still the same keep their hashes of the
        record, so that a change of them is still noticed.
        """
        now, before = hash_files(self.folder), before or {}
        files = {name: known for name, known in self.files.items() if now.get(name) == before.get(name)}
        files |= {name: found for name, found in now.items() if found != before.get(name)}
        obstacle = self.obstacle or ("" if painted is None else _find_lead(painted))
        replace(self, results=results, obstacle=obstacle, files=files).save()

    def save(self) -> None:
        """Writes the file. Raises StorageError."""
        content = {name: value for name, value in vars(self).items() if name != "folder"}
        storage.write_json(self.folder / RECORD, {"format": _RECORD_FORMAT, "version": _RECORD_VERSION, **content})

    @classmethod
    def load(cls, folder: Path) -> Self:
        """Reads the record of a plan's or painting's folder. Raises StorageError if it is damaged or was edited."""
        path = folder / RECORD
        kept = storage.read_json(path, "the record of how something was made")
        if kept.get("format") != _RECORD_FORMAT or kept.get("version") != _RECORD_VERSION:
            raise StorageError(
                f"{path} is no record that this program reads; bring back the one that was written here."
            )
        content = {name: kept.get(name) for name in cls.__dataclass_fields__ if name != "folder"}
        content["files"] = kept.get("files", {})  # older versions had none
        if not all(isinstance(value, str if name in ("kind", "obstacle") else dict) for name, value in content.items()):
            raise StorageError(f"{path} lacks a part of the record of how something was made; bring the original back.")
        return cls(folder, **content)  # type: ignore[arg-type]

    def check(self) -> RecordCheck:
        """Compares versions, plug-ins, device, input files and the files in the folder with those of the record."""
        obstacle = self.obstacle or ("" if self.results else _UNFINISHED)
        here = provenance.describe_here(self.made_with.get("device", _PROMISED))
        known = provenance.PROGRAM in self.made_with
        found = provenance.compare_facts(self.made_with, here) if known else []
        for name, before in self.inputs.items():
            if (now := _hash_of(name, self.folder)) != before:
                found.append(f"{name} {'is gone' if now == _GONE else 'has changed'}")
        there = hash_files(self.folder) if self.files else {}
        changed = [told for name, told in compare_files(self.files, there).items() if name not in self.inputs]
        remark = NO_HASHES if self.results and not self.files else _AS_LEFT if self.obstacle and not changed else ""
        return RecordCheck(obstacle, tuple(found), files=tuple(changed), remark=remark)


def _find_lead(painted: PaintingState) -> str:
    """Returns why no program paints a painting again: it was resumed, or a person led it; "" if neither is true."""
    if painted.sittings.count > 1:
        return "It was interrupted and resumed, so that its looks fell elsewhere than they would again."
    wishes = painted.wishes
    led = wishes.pause or wishes.goals or painted.people.strokes or wishes.region or painted.progress.given_up
    return "A person led it, and no program does that again." if led else ""


def compare_files(before: Mapping[str, str], now: Mapping[str, str]) -> dict[str, str]:
    """Returns a phrase for each file that is not as it was, from the hashes by path."""
    return {
        name: f"{name} {'was added' if name not in before else 'was changed' if name in now else 'is missing'}"
        for name in sorted({*before, *now})
        if before.get(name) != now.get(name)
    }


def _hash_inputs(spec: RunSpec, brushes: tuple[str, ...], folder: Path) -> dict[str, str]:
    """Returns the hash of each file that decides the result: pictures, weights, calibration and others.

    The goal is the copy in the folder, so that the folder can be made again elsewhere.
    """
    kept = [file.relative_to(folder).as_posix() for file in sorted((folder / GOAL).rglob("*")) if file.is_file()]
    chosen = spec.record()
    files = [chosen[name] for name in FILES if chosen[name] is not None]
    files += [chosen["paints"]] if Path(chosen["paints"]).suffix else []
    files += [spec.clip] if spec.clip is not None and Path(spec.clip).exists() else []
    names = [*kept, *files, *(f"{_WEIGHTS}{brush}" for brush in brushes)]
    return {name: _hash_of(name, folder) for name in dict.fromkeys(names)}


def _hash_of(name: str, folder: Path) -> str:
    """Returns the hash of an input: of a file or folder by its path, or of the weights of a brush."""
    if not name.startswith(_WEIGHTS):
        return content_hash(folder / name)
    try:
        files = weights_of(name.removeprefix(_WEIGHTS))
    except FridaError:
        return _GONE
    return " ".join(content_hash(file) for file in files) or "none"


def hash_picture(picture: Tensor) -> str:
    """Returns the sha256 of the bytes of a picture [3, H, W], and of its shape."""
    content = hashlib.sha256(str(tuple(picture.shape)).encode())
    content.update(picture.detach().float().cpu().contiguous().numpy().tobytes())
    return content.hexdigest()
