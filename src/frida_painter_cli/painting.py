"""Commands that make and show paintings: paint, plan, render, resume."""

import sys
import time
from contextlib import AbstractContextManager, ExitStack, nullcontext
from pathlib import Path
from types import FunctionType
from typing import TYPE_CHECKING, Annotated, Any

import typer

from frida_painter import registry
from frida_painter.easel.parent import EaselProcess
from frida_painter.errors import ConfigError, Interrupted
from frida_painter.planning.settings import PlanSettings
from frida_painter.runs.options import PaceOption, taking, whole_number_within, with_fields
from frida_painter.runs.spec import OF_PAINTINGS
from frida_painter.runs.variant_settings import VARIANT, VARIANTS, variant_of
from frida_painter_cli.imagining import imagine_beginning
from frida_painter_cli.options import (
    TAKEN,
    AskOption,
    BriefCommand,
    FilledOption,
    PageOption,
    Photo,
    PictureOut,
    PlanFile,
    ProposeOption,
    planning_options,
    require_person,
    require_proposer,
    spec_of,
    tell_left_out,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from frida_painter.easel.dialogue import Answer, Question
    from frida_painter.runs.run import PaintingRun
    from frida_painter.runs.spec import RunSpec
    from frida_painter_cli.stop_signal import StopSignal


_open_lead = registry.Later("frida_painter_studio.at_page:PageLead.open")
_give_picture = registry.Later("frida_painter_calibration.commands.without_camera:give_picture")
Candidates = Annotated[
    int,
    taking(
        "N",
        "Make N plans with different seeds, in several processes, and paint the best one.",
        "--candidates",
        parser=whole_number_within(1, 1000),
    ),
]
GivenPlan = Annotated[
    Path | None,
    taking(
        "FILE", "A plan.json of this goal and these settings, or a variant, painted instead of a new plan.", "--plan"
    ),
]
_SETS = "; ".join(
    f"{name}, {', '.join(f'{key.replace(chr(95), chr(45))} {value}' for key, value in settings.items()) or 'as usual'}"
    for name, settings in VARIANTS.items()
)
Variants = Annotated[
    int | None,
    taking(
        "N",
        f"Make so many plans side by side to choose from: {_SETS}. Your own settings hold in all of them. "
        "[dim]one plan as usual[/]",
        parser=whole_number_within(1, len(VARIANTS)),
        rich_help_panel=PlanSettings.panel,
    ),
]


def paint(
    *,
    photo: Photo = None,
    candidates: Candidates = 1,
    ask: AskOption = False,
    yes: FilledOption = False,
    propose: ProposeOption = None,
    plan: GivenPlan = None,
    page: PageOption = None,
    **given: Any,
) -> None:
    """Paint a photograph or a text prompt. Plans, paints some strokes, looks at the canvas and replans the rest.

    The virtual studio paints unless --robot names a robot arm, a plotter or a person (docs/how-to/machine.md).

    --text paints a text prompt, --style uses the style of another picture, --semantic paints what a
    picture shows, and --sketch follows the lines of a drawing. They can be combined (docs/how-to/several-goals.md).

    The folder of the painting contains the painting, a timelapse film, the palette to mix, the strokes
    and a page. Ctrl-C stops after the current stroke and keeps the work. A second Ctrl-C stops the robot
    at once. A real robot then stays stopped until you run `frida-painter arm`.
    """
    started, asked, chosen = time.monotonic(), not yes, None
    with _lead_at(page, "paint") as led, ExitStack() as stack:
        spec = spec_of(photo, given)
        require_person(spec, asked=asked)
        if led is None:
            _require_canvas_for_two(spec, candidates, asked=asked)
        require_proposer(propose, together=spec.together)
        if plan is None:
            spec = imagine_beginning(spec, given, asked=asked, paints=True)
        if candidates != 1:  # the best of this number of seeds; it prints which one it is
            spec, chosen = registry.parts(registry.PLAN_CHOOSERS)["candidates"].load(FunctionType)(spec, candidates)
        process = stack.enter_context(EaselProcess(spec.robot))  # loads in parallel with this process
        from frida_painter.easel.connecting import allow_motions
        from frida_painter.runs.run import PaintingRun
        from frida_painter.runs.settle import ground_of
        from frida_painter.strokes.plan import Plan
        from frida_painter.system.devices import prepare_process
        from frida_painter_cli.leading import Leader, answer_early, ready_planner, say_films
        from frida_painter_cli.stop_signal import stop_on_signals

        prepare_process()
        if plan is not None:
            chosen = Plan.load(plan)
            spec = variant_of(spec, dict(chosen.about).get(VARIANT, "")).with_values(ground=ground_of(chosen))
        differs = led is not None
        with stop_on_signals() as stop, PaintingRun(spec, given["out"], record_may_differ=differs) as run:
            say_films(run.spec)
            run.load_easel(process)
            ready_planner(run, stop, given["out"], led=led)
            if chosen is not None:
                run.require_fitting(chosen)
            _open_easel(run, stop, led, None if led else answer_early(run) if asked else allow_motions)
            with Leader(
                run, stop, asked=asked, asks_for_paints=ask, started=started, propose=propose, led=led
            ) as leader:
                outcome = run.start(chosen)
        leader.conclude(outcome)


def _lead_at(page: Path | None, job: str) -> AbstractContextManager[Any]:
    """Returns the lead of people at a page, in a `with` block that tells them how it ends; None without a page."""
    return nullcontext() if page is None else _open_lead(page, job)


def _open_easel(
    run: "PaintingRun", stop: "StopSignal", led: Any, answer: "Callable[[Question], Answer] | None"
) -> None:
    """Opens the easel, whose robot a stop stops at once. Raises Interrupted if people at a page stopped before."""
    if led is not None:
        run.heed()
    stop.at_once = run.open_easel(hear_signals=True, answer=answer).robot.stop
    if led is not None:
        led.stop.then(stop.stop_now)


def _require_canvas_for_two(spec: "RunSpec", candidates: int, *, asked: bool) -> None:
    """Raises ConfigError if a painting without a goal has nobody who can begin it."""
    if not spec.together:
        return
    if spec.simulated:
        raise ConfigError(
            "--together waits for your strokes, and in the virtual studio you paint them on the page: run "
            "frida-painter studio and choose No goal there, or name a robot with --robot."
        )
    if candidates != 1 or not asked:
        option = "--candidates" if candidates != 1 else "--yes"
        raise ConfigError(f"--together answers a person, and {option} is for paintings without one; leave out one.")


def plan(*, photo: Photo = None, variants: Variants = None, **given: Any) -> None:
    """Plan the strokes without painting. Writes the plan, a picture of it, the palette to mix and a shopping list."""
    spec, out = imagine_beginning(spec_of(photo, given), given, asked=True, paints=False), given["out"]
    from frida_painter_cli.variants import plan_once, plan_variants

    if variants is None:
        plan_once(spec, out)
    else:
        plan_variants(spec, out, variants)


def render(
    plan: PlanFile,
    height: Annotated[
        int,
        taking("PIXELS", "Height of the picture in pixels, from 16 to 10000.", parser=whole_number_within(16, 10_000)),
    ] = 1080,
    out: PictureOut = Path("render.png"),
) -> None:
    """Render a plan as a picture of any size.

    Up to 1080 rows, the stroke models of its brushes draw it; they know no more detail. Above, bristles of the virtual
    studio lay each stroke exactly where it is planned. Of a folder that `tiles` made, the tiles are joined, as far as
    they are painted.
    """
    from frida_painter.render.painting import render_plan
    from frida_painter.strokes.plan import Plan
    from frida_painter.system import images
    from frida_painter_cli.plan_output import lay_with_bristles
    from frida_painter_cli.tiling import LAYOUT, join_tiles

    if (plan / LAYOUT).exists():
        joined, painted = join_tiles(plan, height)
        images.save(joined, out)
        print(f"Painted: {', '.join(painted) or 'none yet'}; all others as planned: {out}")
        return
    loaded = Plan.load(plan)
    laid = lay_with_bristles(loaded, height) if height > 1080 else None
    picture = render_plan(loaded, height) if laid is None else images.from_uint8(laid)
    images.save(picture, out)
    print(f"{len(loaded)} strokes at {picture.shape[2]} x {picture.shape[1]} pixels: {out}", file=sys.stdout)
    if laid is None and height > 1080:
        print("Above 1080 rows it shows no more detail: the virtual studio has no bristles like those of its brushes.")


# Command that continues a painting that broke off, was stopped or has paused.

Folder = Annotated[Path, typer.Argument(metavar="FOLDER", help="The folder of the painting.", show_default=False)]
Repaint = Annotated[
    bool | None,
    typer.Option(
        "--repaint/--skip", help="Repaint or skip the stroke that may already be painted. [dim]asks; skip with --yes[/]"
    ),
]
OtherPlace = Annotated[
    str | None, taking("NAME", "The same kind of robot, at another port or address. [dim]where it was[/]", "--robot")
]
Yes = Annotated[
    bool, typer.Option("--yes", "-y", help="Ask no questions. Skips a stroke in doubt; a machine may home.")
]
AcceptChanges = Annotated[
    bool, typer.Option("--accept-changes", help="Continue although settings, pictures or the plan were changed.")
]


def resume(
    folder: Folder,
    repaint: Repaint = None,
    yes: Yes = False,
    accept_changes: AcceptChanges = False,
    pace: PaceOption = 0.0,
    propose: ProposeOption = None,
    page: PageOption = None,
    robot: OtherPlace = None,
) -> None:
    """Continue a painting that was stopped, paused or killed, from its folder.

    Shows the progress, photographs the canvas if there is a camera, asks about a stroke in doubt if there is
    one, cleans the brush and paints the rest. Nothing moves before you confirm, or give --yes.
    """
    started = time.monotonic()
    with _lead_at(page, "resume") as led, ExitStack() as stack:
        from frida_painter.easel.connecting import allow_motions
        from frida_painter.runs.painting_folder import NOW, are_there, history_of
        from frida_painter.runs.run import PaintingRun
        from frida_painter.session.events import SessionResumed
        from frida_painter.system.devices import prepare_process
        from frida_painter_cli.leading import Leader, answer_early, attend, confirm, ready_planner, say, tell
        from frida_painter_cli.stop_signal import stop_on_signals

        painted = (history := history_of(folder)).progress.painted
        if history.end.finished and led is None and are_there(folder, painted):
            say(f"This painting is finished: {painted} strokes, and nothing is left to do.")
            return
        prepare_process()
        changed, other = accept_changes, led is None
        run = stack.enter_context(
            PaintingRun.reopen(folder, accept_changes=changed, pace=pace, forget_stop=other, robot=robot)
        )
        if history.end.finished:
            attend(run, led)
            say(f"This painting is finished: {painted} strokes. Its page and pictures are made again.")
            tell(run.resume(), painted, history.sittings.seconds, watched=run.spec.has_camera or history.is_pictured)
            return
        require_person(run.spec, asked=not yes)
        require_proposer(propose, together=run.spec.together)
        _show(run)
        if not (yes or led or confirm(f"{_next_motion(run.spec)} Go on?", default=None)):
            raise Interrupted("Nothing was moved; the painting stays as it is.")
        stop = stack.enter_context(stop_on_signals())
        run.load_easel()  # loads in parallel with the planner
        ready_planner(run, stop, led=led)
        _open_easel(run, stop, led, None if led else allow_motions if yes else answer_early(run))
        leader = stack.enter_context(
            Leader(run, stop, asked=not yes, repaint=repaint, started=started, propose=propose, led=led)
        )
        at = f"The canvas as it {'was found' if run.spec.has_camera else 'should be'}: {run.folder / NOW}"
        run.listeners.append(lambda event: say(at) if isinstance(event, SessionResumed) else None)
        outcome = run.resume()
        stack.close()
        leader.conclude(outcome)


def watch(folder: Folder) -> None:
    """Follow a painting that another terminal or the studio makes, until it ends or pauses for good.

    Watching changes nothing; Ctrl-C ends it, and no other work.
    """
    from frida_painter_cli.leading import follow

    follow(folder)


def look(
    folder: Folder,
    picture: Annotated[
        Path, typer.Argument(metavar="PICTURE", help="A picture of the whole canvas, also HEIC.", show_default=False)
    ],
    corners: Annotated[
        str | None,
        taking(
            "X,Y ...",
            "The four corners of the canvas in the picture, in pixels, clockwise: column,row of each.",
            "--corners",
        ),
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Do not ask whether the corners were found right.")] = False,
) -> None:
    """Give a picture of the canvas to a painting without a camera. It counts as a look.

    Pause the painting, or take the picture while paint dries, so that the arm is aside. All four corners must be in
    it. The painter takes the picture between two strokes and plans the rest again. Of a finished painting, the page
    is made again with the picture. A picture of another canvas is refused.
    """
    from frida_painter.system.devices import prepare_process
    from frida_painter_cli.terminal import parse_corners

    pointed = None if corners is None else parse_corners(corners)
    if corners is not None and pointed is None:
        raise ConfigError(
            f"--corners was given {corners[:60]!r}; it is column and row of four corners, like "
            "'120,80 1400,95 1420,1010 100,1000'."
        )
    prepare_process()
    _give_picture(folder, picture, pointed, ask=not yes and sys.stdin.isatty())


def _next_motion(spec: "RunSpec") -> str:
    """Returns a sentence about what happens first when a painting is resumed."""
    if not spec.has_camera:
        return (
            "Nobody looks at the canvas (--camera none): put it exactly where it was. The arm will lift, clean its "
            "brush and paint on."
        )
    first = "The canvas" if spec.by_hand else "The arm will lift and move aside, and the canvas"
    return f"{first} will be photographed."


def _show(run: "PaintingRun") -> None:
    """Prints the progress of the painting."""
    from frida_painter.session.time_left import duration
    from frida_painter_cli.leading import say

    state, spec, progress, times = run.painting, run.spec, run.painting.progress, run.painting.sittings
    sittings = "one sitting" if times.count == 1 else f"{times.count} sittings"
    say(
        f"{spec.heading}: {progress.painted} of {spec.strokes} strokes on a canvas of "
        f"{spec.canvas}, painted in {sittings} of {duration(times.seconds)}."
    )
    if times.last is not None:
        say(f"It broke off on {times.last.astimezone():%Y-%m-%d at %H:%M:%S}.")
    if state.pictures.last is not None:
        say(f"The last photograph is {run.folder / state.pictures.last}")
    if progress.in_doubt is not None:
        say(f"Stroke {progress.in_doubt} was begun, and nothing tells whether it was painted.")


def register(app: typer.Typer) -> None:
    """Adds the commands; prints which kinds of goals of other packages cannot be used."""
    tell_left_out(TAKEN)
    app.command("paint", cls=BriefCommand)(with_fields(paint, *planning_options(OF_PAINTINGS)))
    app.command("plan", cls=BriefCommand)(with_fields(plan, *planning_options()))
    app.command("render")(render)
    app.command("resume")(resume)
    app.command("watch")(watch)
    app.command("look")(look)
