"""The gateway: the only way to the robot for painting, calibration and stroke libraries."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from frida_painter.calibration import SurfaceMap
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import PoseMismatch, WorkspaceViolation
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.robot import MotionReport, Reach, Waypoints, Workspace
from frida_painter.hardware.timing import TravelLimits

# Limits of the workspace. A batch of motions is allowed as a whole, or nothing of it is sent. Nothing is clamped, and
# NaN fails every check.

FASTEST = 1.0
_TOLERANCE = 1e-6
_BESIDE = 0.01  # metres around the canvas that count as over it, because strokes end beside it
_ASKED_EVERY = 10  # waypoints are one millimetre apart, so reach is checked for each tenth only


@dataclass(frozen=True)
class Surface:
    """Canvas as an obstacle.

    press_height: robot z of the hardest press in metres
    uneven: height map of the canvas, which moves the hardest press with it; None if the canvas is flat
    """

    size: CanvasSize
    press_height: float
    uneven: SurfaceMap | None = None

    def floor(self, over: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns the lowest allowed robot z [k] at positions [k, 2] in canvas metres."""
        if self.uneven is None:
            return np.full(len(over), self.press_height)
        # The calibrated placement sends the tip up to a few millimetres beside the place whose height it takes.
        return self.press_height + self.uneven.at(over) - _BESIDE * self.uneven.steepest


@dataclass(frozen=True)
class Fault:
    """Fault of a motion that is not allowed, with its remedy.

    label: of the motion
    reason: part of a sentence; names the axis if there is one
    """

    label: str
    reason: str
    remedy: str


def check(
    batch: Iterable[Waypoints],
    workspace: Workspace,
    surface: Surface | None = None,
    reach: Reach | None = None,
    travel: TravelLimits | None = None,
) -> None:
    """Raises WorkspaceViolation, which names motion and axis, unless every motion is allowed.

    surface: depth limit over the canvas; None if unknown
    reach: of the robot's arm; None if it reaches every point
    travel: limits of the machine itself; None without
    """
    for fault in faults(batch, workspace, surface, reach, travel):
        raise WorkspaceViolation(f"{fault.label}: {fault.reason}. Nothing was sent to the robot; {fault.remedy}.")


def faults(
    batch: Iterable[Waypoints],
    workspace: Workspace,
    surface: Surface | None = None,
    reach: Reach | None = None,
    travel: TravelLimits | None = None,
) -> Iterator[Fault]:
    """Yields each motion that is not allowed, with its first fault."""
    for motion in batch:
        for found in _faults_of(motion, workspace, surface, reach, travel):
            yield Fault(motion.label, *found)
            break


def _faults_of(
    motion: Waypoints,
    workspace: Workspace,
    surface: Surface | None,
    reach: Reach | None,
    travel: TravelLimits | None,
) -> Iterator[tuple[str, str]]:
    """Yields the reasons why a motion is not allowed, each with its remedy."""
    way = motion.position

    def where(wrong: NDArray[np.bool_]) -> tuple[str, int, int]:
        """Returns the first coordinate that is wrong [k, 3], in words and by its waypoint and axis."""
        point, axis = map(int, np.argwhere(wrong)[0])
        return f"{'xyz'[axis]} = {way[point, axis]:.4f} m at waypoint {point}", point, axis

    if way.ndim != 2 or way.shape[1] != 3 or way.shape[0] == 0:
        yield f"waypoints of shape {way.shape} were planned; one or more (x, y, z) are needed", "report this"
        return
    if not 0 < motion.speed <= FASTEST:
        allowed = f"a speed of {motion.speed} m/s was planned; allowed is above 0 to {FASTEST} m/s"
        yield allowed, "correct the speeds of the workspace"
    lower, upper = np.array(workspace.lower), np.array(workspace.upper)
    outside = ~((way >= lower - _TOLERANCE) & (way <= upper + _TOLERANCE))
    if outside.any():
        told, _, axis = where(outside)
        reason = f"{told}; the workspace reaches from {lower[axis]:.4f} to {upper[axis]:.4f} m"
        yield reason, "move the canvas into reach or make the workspace true"
    if surface is not None:
        over, size = workspace.to_canvas(way), np.array([surface.size.width, surface.size.height])
        above_canvas = ((over >= -_BESIDE) & (over <= size + _BESIDE)).all(1)
        floor = surface.floor(over)
        deep = above_canvas & ~(way[:, 2] >= floor - _TOLERANCE)
        if deep.any():
            told, point, _ = where(deep[:, None] & [False, False, True])
            reason = f"{told}, over the canvas; the hardest press is at {floor[point]:.4f} m there"
            yield reason, "repeat the brush calibration or make the workspace true"
    if reach is not None:
        asked = way[np.unique(np.r_[np.arange(0, len(way), _ASKED_EVERY), len(way) - 1])]
        within = reach.reachable(asked)
        if not within.all():
            place = "({:.3f}, {:.3f}, {:.3f}) m".format(*asked[int((~within).argmax())])
            yield f"the arm does not reach {place}", "move what is to be reached nearer to the robot"
    if travel is not None and (beyond := travel.beyond(way)).any():
        told, _, axis = where(beyond)
        reason = f"{told}; the machine's own limits are {travel.describe(axis)}"
        yield reason, "move the canvas into its travel, or change its limits if they are wrong"


