"""How the command line runs an experiment: a progress bar while it lasts, a folder with what came out."""

import math
import shutil
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn

from frida_painter.devices import prepare_process
from frida_painter.errors import TryFailed
from frida_painter.lab import base
from frida_painter.lab.base import Experiment, Notify, Outcome, silent
from frida_painter.lab.base import Progress as Progress_of_base
from frida_painter.lab.sweeps.engine import TaskLimits, slots_here
from frida_painter.lab.sweeps.runner import open_engine
from frida_painter.session.time_left import duration

UNFINISHED = "unfinished"
"""The folder, in that of an experiment, in which finished parts wait."""


def conduct(name: str, out: Path, experiment: Callable[[Path, Notify], Outcome]) -> None:
    """Runs an experiment under a progress bar, writes what comes out, and says where it is.

    experiment: is given a folder in which finished parts wait, which goes when all is done, and whom to tell.
    """
    folder = out / name
    unfinished = folder / UNFINISHED
    prepare_process()
    started = time.monotonic()
    console = Console(stderr=True, highlight=False)
    bar = Progress(
        TextColumn("{task.description}"), BarColumn(bar_width=36), TextColumn("{task.fields[left]}"), console=console
    )
    with bar:
        task = bar.add_task("getting ready", total=1.0, left="")

        def hear(progress: base.Progress) -> None:
            passed, share = time.monotonic() - started, progress.share
            left = passed * (1 - share) / share if share > 0 else math.inf
            words = f"{duration(left)} left" if math.isfinite(left) else ""
            bar.update(task, description=progress.doing, completed=share, left=words)

        found = experiment(unfinished, hear)
        bar.update(task, description="done", completed=1.0, left="")
    found.save(folder)
    shutil.rmtree(unfinished, ignore_errors=True)
    print("\n".join([found.title, *(f"  {note}" for note in found.notes)]))
    print(f"In {duration(time.monotonic() - started)}: {folder / 'table.md'}, table.json and", end=" ")
    print(f"{len(found.pictures)} picture{'s' if len(found.pictures) != 1 else ''}.")


# The trials of an experiment in several processes at once, by the engine that does sweeps.

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
        notify(Progress_of_base((total - left) / total, f"{engine.slots} at the same time"))
        for ended in engine.run(measure_share, shares):
            left -= len(ended.task.numbers)
            if ended.error is not None:
                failures.append(f"{experiment.trials[ended.task.numbers[0]].name}: {ended.error}")
            notify(
                Progress_of_base((total - left) / total, f"{total - left} of {total} trials, {engine.slots} at a time")
            )
        if failures:
            raise TryFailed(
                f"{len(failures)} parts of the experiment failed, the first is {failures[0]} Run the command again to "
                "try them once more; the others are kept."
            )
    return experiment.run(keep, notify)
