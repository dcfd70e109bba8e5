"""The order of an easel, as it goes to the easel's process, and the facts that come back once it is open."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

from pydantic import ConfigDict, TypeAdapter, ValidationError

from frida_painter.calibration import Calibration
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import ConfigError
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

    def record(self) -> dict[str, Any]:
        """Returns the order as plain values."""
        return TypeAdapter(EaselOrder).dump_python(self, mode="json")

    @classmethod
    def of(cls, record: Mapping[str, Any]) -> Self:
        """Returns an order from plain values. Raises ConfigError if they are invalid."""
        try:
            return TypeAdapter(cls).validate_python(record)
        except ValidationError as error:
            faults = "; ".join(
                f"{'.'.join(map(str, fault['loc']))}: {fault['msg'].lower()}" for fault in error.errors()
            )
            raise ConfigError(f"The order of an easel is not as it must be ({faults}).") from error


@dataclass(frozen=True)
class EaselFacts:
    """Facts about an open easel.

    workspace to pace: as in hardware.easel.Easel
    knows_reach: True if it tells the reach of the robot's arm
    patience, grace: time limit of a motion, see easel.guard.GuardedRobot
    answer: seconds after which a request without motion counts as unanswered
    """

    workspace: Workspace
    calibration: Calibration
    canvas: CanvasSize
    timing: Timing | AxisTiming | None
    simulated: bool
    has_camera: bool
    person_brushes: tuple[PersonBrush, ...]
    pace: float
    knows_reach: bool
    patience: float
    grace: float
    answer: float

    def record(self) -> dict[str, Any]:
        """Returns the facts as plain values."""
        return TypeAdapter(EaselFacts).dump_python(self, mode="json")

    @classmethod
    def of(cls, record: Mapping[str, Any]) -> Self:
        """Returns the facts from plain values."""
        return TypeAdapter(cls).validate_python(record)
