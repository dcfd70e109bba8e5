"""Easel of a run and its calibration: selection of the easel, the procedures, and the renewed record."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from platformdirs import user_data_path

from frida_painter.brush import DEFAULT_MODEL
from frida_painter.brush.evaluation import learn
from frida_painter.brush.kinds import BrushKind
from frida_painter.brush.training import TrainingProgress
from frida_painter.calibration import OF_A_BRUSH, Calibration, LearnedFile
from frida_painter.easel.dialogue import Answer, Procedure, Question
from frida_painter.easel.kinds import VIRTUAL, easel_kind, state_folder
from frida_painter.easel.operator import PersonAsOperator
from frida_painter.easel.order import EaselOrder
from frida_painter.easel.parent import EaselProcess
from frida_painter.easel.virtual_easel import studio_brush, with_brush
from frida_painter.errors import CalibrationError, ConfigError
from frida_painter.hardware.easel import Easel
from frida_painter.procedures.brush import brush as brush_procedure
from frida_painter.procedures.canvas import canvas as canvas_procedure
from frida_painter.procedures.color import color as color_procedure
from frida_painter.procedures.robot import robot as robot_procedure
from frida_painter.procedures.strokes import StrokesFinding, StrokesProgress
from frida_painter.procedures.strokes import strokes as strokes_procedure
from frida_painter.procedures.surface import POINTS
from frida_painter.procedures.surface import surface as surface_procedure
from frida_painter.runs.fields import millimetres_and_degrees
from frida_painter.runs.spec import RunSpec
from frida_painter.session.human import ByHand
from frida_painter.session.opening import NEEDED
from frida_painter.virtual.studio import open_studio
from frida_painter.virtual.tabletop import PlacementError

# Easel of a run: the one that its description names, and the person beside it.


def order(spec: RunSpec, brushes: Sequence[str], folder: Path | None, state: Path | None = None) -> EaselOrder:
    """Returns the order for the easel of a description, for a painting in `folder`.

    brushes: brush names; the first brush is in the holder.
    state: folder for latched stops and robot locks. None: one default place for all.
    Raises ConfigError if the folder of --arm-meshes holds no arm.
    """
    error = millimetres_and_degrees(spec.placement_error)
    kind = easel_kind(spec.robot)
    ordered = EaselOrder(
        robot=spec.robot,
        canvas=spec.canvas,
        brushes=tuple(brushes),
        seed=spec.seed,
        state=state or state_folder(),
        folder=None if folder is None else folder.absolute(),
        pace=spec.pace if spec.simulated else 0.0,
        placement_error=None if error is None else PlacementError(error[:2], error[2]),
        workspace=None if spec.workspace is None else spec.workspace.absolute(),
        camera=spec.camera,
        film=spec.films_arm,
        canvas_picture=None if spec.studio_canvas is None else spec.studio_canvas.absolute(),
        meshes=None if spec.arm_meshes is None else spec.arm_meshes.absolute(),
    )
    if kind is not None and kind.require is not None:
        kind.require(ordered)
    return ordered


def needed_calibrations(spec: RunSpec) -> tuple[str, ...]:
    """Returns the calibration procedures that painting needs.

    Painting by hand needs only the canvas procedure. Without a camera, none is needed: the workspace tells where the
    canvas is, and the heights of the lightest touch and the hardest press.
    """
    if not spec.has_camera:
        return ()
    return ("canvas",) if spec.by_hand else NEEDED


def require_sensible(spec: RunSpec) -> None:
    """Raises ConfigError if options for a real easel are given for a simulated one, or the other way round.

    It is only for new paintings; a resumed one may have been begun with unnecessary options.
    """
    if spec.simulated:
        said: dict[str, object] = {"--camera": spec.has_camera and spec.camera, "--workspace": spec.workspace}
        whose, is_a = "real", "simulated"
        if spec.on_canvas and spec.studio_canvas is None:
            raise ConfigError(
                "--on-canvas was given, and the canvas of the virtual studio is bare; leave it out, or give a picture "
                "of what is on the canvas: --studio-canvas FILE"
            )
    else:
        said = {
            "--pace": spec.pace,
            "--placement-error": spec.placement_error,
            "--studio-canvas": spec.studio_canvas,
        }
        whose, is_a = "simulated", "real"
    named = [option for option, value in said.items() if value]
    them = "it" if len(named) == 1 else "them"
    if named:
        raise ConfigError(
            f"{' and '.join(named)} {'is' if len(named) == 1 else 'are'} for {whose} robots, and --robot "
            f"{spec.robot[:60]} is a {is_a} one; leave {them} out, or name another robot."
        )


def with_operator(easel: Easel, spec: RunSpec, answer: Callable[[Question], Answer] | None) -> Easel:
    """Returns a real easel with its person, as operator or as painter, who answers questions.

    A simulated one unchanged.
    """
    if easel.simulated or answer is None:
        return easel
    if not spec.by_hand:
        return replace(easel, operator=PersonAsOperator(answer))
    hand = ByHand(easel, answer)
    return replace(easel, robot=hand, camera=hand.camera, operator=hand, foretell=hand.foretell)


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
