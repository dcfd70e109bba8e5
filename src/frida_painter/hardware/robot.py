"""Protocols of robots and cameras, with the workspace, reach, waypoints and frames that they use."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from frida_painter.canvas_size import CanvasSize
from frida_painter.hardware.timing import AxisTiming, TravelLimits

Point = tuple[float, float, float]


@dataclass(frozen=True)
class BrushRack:
    """Rack with forks for brushes, each open to one side. A fork holds a brush more firmly than the robot's hand.

    places: position of the tip of each brush in its fork, by the brush's name
    slide: x and y from the fork to the point at which the brush is clear of it, metres
    lift: metres that the hand rises to be clear of a brush
    """

    places: Mapping[str, Point]
    slide: tuple[float, float]
    lift: float

    def front(self, brush: str) -> Point:
        """Returns the position of a brush's tip when the brush is clear of its fork, at the same height."""
        x, y, z = self.places[brush]
        return x + self.slide[0], y + self.slide[1], z


@dataclass(frozen=True)
class Workspace:
    """Layout of a robot's workspace: canvas, paint and tools. Lengths in metres of the robot's frame.

    lower, upper: corners of the box that the tip never leaves
    canvas_origin: the canvas's bottom-left corner on its surface
    canvas_angle: radians from the robot's x axis to the canvas's lower edge
    wells: position of the tip in each paint well
    water, rag: position of the tip in the water and on the rag
    rag_width: length of a wipe along x
    hover: height of the tip above objects while it travels
    painting_speed, travel_speed: m/s
    home: position of the tip while the camera looks; None if the robot has its own
    rack: of the brushes; None if a person changes them
    """

    lower: Point
    upper: Point
    canvas_origin: Point
    canvas_angle: float
    wells: tuple[Point, ...]
    water: Point
    rag: Point
    rag_width: float
    hover: float
    painting_speed: float
    travel_speed: float
    home: Point | None = None
    rack: BrushRack | None = None

    @property
    def top(self) -> float:
        """Robot z of the highest object in the workspace, metres."""
        things = [self.canvas_origin[2], self.water[2], self.rag[2], *(well[2] for well in self.wells)]
        if self.rack is not None:  # the empty hand passes over a brush in its fork
            things += [place[2] + self.rack.lift for place in self.rack.places.values()]
        return max(things)

    def to_robot(self, position: NDArray[np.float64], height: NDArray[np.float64]) -> NDArray[np.float64]:
        """Converts canvas metres [k, 2] and robot heights [k] to the robot's frame [k, 3]."""
        return np.c_[position @ self._turn + np.array(self.canvas_origin[:2]), height]

    def to_canvas(self, position: NDArray[np.float64]) -> NDArray[np.float64]:
        """Converts positions in the robot's frame [k, 3] to canvas metres [k, 2], as seen from above."""
        return (position[:, :2] - np.array(self.canvas_origin[:2])) @ self._turn.T

    def corners(self, canvas: CanvasSize) -> dict[str, Point]:
        """Returns the corners of a canvas by name: bottom-left, bottom-right, top-right and top-left."""
        width, height = canvas.width, canvas.height
        ends = np.array([(0.0, 0.0), (width, 0.0), (width, height), (0.0, height)])
        found = self.to_robot(ends, np.full(4, self.canvas_origin[2])).tolist()
        return dict(zip(("bottom-left", "bottom-right", "top-right", "top-left"), map(tuple, found), strict=True))

    @property
    def _turn(self) -> NDArray[np.float64]:
        cos, sin = np.cos(self.canvas_angle), np.sin(self.canvas_angle)
        return np.array([[cos, sin], [-sin, cos]])


