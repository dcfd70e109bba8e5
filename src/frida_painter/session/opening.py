"""Preparation of a session: the planning device, and an easel with its valid calibration record."""

from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import torch

from frida_painter.calibration import PROCEDURES, Calibration, Done
from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.kinds import NO_CAMERA
from frida_painter.errors import CalibrationError, StorageError
from frida_painter.hardware.easel import Easel
from frida_painter.registry import is_installed
from frida_painter.system import storage

# Status of a calibration record: valid procedures, and procedures to repeat.

OLD = 90
"""Days after which doctor advises to repeat a procedure; an old procedure stays valid."""
NEEDED = ("canvas", "robot", "color", "brush")
"""Procedures needed for painting on a real easel. Only training of a stroke model needs the strokes procedure."""
_SAME = 0.0005
_RESTS_ON: dict[str, tuple[str, ...]] = {
    "canvas": (),
    "robot": ("canvas",),
    "color": ("canvas",),
    "brush": (),
    "strokes": ("robot", "color", "brush"),
    "surface": ("brush",),
}


@dataclass(frozen=True)
class ProcedureStatus:
    """Status of one calibration procedure.

    done: time and quality, None if never done.
    fault: reason to repeat it; "" if it is valid or was never done.
    days: its age, None if never done or without a readable date.
    """

    procedure: str
    done: Done | None
    fault: str
    days: int | None

    @property
    def is_old(self) -> bool:
        """True if it may be time to repeat it."""
        return self.days is not None and self.days > OLD


def statuses(record: Calibration, easel: Calibration, now: datetime | None = None) -> tuple[ProcedureStatus, ...]:
    """Returns the status of the five procedures of a record at an easel.

    easel: default record of that easel.
    Raises CalibrationError if the record is of another easel.
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
            fault = _outrun(procedure, done, record, found) or _describe_lost(procedure, record)
        found[procedure] = ProcedureStatus(procedure, done, fault, _days(done, now or datetime.now(UTC)))
    return tuple(found.values())


def require(record: Calibration, easel: Calibration, needed: tuple[str, ...] = NEEDED) -> None:
    """Raises CalibrationError, with the next step, unless the `needed` procedures were done and all are valid."""
    for status in statuses(record, easel):
        if status.fault:
            raise CalibrationError(f"{status.fault}: frida-painter calibrate {status.procedure}")
        if status.done is None and status.procedure in needed:
            raise CalibrationError(
                f"The {status.procedure} calibration was never done here; do it: "
                f"frida-painter calibrate {status.procedure}"
            )


def require_basis(procedure: str, record: Calibration, easel: Calibration, *, defaults_hold: bool) -> None:
    """Raises CalibrationError unless the procedures that a procedure rests on were done and are valid.

    defaults_hold: True if the easel's defaults, such as the heights in its workspace, replace missing measurements.
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
    """Returns all procedures that a procedure rests on, directly or indirectly."""
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
    """Returns True if two sizes are the same within 0.5 mm."""
    if one is None or other is None:
        return one is other
    return abs(one.width - other.width) <= _SAME and abs(one.height - other.height) <= _SAME


def _outrun(procedure: str, done: Done, record: Calibration, found: dict[str, ProcedureStatus]) -> str:
    """Returns a fault if a procedure rests on one that was renewed after it or must be repeated; else ""."""
    for basis in _RESTS_ON[procedure]:
        renewed = record.done.get(basis)
        if renewed is not None and renewed.turn > done.turn:
            return f"The {procedure} calibration is older than the {basis} calibration that it rests on; repeat it"
        if found[basis].fault:
            return f"The {procedure} calibration rests on {basis}, which is to be repeated; repeat it afterwards"
    return ""


def _describe_lost(procedure: str, record: Calibration) -> str:
    for what, file in (("stroke library", record.library), ("weights", record.weights)):
        if procedure == "strokes" and file is not None:
            try:
                same = storage.sha256(Path(file.path), "a file of the record") == file.sha256
            except StorageError:
                same = False
            if not same:
                return f"The {what} {file.path} of the record is gone or was changed; repeat the strokes calibration"
    return ""


def _days(done: Done | None, now: datetime) -> int | None:
    if done is None:
        return None
    try:
        return (now - datetime.fromisoformat(done.dated)).days
    except (ValueError, TypeError):
        return None


def planning_device() -> torch.device:
    """Returns the planning device: the first GPU of PyTorch if Triton can compile for it, else the CPU.

    `CUDA_VISIBLE_DEVICES=` hides the GPU. No other place in the project chooses a device.
    """
    return torch.device("cuda" if torch.cuda.is_available() and is_installed("triton") else "cpu")


def on_record(easel: Easel, record: Path | None, needed: tuple[str, ...] = NEEDED) -> Easel:
    """Returns the easel with its calibration record from a file.

    A simulated easel needs no record, and neither does one without a camera: the workspace tells where its canvas is,
    and the heights of its brush. Of a record, an easel without a camera uses the placement and the brushes.

    needed: procedures that a real easel needs.
    Raises CalibrationError, with the procedure to repeat, if the record is missing, damaged, out of date, or of
    another easel, brush, camera or canvas.
    """
    if record is None:
        if not easel.simulated and easel.has_camera:
            raise CalibrationError(
                f"Easel {easel.calibration.easel!r} has no calibration record, and nothing is painted on a real easel "
                "without one; calibrate it: frida-painter calibrate all"
            )
        return easel
    known = load_record(record, easel.calibration, needed, simulated=easel.simulated)
    if "brush" not in known.done:
        known = replace(known, brush=easel.calibration.brush)
    return replace(easel, calibration=known)


def load_record(
    record: Path, default: Calibration, needed: tuple[str, ...] = (), *, simulated: bool = False
) -> Calibration:
    """Returns the calibration record of a file, with the first brush of `default` in the holder; checks all brushes.

    default: the easel's own record before any procedure.
    simulated: True if brushes that the record does not have are taken from `default`.
    Raises CalibrationError.
    """
    needed = () if simulated else needed
    known = adopt_camera(Calibration.load(record), default)
    if default.brush in known.others:
        known = known.of_brush(default.brush)
    require(known, default, needed)
    for brush, delivered in default.others.items():
        if simulated and brush not in known.others:
            known = replace(known, others={**known.others, brush: delivered})
        require(known.of_brush(brush), default.of_brush(brush), needed)
    return known


def adopt_camera(known: Calibration, default: Calibration) -> Calibration:
    """Returns a record as it is; with the part of `default` that cameras measure if that easel has no camera.

    This part is the place of the canvas in a photograph, and the colours. Placement and brushes stay.
    """
    if default.camera != NO_CAMERA:
        return known
    done = {name: one for name, one in known.done.items() if name not in ("canvas", "color")}
    seen = {
        name: getattr(default, name) for name in ("camera", "canvas", "corners", "photograph", "color", "lens", "bare")
    }
    return replace(known, **seen, done=done)
