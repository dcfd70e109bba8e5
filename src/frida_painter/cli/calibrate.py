"""The commands that get to know an easel: calibrate, doctor."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from frida_painter.brush.limits import FEWEST_STROKES
from frida_painter.cli.virtual import PlacementErrorOption
from frida_painter.options.easel import BrushOption, CameraOption, RobotOption, WorkspaceOption
from frida_painter.options.numbers import whole_number_within
from frida_painter.session.procedures.limits import MOST_BETWEEN_REFILLS, MOST_STROKES


class What(StrEnum):
    """What can be calibrated."""

    canvas = "canvas"
    robot = "robot"
    color = "color"
    brush = "brush"
    strokes = "strokes"
    all = "all"


CanvasOption = Annotated[
    str | None,
    typer.Option(
        metavar="SIZE",
        help="Width x height of the canvas on it in in, cm or mm. [dim]the workspace's, else 14x11in[/]",
    ),
]
SeedOption = Annotated[
    int,
    typer.Option(
        parser=whole_number_within(0, 2**31 - 1),
        metavar="N",
        help="Which virtual studio: each has its own light, hand and tuft. `paint --seed` paints in it.",
    ),
]
RecordOption = Annotated[
    Path | None,
    typer.Option("--record", metavar="FILE", help="The calibration record. [dim]one per easel in your data folder[/]"),
]


def register(app: typer.Typer) -> None:
    """Adds the commands."""
    app.command("calibrate")(calibrate)
    app.command("doctor")(doctor)


def calibrate(
    what: Annotated[What, typer.Argument(metavar="canvas|robot|color|brush|strokes|all", help="What to find out.")],
    robot: RobotOption = "virtual",
    camera: CameraOption = "",
    workspace: WorkspaceOption = None,
    brush: BrushOption = "broad",
    canvas: CanvasOption = None,
    seed: SeedOption = 0,
    placement_error: PlacementErrorOption = None,
    count: Annotated[
        int,
        typer.Option(
            parser=whole_number_within(FEWEST_STROKES, MOST_STROKES),
            metavar="N",
            help="How many strokes the strokes procedure paints, and learns the brush from.",
        ),
    ] = 200,
    refill_every: Annotated[
        int,
        typer.Option(
            parser=whole_number_within(1, MOST_BETWEEN_REFILLS),
            metavar="N",
            help="Strokes that the strokes procedure paints with one dip; from 2 on it learns what a dip holds.",
        ),
    ] = 1,
    ask: Annotated[
        bool, typer.Option("--ask", help="Ask me, as on a real easel; without it the virtual studio answers itself.")
    ] = False,
    record: RecordOption = None,
) -> None:
    """Get to know an easel: where its canvas is, where its robot paints, how its camera sees, what its brush does.

    Each procedure is entered into the easel's record as soon as it is done, with a picture of what
    was found beside it. `all` does the five in order.
    """
    from frida_painter.brush.kinds import brush_kind
    from frida_painter.calibration import PROCEDURES
    from frida_painter.cli.calibration import easel_spec, lead_all
    from frida_painter.runs.calibrating import CalibrationSetup, default_record, easel_of
    from frida_painter.session.opening import limit_threads

    limit_threads()
    spec = easel_spec(robot, camera, workspace, canvas, brush, seed, placement_error)
    names = PROCEDURES if what is What.all else (what.value,)
    with easel_of(spec) as here:
        path = (record or default_record(here.calibration.easel)).absolute()
        setup = CalibrationSetup(here, brush_kind(brush), path, seed, count, print, refill_every)
        lead_all(names, setup, anew=what is What.all, ask=ask or not here.simulated)


def doctor(
    robot: RobotOption = "virtual",
    camera: CameraOption = "",
    workspace: WorkspaceOption = None,
    brush: BrushOption = "broad",
    canvas: CanvasOption = None,
    seed: SeedOption = 0,
    record: RecordOption = None,
) -> None:
    """Tell how the easel's calibration stands: what was done when and how well, and what to repeat.

    Exit status 1 where painting with this record would be refused.
    """
    from frida_painter.cli.calibration import easel_spec
    from frida_painter.cli.doctor import examine
    from frida_painter.runs.calibrating import default_record, easel_of

    with easel_of(easel_spec(robot, camera, workspace, canvas, brush, seed, None)) as easel:
        here = easel.calibration
    path = (record or default_record(here.easel)).absolute()
    if not examine(path, here, named=record is not None):
        raise typer.Exit(1)
