"""strokes paint, strokes inspect: the strokes that the painter learns its brush from, and which of them are good."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from frida_painter.brush.limits import MOST_BETWEEN_REFILLS, MOST_STROKES
from frida_painter.errors import ConfigError
from frida_painter.options import BrushOption, out_file, whole_number_within


def register(app: typer.Typer) -> None:
    """Adds the commands."""
    app.command("paint")(paint)
    app.command("inspect")(inspect)


def paint(
    brush: BrushOption = "broad",
    count: Annotated[
        int,
        typer.Option(
            parser=whole_number_within(1, MOST_STROKES), metavar="N", help="Number of strokes. About 200 are enough."
        ),
    ] = 200,
    seed: Annotated[int, typer.Option(parser=whole_number_within(0, 2**31 - 1), metavar="N", help="Random seed.")] = 0,
    refill_every: Annotated[
        int,
        typer.Option(
            parser=whole_number_within(1, MOST_BETWEEN_REFILLS),
            metavar="N",
            help="Strokes per dip of the brush. 1 dips before every stroke.",
        ),
    ] = 1,
    out: Annotated[
        Path, typer.Option(parser=out_file, metavar="FILE", help="The stroke library to write (.npz).")
    ] = Path("library.npz"),
) -> None:
    """Paint single strokes of all shapes in the virtual studio, photograph each, and save them as a library.

    Flawed strokes are marked and never used for training. The contact sheet beside the library shows
    all strokes. If the command was interrupted, run it again to continue.
    """
    from frida_painter import images
    from frida_painter.brush.flaw import Flaw
    from frida_painter.brush.kinds import brush_kind
    from frida_painter.session.opening import open_virtual_easel, prepare_process
    from frida_painter.session.procedures.dialogue import lead
    from frida_painter.session.procedures.strokes import StrokesProgress, strokes, unfinished

    kind = brush_kind(brush)
    if out.suffix != ".npz":
        raise ConfigError(f"--out was given {str(out)!r}; stroke libraries end in .npz.")
    prepare_process()
    if unfinished(out).exists():
        print(f"Going on with the strokes in {unfinished(out)}.")
    with _bar() as bar:
        task = bar.add_task("painting strokes", total=count)

        def hear(progress: StrokesProgress) -> None:
            flaw = f", {progress.flaw.words}" if progress.flaw is not Flaw.NONE else ""
            bar.update(task, completed=progress.done, description=f"painting strokes, paper {progress.sheet}{flaw}")

        easel = open_virtual_easel(brush, seed)
        painting = strokes(easel, kind, out, count=count, seed=seed, refill_every=refill_every, notify=hear)
        finding = lead(painting, lambda question: question.proposal or False)
    sheet = out.with_suffix(".png")
    images.save(finding.picture, sheet)
    print(f"{finding.sentence}\nContact sheet: {sheet}")


def inspect(
    library: Annotated[Path, typer.Argument(metavar="LIBRARY", help="A stroke library (.npz).")],
    out: Annotated[
        Path | None,
        typer.Option(
            parser=out_file, metavar="FILE", help="The contact sheet to write (.png or .jpg).", show_default=False
        ),
    ] = None,
) -> None:
    """Find the flawed strokes of a library, give the reasons, and write a contact sheet of all strokes."""
    from frida_painter import images
    from frida_painter.brush.flaw import Flaw
    from frida_painter.brush.judge import judge
    from frida_painter.brush.library import StrokeLibrary
    from frida_painter.session.contact_sheet import contact_sheet

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


def _bar() -> Progress:
    console = Console(stderr=True, highlight=False)
    return Progress(
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(), console=console
    )
