"""What lies in a painting's folder, beside its log: how it is painted, copies of its pictures, and what else decides.

| file | what it is | made again from |
|---|---|---|
| settings.json | the RunSpec | nothing: resuming needs it |
| goal/ | the goal (TOML) with copies of its pictures; changes/N/goal where it was changed midway | nothing |
| journal | every stroke, motion, plan and photograph | nothing |
| plan.json, plan-*.safetensors | the plan of all strokes | nothing |
| photographs/ | the photographs by which something was decided | nothing |
| studio.diary | the log of a simulated studio | nothing |
| calibration.json | the calibration of the easel as it was painted by | nothing |
| sketchbook/ | timelapse frames and looks, of which film and page are made | nothing |
| film.mp4, painting.png, index.html, result.json, palette.png, mixing.png, strokes.svg, strokes.csv | what a person keeps | the files above, by `resume` |
"""  # noqa: E501

import hashlib
import json
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from torch import Tensor

from frida_painter import storage
from frida_painter.calibration import Calibration
from frida_painter.easel.kinds import DIARY
from frida_painter.errors import ConfigError, StorageError
from frida_painter.event_log import missing
from frida_painter.perception.frame_check import FrameCheck
from frida_painter.planning.placement import Placement
from frida_painter.planning.planner import Planner
from frida_painter.report.film import SKETCHBOOK
from frida_painter.report.sheets import doubt
from frida_painter.runs.goal_item import read_goal_file
from frida_painter.runs.spec import SETTLED, RunSpec, upgraded
from frida_painter.session import resuming
from frida_painter.session.events import DRYING
from frida_painter.session.journal import History, Journal
from frida_painter.session.painting import Painting
from frida_painter.session.resuming import KeptPlan

# What a painting learned of its easel is kept in the calibration record, for the next painting.


def keep_learned(spec: RunSpec, begun: Calibration | None, learned: Placement, painting: Painting) -> Path | None:
    """Writes into the record that a finished painting went by where strokes land and brushes touch; the record then.

    begun: it as the painting began. Where it was changed meanwhile it stays: whoever calibrated anew knows better. The
    record before is kept beside it, as Calibration.save does. Raises CalibrationError and StorageError.
    """
    record, finished = spec.calibration, painting.rest is not None and len(painting.rest) == 0
    if record is None or begun is None or spec.by_hand or not finished or Calibration.load(record) != begun:
        return None
    learned.corrected(begun, spec.canvas).save(record)
    return record


SETTINGS = "settings.json"
GOAL = "goal"
CALIBRATION = "calibration.json"
"""A copy of the easel's calibration as it was painted by, by which its photographs can be read again."""
NOW = "now.png"
"""The canvas as it was found when the painting was resumed, or where something was on it at first."""
CALIBRATION_RECORD = "calibration record"
"""What a painting rests on, in `rests_on`: that by which its robot is sent."""
PAUSE_FILE = "pause"
"""As long as it is there, nothing is painted."""


def new_folder(out: Path | None, name: str, needed: int) -> Path:
    """A new, empty folder with room for `needed` bytes: `out`, or one below "paintings" named after the painting."""
    folder = out or Path("paintings") / f"{name}-{datetime.now():%Y%m%d-%H%M%S}"
    storage.require_space(folder, needed)
    storage.new_folder(folder)
    return folder


def keep_spec(spec: RunSpec, folder: Path) -> None:
    """Puts the description into the folder, for people and for resuming. Raises StorageError."""
    storage.write_text(folder / SETTINGS, json.dumps(spec.record(), indent=2) + "\n")


def read_spec(folder: Path) -> RunSpec:
    """The description as it lies in the folder, whoever has changed it in the meantime. Raises ConfigError."""
    return RunSpec.read(folder / SETTINGS)


def drying_of(plan: Path) -> float:
    """Seconds for which each layer dries of the painting that a plan, or the folder of it, belongs to.

    Where the plan lies on its own, or the painting's settings cannot be read, it is the usual time.
    """
    try:
        return 60 * read_spec(plan if plan.is_dir() else plan.parent).drying
    except ConfigError:
        return DRYING


def keep_goal(spec: RunSpec, folder: Path) -> None:
    """Copies the pictures of a goal into the folder, and how they matter. Raises StorageError."""
    lines: list[str] = []
    tables = [("goal", item) for item in spec.goal] + [("initial", item) for item in spec.initial]
    for number, (table, item) in enumerate(tables, 1):
        value = item.value
        if item.path is not None:
            copy = Path(str(number), item.path.name)
            _copy(item.path, folder / GOAL / copy)
            value = copy.as_posix()
        lines += [f"[[{table}]]", f"{item.kind} = {_quoted(value)}", f"weight = {item.weight!r}", ""]
    storage.write_text(folder / GOAL / "goal.toml", "\n".join(lines))


def read_goal(folder: Path) -> dict[str, Any]:
    """The goal as it was kept, in the words of RunSpec. Raises ConfigError."""
    return read_goal_file(folder / GOAL / "goal.toml")


def input_hashes(spec: RunSpec, folder: Path) -> dict[str, str]:
    """Hashes of all files that decide how a painting goes on, by what they are. Raises StorageError."""
    files = {
        "goal": folder / GOAL,
        CALIBRATION_RECORD: spec.calibration,
        CALIBRATION: folder / CALIBRATION,
        "workspace": spec.workspace,
        **({} if spec.studio_canvas is None else {"studio canvas": spec.studio_canvas}),
        "brush": None,
    }
    for number, name in enumerate(spec.brush_names):
        if Path(name).suffix:
            files[f"brush {number + 1}" if number else "brush"] = Path(name)
    return {what: "none" if path is None else content_hash(path) for what, path in files.items()}


