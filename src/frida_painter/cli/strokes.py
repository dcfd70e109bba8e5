"""The commands that teach the painter its brush: strokes paint, inspect, train."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from frida_painter.brush.kinds import brush_kind
from frida_painter.brush.learn import DEFAULT_MODEL, learn
from frida_painter.brush.library import StrokeLibrary
from frida_painter.brush.training import TrainingProgress
from frida_painter.cli.library import inspect, paint
from frida_painter.cli.numbers import whole_number_within
from frida_painter.errors import ConfigError
from frida_painter.session.opening import settle_threads

BrushName = Annotated[str, typer.Option(metavar="NAME", help="The brush: fine, medium or broad.")]
SeedOption = Annotated[
    int, typer.Option(parser=whole_number_within(0, 2**31 - 1), metavar="N", help="Of every random choice.")
]


def build() -> typer.Typer:
    """The group of commands."""
    app = typer.Typer(no_args_is_help=True, help="Teach the painter its brush from strokes that it has painted.")
    app.command("paint")(paint)
    app.command("inspect")(inspect)
    app.command("train")(train_model)
    return app


def train_model(
    library: Annotated[Path, typer.Argument(metavar="LIBRARY", help="A stroke library (.npz).")],
    brush: BrushName = "broad",
    seed: SeedOption = 0,
    out: Annotated[Path, typer.Option(metavar="FILE", help="The weights to write (.safetensors).")] = Path(
        "weights.safetensors"
    ),
) -> None:
    """Train the stroke model on a library: which mark a stroke of given thickness, length and bend leaves."""
    if out.suffix != ".safetensors":
        raise ConfigError(f"--out was given {str(out)!r}; weights end in .safetensors.")
    kind = brush_kind(brush)
    strokes = StrokeLibrary.load(library)
    settle_threads()  # as fast as several here, and the same weights whatever the number of cores
    with _bar() as bar:
        task = bar.add_task("training", total=None)

        def hear(progress: TrainingProgress) -> None:
            words = f"training, error {progress.validation_error:.4f}, best {progress.best_error:.4f}"
            bar.update(task, total=progress.epochs, completed=progress.epoch, description=words)

        learned = learn(DEFAULT_MODEL, strokes, kind, seed=seed, notify=hear)
    report = learned.report
    learned.model.save(out)
    print(
        f"Trained on {len(learned.library) - len(report.held_out)} strokes; on {len(report.held_out)} others the mean "
        f"error of the magnitude is {report.validation_error:.4f}: {out}"
    )


def _bar() -> Progress:
    console = Console(stderr=True, highlight=False)
    return Progress(
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(), console=console
    )
