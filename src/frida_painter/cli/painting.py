"""The commands that make and show paintings: paint, plan, render."""

import shutil
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any

import torch
import typer
from rich.console import Console

from frida_painter import images, storage
from frida_painter.brush.weights import load_stroke_model
from frida_painter.cli import goal_options, kept
from frida_painter.cli.easel_options import CameraOption, PaceOption, RobotOption, WorkspaceOption
from frida_painter.cli.numbers import number, whole_number
from frida_painter.cli.progress import Forecast, PaintingProgress, PlanningProgress
from frida_painter.cli.real import ArmMeshesOption, Site, attended, require_meshes
from frida_painter.cli.sitting import Pauses, occasion, order, say, tell, tell_encoders, to_its_end
from frida_painter.cli.stopping import stopping
from frida_painter.cli.virtual import PlacementErrorOption, read_placement_error
from frida_painter.cli.wells import AskOption, FilledOption, PaletteOption, Wells, read_palette
from frida_painter.config import PaintingSettings
from frida_painter.errors import ConfigError, FridaError, Interrupted
from frida_painter.frames import PixelGrid
from frida_painter.plan import Plan
from frida_painter.planning.optimize import Step
from frida_painter.render import render as render_strokes
from frida_painter.report.palette_sheet import palette_sheet
from frida_painter.report.recorder import Recorder
from frida_painter.runs import goals
from frida_painter.session.easel_process import EaselProcess
from frida_painter.session.journal import Journal
from frida_painter.session.loop import PHOTOGRAPH_ROWS
from frida_painter.session.names import SAWYER_SIM
from frida_painter.session.opening import limit_threads, on_record, open_planner, open_session
from frida_painter.session.replan_policy import EvenlySpaced
from frida_painter.virtual.sawyer.opengl import NONE as NO_OPENGL
from frida_painter.virtual.sawyer.opengl import headless_opengl

Photo = Annotated[
    Path | None,
    typer.Argument(
        metavar="[PHOTO]", help="The picture to paint: JPEG, PNG, WebP, TIFF, BMP or GIF.", show_default=False
    ),
]
PlanFile = Annotated[
    Path, typer.Argument(metavar="PLAN", help="A plan.json, or the folder of a painting.", show_default=False)
]
Strokes = Annotated[
    int | None,
    typer.Option(
        parser=whole_number, metavar="N", help="How many brush strokes; exactly so many are painted. [dim]300[/]"
    ),
]
Colors = Annotated[
    int | None, typer.Option(parser=whole_number, metavar="N", help="How many paints to mix. [dim]12[/]")
]
Canvas = Annotated[
    str | None,
    typer.Option(
        metavar="SIZE",
        help="Width x height of the canvas in in, cm or mm, like 14x11in or 297x210mm. "
        "[dim]14x11in, turned upright for an upright picture[/]",
    ),
]
Brush = Annotated[
    str | None,
    typer.Option(
        metavar="NAME", help="The brush: fine, medium or broad, or a file of weights that you trained. [dim]broad[/]"
    ),
]
RenderHeight = Annotated[
    int | None,
    typer.Option(
        parser=whole_number,
        metavar="ROWS",
        help="Rows of the picture in which is planned: more is finer and slower. [dim]256[/]",
    ),
]
Replans = Annotated[
    int | None,
    typer.Option(
        parser=whole_number, metavar="N", help="How often to look at the canvas and plan the rest again. [dim]4[/]"
    ),
]
EffortOption = Annotated[
    float | None,
    typer.Option(
        "--effort", parser=number, metavar="X", help="How long to think: 2 plans twice as long, 0.5 half. [dim]1[/]"
    ),
]
Seed = Annotated[
    int | None,
    typer.Option(
        parser=whole_number,
        metavar="N",
        help="Another seed gives another painting; the same gives the same. [dim]0[/]",
    ),
]
SettingsFile = Annotated[
    Path | None, typer.Option("--settings", metavar="FILE", help="A TOML file with these settings, like: strokes = 300")
]
Out = Annotated[
    Path | None,
    typer.Option(metavar="FOLDER", help="The folder for everything that is made. [dim]paintings/NAME-DATE-TIME[/]"),
]


