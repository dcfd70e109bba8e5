"""Runs a sweep from its description to its folder. Finished runs are not repeated, and a failure stops no other run."""

import math
import platform
import re
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any

from frida_painter.errors import ConfigError, PlanError, WorkerUnfit
from frida_painter.report.story import compare
from frida_painter.runs.painting_folder import content_hash
from frida_painter.runs.run import PaintingRun
from frida_painter.runs.settle import ground_of
from frida_painter.runs.spec import RunSpec
from frida_painter.strokes.plan import Plan
from frida_painter.system import images, storage
from frida_painter.system.provenance import describe_here, identify
from frida_painter_lab.engine import Share, TaskLimits, slots_here
from frida_painter_lab.experiment import Notify, do_shares, find_runs, silent
from frida_painter_lab.measures import mse
from frida_painter_lab.runs import RunFolder
from frida_painter_lab.sweeps.report import SweepState, fold, keep_table
from frida_painter_lab.sweeps.sweep_spec import FileHashes, SweepFolder, SweepRun, SweepSpec, expand_runs

# A run in a process of an engine: plans, paints or evaluates it, and writes the results to its folder.


def reopen(keep: str, keys: Sequence[str]) -> Share:
    """Returns runs of the sweep in a folder, for another process than that which asks."""
    return Share(find_runs(_read_runs(keep), keys), keep)


@cache
def _read_runs(keep: str) -> tuple[SweepRun, ...]:
    spec, known, _, program = SweepFolder(Path(keep)).read_request()
    return expand_runs(spec, FileHashes(known), program)


def perform(share: Share) -> dict[str, Any]:
    """Does a run, and returns its record, which is also in its folder. A run that is already done is only read.

    A lock on the folder keeps a process that a dead driver left behind from doing the same run.
    Raises WorkerUnfit if the program has changed since the sweep began, ConfigError if a file of the run has,
    StorageError if nothing can be written, and the errors of the run.
    """
    (run,) = share.runs
    assert isinstance(run, SweepRun)
    made_with = describe_here()
    if (here := identify(made_with)) != run.program:
        raise WorkerUnfit(f"This is {here}, and the sweep was begun with {run.program}; run it again with one of them.")
    for name, before in run.files.items():
        if content_hash(Path(name)) != before:
            raise ConfigError(f"{name} has changed since the sweep began; run the sweep again.")
    folder = RunFolder(Path(share.keep), run.key)
    with folder.lock():
        known = folder.record()
        if known is not None:
            return known
        started, cpu = time.perf_counter(), time.process_time()
        made = None if run.plan is None else Plan.load(run.plan)
        with PaintingRun(run.spec if made is None else fix_to_plan(run.spec, made)) as opened:
            figures = _figures(run.kind, opened, made, folder)
        record = {
            "key": run.key,
            "kind": run.kind,
            "labels": dict(run.labels),
            "settings": {**opened.spec.record(), "goal": [list(fact) for fact in opened.spec.goal_facts]},
            "figures": {name: value for name, value in figures.items() if math.isfinite(value)},
            "times": {
                "cpu_seconds": time.process_time() - cpu,
                "wall_seconds": time.perf_counter() - started,
                "ended": datetime.now(UTC).isoformat(timespec="milliseconds"),
            },
            "versions": made_with,
            "host": platform.node(),
        }
        folder.keep(record)
        return record


def fix_to_plan(spec: RunSpec, plan: Plan) -> RunSpec:
    """Returns the spec of a painting that paints the plan without changes, on its own canvas."""
    wells = max(end - first for first, end in (layer.paints for layer in plan.layers))
    brushes = ",".join(layer.brush for layer in plan.layers) if len(plan.brushes) > 1 else plan.brushes[0]
    return spec.with_values(
        strokes=len(plan), layers=None, colors=wells, brushes=brushes, ground=ground_of(plan), canvas=plan.canvas,
        fit="crop", replans=0,
    )  # fmt: skip


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
    forecast = opened.forecast(plan)
    if forecast is not None:
        figures["expected dB"] = forecast.expected
    if target is not None:
        figures["plan dB"] = compare("plan", picture, target, *picture.shape[1:]).psnr
    if kind != "plan":
        painting = opened.simulate(plan)
        images.save(painting.photograph, folder.path / "painting.png")
        seen = images.fit(painting.photograph, *picture.shape[1:])
        figures["strokes painted"] = painting.painted
        figures["robot seconds"] = painting.robot_seconds
        figures["sim2real error"] = mse(seen, picture)
        if target is not None:
            figures["painting dB"] = compare("painting", painting.photograph, target, *picture.shape[1:]).psnr
    return figures


MANY = 10_000
"""Number of runs above which a person is asked first."""


