"""The pages of a sweep: how far it is (status.html), and what came out (index.html).

They open from the sweep's folder without a network; pictures are those of the runs.
"""

import math
import time
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from frida_painter import images, registry, storage
from frida_painter.lab.sweeps.folder import TABLE, FileHashes, SweepFolder, expanded
from frida_painter.lab.sweeps.spec import SweepRun, SweepSpec, Value
from frida_painter.report.page import Series, chart, template
from frida_painter.session.time_left import duration

if TYPE_CHECKING:
    import pyarrow


# How far a sweep is, and how long it still takes: by what the runs that ended took, and what the others are asked.

_LEAST_BETWEEN = 2.0  # seconds
_SHARE = 0.05  # of the time that may go into writing


@dataclass(frozen=True)
class SweepProgress:
    """How far a sweep is. seconds_left: None until a run has ended; slots: runs at the same time."""

    total: int
    done: int
    failed: int
    seconds_left: float | None
    slots: int


class Renewal:
    """Says when something that shows how far a sweep is should be written anew: seldom enough to cost little."""

    def __init__(self) -> None:
        self._next = time.monotonic() + _LEAST_BETWEEN

    @contextmanager
    def where_due(self) -> Iterator[bool]:
        """Whether it should be written now; what it takes in the block decides when it should be again."""
        started = time.monotonic()
        due = started >= self._next
        yield due
        if due:
            now = time.monotonic()
            self._next = now + max(_LEAST_BETWEEN, (now - started) / _SHARE)


class Tally:
    """Counts the runs of a sweep as they end. slots: runs at the same time."""

    def __init__(self, runs: Sequence[SweepRun], slots: int) -> None:
        self._total, self.slots = len(runs), slots
        self._left = sum(run.cost for run in runs)
        self._seconds = self._cost = 0.0
        self._done = self._failed = 0

    def done(self, run: SweepRun, record: Mapping[str, Any]) -> None:
        """A run is done."""
        self._done += 1
        self._left -= run.cost
        self._cost += run.cost
        self._seconds += record["times"]["wall_seconds"]

    def failed(self, run: SweepRun) -> None:
        """A run has failed for good."""
        self._failed += 1
        self._left -= run.cost

    @property
    def progress(self) -> SweepProgress:
        """How far it is."""
        at_once = max(1, min(self.slots, self._total - self._done - self._failed))
        seconds = max(0.0, self._left) * self._seconds / self._cost / at_once if self._cost else None
        return SweepProgress(self._total, self._done, self._failed, seconds, self.slots)


# How far a sweep is, read from its folder: while another process works on it, and after.

_SHOWN = 10


@dataclass(frozen=True)
class SweepStatus:
    """A sweep as its folder tells it: the runs, the records of those that are done, why others failed, by key.

    working: whether a process works on it now.
    """

    folder: Path
    spec: SweepSpec
    runs: tuple[SweepRun, ...]
    records: Mapping[str, Mapping[str, Any]]
    failures: Mapping[str, Mapping[str, Any]]
    progress: SweepProgress
    working: bool

    def lines(self) -> list[str]:
        """As a terminal shows it."""
        told = [f"{self.spec.title or self.folder.name}: {summary(self.progress, working=self.working)}"]
        told += [f"  {named(failure)}: {failure['error']}" for failure in list(self.failures.values())[:_SHOWN]]
        if len(self.failures) > _SHOWN:
            told.append(f"  and {len(self.failures) - _SHOWN} more that failed")
        return told


def status_of(folder: Path) -> SweepStatus:
    """How far the sweep in a folder is. Raises ConfigError where there is none."""
    place = SweepFolder(folder)
    spec, known, slots = place.asked()
    runs = expanded(spec, FileHashes(known, reread=False))
    tally, records, failures = Tally(runs, slots), dict[str, Any](), dict[str, Any]()
    for run in runs:
        kept = place.run(run.key)
        record = kept.record()
        if record is not None:
            records[run.key] = {**record, "labels": dict(run.labels)}
            tally.done(run, record)
        elif (failure := kept.failure()) is not None:
            failures[run.key] = failure
            tally.failed(run)
    return SweepStatus(place.path, spec, runs, records, failures, tally.progress, place.is_held)


def summary(progress: SweepProgress, *, working: bool) -> str:
    """How far it is in one sentence."""
    told = f"{progress.done} of {progress.total} runs done"
    if progress.failed:
        told += f", {progress.failed} failed"
    if progress.done + progress.failed >= progress.total:
        return f"{told}."
    if not working:
        return f"{told}, and nobody works on it; run the sweep again to continue."
    if progress.seconds_left is None:
        return f"{told}."
    return f"{told}, about {duration(progress.seconds_left)} left."