CalibrationFile = Annotated[
    Path | None,
    typer.Option("--calibration", metavar="FILE", help="The easel's calibration record. [dim]the studio's own[/]"),
]


def register(app: typer.Typer) -> None:
    """Adds the commands."""
    app.command("paint")(paint)
    app.command("plan")(plan)
    app.command("render")(render)


def paint(
    photo: Photo = None,
    image: goal_options.Image = None,
    image_weight: goal_options.ImageWeight = None,
    semantic: goal_options.Semantic = None,
    semantic_weight: goal_options.SemanticWeight = None,
    sketch: goal_options.Sketch = None,
    sketch_weight: goal_options.SketchWeight = None,
    text: goal_options.Text = None,
    text_weight: goal_options.TextWeight = None,
    style: goal_options.Style = None,
    style_weight: goal_options.StyleWeight = None,
    init_text: goal_options.InitText = None,
    init_image: goal_options.InitImage = None,
    init_style: goal_options.InitStyle = None,
    goal: goal_options.GoalFile = None,
    clip: goal_options.ClipSource = None,
    strokes: Strokes = None,
    colors: Colors = None,
    canvas: Canvas = None,
    brush: Brush = None,
    render_height: RenderHeight = None,
    replans: Replans = None,
    effort: EffortOption = None,
    seed: Seed = None,
    settings: SettingsFile = None,
    robot: RobotOption = "virtual",
    camera: CameraOption = "",
    workspace: WorkspaceOption = None,
    calibration: CalibrationFile = None,
    placement_error: PlacementErrorOption = None,
    pace: PaceOption = 0.0,
    palette: PaletteOption = None,
    ask: AskOption = False,
    yes: FilledOption = False,
    film: Annotated[bool, typer.Option("--film/--no-film", help="Film how the painting comes into being.")] = True,
    arm_meshes: ArmMeshesOption = None,
    out: Out = None,
) -> None:
    """Paint a photograph, or words: plan, paint some strokes, look, plan the rest again.

    It is painted in the virtual studio, or by whom --robot names: a robot arm, a plotter, or your own
    hand; docs/machines.md tells how.

    With --text it is painted towards words, with --style in the style of another picture, with
    --semantic by what a picture shows, with --sketch along the lines of a drawing; docs/goals.md tells of all goals.

    Afterwards the folder holds the painting, a film, a palette to mix, the strokes, and a page that
    tells the story. Ctrl-C stops after the current stroke and keeps what was made; once more stops the
    robot at once, and it stays stopped until `frida-painter arm`.
    """
    site = Site(robot, camera, workspace)
    measured = read_palette(palette, colors) if palette else None
    colors = len(measured) if measured else colors
    wanted, target, chosen = _prepare(photo, settings, {**locals(), "canvas": site.canvas(canvas)})
    site.require_somebody(asked=not yes)
    console = Console(stderr=True, highlight=False)
    require_meshes(arm_meshes, site)
    how = kept.Kept(chosen, calibration, placement_error, film, site, arm_meshes)
    filming = film and robot == SAWYER_SIM
    if filming and headless_opengl() is None:
        print(NO_OPENGL, file=sys.stderr)
    error = read_placement_error(placement_error)
    timelapse_frames = how.timelapse_frames
    with ExitStack() as stack:
        stop = stack.enter_context(stopping())
        started = time.monotonic()
        limit_threads()
        process = stack.enter_context(EaselProcess())  # it loads while the planner does
        planner = open_planner(chosen, wanted.goal, calibration)
        tell_encoders(planner.encoders)
        folder = _new_folder(out, wanted.name, needed=200 * 2**20)
        wish = order(chosen, planner.model.brush, folder, error, pace, site, film_arm=filming, arm_meshes=arm_meshes)
        with _taken_back(folder):
            easel = on_record(process.open(wish), calibration, site.needed)
            stop.at_once = easel.robot.stop
            stack.enter_context(process.hearing_signals())
            easel.robot.connect()
            easel.camera.connect()
        journal = _begin_journal(folder, wanted, how)
        stack.callback(journal.close)
        policy = EvenlySpaced(chosen.replans)
        effort_per_replan = planner.effort.refining + planner.effort.replanning
        forecast = Forecast(
            chosen.strokes, policy, started, planning=planner.iterations(chosen.strokes), replanning=effort_per_replan
        )
        bar = stack.enter_context(PaintingProgress(console, forecast))
        easel = attended(easel, site, console, folder, bar.aside, asked=not yes)
        telling = occasion(wanted, target, chosen, planner.encoders, site)
        recorder = stack.enter_context(Recorder(folder, telling, planner.model, timelapse_frames))

        def hear(event: Any) -> None:
            bar.hear(event)
            recorder.hear(event)

        pauses = Pauses(folder, stop, console)
        session = open_session(
            chosen,
            planner,
            easel,
            timelapse_frames=timelapse_frames,
            stop_asked=lambda: stop.asked,
            pause_asked=pauses.asked,
            go_on=pauses.go_on,
            notify=hear,
            journal=journal,
            mixed=Wells(measured, input if ask else None, folder, poured=not easel.simulated).filled,
        )
        ending = to_its_end(session, lambda: session.run(chosen.strokes, chosen.colors), hear)
        bar.say("finishing the film and the page")
        with suppress(FridaError):  # whatever is wrong with it was said before
            easel.robot.close()  # a film of it ends here
        page = None if ending.painting is None else recorder.finish(ending.painting)
    tell(folder, page, ending.painting, chosen.strokes, time.monotonic() - started)
    ending.conclude(stop)


