"""The pages of a sweep: how far it is (status.html), and what came out (index.html).

They open from the sweep's folder without a network; pictures are those of the runs.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from frida_painter import images, storage
from frida_painter.report.chart import Series, chart
from frida_painter.report.page import template
from frida_painter.session.forecast import duration
from frida_painter.sweeps.run import SweepRun, Value
from frida_painter.sweeps.statistics import FieldEffect, Mean, Result, means, paired_tests
from frida_painter.sweeps.status import SweepStatus, named, summary

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
