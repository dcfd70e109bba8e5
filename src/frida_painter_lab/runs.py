"""A run of anything that is measured: its labels, the key of what decides its result, and the folder that keeps it."""

import contextlib
import hashlib
import json
import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from frida_painter.errors import FridaError, StorageError, TryFailed
from frida_painter.runs.spec import RunSpec
from frida_painter.system import locks, storage
from frida_painter.system.provenance import identify_here

LOCK = ".lock"
_PATIENCE = 600.0  # seconds, for a run that a dead driver left behind

Value = str | int | float | bool | None
Labels = Mapping[str, Value]
"""Labels that distinguish a run from the others: the first columns of its row in the table of results."""


@cache
def _identify_program() -> str:
    return identify_here()


def content_key(*values: object) -> str:
    """Returns 20 hexadecimal digits that identify plain values: two of a billion are equal with a chance of 10^-6."""
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:20]


@dataclass(frozen=True)
class Run:
    """Run of an experiment.

    labels: distinguish it from the others
    depends_on: plain values that determine its measurement, besides the labels
    """

    labels: Labels
    depends_on: Mapping[str, object] = field(default_factory=dict)

    def __getitem__(self, label: str) -> str:
        """Returns a label as text."""
        return str(self.labels[label])

    @property
    def key(self) -> str:
        """Hash of everything that determines the measurement, with this program, its libraries and plug-ins."""
        return content_key(_identify_program(), dict(self.labels), dict(self.depends_on))

    @property
    def words(self) -> str:
        """Description of the run for people."""
        told = (f"seed {value}" if label == "seed" else str(value) for label, value in self.labels.items())
        return ", ".join(filter(None, told))


def goal_facts(spec: RunSpec, hash_of: Callable[[Path], str]) -> dict[str, list[list[Value]]]:
    """Returns a goal and what it begins with, each part as its kind, its content (words, or a hash) and its weight."""
    return {
        part: [
            [item.kind, item.value if item.path is None else hash_of(item.path), item.weight]
            for item in getattr(spec, part)
        ]
        for part in ("goal", "initial")
    }


@contextlib.contextmanager
def hold_lock(folder: Path, seconds: float, busy: FridaError) -> Iterator[None]:
    """Holds the lock of a folder, which is made if it is missing.

    Raises `busy` if another process has it for all of these seconds, StorageError if the folder cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        file = locks.open_lock(folder / LOCK)
    except OSError as error:
        raise storage.cannot_write(folder, error) from error
    try:
        if not locks.take(file, seconds):
            raise busy
        yield
    finally:
        os.close(file)


class RunFolder:
    """Folder of one run of a sweep or an experiment.

    key: of the run
    """

    def __init__(self, sweep: Path, key: str) -> None:
        self.path = sweep / "runs" / key

    def lock(self) -> contextlib.AbstractContextManager[None]:
        """Locks the folder for one process at a time; others wait for ten minutes.

        Raises TryFailed if that was in vain, StorageError if the folder cannot be written.
        """
        place = storage.abridge(self.path)
        busy = TryFailed(f"{place} is locked by another process, which does not let go; end it.")
        return hold_lock(self.path, _PATIENCE, busy)

    def record(self) -> dict[str, Any] | None:
        """Returns the result; None if the run is not done, or if the result is damaged or of another run."""
        record = self._read("result.json", "the result of a run")
        return record if record is not None and record.get("key") == self.path.name else None

    def keep(self, record: Mapping[str, Any]) -> None:
        """Writes the result, which marks the run as done. Raises StorageError."""
        storage.write_json(self.path / "result.json", record)
        (self.path / "failure.json").unlink(missing_ok=True)

    def keep_failure(self, failure: Mapping[str, Any]) -> None:
        """Writes the reason of a failure. Raises StorageError."""
        storage.write_json(self.path / "failure.json", failure)

    def failure(self) -> dict[str, Any] | None:
        """Returns the last failure; None if there is none."""
        return self._read("failure.json", "why a run failed")

    def _read(self, name: str, what: str) -> dict[str, Any] | None:
        with contextlib.suppress(StorageError):
            return storage.read_json(self.path / name, what) if (self.path / name).exists() else None
        return None
