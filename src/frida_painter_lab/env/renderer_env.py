"""Environments of the renderer alone: no robot, no camera and no wet paint, so thousands of strokes a second.

Actions and observations are those of the virtual studio, so what was learned here can be tried there. The marks are
those of the stroke model, which the planner uses. The brush runs dry and is dipped as in the studio; nothing takes
time, so `minutes_left` stays as it is.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
import torch
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.brush.table import cached_table
from frida_painter.brush.weights import load_stroke_model
from frida_painter.errors import ConfigError, StepRefused
from frida_painter.render.painting import composite, marks_of
from frida_painter.strokes.strokes import Strokes
from frida_painter.system import images
from frida_painter_lab.env.actions import require_action
from frida_painter_lab.env.task import (
    Observation,
    PaintingTask,
    beside,
    open_task,
    require_render_mode,
    require_seed,
    require_whole,
)


class CanvasStack:
    """Several canvases of one size, on each of which one stroke is painted at a time.

    They lie one above the other in one picture, with strips between them that no canvas shows, so that one call of the
    renderer paints all strokes.
    """

    def __init__(self, task: PaintingTask, count: int) -> None:
        self._task, self.count = task, count
        self._model = cached_table(load_stroke_model(task.brush.name))
        self._rows = task.grid.rows
        # A mark reaches less than the brush's width beyond the path of its stroke, which lies on the canvas.
        self._pitch = self._rows + math.ceil(task.brush.width / task.grid.pitch[1]) + 1
        self._picture = torch.zeros(3, count * self._pitch, task.grid.columns)
        self.clear(np.ones(count, np.bool_))

    def clear(self, which: NDArray[np.bool_]) -> None:
        """Makes some canvases bare. which [n]: True for those"""
        stack = self._picture.view(3, self.count, self._pitch, -1)
        stack[:, torch.from_numpy(which)] = torch.tensor(self._task.ground)[:, None, None, None]

    def paint(self, strokes: Strokes, which: NDArray[np.int64]) -> None:
        """Paints strokes [k], each on the canvas of its number in `which` [k]."""
        if not len(which):
            return
        with torch.no_grad():
            marks = marks_of(strokes, self._model, self._task.grid)
            affine = marks.affine.clone()
            affine[:, :, 2] -= affine[:, :, 1] * torch.from_numpy(which)[:, None] * self._pitch
            self._picture = composite(marks.magnitude, affine, strokes.color, self._picture)

    @property
    def pictures(self) -> Tensor:
        """Pictures of the canvases, sRGB [n, 3, rows, columns] in [0, 1]; valid until the next stroke."""
        return self._picture.view(3, self.count, self._pitch, -1)[:, :, : self._rows].transpose(0, 1)


class RendererVectorEnv(VectorEnv[Observation, NDArray[np.float32], NDArray[Any]]):
    """Environments of the renderer, all painted at once.

    num_envs: their number
    render_mode: "rgb_array" for pictures of goal and canvas beside each other, one for each environment
    seed: seed of the first reset that gets none
    settings: those of `open_task`

    An environment whose episode is over is reset by the next step, which ignores its action (AutoresetMode.NEXT_STEP).
    Raises ConfigError and ImageError for wrong settings.
    """

    metadata = {  # noqa: RUF012, as gymnasium declares it
        "render_modes": ["rgb_array"], "render_fps": 10, "autoreset_mode": AutoresetMode.NEXT_STEP,
    }  # fmt: skip

    def __init__(
        self, num_envs: int = 1, *, render_mode: str | None = None, seed: int | None = None, **settings: Any
    ) -> None:
        require_whole("num_envs", num_envs, 1, 4096)
        require_render_mode(render_mode)
        self.task, self._judge = task, _ = open_task(**settings)
        self.num_envs, self.render_mode = num_envs, render_mode
        self.single_action_space, self.single_observation_space = task.action_space(), task.observation_space()
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self._first_seed = require_seed(seed)
        self._stack = CanvasStack(task, num_envs)
        self._random: list[np.random.Generator] = []
        self._goal = np.zeros((num_envs, *task.goals.shape[1:]), np.uint8)
        # In the order of the stack's picture, so that both are read along their rows
        self._wanted = torch.zeros(3, num_envs, *self._goal.shape[1:3]).transpose(0, 1)
        self._palette = torch.zeros(num_envs, task.paints, 3)
        self._held, self._left = np.zeros(num_envs, np.int64), np.zeros(num_envs)
        self._done, self._score = np.zeros(num_envs, np.int64), np.zeros(num_envs)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begins an episode in every environment.

        seed: one for each environment, or the first of consecutive ones
        options: {"goal": picture} for all environments until the next reset, or none
        Raises ConfigError and ImageError for wrong options.
        """
        episodes = self.task.for_reset(options)
        seed = self._first_seed if seed is None else seed
        if isinstance(seed, Sequence):
            if len(seed) != self.num_envs:
                raise ConfigError(f"{len(seed)} seeds were given; give {self.num_envs}, or a single one.")
            seeds = [require_seed(each) for each in seed]
        else:
            first = require_seed(seed)
            seeds = [None if first is None else first + number for number in range(self.num_envs)]
        self._first_seed, self._episodes = None, episodes
        self._random = [
            self._random[number] if self._random and each is None else gymnasium.utils.seeding.np_random(each)[0]
            for number, each in enumerate(seeds)
        ]
        self._begin(np.ones(self.num_envs, np.bool_))
        return self._observe(), self._info()

    def step(
        self, actions: NDArray[np.float32]
    ) -> tuple[Observation, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Paints one stroke in every environment. The reward is the gain of the judge.

        Raises StepRefused for actions outside the space, and before a reset; then nothing is painted.
        """
        if not self._random:
            raise StepRefused("No episode has begun; call reset before step.")
        given = require_action(actions, self.action_space.shape or ())
        over = self._done >= self.task.strokes
        going = np.flatnonzero(~over)
        self._paint(given[going], going)
        if over.any():
            self._begin(over)
        before = self._score.copy()
        if len(going):
            self._measure(~over)
        reward = np.where(over, 0.0, self._score - before)
        never = np.zeros(self.num_envs, np.bool_)
        return self._observe(), reward, never, (self._done >= self.task.strokes), self._info()

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Returns goal and canvas beside each other for each environment; None without a render mode."""
        if self.render_mode is None:
            return None
        return tuple(beside(goal, canvas) for goal, canvas in zip(self._goal, self._bytes(), strict=True))

    def _begin(self, which: NDArray[np.bool_]) -> None:
        """Begins an episode in some environments. which [n]: True for those"""
        for number in np.flatnonzero(which):
            goal = int(self._random[number].integers(len(self._episodes.goals)))
            self._goal[number], self._palette[number] = self._episodes.goals[goal], self._episodes.palettes[goal]
            self._wanted[number] = images.from_uint8(self._goal[number])
        self._stack.clear(which)
        for state in (self._held, self._left, self._done):
            state[which] = 0
        self._measure(which)

    def _paint(self, action: NDArray[np.float32], which: NDArray[np.int64]) -> None:
        strokes, paint = self.task.code.decode(action, self._palette[torch.from_numpy(which)])
        self._stack.paint(strokes, which)
        kind, paint_held = self.task.brush.for_any_order, paint.numpy() + 1
        use = kind.dip.used_by(kind.area(strokes)).double().numpy()
        dips = (self._held[which] != paint_held) | (self._left[which] < use)
        self._left[which] = np.where(dips, kind.dip.holds, self._left[which]) - use
        self._held[which] = paint_held
        self._done[which] += 1

    def _measure(self, which: NDArray[np.bool_]) -> None:
        canvases, goals = self._stack.pictures, self._wanted
        if not which.all():
            chosen = torch.from_numpy(which)
            canvases, goals = canvases[chosen], goals[chosen]
        self._score[which] = self._judge(canvases, goals)

    def _bytes(self) -> NDArray[np.uint8]:
        rounded = (self._stack.pictures * 255).add_(0.5).to(torch.uint8)
        return rounded.permute(0, 2, 3, 1).contiguous().numpy()

    def _observe(self) -> Observation:
        share = np.clip(self._left / self.task.brush.for_any_order.dip.holds, 0, 1)
        return {
            "canvas": self._bytes(),
            "goal": self._goal.copy(),
            "paints": self._palette.numpy().copy(),
            "held": self._held.copy(),
            "load": share[:, None].astype(np.float32),
            "strokes_left": (self.task.strokes - self._done)[:, None].astype(np.float32),
            "minutes_left": np.full((self.num_envs, 1), self.task.minutes, np.float32),
        }

    def _info(self) -> dict[str, Any]:
        return {"score": self._score.copy(), "strokes": self._done.copy()}


class RendererEnv(gymnasium.Env[Observation, NDArray[np.float32]]):
    """Environment of the renderer: RendererVectorEnv with one environment, which is not reset by itself."""

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012, as gymnasium declares it

    def __init__(self, *, render_mode: str | None = None, seed: int | None = None, **settings: Any) -> None:
        self._one = RendererVectorEnv(1, render_mode=render_mode, **settings)
        self.task, self.render_mode = self._one.task, render_mode
        self.action_space, self.observation_space = self._one.single_action_space, self._one.single_observation_space
        self._first_seed = require_seed(seed)
        self._over = False

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begins an episode with a bare canvas. options: {"goal": picture} or none. Raises ConfigError, ImageError."""
        seed = require_seed(self._first_seed if seed is None else seed)
        super().reset(seed=seed)
        self._first_seed = None
        own = int(self.np_random.integers(2**31)) if seed is None else seed
        observed, info = self._one.reset(seed=own, options=options)
        self._over = False
        return _first(observed), _first(info)

    def step(self, action: NDArray[np.float32]) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Paints one stroke. The reward is the gain of the judge.

        Raises StepRefused for an action outside the space, after the end, and before a reset.
        """
        if self._over:
            raise StepRefused(f"The episode is over after {self.task.strokes} strokes; call reset.")
        given = require_action(action, self.action_space.shape or ())
        observed, reward, _, cut, info = self._one.step(given[None])
        self._over = bool(cut[0])
        return _first(observed), float(reward[0]), False, self._over, _first(info)

    def render(self) -> NDArray[np.uint8] | None:
        """Returns goal and canvas beside each other; None without a render mode."""
        pictures = self._one.render()
        return None if pictures is None else pictures[0]


def _first(several: dict[str, Any]) -> dict[str, Any]:
    """Returns the values of the first environment."""
    return {name: value[0] for name, value in several.items()}
