"""The carrier of all that is measured: an experiment asks a question, does runs, and shows what they gave.

An experiment is a row: its runs, a measure of one run, and tables, sentences and pictures of all. A run contains all
that decides its measurement, so that runs go on in any order and in any process. A run that is done stays on the disk,
and an interrupted experiment continues from there.
"""

import math
from abc import ABC, abstractmethod
from collections import UserDict
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, field, fields
from functools import cache, cached_property
from importlib import import_module
from pathlib import Path
from typing import Any, ClassVar, Self, TypeVar

import numpy as np
from torch import Tensor

from frida_painter.brush.library import StrokeLibrary
from frida_painter.errors import ConfigError, StorageError, TryFailed, WorkerUnfit
from frida_painter.system import images, storage
from frida_painter_lab.engine import Engine, Share, TaskLimits, slots_here
from frida_painter_lab.runs import Labels, Run, RunFolder, Value
from frida_painter_lab.targets import Target

Row = Mapping[str, Value]
AnyRun = TypeVar("AnyRun", bound=Run)
_REQUEST, _LIBRARY = "request.json", "library.npz"
_NO_IMPORT = (
    "Other processes cannot import {!r} from {!r}; put the class at the top of a module of an installed package or of "
    "a folder in PYTHONPATH, or call run(folder), which needs no other process."
)
_LIMITS = TaskLimits(seconds=6 * 3600.0, threads=1, memory=1500, tries=2)


@dataclass(frozen=True)
class Progress:
    """Progress of an experiment.

    share: of the work that is done, in [0, 1]
    doing: current work in words
    """

    share: float
    doing: str


Notify = Callable[[Progress], None]


def silent(progress: Progress) -> None:
    """Ignores progress."""


def within(notify: Notify, first: float, last: float) -> Notify:
    """Returns a listener for a part that takes an experiment from share `first` to share `last`."""
    return lambda progress: notify(Progress(first + (last - first) * progress.share, progress.doing))


@dataclass(frozen=True)
class ResultTable:
    """Table of results.

    title: above the table
    rows: all with the columns of the first one
    notes: sentences below it
    """

    title: str
    rows: Sequence[Row]
    notes: Sequence[str] = ()

    def cells(self) -> list[list[str]]:
        """Returns the values of each row as people read them."""
        return [[format_value(row[name]) for name in self.rows[0]] for row in self.rows]

    def markdown(self) -> str:
        """Returns the table in Markdown, numbers at the right and with four significant digits."""
        columns = tuple(self.rows[0]) if self.rows else ()
        words = {name for name in columns if any(isinstance(row[name], str | bool) for row in self.rows)}
        sides = ["---" if name in words else "---:" for name in columns]
        lines = [f"| {' | '.join(line)} |" for line in (columns, sides, *self.cells())]
        return "\n".join([f"**{self.title}**", "", *lines, *([""] if self.notes else []), *self.notes]) + "\n"


@dataclass(frozen=True)
class Outcome:
    """Outcome of an experiment.

    name: of the command
    title: one line for people
    settings: all that the runs share, and the seeds
    tables: results
    notes: sentences that explain the tables
    pictures: sRGB [3, H, W] in [0, 1], by the name of the file without its ending
    """

    name: str
    title: str
    settings: Mapping[str, Value | Sequence[Value]]
    tables: Sequence[ResultTable]
    notes: Sequence[str] = ()
    pictures: Mapping[str, Tensor] = field(default_factory=dict)

    def markdown(self) -> str:
        """Returns the outcome as a Markdown page."""
        parts = [f"# {self.title}\n", *(f"{note}\n" for note in self.notes)]
        parts += [f"![{name.replace('-', ' ')}]({name}.png)\n" for name in self.pictures]
        parts += [table.markdown() for table in self.tables]
        told = {
            name: ", ".join(map(format_value, value)) if isinstance(value, list | tuple) else value
            for name, value in self.settings.items()
        }
        return "\n".join([*parts, "Settings: " + "; ".join(f"{name} {value}" for name, value in told.items())]) + "\n"

    def save(self, folder: Path) -> None:
        """Writes table.json, table.md and the pictures to `folder`. Raises StorageError.

        Numbers that are not finite become null in table.json.
        """
        for name, picture in self.pictures.items():
            images.save(picture, folder / f"{name}.png")

        def plain(value: Value) -> Value:
            return None if isinstance(value, float) and not math.isfinite(value) else value

        tables = [
            {"title": table.title, "rows": [{name: plain(value) for name, value in row.items()} for row in table.rows]}
            for table in self.tables
        ]
        record = {
            "format": "frida-painter experiment", "experiment": self.name, "title": self.title,
            "settings": dict(self.settings), "notes": list(self.notes), "tables": tables,
            "pictures": [f"{name}.png" for name in self.pictures],
        }  # fmt: skip
        storage.write_text(folder / "table.md", self.markdown())
        storage.write_json(folder / "table.json", record)


