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
from datetime import datetime
from pathlib import Path
from typing import Any

from frida_painter import storage
from frida_painter.errors import ConfigError, StorageError
from frida_painter.report.sketchbook import SKETCHBOOK
from frida_painter.runs.goal_item import read_goal_file
from frida_painter.runs.spec import RunSpec
from frida_painter.session.timetable import DRYING

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


def rests_on(spec: RunSpec, folder: Path) -> dict[str, str]:
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
