"""The trials of an experiment in several processes at once, by the engine that does sweeps."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from frida_painter.errors import TryFailed
from frida_painter.experiments.outcome import Notify, Outcome, Progress, silent
from frida_painter.experiments.trials import Experiment
from frida_painter.sweeps.engine import TaskLimits, slots_here
from frida_painter.sweeps.sweep import open_engine

MakeExperiment = Callable[[], Experiment[Any]]
"""Makes the experiment anew in every process: a function of a module, with its arguments bound by functools.partial."""
_LIMITS = TaskLimits(seconds=6 * 3600.0, threads=1, memory=1500, tries=2)


@dataclass(frozen=True)
class TrialShare:
    """Trials that one process measures, one after the other: their numbers, and the folder where finished ones wait."""

    make: MakeExperiment
    numbers: tuple[int, ...]
    keep: str


def measure_share(share: TrialShare) -> None:
    """Measures the trials of a share that were not measured yet."""
    experiment = share.make()
    for number in share.numbers:
        experiment.measured(experiment.trials[number], Path(share.keep), silent)


def run_in_processes(make: MakeExperiment, keep: Path, notify: Notify, jobs: int | None = None) -> Outcome:
    """Runs the experiment with as many trials at once as there are cores and memory for; with one, in this process.

    keep: the folder in which finished trials wait; jobs: not more at once than so many. Raises TryFailed where trials
    failed, once all others are measured.
    """
    experiment = make()
    shares = [TrialShare(make, numbers, str(keep)) for numbers in experiment.shares(keep)]
    if min(slots_here(_LIMITS, jobs), len(shares)) > 1:
        total, failures = len(experiment.trials), list[str]()
        left = sum(len(share.numbers) for share in shares)
        engine = open_engine(_LIMITS, len(shares), engine="processes", jobs=jobs)  # soon begun, and of this machine
        notify(Progress((total - left) / total, f"{engine.slots} at the same time"))
        for ended in engine.run(measure_share, shares):
            left -= len(ended.task.numbers)
            if ended.error is not None:
                failures.append(f"{experiment.trials[ended.task.numbers[0]].name}: {ended.error}")
            notify(Progress((total - left) / total, f"{total - left} of {total} trials, {engine.slots} at a time"))
        if failures:
            raise TryFailed(
                f"{len(failures)} parts of the experiment failed, the first is {failures[0]} Run the command again to "
                "try them once more; the others are kept."
            )
    return experiment.run(keep, notify)