def named(failure: Mapping[str, Any]) -> str:
    """A run that failed by what tells it from the others."""
    return ", ".join(f"{name} {value}" for name, value in failure["labels"].items()) or str(failure["key"])


# What the results of a sweep show: means with confidence intervals, and paired tests between the values of a field.
#
# Two runs are a pair where they differ in one field alone: the same photograph, the same seed, and all else that was
# varied. Of many tests some would be significant by chance, so their p-values are adjusted by Holm's method.

CONFIDENCE = 0.95
_FEWEST = 3  # pairs, for a test


@dataclass(frozen=True)
class Result:
    """One run: the fields that were varied, and a figure of it."""

    labels: Mapping[str, Value]
    figure: float


@dataclass(frozen=True)
class Mean:
    """A mean over runs, and the interval that holds the true one with 95 % confidence; of one run only the value."""

    value: float
    low: float
    high: float
    count: int

    @classmethod
    def of(cls, values: Sequence[float]) -> "Mean":
        """By Student's t distribution."""
        from scipy.stats import t

        mean = float(np.mean(values))
        if len(values) < 2:
            return cls(mean, mean, mean, len(values))
        half = float(t.ppf((1 + CONFIDENCE) / 2, len(values) - 1) * np.std(values, ddof=1) / math.sqrt(len(values)))
        return cls(mean, mean - half, mean + half, len(values))


@dataclass(frozen=True)
class FieldEffect:
    """How a figure changes where a field goes from one value to another, all else being equal.

    difference: the mean of second - first; t, wilcoxon: p-values of the paired t-test and of Wilcoxon's signed-rank
    test, adjusted by Holm's method over all tests of a list; more: in how many pairs the second is larger.
    """

    field: str
    first: Value
    second: Value
    difference: Mean
    more: int
    t: float
    wilcoxon: float


def means(results: Iterable[Result], field: str, series: str | None) -> dict[Value, dict[float, Mean]]:
    """Means by the value of `series` (None: all runs together) and of a field of numbers, in their order."""
    groups: dict[Value, dict[float, list[float]]] = {}
    for one in results:
        place = one.labels.get(field)
        if isinstance(place, int | float):
            name = one.labels.get(series) if series is not None else None
            groups.setdefault(name, {}).setdefault(float(place), []).append(one.figure)
    return {
        name: {place: Mean.of(values) for place, values in sorted(points.items())} for name, points in groups.items()
    }


def paired_tests(results: Sequence[Result], fields: Iterable[str]) -> tuple[FieldEffect, ...]:
    """A test for every two values of every field that has three pairs of runs or more."""
    found = [
        test
        for field in fields
        for first, second in combinations(dict.fromkeys(one.labels.get(field) for one in results), 2)
        if (test := _test(results, field, first, second)) is not None
    ]
    t, wilcoxon = ([getattr(test, name) for test in found] for name in ("t", "wilcoxon"))
    adjusted = zip(found, holm(t), holm(wilcoxon), strict=True)
    return tuple(replace(test, t=its_t, wilcoxon=its_w) for test, its_t, its_w in adjusted)


def holm(values: Sequence[float]) -> list[float]:
    """P-values adjusted for their number (Holm 1979)."""
    order = sorted(range(len(values)), key=lambda index: values[index])
    adjusted, largest = [0.0] * len(values), 0.0
    for rank, index in enumerate(order):
        largest = max(largest, min(1.0, (len(values) - rank) * values[index]))
        adjusted[index] = largest
    return adjusted


def _test(results: Sequence[Result], field: str, first: Value, second: Value) -> FieldEffect | None:
    from scipy.stats import ttest_rel, wilcoxon

    sides: tuple[dict[object, float], dict[object, float]] = ({}, {})
    for one in results:
        if one.labels.get(field) in (first, second):
            rest = tuple(sorted((name, repr(value)) for name, value in one.labels.items() if name != field))
            sides[int(one.labels.get(field) != first)][rest] = one.figure
    both = [key for key in sides[0] if key in sides[1]]
    if len(both) < _FEWEST:
        return None
    before, after = (np.array([side[key] for key in both]) for side in sides)
    difference = after - before
    if not difference.any():
        p_t = p_wilcoxon = 1.0
    else:
        with warnings.catch_warnings():  # of differences that are all the same
            warnings.simplefilter("ignore", RuntimeWarning)
            p_t, p_wilcoxon = float(ttest_rel(after, before).pvalue), float(wilcoxon(difference).pvalue)
    return FieldEffect(
        field, first, second, Mean.of(difference.tolist()), int((difference > 0).sum()),
        0.0 if math.isnan(p_t) else p_t, p_wilcoxon,
    )  # fmt: skip


