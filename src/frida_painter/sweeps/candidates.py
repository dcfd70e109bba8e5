"""The best of several plans that differ in their seeds: a small sweep before a painting."""

from dataclasses import dataclass
from pathlib import Path

from frida_painter.errors import PlanError
from frida_painter.plan import Plan
from frida_painter.runs.spec import RunSpec
from frida_painter.sweeps.run import SweepRun
from frida_painter.sweeps.spec import SweepSpec
from frida_painter.sweeps.sweep import Notify, sweep

_LAST_SEED = 2**31 - 1
_BETTER = {"expected dB": 1.0, "loss of the plan": -1.0}
"""Figures by which candidates are compared, the first that they have, and whether more (1) or less (-1) is better."""


@dataclass(frozen=True)
class Candidate:
    """The best candidate: its description, its plan, and how it compares, in one sentence."""

    spec: RunSpec
    plan: Plan
    comparison: str


def best_candidate(spec: RunSpec, count: int, folder: Path, *, jobs: int | None = None, notify: Notify) -> Candidate:
    """Plans with `count` seeds from the description's own on, in several processes, and chooses.

    By what is expected of the painting of a photograph, otherwise by the loss of the plan. folder: for the sweep.
    Raises PlanError where no seed made a plan, and what `sweep` raises.
    """
    settings = SweepRun.settings_of(spec)
    seeds = [seed for seed in range(spec.seed, spec.seed + count) if seed <= _LAST_SEED]
    asked = SweepSpec.of(title="candidates", kind="plan", settings=settings, grid={"seed": seeds})
    outcome = sweep(asked, folder, engine="processes", jobs=jobs, notify=notify)
    if not outcome.records:
        first = next(iter(outcome.failures.values()))
        raise PlanError(f"None of the {count} seeds made a plan: {first['error']}")
    found = list(outcome.records.values())
    figure = next(name for name in _BETTER if all(name in record["figures"] for record in found))
    found.sort(key=lambda record: -_BETTER[figure] * record["figures"][figure])
    best, worst = found[0], found[-1]
    seed = best["labels"]["seed"]
    told = f"The best of {len(found)} seeds is {seed}: {figure} {best['figures'][figure]:.4g}"
    if len(found) > 1:
        told += f", the worst {worst['figures'][figure]:.4g}"
    plan = Plan.load(outcome.folder / "runs" / best["key"] / "plan.json")
    return Candidate(spec.changed(seed=seed), plan, f"{told}.")
