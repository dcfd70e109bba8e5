"""Task of an environment: goals, paints, brush and budgets, and its spaces of actions and observations."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray
from torch import Tensor

from frida_painter import images
from frida_painter.brush.kinds import BrushKind, brush_kind
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import ConfigError
from frida_painter.frames import PixelGrid
from frida_painter.palette import MAX_COLORS, Palette, from_hex
from frida_painter_lab import targets
from frida_painter_lab.env.actions import NUMBERS, StrokeCode
from frida_painter_lab.env.rewards import JUDGES, SSIM_WINDOW

Picture = str | Path | Tensor | NDArray[Any]
"""Picture: a file, sRGB [3, H, W] in [0, 1], or bytes [H, W, 3]."""
Paints = int | Palette | Sequence[str | Sequence[float]]
"""Paints: how many are mixed for each goal, or their colours."""
_MAX_STROKES, _MAX_MINUTES = 100_000, 100_000.0
_MIN_ROWS, _MAX_ROWS = 16, 1024
_MIN_SIDE = 8  # pixels of a goal
_PAINT_SEED = 0


@dataclass(frozen=True)
class PaintingTask:
    """Task of an environment.

    size, brush, ground: canvas, brush, and sRGB of the bare canvas
    grid: pixels of the observation
    goals: bytes [g, rows, columns, 3], of which each episode has one
    mixed: the paints as they were given
    palettes: colours of the paints for each goal, [g, k, 3]
    strokes, minutes: budgets of an episode
    judge: name of the judge
    """

    size: CanvasSize
    brush: BrushKind
    ground: tuple[float, float, float]
    grid: PixelGrid
    goals: NDArray[np.uint8]
    mixed: Paints
    palettes: Tensor
    strokes: int
    minutes: float
    judge: str

    @classmethod
    def of(
        cls,
        canvas: CanvasSize | str = "20x16cm",
        *,
        brush: str = "medium",
        paints: Paints = 8,
        goal: Picture | Sequence[Picture] | None = None,
        strokes: int = 100,
        minutes: float = 120.0,
        judge: str = "psnr",
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
        judge: psnr, ssim or perceptual (judges.py)
        rows: height of the observed pictures in pixels
        ground: colour of the bare canvas
        """
        size = CanvasSize.of(canvas)
        _require_whole("strokes", strokes, 1, _MAX_STROKES)
        _require_whole("rows", rows, _MIN_ROWS, _MAX_ROWS)
        if not (isinstance(minutes, int | float) and 0 < minutes <= _MAX_MINUTES):
            raise ConfigError(f"{minutes!r} minutes were given; give a number above 0, at most {_MAX_MINUTES:g}.")
        if judge not in JUDGES:
            raise ConfigError(f"The judge {str(judge)[:40]!r} was given; take {', '.join(JUDGES)}.")
        grid = PixelGrid.of_height(size, rows)
        if judge == "ssim" and not min(grid.rows, grid.columns) >= SSIM_WINDOW:
            raise ConfigError(
                f"The judge ssim compares windows of {SSIM_WINDOW} x {SSIM_WINDOW} pixels, and the observed pictures "
                f"are {grid.columns} x {grid.rows}; give more rows, or take another judge."
            )
        goals = [_fit(one, grid) for one in _each(goal)]
        palettes = torch.stack([_palette(paints, images.from_uint8(one)) for one in goals])
        red, green, blue = _color(ground).tolist()
        return cls(
            size, brush_kind(brush), (red, green, blue), grid, np.stack(goals), paints, palettes,
            strokes, float(minutes), judge,
        )  # fmt: skip

    @property
    def paints(self) -> int:
        """Number of paints."""
        return self.palettes.shape[1]

    @property
    def code(self) -> StrokeCode:
        """Code between actions and strokes."""
        return StrokeCode(self.size, self.brush.limits.within(self.size), self.paints)

    def action_space(self, batch: int | None = None) -> spaces.Box:
        """Returns the space of a stroke, [7], or of a batch of strokes, [batch, 7]."""
        shape = (NUMBERS,) if batch is None else (batch, NUMBERS)
        return spaces.Box(-1.0, 1.0, shape, np.float32)

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

    def with_goal(self, picture: Picture) -> "PaintingTask":
        """Returns the task with this goal alone, and as many paints. Raises ImageError and ConfigError."""
        goal = _fit(picture, self.grid)
        palette = _palette(self.mixed, images.from_uint8(goal))
        return replace(self, goals=goal[None], palettes=palette[None])


