"""What a session needs before it begins: a device to plan on, and an easel with its calibration record."""

from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import torch

from frida_painter import storage
from frida_painter.calibration import PROCEDURES, Calibration, Done, LearnedFile
from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.studio import studio_brush, with_brush
from frida_painter.errors import CalibrationError, StorageError
from frida_painter.hardware.easel import Easel
from frida_painter.virtual.studio import open_studio
from frida_painter.virtual.table import PlacementError

# How a calibration record stands: which of its procedures hold at this easel, and which are to be repeated.

OLD = 90
"""Days after which doctor advises to repeat a procedure; nothing is refused for it."""
NEEDED = ("canvas", "robot", "color", "brush")
"""What painting on a real easel needs. The strokes are needed by whoever trains a stroke model of them."""
_SAME = 0.0005
_RESTS_ON: dict[str, tuple[str, ...]] = {
    "canvas": (),
    "robot": ("canvas",),
    "color": ("canvas",),
    "brush": (),
    "strokes": ("robot", "color", "brush"),
}


@dataclass(frozen=True)
class ProcedureStatus:
    """The status of one calibration procedure.

    done: when and how well, None where never; fault: why it is to be repeated, "" where it holds or
    was never done; days: how old it is, None where never done or its date cannot be read.
    """

    procedure: str
    done: Done | None
    fault: str
    days: int | None

    @property
    def is_old(self) -> bool:
        """Whether it may be time to repeat it."""
        return self.days is not None and self.days > OLD


def statuses(record: Calibration, easel: Calibration, now: datetime | None = None) -> tuple[ProcedureStatus, ...]:
    """How the five procedures of a record stand at an easel, of which `easel` is the default record.

    Raises CalibrationError where the record is of another easel altogether.
    """
    if record.easel != easel.easel:
        raise CalibrationError(
            f"The calibration record is of easel {record.easel!r}, and this is {easel.easel!r}; give the record of "
            "this easel, or calibrate it: frida-painter calibrate all"
        )
    found: dict[str, ProcedureStatus] = {}
    for procedure in PROCEDURES:
        done = record.done.get(procedure)
        fault = _foreign(procedure, record, easel)
        if not fault and done is not None:
            fault = _outrun(procedure, done, record, found) or _lost(procedure, record)
        found[procedure] = ProcedureStatus(procedure, done, fault, _days(done, now or datetime.now(UTC)))
    return tuple(found.values())


def require(record: Calibration, easel: Calibration, needed: tuple[str, ...] = NEEDED) -> None:
    """Raises CalibrationError, saying what to do first, unless the `needed` procedures were done and all hold."""
    for status in statuses(record, easel):
        if status.fault:
            raise CalibrationError(f"{status.fault}: frida-painter calibrate {status.procedure}")
        if status.done is None and status.procedure in needed:
            raise CalibrationError(
                f"The {status.procedure} calibration was never done here; do it: "
                f"frida-painter calibrate {status.procedure}"
            )


def require_basis(procedure: str, record: Calibration, easel: Calibration, *, defaults_hold: bool) -> None:
    """Raises CalibrationError unless what a procedure rests on was done and holds.

    defaults_hold: whether the easel's defaults serve where nothing was measured.
    """
    for status in statuses(record, easel):
        if status.procedure in _all_below(procedure):
            if status.fault:
                raise CalibrationError(f"{status.fault} before {procedure}: frida-painter calibrate {status.procedure}")
            if status.done is None and not defaults_hold:
                raise CalibrationError(
                    f"{procedure.capitalize()} rests on {status.procedure}, which was never done here; do it first: "
                    f"frida-painter calibrate {status.procedure}"
                )


def _all_below(procedure: str) -> set[str]:
    """What a procedure rests on, and what that rests on."""
    below = set(_RESTS_ON[procedure])
    return below.union(*(_all_below(basis) for basis in below))


def _foreign(procedure: str, record: Calibration, easel: Calibration) -> str:
    if procedure == "canvas" and record.camera != easel.camera:
        return f"The record is of camera {record.camera!r}, and this is {easel.camera!r}; repeat the canvas calibration"
    if procedure == "canvas" and not _alike(record.canvas, easel.canvas):
        return (
            f"The record is for a canvas of {record.canvas}, and this is {easel.canvas}; repeat the canvas calibration"
        )
    if procedure == "brush" and record.brush != easel.brush:
        return f"The record is of the {record.brush} brush, and this is {easel.brush}; repeat the brush calibration"
    return ""


