"""The commands that print the paper's figures and tables: experiments NAME, experiments list."""

import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn

from frida_painter.cli.numbers import whole_number_within
from frida_painter.cli.progress import duration
from frida_painter.experiments import continuous_strokes, outcome
from frida_painter.experiments.outcome import Outcome
from frida_painter.session.opening import settle_threads

BrushName = Annotated[str, typer.Option(metavar="NAME", help="The brush: fine, medium or broad.")]
Seed = Annotated[
    int, typer.Option(parser=whole_number_within(0, 2**31 - 1), metavar="N", help="Of every random choice.")
]
Quick = Annotated[
    bool, typer.Option("--quick", help="Do only as much as shows that it runs; the figures mean nothing then.")
]
Out = Annotated[
    Path, typer.Option(metavar="FOLDER", help="Where FOLDER/NAME/table.json, table.md and the pictures go.")
]
HERE = Path("experiments")


def build() -> typer.Typer:
    """The group of commands."""
    app = typer.Typer(
        no_args_is_help=True, help="The paper's figures and tables, and ours, each one command that measures anew."
    )
    app.command("list")(list_all)
    app.command(continuous_strokes.NAME)(sweep)
    return app


def list_all(context: typer.Context) -> None:
    """Say which experiments there are."""
    assert context.parent is not None
    for name, command in context.parent.command.commands.items():  # type: ignore[attr-defined]
        if name != "list":
            print(f"{name:20} {command.get_short_help_str(100)}")


def sweep(brush: BrushName = "broad", seed: Seed = 0, quick: Quick = False, out: Out = HERE) -> None:
    """Thickness, length and bend from one extreme to the other, as modelled and as painted."""
    scale = continuous_strokes.QUICK if quick else continuous_strokes.FULL
    _conduct(out, lambda notify: continuous_strokes.run(brush=brush, seed=seed, scale=scale, notify=notify))


def _conduct(out: Path, experiment: Callable[[outcome.Notify], Outcome]) -> None:
    """Runs an experiment under a progress bar, writes what comes out, and says where it is."""
    settle_threads()
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

        found = experiment(hear)
        bar.update(task, description="done", completed=1.0, left="")
    folder = out / found.name
    found.save(folder)
    print("\n".join([found.title, *(f"  {note}" for note in found.notes)]))
    print(f"In {duration(time.monotonic() - started)}: {folder / 'table.md'}, table.json and", end=" ")
    print(f"{len(found.pictures)} picture{'s' if len(found.pictures) != 1 else ''}.")
