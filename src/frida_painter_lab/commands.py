"""The commands for the experiments of the paper: experiments NAME, experiments list."""

import math
import shutil
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from frida_painter.runs.options import out_folder, taking, whole_number_option, whole_number_within
from frida_painter.system.storage import PART, count_of

if TYPE_CHECKING:
    from frida_painter_lab.experiment import Experiment, Notify, Outcome, Progress
    from frida_painter_lab.targets import Target

UNFINISHED = f"{PART}unfinished"
"""Name of the folder for finished runs, inside the experiment's folder, until all are done."""
_PREPARING = 0.2  # share of the time for what all runs share, such as a stroke library
_seed = whole_number_within(0, 2**31 - 1)


def seeds_of(text: str) -> tuple[int, ...]:
    """Parses "0,1,2" to numbers. Raises typer.BadParameter."""
    seeds = tuple(_seed(part) for part in text.split(","))
    if len(set(seeds)) < len(seeds):
        raise typer.BadParameter(f"{text[:40]!r} names a seed twice")
    return seeds


def _brush(name: str) -> str:
    """Returns the name of a brush after a check for its stroke model. Raises WeightsError."""
    from frida_painter.brush.weights import load_stroke_model  # imported late: help loads no networks

    load_stroke_model(name)
    return name


Library = Annotated[Path | None, taking("FILE", "A stroke library (.npz). [dim]the brush in the virtual studio[/]")]
Brush = Annotated[str, taking("NAME", "The brush: fine, medium or broad.", parser=_brush)]
Seeds = Annotated[Any, taking("N,N,...", "Random seeds. The experiment runs once with each.", parser=seeds_of)]
Photo = Annotated[Path | None, taking("PHOTO", "The picture to paint. [dim]a cup of coffee[/]", "--target")]
Photos = Annotated[
    list[Path] | None,
    taking("PHOTO", "A picture to paint. May be repeated. [dim]some of the project's[/]", "--target"),
]
Strokes = Annotated[int | None, whole_number_option(13, 1000, "Number of strokes. [dim]120[/]")]
Quick = Annotated[bool, typer.Option("--quick", help="Run a very small version as a test. Its figures mean nothing.")]
Jobs = Annotated[
    int | None,
    whole_number_option(1, 4096, "Number of runs at the same time. [dim]as many as there are cores and memory for[/]"),
]
Out = Annotated[
    Path,
    taking(
        "FOLDER", "The output folder. Writes table.json, table.md and pictures into FOLDER/NAME.", parser=out_folder
    ),
]
_OUT = Path("experiments")


def compare_stroke_models(
    library: Library = None, brush: Brush = "broad", seeds: Seeds = "0,1,2,3,4", quick: Quick = False,
    jobs: Jobs = None, out: Out = _OUT,
) -> None:  # fmt: skip
    """Measure the error on held-out strokes against the number of training strokes, and compare all stroke models."""
    from frida_painter_lab.stroke_models import StrokesNeeded

    _conduct(StrokesNeeded(library=library, brush=brush, seeds=seeds, quick=quick), out, jobs)


def sim2real(
    brush: Brush = "broad", seeds: Seeds = "0,1,2", photos: Photos = None, strokes: Strokes = None,
    quick: Quick = False, jobs: Jobs = None, out: Out = _OUT,
) -> None:  # fmt: skip
    """Measure the sim2real gap of paintings for our planner and two planners like earlier work."""
    from frida_painter_lab.simulation_gap import Sim2Real
    from frida_painter_lab.targets import SHIPPED

    asked = Sim2Real(brush=brush, seeds=seeds, photos=_targets(photos, SHIPPED), strokes=strokes, quick=quick)
    _conduct(asked, out, jobs)


def replanning(
    brush: Brush = "broad", seeds: Seeds = "0,1,2", photo: Photo = None, quick: Quick = False, jobs: Jobs = None,
    out: Out = _OUT,
) -> None:  # fmt: skip
    """Compare paintings with and without replanning: the distance to the first plan and to the target."""
    from frida_painter_lab.simulation_gap import Replanning

    photos = _targets([photo] if photo else None, ["coffee"])
    _conduct(Replanning(brush=brush, seeds=seeds, photos=photos, quick=quick), out, jobs)