def are_there(folder: Path, strokes: int) -> bool:
    """Whether all that a person keeps of a finished painting of so many strokes is in its folder."""
    try:
        result = storage.read_json(folder / "result.json", "the figures of a painting")
    except StorageError:
        return False
    filmed = (folder / "film.mp4").exists() or not any((folder / SKETCHBOOK).glob("glimpse-*"))
    names = ("painting.png", "index.html", "strokes.svg", "strokes.csv", "palette.png", "plan.png")
    done = result.get("strokes_painted", 0) + len(result.get("strokes_given_up", ()))
    is_done = done >= strokes and result.get("stopped") is False
    return is_done and filmed and all((folder / name).exists() for name in names)


def _quoted(text: str) -> str:
    """As a TOML string."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _copy(source: Path, copy: Path) -> None:
    storage.copy(source, copy, "a picture of the goal", storage.MAX_BYTES)


def content_hash(path: Path) -> str:
    """sha256 over a file, or over the names and contents of all files in a folder; "gone" where it is."""
    content = hashlib.sha256()
    if not path.exists():
        return "gone"
    try:
        for file in sorted(path.rglob("*")) if path.is_dir() else [path]:
            if file.is_file():
                content.update(str(file.relative_to(path)).encode() + b"\0")
                with storage.opened(file, "what decides how the painting goes on", storage.MAX_BYTES) as opened:
                    while piece := opened.read(2**20):
                        content.update(piece)
    except OSError as error:
        raise StorageError(f"{path} cannot be read ({error.strerror}); it decides how the painting goes on.") from error
    return content.hexdigest()


# A painting that goes on: it is reopened from its folder, and held against what it was begun with.


@dataclass(frozen=True)
class ReopenedPainting:
    """A painting that is resumed.

    spec: as its folder has it; journal: held until it is closed; history: read from it; plan: the one in the folder,
    None where it broke off before there was one; placement: as it was learned by then, None where it is for another
    calibration record than the one that is there now; accept_changes: whether it goes on whatever has changed.
    """

    spec: RunSpec
    journal: Journal
    history: History
    plan: KeptPlan | None
    placement: Placement | None
    accept_changes: bool

    def require_as_left(self, good: FrameCheck | None, planner: Planner, before: Tensor, now: Tensor) -> None:
        """Raises FrameRejected where the canvas `now` is not what came, by the journal, of the canvas `before`.

        Both [3, H, W]; good: what a photograph there is like, None where that is not known: then all is as it was.
        """
        if self.plan is not None and good is not None:
            good.require_explained(now, resuming.as_left(self.plan, self.history, planner, before))

    def stroke_in_doubt(self, planner: Planner, now: Tensor) -> Tensor | None:
        """A picture, on the canvas `now`, of the stroke that was begun and perhaps not painted; None without one."""
        number = self.history.in_doubt
        if number is None or self.plan is None:
            return None
        painted = planner.expected(self.plan.plan.part(slice(number - 1, number)), now)
        return doubt(self.plan.plan, number - 1, now, painted)


def reopen(folder: Path, *, accept_changes: bool, pace: float) -> ReopenedPainting:
    """The painting in a folder, and its journal, held. Raises StorageError, PlanError and ConfigError.

    The latter names all that was changed since it was begun, where that was not accepted.
    """
    journal, history = Journal.reopen(folder)
    try:
        spec = read_spec(folder) if not history.finished else RunSpec.of(**upgraded(history.settings))
        plan = resuming.kept_plan(folder, history)
        if not history.finished:
            _require_unchanged(spec, folder, history, plan, accept_changes=accept_changes)
        placement = None if plan is None or _recalibrated(spec, folder, history) else plan.planning.placement
        spec = spec.changed(pace=pace, **read_goal(folder / history.goal))
    except BaseException:
        journal.close()
        raise
    return ReopenedPainting(spec, journal, history, plan, placement, accept_changes)


def _recalibrated(spec: RunSpec, folder: Path, history: History) -> bool:
    """Whether the calibration record is another one than when the painting was begun."""
    return not history.finished and input_hashes(spec, folder)[CALIBRATION_RECORD] != history.rests_on.get(
        CALIBRATION_RECORD
    )


def history_of(folder: Path) -> History:
    """How far a painting came, read without taking it from whoever works on it. Raises StorageError."""
    journal, history = Journal.reopen(folder)
    journal.close()
    return history


def _require_unchanged(
    spec: RunSpec, folder: Path, history: History, plan: KeptPlan | None, *, accept_changes: bool
) -> None:
    """Raises ConfigError, showing all of them, where there are changes that nobody accepted, or cannot be."""
    begun = RunSpec.of(**upgraded(history.settings)).record()
    history.settings = begun
    diary = missing(folder / DIARY, "the diary of a virtual studio") if spec.simulated else 0
    rests_on = input_hashes(spec, folder)
    if CALIBRATION not in history.rests_on:  # earlier programs did not take it down
        del rests_on[CALIBRATION]
    changes = resuming.changes(folder, history, spec.record(), rests_on, plan, diary)
    settled = [name for name in SETTLED if begun[name] != spec.record()[name]]
    if not changes or (accept_changes and not settled):
        return
    told = "\n".join(f"  {line}" for line in changes)
    remedy = (
        f"{', '.join(settled)} cannot be changed any more; change it back in {folder / SETTINGS}."
        if settled
        else "Change it back, or go on with what is there now: --accept-changes"
    )
    raise ConfigError(f"Since this painting was begun, something was changed:\n{told}\n{remedy}")
