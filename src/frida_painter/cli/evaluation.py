"""strokes evaluate: how near a stroke model comes to strokes that were really painted."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.table import Table

from frida_painter import registry, storage
from frida_painter.errors import ConfigError
from frida_painter.options import ListingOption, out_file

if TYPE_CHECKING:
    from frida_painter.brush.library import StrokeLibrary
    from frida_painter.brush.measure import Evaluation, Likelihood

_SHOWN = 8


def register(app: typer.Typer) -> None:
    """Adds the command."""
    app.command("evaluate")(evaluate_model)


def evaluate_model(
    weights: Annotated[
        str,
        ListingOption(
            "--weights",
            metavar="FILE",
            groups=(registry.STROKE_MODELS,),
            says="The weights to test (.safetensors), or a brush. Available:",
        ),
    ],
    library: Annotated[
        Path, typer.Option(metavar="FILE", help="A stroke library that the model was not trained on (.npz).")
    ],
    page: Annotated[
        Path | None,
        typer.Option(parser=out_file, metavar="FILE", help="Also write a page with pictures of the strokes (.html)."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print every figure as JSON.")] = False,
) -> None:
    """Measure the error of a stroke model on strokes that were really painted.

    The error is the mean absolute error of the magnitude map over the whole stored crop, from 0 to 1.
    All strokes count, also flawed ones.
    """
    from frida_painter.brush.library import StrokeLibrary
    from frida_painter.brush.measure import evaluate, likelihood
    from frida_painter.brush.weights import load_stroke_model
    from frida_painter.report.training_page import evaluation_page
    from frida_painter.session.opening import prepare_process

    if page is not None and page.suffix != ".html":
        raise ConfigError(f"--page was given {str(page)!r}; a page goes into a file that ends in .html.")
    prepare_process()
    model = load_stroke_model(weights)
    strokes = StrokeLibrary.load(library)
    found, foretold = evaluate(model, strokes), likelihood(model, strokes)
    if page is not None:
        storage.write_text(page, evaluation_page(model, weights, strokes, library.name))
    if as_json:
        print(json.dumps(_record(weights, library, model.brush, strokes, found, foretold), indent=2))
    else:
        _show(strokes, found, foretold)


def _record(
    weights: str, path: Path, brush: str, strokes: "StrokeLibrary", found: "Evaluation", foretold: "Likelihood"
) -> dict[str, str | int | float | list[dict[str, int | float | bool]]]:
    return {
        "weights": weights,
        "brush": brush,
        "library": str(path),
        "strokes": len(strokes),
        "mean_absolute_error": float(found.error.mean()),
        "error_of_bare_paper": float(found.paint.mean()),
        "log_likelihood": foretold.predicted,
        "log_likelihood_with_one_variance": foretold.constant,
        "strokes_outside_the_limits": int(found.outside.sum()),
        "per_stroke": [
            {
                "recorded_index": int(strokes.recorded_index[index]),
                "thickness": float(strokes.thickness[index]),
                "length_m": float(strokes.length_m[index]),
                "bend_m": float(strokes.bend_m[index]),
                "error": float(found.error[index]),
                "outside_the_limits": bool(found.outside[index]),
            }
            for index in range(len(strokes))
        ],
    }


def _show(strokes: "StrokeLibrary", found: "Evaluation", foretold: "Likelihood") -> None:
    console = Console(highlight=False)
    console.print(
        f"{len(strokes)} strokes: mean absolute error [bold]{found.error.mean():.4f}[/] "
        f"(bare paper would give {found.paint.mean():.4f}); half of the strokes are below "
        f"{sorted(found.error)[len(strokes) // 2]:.4f}, the worst has {found.error.max():.4f}.",
        soft_wrap=True,
    )
    console.print(
        f"Mean and variance that the model expects: log likelihood {foretold.predicted:.2f} per cell, "
        f"{foretold.constant:.2f} with one variance for all cells.",
        soft_wrap=True,
    )
    if found.outside.any():
        console.print(
            f"{found.outside.sum()} of them are outside the lengths and bends that the model knows (marked *)."
        )
    worst = found.error.argsort()[::-1][:_SHOWN]
    table = Table("stroke", "thickness", "length", "bend", "error", title=f"The {len(worst)} farthest off", box=None)
    for column in table.columns:
        column.justify = "right"
    for index in worst:
        table.add_row(
            f"{strokes.recorded_index[index]}{'*' if found.outside[index] else ''}",
            f"{strokes.thickness[index]:.2f}",
            f"{1000 * strokes.length_m[index]:.1f} mm",
            f"{1000 * strokes.bend_m[index]:.1f} mm",
            f"{found.error[index]:.4f}",
        )
    console.print(table)