def goal_of(options: Mapping[str, Any] | None) -> Picture | None:
    """Returns the goal among the options of a reset, None if there is none. Raises ConfigError for other options."""
    given = dict(options or {})
    goal: Picture | None = given.pop("goal", None)
    if given:
        raise ConfigError(f"A reset was given the option {str(next(iter(given)))[:40]!r}; its only option is goal.")
    return goal


def choose_goal(random: np.random.Generator, count: int) -> int:
    """Returns the number of an episode's goal."""
    return int(random.integers(count))


def require_render_mode(mode: str | None) -> None:
    """Raises ConfigError for an unknown render mode."""
    if mode not in (None, "rgb_array"):
        raise ConfigError(f"The render mode {mode!r} was given; it is rgb_array, or none.")


def beside(goal: NDArray[np.uint8], canvas: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Returns the goal and the canvas beside each other, [rows, 2 columns + 4, 3]."""
    gap = np.full((len(goal), 4, 3), 255, np.uint8)
    return np.concatenate((goal, gap, canvas), 1)


def require_seed(seed: int | None) -> int | None:
    """Returns the seed of an environment. Raises ConfigError if it is no whole number of at least 0."""
    if seed is not None:
        _require_whole("the seed", seed, 0, 2**63 - 1)
    return seed


def _require_whole(what: str, value: object, least: int, most: int) -> None:
    if not (isinstance(value, int | np.integer) and not isinstance(value, bool) and least <= value <= most):
        raise ConfigError(f"{str(value)[:40]!r} was given for {what}; it is a whole number from {least} to {most}.")


def _each(goal: Picture | Sequence[Picture] | None) -> Sequence[Picture]:
    """Returns the pictures of a goal. Raises ConfigError if there is none."""
    if goal is None:
        return [Path(targets.__file__).with_name(f"{name}.jpg") for name in targets.SHIPPED]
    if isinstance(goal, str | Path | Tensor | np.ndarray):
        return [goal]
    pictures = list(goal)
    if not pictures:
        raise ConfigError("No goal was given; give a picture, or leave it out for photographs of the project.")
    return pictures


def _fit(picture: Picture, grid: PixelGrid) -> NDArray[np.uint8]:
    """Returns a goal as bytes [rows, columns, 3] that fill the canvas. Raises ImageError and ConfigError."""
    if isinstance(picture, str | Path):
        whole = images.load(Path(picture))
    elif isinstance(picture, np.ndarray) and picture.dtype == np.uint8 and picture.ndim == 3 and picture.shape[2] == 3:
        whole = images.from_uint8(picture)
    elif isinstance(picture, Tensor) and picture.dim() == 3 and len(picture) == 3:
        whole = picture.detach().cpu().float()
    else:
        raise ConfigError(
            f"A goal of type {type(picture).__name__} and shape {tuple(getattr(picture, 'shape', ()))} was given; give "
            "a file, a tensor [3, H, W] in [0, 1], or bytes [H, W, 3]."
        )
    if not (min(whole.shape[1:]) >= _MIN_SIDE and bool(((whole >= 0) & (whole <= 1)).all())):
        raise ConfigError(
            f"A goal of {whole.shape[1]} x {whole.shape[2]} pixels with values outside [0, 1], or below {_MIN_SIDE} "
            "pixels, was given; give sRGB in [0, 1]."
        )
    return images.to_uint8(images.resize_by_area(whole, grid.rows, grid.columns))


def _palette(paints: Paints, goal: Tensor) -> Tensor:
    """Returns the colours of the paints [k, 3] for a goal [3, rows, columns]. Raises ConfigError."""
    if isinstance(paints, Palette):
        return paints.color.float()
    if isinstance(paints, int | np.integer):
        _require_whole("paints", paints, 1, MAX_COLORS)
        pixels = goal.flatten(1).T
        return Palette.cluster(pixels, torch.ones(len(pixels)), int(paints), _PAINT_SEED).color.float()
    if isinstance(paints, str) or not len(paints):
        raise ConfigError(f"The paints {paints!r} were given; give their number, or a list such as ['#222', '#a33'].")
    return Palette(torch.stack([_color(paint) for paint in paints])).color


def _color(color: str | Sequence[float]) -> Tensor:
    """Returns sRGB [3] of "#a33", "#aa3333", or three numbers in [0, 1]. Raises ConfigError."""
    if isinstance(color, str):
        short = len(color) == 4 and color.startswith("#")
        return from_hex("#" + "".join(2 * digit for digit in color[1:]) if short else color)
    numbers = torch.as_tensor(np.asarray(color, np.float32))
    if numbers.shape != (3,) or not bool(((numbers >= 0) & (numbers <= 1)).all()):
        raise ConfigError(
            f"The colour {str(color)[:40]} was given; write it like #b97f2c, or as three numbers in [0, 1]."
        )
    return numbers
