"""Wrappers that turn observations into one vector, for methods of learning that take no pictures."""

from typing import Any

import cv2
import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import VectorEnv, VectorObservationWrapper
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from frida_painter.errors import ConfigError

Observation = dict[str, Any]
_MAX_CELLS = 64


class VectorObservation(gymnasium.ObservationWrapper[NDArray[np.float32], Any, Observation]):
    """Environment whose observation is a vector in [-1, 1].

    cells: the canvas and its difference from the goal are averaged in cells x cells squares

    Its parts: goal minus canvas [cells^2 x 3]; canvas [cells^2 x 3]; the paints [k x 3]; the held paint, one of k + 1;
    load; shares of the strokes and of the minutes that are left.
    """

    def __init__(self, env: "gymnasium.Env[Observation, Any]", cells: int = 8) -> None:
        super().__init__(env)
        self._code = _VectorCode(env.observation_space, cells)
        self.observation_space = self._code.space

    def observation(self, observation: Observation) -> NDArray[np.float32]:
        """Returns the vector of an observation."""
        return self._code.vector(observation)


class VectorObservations(VectorObservationWrapper):
    """Vector environment whose observations are vectors [n, numbers], as of VectorObservation."""

    def __init__(self, env: VectorEnv[Any, Any, Any], cells: int = 8) -> None:
        super().__init__(env)
        self._code = _VectorCode(env.single_observation_space, cells)
        self.single_observation_space = self._code.space
        self.observation_space = batch_space(self._code.space, env.num_envs)

    def observations(self, observations: Observation) -> NDArray[np.float32]:
        """Returns the vectors of observations."""
        several = [{name: part[at] for name, part in observations.items()} for at in range(self.num_envs)]
        return np.stack([self._code.vector(one) for one in several])


class _VectorCode:
    """Code from observations to vectors. Raises ConfigError for an environment with other observations."""

    def __init__(self, space: "gymnasium.Space[Any]", cells: int) -> None:
        if not (isinstance(space, spaces.Dict) and {"canvas", "goal", "paints", "held"} <= set(space.spaces)):
            raise ConfigError(
                "The observations of this environment have no canvas and goal; wrap one of frida-painter."
            )
        picture = space["canvas"].shape or (0, 0)
        if not (type(cells) is int and 1 <= cells <= min(_MAX_CELLS, *picture[:2])):
            raise ConfigError(f"{cells!r} cells were asked for; give from 1 to {min(_MAX_CELLS, *picture[:2])}.")
        self._cells, self._held = cells, int(space["held"].n)  # type: ignore[attr-defined]
        self._most = [float(space[name].high[0]) for name in ("strokes_left", "minutes_left")]  # type: ignore[attr-defined]
        size = 6 * cells**2 + 3 * (self._held - 1) + self._held + 3
        self.space = spaces.Box(-1.0, 1.0, (size,), np.float32)

    def vector(self, observation: Observation) -> NDArray[np.float32]:
        canvas, goal = (self._squares(observation[name]) for name in ("canvas", "goal"))
        held = np.zeros(self._held, np.float32)
        held[int(observation["held"])] = 1
        left = [
            observation[name][0] / most for name, most in zip(("strokes_left", "minutes_left"), self._most, strict=True)
        ]
        parts = (goal - canvas, canvas, np.asarray(observation["paints"]), held, observation["load"], np.array(left))
        return np.concatenate([np.asarray(part, np.float32).ravel() for part in parts])

    def _squares(self, picture: NDArray[np.uint8]) -> NDArray[np.float32]:
        small = cv2.resize(picture, (self._cells, self._cells), interpolation=cv2.INTER_AREA)
        return np.asarray(small / 255, np.float32)
