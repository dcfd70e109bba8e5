"""The commands about where things stand around a robot: check a plan there, print and draw workspaces."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import torch
import typer

from frida_painter import images
from frida_painter.brush.kinds import brush_kind
from frida_painter.brush.weights import load_stroke_model
from frida_painter.calibration import Calibration
from frida_painter.cli.progress import duration
from frida_painter.cli.real import VIRTUAL
from frida_painter.errors import ConfigError
from frida_painter.frames import CanvasSize, PixelGrid
from frida_painter.hardware.motion import Motion
from frida_painter.hardware.reach import Reach
from frida_painter.hardware.timing import Timing
from frida_painter.hardware.workcell import WorkcellConfig, example
from frida_painter.hardware.workspace import Workspace
from frida_painter.plan import Plan
from frida_painter.render import render
from frida_painter.report.offending_strokes import offending_strokes
from frida_painter.report.workspace_plan import workspace_plan
from frida_painter.session.choreography import BrushLoad, Choreography
from frida_painter.session.easel_order import EaselOrder
from frida_painter.session.easel_process import state_folder
from frida_painter.session.easels import open_easel
from frida_painter.session.machines import robot_named
from frida_painter.session.names import MACHINES, SAWYER_SIM, SIMULATED, require_known
from frida_painter.session.opening import limit_threads
from frida_painter.session.procedures.calibration_status import require
from frida_painter.session.refilling import refilled
from frida_painter.session.rehearsal import Rehearsal, rehearse
from frida_painter.session.timetable import Timetable
from frida_painter.session.timing import reckon
from frida_painter.virtual.sawyer.arm import TIMING
from frida_painter.virtual.sawyer.reach import SawyerReach

_TOLD = 12  # faults; the picture shows all
_ROWS = 900
_SOME_CAMERA = "opencv:0"  # a person's easel has to have one; nothing is photographed here

PictureOut = Annotated[Path, typer.Option(metavar="FILE", help="The picture to write, .png or .jpg.")]


def register(app: typer.Typer) -> None:
    """Adds the commands."""
    app.command("check")(check)
    group = typer.Typer(no_args_is_help=True, help="Write down where canvas, wells, water and rag stand, in metres.")
    group.command("example")(print_example)
    group.command("draw")(draw)
    app.add_typer(group, name="workspace")


def check(
    plan: Annotated[
        Path, typer.Argument(metavar="PLAN", help="A plan.json, or the folder of a painting.", show_default=False)
    ],
    robot: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Who is to paint it, as paint --robot names them. [dim]any robot in the workspace, or virtual[/]",
        ),
    ] = None,
    workspace: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="The workspace of the easel (TOML). [dim]the virtual studio's own[/]"),
    ] = None,
    calibration: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="The easel's calibration record. [dim]the heights of the workspace[/]"),
    ] = None,
    out: PictureOut = Path("check.png"),
) -> None:
    """Check whether a whole plan can be painted on an easel, before anything moves.

    Every motion is asked for: strokes, dips, rinses, wipes. Where something cannot be done, it is
    told, a picture shows the strokes in red, and the exit status is 1.
    """
    _require_picture(out)
    limit_threads()
    loaded = Plan.load(plan)
    there = _place(loaded, robot, workspace)
    place = there.workspace
    known = _known(calibration, there.calibration)
    found = rehearse(loaded, place, there.canvas, known, there.reach)
    if found.passed:
        print(f"{_count(len(loaded), 'stroke')} in {_count(len(loaded.palette), 'paint')}: all of it can be painted.")
        brush = refilled(brush_kind(loaded.brush), known, simulated=there.simulated)
        choreography = Choreography(Motion(place, known), brush)
        _tell_time(reckon(loaded, choreography, BrushLoad(), lambda painted: 0, there.timing))
        print(f"The brush is dipped again after {brush.dip}.")
        return
    _tell(found, len(loaded))
    if found.strokes:
        images.save(offending_strokes(loaded, _picture(loaded), found.strokes), out)
        print(f"  The strokes in red: {out}", file=sys.stderr)
    raise typer.Exit(1)


def print_example() -> None:
    """Print a whole workspace file with comments; redirect it into a file of your own and measure."""
    print(example(), end="")


def draw(
    workspace: Annotated[Path, typer.Argument(metavar="FILE", help="A workspace (TOML).", show_default=False)],
    out: PictureOut = Path("workspace.png"),
) -> None:
    """Draw a workspace as seen from above, to compare it with the table in front of you."""
    _require_picture(out)
    stand = WorkcellConfig.load(workspace)
    images.save(workspace_plan(stand.workspace, stand.canvas, stand.easel), out)
    print(f"{stand.easel}: {_count(len(stand.workspace.wells), 'well')}, canvas of {stand.canvas}: {out}")


@dataclass(frozen=True)
class _Place:
    """What a plan is checked against: an easel of which nothing is opened."""

    workspace: Workspace
    canvas: CanvasSize
    calibration: Calibration
    reach: Reach | None
    timing: Timing | None
    simulated: bool


def _place(plan: Plan, robot: str | None, workspace: Path | None) -> _Place:
    """Where it is to be painted: in the workspace of that file, or where a robot of that name knows its own."""
    if workspace is not None:
        stand = WorkcellConfig.load(workspace)
        if robot is not None and require_known(robot) in MACHINES:
            robot_named(robot, stand.workspace)  # only to hear what is wrong with it
        reach: Reach | None = stand.reach
        timing: Timing | None = None
        if robot == SAWYER_SIM:  # a Sawyer whose foot is the workspace's origin
            reach, timing = SawyerReach(stand.workspace, stand.canvas), TIMING
        known, simulated = stand.calibration(plan.brush), robot in SIMULATED
        return _Place(stand.workspace, stand.canvas, known, reach, timing, simulated)
    if robot is not None and require_known(robot) in MACHINES:
        raise ConfigError(f"Where things stand around {robot[:60]!r} is not known; say it with --workspace FILE.")
    order = EaselOrder(robot or VIRTUAL.robot, plan.canvas, plan.brush, 0, state_folder(), camera=_SOME_CAMERA)
    easel = open_easel(order).easel
    return _Place(easel.workspace, easel.canvas, easel.calibration, easel.reach, easel.timing, easel.simulated)


def _known(record: Path | None, default: Calibration) -> Calibration:
    """The easel's record; refused where it is of another easel, brush or canvas."""
    if record is None:
        return default
    known = Calibration.load(record)
    require(known, default, ())
    return known


