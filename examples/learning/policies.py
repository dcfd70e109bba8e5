"""Policies to compare with: random strokes, the best of some random strokes, and the planner.

A policy is called with an observation and returns the action. `play` paints episodes with one. For methods of learning
that take no pictures, wrappers turn observations into one vector.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import Any

import cv2
import gymnasium
import numpy as np
import torch
from gymnasium import spaces
from gymnasium.vector import VectorEnv
from gymnasium.wrappers import TransformObservation
from gymnasium.wrappers.vector import VectorizeTransformObservation
from numpy.typing import NDArray

from frida_painter.errors import ConfigError
from frida_painter.objectives.image import ImageTerm
from frida_painter.objectives.objective import Goal
from frida_painter.planning.placement import Placement, displace_strokes
from frida_painter.planning.planner import Planner
from frida_painter.planning.settings import PlannerSettings
from frida_painter.strokes.palette import Palette
from frida_painter.strokes.plan import Plan
from frida_painter.strokes.strokes import Strokes
from frida_painter.system import images
from frida_painter_lab.env.actions import NUMBERS
from frida_painter_lab.env.renderer_env import CanvasStack
from frida_painter_lab.env.task import Observation, PaintingTask

Action = NDArray[np.float32]
Policy = Callable[[Observation], Action]


class RandomPolicy:
    """Policy of random strokes.

    batch: strokes of an action; None for one
    """

    def __init__(self, seed: int = 0, batch: int | None = None) -> None:
        self._random = np.random.default_rng(seed)
        self._shape = (NUMBERS,) if batch is None else (batch, NUMBERS)

    def __call__(self, observation: Observation) -> Action:
        """Returns a random action."""
        return self._random.uniform(-1, 1, self._shape).astype(np.float32)


class GreedyPolicy:
    """Policy of the best of some random strokes: the one whose mark, in its best paint, lowers the squared error most.

    task: that of the environment (`env.unwrapped.task`)
    candidates: number of random strokes
    """

    def __init__(self, task: PaintingTask, candidates: int = 64, seed: int = 0) -> None:
        self._task, self._random = task, np.random.default_rng(seed)
        black = replace(task, ground=(0.0, 0.0, 0.0))  # coverage is what white strokes leave on black canvases
        self._stack, self._white = CanvasStack(black, candidates), torch.ones(task.paints, 3)
        self._all = np.arange(candidates)

    def __call__(self, observation: Observation) -> Action:
        """Returns the stroke after which the canvas should be nearest to the goal."""
        action = self._random.uniform(-1, 1, (len(self._all), NUMBERS)).astype(np.float32)
        strokes, _ = self._task.code.decode(action, self._white)
        self._stack.clear(np.ones(len(action), np.bool_))
        self._stack.paint(strokes, self._all)
        coverage = self._stack.pictures[:, 0].flatten(1)  # [n, pixels]
        canvas, goal = (
            torch.from_numpy(observation[name].reshape(-1, 3).astype(np.float32) / 255) for name in ("canvas", "goal")
        )
        # |canvas + a (paint - canvas) - goal|^2 - |canvas - goal|^2 = 2 a (canvas - goal)(paint - canvas) + a^2 (...)^2
        paints = torch.from_numpy(observation["paints"])
        way = paints[:, None] - canvas  # [k, pixels, 3]
        slope, square = 2 * ((canvas - goal) * way).sum(2), way.square().sum(2)
        change = coverage @ slope.T + coverage.square() @ square.T  # [n, k]
        best, paint = divmod(int(change.argmin()), len(paints))
        action[best, 6] = (paint + 0.5) / len(paints) * 2 - 1
        return action[best]


class PlannerPolicy:
    """Policy of the project's planner: it plans all strokes that are left, and replans them for the seen canvas.

    task: that of the environment
    every: strokes after which it replans
    effort: factor of the usual number of iterations
    batch: strokes of an action; None for one

    It learns the robot's placement from its strokes, as a painting does.
    """

    def __init__(
        self, task: PaintingTask, *, every: int = 10, effort: float = 0.5, batch: int | None = None, seed: int = 0
    ) -> None:
        self._task, self._every, self._effort, self._batch, self._seed = task, every, effort, batch, seed
        self._left, self._painted = -1, list[Plan]()
        self._plan: Plan

    def __call__(self, observation: Observation) -> Action:
        """Returns the next stroke or batch of the plan."""
        left = round(float(observation["strokes_left"][0]))
        seen = images.from_uint8(observation["canvas"])
        if left != self._left:
            self._begin(observation, seen, left)
        elif len(self._painted) >= self._every:
            self._look(seen)
        count = 1 if self._batch is None else self._batch
        next_strokes = self._plan.part(slice(0, count))
        self._painted += [next_strokes]
        self._plan, self._left = self._plan.part(slice(count, None)), left - count
        action = self._task.code.encode(self._send(next_strokes), next_strokes.paint)
        return action[0] if self._batch is None else action

    def _begin(self, observation: Observation, seen: torch.Tensor, left: int) -> None:
        task, palette = self._task, Palette(torch.from_numpy(observation["paints"]))
        picture = images.from_uint8(observation["goal"])
        settings = PlannerSettings.of(
            canvas=task.grid.size, ground=task.ground, brushes=task.brush.name, render_height=max(task.grid.rows, 64),
            effort=self._effort, seed=self._seed, layers=1, focus="none", paints="any",
        )  # fmt: skip
        self._planner = Planner(Goal((ImageTerm(picture, wanted=picture),)), settings)
        self._plan = self._planner.bind_to_palette(self._planner.plan(seen, left, task.paints), seen, palette)
        self._placement, self._before, self._painted = Placement.unknown(), seen, list[Plan]()

    def _look(self, seen: torch.Tensor) -> None:
        """Learns from the strokes since the last look, and replans the rest."""
        batch = reduce(Plan.followed_by, self._painted)
        self._placement = self._planner.locate(batch, self._placement, self._before, seen)
        self._plan = self._planner.replan(self._plan, seen)
        self._before, self._painted = seen, []

    def _send(self, plan: Plan) -> Strokes:
        """Returns the strokes corrected for the placement error, kept on the canvas."""
        x, y, turn = self._placement.error
        cos, sin = math.cos(turn), math.sin(turn)
        back = -(cos * x + sin * y), sin * x - cos * y, -turn  # the inverse of a turn and a shift
        size = self._task.grid.size
        return displace_strokes(plan.strokes, back, size).project(self._task.code.limits, size)


@dataclass(frozen=True)
class Episode:
    """Result of an episode.

    score: of the judge, of the last canvas
    gain: sum of the rewards
    strokes: number of painted strokes
    minutes: of the robot; None on the renderer
    """

    score: float
    gain: float
    strokes: int
    minutes: float | None


def play(env: "gymnasium.Env[Observation, Action]", policy: Policy, seeds: Sequence[int]) -> list[Episode]:
    """Paints an episode for each seed with a policy, and returns the results."""
    found = []
    for seed in seeds:
        observation, info = env.reset(seed=seed)
        gain, ended = 0.0, False
        while not ended:
            observation, reward, over, cut, info = env.step(policy(observation))
            gain, ended = gain + float(reward), over or cut
        found.append(Episode(float(info["score"]), gain, int(info["strokes"]), info.get("minutes")))
    return found


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