def sweep(
    what: str | Path | SweepSpec | Mapping[str, Any],
    folder: str | Path | None = None,
    *,
    jobs: int | None = None,
    notify: Notify = silent,
    most: int | None = MANY,
) -> SweepState:
    """Does all runs of a sweep that are not done yet, and returns the outcome of all.

    what: TOML file, or the same as a mapping, such as {"kind": "plan", "grid": {"image": ["a.jpg"], "seed": [0,
        1]}}
    folder: of the sweep, by default one below "sweeps"; the same one again continues the sweep
    jobs: number of runs at the same time; by default as many as cores and memory allow
    notify: hears the progress
    most: greatest number of runs; None for any

    Raises ConfigError for an invalid sweep, SweepBusy if another process works on the folder, StorageError if the
    disk is full, WorkerUnfit if processes cannot work.

        >>> import frida_painter as fp
        >>> wanted = {"settings": {"image": "photo.jpg", "strokes": 5, "render_height": 64}, "grid": {"seed": [0, 1]}}
        >>> outcome = fp.sweep(wanted, "seeds", jobs=1)
        >>> len(outcome.records), len(outcome.failures)
        (2, 0)
    """
    if isinstance(what, SweepSpec):
        spec = what
    else:
        spec = (
            SweepSpec.of_files(dict(what), Path.cwd()) if isinstance(what, Mapping) else SweepSpec.from_toml(Path(what))
        )
    if most is not None and spec.count > most:
        raise ConfigError(f"The sweep has {spec.count:,} runs, and {most:,} are the most without --yes (most=None).")
    place = SweepFolder(Path(folder) if folder is not None else default_folder(spec))
    limits = TaskLimits(spec.time_limit, spec.threads, spec.memory, spec.tries)
    hashes = FileHashes()
    runs = expand_runs(spec, hashes)  # a wrong sweep is refused before its folder is made
    with place.lock():
        left = [run for run in runs if RunFolder(place.path, run.key).record() is None]
        slots = max(1, min(slots_here(limits, jobs), len(left)))
        place.keep(spec, hashes.by_path, slots)
        failures, remarks = dict[str, Mapping[str, Any]](), tuple[str, ...]()
        try:
            if left:
                shares = [Share((run,), str(place.path)) for run in left]
                failures |= do_shares(perform, shares, place.path, limits, slots, len(runs), notify)
        finally:
            found = replace(fold(place, spec, runs, slots), failures=failures, working=False)
            remarks = keep_table(found)
        return replace(found, done_before=len(runs) - len(left), remarks=remarks)


def default_folder(spec: SweepSpec) -> Path:
    """Returns the default folder of a sweep."""
    return Path("sweeps") / storage.file_name(re.sub(r"[^\w.]+", "-", spec.title).strip("-.") or "sweep")


# The best of several plans with different seeds: a small sweep before a painting.

_LAST_SEED = 2**31 - 1
_EXPECTED, _LOSS = "expected dB", "loss of the plan"


def best_candidate(spec: RunSpec, count: int, folder: Path, notify: Notify) -> tuple[RunSpec, Plan, str]:
    """Plans with `count` successive seeds in several processes.

    Returns the spec with the best seed, its plan, and a sentence that compares it.

    folder: for the sweep

    The criterion is the expected similarity of the painting for a photograph, and the loss of the plan otherwise.
    Raises PlanError if no seed made a plan, and the errors of `sweep`.
    """
    settings = {name: value for name, value in spec.record().items() if name in spec.model_fields_set}
    settings |= {part: [item.model_dump() for item in getattr(spec, part)] for part in ("goal", "initial")}
    seeds = [seed for seed in range(spec.seed, spec.seed + count) if seed <= _LAST_SEED]
    outcome = sweep(SweepSpec.of(title="candidates", settings=settings, grid={"seed": seeds}), folder, notify=notify)
    if not outcome.records:
        first = next(iter(outcome.failures.values()))
        raise PlanError(f"None of the {count} seeds made a plan: {first['error']}")
    figure, found = rank_plans(spec, list(outcome.records.values()))
    best, worst = found[0], found[-1]
    seed = best["labels"]["seed"]
    told = f"The best of {len(found)} seeds is {seed}: {figure} {best['figures'][figure]:.4g}"
    if len(found) > 1:
        told += f", the worst {worst['figures'][figure]:.4g}"
    plan = Plan.load(RunFolder(outcome.folder, best["key"]).path / "plan.json")
    return spec.with_values(seed=seed, ground=ground_of(plan)), plan, f"{told}."


def rank_plans(spec: RunSpec, records: Sequence[Mapping[str, Any]]) -> tuple[str, list[Mapping[str, Any]]]:
    """Returns the figure by which the records of plans are compared, and the records, best first.

    The similarity to a picture counts only if all goals are pictures. Words have an initial picture too, but the
    loss tells if the plan shows the words.
    """
    pictures = all(item.kind == "image" for item in spec.goal)
    if pictures and all(_EXPECTED in record["figures"] for record in records):
        return _EXPECTED, sorted(records, key=lambda record: -record["figures"][_EXPECTED])
    return _LOSS, sorted(records, key=lambda record: record["figures"][_LOSS])
