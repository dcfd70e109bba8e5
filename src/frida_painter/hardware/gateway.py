"""The gateway: the only way to the robot for painting, calibration and stroke libraries."""

import hashlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from frida_painter.calibration import Calibration, SurfaceMap
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import PoseMismatch, WorkspaceViolation
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.robot import Reach, Waypoints, Workspace
from frida_painter.hardware.timing import TravelLimits

# A batch is allowed as a whole, or nothing of it is sent. Nothing is clamped, and NaN fails every check.

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

    @classmethod
    def of(cls, canvas: CanvasSize, calibration: Calibration) -> Self:
        """Returns the canvas as it was calibrated."""
        return cls(canvas, calibration.press_height, calibration.surface)

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


@dataclass(frozen=True)
class MotionLimits:
    """Limits of every motion at an easel.

    surface: depth limit over the canvas; None if unknown
    reach: of the robot's arm; None if it reaches every point
    travel: limits of the machine itself; None without
    """

    workspace: Workspace
    surface: Surface | None = None
    reach: Reach | None = None
    travel: TravelLimits | None = None

    def check(self, batch: Iterable[Waypoints]) -> None:
        """Raises WorkspaceViolation, which names motion and axis, unless every motion is allowed."""
        for fault in self.faults(batch):
            raise WorkspaceViolation(f"{fault.label}: {fault.reason}. Nothing was sent to the robot; {fault.remedy}.")

    def faults(self, batch: Iterable[Waypoints]) -> Iterator[Fault]:
        """Yields each motion that is not allowed, with its first fault."""
        for motion in batch:
            if (found := next(self._faults_of(motion), None)) is not None:
                yield Fault(motion.label, *found)

    def _faults_of(self, motion: Waypoints) -> Iterator[tuple[str, str]]:
        """Yields the reasons why a motion is not allowed, each with its remedy."""
        way, workspace, surface = motion.position, self.workspace, self.surface

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
        if self.reach is not None:
            asked = way[np.unique(np.r_[np.arange(0, len(way), _ASKED_EVERY), len(way) - 1])]
            within = self.reach.reachable(asked)
            if not within.all():
                place = "({:.3f}, {:.3f}, {:.3f}) m".format(*asked[int((~within).argmax())])
                yield f"the arm does not reach {place}", "move what is to be reached nearer to the robot"
        if self.travel is not None and (beyond := self.travel.beyond(way)).any():
            told, _, axis = where(beyond)
            reason = f"{told}; the machine's own limits are {self.travel.describe(axis)}"
            yield reason, "move the canvas into its travel, or change its limits if they are wrong"


# The door: the one place at which motions are checked, in the process that owns the robot.


@runtime_checkable
class CheckedRobot(Protocol):
    """Robot behind the door of its process."""

    def allow(self, motions: tuple[Waypoints, ...], workspace: Workspace, surface: Surface) -> None:
        """Checks a batch of motions before the first of them moves; an allowed motion is not checked again.

        workspace, surface: limits that the painter states; those of the robot itself hold as well
        Raises WorkspaceViolation if one of the motions is not allowed.
        """


class Door:
    """Door to one robot: checks each motion once, by the robot's own limits and by those that the painter states.

    own: limits of the robot itself, which also hold for motions that nobody asked about before
    """

    def __init__(self, own: MotionLimits) -> None:
        self._own = self._both = own
        self._stated: tuple[Workspace, Surface] | None = None
        self._allowed: set[tuple[float, bytes]] = set()

    def allow(self, motions: tuple[Waypoints, ...], workspace: Workspace, surface: Surface) -> None:
        """Checks a batch; as `CheckedRobot`."""
        if self._stated != (workspace, surface):
            own = self._own.workspace
            lower, upper = np.maximum(own.lower, workspace.lower), np.minimum(own.upper, workspace.upper)  # NaN stays
            box = replace(workspace, lower=tuple(lower.tolist()), upper=tuple(upper.tolist()))
            self._both, self._stated = replace(self._own, workspace=box, surface=surface), (workspace, surface)
            self._allowed.clear()
        fresh: dict[tuple[float, bytes], Waypoints] = {}
        for motion in motions:
            if (key := _identify(motion)) not in self._allowed:
                fresh.setdefault(key, motion)
        self._both.check(fresh.values())
        self._allowed.update(fresh)

    def require_allowed(self, motion: Waypoints) -> None:
        """Raises WorkspaceViolation unless the motion was allowed, or is within the robot's own limits."""
        if _identify(motion) not in self._allowed:
            self._own.check([motion])

    def learn_travel(self, travel: TravelLimits | None) -> None:
        """Replaces the limits of the machine itself; every motion is checked anew."""
        self._own, self._stated = replace(self._own, travel=travel), None
        self._allowed.clear()