def semantic(
    brush: Brush = "broad", seeds: Seeds = "0,1", photos: Photos = None, quick: Quick = False, jobs: Jobs = None,
    out: Out = _OUT,
) -> None:  # fmt: skip
    """Compare painting by content with painting by pixels, scored by a network that no optimiser uses."""
    from frida_painter_lab.goals import SemanticExperiment
    from frida_painter_lab.targets import PHOTOGRAPHS

    asked = SemanticExperiment(brush=brush, seeds=seeds, photos=_targets(photos, PHOTOGRAPHS), quick=quick)
    _conduct(asked, out, jobs)


EXPERIMENTS: Mapping[str, Callable[..., None]] = {
    "strokes-needed": compare_stroke_models, "sim2real": sim2real, "replanning": replanning, "semantic": semantic,
}  # fmt: skip


def register(app: typer.Typer) -> None:
    """Adds the group of commands."""
    group = typer.Typer(
        no_args_is_help=True,
        help="Run the experiments of the paper and more. Each command measures anew and writes tables and pictures.",
    )
    group.command("list")(list_all)
    for name, command in EXPERIMENTS.items():
        group.command(name)(command)
    app.add_typer(group, name="experiments")


def list_all() -> None:
    """List the experiments."""
    for name, command in EXPERIMENTS.items():
        print(f"{name:20} {command.__doc__}")


def _targets(own: "Sequence[Path] | None", shipped: Sequence[str]) -> "tuple[Target, ...]":
    from frida_painter_lab.targets import load_shipped_targets, load_targets

    return load_targets(own) if own else load_shipped_targets(shipped)


def _conduct(experiment: "Experiment", out: Path, jobs: int | None) -> None:
    conduct(experiment, out / experiment.NAME, jobs)


def conduct(experiment: "Experiment", folder: Path, jobs: int | None = None, *, stays: bool = False) -> "Outcome":
    """Runs an experiment under a progress bar, writes its outcome, and prints where it is.

    folder: takes the outcome, and meanwhile the finished runs
    jobs: greatest number of runs at the same time
    stays: True if the finished runs stay, so that more of them can be done later

    Raises the errors of the experiment, and StorageError.
    """
    from frida_painter.session.time_left import duration
    from frida_painter.system.devices import prepare_process
    from frida_painter_lab.experiment import within

    prepare_process()
    started, keep = time.monotonic(), folder if stays else folder / UNFINISHED
    with show_progress() as hear:
        ready = experiment.prepare(within(hear, 0.0, _PREPARING))
        first = _PREPARING if ready is not experiment else 0.0
        found = ready.run_in_processes(keep, within(hear, first, 1.0), jobs)
    found.save(folder)
    if not stays:
        shutil.rmtree(keep, ignore_errors=True)
    print("\n".join([found.title, *(f"  {note}" for note in found.notes)]))
    print(f"In {duration(time.monotonic() - started)}: {folder / 'table.md'}, table.json and", end=" ")
    print(f"{count_of(len(found.pictures), 'picture')}.")
    return found


@contextmanager
def show_progress() -> "Iterator[Notify]":
    """Shows a bar on the terminal within a `with` block, and yields what hears the progress."""
    from rich.console import Console

    from frida_painter.session.time_left import remaining_seconds
    from frida_painter_cli.terminal import Line

    bar, started, done_before = Line(Console(stderr=True, highlight=False)), time.monotonic(), math.inf

    def hear(progress: "Progress") -> None:
        nonlocal done_before
        done_before = min(done_before, progress.share)
        share = (progress.share - done_before) / max(1 - done_before, 1e-9)
        left = remaining_seconds(time.monotonic() - started, share)
        bar.update(bar.task, description=progress.doing, completed=progress.share, left=left)

    with bar:
        yield hear
