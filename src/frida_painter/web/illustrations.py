"""Pictures of a plan for the page: as it grows, stroke after stroke, and as a whole."""

import json
import math
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from frida_painter import images, storage
from frida_painter.brush.stroke_model import StrokeModel
from frida_painter.export.bezier import plan_widths
from frida_painter.frames import CanvasSize, PixelGrid
from frida_painter.mixing.amounts import volumes
from frida_painter.mixing.paint_inventory import usual_paints
from frida_painter.mixing.recipe import recipes
from frida_painter.plan import Plan
from frida_painter.render import render
from frida_painter.render.plan_picture import render_on
from frida_painter.report.palette_sheet import palette_sheet, sheet_file
from frida_painter.report.story import paints
from frida_painter.strokes import Strokes

ROWS = 720
_PREVIEW_ROWS = 400
_FRAME_ROWS = 480
_FRAMES = 60
_POINTS = 9
_SHARE = 0.06  # of the time may go into previews


class Growing:
    """Draws a plan now and then while it is made; never so often that the planning becomes noticeably slower.

    canvas: the picture [3, H, W] of the canvas that the strokes go on; models: of the brushes, by their names;
    told: hears the name of each
    new picture in `folder`.
    """

    def __init__(
        self,
        folder: Path,
        canvas: Tensor,
        models: Mapping[str, StrokeModel],
        size: CanvasSize,
        told: Callable[[str], None],
    ) -> None:
        grid = PixelGrid.of_height(size, _PREVIEW_ROWS)
        self._folder, self._size, self._models, self._told = folder, size, models, told
        self._canvas = images.fit(canvas, grid.rows, grid.columns)
        self._number, self._next = 0, 0.0

    def hear(self, parts: Sequence[tuple[str, Strokes]]) -> None:
        """The strokes as they stand, in painting order: the brush, and what it paints."""
        started = time.monotonic()
        if not any(len(strokes) for _, strokes in parts) or started < self._next:
            return
        picture = self._canvas
        with torch.no_grad():
            for brush, strokes in parts:
                picture = render(strokes, self._models[brush], picture, self._size)
        name = f"growing-{self._number:04d}.jpg"
        images.save(picture, self._folder / name)
        (self._folder / f"growing-{self._number - 3:04d}.jpg").unlink(missing_ok=True)
        self._number += 1
        self._told(name)
        spent = time.monotonic() - started
        self._next = time.monotonic() + max(0.6, spent / _SHARE)


def illustrate(
    plan: Plan, models: Mapping[str, StrokeModel], canvas: Tensor, folder: Path, prefix: str = ""
) -> dict[str, Any]:
    """Writes pictures of a plan on a canvas [3, H, W] into `folder`, and returns what the page wants to know of it.

    These are: the whole plan, the canvas after so many strokes for the slider, where every stroke runs,
    and the palette; all their names begin with `prefix`. Raises StorageError.
    """
    frames = _frames(plan, models, canvas, folder, prefix)
    grid = PixelGrid.of_height(plan.canvas, ROWS)
    whole = render_on(plan, models, images.fit(canvas, grid.rows, grid.columns))
    images.save(whole, folder / f"{prefix}plan.jpg")
    for layer, part in plan.by_wells():
        images.save(palette_sheet(part), folder / f"{prefix}{sheet_file('palette.png', layer)}")
    storage.write_text(folder / f"{prefix}strokes.json", _strokes_json(plan, models))
    return {"prefix": prefix, "frames": frames, "strokes": len(plan), "palette": palette(plan)}


def palette(plan: Plan) -> list[dict[str, Any]]:
    """The paints of a plan: number, colour, strokes and share of the painted length."""
    return [
        {"number": paint.number, "hex": paint.hex, "strokes": paint.strokes, "share": round(paint.share, 4)}
        for paint in paints(plan)
    ]


def mixtures(plan: Plan) -> list[dict[str, Any]]:
    """How each paint of a plan is mixed from common acrylics, its millilitres, and whether that comes near."""
    found = recipes(plan.palette.color, usual_paints())
    return [
        {"recipe": recipe.words, "millilitres": round(amount, 1), "near": recipe.within_reach}
        for recipe, amount in zip(found, volumes(plan).tolist(), strict=True)
    ]


def _frames(plan: Plan, models: Mapping[str, StrokeModel], canvas: Tensor, folder: Path, prefix: str) -> list[int]:
    """Pictures of the canvas after so many strokes each; their numbers are returned."""
    count = min(_FRAMES, len(plan))
    ends = [len(plan) * (number + 1) // count for number in range(count)]
    grid = PixelGrid.of_height(plan.canvas, _FRAME_ROWS)
    picture = images.fit(canvas, grid.rows, grid.columns)
    images.save(picture, folder / f"{prefix}after-0.jpg")
    for begin, end in zip([0, *ends], ends, strict=False):
        picture = render_on(plan.part(slice(begin, end)), models, picture)
        images.save(picture, folder / f"{prefix}after-{end}.jpg")
    return [0, *ends]


def _strokes_json(plan: Plan, models: Mapping[str, StrokeModel]) -> str:
    """Where every stroke runs, in thousandths of the canvas's width from its top-left corner, how wide, which paint."""
    path = plan.canvas.on_page(plan.strokes.path(torch.linspace(0, 1, _POINTS))) / plan.canvas.width  # [n, t, 2]
    widths = plan_widths(plan, models) / plan.canvas.width
    return json.dumps(
        {
            "height": round(1000 * plan.canvas.height / plan.canvas.width, 2),
            "paths": [[[round(1000 * x, 1), round(1000 * y, 1)] for x, y in stroke] for stroke in path.tolist()],
            "widths": [round(1000 * width, 1) if math.isfinite(width) else 1.0 for width in widths.flatten().tolist()],
            "paint": plan.paint.tolist(),
        },
        separators=(",", ":"),
    )
