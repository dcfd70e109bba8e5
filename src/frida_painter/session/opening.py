"""What every session needs before it begins: threads, a device, an easel by its record, paper for strokes."""

from dataclasses import replace
from pathlib import Path

import torch

from frida_painter.calibration import Calibration
from frida_painter.errors import CalibrationError
from frida_painter.frames import CanvasSize
from frida_painter.hardware.easel import Easel
from frida_painter.session.easel_kinds.studio import studio_brush, with_brush
from frida_painter.session.procedures.calibration_status import NEEDED, require
from frida_painter.virtual.studio import open_studio
from frida_painter.virtual.table import PlacementError

PAPER = CanvasSize(0.42, 0.297)


def limit_threads() -> None:
    """One thread for tensors, for this process: they are small, and torch's idle threads spin.

    Measured on two cores, planning with torch's default took twice the time.
    """
    torch.set_num_threads(1)


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
    known = Calibration.load(record)
    require(known, easel.calibration, () if easel.simulated else needed)
    if "brush" not in known.done:
        known = replace(known, brush=easel.calibration.brush)
    return replace(easel, calibration=known)


def open_virtual_easel(brush: str, seed: int) -> Easel:
    """A virtual studio for painting a stroke library: paper, and a calibrated robot that paints where it means to."""
    studio = open_studio(PAPER, studio_brush(brush), seed=seed, placement_error=PlacementError((0.0, 0.0), 0.0))
    studio.easel.robot.connect()
    studio.easel.camera.connect()
    return with_brush(studio.easel, brush)
