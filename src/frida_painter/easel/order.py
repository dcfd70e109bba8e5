"""The order of an easel, as it goes to the easel's process, and the facts that come back once it is open."""

from dataclasses import dataclass, fields
from pathlib import Path

from pydantic import ConfigDict

from frida_painter.calibration import Calibration
from frida_painter.canvas_size import CanvasSize
from frida_painter.hardware.easel import PersonBrush
from frida_painter.hardware.faults import NO_FAULTS, Faults, PlacementError
from frida_painter.hardware.robot import Workspace
from frida_painter.hardware.timing import AxisTiming, Timing


@dataclass(frozen=True)
class SimulationOrder:
    """Part of an order that concerns a simulated easel alone.

    seed: of the painting
    pace: real seconds per simulated second; 0 for as fast as possible
    placement_error: None for one by chance
    canvas_picture: file with the first content of the canvas; None if it is bare
    film: True if the arm is filmed at work, into the painting's folder
    """

    __pydantic_config__ = ConfigDict(extra="forbid", allow_inf_nan=False)

    seed: int = 0
    pace: float = 0.0
    placement_error: PlacementError | None = None
    faults: Faults = NO_FAULTS
    canvas_picture: Path | None = None
    film: bool = False


@dataclass(frozen=True)
class EaselOrder:
    """Order of an easel: all that its process must know, as plain values.

    robot: name of a whole easel or of a real robot
    brushes: of the painting; the first is in the holder
    state: folder of latches and locks
    folder: of the painting, for the stop file and a virtual studio's diary
    workspace: file of a real easel
    camera: name of a real easel's camera
    """

    __pydantic_config__ = ConfigDict(extra="forbid", allow_inf_nan=False)

    robot: str
    canvas: CanvasSize
    brushes: tuple[str, ...]
    state: Path
    folder: Path | None = None
    workspace: Path | None = None
    camera: str = ""
    simulation: SimulationOrder = SimulationOrder()


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
