"""What commands of experiments are given alike: brush, seeds, pictures, library, folder, jobs; and how one is run."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from frida_painter.options import out_folder, whole_number_within

if TYPE_CHECKING:  # the command line lists the experiments without loading them
    from frida_painter.experiments.outcome import Notify, Outcome
    from frida_painter.experiments.parallel import MakeExperiment
    from frida_painter.experiments.targets import Target

_seed = whole_number_within(0, 2**31 - 1)


def seeds_of(text: str) -> tuple[int, ...]:
    """ "0,1,2" as numbers. Raises typer.BadParameter."""
    seeds = tuple(_seed(part) for part in text.split(","))
    if len(set(seeds)) < len(seeds):
        raise typer.BadParameter(f"{text[:40]!r} names a seed twice")
    return seeds


def _brush(name: str) -> str:
    """The name of a brush that has a stroke model, asked before any work begins. Raises WeightsError."""
    from frida_painter.brush.weights import load_stroke_model  # whoever asks for help waits for no network

    load_stroke_model(name)
    return name


BrushName = Annotated[str, typer.Option(parser=_brush, metavar="NAME", help="The brush: fine, medium or broad.")]
Seed = Annotated[int, typer.Option(parser=_seed, metavar="N", help="Random seed.")]
Seeds = Annotated[
    Any,
    typer.Option(parser=seeds_of, metavar="N,N,...", help="Random seeds. The experiment runs once with each."),
]
Photo = Annotated[
    Path | None, typer.Option("--target", metavar="PHOTO", help="The picture to paint. [dim]a cup of coffee[/]")
]
Photos = Annotated[
    list[Path] | None,
    typer.Option(
        "--target", metavar="PHOTO", help="A picture to paint. May be repeated. [dim]some of the project's[/]"
    ),
]
Styles = Annotated[
    list[Path] | None,
    typer.Option("--style", metavar="PICTURE", help="A style picture. May be repeated. [dim]two of the project's[/]"),
]
Style = Annotated[
    Path | None, typer.Option("--style", metavar="PICTURE", help="A style picture. [dim]one of the project's[/]")
]
Quick = Annotated[bool, typer.Option("--quick", help="Run a very small version as a test. Its figures mean nothing.")]
Out = Annotated[
    Path,
    typer.Option(
        parser=out_folder,
        metavar="FOLDER",
        help="The output folder. Writes table.json, table.md and pictures into FOLDER/NAME.",
    ),
]
Library = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="A stroke library (.npz). [dim]200 strokes, painted in the virtual studio[/]"),
]
Jobs = Annotated[
    int | None,
    typer.Option(
        parser=whole_number_within(1, 4096),
        metavar="N",
        help="Number of trials at the same time. [dim]as many as there are cores and memory for[/]",
    ),
]
HERE = Path("experiments")


def pictures_of(given: Sequence[Path] | None, shipped: Sequence[str]) -> "tuple[Target, ...]":
    """A person's own pictures, or some of the project's by their names."""
    from frida_painter.experiments import targets

    return targets.given(given) if given else targets.shipped(shipped)


def run_under_progress(name: str, out: Path, run: "Callable[[Path, Notify], Outcome]") -> None:
    """Runs the experiment of that name under a progress bar; what comes out goes into out/NAME."""
    from frida_painter.experiments.conduct import conduct

    conduct(name, out, run)


def run_trials(name: str, out: Path, make: "MakeExperiment", jobs: int | None) -> None:
    """Runs the trials of the experiment that `make` makes, in several processes at once, under a progress bar."""
    from frida_painter.experiments.parallel import run_in_processes

    run_under_progress(name, out, lambda keep, notify: run_in_processes(make, keep, notify, jobs))
