"""strokes train: from photographs of strokes to a model of the brush."""

import csv
import io
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from frida_painter import registry, storage
from frida_painter.brush.limits import DEFAULT_MODEL, FIELD, MODELS, MOST_FOLDS, PARAM2STROKE
from frida_painter.errors import ConfigError
from frida_painter.options import ListingOption, out_file, whole_number_within

if TYPE_CHECKING:
    from frida_painter.brush.learn import Learned


def register(app: typer.Typer) -> None:
    """Adds the command."""
    app.command("train")(train)


def train(
    library: Annotated[Path, typer.Argument(metavar="LIBRARY", help="A stroke library (.npz).")],
    brush: Annotated[
        str | None,
        ListingOption(
            "--brush",
            metavar="NAME",
            groups=(registry.STROKE_MODELS,),
            says="The brush that painted the library. Without it, the limits come from the library. Available:",
            show_default=False,
        ),
    ] = None,
    model: Annotated[
        str,
        typer.Option(
            metavar="NAME", help=f"{FIELD}: needs few strokes; {PARAM2STROKE}: the network of the FRIDA paper."
        ),
    ] = DEFAULT_MODEL,
    folds: Annotated[
        int,
        typer.Option(
            parser=whole_number_within(0, MOST_FOLDS),
            metavar="K",
            help="Cross-validation: train K times before, each time with another part held out. 0 for none.",
        ),
    ] = 0,
    seed: Annotated[int, typer.Option(parser=whole_number_within(0, 2**31 - 1), metavar="N", help="Random seed.")] = 0,
    out: Annotated[
        Path, typer.Option(parser=out_file, metavar="FILE", help="The weights to write (.safetensors).")
    ] = Path("weights.safetensors"),
) -> None:
    """Train a stroke model on a library. It predicts a stroke's mark from its thickness, length and bend.

    A fifth of the strokes is held out for validation. The learning curve (.csv) and a page with
    pictures (.html) are written beside the weights.
    """
    from frida_painter.brush.kinds import brush_kind
    from frida_painter.brush.learn import learn
    from frida_painter.brush.library import StrokeLibrary
    from frida_painter.brush.measure import cross_validate
    from frida_painter.brush.training import TrainingProgress
    from frida_painter.report.training_page import training_page
    from frida_painter.session.opening import prepare_process

    if out.suffix != ".safetensors" or out.is_dir():
        raise ConfigError(f"--out was given {str(out)!r}; weights go into a file that ends in .safetensors.")
    if model not in MODELS:
        raise ConfigError(f"--model was given {model!r}; models are {' and '.join(MODELS)}.")
    if folds == 1:
        raise ConfigError("--folds was given 1; a library is parted into at least 2 folds, or 0 for none.")
    kind = brush_kind(brush) if brush is not None else None
    strokes = StrokeLibrary.load(library)
    prepare_process()  # as fast as several here, and the same weights whatever the number of cores
    # Whether the weights can be written is known before minutes are spent on them.
    with storage.replacing(out) as unfinished, _bar() as bar:
        if folds:
            task = bar.add_task("cross-validation", total=folds)

            def follow(fold: int, progress: TrainingProgress) -> None:
                bar.update(task, completed=fold + progress.epoch / progress.epochs)

            errors = cross_validate(model, strokes, kind, folds=folds, seed=seed, notify=follow)
            bar.remove_task(task)
            print(
                f"Cross-validation in {folds} folds: mean error {errors.mean():.4f}, spread {errors.std(ddof=1):.4f} "
                f"({', '.join(f'{error:.4f}' for error in errors)})."
            )
        task = bar.add_task("training", total=None)

        def hear(progress: TrainingProgress) -> None:
            words = f"training, error {progress.validation_error:.4f}, best {progress.best_error:.4f}"
            bar.update(task, total=progress.epochs, completed=progress.epoch, description=words)

        learned = learn(model, strokes, kind, seed=seed, notify=hear)
        learned.model.save(unfinished)
    storage.write_text(out.with_suffix(".csv"), _curve(learned))
    page = out.with_suffix(".html")
    storage.write_text(page, training_page(learned, model, library.name, dirty=len(strokes) - len(learned.library)))
    _conclude(learned, len(strokes), out, page)


def _conclude(learned: "Learned", count: int, out: Path, page: Path) -> None:
    report, clean = learned.report, len(learned.library)
    dirty = f" ({count - clean} dirty ones were left out)" if count > clean else ""
    print(
        f"Trained on {clean - len(report.held_out)} strokes{dirty}; on {len(report.held_out)} others the mean "
        f"error of the magnitude is {report.validation_error:.4f}: {out}\nPictures: {page}"
    )


def _curve(learned: "Learned") -> str:
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(("epoch", "training_error", "validation_error"))
    rows.writerows((step.epoch, step.training_error, step.validation_error) for step in learned.report.curve)
    return text.getvalue()


def _bar() -> Progress:
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        console=Console(stderr=True, highlight=False),
        transient=True,
    )
