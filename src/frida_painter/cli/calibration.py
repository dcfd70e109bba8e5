"""The commands that get to know an easel: calibrate, doctor."""

from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from frida_painter import images
from frida_painter.brush.kinds import brush_kind
from frida_painter.brush.training import FEWEST_STROKES
from frida_painter.calibration import PROCEDURES
from frida_painter.cli.doctor import examine
from frida_painter.cli.easel_options import CameraOption, RobotOption, WorkspaceOption
from frida_painter.cli.numbers import whole_number_within
from frida_painter.cli.terminal import Terminal
from frida_painter.cli.virtual import PlacementErrorOption
from frida_painter.runs.calibrating import (
    Place,
    begin_procedure,
    beside,
    default_record,
    easel_of,
    learn_from,
    record_to_renew,
)
from frida_painter.runs.easel import workspace_canvas
from frida_painter.runs.spec import RunSpec
from frida_painter.session.opening import limit_threads
from frida_painter.session.procedures.calibration_status import require_basis
from frida_painter.session.procedures.dialogue import Answer, Question, lead
from frida_painter.session.procedures.finding import Finding
from frida_painter.session.procedures.strokes import MOST_BETWEEN_REFILLS, MOST_STROKES, StrokesFinding


class What(StrEnum):
    """What can be calibrated."""

    canvas = "canvas"
    robot = "robot"
    color = "color"
    brush = "brush"
    strokes = "strokes"
    all = "all"


BrushOption = Annotated[str, typer.Option(metavar="NAME", help="The brush in it: fine, medium or broad.")]
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
    limit_threads()
    spec = _spec(robot, camera, workspace, canvas, brush, seed, placement_error)
    with easel_of(spec) as here:
        path = (record or default_record(here.calibration.easel)).absolute()
        place = Place(here, brush_kind(brush), path, seed, count, print, refill_every)
        _calibrate(what, place, ask=ask or not here.simulated)


def _calibrate(what: What, begun: "Place", *, ask: bool) -> None:
    here, path = begun.easel, begun.record
    known = record_to_renew(path, here.calibration, anew=what is What.all)
    console = Console(stderr=True, highlight=False)
    terminal = Terminal(
        lambda prompt: console.input(prompt, markup=False), lambda line: console.print(line, markup=False), path.parent
    )
    answer = terminal.answer if ask else _proposal
    try:
        here.robot.connect()
        here.camera.connect()
        for name in PROCEDURES if what is What.all else (what.value,):
            require_basis(name, known, here.calibration, defaults_hold=here.simulated)
            with console.status(f"{name} ...") if not ask else _Silence() as status:
                place = replace(begun, easel=replace(here, calibration=known), say=status.update)
                finding = lead(begin_procedure(name, place), answer)
                known = finding.enter(known)
                if isinstance(finding, StrokesFinding):
                    known = learn_from(finding, place, known)
            known.save(path)
            _tell(name, finding, path)
    finally:
        here.camera.close()
        here.robot.close()
    print(f"The record: {path}")


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
    with easel_of(_spec(robot, camera, workspace, canvas, brush, seed, None)) as easel:
        here = easel.calibration
    path = (record or default_record(here.easel)).absolute()
    if not examine(path, here, named=record is not None):
        raise typer.Exit(1)


def _spec(
    robot: str,
    camera: str,
    workspace: Path | None,
    canvas: str | None,
    brush: str,
    seed: int,
    placement_error: str | None,
) -> RunSpec:
    """The easel that the options name. Raises ConfigError."""
    given = {"canvas": canvas, "workspace": workspace, "placement_error": placement_error}
    said = {name: value for name, value in given.items() if value is not None}
    return workspace_canvas(RunSpec.of(robot=robot, camera=camera, brush=brush, seed=seed, **said))


def _tell(name: str, finding: Finding, record: Path) -> None:
    print(f"{name}: {finding.sentence}")
    if finding.picture is not None:
        picture = beside(record, f"{name}.png")
        images.save(finding.picture, picture)
        print(f"  {picture}")


def _proposal(question: Question) -> Answer:
    """The virtual studio agrees to whatever is proposed."""
    return question.proposal  # type: ignore[return-value]  # None where nothing was found: the procedure says what to do


class _Silence:
    """Stands where a status line would be overwritten by a dialogue."""

    def __enter__(self) -> "_Silence":
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def update(self, text: str) -> None:
        """Says nothing."""
