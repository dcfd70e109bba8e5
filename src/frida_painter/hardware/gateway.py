"""The one way to the robot: painting, calibration and stroke libraries move it through a gateway."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import PoseMismatch, WorkspaceViolation
from frida_painter.hardware.easel import Easel
from frida_painter.hardware.robot import MotionReport, Reach, Waypoints, Workspace

# The limits of the workspace: a batch of motions is allowed as a whole, or nothing of it is sent.
#
# Nothing is clamped. The checks are written so that NaN fails them.

FASTEST = 1.0
_TOLERANCE = 1e-6
_BESIDE = 0.01  # metres: so near to the canvas counts as over it, for strokes end beside it
_ASKED_EVERY = 10  # waypoints, a millimetre apart: reach is not asked for each


@dataclass(frozen=True)
class Surface:
    """The canvas as what the brush must not go through: its size, and robot z of the hardest press, metres."""

    size: CanvasSize
    press_height: float


@dataclass(frozen=True)
class Fault:
    """Why a motion is not allowed: the motion's label, and what is wrong with which axis."""

    label: str
    reason: str
    remedy: str


def check(
    batch: Iterable[Waypoints], workspace: Workspace, surface: Surface | None = None, reach: Reach | None = None
) -> None:
    """Raises WorkspaceViolation, naming the motion and the axis, unless every motion is allowed.

    surface: how deep the brush may go over the canvas, as far as that is known; reach: of the robot,
    where its arm does not get everywhere.
    """
    for fault in faults(batch, workspace, surface, reach):
        raise WorkspaceViolation(f"{fault.label}: {fault.reason}. Nothing was sent to the robot; {fault.remedy}.")


def faults(
    batch: Iterable[Waypoints], workspace: Workspace, surface: Surface | None = None, reach: Reach | None = None
) -> Iterator[Fault]:
    """Every motion that is not allowed, with the first of its faults."""
    for motion in batch:
        found = _of_form(motion) or _outside(motion, workspace)
        found = found or (_too_deep(motion, workspace, surface) if surface else None)
        found = found or (_out_of_reach(motion, reach) if reach else None)
        if found:
            yield Fault(motion.label, *found)


def _of_form(motion: Waypoints) -> tuple[str, str] | None:
    shape = motion.position.shape
    if motion.position.ndim != 2 or shape[1] != 3 or shape[0] == 0:
        return f"waypoints of shape {shape} were planned; one or more (x, y, z) are needed", "report this"
    if not 0 < motion.speed <= FASTEST:
        allowed = f"a speed of {motion.speed} m/s was planned; allowed is above 0 to {FASTEST} m/s"
        return allowed, "correct the speeds of the workspace"
    return None


def _outside(motion: Waypoints, workspace: Workspace) -> tuple[str, str] | None:
    lower, upper = np.array(workspace.lower) - _TOLERANCE, np.array(workspace.upper) + _TOLERANCE
    inside = (motion.position >= lower) & (motion.position <= upper)
    if inside.all():
        return None
    point, axis = np.argwhere(~inside)[0]
    reason = (
        f"{_axis(motion, point, axis)}; the workspace reaches from {workspace.lower[axis]:.4f} to "
        f"{workspace.upper[axis]:.4f} m"
    )
    return reason, "move the canvas into reach or make the workspace true"


def _too_deep(motion: Waypoints, workspace: Workspace, surface: Surface) -> tuple[str, str] | None:
    over = workspace.to_canvas(motion.position)
    size = np.array([surface.size.width, surface.size.height])
    above_canvas = ((over >= -_BESIDE) & (over <= size + _BESIDE)).all(1)
    deep = above_canvas & ~(motion.position[:, 2] >= surface.press_height - _TOLERANCE)
    if not deep.any():
        return None
    reason = (
        f"{_axis(motion, int(deep.argmax()), 2)}, over the canvas; the hardest press is at {surface.press_height:.4f} m"
    )
    return reason, "repeat the brush calibration or make the workspace true"


