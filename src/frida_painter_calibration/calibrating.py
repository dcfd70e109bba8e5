"""Calibration of an easel: the easel to calibrate, its procedures, and the renewed record."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

from platformdirs import user_data_path

from frida_painter.brush import DEFAULT_MODEL
from frida_painter.brush.kinds import BrushKind
from frida_painter.calibration import OF_A_BRUSH, Calibration, LearnedFile
from frida_painter.easel.dialogue import Answer, Finding, Procedure, Question, lead
from frida_painter.easel.kinds import VIRTUAL
from frida_painter.easel.parent import EaselProcess
from frida_painter.easel.virtual_easel import studio_brush, with_brush
from frida_painter.errors import CalibrationError
from frida_painter.hardware.easel import Easel
from frida_painter.runs.painting_easel import order
from frida_painter.runs.spec import RunSpec
from frida_painter.session.opening import require_basis
from frida_painter.system import images, storage
from frida_painter.virtual.studio import open_studio
from frida_painter_calibration.options import SurfaceOptions
from frida_painter_calibration.procedures.brush import brush
from frida_painter_calibration.procedures.canvas import canvas
from frida_painter_calibration.procedures.color import color
from frida_painter_calibration.procedures.robot import robot
from frida_painter_calibration.procedures.strokes import contact_sheet, strokes
from frida_painter_calibration.procedures.surface import read_surface, surface
from frida_painter_calibration.procedures.surface_marks import surface_by_marks, surface_in_picture
from frida_painter_calibration.teaching.evaluation import learn


@contextmanager
def easel_of(spec: RunSpec, folder: Path | None = None, state: Path | None = None) -> Iterator[Easel]:
    """Opens the easel of a description in its own process; robot and camera are not connected.

    A virtual studio without a `folder` for its log needs no process.
    state: folder for latched stops.
    Raises ConfigError, RobotStopped and RobotBusy.
    """
    (brush,) = spec.brush_names
    wanted = order(spec, (brush,), folder, state)
    error = wanted.simulation.placement_error
    if spec.robot == VIRTUAL and folder is None:
        studio = open_studio(spec.canvas, studio_brush(brush), seed=spec.seed, placement_error=error)
        yield with_brush(studio.easel, brush)
        return
    with EaselProcess() as process:
        yield process.open(wanted)


def default_record(easel: str) -> Path:
    """Returns the default file of an easel's calibration record."""
    folder = storage.file_name("-".join(easel.split()))
    return user_data_path("frida-painter", appauthor=False) / "easels" / folder / "calibration.json"


def record_to_renew(path: Path, default: Calibration, *, anew: bool) -> Calibration:
    """Returns the record to continue: that of the file, or the easel's default if there is none.

    The brush of `default` is in the holder, if the record has it; the data of other brushes stay.
    anew: True if all procedures are to be done again.
    Raises CalibrationError if the file is damaged, unless all is done anew.
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
        return known.start_anew(default)
    return known.of_brush(default.brush) if default.brush in known.others else known


@dataclass(frozen=True)
class CalibrationSetup:
    """Inputs of the calibration procedures.

    easel: easel with its default record
    record: file of the record; files of the procedures are beside it
    say: receives the progress in words
    count, refill_every: of the strokes procedure
    """

    easel: Easel
    brush: BrushKind
    record: Path
    seed: int
    count: int
    say: Callable[[str], None]
    refill_every: int = 1
    surface: SurfaceOptions = field(default_factory=SurfaceOptions)

    def beside(self, name: str, ending: str) -> Path:
        """Returns the file of a procedure beside the record; its name holds the brush if the procedure concerns one."""
        of = f"-{self.brush.name}" if name in OF_A_BRUSH else ""
        return self.record.with_name(f"{self.record.stem}-{name}{of}.{ending}")


def calibrate_one(
    name: str, setup: CalibrationSetup, known: Calibration, answer: Callable[[Question], Answer]
) -> tuple[Finding, Calibration]:
    """Leads the procedure of that name, and returns its finding and the record with it, which is saved at once.

    known: the record so far
    Raises CalibrationError if a procedure that it rests on does not hold, and the errors of the procedure.
    """
    here = setup.easel
    require_basis(name, known, here.calibration, defaults_hold=here.simulated or not here.has_camera)
    finding = lead(_begin(name, setup, replace(here, calibration=known)), answer)
    known = finding.enter(known)
    known.save(setup.record)
    if finding.picture is not None:
        images.save(finding.picture, setup.beside(name, "png"))
    return finding, known


def _begin(name: str, setup: CalibrationSetup, easel: Easel) -> Procedure[Finding]:
    of = setup.surface
    match name:
        case "canvas":
            return (yield from canvas(easel))
        case "robot":
            return (yield from robot(easel))
        case "color":
            return (yield from color(easel))
        case "brush":
            return (yield from brush(easel, name=setup.brush.name))
        case "surface" if of.heights is not None:
            return read_surface(of.heights, easel)
        case "surface" if of.picture is not None:
            photograph = images.to_uint8(images.load(of.picture))
            return (yield from surface_in_picture(photograph, easel, setup.brush, points=of.points))
        case "surface" if of.marks:
            return (yield from surface_by_marks(easel, setup.brush, points=of.points))
        case "surface":
            return (yield from surface(easel, points=of.points))
        case _:
            return (yield from _learn_strokes(easel, setup))


def _learn_strokes(easel: Easel, setup: CalibrationSetup) -> Procedure[Finding]:
    """Records strokes, and trains a stroke model on them, with which `paint --calibration` then plans.

    Raises LibraryError if fewer than 5 strokes are clean.
    """
    out, path, kind = setup.beside("strokes", "npz"), setup.beside("strokes", "safetensors"), setup.brush
    recorded = yield from strokes(
        easel,
        kind,
        out,
        count=setup.count,
        seed=setup.seed,
        refill_every=setup.refill_every,
        notify=lambda done: setup.say(f"strokes: {done.done} of {done.of}, paper {done.sheet}"),
    )
    learned = learn(
        DEFAULT_MODEL,
        recorded.library,
        kind,
        seed=setup.seed,
        notify=lambda done: setup.say(f"strokes: learning from them, {done.epoch} of {done.epochs}"),
    )
    library, weights = recorded.file, LearnedFile(str(path), learned.model.save(path))
    assert library is not None
    return Finding(
        recorded.sentence,
        contact_sheet(recorded.library, f"Strokes of the {kind.name} brush"),
        lambda record: record.with_strokes(library, weights, residual=learned.report.validation_error),
    )
