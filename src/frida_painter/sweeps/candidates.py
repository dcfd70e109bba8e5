"""The best of several plans that differ in their seeds: a small sweep before a painting."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from frida_painter.errors import PlanError
from frida_painter.plan import Plan
from frida_painter.runs.ground_choice import ground_of
from frida_painter.runs.spec import RunSpec
from frida_painter.sweeps.run import SweepRun
from frida_painter.sweeps.spec import SweepSpec
from frida_painter.sweeps.sweep import Notify, sweep

_LAST_SEED = 2**31 - 1
_EXPECTED, _LOSS = "expected dB", "loss of the plan"


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
    figure, found = ranked(spec, list(outcome.records.values()))
    best, worst = found[0], found[-1]
    seed = best["labels"]["seed"]
    told = f"The best of {len(found)} seeds is {seed}: {figure} {best['figures'][figure]:.4g}"
    if len(found) > 1:
        told += f", the worst {worst['figures'][figure]:.4g}"
    plan = Plan.load(outcome.folder / "runs" / best["key"] / "plan.json")
    return Candidate(spec.changed(seed=seed, ground=ground_of(plan)), plan, f"{told}.")


def ranked(spec: RunSpec, records: Sequence[Mapping[str, Any]]) -> tuple[str, list[Mapping[str, Any]]]:
    """The figure by which the records of plans are compared, and the records, best first.

    Only where pictures are all that is wanted does it matter how near to one a painting will be: words have one to
    begin with as well, and the loss says whether it shows them.
    """
    pictures = all(item.kind == "image" for item in spec.goal)
    if pictures and all(_EXPECTED in record["figures"] for record in records):
        return _EXPECTED, sorted(records, key=lambda record: -record["figures"][_EXPECTED])
    return _LOSS, sorted(records, key=lambda record: record["figures"][_LOSS])