def _alike(one: CanvasSize | None, other: CanvasSize | None) -> bool:
    """Whether two sizes are the same, but for how they were written."""
    if one is None or other is None:
        return one is other
    return abs(one.width - other.width) <= _SAME and abs(one.height - other.height) <= _SAME


def _outrun(procedure: str, done: Done, record: Calibration, found: dict[str, ProcedureStatus]) -> str:
    """Whether something that a procedure rests on was renewed after it, or is itself to be repeated."""
    for basis in _RESTS_ON[procedure]:
        renewed = record.done.get(basis)
        if renewed is not None and renewed.turn > done.turn:
            return f"The {procedure} calibration is older than the {basis} calibration that it rests on; repeat it"
        if found[basis].fault:
            return f"The {procedure} calibration rests on {basis}, which is to be repeated; repeat it afterwards"
    return ""


def _lost(procedure: str, record: Calibration) -> str:
    if procedure != "strokes":
        return ""
    for what, file in (("stroke library", record.library), ("weights", record.weights)):
        if file is not None and not _is_there(file):
            return f"The {what} {file.path} of the record is gone or was changed; repeat the strokes calibration"
    return ""


def _is_there(file: LearnedFile) -> bool:
    try:
        return storage.sha256(Path(file.path), "a file of the record") == file.sha256
    except StorageError:
        return False


def _days(done: Done | None, now: datetime) -> int | None:
    if done is None:
        return None
    try:
        return (now - datetime.fromisoformat(done.dated)).days
    except (ValueError, TypeError):
        return None


PAPER = CanvasSize(0.42, 0.297)


def planning_device() -> torch.device:
    """Where is planned: on the GPU that PyTorch sees first, if any (`CUDA_VISIBLE_DEVICES=` hides it), else on the CPU.

    No other place in the project chooses a device.
    """
    return torch.device("cuda" if torch.cuda.is_available() else "cpu")


def on_record(easel: Easel, record: Path | None, needed: tuple[str, ...] = NEEDED) -> Easel:
    """The easel with its calibration record from a file; without one only a simulated one is painted on.

    needed: the procedures that a real one needs. Raises CalibrationError, saying which procedure to
    repeat, where the record is damaged, of another easel, brush, camera or canvas, out of date, or
    missing.
    """
    if record is None:
        if not easel.simulated:
            raise CalibrationError(
                f"Easel {easel.calibration.easel!r} has no calibration record, and nothing is painted on a real easel "
                "without one; calibrate it: frida-painter calibrate all"
            )
        return easel
    known = loaded_record(record, easel.calibration, needed, simulated=easel.simulated)
    if "brush" not in known.done:
        known = replace(known, brush=easel.calibration.brush)
    return replace(easel, calibration=known)


def loaded_record(
    record: Path, default: Calibration, needed: tuple[str, ...] = (), *, simulated: bool = False
) -> Calibration:
    """The calibration record of a file, the first brush of `default` in the holder; all of its brushes are checked.

    default: the easel's own record, before any procedure; simulated: whether its brushes are as they are delivered
    where the record does not know them. Raises CalibrationError.
    """
    needed = () if simulated else needed
    known = Calibration.load(record)
    if default.brush in known.others:
        known = known.of_brush(default.brush)
    require(known, default, needed)
    for brush, delivered in default.others.items():
        if simulated and brush not in known.others:
            known = replace(known, others={**known.others, brush: delivered})
        require(known.of_brush(brush), default.of_brush(brush), needed)
    return known


def open_virtual_easel(brush: str, seed: int) -> Easel:
    """A virtual studio for painting a stroke library: paper, and a calibrated robot that paints where it means to."""
    studio = open_studio(PAPER, studio_brush(brush), seed=seed, placement_error=PlacementError((0.0, 0.0), 0.0))
    studio.easel.robot.connect()
    studio.easel.camera.connect()
    return with_brush(studio.easel, brush)
