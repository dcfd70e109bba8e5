"""What every session needs before it begins: threads, memory, a device, an easel by its record, paper for strokes."""

import ctypes
import sys
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
_KEPT, _LARGEST = 512 * 2**20, 32 * 2**20  # bytes that are kept, and of a block that is; mallopt allows no larger one
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD, _M_ARENA_MAX = -1, -3, -8  # malloc.h


def prepare_process() -> None:
    """Has this process compute on one thread, and keep up to half a gigabyte of memory that it frees.

    Tensors are small, and torch's idle threads spin: on two cores, planning with torch's default took twice the time.
    An iteration of the planner frees and takes blocks of some MB, which glibc may hand back each time, for
    some 2,000 page faults; C libraries that cannot be told otherwise are left as they are. All threads take from one
    arena: of several, each would keep as much for itself.
    """
    torch.set_num_threads(1)
    if sys.platform == "linux" and hasattr(library := ctypes.CDLL(None), "mallopt"):  # musl has none
        library.mallopt(_M_MMAP_THRESHOLD, _LARGEST)
        library.mallopt(_M_TRIM_THRESHOLD, _KEPT)
        library.mallopt(_M_ARENA_MAX, 1)


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