def _picture(plan: Plan) -> torch.Tensor:
    grid = PixelGrid.of_height(plan.canvas, _ROWS)
    ground = torch.tensor(plan.ground)[:, None, None].expand(3, grid.rows, grid.columns)
    with torch.no_grad():
        return render(plan.strokes, load_stroke_model(plan.brush), ground.contiguous(), plan.canvas)


def _tell(found: Rehearsal, strokes: int) -> None:
    print("This plan cannot be painted here:", file=sys.stderr)
    faults = [*found.others, *found.strokes.values()]
    told = [*found.mismatches, *(f"{fault.label}: {fault.reason}" for fault in faults)]
    for line in told[:_TOLD]:
        print(f"  {line}", file=sys.stderr)
    if len(told) > _TOLD:
        print(f"  and {len(told) - _TOLD} more", file=sys.stderr)
    if found.strokes:
        print(f"  {len(found.strokes)} of {_count(strokes, 'stroke')} are concerned.", file=sys.stderr)
    for remedy in dict.fromkeys(fault.remedy for fault in faults):
        print(f"  What to do: {remedy}.", file=sys.stderr)


def _tell_time(table: Timetable) -> None:
    parts = {"strokes": table.strokes, "dips": table.dips, "washing": table.washing, "travel": table.travel}
    spent = ", ".join(f"{name} {duration(seconds)}" for name, seconds in parts.items())
    print(f"The robot takes {duration(table.total)} without looks and planning: {spent}.")


def _require_picture(out: Path) -> None:
    if out.suffix.lower() not in (".png", ".jpg", ".jpeg"):
        raise ConfigError(f"--out was given {str(out)!r}; the picture ends in .png or .jpg.")


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"
