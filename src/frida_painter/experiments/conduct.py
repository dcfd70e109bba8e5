"""How the command line runs an experiment: a progress bar while it lasts, a folder with what came out."""

import math
import shutil
import time
from collections.abc import Callable
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn

from frida_painter.experiments import outcome
from frida_painter.experiments.outcome import Notify, Outcome
from frida_painter.session.forecast import duration
from frida_painter.session.opening import prepare_process

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

        def hear(progress: outcome.Progress) -> None:
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