_ARRIVED = 0.002


class RobotGateway:
    """Gateway to the robot: checks each batch of motions as a whole, and that the tip arrives at each motion's end.

    lowest: robot z (m) of the lowest tip position over the canvas; None for the hardest press of the calibration.
        The brush procedure, which measures that press, gives the floor of the workspace.
    last_motion: time of the last motion, seconds of the robot's clock

    Every wait for a motion has a deadline. The guard in the easel's process gives up a driver (easel/guard.py), and
    the link gives up that process (easel/connection.py); both raise RobotDisconnected. A person who paints by hand has
    no deadline. Neither has the virtual studio if an experiment opens it without its own process.
    """

    def __init__(self, easel: Easel, *, lowest: float | None = None) -> None:
        self.easel = easel
        self.last_motion = 0.0
        self._calibrated = easel.calibration.press_height if lowest is None else lowest
        self._surface = Surface(easel.canvas, self._calibrated, easel.calibration.surface)

    def follow_touch(self, lower: float) -> None:
        """Lets the tip go `lower` metres below the hardest press from now on. A negative value counts as 0."""
        self._surface = replace(self._surface, press_height=self._calibrated - max(lower, 0.0))

    def check(self, motions: Iterable[Waypoints]) -> None:
        """Raises WorkspaceViolation unless every motion of the batch is allowed; nothing is clamped.

        A motion is refused if it contains NaN, leaves the workspace, is faster than 1 m/s, goes over the canvas
        below the hardest press, or is out of the arm's reach or beyond the machine's own limits.
        """
        check(motions, self.easel.workspace, self._surface, self.easel.reach, self.easel.travel)

    def perform(self, motions: Iterable[Waypoints]) -> bool:
        """Makes the motions if all are allowed; returns True if a person who paints by hand left one out.

        Raises WorkspaceViolation before anything moves, if a motion is not allowed.
        Raises PoseMismatch if the tip arrives more than 2 mm from where it was sent, and sends nothing more.
        Raises RobotError and its subclasses.
        """
        batch = list(motions)
        self.check(batch)
        left_out = False
        for motion in batch:
            report = self._report_done(self.easel.robot.follow(motion))
            require_arrived(motion.label, report.reached, motion.position[-1])
            left_out |= report.left_out
        return left_out

    def step_aside(self) -> None:
        """Moves the arm out of the camera's view.

        Raises PoseMismatch if the tip ends more than 2 mm from the workspace's home, or, without a home, more than
        2 mm outside the workspace.
        Raises RobotError and its subclasses.
        """
        report = self._report_done(self.easel.robot.home())
        workspace = self.easel.workspace
        inside = np.minimum(np.maximum(report.reached, workspace.lower), workspace.upper)  # NaN stays NaN
        require_arrived("home", report.reached, inside if workspace.home is None else np.array(workspace.home))

    def pose(self) -> NDArray[np.float64]:
        """Returns the position of the tip, [3] metres. Raises RobotError if the robot does not know it."""
        return self.easel.robot.pose()

    def _report_done(self, report: MotionReport) -> MotionReport:
        self.last_motion = report.finished_at
        return report


def require_arrived(
    label: str, tip: NDArray[np.float64], place: NDArray[np.float64], meant: str = "it was sent"
) -> None:
    """Raises PoseMismatch if a tip [3] is more than 2 mm from a place [3] (m).

    meant: what the place is, after "from where", in the error's message
    """
    away = float(np.linalg.norm(tip - place))
    if not away <= _ARRIVED:
        raise PoseMismatch(
            f"{label}: the robot says it is done, but its tip is {away * 1000:.1f} mm from where {meant}; "
            f"allowed are {_ARRIVED * 1000:g} mm. Look at the robot, then repeat the robot calibration."
        )
