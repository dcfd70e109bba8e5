"""The simulated Sawyer as an arm of the studio: plans a whole path, refuses or follows it, and reports the course."""

import threading
from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from frida_painter import registry
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import RobotError, WorkspaceViolation
from frida_painter.hardware.robot import Workspace
from frida_painter.hardware.timing import Timing
from frida_painter.virtual.bristles import BristleBrush
from frida_painter.virtual.robot import Arm, Course, FreeArm, Way
from frida_painter.virtual.studio import ArmAndTable, StudioArm
from frida_painter.virtual.tabletop import HandNoise, sawyer_layout

if TYPE_CHECKING:
    from frida_painter_drivers.sawyer.body import Kinematics, SimulatedArm


TIMING = Timing(acceleration=0.8, smoothing=0.06, period=0.01)
"""Limits on its motion: gentle enough for its motors, and for a wet brush."""


class SawyerArm(Arm):
    """Simulated Sawyer: inverse kinematics at 100 Hz, joint control and physics at 500 Hz.

    seed: of the controller's error about the friction

    Implements virtual.robot.Arm.
    """

    def __init__(self, workspace: Workspace, canvas: CanvasSize, seed: int) -> None:
        self._workspace, self._canvas, self._seed = workspace, canvas, seed
        self._remembered: Sequence[float] = ()
        self._body: SimulatedArm | None = None
        self._kinematics: Kinematics | None = None

    def connect(self, tip: NDArray[np.float64]) -> None:
        """Builds the arm with its tip at a position [3], metres. Raises RobotError if MuJoCo is not installed."""
        self._kinematics = load_kinematics(self._workspace, self._canvas)
        from frida_painter_drivers.sawyer.body import SimulatedArm

        self._body = SimulatedArm(self._kinematics.model, self._kinematics.posture(tip), self._seed)
        if self._remembered:
            self._body.restore(self._remembered)

    def move(self, way: Way, stopped: threading.Event, pace: float) -> Course:
        """Plans the whole path, then follows it.

        stopped: a set event stops the arm
        pace: least real seconds per second of motion

        Raises WorkspaceViolation before it moves, if the arm does not reach a waypoint, would have to turn a joint
        too fast, or would touch itself or the table. Raises RobotError if it is not connected.
        """
        body, kinematics = self._body, self._kinematics
        if body is None or kinematics is None:
            raise RobotError(f"{way.label}: the simulated Sawyer is not connected; call connect() first.")
        places = TIMING.places(way.path, way.speeds())
        if len(places) == 1:
            return Course(body.tip[None], 0.0)  # it is there already
        angles = kinematics.follow(places, body.angles, stopped)
        if len(angles) < len(places):
            return Course(body.tip[None], 0.0, stopped=True)
        hindrance = kinematics.hindrance(angles, places, TIMING.period)
        if hindrance is not None:
            raise WorkspaceViolation(
                f"{way.label}: {hindrance}. The arm did not move; bring what is to be reached nearer to it."
            )
        track = body.track(angles, TIMING.period, stopped, pace)
        # After a stop the arm brakes; its intended position stays that of the stop.
        braking = np.repeat(places[-1:], max(0, len(track.places) - len(places)), axis=0)
        meant = np.concatenate([places, braking])[: len(track.places)]
        return Course(track.places, track.seconds, track.stopped, meant, track.angles)

    def state(self) -> Sequence[float]:
        """Returns the state of the physics, which determines the next motion."""
        return self._remembered if self._body is None else self._body.state()

    def remember(self, state: Sequence[float]) -> None:
        """Stores a state from which the next connection continues."""
        self._remembered = tuple(state)

    def close(self) -> None:
        """Ends the simulation and keeps its state."""
        self._remembered = self.state()
        self._body = self._kinematics = None


def load_kinematics(workspace: Workspace, canvas: CanvasSize) -> "Kinematics":
    """Returns the kinematics of the arm in its surroundings. Raises RobotError if MuJoCo is not installed."""
    with registry.importing("mujoco", "The simulated Sawyer", RobotError):
        from frida_painter_drivers.sawyer.body import Kinematics
        from frida_painter_drivers.sawyer.surroundings import make_model
    return Kinematics(make_model(workspace, canvas))


# Reach of the simulated Sawyer, checked before anything moves.

# All positions in a cube of this side (m) get the same answer, because strokes are dense on a canvas.
_CUBE = 0.005


class SawyerReach:
    """Reach by inverse kinematics: True if the tip gets there, without touching anything.

    Implements hardware.robot.Reach.
    """

    def __init__(self, workspace: Workspace, canvas: CanvasSize) -> None:
        self._workspace, self._canvas = workspace, canvas
        self._answers: dict[tuple[int, ...], bool] = {}

    @cached_property
    def _kinematics(self) -> "Kinematics":
        return load_kinematics(self._workspace, self._canvas)

    def reachable(self, position: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Returns True for each reachable position [k, 3] (m): [k]. Raises RobotError if MuJoCo is not installed."""
        if not np.isfinite(position).all():
            return np.isfinite(position).all(1) & self.reachable(np.nan_to_num(position, posinf=0.0, neginf=0.0))
        cubes = np.round(position / _CUBE).astype(int)
        for cube in np.unique(cubes, axis=0):
            if (key := tuple(cube.tolist())) not in self._answers:
                place = cube * _CUBE
                angles = self._kinematics.posture(place)
                self._answers[key] = self._kinematics.hindrance(angles[None], place[None], 1.0) is None
        return np.array([self._answers[tuple(cube)] for cube in cubes.tolist()], bool)


# The Sawyer as an arm of the virtual studio.

SAWYER, KINEMATIC_SAWYER = "sawyer", "kinematic-sawyer"
_STEADY = HandNoise(0.0, 0.0)


def _with_sawyer(canvas: CanvasSize, brush: BristleBrush, seed: int) -> ArmAndTable:
    layout = sawyer_layout(canvas, brush)
    reach = SawyerReach(layout.workspace, canvas)
    return ArmAndTable(layout, SawyerArm(layout.workspace, canvas, seed), _STEADY, reach, TIMING)


def _with_kinematic_sawyer(canvas: CanvasSize, brush: BristleBrush, seed: int) -> ArmAndTable:
    return ArmAndTable(sawyer_layout(canvas, brush), FreeArm(TIMING), _STEADY, timing=TIMING)


SAWYER_ARM = StudioArm(SAWYER, "simulated Sawyer", _with_sawyer)
KINEMATIC_ARM = StudioArm(KINEMATIC_SAWYER, "kinematic Sawyer", _with_kinematic_sawyer)
"""Arm without any error at the Sawyer's table, with the Sawyer's timing."""
