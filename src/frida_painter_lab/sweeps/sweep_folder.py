"""The folder of a sweep: lock, request, and the result of every run.

| file | content |
|---|---|
| sweep.json | the latest request of the sweep, with the hashes of its files |
| runs/KEY/ | one run: result.json if it is done, failure.json if its last try failed, plan and pictures |
| table.parquet | all results; it can be made again from the runs |
| index.html | the page of `sweep report` |
"""

import contextlib
from collections.abc import Iterator, Mapping
from pathlib import Path

from filelock import Timeout

from frida_painter import storage
from frida_painter.errors import ConfigError, StorageError, SweepBusy
from frida_painter.provenance import identify_here
from frida_painter_lab.runs import LOCK, hold_lock, lock_of
from frida_painter_lab.sweeps.sweep_spec import SweepSpec

SWEEP = "sweep.json"
TABLE = "table.parquet"
_FORMAT = "frida-painter sweep"
_ROOM = 100 * 2**20  # bytes


class SweepFolder:
    """Folder of a sweep."""

    def __init__(self, path: Path) -> None:
        self.path = path.absolute()

    @contextlib.contextmanager
    def lock(self) -> Iterator[None]:
        """Locks the folder for one driver.

        Raises SweepBusy if another process has it, StorageError if it cannot be used.
        """
        place = storage.abridge(self.path)
        storage.require_space(self.path, _ROOM, "this sweep")
        if not self.is_begun and self._holds_something_else():
            raise StorageError(f"{place} holds something that is no sweep; choose a new folder with --out.")
        busy = SweepBusy(
            f"Another process works on {place}; wait until it is done, or look how far it is: frida-painter sweep "
            f"status {place}"
        )
        with hold_lock(self.path, 0.0, busy):
            yield

    def _holds_something_else(self) -> bool:
        """Returns True if the folder holds more than the lock and what a killed process left. Raises StorageError."""
        try:
            there = {one.name for one in self.path.iterdir()} if self.path.exists() else set()
            return bool(there - {LOCK, *(one.name for one in self.path.glob(f"{storage.PART}*"))})
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
            with lock_of(self.path).acquire(blocking=False):
                return False
        except (Timeout, OSError):
            return True

    def keep(self, spec: SweepSpec, hashes: Mapping[str, str], slots: int) -> None:
        """Writes the request, with the program that does the runs.

        hashes: of files by their paths
        slots: number of runs at the same time
        """
        request = {"sweep": spec.model_dump(mode="json"), "files": dict(hashes), "slots": slots}
        storage.write_json(self.path / SWEEP, {"format": _FORMAT, **request, "program": identify_here()})

    def read_request(self) -> tuple[SweepSpec, dict[str, str], int, str]:
        """Returns the latest request: the sweep, hashes of files by path, slots, and what did the runs.

        Raises ConfigError.
        """
        path = self.path / SWEEP
        if not self.is_begun:
            raise ConfigError(
                f"{storage.abridge(self.path)} holds no sweep; give the folder of one, such as sweeps/NAME."
            )
        kept = storage.read_json(path, "a sweep", ConfigError)
        if kept.get("format") != _FORMAT:
            raise ConfigError(f"{storage.abridge(path)} is no sweep of this program; give the folder of one.")
        with storage.understanding(path, "a sweep", ConfigError):
            return SweepSpec.of(**kept["sweep"]), dict(kept["files"]), int(kept["slots"]), str(kept["program"])
