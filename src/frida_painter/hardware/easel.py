"""The easel: robot, camera and operator, with all that is known about them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from frida_painter.calibration import Calibration
from frida_painter.canvas_size import CanvasSize
from frida_painter.hardware.robot import Camera, Reach, Robot, Timing, Waypoints, Workspace
from frida_painter.palette import Palette


class Operator(Protocol):
    """Operator of an easel, who prepares what the robot needs: a person, or the virtual studio itself."""

    def fill_wells(self, palette: Palette) -> None:
        """Returns when well i holds paint i of the palette."""

    def tone(self, ground: tuple[float, float, float]) -> None:
        """Returns when the bare canvas is toned in that sRGB colour and dry, or at once if nobody can be asked."""

    def change_brush(self, brush: str) -> None:
        """Returns when the clean brush of that name is in the robot's holder, or in the hand of a person who paints."""

    def let_dry(self, seconds: float) -> None:
        """Returns when the paint on the canvas has dried for `seconds` more, at the easel's pace."""

    def lay_paper(self) -> bool:
        """Returns True if a fresh, bare canvas is on the easel now; False if a person must be asked for one."""

    def lay_checker(self) -> bool:
        """Returns True if the colour checker is in view of the camera now; False if a person must be asked for it."""

    def take_checker_away(self) -> bool:
        """Returns True if the colour checker is gone; False if a person must be asked to take it away."""


def _unheard(motions: Sequence[Waypoints]) -> None:
    """Ignores the next motions: a robot need not know them."""


@dataclass(frozen=True)
class Easel:
    """Easel: everything that differs between a virtual and a real painting.

    reach: of the robot's arm; None if it reaches every point of its workspace
    timing: acceleration of the robot; None if unknown, then estimates assume full speed
    simulated: True if no real robot moves
    pace: real seconds per second of the easel's clock; 0 for as fast as possible
    foretell: receives the next motions in order, for a person who paints by hand and wants to see more than one
        stroke
    """

    robot: Robot
    camera: Camera
    operator: Operator
    workspace: Workspace
    calibration: Calibration
    canvas: CanvasSize
    reach: Reach | None = None
    timing: Timing | None = None
    simulated: bool = False
    pace: float = 1.0
    foretell: Callable[[Sequence[Waypoints]], None] = _unheard