def _out_of_reach(motion: Waypoints, reach: Reach) -> tuple[str, str] | None:
    asked = np.unique(np.r_[np.arange(0, len(motion.position), _ASKED_EVERY), len(motion.position) - 1])
    position: NDArray[np.float64] = motion.position[asked]
    within = reach.reachable(position)
    if within.all():
        return None
    x, y, z = position[int((~within).argmax())]
    return f"the arm does not reach ({x:.3f}, {y:.3f}, {z:.3f}) m", "move what is to be reached nearer to the robot"


def _axis(motion: Waypoints, point: int, axis: int) -> str:
    return f"{'xyz'[axis]} = {motion.position[point, axis]:.4f} m at waypoint {point}"


_ARRIVED = 0.002


class RobotGateway:
    """Checks motions as a whole, sends them one after another, and compares where the tip arrived.

    lowest: robot z (m) below which the tip does not go over the canvas, the hardest press of the
    easel's record where it is None; the brush procedure, which finds that press, gives the floor of
    the workspace. last_motion: when the robot last moved, s of its clock.

    Every wait for a motion has a deadline, which is kept where the wait is: the guard in the easel's
    process gives up a driver (easel/guard.py), and the link gives up that process
    (easel/parent.py); both raise RobotDisconnected. A person who paints by hand may take any
    time, and so may the virtual studio where an experiment opens it without a process of its own.
    """

    def __init__(self, easel: Easel, *, lowest: float | None = None) -> None:
        self.easel = easel
        self.last_motion = 0.0
        self._calibrated = easel.calibration.press_height if lowest is None else lowest
        self._surface = Surface(easel.canvas, self._calibrated)

    def follow_touch(self, lower: float) -> None:
        """From now on the tip goes `lower` metres lower than the hardest press; not higher where that is below 0."""
        self._surface = Surface(self.easel.canvas, self._calibrated - max(lower, 0.0))

    def check(self, motions: Iterable[Waypoints]) -> None:
        """Raises WorkspaceViolation unless every motion of the batch is allowed; nothing is clamped.

        A motion is refused where a number of it is NaN, it leaves the workspace, is faster than 1 m/s,
        goes over the canvas below the hardest press, or is out of the arm's reach.
        """
        check(motions, self.easel.workspace, self._surface, self.easel.reach)

    def perform(self, motions: Iterable[Waypoints]) -> bool:
        """Makes the motions, once all of them are allowed; whether a person who paints by hand left one out.

        Raises WorkspaceViolation before anything moves, as `check` does; PoseMismatch where the tip
        arrives more than 2 mm from where it was sent, and then sends nothing more; RobotError and its kinds.
        """
        batch = list(motions)
        self.check(batch)
        left_out = False
        for motion in batch:
            report = self._done(self.easel.robot.follow(motion))
            _require_arrived(motion.label, report.reached, motion.position[-1])
            left_out |= report.left_out
        return left_out

    def step_aside(self) -> None:
        """Moves the arm out of the camera's sight.

        Raises PoseMismatch where the tip ends more than 2 mm from the workspace's home, or outside the
        workspace where that names none; RobotError and its kinds.
        """
        report = self._done(self.easel.robot.home())
        workspace = self.easel.workspace
        inside = np.minimum(np.maximum(report.reached, workspace.lower), workspace.upper)  # NaN stays NaN
        _require_arrived("home", report.reached, inside if workspace.home is None else np.array(workspace.home))

    def pose(self) -> NDArray[np.float64]:
        """Where the tip is, [3] metres. Raises RobotError where the robot does not know."""
        return self.easel.robot.pose()

    def _done(self, report: MotionReport) -> MotionReport:
        self.last_motion = report.finished_at
        return report


def _require_arrived(label: str, reached: NDArray[np.float64], sent: NDArray[np.float64]) -> None:
    away = float(np.linalg.norm(reached - sent))
    if not away <= _ARRIVED:
        raise PoseMismatch(
            f"{label}: the robot says it is done, but its tip is {away * 1000:.1f} mm from where it was sent; "
            f"allowed are {_ARRIVED * 1000:g} mm. Look at the robot, then repeat the robot calibration."
        )
