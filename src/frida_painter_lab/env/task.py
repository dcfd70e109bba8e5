"""Task of an environment: goals, paints, brush and budgets, its spaces of actions and observations; the judges."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.brush.kinds import BrushKind, brush_kind
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import ConfigError
from frida_painter.frames import PixelGrid
from frida_painter.strokes.palette import MAX_COLORS, AnyColor, Palette, as_color
from frida_painter.system import images
from frida_painter.system.images import AnyPicture
from frida_painter_lab import targets
from frida_painter_lab.env.actions import NUMBERS, StrokeCode

Observation = dict[str, Any]
Paints = int | Palette | Sequence[AnyColor]
"""Paints: how many are mixed for each goal, or their colours."""
Judge = Callable[[Tensor, Tensor], NDArray[np.float64]]
"""Returns a number [n], more for a better one, for true canvases and their goals, sRGB [n, 3, rows, columns] each."""
JUDGES = ("psnr", "ssim", "perceptual")
"""Names of the judges; the gain of the judge is the reward of a step."""
_SSIM_WINDOW = 11  # pixels
_MIN_ERROR = 1e-8
_MIN_SIDE = 8  # pixels of a goal
_PAINT_SEED = 0


def open_judge(name: str, grid: PixelGrid) -> Judge:
    """Returns a judge by its name, for pictures on that grid.

    "psnr" is in dB, "ssim" in [-1, 1], "perceptual" minus the distance of features of a network, which must be fetched.
    Raises ConfigError for another name or a grid that is too small, WeightsError if the network is missing.
    """
    if name not in JUDGES:
        raise ConfigError(f"The judge {str(name)[:40]!r} was given; take {', '.join(JUDGES)}.")
    if name == "ssim" and not min(grid.rows, grid.columns) >= _SSIM_WINDOW:
        raise ConfigError(
            f"The judge ssim compares windows of {_SSIM_WINDOW} x {_SSIM_WINDOW} pixels, and the observed pictures "
            f"are {grid.columns} x {grid.rows}; give more rows, or take another judge."
        )
    if name == "psnr":
        return _judge_errors
    from frida_painter.objectives.encoders.loading import EncoderRegistry  # loaded here because few callers need it
    from frida_painter_lab.measures import perceptual_distance, ssim

    network = EncoderRegistry().style() if name == "perceptual" else None

    def judge_each(canvas: Tensor, goal: Tensor) -> NDArray[np.float64]:
        pairs = zip(canvas.contiguous(), goal.contiguous(), strict=True)
        found = (-perceptual_distance(network, *pair) if network else ssim(*pair) for pair in pairs)
        return np.array([*found], np.float64)

    return judge_each


def _judge_errors(canvas: Tensor, goal: Tensor) -> NDArray[np.float64]:
    error = (canvas - goal).square_().mean((1, 2, 3)).double().numpy()
    return np.asarray(-10 * np.log10(np.maximum(error, _MIN_ERROR)), np.float64)


@dataclass(frozen=True)
class PaintingTask:
    """Task of an environment.

    grid: canvas, in pixels of the observation
    brush, ground: brush, and sRGB of the bare canvas
    goals: bytes [g, rows, columns, 3], of which each episode has one
    mixed: the paints as they were given
    palettes: colours of the paints for each goal, [g, k, 3]
    strokes, minutes: budgets of an episode
    """

    grid: PixelGrid
    brush: BrushKind
    ground: tuple[float, float, float]
    goals: NDArray[np.uint8]
    mixed: Paints
    palettes: Tensor
    strokes: int
    minutes: float

    @classmethod
    def of(
        cls,
        canvas: CanvasSize | str = "20x16cm",
        *,
        brush: str = "medium",
        paints: Paints = 8,
        goal: AnyPicture | Sequence[AnyPicture] | None = None,
        strokes: int = 100,
        minutes: float = 120.0,
        rows: int = 64,
        ground: str = "#ffffff",
    ) -> Self:
        """Returns the task of these settings. Raises ConfigError and ImageError.

        canvas: size such as "20x16cm"
        brush: fine, medium, broad, or that of a plug-in
        paints: number of paints, mixed for each goal; or their colours, such as ["#222", "#a33"]
        goal: picture, or several of which each episode has one. None: some photographs of the project
        strokes: most strokes of an episode
        minutes: most minutes that the robot takes in an episode
        rows: height of the observed pictures in pixels
        ground: colour of the bare canvas
        """
        require_whole("strokes", strokes, 1, 100_000)
        require_whole("rows", rows, 16, 1024)
        if not (isinstance(minutes, int | float) and 0 < minutes <= 100_000):
            raise ConfigError(f"{minutes!r} minutes were given; give a number above 0, at most 100000.")
        grid = PixelGrid.of_height(CanvasSize.of(canvas), rows)
        if goal is None:
            goal = [target.picture for target in targets.load_shipped_targets()]
        pictures = list(goal) if isinstance(goal, Sequence) and not isinstance(goal, str) else [goal]
        goals = [_fit(one, grid) for one in pictures]
        if not goals:
            raise ConfigError("No goal was given; give a picture, or leave it out for photographs of the project.")
        palettes = torch.stack([_palette(paints, images.from_uint8(one)) for one in goals])
        held, bare = brush_kind(brush), as_color(_in_full(ground))
        return cls(grid, held, bare, np.stack(goals), paints, palettes, strokes, float(minutes))

    @property
    def paints(self) -> int:
        """Number of paints."""
        return self.palettes.shape[1]

    @property
    def code(self) -> StrokeCode:
        """Code between actions and strokes."""
        return StrokeCode(self.grid.size, self.brush.limits.within(self.grid.size), self.paints)

    def action_space(self, batch: int | None = None) -> spaces.Box:
        """Returns the space of a stroke, [7], or of a batch of strokes, [batch, 7]."""
        return spaces.Box(-1.0, 1.0, (NUMBERS,) if batch is None else (batch, NUMBERS), np.float32)

    def observation_space(self) -> spaces.Dict:
        """Returns the space of observations.

        canvas: bytes [rows, columns, 3], straight on; in the studio as the camera sees it
        goal: bytes of the same size
        paints: sRGB [k, 3]
        held: paint on the brush, from 1; 0 for a clean brush
        load: share of a dip that is left on the brush, [1]
        strokes_left, minutes_left: what is left of the budgets, [1]
        """
        picture = spaces.Box(0, 255, (self.grid.rows, self.grid.columns, 3), np.uint8)
        return spaces.Dict(
            {
                "canvas": picture,
                "goal": picture,
                "paints": spaces.Box(0.0, 1.0, (self.paints, 3), np.float32),
                "held": spaces.Discrete(self.paints + 1),
                "load": spaces.Box(0.0, 1.0, (1,), np.float32),
                "strokes_left": spaces.Box(0.0, float(self.strokes), (1,), np.float32),
                "minutes_left": spaces.Box(0.0, self.minutes, (1,), np.float32),
            }
        )

    def for_reset(self, options: Mapping[str, Any] | None) -> "PaintingTask":
        """Returns the task of an episode: with the goal of a reset's options alone, if they have one.

        Raises ConfigError for other options, and ImageError.
        """
        given = dict(options or {})
        picture: AnyPicture | None = given.pop("goal", None)
        if given:
            raise ConfigError(f"A reset was given the option {str(next(iter(given)))[:40]!r}; its only option is goal.")
        if picture is None:
            return self
        goal = _fit(picture, self.grid)
        return replace(self, goals=goal[None], palettes=_palette(self.mixed, images.from_uint8(goal))[None])


def open_task(*, judge: str = "psnr", **settings: Any) -> tuple[PaintingTask, Judge]:
    """Returns the task of the settings of `PaintingTask.of`, and its judge: psnr, ssim or perceptual."""
    task = PaintingTask.of(**settings)
    return task, open_judge(judge, task.grid)


def require_render_mode(mode: str | None) -> None:
    """Raises ConfigError for an unknown render mode."""
    if mode not in (None, "rgb_array"):
        raise ConfigError(f"The render mode {mode!r} was given; it is rgb_array, or none.")


def beside(goal: NDArray[np.uint8], canvas: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Returns the goal and the canvas beside each other, [rows, 2 columns + 4, 3]."""
    return np.concatenate((goal, np.full((len(goal), 4, 3), 255, np.uint8), canvas), 1)


