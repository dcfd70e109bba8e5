"""The folder of a sweep: lock, request, copies of the pictures, and the result of every run.

| file | content |
|---|---|
| sweep.json | the latest request of the sweep, with the hashes of its files |
| inputs/ | copies of the pictures, named by their content, in case the originals vanish |
| runs/KEY/ | one run: result.json if it is done, failure.json if its last try failed, plan and pictures |
| table.parquet | all results; it can be made again from the runs |
| index.html | the page of `sweep report` |
"""

import contextlib
import os
from collections.abc import Iterator, Mapping
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from frida_painter import storage
from frida_painter.errors import ConfigError, FridaError, StorageError, SweepBusy, TryFailed
from frida_painter.provenance import identify_here
from frida_painter.runs.painting_folder import content_hash
from frida_painter_lab.sweeps.sweep_spec import Fields, SweepRun, SweepSpec, Value, label

# Expansion of a sweep to its runs, each once, identified by the content of its files.

_MAX_FAULTS = 5


class FileHashes:
    """Hashes of files by path, each computed once; a vanished file has its known hash.

    known: hashes from the start of the sweep
    reread: True to hash existing files again
    """

    def __init__(self, known: Mapping[str, str] | None = None, *, reread: bool = True) -> None:
        self._known = known or {}
        self.by_path = {} if reread else dict(self._known)
        self.vanished: list[str] = []

    def of(self, path: Path) -> str:
        """Returns the hash of a file, or of all files in a folder. Raises ConfigError if it is missing and unknown."""
        name = str(path.absolute())
        if name not in self.by_path:
            if storage.exists(path):
                self.by_path[name] = content_hash(path)
            elif name in self._known:
                self.vanished.append(path.name)
                self.by_path[name] = self._known[name]
            else:
                raise ConfigError(f"{storage.abridge(path)} does not exist; a run of the sweep needs it.")
        return self.by_path[name]


def expand_runs(spec: SweepSpec, hashes: FileHashes, program: str | None = None) -> tuple[SweepRun, ...]:
    """Returns the runs in order, each once. Raises ConfigError, which names the first few faults.

    program: what did the runs of an existing sweep. None: what is here
    """
    program = identify_here() if program is None else program
    runs, faults = dict[str, SweepRun](), list[str]()
    told = _Labels(spec)
    for differing, fields in spec.fields():
        try:
            run = SweepRun.of(spec.kind, differing, fields, hashes.of, program)
        except FridaError as error:
            if str(error) not in faults:
                faults.append(str(error))
            if len(faults) == _MAX_FAULTS:
                break
            continue
        runs.setdefault(run.key, replace(run, labels=told.of(differing)))
    if faults:
        raise ConfigError(" ".join(faults))
    return tuple(runs.values())


class _Labels:
    """Labels for the values of the fields in which runs differ; no two values have the same label."""

    def __init__(self, spec: SweepSpec) -> None:
        self._named: dict[str, dict[str, Value]] = {name: {} for name in spec.axes}
        values = [(name, value) for name, several in spec.grid.items() for value in several]
        values += [(name, value) for run in spec.runs for name, value in run.items()]
        for name, value in values:
            self._named[name][repr(value)] = label(value)
        for name, known in self._named.items():
            if len(set(known.values())) < len(known):  # for example the same file name in several folders
                files = [value for field, value in values if field == name and isinstance(value, str)]
                if len(set(files)) == len(known) and all("/" in file for file in files):
                    above = os.path.commonpath([str(Path(file).parent) for file in files])
                    known |= {repr(file): str(Path(file).relative_to(above)) for file in files}
                else:
                    known |= {value: value for value in known}

    def of(self, differing: Fields) -> dict[str, Value]:
        """Returns the labels of a run with these fields."""
        return {name: self._named[name][repr(value)] for name, value in differing.items()}


SWEEP = "sweep.json"
TABLE = "table.parquet"
_FORMAT = "frida-painter sweep"
_LOCK = ".lock"
_PATIENCE = 600.0  # seconds, for a run that a dead driver left behind
_ROOM = 100 * 2**20  # bytes


def _lock_of(folder: Path) -> FileLock:
    return FileLock(folder / _LOCK, mode=0o600, fallback_to_soft=False, preserve_lock_file=True)


