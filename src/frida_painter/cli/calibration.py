"""The commands that get to know an easel: calibrate, doctor."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer
from platformdirs import user_data_path
from rich.console import Console

from frida_painter import images
from frida_painter.brush.kinds import BrushKind, brush_kind
from frida_painter.brush.learn import DEFAULT_MODEL, learn
from frida_painter.brush.training import FEWEST_STROKES, TrainingProgress
from frida_painter.calibration import PROCEDURES, Calibration, LearnedFile
from frida_painter.cli.doctor import examine
from frida_painter.cli.easel_options import BrushOption, CameraOption, RobotOption, WorkspaceOption
from frida_painter.cli.numbers import whole_number_within
from frida_painter.cli.real import VIRTUAL, Site
from frida_painter.cli.terminal import Terminal
from frida_painter.cli.virtual import PlacementErrorOption, read_placement_error
from frida_painter.errors import CalibrationError
from frida_painter.frames import CanvasSize
from frida_painter.hardware.easel import Easel
from frida_painter.session.easel_kinds.studio import studio_brush, with_brush
from frida_painter.session.easel_order import EaselOrder
from frida_painter.session.easel_process import EaselProcess, state_folder
from frida_painter.session.opening import limit_threads
from frida_painter.session.procedures.brush import brush as brush_procedure
from frida_painter.session.procedures.calibration_status import require_basis
from frida_painter.session.procedures.canvas import canvas as canvas_procedure
from frida_painter.session.procedures.color import color as color_procedure
from frida_painter.session.procedures.dialogue import Answer, Procedure, Question, lead
from frida_painter.session.procedures.finding import Finding
from frida_painter.session.procedures.robot import robot as robot_procedure
from frida_painter.session.procedures.strokes import MOST_BETWEEN_REFILLS, MOST_STROKES, StrokesFinding, StrokesProgress
from frida_painter.session.procedures.strokes import strokes as strokes_procedure
from frida_painter.virtual.studio import open_studio
from frida_painter.virtual.table import PlacementError


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
    limit_threads()
    site, error = Site(robot, camera, workspace), read_placement_error(placement_error)
    with _easel(site, canvas, brush, seed, error) as here:
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
    with _easel(Site(robot, camera, workspace), canvas, brush, seed, None) as easel:
        here = easel.calibration
    path = (record or default_record(here.easel)).absolute()
    if not examine(path, here, named=record is not None):
        raise typer.Exit(1)


@contextmanager
def _easel(site: Site, canvas: str | None, brush: str, seed: int, error: PlacementError | None) -> Iterator[Easel]:
    """The easel there, neither robot nor camera connected; a real one in a process of its own."""
    size = CanvasSize.parse(site.canvas(canvas) or "14x11in")
    if site == VIRTUAL:
        studio = open_studio(size, studio_brush(brush), seed=seed, placement_error=error)
        yield with_brush(studio.easel, brush)
        return
    with EaselProcess() as process:
        yield process.open(
            EaselOrder(
                robot=site.robot,
                canvas=size,
                brush=brush,
                seed=seed,
                state=state_folder(),
                placement_error=error,
                workspace=None if site.workspace is None else site.workspace.absolute(),
                camera=site.camera,
            )
        )


def default_record(easel: str) -> Path:
    """Where the record of an easel is kept when nobody says otherwise."""
    folder = "-".join(easel.split())
    return user_data_path("frida-painter", appauthor=False) / "easels" / folder / "calibration.json"


@dataclass(frozen=True)
class Place:
    """What procedures may want to know: the easel with the record so far, and where they may leave files."""

    easel: Easel
    brush: BrushKind
    record: Path
    seed: int
    count: int
    say: Callable[[str], None]
    refill_every: int = 1

    def beside(self, ending: str) -> Path:
        """A file that belongs to the record."""
        return beside(self.record, ending)


def begin_procedure(name: str, place: Place) -> Procedure[Any]:
    """The procedure of that name, begun at that place."""

    def hear(progress: StrokesProgress) -> None:
        place.say(f"strokes: {progress.done} of {progress.of}, paper {progress.sheet}")

    match name:
        case "canvas":
            return canvas_procedure(place.easel)
        case "robot":
            return robot_procedure(place.easel)
        case "color":
            return color_procedure(place.easel)
        case "brush":
            return brush_procedure(place.easel, name=place.brush.name)
        case _:
            library = place.beside("strokes.npz")
            return strokes_procedure(
                place.easel,
                place.brush,
                library,
                count=place.count,
                seed=place.seed,
                refill_every=place.refill_every,
                notify=hear,
            )


def learn_from(finding: StrokesFinding, place: Place, record: Calibration) -> Calibration:
    """The record with what the strokes teach of the brush, by which `paint --calibration` plans.

    Raises LibraryError where fewer than 5 strokes are clean.
    """

    def hear(progress: TrainingProgress) -> None:
        place.say(f"strokes: learning from them, {progress.epoch} of {progress.epochs}")

    learned = learn(DEFAULT_MODEL, finding.library, place.brush, seed=place.seed, notify=hear)
    path = place.beside("weights.safetensors")
    weights = LearnedFile(str(path), learned.model.save(path))
    assert record.library is not None  # the finding has just entered it
    return record.with_strokes(record.library, weights, residual=learned.report.validation_error)


def record_to_renew(path: Path, default: Calibration, *, anew: bool) -> Calibration:
    """The record to go on with: the one in the file, or the easel's default for a first one and for all `anew`.

    Raises CalibrationError where the one in the file is damaged, unless all is done anew.
    """
    if not path.exists():
        return default
    try:
        known = Calibration.load(path)
    except CalibrationError:
        if anew:
            return default
        raise
    if anew and known.easel == default.easel:
        return replace(default, done=known.done)  # what is done anew is newer than all that was
    return known


def beside(record: Path, ending: str) -> Path:
    """A file beside a record that belongs to it: "calibration.json" and "robot.png" make "calibration-robot.png"."""
    return record.with_name(f"{record.stem}-{ending}")


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