def plan(
    photo: Photo = None,
    image: goal_options.Image = None,
    image_weight: goal_options.ImageWeight = None,
    semantic: goal_options.Semantic = None,
    semantic_weight: goal_options.SemanticWeight = None,
    sketch: goal_options.Sketch = None,
    sketch_weight: goal_options.SketchWeight = None,
    text: goal_options.Text = None,
    text_weight: goal_options.TextWeight = None,
    style: goal_options.Style = None,
    style_weight: goal_options.StyleWeight = None,
    init_text: goal_options.InitText = None,
    init_image: goal_options.InitImage = None,
    init_style: goal_options.InitStyle = None,
    goal: goal_options.GoalFile = None,
    clip: goal_options.ClipSource = None,
    strokes: Strokes = None,
    colors: Colors = None,
    canvas: Canvas = None,
    brush: Brush = None,
    render_height: RenderHeight = None,
    effort: EffortOption = None,
    seed: Seed = None,
    settings: SettingsFile = None,
    palette: PaletteOption = None,
    out: Out = None,
) -> None:
    """Plan the strokes for a photograph, or for words, without painting: plan, picture of it, palette to mix."""
    measured = read_palette(palette, colors) if palette else None
    colors = len(measured) if measured else colors
    wanted, _, chosen = _prepare(photo, settings, {**locals(), "replans": 0})
    with ExitStack() as stack:
        stop = stack.enter_context(stopping())
        limit_threads()
        planner = open_planner(chosen, wanted.goal)
        tell_encoders(planner.encoders)
        folder = _new_folder(out, wanted.name, needed=20 * 2**20)
        bar = stack.enter_context(PlanningProgress(Console(stderr=True, highlight=False)))

        def hear(step: Step) -> None:
            bar.hear(step)
            if stop.asked:
                raise Interrupted("You stopped the planning; nothing was kept. Run the command again to plan anew.")

        bare = torch.ones(3, planner.fine.rows, planner.fine.columns)
        made = planner.plan(bare, chosen.strokes, chosen.colors, hear)
        made = planner.bind_to_palette(made, bare, measured, hear) if measured else made
    made.save(folder / "plan.json")
    images.save(planner.expected(made, bare), folder / "plan.png")
    images.save(palette_sheet(made), folder / "palette.png")
    say(
        f"The plan:    {folder / 'plan.json'}",
        f"As picture:  {folder / 'plan.png'}",
        f"Palette:     {folder / 'palette.png'}",
    )


