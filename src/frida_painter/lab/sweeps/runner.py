"""Runs a sweep from its description to its folder. Finished runs are not repeated, and a failure stops no other run."""

import math
import platform
import re
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from frida_painter import images, registry
from frida_painter.errors import ConfigError, PlanError, StorageError, WorkerUnfit
from frida_painter.lab.sweeps.engine import Engine, LocalEngine, RayEngine, TaskLimits, slots_here
from frida_painter.lab.sweeps.report import (
    FieldEffect,
    Renewal,
    Result,
    SweepProgress,
    SweepStatus,
    TableWriter,
    Tally,
    flat,
    paired_tests,
    write_status_page,
)
from frida_painter.lab.sweeps.sweep_folder import FileHashes, RunFolder, SweepFolder, expand_runs
from frida_painter.lab.sweeps.sweep_spec import EngineName, SweepRun, SweepSpec
from frida_painter.plan import Plan
from frida_painter.provenance import describe_here, identify
from frida_painter.runs.painting_folder import hash_files
from frida_painter.runs.run import PaintingRun
from frida_painter.runs.settle import ground_of
from frida_painter.runs.spec import RunSpec

# A run in a process of an engine: plans, paints or evaluates it, and writes the results to its folder.
# This module is loaded before the first run, so that no run waits for PyTorch.


@dataclass(frozen=True)
class Assignment:
    """Run with the folder of its sweep; every machine that works on it must see the folder under this path."""

    run: SweepRun
    sweep: str


def perform(assignment: Assignment) -> dict[str, Any]:
    """Does a run, and returns its record, which is also in its folder. A run that is already done is only read.

    A lock on the folder keeps a process that a dead driver left behind from doing the same run.
    Raises WorkerUnfit if this machine has another version of the program or does not see the folder, StorageError
    if nothing can be written, and the errors of the run.
    """
    run, sweep = assignment.run, Path(assignment.sweep)
    made_with = describe_here()
    here = identify(made_with)
    if here != run.program:
        raise WorkerUnfit(
            f"{platform.node()} has {here}, and the sweep was begun with {run.program}; install one version everywhere."
        )
    if not sweep.is_dir():
        raise WorkerUnfit(
            f"{platform.node()} does not see {sweep}; put the sweep into a folder that all machines share (--out)."
        )
    folder = RunFolder(sweep, run.key)
    with folder.lock():
        known = folder.record()
        if known is not None:
            return known
        started, cpu = time.perf_counter(), time.process_time()
        made = None if run.plan is None else Plan.load(run.plan)
        with PaintingRun(run.spec if made is None else fix_to_plan(run.spec, made)) as opened:
            figures = _figures(run.kind, opened, made, folder)
        times = {
            "cpu_seconds": time.process_time() - cpu,
            "wall_seconds": time.perf_counter() - started,
            "ended": datetime.now(UTC).isoformat(timespec="milliseconds"),
        }
        record = {
            "key": run.key,
            "kind": run.kind,
            "labels": dict(run.labels),
            "settings": {**opened.spec.record(), "goal": [list(fact) for fact in opened.spec.goal_facts]},
            "figures": {name: value for name, value in figures.items() if math.isfinite(value)},
            "times": times,
            "versions": made_with,
            "host": platform.node(),
            "files": hash_run(folder.path),
        }
        folder.keep(record)
        return record


def hash_run(folder: Path) -> dict[str, str]:
    """Returns the hashes of the plan and the pictures of a run by their names."""
    return {name: found for name, found in hash_files(folder).items() if name != "result.json"}


def fix_to_plan(spec: RunSpec, plan: Plan) -> RunSpec:
    """Returns the spec of a painting that paints the plan without changes, on its own canvas."""
    wells = max(end - first for first, end in (layer.paints for layer in plan.layers))
    brushes = ",".join(layer.brush for layer in plan.layers) if len(plan.brushes) > 1 else plan.brushes[0]
    return spec.with_values(
        strokes=len(plan),
        layers=None,
        colors=wells,
        brushes=brushes,
        ground=ground_of(plan),
        canvas=plan.canvas,
        fit="crop",
        replans=0,
    )


def _figures(kind: str, opened: PaintingRun, made: Plan | None, folder: RunFolder) -> Mapping[str, float]:
    """Does the work, stores plan and pictures, and returns their figures.

    made: the plan to evaluate; None to make one
    """
    planner, target, bare = opened.planner, opened.target, opened.planner.bare
    plan = opened.plan() if made is None else made
    if made is None:
        plan.save(folder.path / "plan.json")
    picture = planner.expected(plan, bare)
    images.save(picture, folder.path / "plan.png")
    figures: dict[str, float] = {"strokes planned": len(plan), "loss of the plan": planner.expected_loss(plan, bare)}
    forecast = planner.forecast(plan, bare)
    if forecast is not None:
        figures["expected dB"] = forecast.expected
    if target is not None:
        figures["plan dB"] = psnr(picture, target)
    if kind != "plan":
        painting = opened.simulate(plan)
        images.save(painting.photograph, folder.path / "painting.png")
        seen = images.fit(painting.photograph, *picture.shape[1:])
        figures["strokes painted"] = painting.painted
        figures["robot seconds"] = painting.robot_seconds
        figures["sim2real error"] = float((seen - picture).square().mean())
        if target is not None:
            figures["painting dB"] = psnr(seen, target)
    return figures