def _identify(motion: Waypoints) -> tuple[float, bytes]:
    """Returns what tells a motion from every other one: its speed, and a digest of its path."""
    way = np.ascontiguousarray(motion.position)
    return motion.speed, hashlib.sha256(repr((way.dtype.str, way.shape)).encode() + way.tobytes()).digest()


def door_of(easel: Easel) -> CheckedRobot:
    """Returns the door of an easel's robot: that of its process, or one here for a robot of this process."""
    robot = easel.robot
    return robot if isinstance(robot, CheckedRobot) else Door(MotionLimits(easel.workspace, reach=easel.reach))


_ARRIVED = 0.002
_AT_ONCE = 32  # motions in one question to the door; an arm's reach may take milliseconds for each place of each


class RobotGateway:
    """Gateway to the robot: has each batch of motions checked as a whole at the robot's door, and checks where it ends.

    lowest: robot z (m) of the lowest tip position over the canvas; None for the hardest press of the calibration.
        The brush procedure, which measures that press, gives the floor of the workspace.
    last_motion: time of the last motion, seconds of the robot's clock

    Every wait for a motion has a deadline: the guard gives up a driver (easel/guard.py), and the link gives up the
    easel's process (easel/connection.py). A person who paints by hand has none, nor has a studio in this process.
    """

    def __init__(self, easel: Easel, *, lowest: float | None = None) -> None:
        self.easel = easel
        self.last_motion = 0.0
        self._door = door_of(easel)
        surface = Surface.of(easel.canvas, easel.calibration)
        self._surface = self._calibrated = surface if lowest is None else replace(surface, press_height=lowest)

    def follow_touch(self, lower: float) -> None:
        """Lets the tip go `lower` metres below the hardest press from now on. A negative value counts as 0."""
        self._surface = replace(self._calibrated, press_height=self._calibrated.press_height - max(lower, 0.0))

    def check(self, motions: Iterable[Waypoints]) -> None:
        """Raises WorkspaceViolation unless the door allows every motion of the batch.

        A motion is refused if it contains NaN, leaves the workspace, is faster than 1 m/s, goes over the canvas
        below the hardest press, or is out of the arm's reach or beyond the machine's own limits.
        """
        batch = tuple(motions)
        for start in range(0, len(batch), _AT_ONCE):
            self._door.allow(batch[start : start + _AT_ONCE], self.easel.workspace, self._surface)

    def perform(self, motions: Iterable[Waypoints]) -> bool:
        """Makes the motions if all are allowed; returns True if a person who paints by hand left one out.

        Raises WorkspaceViolation before anything moves, if a motion is not allowed.
        Raises PoseMismatch if the tip arrives more than 2 mm from where it was sent, and sends nothing more.
        Raises RobotError and its subclasses.
        """
        batch = tuple(motions)
        self.check(batch)
        left_out = False
        for motion in batch:
            report = self.easel.robot.follow(motion)
            self.last_motion = report.finished_at
            require_arrived(motion.label, report.reached, motion.position[-1])
            left_out |= report.left_out
        return left_out

    def step_aside(self) -> None:
        """Moves the arm out of the camera's view.

        Raises PoseMismatch if the tip ends more than 2 mm from the workspace's home, or, without a home, more than
        2 mm outside the workspace.
        Raises RobotError and its subclasses.
        """
        report, workspace = self.easel.robot.home(), self.easel.workspace
        self.last_motion = report.finished_at
        inside = np.minimum(np.maximum(report.reached, workspace.lower), workspace.upper)  # NaN stays NaN
        require_arrived("home", report.reached, inside if workspace.home is None else np.array(workspace.home))

    def pose(self) -> NDArray[np.float64]:
        """Returns the position of the tip, [3] metres. Raises RobotError if the robot does not know it."""
        return self.easel.robot.pose()


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