def render(
    plan: PlanFile,
    height: Annotated[
        int,
        typer.Option(
            parser=whole_number, metavar="ROWS", help="Rows of the picture: any size, from a stamp to a poster."
        ),
    ] = 1080,
    out: Annotated[Path, typer.Option(metavar="FILE", help="The picture to write, .png or .jpg.")] = Path("render.png"),
) -> None:
    """Draw a plan as a picture of any size, as the simulation of the brush sees it."""
    if not 16 <= height <= 10_000:
        raise ConfigError(f"--height was given {height}; it is from 16 to 10000 rows.")
    if out.suffix.lower() not in (".png", ".jpg", ".jpeg"):
        raise ConfigError(f"--out was given {str(out)!r}; the picture ends in .png or .jpg.")
    loaded = Plan.load(plan)
    grid = PixelGrid.of_height(loaded.canvas, height)
    ground = torch.tensor(loaded.ground)[:, None, None].expand(3, grid.rows, grid.columns)
    model = load_stroke_model(loaded.brush)
    with torch.no_grad():
        picture = render_strokes(loaded.strokes, model, ground.contiguous(), loaded.canvas)
    images.save(picture, out)
    say(f"{len(loaded)} strokes at {grid.columns} x {grid.rows} pixels: {out}")


def _prepare(
    photo: Path | None, settings: Path | None, given: dict[str, Any]
) -> tuple[goals.Wanted, torch.Tensor | None, PaintingSettings]:
    """The goal, its first picture, if any, as it will fill the canvas, and the settings: options over the file."""
    names = set(PaintingSettings.model_fields)
    overrides = {name: value for name, value in given.items() if name in names and value is not None}
    chosen = PaintingSettings.from_toml(settings, **overrides) if settings else PaintingSettings.of(**overrides)
    wanted = goals.read_goal(photo, given)
    picture = wanted.picture
    if picture is not None and "canvas" not in chosen.model_fields_set:
        chosen = chosen.model_copy(update={"canvas": chosen.canvas.turned_like(*picture.shape[1:])})
    chosen = kept.as_read_again(chosen)
    return *fit_to_canvas(wanted, chosen), chosen


def fit_to_canvas(wanted: goals.Wanted, chosen: PaintingSettings) -> tuple[goals.Wanted, torch.Tensor | None]:
    """The goal, and its first picture if it has one, as they will fill the canvas."""
    grid = PixelGrid.of_height(chosen.canvas, max(PHOTOGRAPH_ROWS, chosen.render_height))
    picture = wanted.picture
    return wanted.fitted(grid), None if picture is None else images.fit(picture, grid.rows, grid.columns)


def _new_folder(out: Path | None, name: str, needed: int) -> Path:
    folder = out or Path("paintings") / f"{name}-{datetime.now():%Y%m%d-%H%M%S}"
    storage.require_space(folder, needed)
    storage.new_folder(folder)
    return folder


@contextmanager
def _taken_back(folder: Path) -> Iterator[None]:
    """Where the easel cannot be had, nothing was begun: the new folder goes away again."""
    try:
        yield
    except FridaError:
        shutil.rmtree(folder, ignore_errors=True)
        with suppress(OSError):  # "paintings", where this would have been the first
            folder.parent.rmdir()
        raise


def _begin_journal(folder: Path, wanted: goals.Wanted, how: kept.Kept) -> Journal:
    """Keeps in the folder all that resuming needs, and begins the journal of the painting."""
    kept.keep_goal(wanted, folder)
    how.write(folder)
    return Journal.begin(folder, how.plain(), how.rests_on(folder))