def psnr(picture: Tensor, target: Tensor) -> float:
    """Returns the peak signal-to-noise ratio of a picture [3, H, W] to a target of any size, in dB."""
    with torch.no_grad():
        error = (picture - images.fit(target, *picture.shape[1:])).square().mean()
    return float(-10 * error.clamp(min=1e-12).log10())


MANY = 10_000
"""Number of runs above which a person is asked first."""

Record = Mapping[str, Any]


@dataclass(frozen=True)
class SweepOutcome:
    """Outcome of a sweep.

    runs: all of them, in order
    records: of the finished runs, by key
    failures: reasons of failed runs, by key
    done_before: number of runs that earlier calls had finished
    """

    folder: Path
    runs: tuple[SweepRun, ...]
    records: Mapping[str, Record]
    failures: Mapping[str, Record]
    done_before: int = 0
    remarks: tuple[str, ...] = ()

    def table(self) -> list[dict[str, Any]]:
        """Returns a row of plain values for each run that ended, as in table.parquet; `pandas.DataFrame` takes it."""
        ended = (self.records.get(run.key) or self.failures.get(run.key) for run in self.runs)
        return [flat(record) for record in ended if record is not None]

    def compare(self, field: str, figure: str) -> tuple[FieldEffect, ...]:
        """Returns the effect of a field on a figure, as the report tells it: paired runs, intervals, Holm's method.

        Raises ConfigError if runs do not differ in that field, or if none has that figure.
        """
        done = [(run.labels, self.records[run.key]["figures"]) for run in self.runs if run.key in self.records]
        fields, figures = {name for labels, _ in done for name in labels}, {name for _, all_ in done for name in all_}
        for name, known, what in ((field, fields, "a field in which runs differ"), (figure, figures, "a figure")):
            if name not in known:
                raise ConfigError(f"{name[:40]!r} is not {what}; there are {', '.join(sorted(known)) or 'none'}.")
        results = [Result(labels, found[figure]) for labels, found in done if figure in found]
        return paired_tests(results, [field])


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
    """Does all runs of a sweep that are not done yet, and returns the outcome of all.

    what: TOML file, or the same as a mapping, such as {"kind": "plan", "grid": {"image": ["a.jpg"], "seed": [0,
        1]}}
    folder: of the sweep, by default one below "sweeps"; the same one again continues the sweep
    engine: by default Ray if it is installed, otherwise processes
    address: of a Ray cluster; None for this machine
    jobs: number of runs at the same time; by default as many as cores and memory allow
    notify: hears the progress
    most: greatest number of runs; None for any

    A script must call it below `if __name__ == "__main__":`, because it starts processes.
    Raises ConfigError for an invalid sweep, SweepBusy if another process works on the folder, StorageError if the
    disk is full, WorkerUnfit if processes cannot work.

        >>> import frida_painter as fp
        >>> wanted = {"settings": {"image": "photo.jpg", "strokes": 5, "render_height": 64}, "grid": {"seed": [0, 1]}}
        >>> if __name__ == "__main__":  # a sweep starts processes
        ...     outcome = fp.sweep(wanted, "seeds", engine="processes", jobs=1)
        ...     print(len(outcome.records), len(outcome.failures))
        2 0
    """
    spec = _spec_of(what)
    refuse_many(spec, most)
    place = SweepFolder(Path(folder) if folder is not None else default_folder(spec))
    limits = TaskLimits(spec.time_limit, spec.threads, spec.memory, spec.tries)
    with place.lock():
        hashes = FileHashes(place.read_request()[1] if place.is_begun else None)
        runs = expand_runs(spec, hashes)
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
    """Returns the default folder of a sweep."""
    return Path("sweeps") / (re.sub(r"[^\w.]+", "-", spec.title).strip("-.") or "sweep")


def open_engine(
    limits: TaskLimits,
    tasks: int,
    *,
    engine: EngineName | None = None,
    address: str | None = None,
    jobs: int | None = None,
) -> Engine:
    """Returns the engine for that many tasks: Ray if it is installed, otherwise processes.

    jobs: greatest number of tasks at the same time

    Raises ConfigError if Ray is requested but not installed, the address does not answer, or an address is given
    for processes.
    """
    if address is not None and engine == "processes":
        raise ConfigError("--address is for Ray, and --engine processes is this machine alone; leave out one of them.")
    slots = max(1, min(slots_here(limits, jobs), tasks))
    if address is not None or engine == "ray" or (engine is None and registry.is_installed("ray")):
        return RayEngine(limits, slots, address)
    return LocalEngine(limits, slots)


