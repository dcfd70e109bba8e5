"""A sweep from its description to its folder: what was done is not done again, and what fails stops nothing else."""

import platform
import re
from collections.abc import Callable, Iterable, Mapping
from contextlib import closing, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from frida_painter import extras
from frida_painter.errors import ConfigError, StorageError, WorkerUnfit
from frida_painter.sweeps.engine import Engine, LocalEngine, TaskLimits, slots_here
from frida_painter.sweeps.expansion import FileHashes, expanded
from frida_painter.sweeps.folder import SweepFolder
from frida_painter.sweeps.progress import Renewal, SweepProgress, Tally
from frida_painter.sweeps.ray_engine import RayEngine
from frida_painter.sweeps.report import write_status_page
from frida_painter.sweeps.run import SweepRun
from frida_painter.sweeps.spec import EngineName, SweepSpec
from frida_painter.sweeps.status import SweepStatus
from frida_painter.sweeps.table import TableWriter
from frida_painter.sweeps.worker import Assignment, perform

MANY = 10_000
"""Runs above which a person is asked first."""

Record = Mapping[str, Any]


@dataclass(frozen=True)
class SweepOutcome:
    """What came of a sweep: the runs, in order, the records of those that are done, and why others failed, by key.

    done_before: how many of them earlier calls had done.
    """

    folder: Path
    runs: tuple[SweepRun, ...]
    records: Mapping[str, Record]
    failures: Mapping[str, Record]
    done_before: int = 0
    remarks: tuple[str, ...] = ()


Notify = Callable[[SweepProgress], None]


def sweep(
    what: str | Path | SweepSpec | Mapping[str, Any],
    folder: str | Path | None = None,
    *,
    engine: EngineName | None = None,
    address: str | None = None,
    jobs: int | None = None,
    notify: Notify = lambda progress: None,
    most: int | None = MANY,
) -> SweepOutcome:
    """Does all runs of a sweep that are not done yet, and returns what came of all of them.

    what: a TOML file, or the same as a mapping, such as {"kind": "plan", "grid": {"image": ["a.jpg"], "seed": [0, 1]}};
    folder: of the sweep, by default one below "sweeps"; the same one again goes on where it was left;
    engine: by default Ray where it is installed, otherwise processes; address: of a Ray cluster, None: this machine;
    jobs: runs at the same time, by default as many as there are cores and memory for;
    most: runs, above which it refuses, None: any number.
    In a script of your own call it below `if __name__ == "__main__":`, for it starts processes. Raises ConfigError for
    what makes no sweep, SweepBusy where another process works on the folder, StorageError where the disk is full, and
    WorkerUnfit where processes cannot work.
    """
    spec = _spec_of(what)
    refuse_many(spec, most)
    place = SweepFolder(Path(folder) if folder is not None else default_folder(spec))
    limits = TaskLimits(spec.time_limit, spec.threads, spec.memory, spec.tries)
    with place.held():
        hashes = FileHashes(place.asked()[1] if place.is_begun else None)
        runs = expanded(spec, hashes)
        driver = _Driver(place, spec, runs, hashes, notify)
        opened = None
        if driver.left:
            opened = open_engine(limits, len(driver.left), engine=engine, address=address, jobs=jobs)
        place.keep(spec, hashes.by_path, 1 if opened is None else opened.slots)
        try:
            if opened is not None:
                driver.lead(opened)
        finally:
            driver.show(working=False)
        return driver.outcome()


def refuse_many(spec: SweepSpec, most: int | None) -> None:
    """Raises ConfigError for more runs than `most`."""
    if most is not None and spec.count > most:
        raise ConfigError(f"The sweep has {spec.count:,} runs, and {most:,} are the most without --yes (most=None).")


def default_folder(spec: SweepSpec) -> Path:
    """Where a sweep goes when nobody says otherwise."""
    return Path("sweeps") / (re.sub(r"[^\w.]+", "-", spec.title).strip("-.") or "sweep")


