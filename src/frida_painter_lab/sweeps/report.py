"""What a sweep gave: its progress, its statistics, its table, and its page (index.html).

The page works from the sweep's folder without a network; its pictures are those of the runs.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from frida_painter import registry
from frida_painter.errors import ConfigError
from frida_painter.report.chart import Series, chart
from frida_painter.report.page import template
from frida_painter.session.time_left import duration
from frida_painter.system import images, storage
from frida_painter_lab.runs import RunFolder, Value
from frida_painter_lab.statistics import FieldEffect, Result, means, paired_tests
from frida_painter_lab.sweeps.sweep_spec import TABLE, FileHashes, SweepFolder, SweepRun, SweepSpec, expand_runs

Record = Mapping[str, Any]

# State of a sweep, folded from its folder: during the work of another process and after it.

_SHOWN = 10


@dataclass(frozen=True)
class SweepState:
    """State of a sweep.

    runs: all of them, in order
    records: results of the finished runs, by key
    failures: reasons of failed runs, by key
    slots: number of runs at the same time
    working: True if a process works on it now
    done_before: number of runs that earlier calls had finished
    remarks: sentences for a person
    """

    folder: Path
    spec: SweepSpec
    runs: tuple[SweepRun, ...]
    records: Mapping[str, Record]
    failures: Mapping[str, Record]
    slots: int
    working: bool = False
    done_before: int = 0
    remarks: tuple[str, ...] = ()

    @property
    def seconds_left(self) -> float:
        """Seconds for the runs that have not ended, each as long as the mean of the finished ones; infinite if none."""
        left = len(self.runs) - len(self.records) - len(self.failures)
        took = [record["times"]["wall_seconds"] for record in self.records.values()]
        return left * float(np.mean(took)) / max(1, min(self.slots, left)) if took else math.inf

    @property
    def summary(self) -> str:
        """Progress in one sentence."""
        done, failed, total = len(self.records), len(self.failures), len(self.runs)
        told = f"{done} of {total} runs done" + (f", {failed} failed" if failed else "")
        if done + failed >= total:
            return f"{told}."
        if not self.working:
            return f"{told}, and nobody works on it; run the sweep again to continue."
        return f"{told}." if math.isinf(self.seconds_left) else f"{told}, about {duration(self.seconds_left)} left."

    def lines(self) -> list[str]:
        """Returns the state as lines for a terminal."""
        told = [f"{self.spec.title or self.folder.name}: {self.summary}"]
        told += [f"  {describe_run(failure)}: {failure['error']}" for failure in list(self.failures.values())[:_SHOWN]]
        if len(self.failures) > _SHOWN:
            told.append(f"  and {len(self.failures) - _SHOWN} more that failed")
        return told

    def table(self) -> list[dict[str, Any]]:
        """Returns a row of plain values for each run that ended, as in table.parquet; `pandas.DataFrame` takes it."""
        ended = (self.records.get(run.key) or self.failures.get(run.key) for run in self.runs)
        return [flat(record) for record in ended if record is not None]

    def compare(self, field: str, figure: str) -> "tuple[FieldEffect, ...]":
        """Returns the effect of a field on a figure, as the report tells it: paired runs, intervals, Holm's method.

        Raises ConfigError if runs do not differ in that field, or if none has that figure.
        """
        figures = {name for record in self.records.values() for name in record["figures"]}
        for name, known, what in (
            (field, self.spec.axes, "a field in which runs differ"),
            (figure, figures, "a figure"),
        ):
            if name not in known:
                raise ConfigError(f"{name[:40]!r} is not {what}; there are {', '.join(sorted(known)) or 'none'}.")
        return paired_tests(self.results(figure), [field])

    def results(self, figure: str) -> "list[Result]":
        """Returns a figure of the runs that have it."""
        done = [(run.labels, self.records[run.key]["figures"]) for run in self.runs if run.key in self.records]
        return [Result(labels, figures[figure]) for labels, figures in done if figure in figures]


def read_state(folder: Path) -> SweepState:
    """Returns the state of the sweep in a folder. Raises ConfigError if there is none."""
    place = SweepFolder(folder)
    spec, known, slots, program = place.read_request()
    return fold(place, spec, expand_runs(spec, FileHashes(known), program), slots)


def fold(place: SweepFolder, spec: SweepSpec, runs: tuple[SweepRun, ...], slots: int) -> SweepState:
    """Returns the state of these runs. slots: number of runs at the same time."""
    records, failures = dict[str, Record](), dict[str, Record]()
    for run in runs:
        kept = RunFolder(place.path, run.key)
        if (record := kept.record()) is not None:
            records[run.key] = {**record, "labels": dict(run.labels)}  # it may have been done for another sweep
        elif (failure := kept.failure()) is not None:
            failures[run.key] = failure
    return SweepState(place.path, spec, runs, records, failures, slots, place.is_held)


def describe_run(failure: Mapping[str, Any]) -> str:
    """Returns the name of a failed run: its labels."""
    return ", ".join(f"{name} {value}" for name, value in failure["labels"].items()) or str(failure["key"])


REPORT_PAGE = "index.html"
_FIGURES = {
    "plan": ("plan dB", "loss of the plan"),
    "painting": ("painting dB", "sim2real error"),
    "evaluation": ("painting dB", "sim2real error"),
}
"""Figures of a report by the kind of run; the first one that the runs have is used."""
_MAX_PICTURES = 200
_MAX_FAILURES = 50
_MAX_SERIES = 5
_SEED = "seed"


def write_report(state: SweepState) -> Path:
    """Writes the results: contact sheet, curves with confidence intervals, paired tests. Raises StorageError."""
    known = {name for record in state.records.values() for name in record["figures"]}
    figure = next((name for name in _FIGURES[state.spec.kind] if name in known), "")
    results = state.results(figure)
    varied = [name for name in state.spec.axes if len({repr(run.labels.get(name)) for run in state.runs}) > 1]
    failures = [(describe_run(failure), failure["error"]) for failure in state.failures.values()]
    facts: list[tuple[str, str]] = [("Kind of run", state.spec.kind)]
    for name in state.spec.axes:
        told = ", ".join(map(_format_value, dict.fromkeys(run.labels.get(name) for run in state.runs)))
        facts.append((name, told if len(told) <= 400 else f"{told[:397]}..."))
    facts.append(("CPU time", duration(sum(record["times"]["cpu_seconds"] for record in state.records.values()))))
    done = [run for run in state.runs if run.key in state.records]
    pictures = []
    for run in done[:: -(-len(done) // _MAX_PICTURES) or 1]:  # an even selection of very many
        told = ", ".join(
            value if isinstance(value := run.labels.get(name), str) else f"{name} {_format_value(value)}"
            for name in varied
        )
        value = state.records[run.key]["figures"].get(figure)
        caption = (told or run.key) + ("" if value is None else f": {value:.4g}")
        picture = "plan.png" if state.spec.kind == "plan" else "painting.png"
        pictures.append({"file": f"runs/{run.key}/{picture}", "caption": caption})
    html = template("sweep.html").render(
        title=state.spec.title or state.folder.name,
        summary=state.summary,
        facts=facts,
        failures=failures[:_MAX_FAILURES],
        more_failures=max(0, len(failures) - _MAX_FAILURES),
        pictures=pictures,
        left_out=len(done) - len(pictures),
        charts=_charts(state, results, varied, figure),
        tests=[_row(test) for test in paired_tests(results, [name for name in varied if name != _SEED])],
        figure=figure,
    )
    path = state.folder / REPORT_PAGE
    storage.write_text(path, html.encode("utf-8", "replace").decode("utf-8"))
    return path


def _charts(state: SweepState, results: Sequence[Result], varied: Sequence[str], figure: str) -> list[str]:
    """Writes a chart for every varied numeric field; returns the file names.

    A chart has a line for each value of another varied field with few values, if there is one.
    """
    made = []
    for number, field in enumerate(name for name in varied if name != _SEED):
        values = {one.labels.get(field) for one in results}
        if len(values) < 2 or not all(isinstance(value, int | float) for value in values):
            continue
        others = [name for name in varied if name not in (field, _SEED)]
        few = (name for name in others if 2 <= len({one.labels.get(name) for one in results}) <= _MAX_SERIES)
        lines = []
        for name, points in means(results, field, next(few, None)).items():
            mean, low, high = ([getattr(one, part) for one in points.values()] for part in ("value", "low", "high"))
            told = "all runs" if name is None else _format_value(name)
            lines.append(Series(told, list(points), mean, low, high, band=False))
        above = all(min(line.low) > 0 for line in lines)
        words = f"{figure}; bars: 95 % confidence of the mean"
        made.append(f"chart-{number}.png")
        images.save(chart(f"{figure} by {field}", field, words, lines, logarithmic=above), state.folder / made[-1])
    return made


def _row(test: FieldEffect) -> tuple[str, ...]:
    change = test.difference
    return (
        test.field,
        f"{_format_value(test.first)} → {_format_value(test.second)}",
        f"{change.value:+.4g}",
        f"{change.low:+.4g} to {change.high:+.4g}",
        f"{test.more} of {change.count}",
        f"{test.t:.2g}",
        f"{test.wilcoxon:.2g}",
    )


def _format_value(value: Value) -> str:
    return f"{value:.4g}" if isinstance(value, float) else "none" if value is None else str(value)


# The table of a sweep in Parquet: a row for every ended run, for DuckDB, pandas, polars and others.
# It is written again as results come in, completely or not at all, so that it can be read at any moment. Columns: the
# varied fields by their names, "set NAME" for the other settings, figures, times, versions.


def keep_table(state: SweepState) -> tuple[str, ...]:
    """Writes the table of a sweep; returns a remark instead if pyarrow is not installed. Raises StorageError."""
    if not registry.is_installed("pyarrow"):
        return (registry.advice("table", "The table of results (Parquet)") + ".",)
    write_table(state.folder / TABLE, state.table())
    return ()


def flat(record: Mapping[str, Any]) -> dict[str, Any]:
    """Returns a record as one row of plain values."""
    times, labels = record.get("times", {}), record["labels"]
    settings = {f"set {name}": value for name, value in record.get("settings", {}).items() if name not in labels}
    goal = settings.pop("set goal", None)
    return {
        "key": record["key"],
        "kind": record.get("kind"),
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
    """Writes rows as Parquet; a column with numbers and words becomes words. Raises StorageError."""
    import pyarrow
    from pyarrow import parquet

    names = dict.fromkeys(name for row in rows for name in row)
    table = pyarrow.table({name: _column([row.get(name) for row in rows]) for name in names})
    with storage.replacing(path) as temporary:
        parquet.write_table(table, temporary)


def _column(values: Sequence[Any]) -> Any:
    import pyarrow

    kinds = {type(value) for value in values if value is not None}
    if kinds <= {int, float} and len(kinds) == 2:
        return pyarrow.array(values, pyarrow.float64())
    if len(kinds) <= 1 and kinds <= {int, float, bool, str}:
        return pyarrow.array(values)
    return pyarrow.array([None if value is None else str(value) for value in values], pyarrow.string())
