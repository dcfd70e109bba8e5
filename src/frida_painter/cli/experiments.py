"""The commands that print the paper's figures and tables: experiments NAME, experiments list."""

import math
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn

from frida_painter.cli.numbers import whole_number_within
from frida_painter.cli.progress import duration
from frida_painter.experiments import continuous_strokes, outcome, replanning, sim2real, targets
from frida_painter.experiments.outcome import Outcome
from frida_painter.session.opening import settle_threads

BrushName = Annotated[str, typer.Option(metavar="NAME", help="The brush: fine, medium or broad.")]
Seed = Annotated[
    int, typer.Option(parser=whole_number_within(0, 2**31 - 1), metavar="N", help="Of every random choice.")
]
Seeds = Annotated[
    str, typer.Option(metavar="N,N,...", help="Everything is done once with each of these seeds.", show_default=True)
]
Targets = Annotated[
    list[Path] | None,
    typer.Option(
        "--target", metavar="PHOTO", help="A picture to paint; may be given again. [dim]five of the project's[/]"
    ),
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
    app.command(sim2real.NAME)(gap)
    app.command(replanning.NAME)(looking)
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


def gap(
    brush: BrushName = "broad", seeds: Seeds = "0,1,2", target: Targets = None, quick: Quick = False, out: Out = HERE
) -> None:
    """How far paintings are from their simulation: our planner, and two in the manner of earlier work."""
    scale = sim2real.QUICK if quick else sim2real.FULL
    pictures = targets.given(target) if target else targets.shipped()
    chosen, keep = seeds_of(seeds), out / sim2real.NAME / "unfinished"
    _conduct(
        out,
        lambda notify: sim2real.run(pictures, brush=brush, seeds=chosen, scale=scale, keep=keep, notify=notify),
        unfinished=keep,
    )


def looking(
    brush: BrushName = "broad",
    seeds: Seeds = "0,1,2",
    target: Annotated[
        Path | None, typer.Option(metavar="PHOTO", help="The picture to paint. [dim]a cup of coffee[/]")
    ] = None,
    quick: Quick = False,
    out: Out = HERE,
) -> None:
    """With and without looking: how far a painting strays from its first plan and from its target."""
    scale = replanning.QUICK if quick else replanning.FULL
    (picture,) = targets.given([target]) if target else targets.shipped(["coffee"])
    chosen = seeds_of(seeds)
    _conduct(out, lambda notify: replanning.run(picture, brush=brush, seeds=chosen, scale=scale, notify=notify))


def seeds_of(text: str) -> tuple[int, ...]:
    """ "0,1,2" as numbers. Raises typer.BadParameter."""
    read = whole_number_within(0, 2**31 - 1)
    seeds = tuple(read(part) for part in text.split(","))
    if len(set(seeds)) < len(seeds):
        raise typer.BadParameter(f"{text[:40]!r} names a seed twice")
    return seeds


def _conduct(out: Path, experiment: Callable[[outcome.Notify], Outcome], *, unfinished: Path | None = None) -> None:
    """Runs an experiment under a progress bar, writes what comes out, and says where it is.

    unfinished: a folder that is no longer needed when the experiment is done.
    """
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
    if unfinished is not None:
        shutil.rmtree(unfinished, ignore_errors=True)
    print("\n".join([found.title, *(f"  {note}" for note in found.notes)]))
    print(f"In {duration(time.monotonic() - started)}: {folder / 'table.md'}, table.json and", end=" ")
    print(f"{len(found.pictures)} picture{'s' if len(found.pictures) != 1 else ''}.")
