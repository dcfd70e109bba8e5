"""The commands that make and show paintings: paint, plan, render."""

import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated, Any

import typer

from frida_painter.cli.goal_options import tell_left_out
from frida_painter.cli.run_options import (
    TAKEN,
    Photo,
    painting_options,
    planning_options,
    require_person,
    spec_of,
    taking,
)
from frida_painter.cli.wells import AskOption, FilledOption
from frida_painter.compiled import LoopCompiler
from frida_painter.errors import ConfigError
from frida_painter.options import out_file, whole_number, whole_number_within
from frida_painter.session.easel_launch import EaselLaunch

if TYPE_CHECKING:  # with them come tensors
    from frida_painter.plan import Plan
    from frida_painter.runs.spec import RunSpec

PlanFile = Annotated[
    Path, typer.Argument(metavar="PLAN", help="A plan.json, or the folder of a painting.", show_default=False)
]

Candidates = Annotated[
    int,
    typer.Option(
        "--candidates",
        parser=whole_number_within(1, 1000),
        metavar="N",
        help="Make N plans with different seeds, in several processes, and paint the best one.",
    ),
]


def register(app: typer.Typer) -> None:
    """Adds the commands; says which kinds of goals of other packages cannot be used."""
    tell_left_out(TAKEN)
    app.command("paint")(taking(painting_options(), paint))
    app.command("plan")(taking(planning_options(), plan))
    app.command("render")(render)


def paint(
    *,
    photo: Photo = None,
    candidates: Candidates = 1,
    ask: AskOption = False,
    yes: FilledOption = False,
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
    started = time.monotonic()
    spec = spec_of(photo, given)
    require_person(spec, asked=not yes)
    with LoopCompiler():
        spec, chosen = (spec, None) if candidates == 1 else _best_of(candidates, spec)
        _paint(spec, chosen, started, given["out"], asked=not yes, asks_for_paints=ask)


def _paint(
    spec: "RunSpec", chosen: "Plan | None", started: float, out: Path | None, *, asked: bool, asks_for_paints: bool
) -> None:
    """Paints what is described; chosen: by that plan."""
    with EaselLaunch(spec.robot) as launch:  # it loads while this process does
        from frida_painter.cli.leading import Leader, ready_planner, say_films
        from frida_painter.cli.stop_signal import stop_on_signals
        from frida_painter.runs.run import PaintingRun
        from frida_painter.session.opening import prepare_process

        prepare_process()
        with stop_on_signals() as stop, PaintingRun(spec, out) as run:
            say_films(run.spec)
            run.load_easel(launch)
            ready_planner(run, stop, out)
            stop.at_once = run.open_easel(hear_signals=True).robot.stop
            with Leader(run, stop, asked=asked, asks_for_paints=asks_for_paints, started=started) as leader:
                outcome = run.start(chosen)
    leader.conclude(outcome)


def _best_of(candidates: int, spec: "RunSpec") -> "tuple[RunSpec, Plan]":
    """The description with the best of so many seeds, and its plan; says which it is."""
    from rich.console import Console

    from frida_painter.cli.progress import SweepLine
    from frida_painter.sweeps.candidates import best_candidate

    with TemporaryDirectory() as folder, SweepLine(Console(stderr=True, highlight=False)) as line:
        best = best_candidate(spec, candidates, Path(folder), notify=line.hear)
    print(best.comparison, file=sys.stderr)
    return best.spec, best.plan


def plan(*, photo: Photo = None, **given: Any) -> None:
    """Plan the strokes without painting. Writes the plan, a picture of the plan and the palette to mix."""
    spec = spec_of(photo, given)
    with LoopCompiler():
        _plan(spec, given["out"])


def _plan(spec: "RunSpec", out: Path | None) -> None:
    """Plans what is described, into a folder."""
    from rich.console import Console

    from frida_painter import images
    from frida_painter.cli.leading import PLAN_ROOM, ready_planner, say
    from frida_painter.cli.progress import PlanningLine
    from frida_painter.cli.stop_signal import stop_on_signals
    from frida_painter.errors import Interrupted
    from frida_painter.planning.optimize import Step
    from frida_painter.report.palette_sheet import palette_sheet, sheet_file
    from frida_painter.runs.folder import new_folder
    from frida_painter.runs.run import PaintingRun
    from frida_painter.session.opening import prepare_process

    prepare_process()
    with stop_on_signals() as stop, PaintingRun(spec) as run:
        ready_planner(run, stop, out)
        folder = new_folder(out, run.spec.name, PLAN_ROOM)
        with PlanningLine(Console(stderr=True, highlight=False)) as bar:

            def hear(step: Step) -> None:
                bar.hear(step)
                if stop.asked:
                    raise Interrupted(
                        "You stopped the planning, and nothing was saved. Run the command again to plan from the start."
                    )

            made = run.plan(hear)
        bare = run.planner.bare
        made.save(folder / "plan.json")
        images.save(run.planner.expected(made, bare), folder / "plan.png")
        forecast = run.planner.forecast(made, bare)
        for layer, part in made.by_wells():
            images.save(palette_sheet(part), folder / sheet_file("palette.png", layer))
    say(
        f"The plan:    {folder / 'plan.json'}",
        f"As picture:  {folder / 'plan.png'}",
        f"Palette:     {folder / 'palette.png'}",
        *([f"Similarity:  {forecast}"] if forecast else []),
    )


def render(
    plan: PlanFile,
    height: Annotated[
        int,
        typer.Option(parser=whole_number, metavar="PIXELS", help="Height of the picture in pixels, from 16 to 10000."),
    ] = 1080,
    out: Annotated[
        Path, typer.Option(parser=out_file, metavar="FILE", help="The picture to write, .png or .jpg.")
    ] = Path("render.png"),
) -> None:
    """Render a plan as a picture of any size, with the stroke models of its brushes."""
    if not 16 <= height <= 10_000:
        raise ConfigError(f"--height was given {height}; it is from 16 to 10000 pixels.")
    if out.suffix.lower() not in (".png", ".jpg", ".jpeg"):
        raise ConfigError(f"--out was given {str(out)!r}; the picture ends in .png or .jpg.")
    from frida_painter import images
    from frida_painter.plan import Plan
    from frida_painter.render.plan_picture import render_plan

    loaded = Plan.load(plan)
    picture = render_plan(loaded, height)
    images.save(picture, out)
    rows, columns = picture.shape[1:]
    print(f"{len(loaded)} strokes at {columns} x {rows} pixels: {out}", file=sys.stdout)
