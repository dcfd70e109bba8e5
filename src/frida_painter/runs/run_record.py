"""Record of how a plan or a painting was made, and whether it can be made again here.

`record.json` in its folder holds the facts of provenance.py, the settings before anything was chosen, and the hashes
of all input files, of the results and of every file in the folder that the program wrote.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Self

from torch import Tensor

from frida_painter import provenance, storage
from frida_painter.brush.weights import weights_of
from frida_painter.errors import FridaError, StorageError
from frida_painter.runs.painting_folder import GOAL, content_hash, hash_files
from frida_painter.runs.spec import FILES, RunSpec

RECORD = "record.json"
_FORMAT, _VERSION = "frida-painter record", 1
_PROMISED = "cpu"  # the device on which equal settings give equal bytes
_MAX_TOLD = 12
_GONE = "gone"
_WEIGHTS = "weights of "
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
        files = f"Its folder is not as it was left: {'; '.join(self.files)}." if self.files else ""
        return " ".join(filter(None, (files, self._told, self.remark)))

    @property
    def _told(self) -> str:
        changed = "; ".join(self.differences[:_MAX_TOLD])
        more = f"; and {len(self.differences) - _MAX_TOLD} more" if len(self.differences) > _MAX_TOLD else ""
        if self.obstacle:
            return f"{self.obstacle} Changed since: {changed}{more}." if changed else self.obstacle
        if self.same is None:
            told = "It can be made again here: nothing that decides it has changed."
            return f"It may come out differently here: {changed}{more}." if changed else told
        told = "It was made again, and is the same to the last bit." if self.same else "It was made again, and differs."
        return f"{told} Changed since: {changed}{more}." if changed else told


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
    def begin(cls, folder: Path, kind: str, spec: RunSpec, brushes: tuple[str, ...], device: str) -> "RunRecord":
        """Writes the record at the beginning, in a folder that has its goal. Raises StorageError.

        spec: description before anything was chosen
        brushes: names or files of the brushes
        """
        obstacle = "" if spec.simulated else f"It was painted by {spec.robot}, and no program makes real paint again."
        made = cls(
            folder, kind, provenance.describe_here(device), spec.record(), _hash_inputs(spec, brushes, folder), {},
            obstacle,
        )  # fmt: skip
        made.save()
        return made

    def finish(self, obstacle: str = "", before: Mapping[str, str] | None = None, **results: str) -> None:
        """Writes what came out, with the hashes of all files. Raises StorageError.

        before: hashes of the files before some were made again. Files that are still the same keep their hashes of the
        record, so that a change of them is still noticed.
        """
        now, before = hash_files(self.folder), before or {}
        files = {name: known for name, known in self.files.items() if now.get(name) == before.get(name)}
        files |= {name: found for name, found in now.items() if found != before.get(name)}
        replace(self, results=results, obstacle=self.obstacle or obstacle, files=files).save()

    def save(self) -> None:
        """Writes the file. Raises StorageError."""
        content = {name: value for name, value in vars(self).items() if name != "folder"}
        storage.write_json(self.folder / RECORD, {"format": _FORMAT, "version": _VERSION, **content})

    @classmethod
    def load(cls, folder: Path) -> Self:
        """Reads the record of a plan's or painting's folder. Raises StorageError if it is damaged or was edited."""
        path = folder / RECORD
        kept = storage.read_json(path, "the record of how something was made")
        if kept.get("format") != _FORMAT or kept.get("version") != _VERSION:
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