def _spec_of(what: str | Path | SweepSpec | Mapping[str, Any]) -> SweepSpec:
    if isinstance(what, SweepSpec):
        return what
    return SweepSpec.of_files(dict(what), Path.cwd()) if isinstance(what, Mapping) else SweepSpec.from_toml(Path(what))


class _Driver:
    """Driver of a sweep: sends the remaining runs to an engine, and records the results."""

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
        """Runs that are not done."""
        return [run for run in self._runs if run.key not in self._records]

    def lead(self, engine: Engine) -> None:
        """Lets the engine do the remaining runs. Raises StorageError, WorkerUnfit."""
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
        """Returns the outcome."""
        vanished = self._hashes.vanished
        names = ", ".join(sorted(vanished))
        remarks = [f"{names} vanished; the copy in the sweep's folder is used."] if vanished else []
        return SweepOutcome(
            self._place.path, self._runs, self._records, self._failures, self._before,
            (*remarks, *self._table.remarks),
        )  # fmt: skip

    def _take(self, run: SweepRun, record: Record) -> None:
        # Current labels: the run may have been done for another sweep in this folder.
        self._records[run.key] = {**record, "labels": dict(run.labels)}
        self._tally.count_done(run, record)

    def _note_failure(self, run: SweepRun, error: Exception) -> None:
        if isinstance(error, WorkerUnfit):
            raise error
        if isinstance(error, StorageError):
            self._place.require_space()
        failure = {
            "key": run.key, "kind": run.kind, "labels": dict(run.labels), "error": str(error),
            "times": {"ended": datetime.now(UTC).isoformat(timespec="milliseconds")}, "host": platform.node(),
        }  # fmt: skip
        with suppress(StorageError):  # another file is in place of its folder; the other runs go on
            self._place.run(run.key).keep_failure(failure)
        self._failures[run.key] = failure
        self._tally.count_failed(run)

    def _copies(self, runs: Iterable[SweepRun]) -> dict[str, str]:
        """Returns copies of the pictures by their paths."""
        paths = dict.fromkeys(path for run in runs for path in run.pictures)
        return {
            path: str(self._place.copy_of(Path(path), self._hashes.by_path[str(Path(path).absolute())]))
            for path in paths
        }


# The best of several plans with different seeds: a small sweep before a painting.

_LAST_SEED = 2**31 - 1
_EXPECTED, _LOSS = "expected dB", "loss of the plan"


@dataclass(frozen=True)
class Candidate:
    """Best candidate: its spec, its plan, and a sentence that compares it."""

    spec: RunSpec
    plan: Plan
    comparison: str


def best_candidate(spec: RunSpec, count: int, folder: Path, *, jobs: int | None = None, notify: Notify) -> Candidate:
    """Plans with `count` successive seeds in several processes, and returns the best.

    folder: for the sweep

    The criterion is the expected similarity of the painting for a photograph, and the loss of the plan otherwise.
    Raises PlanError if no seed made a plan, and the errors of `sweep`.
    """
    settings = SweepRun.settings_of(spec)
    seeds = [seed for seed in range(spec.seed, spec.seed + count) if seed <= _LAST_SEED]
    asked = SweepSpec.of(title="candidates", kind="plan", settings=settings, grid={"seed": seeds})
    outcome = sweep(asked, folder, engine="processes", jobs=jobs, notify=notify)
    if not outcome.records:
        first = next(iter(outcome.failures.values()))
        raise PlanError(f"None of the {count} seeds made a plan: {first['error']}")
    figure, found = rank_plans(spec, list(outcome.records.values()))
    best, worst = found[0], found[-1]
    seed = best["labels"]["seed"]
    told = f"The best of {len(found)} seeds is {seed}: {figure} {best['figures'][figure]:.4g}"
    if len(found) > 1:
        told += f", the worst {worst['figures'][figure]:.4g}"
    plan = Plan.load(outcome.folder / "runs" / best["key"] / "plan.json")
    return Candidate(spec.with_values(seed=seed, ground=ground_of(plan)), plan, f"{told}.")


def rank_plans(spec: RunSpec, records: Sequence[Mapping[str, Any]]) -> tuple[str, list[Mapping[str, Any]]]:
    """Returns the figure by which the records of plans are compared, and the records, best first.

    The similarity to a picture counts only if all goals are pictures. Words have an initial picture too, but the
    loss tells if the plan shows the words.
    """
    pictures = all(item.kind == "image" for item in spec.goal)
    if pictures and all(_EXPECTED in record["figures"] for record in records):
        return _EXPECTED, sorted(records, key=lambda record: -record["figures"][_EXPECTED])
    return _LOSS, sorted(records, key=lambda record: record["figures"][_LOSS])
