"""Calibration of an easel: the easel to calibrate, its procedures, and the renewed record."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from platformdirs import user_data_path

from frida_painter.brush import DEFAULT_MODEL
from frida_painter.brush.kinds import BrushKind
from frida_painter.calibration import OF_A_BRUSH, Calibration, LearnedFile
from frida_painter.easel.dialogue import Procedure
from frida_painter.easel.kinds import VIRTUAL
from frida_painter.easel.parent import EaselProcess
from frida_painter.easel.virtual_easel import studio_brush, with_brush
from frida_painter.errors import CalibrationError
from frida_painter.hardware.easel import Easel
from frida_painter.runs.painting_easel import order
from frida_painter.runs.spec import RunSpec
from frida_painter.virtual.studio import open_studio
from frida_painter_calibration.procedures.brush import brush as brush_procedure
from frida_painter_calibration.procedures.canvas import canvas as canvas_procedure
from frida_painter_calibration.procedures.color import color as color_procedure
from frida_painter_calibration.procedures.robot import robot as robot_procedure
from frida_painter_calibration.procedures.strokes import StrokesFinding, StrokesProgress
from frida_painter_calibration.procedures.strokes import strokes as strokes_procedure
from frida_painter_calibration.procedures.surface import POINTS
from frida_painter_calibration.procedures.surface import surface as surface_procedure
from frida_painter_calibration.teaching.evaluation import learn
from frida_painter_calibration.teaching.training import TrainingProgress


@contextmanager
def easel_of(spec: RunSpec, folder: Path | None = None, state: Path | None = None) -> Iterator[Easel]:
    """Opens the easel of a description in its own process; robot and camera are not connected.

    A virtual studio without a `folder` for its log needs no process.
    state: folder for latched stops.
    Raises ConfigError, RobotStopped and RobotBusy.
    """
    (brush,) = spec.brush_names
    wanted = order(spec, (brush,), folder, state)
    if spec.robot == VIRTUAL and folder is None:
        studio = open_studio(spec.canvas, studio_brush(brush), seed=spec.seed, placement_error=wanted.placement_error)
        yield with_brush(studio.easel, brush)
        return
    with EaselProcess() as process:
        yield process.open(wanted)


def default_record(easel: str) -> Path:
    """Returns the default file of an easel's calibration record."""
    folder = "-".join(easel.split())
    return user_data_path("frida-painter", appauthor=False) / "easels" / folder / "calibration.json"


@dataclass(frozen=True)
class CalibrationSetup:
    """Inputs of a calibration procedure.

    easel: easel with the record so far.
    record: file of the record; files of the procedures are beside it.
    say: receives the progress in words.
    """

    easel: Easel
    brush: BrushKind
    record: Path
    seed: int
    count: int
    say: Callable[[str], None]
    refill_every: int = 1
    points: int = POINTS

    def beside(self, name: str, ending: str) -> Path:
        """Returns the file of a procedure beside the record; its name holds the brush if the procedure concerns one."""
        of = f"-{self.brush.name}" if name in OF_A_BRUSH else ""
        return self.record.with_name(f"{self.record.stem}-{name}{of}.{ending}")


def begin_procedure(name: str, setup: CalibrationSetup) -> Procedure[Any]:
    """Begins the procedure of that name with this setup."""

    def hear(progress: StrokesProgress) -> None:
        setup.say(f"strokes: {progress.done} of {progress.of}, paper {progress.sheet}")

    match name:
        case "canvas":
            return canvas_procedure(setup.easel)
        case "robot":
            return robot_procedure(setup.easel)
        case "color":
            return color_procedure(setup.easel)
        case "surface":
            return surface_procedure(setup.easel, points=setup.points)
        case "brush":
            return brush_procedure(setup.easel, name=setup.brush.name)
        case _:
            library = setup.beside("strokes", "npz")
            return strokes_procedure(
                setup.easel,
                setup.brush,
                library,
                count=setup.count,
                seed=setup.seed,
                refill_every=setup.refill_every,
                notify=hear,
            )


def learn_from(finding: StrokesFinding, setup: CalibrationSetup, record: Calibration) -> Calibration:
    """Trains a stroke model on the strokes and returns the record with it; `paint --calibration` then plans with it.

    Raises LibraryError if fewer than 5 strokes are clean.
    """

    def hear(progress: TrainingProgress) -> None:
        setup.say(f"strokes: learning from them, {progress.epoch} of {progress.epochs}")

    learned = learn(DEFAULT_MODEL, finding.library, setup.brush, seed=setup.seed, notify=hear)
    path = setup.beside("strokes", "safetensors")
    weights = LearnedFile(str(path), learned.model.save(path))
    assert record.library is not None  # set by the finding before
    return record.with_strokes(record.library, weights, residual=learned.report.validation_error)


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
