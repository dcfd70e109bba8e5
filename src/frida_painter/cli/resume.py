"""The command that goes on with a painting that broke off, was stopped or has paused."""

import time
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import torch
import typer
from rich.console import Console

from frida_painter import images, storage
from frida_painter.cli import kept
from frida_painter.cli.easel_options import PaceOption
from frida_painter.cli.painting import fit_to_canvas
from frida_painter.cli.progress import Forecast, PaintingProgress, duration
from frida_painter.cli.real import attended
from frida_painter.cli.sitting import Pauses, confirm, occasion, order, say, tell, tell_encoders, to_its_end
from frida_painter.cli.stopping import stopping
from frida_painter.cli.virtual import read_placement_error
from frida_painter.errors import ConfigError, FrameRejected, FridaError, Interrupted
from frida_painter.planning.planner import Planner
from frida_painter.report.doubt import doubt
from frida_painter.report.recorder import Recorder
from frida_painter.runs import goals
from frida_painter.session import resuming
from frida_painter.session.canvas_observer import CanvasObserver
from frida_painter.session.easel_process import EaselProcess
from frida_painter.session.history import History
from frida_painter.session.journal import Journal
from frida_painter.session.loop import ResumeState
from frida_painter.session.names import HUMAN, SAWYER_SIM
from frida_painter.session.opening import limit_threads, on_record, open_planner, open_session
from frida_painter.session.replan_policy import EvenlySpaced, ReplanPolicy
from frida_painter.session.resuming import KeptPlan

NOW = "now.png"

