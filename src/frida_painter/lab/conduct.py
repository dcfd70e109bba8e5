"""Running an experiment from the command line: a progress bar, and a folder with the outcome."""

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
from frida_painter.lab import trials
from frida_painter.lab.sweeps.engine import TaskLimits, slots_here
from frida_painter.lab.sweeps.runner import open_engine
from frida_painter.lab.trials import Experiment, Notify, Outcome, silent
from frida_painter.lab.trials import Progress as Progress_of_base
from frida_painter.session.time_left import duration, remaining_seconds
from frida_painter.storage import PART

UNFINISHED = f"{PART}unfinished"
"""Name of the folder for finished parts, inside the experiment's folder."""


def conduct(name: str, out: Path, experiment: Callable[[Path, Notify], Outcome]) -> None:
    """Runs an experiment under a progress bar, writes its outcome, and prints where it is.

    experiment: gets a folder for finished parts, which is deleted at the end, and a listener for its progress

    Raises the errors of `experiment`, and StorageError.
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

        def hear(progress: trials.Progress) -> None:
            left = remaining_seconds(time.monotonic() - started, progress.share)
            words = f"{duration(left)} left" if math.isfinite(left) else ""
            bar.update(task, description=progress.doing, completed=progress.share, left=words)

        found = experiment(unfinished, hear)
        bar.update(task, description="done", completed=1.0, left="")
    found.save(folder)
    shutil.rmtree(unfinished, ignore_errors=True)
    print("\n".join([found.title, *(f"  {note}" for note in found.notes)]))
    print(f"In {duration(time.monotonic() - started)}: {folder / 'table.md'}, table.json and", end=" ")
    print(f"{len(found.pictures)} picture{'s' if len(found.pictures) != 1 else ''}.")


# The trials of an experiment in several processes at once, with the engine of sweeps.

MakeExperiment = Callable[[], Experiment[Any]]
"""Makes the experiment in every process: a function of a module, with arguments bound by functools.partial."""
_LIMITS = TaskLimits(seconds=6 * 3600.0, threads=1, memory=1500, tries=2)


@dataclass(frozen=True)
class TrialShare:
    """Share of an experiment: trials that one process measures, one after another.

    make: makes the experiment
    numbers: of the trials
    keep: folder of finished trials
    """

    make: MakeExperiment
    numbers: tuple[int, ...]
    keep: str


def measure_share(share: TrialShare) -> None:
    """Measures those trials of a share that are not measured yet."""
    experiment = share.make()
    for number in share.numbers:
        experiment.measure_or_load(experiment.trials[number], Path(share.keep), silent)


def run_in_processes(make: MakeExperiment, keep: Path, notify: Notify, jobs: int | None = None) -> Outcome:
    """Runs the experiment with as many trials at once as cores and memory allow; with one, in this process.

    keep: folder of finished trials
    jobs: greatest number of trials at once; None for no limit

    Raises TryFailed if trials failed, after all others are measured.
    """
    experiment = make()
    shares = [TrialShare(make, numbers, str(keep)) for numbers in experiment.shares(keep)]
    if min(slots_here(_LIMITS, jobs), len(shares)) > 1:
        total, failures = len(experiment.trials), list[str]()
        left = sum(len(share.numbers) for share in shares)
        engine = open_engine(_LIMITS, len(shares), engine="processes", jobs=jobs)  # starts fast
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
