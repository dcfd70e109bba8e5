"""Opening a session: goal, brush, easel and planner are put together here, and nowhere below."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import torch

from frida_painter.brush.kinds import brush_kind
from frida_painter.brush.table_cache import cached_table
from frida_painter.brush.weights import load_stroke_model
from frida_painter.calibration import Calibration
from frida_painter.config import PaintingSettings
from frida_painter.errors import CalibrationError
from frida_painter.frames import CanvasSize
from frida_painter.goal import Goal
from frida_painter.hardware.easel import Easel
from frida_painter.objectives.encoders.registry import EncoderRegistry
from frida_painter.palette import Palette
from frida_painter.perception.flatfield import FlatField
from frida_painter.planning.placement import Placement
from frida_painter.planning.planner import Effort, Planner
from frida_painter.session.brushwork import Brushwork
from frida_painter.session.canvas_observer import CanvasObserver
from frida_painter.session.events import Notify, Paused
from frida_painter.session.journal import Journal
from frida_painter.session.loop import PaintingSession
from frida_painter.session.procedures.calibration_status import NEEDED, require
from frida_painter.session.refilling import refilled
from frida_painter.session.replan_policy import EvenlySpaced
from frida_painter.session.timelapse import Timelapse
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


def open_planner(settings: PaintingSettings, goal: Goal, record: Path | None = None) -> Planner:
    """The planner that the settings describe, with the stroke model of their brush.

    record: the easel's calibration record; what its own strokes taught of that brush goes before what
    the project ships. Raises CalibrationError where it is damaged, and WeightsError and ConfigError
    where there is no such brush, or a network that the goal needs is missing.
    """
    source: str | Path = settings.brush
    if record is not None:
        known = Calibration.load(record)
        if known.weights is not None and known.brush == settings.brush:
            source = Path(known.weights.path)
    model = cached_table(load_stroke_model(source))
    effort = Effort().scaled(settings.effort)
    device = planning_device()
    return Planner(
        goal,
        settings.canvas,
        model,
        rows=settings.render_height,
        effort=effort,
        seed=settings.seed,
        encoders=EncoderRegistry(clip=settings.clip, device=device),
        device=device,
    )


def open_session(
    settings: PaintingSettings,
    planner: Planner,
    easel: Easel,
    *,
    timelapse_frames: int,
    stop_asked: Callable[[], bool],
    notify: Notify,
    journal: Journal,
    go_on: Callable[[Paused], bool] = lambda paused: False,
    pause_asked: Callable[[], bool] = lambda: False,
    light: FlatField | None = None,
    placement: Placement | None = None,
    mixed: Callable[[Palette], Palette | None] = lambda wanted: None,
) -> PaintingSession:
    """A session on an easel whose robot and camera are connected. Raises LibraryError where its library is damaged.

    light, placement: what an earlier sitting learned of the room and of where strokes land; mixed: asked
    what was really mixed.
    """
    kind = refilled(brush_kind(planner.model.brush), easel.calibration, simulated=easel.simulated)
    brushwork = Brushwork(easel, kind, placement or Placement.unknown())
    observer = CanvasObserver(easel, (1.0, 1.0, 1.0), light)
    return PaintingSession(
        planner,
        brushwork,
        observer,
        EvenlySpaced(settings.replans),
        stop_asked=stop_asked,
        notify=notify,
        journal=journal,
        pause_asked=pause_asked,
        go_on=go_on,
        mixed=mixed,
        timelapse=Timelapse(timelapse_frames),
    )


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
    studio = open_studio(PAPER, brush, seed=seed, placement_error=PlacementError((0.0, 0.0), 0.0))
    studio.easel.robot.connect()
    studio.easel.camera.connect()
    return studio.easel