@contextlib.contextmanager
def _hold_lock(folder: Path, seconds: float = 0.0) -> Iterator[None]:
    """Holds the lock of a folder, which is made if it is missing.

    Raises Timeout if another process has it for all of these seconds, StorageError if the folder cannot be written.
    """
    lock = _lock_of(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock.acquire(timeout=seconds)
    except Timeout:
        raise
    except OSError as error:
        raise storage.cannot_write(folder, error) from error
    try:
        yield
    finally:
        lock.release()


class RunFolder:
    """Folder of one run of a sweep.

    key: of the run
    """

    def __init__(self, sweep: Path, key: str) -> None:
        self.path = sweep / "runs" / key

    @contextlib.contextmanager
    def lock(self) -> Iterator[None]:
        """Locks the folder for one process at a time; others wait for ten minutes.

        Raises TryFailed if that was in vain, StorageError if the folder cannot be written.
        """
        with contextlib.ExitStack() as held:
            try:
                held.enter_context(_hold_lock(self.path, _PATIENCE))
            except Timeout as busy:
                raise TryFailed(
                    f"{storage.abridge(self.path)} is locked by another process, which does not let go; end it."
                ) from busy
            yield

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
        if not (self.path / name).exists():
            return None
        try:
            return storage.read_json(self.path / name, what)
        except StorageError:
            return None


class SweepFolder:
    """Folder of a sweep."""

    def __init__(self, path: Path) -> None:
        self.path = path.absolute()

    def run(self, key: str) -> RunFolder:
        """Returns the folder of a run."""
        return RunFolder(self.path, key)

    @contextlib.contextmanager
    def lock(self) -> Iterator[None]:
        """Locks the folder for one driver.

        Raises SweepBusy if another process has it, StorageError if it cannot be used.
        """
        storage.require_space(self.path, _ROOM, "this sweep")
        if not self.is_begun and self._holds_something_else:
            raise StorageError(
                f"{storage.abridge(self.path)} holds something that is no sweep; choose a new folder with --out."
            )
        with contextlib.ExitStack() as held:
            try:
                held.enter_context(_hold_lock(self.path))
            except Timeout as busy:
                raise SweepBusy(
                    f"Another process works on {storage.abridge(self.path)}; wait until it is done, or look how far it "
                    f"is: frida-painter sweep status {storage.abridge(self.path)}"
                ) from busy
            yield

    @property
    def _holds_something_else(self) -> bool:
        """True if the folder holds more than the lock and what a killed process left. Raises StorageError."""
        try:
            there = {one.name for one in self.path.iterdir()} if self.path.exists() else set()
            return bool(there - {_LOCK, *(one.name for one in self.path.glob(f"{storage.PART}*"))})
        except OSError as error:
            raise storage.cannot_write(self.path, error) from error

    @property
    def is_begun(self) -> bool:
        """True if the folder contains a sweep."""
        return (self.path / SWEEP).exists()

    @property
    def is_held(self) -> bool:
        """True if a driver works on it now."""
        try:
            with _lock_of(self.path).acquire(blocking=False):
                return False
        except (Timeout, OSError):
            return True

    def keep(self, spec: SweepSpec, hashes: Mapping[str, str], slots: int) -> None:
        """Writes the request, with the versions that do the runs.

        hashes: of files by their paths
        slots: number of runs at the same time
        """
        storage.write_json(
            self.path / SWEEP,
            {
                "format": _FORMAT,
                "sweep": spec.model_dump(mode="json"),
                "files": dict(hashes),
                "slots": slots,
                "program": identify_here(),
            },
        )

    def read_request(self) -> tuple[SweepSpec, dict[str, str], int]:
        """Returns the latest request, the hashes of files by their paths, and the slots. Raises ConfigError."""
        path = self.path / SWEEP
        if not self.is_begun:
            raise ConfigError(
                f"{storage.abridge(self.path)} holds no sweep; give the folder of one, such as sweeps/NAME."
            )
        kept = storage.read_json(path, "a sweep", ConfigError)
        if kept.get("format") != _FORMAT:
            raise ConfigError(f"{storage.abridge(path)} is no sweep of this program; give the folder of one.")
        with storage.understanding(path, "a sweep", ConfigError):
            return SweepSpec.of(**kept["sweep"]), dict(kept["files"]), int(kept["slots"])

    def read_program(self) -> str:
        """Returns what did the runs of the latest request; the version alone if an older program wrote it."""
        kept = storage.read_json(self.path / SWEEP, "a sweep", ConfigError)
        return str(kept.get("program", version("frida-painter")))

    def copy_of(self, path: Path, content: str) -> Path:
        """Returns the copy of a picture with a given hash, and makes it if it is missing or damaged.

        Raises ConfigError if it cannot be made, or if the picture has changed since it was hashed.
        """
        copy = self.path / "inputs" / f"{path.stem[:60]}-{content[:16]}{path.suffix.lower()}"
        if not copy.is_file() or content_hash(copy) != content:
            storage.copy(path, copy, "a picture of the sweep", storage.MAX_BYTES, ConfigError)
            if content_hash(copy) != content:
                copy.unlink()
                raise ConfigError(f"{storage.abridge(path)} has changed while the sweep began; call it once more.")
        return copy

    def require_space(self) -> None:
        """Raises StorageError if its disk is almost full."""
        storage.require_space(self.path, 2**20, "the next run of this sweep")
