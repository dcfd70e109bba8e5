"""Wrappers that turn observations into one vector, for methods of learning that take no pictures."""

from typing import Any

import cv2
import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import VectorEnv
from gymnasium.wrappers import TransformObservation
from gymnasium.wrappers.vector import VectorizeTransformObservation
from numpy.typing import NDArray

from frida_painter.errors import ConfigError
from frida_painter_lab.env.task import Observation

_MAX_CELLS = 64


class VectorObservation(TransformObservation[NDArray[np.float32], Any, Observation]):
    """Environment whose observation is a vector in [-1, 1].

    cells: the canvas and its difference from the goal are averaged in cells x cells squares

    Its parts: goal minus canvas [cells^2 x 3]; canvas [cells^2 x 3]; the paints [k x 3]; the held paint, one of k + 1;
    load; shares of the strokes and of the minutes that are left.
    Raises ConfigError for an environment with other observations.
    """

    def __init__(self, env: "gymnasium.Env[Observation, Any]", cells: int = 8) -> None:
        space = env.observation_space
        if not (isinstance(space, spaces.Dict) and {"canvas", "goal", "paints", "held"} <= set(space.spaces)):
            raise ConfigError(
                "The observations of this environment have no canvas and goal; wrap one of frida-painter."
            )
        most = min(_MAX_CELLS, *(space["canvas"].shape or (0, 0))[:2])
        if not (type(cells) is int and 1 <= cells <= most):
            raise ConfigError(f"{cells!r} cells were asked for; give from 1 to {most}.")
        self._cells, self._held = cells, int(space["held"].n)  # type: ignore[attr-defined]
        self._most = {name: float(space[name].high[0]) for name in ("strokes_left", "minutes_left")}  # type: ignore[attr-defined]
        size = 6 * cells**2 + 3 * (self._held - 1) + self._held + 3
        super().__init__(env, self._vector, spaces.Box(-1.0, 1.0, (size,), np.float32))

    def _vector(self, observation: Observation) -> NDArray[np.float32]:
        canvas, goal = (
            cv2.resize(observation[name], (self._cells, self._cells), interpolation=cv2.INTER_AREA) / 255
            for name in ("canvas", "goal")
        )
        held = np.eye(self._held)[int(observation["held"])]
        left = [observation[name][0] / most for name, most in self._most.items()]
        parts = (goal - canvas, canvas, observation["paints"], held, observation["load"], left)
        return np.concatenate([np.asarray(part, np.float32).ravel() for part in parts])


class VectorObservations(VectorizeTransformObservation[Any, Any, Any, Any]):
    """Vector environment whose observations are vectors [n, numbers], as of VectorObservation."""

    def __init__(self, env: VectorEnv[Any, Any, Any], cells: int = 8) -> None:
        super().__init__(env, VectorObservation, cells=cells)