Folder = Annotated[Path, typer.Argument(metavar="FOLDER", help="The folder of the painting.", show_default=False)]
Repaint = Annotated[
    bool | None,
    typer.Option("--repaint/--skip", help="What to do with a stroke that may be painted or not. [dim]asks; skip[/]"),
]
Yes = Annotated[bool, typer.Option("--yes", "-y", help="Ask nothing; a stroke in doubt is skipped.")]
AcceptChanges = Annotated[
    bool, typer.Option("--accept-changes", help="Go on although settings, pictures or the plan were changed since.")
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
    """Go on with a painting that was stopped or broke off, from its folder.

    Shows how far it came, photographs the canvas, asks about the one stroke that may be in doubt, cleans
    the brush, and paints what is left. Nothing moves before you say so, or give --yes.
    """
    with ExitStack() as stack:
        journal, history = Journal.reopen(folder)
        stack.callback(journal.close)
        if history.finished:
            say(f"This painting is finished: {history.painted} strokes, and nothing is left to do.")
            return
        begun = Begun.read(folder, history, accept_changes=accept_changes)
        begun.how.site.require_somebody(asked=not yes)
        _show(begun, history)
        by_hand = begun.how.site.robot == HUMAN
        first = "The canvas" if by_hand else "The arm will lift and move aside, and the canvas"
        if not (yes or confirm(f"{first} will be photographed. Go on?", default=True)):
            raise Interrupted("Nothing was moved; the painting stays as it is.")
        storage.clear_leftovers(folder)
        started = time.monotonic()
        stop = stack.enter_context(stopping())
        limit_threads()
        process = stack.enter_context(EaselProcess())  # it loads while the planner does
        how, of = begun.how, begun.how.settings.strokes
        planner = open_planner(how.settings, begun.wanted.goal, how.calibration)
        planner.region = resuming.region(folder, history)
        tell_encoders(planner.encoders)
        error = read_placement_error(how.placement_error)
        filming = how.film and how.site.robot == SAWYER_SIM
        shapes = how.arm_meshes if how.arm_meshes and how.arm_meshes.is_dir() else None
        wish = order(
            how.settings, planner.model.brush, folder, error, pace, how.site, film_arm=filming, arm_meshes=shapes
        )
        easel = on_record(process.open(wish), how.calibration, how.site.needed)
        stop.at_once = easel.robot.stop
        stack.enter_context(process.hearing_signals())
        easel.robot.connect()
        easel.camera.connect()
        console = Console(stderr=True, highlight=False)
        forecast = _forecast(how.settings.strokes, EvenlySpaced(how.settings.replans), planner, started)
        bar = PaintingProgress(console, forecast)
        easel = attended(easel, how.site, console, folder, bar.aside, asked=not yes)
        telling = occasion(begun.wanted, begun.target, how.settings, planner.encoders, how.site)
        recorder = Recorder(folder, telling, planner.model, how.timelapse_frames, before=history)
        pauses = Pauses(folder, stop, console)

        def hear(event: Any) -> None:
            bar.hear(event)
            recorder.hear(event)

        session = open_session(
            how.settings,
            planner,
            easel,
            timelapse_frames=how.timelapse_frames,
            stop_asked=lambda: stop.asked,
            pause_asked=pauses.asked,
            go_on=pauses.go_on,
            notify=hear,
            journal=journal,
            light=resuming.light(history),
            placement=begun.plan.planning.placement if begun.plan else None,
        )
        if (bare := resuming.bare_photograph(folder)) is not None:
            session.observer.learn_good(bare)
        now = session.look()
        images.save(now, folder / NOW)
        before = resuming.seen_before(folder, begun.plan, session.observer) if begun.plan else None
        if before is not None and not accept_changes:
            require_as_left(begun, history, planner, session.observer, before, now)
        say(f"The canvas as it is now: {folder / NOW}")
        again = _repaint(begun, history, planner, now, folder, repaint=repaint, yes=yes)
        journal.resumed(history, repaint=again)
        stack.enter_context(bar)
        stack.enter_context(recorder)
        if begun.plan is None:
            ending = to_its_end(session, lambda: session.run(of, how.settings.colors), hear)
        else:
            known = None if accept_changes else before
            where = ResumeState(begun.plan.plan, history.painted, begun.plan.planning.done, known, now)
            ending = to_its_end(session, lambda: session.resume(where), hear)
        bar.say("finishing the film and the page")
        with suppress(FridaError):  # whatever is wrong with it was said before
            easel.robot.close()  # a film of it ends here
        page = None if ending.painting is None else recorder.finish(ending.painting)
    tell(folder, page, ending.painting, of, time.monotonic() - started)
    ending.conclude(stop)


@dataclass(frozen=True)
class Begun:
    """A painting as its folder keeps it: how it is painted, what it is to show, and its plan if there is one."""

    folder: Path
    how: kept.Kept
    wanted: goals.Wanted
    target: torch.Tensor | None
    plan: KeptPlan | None

    @classmethod
    def read(cls, folder: Path, history: History, *, accept_changes: bool) -> "Begun":
        """Raises ConfigError, showing all of them, where there are changes that nobody accepted."""
        how = kept.Kept.read(folder)
        plan = resuming.kept_plan(folder, history)
        changes = resuming.changes(history, how.plain(), how.rests_on(folder), plan)
        settled = resuming.settled_changes(history, how.plain())
        if changes and (settled or not accept_changes):
            told = "\n".join(f"  {line}" for line in changes)
            remedy = (
                f"{', '.join(settled)} cannot be changed any more; change it back in {folder / kept.SETTINGS}."
                if settled
                else "Change it back, or go on with what is there now: --accept-changes"
            )
            raise ConfigError(f"Since this painting was begun, something was changed:\n{told}\n{remedy}")
        wanted, target = fit_to_canvas(kept.read_goal(folder / history.goal), how.settings)
        return cls(folder, how, wanted, target, plan)


def _show(begun: Begun, history: History) -> None:
    """How far it came."""
    sittings = "one sitting" if history.sittings == 1 else f"{history.sittings} sittings"
    say(
        f"{begun.wanted.title}: {history.painted} of {begun.how.settings.strokes} strokes on a canvas of "
        f"{begun.how.settings.canvas}, painted in {sittings} of {duration(history.seconds)}."
    )
    if history.last is not None:
        say(f"It broke off on {history.last.astimezone():%Y-%m-%d at %H:%M:%S}.")
    if history.last_photograph is not None:
        say(f"The last photograph is {begun.folder / history.last_photograph}")
    if history.in_doubt is not None:
        say(f"Stroke {history.in_doubt} was begun, and nothing tells whether it was painted.")


def require_as_left(
    begun: Begun, history: History, planner: Planner, observer: CanvasObserver, before: torch.Tensor, now: torch.Tensor
) -> None:
    """Raises FrameRejected where another canvas is on the easel, or somebody has painted on this one."""
    if begun.plan is None or observer.good is None:
        return
    try:
        observer.good.require_explained(now, resuming.as_left(begun.plan, history, planner, before))
    except FrameRejected as difference:
        raise FrameRejected(
            f"{difference} Look at {begun.folder / NOW}; if it is to be painted on as it is, say --accept-changes"
        ) from difference


def _repaint(
    begun: Begun,
    history: History,
    planner: Planner,
    now: torch.Tensor,
    folder: Path,
    *,
    repaint: bool | None,
    yes: bool,
) -> bool:
    """Whether the stroke in doubt, if there is one, is painted again; a picture of it is shown."""
    if history.in_doubt is None or begun.plan is None:
        return False
    number, plan = history.in_doubt, begun.plan.plan
    painted = planner.expected(plan.part(slice(number - 1, number)), now)
    images.save(doubt(plan, number - 1, now, painted), folder / NOW)
    if repaint is not None or yes:
        return bool(repaint)
    return confirm(f"Look at {folder / NOW}: paint stroke {number} again?", default=False)


def _forecast(strokes: int, policy: ReplanPolicy, planner: Planner, started: float) -> Forecast:
    replanning = planner.effort.refining + planner.effort.replanning
    return Forecast(strokes, policy, started, planning=planner.iterations(strokes), replanning=replanning)
