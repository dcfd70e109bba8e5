"""The order of an easel, as it goes to the easel's process, and the facts that come back once it is open."""

from dataclasses import dataclass, field, fields
from pathlib import Path

from pydantic import ConfigDict

from frida_painter.calibration import Calibration
from frida_painter.canvas_size import CanvasSize
from frida_painter.hardware.easel import PersonBrush
from frida_painter.hardware.faults import NO_FAULTS, Faults, PlacementError
from frida_painter.hardware.robot import Workspace
from frida_painter.hardware.timing import AxisTiming, Timing


@dataclass(frozen=True)
class EaselOrder:
    """Order of an easel: all that its process must know, as plain values.

    robot: name of a whole easel or of a real robot
    canvas, seed: from the painting's settings
    brushes: of the painting; the first is in the holder
    state: folder of latches and locks
    folder: of the painting, for the stop file and a virtual studio's diary
    pace, placement_error, faults: of a virtual studio
    canvas_picture: file with the first content of a virtual studio's canvas; None if it is bare
    workspace: file of a real easel
    camera: name of a real easel's camera
    film: True if a simulated arm is filmed at work, into `folder`
    """

    __pydantic_config__ = ConfigDict(extra="forbid", allow_inf_nan=False)

    robot: str
    canvas: CanvasSize
    brushes: tuple[str, ...]
    seed: int
    state: Path
    folder: Path | None = None
    pace: float = 0.0
    placement_error: PlacementError | None = None
    faults: Faults = field(default=NO_FAULTS)
    canvas_picture: Path | None = None
    workspace: Path | None = None
    camera: str = ""
    film: bool = False


@dataclass(frozen=True)
class EaselFacts:
    """Facts about an open easel, as in hardware.easel.Easel."""

    workspace: Workspace
    calibration: Calibration
    canvas: CanvasSize
    timing: Timing | AxisTiming | None
    simulated: bool
    has_camera: bool
    person_brushes: tuple[PersonBrush, ...]
    pace: float


FACTS = tuple(fact.name for fact in fields(EaselFacts))