def require_seed(seed: int | None) -> int | None:
    """Returns the seed of an environment. Raises ConfigError if it is no whole number of at least 0."""
    if seed is not None:
        require_whole("the seed", seed, 0, 2**63 - 1)
    return seed


def require_whole(what: str, value: object, least: int, most: int) -> None:
    """Raises ConfigError unless a value is a whole number within limits."""
    if not (isinstance(value, int | np.integer) and not isinstance(value, bool) and least <= value <= most):
        raise ConfigError(f"{str(value)[:40]!r} was given for {what}; it is a whole number from {least} to {most}.")


def _fit(picture: AnyPicture, grid: PixelGrid) -> NDArray[np.uint8]:
    """Returns a goal as bytes [rows, columns, 3] that fill the canvas. Raises ImageError and ConfigError."""
    whole = images.as_picture(picture).detach().cpu().float()
    if not min(whole.shape[1:]) >= _MIN_SIDE:
        raise ConfigError(
            f"A goal of {whole.shape[1]} x {whole.shape[2]} pixels was given; each side has at least {_MIN_SIDE}."
        )
    return images.to_uint8(images.resize_by_area(whole, grid.rows, grid.columns))


def _palette(paints: Paints, goal: Tensor) -> Tensor:
    """Returns the colours of the paints [k, 3] for a goal [3, rows, columns]. Raises ConfigError."""
    if isinstance(paints, int | np.integer):
        require_whole("paints", paints, 1, MAX_COLORS)
        pixels = goal.flatten(1).T
        return Palette.cluster(pixels, torch.ones(len(pixels)), int(paints), _PAINT_SEED).color.float()
    if not isinstance(paints, Palette):
        paints = Palette(paints if isinstance(paints, str) else [*map(_in_full, paints)])
    return paints.color.float()


def _in_full(color: AnyColor) -> AnyColor:
    """Returns "#a33" as "#aa3333", and any other colour as it is."""
    if isinstance(color, str) and len(color) == 4 and color.startswith("#"):
        return "#" + "".join(2 * digit for digit in str(color)[1:])
    return color
