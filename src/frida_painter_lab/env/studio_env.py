"""Environment of the virtual studio: an action is a stroke, or a batch of them, and then the camera looks.

The studio is the one of paintings, with its marks, paints, robot and camera, and with its hidden placement error. The
hand is that of paintings too: it dips when the brush runs dry, and washes it before another paint. The judge sees the
true canvas; the observation is the camera's picture of it.
"""

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

import gymnasium
import numpy as np
from numpy.typing import NDArray

from frida_painter.easel.order import EaselOrder, SimulationOrder
from frida_painter.easel.virtual_easel import assemble_easel
from frida_painter.errors import ConfigError, StepRefused
from frida_painter.session.hand import Hand
from frida_painter.session.observer import CanvasObserver, CanvasStart
from frida_painter.strokes.palette import Palette
from frida_painter.strokes.plan import Plan
from frida_painter.system import images
from frida_painter.virtual.studio import FREE, VirtualStudio
from frida_painter_lab.env.actions import require_action
from frida_painter_lab.env.task import Observation, PaintingTask, beside, open_task, require_render_mode, require_seed

_RENDER_ROWS = 480
_MAX_SEED = 2**31


class StudioEnv(gymnasium.Env[Observation, NDArray[np.float32]]):
    """Environment of the virtual studio.

    batch: number of strokes of an action, [batch, 7]. None: one stroke, [7].
    render_mode: "rgb_array" for pictures of the goal and of the true canvas beside each other.
    seed: seed of the first reset that gets none.
    settings: those of `open_task`.

    A reset opens a studio whose seed is drawn from that of the reset, with a bare canvas; its option `goal` is a
    picture for this episode. An episode is never terminated; it is truncated when the budget of strokes or of minutes
    is spent. A batch is painted whole, also if its minutes pass the budget.
    Raises ConfigError and ImageError for wrong settings.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012, as gymnasium declares it

    def __init__(
        self, *, batch: int | None = None, render_mode: str | None = None, seed: int | None = None, **settings: Any
    ) -> None:
        require_render_mode(render_mode)
        self.task, self._judge = open_task(**settings)
        if batch is not None and not (type(batch) is int and batch >= 1 and self.task.strokes % batch == 0):
            raise ConfigError(
                f"A batch of {batch!r} strokes was given; give a whole number that divides {self.task.strokes} strokes."
            )
        self.render_mode = render_mode
        space = self.task.action_space(batch)
        self._shape, self.action_space = space.shape, cast(gymnasium.Space[NDArray[np.float32]], space)
        self.observation_space = self.task.observation_space()
        self._first_seed = require_seed(seed)
        self._episode: _Episode | None = None

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Opens another studio with a bare canvas; returns the first observation.

        seed: with it, the episode is the same as after any other reset with this seed, byte for byte.
        options: {"goal": picture} or none.
        Raises ConfigError and ImageError for wrong options.
        """
        task = self.task.for_reset(options)
        super().reset(seed=require_seed(self._first_seed if seed is None else seed))
        self._first_seed = None
        number = int(self.np_random.integers(len(task.goals)))
        self.close()
        self._episode = _Episode(task, number, int(self.np_random.integers(_MAX_SEED)))
        self._score = self._measure(self._episode)
        return self._episode.observation, self._info(self._episode)

    def step(self, action: NDArray[np.float32]) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Paints the stroke or the batch, and looks. The reward is the gain of the judge.

        Raises StepRefused before anything moves: for an action outside the space, after the end, and before a reset.
        """
        episode = self._begun()
        if episode.is_over:
            raise StepRefused(
                f"The episode is over after {episode.done} strokes and {episode.minutes:.1f} minutes; call reset."
            )
        given = require_action(action, self._shape)
        episode.paint(given.reshape(-1, given.shape[-1]))
        before, self._score = self._score, self._measure(episode)
        return episode.observation, self._score - before, False, episode.is_over, self._info(episode)

    def render(self) -> NDArray[np.uint8] | None:
        """Returns the goal and the true canvas beside each other, 480 pixels high; None without a render mode."""
        if self.render_mode is None:
            return None
        episode = self._begun()
        canvas = images.to_uint8(episode.studio.truth(_RENDER_ROWS))
        goal = images.fit(images.from_uint8(episode.goal), *canvas.shape[:2])
        return beside(images.to_uint8(goal), canvas)

    def close(self) -> None:
        """Closes the studio."""
        if self._episode is not None:
            self._episode.studio.close()
        self._episode = None

    @property
    def studio(self) -> VirtualStudio:
        """Studio of this episode, for films and measurements; not for the one who learns. Raises StepRefused."""
        return self._begun().studio

    def _begun(self) -> "_Episode":
        if self._episode is None:
            raise StepRefused("No episode has begun; call reset first.")
        return self._episode

    def _measure(self, episode: "_Episode") -> float:
        canvas = episode.studio.truth(self.task.grid.rows)
        goal = images.from_uint8(episode.goal)
        return float(self._judge(images.fit(canvas, *goal.shape[1:])[None], goal[None])[0])

    def _info(self, episode: "_Episode") -> dict[str, Any]:
        return {"score": self._score, "strokes": episode.done, "minutes": episode.minutes}


class _Episode:
    """One painting in a studio of its own.

    goal: bytes [rows, columns, 3]
    done: painted strokes
    observation: of the last look
    """

    def __init__(self, task: PaintingTask, goal: int, seed: int) -> None:
        seeded = SimulationOrder(seed)
        order = EaselOrder(
            "virtual", task.grid.size, (task.brush.name,), Path(tempfile.gettempdir()), simulation=seeded
        )
        self.studio, easel = assemble_easel(order, FREE)
        easel.robot.connect()
        easel.camera.connect()
        self.goal, self.done = task.goals[goal], 0
        self._task, self._palette = task, Palette(task.palettes[goal])
        self._hand = Hand(easel, task.brush.for_any_order)
        self._observer = CanvasObserver(easel, CanvasStart(task.ground))
        self._hand.step_aside()
        self._observer.look(self._hand.last_motion, task.grid.rows)  # at the white canvas: learns the light
        easel.operator.tone(task.ground)
        easel.operator.fill_wells(self._palette)
        self._began = self._hand.last_motion
        self.observation = self._look()

    @property
    def minutes(self) -> float:
        """Minutes of the robot's clock since the beginning."""
        return (self._hand.last_motion - self._began) / 60

    @property
    def is_over(self) -> bool:
        """True if a budget is spent."""
        return self.done >= self._task.strokes or self.minutes >= self._task.minutes

    def paint(self, action: NDArray[np.float32]) -> None:
        """Paints the strokes of actions [n, 7] in their order, and looks. Raises StepRefused before anything moves."""
        task, code = self._task, self._task.code
        strokes, paint = code.decode(action, self._palette.color)
        plan = Plan.of(
            strokes, self._palette, paint, brush=task.brush.name, limits=code.limits, canvas=task.grid.size,
            ground=task.ground,
        )  # fmt: skip
        for each in self._hand.prepare(plan, self.done, task.strokes):
            self._hand.perform(each)
        self.done += len(plan)
        self.observation = self._look()

    def _look(self) -> Observation:
        """Returns what is observed now, with the arm out of the camera's view."""
        self._hand.step_aside()
        task, load = self._task, self._hand.load
        seen = self._observer.look(self._hand.last_motion, task.grid.rows)
        holds = task.brush.for_any_order.dip.holds
        return {
            "canvas": images.to_uint8(images.fit(seen, task.grid.rows, task.grid.columns)),
            "goal": self.goal.copy(),
            "paints": self._palette.color.numpy().astype(np.float32),
            "held": np.int64(0 if load.paint is None else load.paint + 1),
            "load": np.array([min(max(load.left / holds, 0.0), 1.0)], np.float32),
            "strokes_left": np.array([task.strokes - self.done], np.float32),
            "minutes_left": np.array([max(task.minutes - self.minutes, 0.0)], np.float32),
        }
