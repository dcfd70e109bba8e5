"""What a process of an engine does with a run: plans, paints or evaluates it, and writes what came out to its folder.

It is loaded before the first run, so that no run waits for PyTorch.
"""

import math
import platform
import time
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from frida_painter import images
from frida_painter.errors import WorkerUnfit
from frida_painter.plan import Plan
from frida_painter.runs.ground_choice import ground_of
from frida_painter.runs.run import PaintingRun
from frida_painter.runs.spec import RunSpec
from frida_painter.sweeps.folder import RunFolder
from frida_painter.sweeps.run import SweepRun

LIBRARIES = ("frida-painter", "torch", "numpy")


@dataclass(frozen=True)
class Assignment:
    """A run, and the folder of its sweep, which every machine that works on it has to see under this path."""

    run: SweepRun
    sweep: str


def perform(assignment: Assignment) -> dict[str, Any]:
    """Does a run, and returns its record, which is also in its folder; one that was done already is only read.

    A lock on the folder sees to it that a process which a dead driver left behind does not do the same run. Raises
    WorkerUnfit where this machine has another version of the program or does not see the folder, StorageError where
    nothing can be written, and whatever keeps the run from being done.
    """
    run, sweep = assignment.run, Path(assignment.sweep)
    here = version("frida-painter")
    if here != run.program:
        raise WorkerUnfit(
            f"{platform.node()} has frida-painter {here}, and the sweep was begun with {run.program}; install one "
            "version everywhere."
        )
    if not sweep.is_dir():
        raise WorkerUnfit(
            f"{platform.node()} does not see {sweep}; put the sweep into a folder that all machines share (--out)."
        )
    folder = RunFolder(sweep, run.key)
    with folder.held():
        known = folder.record()
        if known is not None:
            return known
        started, cpu = time.perf_counter(), time.process_time()
        made = None if run.plan is None else Plan.load(run.plan)
        with PaintingRun(run.spec if made is None else _of_plan(run.spec, made)) as opened:
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
            "versions": {name: version(name) for name in LIBRARIES} | {"python": platform.python_version()},
            "host": platform.node(),
        }
        folder.keep(record)
        return record


def _of_plan(spec: RunSpec, plan: Plan) -> RunSpec:
    """The description of a painting of a plan as it is, on its own canvas."""
    wells = max(end - first for first, end in (layer.paints for layer in plan.layers))
    brushes = ",".join(layer.brush for layer in plan.layers) if len(plan.brushes) > 1 else plan.brushes[0]
    return spec.changed(
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
    """Does the work, keeps plan and pictures, and returns what is measured of them. made: the plan to evaluate."""
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
    """Peak signal to noise of a picture [3, H, W] to a target of any size, in dB."""
    with torch.no_grad():
        error = (picture - images.fit(target, *picture.shape[1:])).square().mean()
    return float(-10 * error.clamp(min=1e-12).log10())
