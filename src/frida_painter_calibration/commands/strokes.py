"""Commands for stroke libraries and stroke models: strokes paint, inspect, train, evaluate."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from frida_painter import registry
from frida_painter.brush import (
    DEFAULT_MODEL,
    FIELD,
    MAX_BETWEEN_REFILLS,
    MAX_STROKES,
    MODELS,
    PARAM2STROKE,
)
from frida_painter.errors import ConfigError
from frida_painter.runs.options import out_file, taking, whole_number_option
from frida_painter.system import storage
from frida_painter_calibration.options import BrushOption, SeedOption, listing_option

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from frida_painter.brush.kinds import BrushKind
    from frida_painter.brush.library import StrokeLibrary
    from frida_painter_calibration.procedures.strokes import RecordedStrokes
    from frida_painter_calibration.teaching.evaluation import Evaluation, Learned, Likelihood


# strokes evaluate: error of a stroke model on really painted strokes.


def evaluate_model(
    weights: Annotated[
        str,
        listing_option(
            "--weights",
            metavar="FILE",
            groups=(registry.STROKE_MODELS,),
            says="The weights to test (.safetensors), or a brush. Available:",
        ),
    ],
    library: Annotated[Path, taking("FILE", "A stroke library that the model was not trained on (.npz).")],
    page: Annotated[
        Path | None, taking("FILE", "Also write a page with pictures of the strokes (.html).", parser=out_file)
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print every figure as JSON.")] = False,
) -> None:
    """Measure the error of a stroke model on strokes that were really painted.

    The error is the mean absolute error of the magnitude map over the whole stored crop, from 0 to 1.
    All strokes count, also flawed ones.
    """
    from frida_painter.brush.library import StrokeLibrary
    from frida_painter.brush.weights import load_stroke_model
    from frida_painter.system.devices import prepare_process
    from frida_painter_calibration.teaching.evaluation import evaluate, likelihood
    from frida_painter_calibration.teaching.learned_pages import evaluation_page

    if page is not None and page.suffix != ".html":
        raise ConfigError(f"--page was given {str(page)!r}; a page goes into a file that ends in .html.")
    prepare_process()
    model, strokes = load_stroke_model(weights), StrokeLibrary.load(library)
    found, foretold = evaluate(model, strokes), likelihood(model, strokes)
    if page is not None:
        storage.write_text(page, evaluation_page(model, weights, strokes, library.name))
    columns: dict[str, NDArray[Any]] = {
        "recorded_index": strokes.recorded_index,
        "thickness": strokes.thickness,
        "length_m": strokes.length_m,
        "bend_m": strokes.bend_m,
        "error": found.error,
        "outside_the_limits": found.outside,
    }
    if not as_json:
        _show(found, foretold)
        return
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    record = {
        "weights": weights,
        "brush": model.brush,
        "library": str(library),
        "strokes": len(strokes),
        "mean_absolute_error": float(found.error.mean()),
        "error_of_bare_paper": float(found.paint.mean()),
        "log_likelihood": foretold.predicted,
        "log_likelihood_with_one_variance": foretold.constant,
        "strokes_outside_the_limits": int(found.outside.sum()),
        "per_stroke": [dict(zip(columns, row, strict=True)) for row in rows],
    }
    print(json.dumps(record, indent=2))


def _show(found: "Evaluation", foretold: "Likelihood") -> None:
    """Prints the errors."""
    error = found.error
    told = [
        f"{len(error)} strokes: mean absolute error [bold]{error.mean():.4f}[/] (bare paper would give "
        f"{found.paint.mean():.4f}); half of the strokes are below {sorted(error)[len(error) // 2]:.4f}, the worst has "
        f"{error.max():.4f}.",
        f"Mean and variance that the model expects: log likelihood {foretold.predicted:.2f} per cell, "
        f"{foretold.constant:.2f} with one variance for all cells.",
    ]
    if found.outside.any():
        told.append(f"{found.outside.sum()} of them are outside the lengths and bends that the model knows.")
    Console(highlight=False).print("\n".join(told), soft_wrap=True)


# strokes train: from photographs of strokes to a stroke model.


def train(
    library: Annotated[Path, typer.Argument(metavar="LIBRARY", help="A stroke library (.npz).")],
    brush: Annotated[
        str | None,
        listing_option(
            "--brush",
            metavar="NAME",
            groups=(registry.STROKE_MODELS,),
            says="The brush that painted the library. Without it, the limits come from the library. Available:",
            show_default=False,
        ),
    ] = None,
    model: Annotated[
        str, taking("NAME", f"{FIELD}: needs few strokes; {PARAM2STROKE}: the network of the FRIDA paper.")
    ] = DEFAULT_MODEL,
    seed: SeedOption = 0,
    out: Annotated[Path, taking("FILE", "The weights to write (.safetensors).", parser=out_file)] = Path(
        "weights.safetensors"
    ),
) -> None:
    """Train a stroke model on a library. It predicts a stroke's mark from its thickness, length and bend.

    A fifth of the strokes is held out for validation. The learning curve (.csv) and a page with
    pictures (.html) are written beside the weights.
    """
    from frida_painter.brush.kinds import brush_kind
    from frida_painter.brush.library import StrokeLibrary
    from frida_painter.system.devices import prepare_process
    from frida_painter_calibration.teaching.learned_pages import training_page

    if out.suffix != ".safetensors" or out.is_dir():
        raise ConfigError(f"--out was given {str(out)!r}; weights go into a file that ends in .safetensors.")
    if model not in MODELS:
        raise ConfigError(f"--model was given {model!r}; models are {' and '.join(MODELS)}.")
    kind = brush_kind(brush) if brush is not None else None
    strokes = StrokeLibrary.load(library)
    prepare_process()  # one thread: as fast as several here, and the same weights for any number of cores
    # The output file is opened first, so that an unwritable one fails before minutes of training.
    with storage.replacing(out) as unfinished, work_bar() as bar:
        learned = learn_on(bar, model, strokes, kind, seed)
        learned.model.save(unfinished)
    report, clean, page = learned.report, len(learned.library), out.with_suffix(".html")
    rows = [f"{step.epoch},{step.training_error},{step.validation_error}\n" for step in report.curve]
    storage.write_text(out.with_suffix(".csv"), "".join(("epoch,training_error,validation_error\n", *rows)))
    storage.write_text(page, training_page(learned, model, library.name, dirty=len(strokes) - clean))
    dirty = f" ({len(strokes) - clean} dirty ones were left out)" if len(strokes) > clean else ""
    print(
        f"Trained on {clean - len(report.held_out)} strokes{dirty}; on {len(report.held_out)} others the mean "
        f"error of the magnitude is {report.validation_error:.4f}: {out}\nPictures: {page}"
    )


def work_bar() -> Progress:
    """Returns the progress bar of a training or a library, which goes when it is done."""
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        console=Console(stderr=True, highlight=False),
        transient=True,
    )


def learn_on(bar: Progress, model: str, library: "StrokeLibrary", kind: "BrushKind | None", seed: int) -> "Learned":
    """Learns a stroke model of that name, and shows the progress on a bar."""
    from frida_painter_calibration.teaching.evaluation import learn
    from frida_painter_calibration.teaching.training import TrainingProgress

    task = bar.add_task("training", total=None)

    def hear(progress: TrainingProgress) -> None:
        words = f"training, error {progress.validation_error:.4f}, best {progress.best_error:.4f}"
        bar.update(task, total=progress.epochs, completed=progress.epoch, description=words)

    return learn(model, library, kind, seed=seed, notify=hear)


def paint_library(kind: "BrushKind", out: Path, count: int, seed: int, refill_every: int = 1) -> "RecordedStrokes":
    """Has the virtual studio paint a library of strokes of a brush into a file, and shows the progress."""
    from frida_painter.brush.library import Flaw
    from frida_painter.easel.dialogue import lead
    from frida_painter.easel.virtual_easel import open_virtual_easel
    from frida_painter_calibration.procedures.strokes import StrokesProgress, strokes

    with work_bar() as bar:
        task = bar.add_task("painting strokes", total=count)

        def hear(progress: StrokesProgress) -> None:
            flaw = f", {progress.flaw.words}" if progress.flaw is not Flaw.NONE else ""
            bar.update(task, completed=progress.done, description=f"painting strokes, paper {progress.sheet}{flaw}")

        easel = open_virtual_easel(kind.name, seed)
        painting = strokes(easel, kind, out, count=count, seed=seed, refill_every=refill_every, notify=hear)
        return lead(painting, lambda question: question.proposal or False)


def paint(
    brush: BrushOption = "broad",
    count: Annotated[int, whole_number_option(1, MAX_STROKES, "Number of strokes. About 200 are enough.")] = 200,
    seed: SeedOption = 0,
    refill_every: Annotated[
        int, whole_number_option(1, MAX_BETWEEN_REFILLS, "Strokes per dip of the brush. 1 dips before every stroke.")
    ] = 1,
    out: Annotated[Path, taking("FILE", "The stroke library to write (.npz).", parser=out_file)] = Path("library.npz"),
) -> None:
    """Paint single strokes of all shapes in the virtual studio, photograph each, and save them as a library.

    Flawed strokes are marked and never used for training. The contact sheet beside the library shows
    all strokes. If the command was interrupted, run it again to continue.
    """
    from frida_painter.brush.kinds import brush_kind
    from frida_painter.system import images
    from frida_painter.system.devices import prepare_process
    from frida_painter_calibration.procedures.strokes import contact_sheet, unfinished_folder

    kind = brush_kind(brush)
    if out.suffix != ".npz":
        raise ConfigError(f"--out was given {str(out)!r}; stroke libraries end in .npz.")
    prepare_process()
    if unfinished_folder(out).exists():
        print(f"Going on with the strokes in {unfinished_folder(out)}.")
    finding = paint_library(kind, out, count, seed, refill_every)
    sheet = out.with_suffix(".png")
    images.save(contact_sheet(finding.library, f"Strokes of the {kind.name} brush"), sheet)
    print(f"{finding.sentence}: {out}\nContact sheet: {sheet}")


def inspect(
    library: Annotated[Path, typer.Argument(metavar="LIBRARY", help="A stroke library (.npz).")],
    out: Annotated[
        Path | None, taking("FILE", "The contact sheet to write (.png or .jpg).", parser=out_file, show_default=False)
    ] = None,
) -> None:
    """Find the flawed strokes of a library, give the reasons, and write a contact sheet of all strokes."""
    from frida_painter.brush.library import Flaw, StrokeLibrary, judge
    from frida_painter.system import images
    from frida_painter_calibration.procedures.strokes import contact_sheet

    strokes_seen = StrokeLibrary.load(library)
    flaws = judge(strokes_seen)
    dirty = int((flaws != Flaw.NONE).sum())
    print(f"{len(strokes_seen)} strokes, {dirty} of them dirty and left out of training.")
    for flaw in Flaw:
        numbers = strokes_seen.recorded_index[flaws == flaw]
        if flaw is not Flaw.NONE and len(numbers):
            print(f"{len(numbers)} {flaw.words} ({flaw.sentence}): {', '.join(map(str, numbers))}")
    sheet = out or Path(f"{library.stem}-strokes.png")
    images.save(contact_sheet(strokes_seen, f"Strokes of {library.name}"), sheet)
    print(f"Contact sheet: {sheet}")


def register(app: typer.Typer) -> None:
    """Adds the commands."""
    app.command("evaluate")(evaluate_model)
    app.command("train")(train)
    app.command("paint")(paint)
    app.command("inspect")(inspect)
