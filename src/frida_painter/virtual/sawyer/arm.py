"""The simulated Sawyer as an arm of the studio: a way is planned whole, refused or gone, and its real course told."""

import threading
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from frida_painter.errors import RobotError, WorkspaceViolation
from frida_painter.frames import CanvasSize
from frida_painter.hardware.timing import Timing
from frida_painter.hardware.workspace import Workspace
from frida_painter.virtual.arm import Course, Way

if TYPE_CHECKING:
    from frida_painter.virtual.sawyer.control import SimulatedArm
    from frida_painter.virtual.sawyer.kinematics import Kinematics

MISSING = (
    "The simulated Sawyer needs MuJoCo and mink, which are not installed; say: pip install 'frida-painter[mujoco]'"
)


TIMING = Timing(acceleration=0.8, smoothing=0.06, period=0.01)
"""How it starts and stops: gently enough for its motors, and for a wet brush."""


class SawyerArm:
    """Implements virtual.arm.Arm: inverse kinematics at 100 Hz, joint control and physics at 500 Hz.

    seed: of what its controller does not know of its own friction.
    """

    def __init__(self, workspace: Workspace, canvas: CanvasSize, seed: int) -> None:
        self._workspace, self._canvas, self._seed = workspace, canvas, seed
        self._remembered: Sequence[float] = ()
        self._body: SimulatedArm | None = None
        self._kinematics: Kinematics | None = None

    def connect(self, tip: NDArray[np.float64]) -> None:
        """Builds the arm with its tip there. Raises RobotError where MuJoCo is not installed."""
        try:
            from frida_painter.virtual.sawyer.control import SimulatedArm
            from frida_painter.virtual.sawyer.kinematics import Kinematics
            from frida_painter.virtual.sawyer.surroundings import Surroundings
        except ImportError as cause:
            raise RobotError(MISSING) from cause
        model = Surroundings(self._workspace, self._canvas).model()
        self._kinematics = Kinematics(model)
        self._body = SimulatedArm(model, self._kinematics.posture(tip), self._seed)
        if self._remembered:
            self._body.restore(self._remembered)

    def move(self, way: Way, stopped: threading.Event, pace: float) -> Course:
        """Plans the whole way, then goes it.

        Raises WorkspaceViolation before it moves, where the arm does not reach, would have to turn a
        joint too fast, or would touch itself or the table.
        """
        body, kinematics = self._alive(way.label)
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
        # After a stop it brakes, meant to be nowhere else than where it was stopped.
        braking = np.repeat(places[-1:], max(0, len(track.places) - len(places)), axis=0)
        meant = np.concatenate([places, braking])[: len(track.places)]
        return Course(track.places, track.seconds, track.stopped, meant, track.angles)

    def state(self) -> Sequence[float]:
        """All that the physics of the next motion follows from."""
        return self._remembered if self._body is None else self._body.state()

    def remember(self, state: Sequence[float]) -> None:
        """Takes up from that state when it is connected."""
        self._remembered = tuple(state)

    def close(self) -> None:
        """Lets go of the simulation; its state is kept."""
        self._remembered = self.state()
        self._body = self._kinematics = None

    def _alive(self, label: str) -> "tuple[SimulatedArm, Kinematics]":
        if self._body is None or self._kinematics is None:
            raise RobotError(f"{label}: the simulated Sawyer is not connected; call connect() first.")
        return self._body, self._kinematics