def open_engine(
    limits: TaskLimits,
    tasks: int,
    *,
    engine: EngineName | None = None,
    address: str | None = None,
    jobs: int | None = None,
) -> Engine:
    """The engine for that many tasks: Ray where it is installed, or processes. jobs: at the same time, at the most.

    Raises ConfigError where Ray is asked for and is not installed, or where the address does not answer.
    """
    if address is not None and engine == "processes":
        raise ConfigError("--address is for Ray, and --engine processes is this machine alone; leave out one of them.")
    slots = max(1, min(slots_here(limits, jobs), tasks))
    if address is not None or engine == "ray" or (engine is None and extras.is_installed("ray")):
        return RayEngine(limits, slots, address)
    return LocalEngine(limits, slots)


def _spec_of(what: str | Path | SweepSpec | Mapping[str, Any]) -> SweepSpec:
    if isinstance(what, SweepSpec):
        return what
    return SweepSpec.of_files(dict(what), Path.cwd()) if isinstance(what, Mapping) else SweepSpec.from_toml(Path(what))


class _Driver:
    """Leads an engine through the runs that are left, and writes down what comes."""

    def __init__(
        self, place: SweepFolder, spec: SweepSpec, runs: tuple[SweepRun, ...], hashes: FileHashes, notify: Notify
    ) -> None:
        self._place, self._spec, self._runs, self._hashes, self._notify = place, spec, runs, hashes, notify
        self._records: dict[str, Record] = {}
        self._failures: dict[str, Record] = {}
        self._table = TableWriter(place.path)
        self._renewal = Renewal()
        self._tally = Tally(runs, 1)
        for run in runs:
            record = place.run(run.key).record()
            if record is not None:
                self._take(run, record)
        self._before = len(self._records)

    @property
    def left(self) -> list[SweepRun]:
        """The runs that are not done."""
        return [run for run in self._runs if run.key not in self._records]

    def lead(self, engine: Engine) -> None:
        """Has the engine do what is left. Raises StorageError, WorkerUnfit."""
        self._tally.slots = engine.slots
        self._notify(self._tally.progress)
        copies = self._copies(self.left)
        tasks = [Assignment(run.with_pictures(copies), str(self._place.path)) for run in self.left]
        with closing(engine.run(perform, tasks)) as ended:
            for one in ended:
                if one.error is None:
                    self._take(one.task.run, one.value)
                else:
                    self._note_failure(one.task.run, one.error)
                with self._renewal.where_due() as due:
                    if due:
                        self.show(working=True)
                self._notify(self._tally.progress)

    def show(self, *, working: bool) -> None:
        """Writes table and page. Raises StorageError."""
        ended = (self._records.get(run.key) or self._failures.get(run.key) for run in self._runs)
        self._table.write(record for record in ended if record is not None)
        write_status_page(
            SweepStatus(
                self._place.path, self._spec, self._runs, self._records, self._failures, self._tally.progress, working
            )
        )

    def outcome(self) -> SweepOutcome:
        """What came of it."""
        vanished = self._hashes.vanished
        names = ", ".join(sorted(vanished))
        remarks = [f"{names} vanished; the copy in the sweep's folder is used."] if vanished else []
        return SweepOutcome(
            self._place.path, self._runs, self._records, self._failures, self._before,
            (*remarks, *self._table.remarks),
        )  # fmt: skip

    def _take(self, run: SweepRun, record: Record) -> None:
        # Its labels are those of today: a run may have been done for another sweep in this folder.
        self._records[run.key] = {**record, "labels": dict(run.labels)}
        self._tally.done(run, record)

    def _note_failure(self, run: SweepRun, error: Exception) -> None:
        if isinstance(error, WorkerUnfit):
            raise error
        if isinstance(error, StorageError):
            self._place.require_space()
        failure = {
            "key": run.key, "kind": run.kind, "labels": dict(run.labels), "error": str(error),
            "times": {"ended": datetime.now(UTC).isoformat(timespec="milliseconds")}, "host": platform.node(),
        }  # fmt: skip
        with suppress(StorageError):  # something else stands where its folder was: the others go on
            self._place.run(run.key).keep_failure(failure)
        self._failures[run.key] = failure
        self._tally.failed(run)

    def _copies(self, runs: Iterable[SweepRun]) -> dict[str, str]:
        """Copies of the pictures by their paths."""
        paths = dict.fromkeys(path for run in runs for path in run.pictures)
        return {
            path: str(self._place.copy_of(Path(path), self._hashes.by_path[str(Path(path).absolute())]))
            for path in paths
        }
