"""The command that goes on with a painting that broke off, was stopped or has paused."""

import time
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from frida_painter.compiled import LoopCompiler
from frida_painter.options import PaceOption

if TYPE_CHECKING:
    from collections.abc import Callable

    from frida_painter.runs.run import PaintingRun
    from frida_painter.session.events import Event

Folder = Annotated[Path, typer.Argument(metavar="FOLDER", help="The folder of the painting.", show_default=False)]
Repaint = Annotated[
    bool | None,
    typer.Option(
        "--repaint/--skip", help="Repaint or skip the stroke that may already be painted. [dim]asks; skip with --yes[/]"
    ),
]
Yes = Annotated[bool, typer.Option("--yes", "-y", help="Ask no questions. Skips a stroke in doubt.")]
AcceptChanges = Annotated[
    bool, typer.Option("--accept-changes", help="Continue although settings, pictures or the plan were changed.")
]


def register(app: typer.Typer) -> None:
    """Adds the command."""
    app.command("resume")(resume)


def resume(
    folder: Folder,
    repaint: Repaint = None,
    yes: Yes = False,
    accept_changes: AcceptChanges = False,
    pace: PaceOption = 0.0,
) -> None:
    """Continue a painting that was stopped, paused or killed, from its folder.

    Shows the progress, photographs the canvas, asks about a stroke in doubt if there is one, cleans the
    brush and paints the rest. Nothing moves before you confirm, or give --yes.
    """
    from frida_painter.cli.leading import Leader, confirm, ready_planner, say, tell
    from frida_painter.cli.run_options import require_person
    from frida_painter.cli.stop_signal import stop_on_signals
    from frida_painter.errors import Interrupted
    from frida_painter.runs.folder import are_there
    from frida_painter.runs.reopening import history_of
    from frida_painter.runs.run import PaintingRun
    from frida_painter.session.opening import prepare_process

    if (history := history_of(folder)).finished:
        if are_there(folder, history.painted):
            say(f"This painting is finished: {history.painted} strokes, and nothing is left to do.")
            return
        say(f"This painting is finished: {history.painted} strokes. Its page and pictures are made again.")
        prepare_process()
        with PaintingRun.reopen(folder) as run:
            tell(run.resume(), history.painted, history.seconds)
        return
    started = time.monotonic()
    prepare_process()
    with ExitStack() as stack:
        stack.enter_context(LoopCompiler())
        run = stack.enter_context(PaintingRun.reopen(folder, accept_changes=accept_changes, pace=pace))
        require_person(run.spec, asked=not yes)
        _show(run)
        first = "The canvas" if run.spec.by_hand else "The arm will lift and move aside, and the canvas"
        if not (yes or confirm(f"{first} will be photographed. Go on?", default=True)):
            raise Interrupted("Nothing was moved; the painting stays as it is.")
        stop = stack.enter_context(stop_on_signals())
        run.load_easel()  # it loads while the planner does
        ready_planner(run, stop)
        stop.at_once = run.open_easel(hear_signals=True).robot.stop
        leader = stack.enter_context(Leader(run, stop, asked=not yes, repaint=repaint, started=started))
        run.listeners.append(_show_canvas(run))
        outcome = run.resume()
    leader.conclude(outcome)


def _show_canvas(run: "PaintingRun") -> "Callable[[Event], None]":
    """Says, when painting goes on, where the canvas is shown as it was found."""
    from frida_painter.cli.leading import say
    from frida_painter.runs.folder import NOW
    from frida_painter.session.events import Resumed

    def hear(event: "Event") -> None:
        if isinstance(event, Resumed):
            say(f"The canvas as it was found: {run.folder / NOW}")

    return hear


def _show(run: "PaintingRun") -> None:
    """How far it came."""
    from frida_painter.cli.leading import say
    from frida_painter.session.forecast import duration

    history, spec = run.history, run.spec
    assert history is not None
    sittings = "one sitting" if history.runs == 1 else f"{history.runs} sittings"
    say(
        f"{spec.heading}: {history.painted} of {spec.strokes} strokes on a canvas of "
        f"{spec.canvas}, painted in {sittings} of {duration(history.seconds)}."
    )
    if history.last is not None:
        say(f"It broke off on {history.last.astimezone():%Y-%m-%d at %H:%M:%S}.")
    if history.last_photograph is not None:
        say(f"The last photograph is {run.folder / history.last_photograph}")
    if history.in_doubt is not None:
        say(f"Stroke {history.in_doubt} was begun, and nothing tells whether it was painted.")