STATUS_PAGE, REPORT_PAGE = "status.html", "index.html"
_FIGURES = {
    "plan": ("plan dB", "loss of the plan"),
    "painting": ("painting dB", "sim2real error"),
    "evaluation": ("painting dB", "sim2real error"),
}
"""What a report is about, by the kind of run: the first that runs have."""
_MOST_PICTURES = 200
_MOST_FAILURES = 50
_MOST_SERIES = 5
_SEED = "seed"


@dataclass(frozen=True)
class _Picture:
    """A run on the contact sheet."""

    file: str
    caption: str


def write_status_page(status: SweepStatus) -> Path:
    """Writes how far it is; the page loads itself again while the sweep is at work. Raises StorageError."""
    path = status.folder / STATUS_PAGE
    storage.write_text(path, _page(status, [], [], (), ""))
    return path


def write_report(status: SweepStatus) -> Path:
    """Writes what came out: contact sheet, curves with confidence intervals, paired tests. Raises StorageError."""
    figure = figure_of(status)
    results = [] if figure is None else results_of(status, figure)
    varied = [name for name in status.spec.axes if len({repr(run.labels.get(name)) for run in status.runs}) > 1]
    charts = [] if figure is None else _charts(status, results, varied, figure)
    tests = paired_tests(results, [name for name in varied if name != _SEED])
    path = status.folder / REPORT_PAGE
    storage.write_text(path, _page(status, _contact_sheet(status, varied, figure), charts, tests, figure or ""))
    return path


def figure_of(status: SweepStatus) -> str | None:
    """The figure by which the runs are compared; None where no run has one."""
    known = {name for record in status.records.values() for name in record["figures"]}
    return next((name for name in _FIGURES[status.spec.kind] if name in known), None)


def results_of(status: SweepStatus, figure: str) -> list[Result]:
    """That figure of the runs that have it."""
    return [
        Result(run.labels, status.records[run.key]["figures"][figure])
        for run in status.runs
        if figure in status.records.get(run.key, {}).get("figures", {})
    ]


def _page(
    status: SweepStatus, pictures: Sequence[_Picture], charts: Sequence[str], tests: Sequence[FieldEffect], figure: str
) -> str:
    progress = status.progress
    failures = [(named(failure), failure["error"]) for failure in status.failures.values()]
    seconds = sum(record["times"]["cpu_seconds"] for record in status.records.values())
    facts: list[tuple[str, str]] = [("Kind of run", status.spec.kind)]
    for name in status.spec.axes:
        values = dict.fromkeys(run.labels.get(name) for run in status.runs)
        facts.append((name, ", ".join(map(_shown, values))))
    facts.append(("CPU time", duration(seconds)))
    html = template("sweep.html").render(
        title=status.spec.title or status.folder.name,
        summary=summary(progress, working=status.working),
        working=status.working,
        share=(progress.done + progress.failed) / max(progress.total, 1),
        facts=[(name, value if len(value) <= 400 else f"{value[:397]}...") for name, value in facts],
        failures=failures[:_MOST_FAILURES],
        more_failures=max(0, len(failures) - _MOST_FAILURES),
        pictures=pictures,
        left_out=max(0, len(status.records) - len(pictures)) if pictures else 0,
        charts=charts,
        tests=[_row(test) for test in tests],
        figure=figure,
    )
    return html.encode("utf-8", "replace").decode("utf-8")


