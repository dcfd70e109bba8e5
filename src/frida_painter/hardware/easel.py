"""The easel: robot, camera and operator, with all that is known about them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from frida_painter.calibration import Calibration
from frida_painter.canvas_size import CanvasSize
from frida_painter.hardware.robot import Camera, Reach, Robot, Waypoints, Workspace
from frida_painter.hardware.timing import AxisTiming, Timing
from frida_painter.strokes.palette import Palette


class Operator(Protocol):
    """Operator of an easel, who prepares what the robot needs: a person, or the virtual studio itself.

    The methods here do nothing, and leave paper and checker to a person.
    """

    def fill_wells(self, palette: Palette) -> None:
        """Returns when well i holds paint i of the palette."""
        return

    def tone(self, ground: tuple[float, float, float]) -> None:
        """Returns when the bare canvas is toned in that sRGB colour and dry, or at once if nobody can be asked."""
        return

    def change_brush(self, brush: str) -> None:
        """Returns when the clean brush of that name is in the robot's holder, or in the hand of a person who paints."""
        return

    def let_dry(self, seconds: float) -> None:
        """Returns when the paint on the canvas has dried for `seconds` more, at the easel's pace."""
        return

    def lay_paper(self) -> bool:
        """Returns True if a fresh, bare canvas is on the easel now; False if a person must be asked for one."""
        return False

    def lay_checker(self) -> bool:
        """Returns True if the colour checker is in view of the camera now; False if a person must be asked for it."""
        return False

    def take_checker_away(self) -> bool:
        """Returns True if the colour checker is gone; False if a person must be asked to take it away."""
        return False

    def print_canvas(self) -> NDArray[np.uint8] | None:
        """Returns the canvas [rows, columns, 3], sRGB, in more detail than a camera sees; None if only a camera can."""
        return None


@dataclass(frozen=True)
class PersonBrush:
    """Brush that a person may take at a simulated easel.

    light, hard: widths of its marks at the lightest touch and at the hardest press, metres
    """

    name: str
    light: float
    hard: float


@dataclass(frozen=True)
class PersonStroke:
    """Stroke of a person on a simulated canvas.

    number: from 1, over the whole painting; a number is painted once only
    brush, paint: name of the brush, and number of the well from 0
    place [k, 2]: canvas metres
    press [k]: 0 for the lightest touch, 1 for the hardest press
    tilt [k]: angle of the brush from upright, radians in [0, pi/2]
    toward [k]: direction to which the handle leans, radians counter-clockwise from the canvas's x
    seconds: duration
    """

    number: int
    brush: str
    paint: int
    place: NDArray[np.float64]
    press: NDArray[np.float64]
    tilt: NDArray[np.float64]
    toward: NDArray[np.float64]
    seconds: float = 0.0

    def record(self) -> dict[str, Any]:
        """Returns the stroke as plain values: numbers with as many digits as the float has."""
        way = np.c_[self.place, self.press, self.tilt, self.toward]
        about = {name: getattr(self, name) for name in ("number", "brush", "paint", "seconds")}
        return {**about, "way": way.tolist()}

    @classmethod
    def of(cls, record: Mapping[str, Any]) -> Self:
        """Returns the stroke of a record. Raises KeyError and ValueError if it is none."""
        way = np.array(record["way"], np.float64).reshape(-1, 5)
        if not (len(way) and np.isfinite(way).all()):
            raise ValueError("the way of a person's stroke")
        return cls(
            int(record["number"]), str(record["brush"]), int(record["paint"]),
            way[:, :2], way[:, 2], way[:, 3], way[:, 4], float(record["seconds"]),
        )  # fmt: skip


@runtime_checkable
class PersonCanvas(Protocol):
    """Operator of a simulated easel, on whose canvas a person can paint."""

    def paint_stroke(self, stroke: PersonStroke) -> None:
        """Paints a person's stroke, unless one of that number is there already. Raises ConfigError."""


@dataclass(frozen=True)
class Easel:
    """Easel: everything that differs between a virtual and a real painting.

    reach: of the arm of a robot in this process; None if it reaches every point
    timing: limits of the robot; None if unknown, then estimates assume full speed
    simulated: True if no real robot moves
    has_camera: False if nobody looks at the canvas, so that a plan is painted as it is
    pace: real seconds per second of the easel's clock; 0 for as fast as possible
    foretell: receives the next motions in order, for a person who paints by hand and wants to see more than one
        stroke
    person_brushes: brushes with which a person can paint through this program; none on a real easel, on which
        people paint with a real brush. The operator is then a PersonCanvas.
    """

    robot: Robot
    camera: Camera
    operator: Operator
    workspace: Workspace
    calibration: Calibration
    canvas: CanvasSize
    reach: Reach | None = None
    timing: Timing | AxisTiming | None = None
    simulated: bool = False
    has_camera: bool = True
    pace: float = 1.0
    foretell: Callable[[Sequence[Waypoints]], None] = lambda motions: None
    person_brushes: tuple[PersonBrush, ...] = ()

    @property
    def drying_pace(self) -> float:
        """Seconds that people wait while paint dries for a second: 0 if a simulation is as fast as possible."""
        return self.pace if self.simulated else 1.0
