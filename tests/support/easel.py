"""An easel without any paint: a robot that notes its motions, a camera that hands out what it is told to."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from frida_painter.calibration import Calibration
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import StaleFrame
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.robot import Frame, MotionReport, Waypoints, Workspace
from frida_painter.strokes.palette import Palette

CANVAS = CanvasSize(0.12, 0.09)
WORKSPACE = Workspace(
    lower=(-0.3, -0.3, 0.05),
    upper=(0.5, 0.5, 0.4),
    canvas_origin=(0.1, 0.05, 0.1),
    canvas_angle=0.3,
    wells=tuple((-0.1, 0.05 * well, 0.1) for well in range(4)),
    water=(-0.2, 0.0, 0.1),
    rag=(-0.2, 0.2, 0.1),
    rag_width=0.08,
    hover=0.03,
    painting_speed=0.06,
    travel_speed=0.25,
)
CALIBRATION = Calibration(
    easel="stub",
    brush="small",
    corners=((0.0, 0.0), (119.0, 0.0), (119.0, 89.0), (0.0, 89.0)),
    photograph=(90, 120),
    touch_height=0.1,
    press_height=0.09,
)


@dataclass
class NotingRobot:
    """Does what it is told, one second a motion; ends `astray` metres away from where it was sent."""

    astray: float = 0.0
    now: float = 0.0
    motions: list[Waypoints] = field(default_factory=list)

    def connect(self) -> None: ...

    def close(self) -> None: ...

    def stop(self) -> None: ...

    def pose(self) -> NDArray[np.float64]:
        return self.motions[-1].position[-1]

    def home(self) -> MotionReport:
        return self.follow(Waypoints("home", np.array([[0.0, 0.0, 0.3]]), 0.1))

    def follow(self, waypoints: Waypoints) -> MotionReport:
        self.motions.append(waypoints)
        started, self.now = self.now, self.now + 1
        reached = waypoints.position[-1] + (self.astray, 0, 0)
        return MotionReport(waypoints.label, started, self.now, reached)

    def labels(self) -> list[str]:
        """Of all motions but the ways through the air before and after a stroke."""
        return [motion.label for motion in self.motions if not motion.label.startswith(("above ", "up from "))]


@dataclass
class PatientCamera:
    """Photographs a white canvas half a second after the moment asked for; `script` says what to do instead.

    Of the script, each photograph takes the next entry: (captured_at, sequence), or "raise". noisy: no two are alike
    to the byte, as of a real camera.
    """

    script: list[tuple[float, int] | str] = field(default_factory=list)
    asked: list[float] = field(default_factory=list)
    noisy: bool = False

    def connect(self) -> None: ...

    def close(self) -> None: ...

    def capture(self, newer_than: float) -> Frame:
        self.asked.append(newer_than)
        captured_at, sequence = newer_than + 0.5, len(self.asked)
        if self.script:
            entry = self.script.pop(0)
            if isinstance(entry, str):
                raise StaleFrame("an old one")
            captured_at, sequence = entry
        image = np.full((90, 120, 3), 240, np.uint8)
        if self.noisy:
            image[0, 0] = len(self.asked) % 256
        return Frame(image, captured_at, sequence)


@dataclass
class NotingAttendant:
    palettes: list[Palette] = field(default_factory=list)
    dried: list[float] = field(default_factory=list)
    toned: list[tuple[float, float, float]] = field(default_factory=list)
    brushes: list[str] = field(default_factory=list)

    def fill_wells(self, palette: Palette) -> None:
        self.palettes.append(palette)

    def tone(self, ground: tuple[float, float, float]) -> None:
        self.toned.append(ground)

    def change_brush(self, brush: str) -> None:
        self.brushes.append(brush)

    def let_dry(self, seconds: float) -> None:
        self.dried.append(seconds)

    def lay_paper(self) -> bool:
        return False

    def lay_checker(self) -> bool:
        return False

    def take_checker_away(self) -> bool:
        return False


def stub_easel(robot: NotingRobot | None = None, camera: PatientCamera | None = None) -> Easel:
    robot, camera = robot or NotingRobot(), camera or PatientCamera()
    return Easel(robot, camera, NotingAttendant(), WORKSPACE, CALIBRATION, CANVAS, pace=0.0)