def format_value(value: Value) -> str:
    """Returns a value of a table as people read it."""
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.4g}" if isinstance(value, float) else str(value).replace("|", r"\|")


@dataclass(frozen=True)
class Measurement:
    """Measurement of a run: numbers by name, pictures [3, H, W] by name, and sentences about it."""

    numbers: Mapping[str, float]
    pictures: Mapping[str, Tensor] = field(default_factory=dict)
    remarks: Sequence[str] = ()


@dataclass(frozen=True)
class Results:
    """Measurements of all runs, in order, with their labels."""

    found: Sequence[tuple[Labels, Measurement]]

    def having(self, **labels: Value) -> list[Measurement]:
        """Returns the measurements of the runs with these labels."""
        return [found for its, found in self.found if all(its[name] == value for name, value in labels.items())]

    def one(self, **labels: Value) -> Measurement:
        """Returns the measurement of the only run with these labels."""
        (found,) = self.having(**labels)
        return found

    def values(self, number: str, **labels: Value) -> list[float]:
        """Returns one of the numbers for all runs with these labels."""
        return [found.numbers[number] for found in self.having(**labels)]

    def mean(self, number: str, **labels: Value) -> float:
        """Returns the mean of `values`."""
        return float(np.mean(self.values(number, **labels)))

    def rows(self) -> tuple[Row, ...]:
        """Returns a table with a row for every run: its labels and its numbers."""
        return tuple({**labels, **found.numbers} for labels, found in self.found)

    def means(self, label: str) -> tuple[Row, ...]:
        """Returns a table with a row for every value of a label: the means of all numbers."""
        values = dict.fromkeys(its[label] for its, _ in self.found)
        names = list(self.found[0][1].numbers)
        return tuple({label: value, **{name: self.mean(name, **{label: value}) for name in names}} for value in values)


