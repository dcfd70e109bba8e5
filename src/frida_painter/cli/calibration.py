"""What `calibrate` does: procedures are led at an easel, and what they find is entered into its record."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from platformdirs import user_data_path
from rich.console import Console

from frida_painter import images
from frida_painter.brush.kinds import BrushKind
from frida_painter.brush.learn import learn
from frida_painter.brush.limits import DEFAULT_MODEL
from frida_painter.brush.training import TrainingProgress
from frida_painter.calibration import Calibration, LearnedFile
from frida_painter.cli.real import VIRTUAL, Site
from frida_painter.cli.terminal import Terminal
from frida_painter.errors import CalibrationError
from frida_painter.frames import CanvasSize
from frida_painter.hardware.easel import Easel
from frida_painter.session.easel_process import EaselProcess
from frida_painter.session.easels import EaselOrder
from frida_painter.session.procedures.brush import brush as brush_procedure
from frida_painter.session.procedures.calibration_status import require_basis
from frida_painter.session.procedures.canvas import canvas as canvas_procedure
from frida_painter.session.procedures.color import color as color_procedure
from frida_painter.session.procedures.dialogue import Answer, Procedure, Question, lead
from frida_painter.session.procedures.finding import Finding
from frida_painter.session.procedures.robot import robot as robot_procedure
from frida_painter.session.procedures.strokes import StrokesFinding, StrokesProgress
from frida_painter.session.procedures.strokes import strokes as strokes_procedure
from frida_painter.session.state_folder import state_folder
from frida_painter.virtual.studio import open_studio
from frida_painter.virtual.table import PlacementError


def lead_all(names: Sequence[str], begun: "Place", *, anew: bool, ask: bool) -> None:
    """Does the procedures of these names, and enters each into the record as soon as it is done.

    anew: all that was known is done again; ask: a person answers, else the virtual studio agrees to what is proposed.
    """
    here, path = begun.easel, begun.record
    known = record_to_renew(path, here.calibration, anew=anew)
    console = Console(stderr=True, highlight=False)
    terminal = Terminal(
        lambda prompt: console.input(prompt, markup=False), lambda line: console.print(line, markup=False), path.parent
    )
    answer = terminal.answer if ask else _proposal
    try:
        here.robot.connect()
        here.camera.connect()
        for name in names:
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


@contextmanager
def easel_at(site: Site, canvas: str | None, brush: str, seed: int, error: PlacementError | None) -> Iterator[Easel]:
    """The easel there, neither robot nor camera connected; a real one in a process of its own."""
    size = CanvasSize.parse(site.canvas(canvas) or "14x11in")
    if site == VIRTUAL:
        yield open_studio(size, brush, seed=seed, placement_error=error).easel
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
