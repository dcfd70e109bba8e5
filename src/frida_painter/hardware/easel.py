"""An easel: the robot, the camera and the person beside them, with all that is known about the three."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from frida_painter.calibration import Calibration
from frida_painter.canvas_size import CanvasSize
from frida_painter.hardware.robot import Camera, Reach, Robot, Timing, Waypoints, Workspace
from frida_painter.palette import Palette


class Operator(Protocol):
    """Whoever prepares what is needed: a person at a real easel, the virtual studio for itself."""

    def fill_wells(self, palette: Palette) -> None:
        """Returns when well i holds paint i of the palette."""

    def tone(self, ground: tuple[float, float, float]) -> None:
        """Returns when the bare canvas is toned in that colour (sRGB) and dry, or where nobody can be asked."""

    def change_brush(self, brush: str) -> None:
        """Returns when the brush of that name, clean, is in the robot's holder, or in the hand."""

    def let_dry(self, seconds: float) -> None:
        """The paint on the canvas has dried for so many seconds more, which were waited for at the easel's pace."""

    def lay_paper(self) -> bool:
        """Whether a fresh, bare canvas lies on the easel now; False where a person is to be asked for one."""

    def lay_checker(self) -> bool:
        """Whether the colour checker lies in the camera's sight now; False where a person is to be asked for it."""

    def take_checker_away(self) -> bool:
        """Whether the colour checker is gone again; False where a person is to be asked to take it away."""


def _unheard(motions: Sequence[Waypoints]) -> None:
    """A robot need not know what comes next."""


@dataclass(frozen=True)
class Easel:
    """Everything that differs between a virtual and a real painting.

    reach: where the robot's arm gets, None where it gets everywhere in its workspace; timing: how it
    starts and stops, None where it is not known and its full speed is reckoned with; simulated: no real
    robot is moved; pace: seconds that a second of its clock takes, 0 where it is as fast as can be computed;
    foretell: hears what the robot will be sent next, in that order, for a person who paints by hand and wants
    to see more than one stroke.
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