@runtime_checkable
class Reach(Protocol):
    """Reach of an arm, by inverse kinematics or by its length; checked before anything moves.

    A driver that knows the reach of its arm before it is connected implements this beside `Robot`.
    """

    def reachable(self, position: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Returns True for each position [k, 3] in the robot's frame (m) that the tip reaches with its brush: [k]."""


@dataclass(frozen=True)
class ArmLength:
    """Reach of an arm of known length: nearest and farthest distance of the tip from the shoulder, metres."""

    shoulder: Point
    nearest: float
    farthest: float

    def reachable(self, position: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Returns True for each position [k, 3] between the two spheres: [k]."""
        away = np.linalg.norm(position - np.array(self.shoulder), axis=1)
        return (away >= self.nearest) & (away <= self.farthest)


@dataclass(frozen=True)
class Waypoints:
    """Path of the brush's tip.

    label: purpose of the motion in messages ("stroke 12", "dip into well 3")
    position: waypoints [k, 3] in metres of the robot's frame, z up
    speed: m/s
    cue: ("dip", number of the well from 1) or ("change", name of the brush) for such a motion; None for others
    """

    label: str
    position: NDArray[np.float64]
    speed: float
    cue: tuple[str, str] | None = None

    @property
    def length(self) -> float:
        """Length of the path in metres."""
        return float(np.linalg.norm(np.diff(self.position, axis=0), axis=1).sum())


def plan_way_home(here: NDArray[np.float64], home: Point, speed: float) -> Waypoints:
    """Returns the way of the tip from `here` [3] to the home position, first vertically. speed: m/s"""
    aside = np.array(home)
    above = np.array([here[0], here[1], max(here[2], aside[2])])
    return Waypoints("home", np.stack((above, aside)), speed)


@dataclass(frozen=True)
class MotionReport:
    """Result of a motion.

    started_at, finished_at: seconds of the robot's own clock
    reached: final position of the tip [3], metres
    left_out: True if a person who paints by hand chose not to make the motion
    """

    label: str
    started_at: float
    finished_at: float
    reached: NDArray[np.float64]
    left_out: bool = False


class Robot(Protocol):
    """Driver of a robot. It knows nothing of painting. Raises RobotError and its subclasses.

    If the controller states its serial number, the driver has it as `serial_number` once connected.

        >>> import frida_painter as fp
        >>> robot: fp.Robot = fp.open_virtual_studio("12x9cm").easel.robot
        >>> robot.connect()
        >>> robot.home().label
        'home'
    """

    def connect(self) -> None:
        """Connects to the robot. A failed attempt leaves nothing open and may be repeated."""

    def home(self) -> MotionReport:
        """Moves to the home position, from which the camera sees the whole canvas."""

    def pose(self) -> NDArray[np.float64]:
        """Returns the position of the tip, [3] metres."""

    def follow(self, waypoints: Waypoints) -> MotionReport:
        """Moves the tip along the waypoints and returns when it has arrived."""

    def stop(self) -> None:
        """Stops at once, over a separate channel; may be called from any thread."""

    def close(self) -> None:
        """Disconnects from the robot."""


# Optional protocols of a robot: what its controller tells. The core asks `isinstance(robot, ZeroedRobot)` and so on.
# A robot that lacks one is treated as before: its zero counts as known, its speeds as reached.


@dataclass(frozen=True)
class Zero:
    """Knowledge of a connected machine about its zero, the origin of the robot's frame.

    lost: reason why the reported position may be wrong, as part of a sentence ("its board was reset as the line was
        opened"); "" if the position survived since the zero was found
    homes: True if the machine can find its zero by itself, with limit switches, and may after a person said yes
    seconds: longest duration of that
    locked: True if the machine does nothing else before that
    """

    lost: str = ""
    homes: bool = False
    seconds: float = 300.0
    locked: bool = False

    @property
    def known(self) -> bool:
        """True if the reported position can be trusted."""
        return not self.lost


@runtime_checkable
class ZeroedRobot(Protocol):
    """Robot that may forget where it is: after a reset, a power cut, or while its motors are off.

    While the zero is lost, `follow` and `home` are refused by the guard (easel/guard.py), before anything moves.
    """

    def zero(self) -> Zero:
        """Returns the knowledge about the zero, once connected; moves nothing. Raises RobotError."""

    def find_zero(self) -> None:
        """Drives to the limit switches, if `Zero.homes`; the zero is known then. Raises RobotError."""

    def jog(self, step: NDArray[np.float64]) -> None:
        """Moves the tip slowly by `step` [3] metres in the robot's frame, also if the zero is lost.

        Returns when the tip stands. Raises RobotError.
        """

    def set_zero(self, tip: NDArray[np.float64]) -> None:
        """Declares that the tip stands at `tip` [3] (m) now; the zero is known then. Moves nothing.

        Raises RobotError.
        """


@runtime_checkable
class TimedRobot(Protocol):
    """Robot whose controller tells how fast it can move. Deadlines and timetables follow from that."""

    def timing(self) -> AxisTiming | None:
        """Returns the limits that were read at connection; None if the controller did not tell them (yet)."""

    def alive_at(self) -> float:
        """Returns the time (s, hardware.deadline.steady) when the controller last showed that it moves or waits.

        It waits if a person holds it, or during a dwell. A motion is not overdue while this time advances. -inf if
        the controller does not show it. May be called from any thread.
        """


@runtime_checkable
class LimitedRobot(Protocol):
    """Robot whose controller tells limits of its travel, beyond which it would stop, or would not go."""

    def travel_limits(self) -> TravelLimits | None:
        """Returns the limits of the connected machine, moving nothing; None if it has none. Raises RobotError."""


Weight = Literal["fact", "warning", "refusal"]


@dataclass(frozen=True)
class MachineFact:
    """Fact that a controller told, in a sentence for a person.

    weight: "fact", "warning" if painting may suffer, or "refusal" if painting cannot work. The sentence of the last
        two contains the remedy. `connect` raises RobotError for a machine with a refusal.
    question: asked in a setup if only a person knows whether a warning matters; "no" makes it a refusal
    """

    text: str
    weight: Weight = "fact"
    question: str = ""


@dataclass(frozen=True)
class Examination:
    """Result of an examination of a machine.

    facts: in the order in which a person reads them
    timing: limits that the controller told; None if it did not
    travel: limits of the travel that it told; None without
    homes: as in Zero
    """

    facts: tuple[MachineFact, ...]
    timing: AxisTiming | None = None
    travel: TravelLimits | None = None
    homes: bool = False


@runtime_checkable
class ExaminedRobot(Protocol):
    """Robot whose controller can be examined: for `doctor --robot`."""

    def examine(self) -> Examination:
        """Connects, reads everything that the controller tells, and disconnects, within ten seconds; moves nothing.

        A machine in an alarm is examined, too. Raises RobotError if nobody answers or it is another device.
        """


@runtime_checkable
class GuidedRobot(Protocol):
    """Arm that a person guides by hand while it tells where its tip is; it never moves by itself then."""

    def begin_guiding(self) -> None:
        """Connects and lets the arm follow a person's hand. A failed attempt leaves nothing open.

        Raises RobotError and its subclasses.
        """

    def guided_tip(self) -> NDArray[np.float64]:
        """Returns the tip [3] (m) in the arm's present posture, the brush upright or not.

        Raises RobotError and its subclasses if the arm left this mode or has a fault.
        """

    def end_guiding(self) -> None:
        """Lets the arm hold its place, without obeying motions, and disconnects. May be called repeatedly."""


@runtime_checkable
class PausableRobot(Protocol):
    """Robot whose board has a pause button."""

    def wants_pause(self) -> bool:
        """Returns True, once, if the button was pressed since the last call; moves nothing. Raises RobotError."""


@dataclass(frozen=True)
class StopLine:
    """Open line of a machine, over which another process can stop it once the driver's process is gone.

    file: descriptor of the line
    content: bytes that stop the machine
    """

    file: int
    content: bytes


@runtime_checkable
class LineStoppedRobot(Protocol):
    """Robot that a few bytes on its line stop, whatever was sent before."""

    def stop_line(self) -> StopLine | None:
        """Returns the line as it is now, None if it is closed. Never waits; may be called from any thread."""
        ...


@runtime_checkable
class LooseRobot(Protocol):
    """Robot whose gears have play, so that its tip is not exactly where it is sent. `check` tells it."""

    def play(self, position: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns how far the tip may be from each position [k, 3] of the robot's frame: [k], metres.

        NaN if the position is out of reach.
        """


Sense = Literal["contact", "force"]
"""Sense of touch: by an electric contact that a person fastens to brush and canvas, or by the arm's own force."""


@runtime_checkable
class TouchProbe(Protocol):
    """Robot that may feel a touch of its brush."""

    def feels(self) -> Sense | None:
        """Returns how it feels a touch; None if it does not."""

    def touch(self, lowest: float, speed: float) -> MotionReport:
        """Moves straight down until the brush touches something; `reached` is the position of the touch.

        lowest: robot z in metres at which the motion ends; `reached` is there if nothing was touched
        speed: m/s
        Raises RobotError and its subclasses.
        """


# Cameras: each gives a photograph that is newer than a given moment.


@dataclass(frozen=True)
class Frame:
    """Photograph with its time and number.

    image: [rows, columns, 3] uint8 sRGB
    captured_at: seconds of the robot's clock
    sequence: number of the photograph
    """

    image: NDArray[np.uint8]
    captured_at: float
    sequence: int


class Camera(Protocol):
    """Driver of a camera. Raises CameraError and its subclasses.

    The virtual studio has one:

        >>> import frida_painter as fp
        >>> camera: fp.Camera = fp.open_virtual_studio("12x9cm").easel.camera
        >>> camera.connect()
        >>> camera.capture(newer_than=0.0).image.dtype
        dtype('uint8')
    """

    def connect(self) -> None:
        """Connects to the camera. A failed attempt leaves nothing open and may be repeated."""

    def capture(self, newer_than: float) -> Frame:
        """Returns a photograph taken after `newer_than` (s). Raises StaleFrame if there is none."""

    def close(self) -> None:
        """Disconnects from the camera."""


@runtime_checkable
class LiveCamera(Camera, Protocol):
    """Camera that always has a picture to watch, like a webcam."""

    def glance(self) -> NDArray[np.uint8]:
        """Returns the current picture [rows, columns, 3] sRGB, for display only. Raises CameraError."""