@dataclass(frozen=True, kw_only=True)
class Experiment(ABC):
    """Experiment: a question with its runs, the measure of a run, and tables, sentences and pictures of all.

    NAME: of its command and its folder
    TITLE: one line for people

    brush: brush of the project
    quick: True for the least work that runs every step; the figures then mean nothing
    """

    NAME: ClassVar[str]
    TITLE: ClassVar[str]

    brush: str = "broad"
    quick: bool = False

    @property
    def heading(self) -> str:
        """One line for people."""
        return self.TITLE

    def prepare(self, notify: Notify) -> Self:
        """Returns the experiment with all that its runs share, such as a stroke library."""
        return self

    @abstractmethod
    def runs(self) -> Sequence[Run]:
        """Returns the runs."""

    @abstractmethod
    def measure(self, run: Run, notify: Notify) -> Measurement:
        """Does and measures one run, and reports its progress."""

    def settings(self) -> Mapping[str, Value | Sequence[Value]]:
        """Returns all that the runs share, and the seeds."""
        return {"brush": self.brush}

    def tables(self, results: Results) -> Sequence[ResultTable]:
        """Returns the tables of all runs."""
        return [ResultTable("All runs", results.rows())]

    def notes(self, results: Results) -> Sequence[str]:
        """Returns sentences on the tables, for any result."""
        return ()

    def pictures(self, results: Results) -> Mapping[str, Tensor]:
        """Returns pictures by the names of their files."""
        return {}

    @cached_property
    def all_runs(self) -> Sequence[Run]:
        """Runs, computed once."""
        return self.runs()

    def report(self, results: Results) -> Outcome:
        """Returns the outcome of all measurements."""
        tables, notes = self.tables(results), self.notes(results)
        return Outcome(self.NAME, self.heading, self.settings(), tables, notes, self.pictures(results))

    def run(self, keep: Path | None = None, notify: Notify = silent) -> Outcome:
        """Does every run that is not in `keep`, in this process, and returns the outcome.

        keep: folder that keeps finished runs in case of an interruption; None to keep nothing
        notify: hears the progress

        Raises the errors of `measure`, and StorageError.
        """
        found, count = [], len(self.all_runs)
        for number, run in enumerate(self.all_runs):
            telling = within(notify, number / count, (number + 1) / count)
            found.append((run.labels, self.measure_or_load(run, keep, telling)))
        return self.report(Results(found))

    def run_in_processes(self, keep: Path, notify: Notify, jobs: int | None = None) -> Outcome:
        """Does as many runs at once as cores and memory allow; with one, in this process.

        keep: folder of finished runs
        jobs: greatest number of runs at once; None for no limit

        Raises ConfigError if its class stands in a script, TryFailed if runs failed, after all others are measured.
        """
        shares = self.shares(keep)
        slots = min(slots_here(_LIMITS, jobs), len(shares))
        if slots > 1:
            if type(self).__module__ == "__main__":
                raise ConfigError(_NO_IMPORT.format(type(self).__name__, "__main__"))
            self.keep_request(keep)
            failures = do_shares(measure_share, shares, keep, _LIMITS, slots, len(self.all_runs), notify)
            if failures:
                first = next(iter(failures.values()))
                raise TryFailed(
                    f"{len(failures)} parts of the experiment failed, the first is {first['words']}: {first['error']} "
                    "Run the command again to try them once more; the others are kept."
                )
        return self.run(keep, notify)

    def shares(self, keep: Path) -> list[Share]:
        """Returns the runs that are not in `keep`, each as a share."""
        return [Share((run,), str(keep), self) for run in self.all_runs if _load(keep, run) is None]

    def keep_request(self, keep: Path) -> None:
        """Writes the options, from which another process opens the same experiment. Raises StorageError."""
        told = {one.name: _plain(getattr(self, one.name), keep) for one in fields(self) if one.compare}
        place = f"{type(self).__module__}:{type(self).__qualname__}"
        storage.write_json(keep / _REQUEST, {"experiment": place, "options": told})

    def measure_or_load(self, run: Run, keep: Path | None, notify: Notify) -> Measurement:
        """Returns the measurement of a run, from `keep` if it is there. Raises StorageError, errors of `measure`."""
        if keep is None:
            return self.measure(run, notify)
        with RunFolder(keep, run.key).lock():
            measured = _load(keep, run)
            if measured is None:
                measured = self.measure(run, notify)
                self.keep(run, keep, measured)
            return measured

    def keep(self, run: Run, keep: Path, measured: Measurement) -> None:
        """Keeps a measurement in the folder of its run. Raises StorageError."""
        place, pictures = RunFolder(keep, run.key), measured.pictures
        for name in pictures:
            images.save(pictures[name], place.path / f"{name}.png")
        record = {"key": run.key, "labels": dict(run.labels), "numbers": dict(measured.numbers)}
        place.keep(record | {"pictures": list(pictures), "remarks": list(measured.remarks)})

    def collect_results(self, keep: Path) -> Results:
        """Returns the measurements of the runs that are done."""
        found = [(run.labels, _load(keep, run)) for run in self.all_runs]
        return Results([(labels, one) for labels, one in found if one is not None])


def measure_share(share: Share) -> None:
    """Does those runs of a share that are not done yet."""
    assert share.experiment is not None
    for run in share.runs:
        share.experiment.measure_or_load(run, Path(share.keep), silent)


def reopen(keep: str, keys: Sequence[str]) -> Share:
    """Returns runs of the experiment that was asked for in a folder, for another process than that which asked."""
    experiment = _read_request(keep)
    return Share(find_runs(experiment.all_runs, keys), keep, experiment)