def _contact_sheet(status: SweepStatus, varied: Sequence[str], figure: str | None) -> list[_Picture]:
    """The pictures of the runs in their order; of very many every so manieth."""
    done = [run for run in status.runs if run.key in status.records]
    name = "plan.png" if status.spec.kind == "plan" else "painting.png"
    found = []
    for run in done[:: -(-len(done) // _MOST_PICTURES) or 1]:
        value = status.records[run.key]["figures"].get(figure)
        told = "" if value is None else f": {value:.4g}"
        found.append(_Picture(f"runs/{run.key}/{name}", f"{_words(run, varied)}{told}"))
    return found


def _charts(status: SweepStatus, results: Sequence[Result], varied: Sequence[str], figure: str) -> list[str]:
    """A curve for every varied field of numbers, drawn for each value of the first other field with few; file names."""
    made = []
    for number, field in enumerate(name for name in varied if name != _SEED):
        values = {one.labels.get(field) for one in results}
        if len(values) < 2 or not all(isinstance(value, int | float) for value in values):
            continue
        others = [name for name in varied if name not in (field, _SEED)]
        few = (name for name in others if 2 <= len({one.labels.get(name) for one in results}) <= _MOST_SERIES)
        found = means(results, field, next(few, None))
        lines = [_series("all runs" if name is None else _shown(name), points) for name, points in found.items()]
        above = all(min(line.low) > 0 for line in lines)
        picture = chart(
            f"{figure} by {field}", field, f"{figure}; bars: 95 % confidence of the mean", lines, logarithmic=above
        )
        name = f"chart-{number}.png"
        images.save(picture, status.folder / name)
        made.append(name)
    return made


def _series(name: str, points: dict[float, Mean]) -> Series:
    mean, low, high = ([getattr(one, part) for one in points.values()] for part in ("value", "low", "high"))
    return Series(name, list(points), mean, low, high, band=False)


def _row(test: FieldEffect) -> tuple[str, ...]:
    change = test.difference
    return (
        test.field,
        f"{_shown(test.first)} → {_shown(test.second)}",
        f"{change.value:+.4g}",
        f"{change.low:+.4g} to {change.high:+.4g}",
        f"{test.more} of {change.count}",
        f"{test.t:.2g}",
        f"{test.wilcoxon:.2g}",
    )


def _words(run: SweepRun, varied: Sequence[str]) -> str:
    """What tells a run from the others."""
    told = [(name, run.labels.get(name)) for name in varied]
    return ", ".join(value if isinstance(value, str) else f"{name} {_shown(value)}" for name, value in told) or run.key


def _shown(value: Value) -> str:
    return f"{value:.4g}" if isinstance(value, float) else "none" if value is None else str(value)


# The table of a sweep, Parquet: a row for every run that has ended, for DuckDB, pandas, polars and whatever reads it.
#
# It is written anew as results come in, whole or not at all, so that it can be read at any moment. Columns: what
# differs
# between runs by its own name, "set NAME" for the other settings, figures, times, versions.


class TableWriter:
    """Writes the table of a sweep's folder; without pyarrow it writes none, and says so."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / TABLE
        self._installed = registry.is_installed("pyarrow")

    @property
    def remarks(self) -> tuple[str, ...]:
        """What a person should know of the table."""
        return () if self._installed else (registry.advice("table", "The table of results (Parquet)") + ".",)

    def write(self, records: Iterable[Mapping[str, Any]]) -> None:
        """Writes a row for each record. Raises StorageError."""
        if self._installed:
            write_table(self._path, [flat(record) for record in records])


def flat(record: Mapping[str, Any]) -> dict[str, Any]:
    """A record as one row of plain values."""
    times, labels = record.get("times", {}), record["labels"]
    settings = {f"set {name}": value for name, value in record.get("settings", {}).items() if name not in labels}
    goal = settings.pop("set goal", None)
    return {
        "key": record["key"],
        "kind": record["kind"],
        "status": "failed" if "error" in record else "done",
        **labels,
        **record.get("figures", {}),
        **times,
        **({} if goal is None else {"goal": "; ".join(": ".join(map(str, fact)) for fact in goal)}),
        **settings,
        **{f"version {name}": value for name, value in record.get("versions", {}).items()},
        "host": record.get("host"),
        "error": record.get("error"),
    }


def write_table(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Writes rows as Parquet; a column that mixes numbers and words holds words. Raises StorageError."""
    import pyarrow
    from pyarrow import parquet

    names = dict.fromkeys(name for row in rows for name in row)
    table = pyarrow.table({name: _column([row.get(name) for row in rows]) for name in names})
    with storage.replacing(path) as temporary:
        parquet.write_table(table, temporary)


def _column(values: Sequence[Any]) -> "pyarrow.Array[Any]":
    import pyarrow

    kinds = {type(value) for value in values if value is not None}
    if kinds <= {int, float} and len(kinds) == 2:
        return pyarrow.array(values, pyarrow.float64())
    if len(kinds) <= 1 and kinds <= {int, float, bool, str}:
        return pyarrow.array(values)
    return pyarrow.array([None if value is None else str(value) for value in values], pyarrow.string())