def find_runs(runs: Iterable[AnyRun], keys: Sequence[str]) -> tuple[AnyRun, ...]:
    """Returns the runs with these keys. Raises WorkerUnfit if there are others here."""
    found = {run.key: run for run in runs}
    if not found.keys() >= set(keys):
        raise WorkerUnfit("The program or a picture has changed since the runs were asked for; begin again.")
    return tuple(found[key] for key in keys)


@cache
def _read_request(keep: str) -> Experiment:
    told = storage.read_json(Path(keep) / _REQUEST, "the request of an experiment")
    module, _, name = told["experiment"].partition(":")
    try:
        kind: type[Experiment] = getattr(import_module(module), name)
    except (AttributeError, ModuleNotFoundError) as cause:
        raise WorkerUnfit(_NO_IMPORT.format(name[:40], module[:40])) from cause
    if not issubclass(kind, Experiment):
        raise WorkerUnfit(f"{keep} asks for {name[:40]!r}, which is no experiment.")
    return kind(**{name: _value(plain) for name, plain in told["options"].items()})


def _plain(value: Any, keep: Path) -> Any:
    """Returns an option as plain values; a library that was painted goes into a file of `keep`."""
    if isinstance(value, StrokeLibrary):
        value.save(keep / _LIBRARY)
        return {"library": str(keep / _LIBRARY)}
    if isinstance(value, Target | Path):
        return {"target": str(value.path)} if isinstance(value, Target) else {"path": str(value)}
    if isinstance(value, tuple):
        return [_plain(one, keep) for one in value]
    return {"mapping": dict(value)} if isinstance(value, Mapping) else value


def _value(plain: Any) -> Any:
    if isinstance(plain, list):
        return tuple(map(_value, plain))
    if not isinstance(plain, dict):
        return plain
    ((kind, told),) = plain.items()
    return _KINDS[kind](told)


_KINDS: Mapping[str, Callable[[Any], Any]] = {
    "library": StrokeLibrary.load, "target": lambda path: Target.read(Path(path)), "path": Path, "mapping": dict,
}  # fmt: skip


def do_shares(
    work: Callable[[Share], object], shares: Sequence[Share], keep: Path, limits: TaskLimits, slots: int, total: int,
    notify: Notify,
) -> dict[str, dict[str, Any]]:  # fmt: skip
    """Does the shares in other processes, and returns why runs failed, by key; a failure stops no other run.

    keep: folder of finished runs, which takes the failures too
    slots: number of shares at the same time
    total: number of runs, with those that are done

    Raises StorageError if the disk is full, WorkerUnfit if processes cannot work.
    """
    left, failures = sum(len(share.runs) for share in shares), dict[str, dict[str, Any]]()

    def tell() -> None:
        failed = f", {len(failures)} failed" if failures else ""
        done = total - left - len(failures)
        notify(Progress(1 - left / total, f"{done} of {total} runs done{failed}, {slots} at the same time"))

    tell()
    with closing(Engine(limits, slots).run(work, shares)) as ended:
        for one in ended:
            left -= len(one.task.runs)
            if isinstance(one.error, WorkerUnfit):
                raise one.error
            if isinstance(one.error, StorageError):
                storage.require_space(keep, 2**20, "the next run")
            if one.error is not None:
                run = one.task.runs[0]
                why = {"key": run.key, "labels": dict(run.labels), "words": run.words, "error": str(one.error)}
                failures[run.key] = why
                with suppress(StorageError):  # another file is in place of its folder; the other runs go on
                    RunFolder(keep, run.key).keep_failure(why)
            tell()
    return failures


class _KeptPictures(UserDict[str, Any]):
    """Pictures of a kept measurement, in 8 bits; it holds their files, and reads each when it is asked for."""

    def __getitem__(self, name: str) -> Tensor:
        return images.load(self.data[name])


def _load(folder: Path, run: Run) -> Measurement | None:
    """Returns a kept measurement; None if it is missing or damaged."""
    place = RunFolder(folder, run.key)
    record = place.record()
    if record is None or not {"numbers", "pictures", "remarks"} <= record.keys():
        return None
    files = {name: place.path / f"{name}.png" for name in record["pictures"]}
    are_there = all(file.is_file() for file in files.values())
    return Measurement(record["numbers"], _KeptPictures(files), record["remarks"]) if are_there else None
