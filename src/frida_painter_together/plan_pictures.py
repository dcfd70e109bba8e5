"""Pictures of a plan for the studio's page: while it grows, stroke by stroke, and as a whole; its exports."""

import json
import math
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor

from frida_painter.brush.kinds import StrokeModel
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import FridaError, StorageError
from frida_painter.frames import PixelGrid
from frida_painter.render import render
from frida_painter.render.exporter import ExportOptions, export_plan
from frida_painter.render.painting import render_on
from frida_painter.report.painters import PERSON, find_painters
from frida_painter.report.story import paints
from frida_painter.report.vector import plan_widths, svg
from frida_painter.session import events
from frida_painter.session.events import Event
from frida_painter.strokes.plan import Plan
from frida_painter.strokes.strokes import Strokes
from frida_painter.system import images, storage

if TYPE_CHECKING:
    from frida_painter.runs.run import PaintingRun, RunOutcome

_ROWS = 720
_PREVIEW_ROWS = 400
_FRAME_ROWS = 480
_FRAMES = 60
_POINTS = 9
_SHARE = 0.06  # largest share of the time for previews


class GrowingPlan:
    """Draws previews of a plan during planning into `folder`, seldom enough not to slow it noticeably.

    canvas [3, H, W]: picture of the canvas below the strokes.
    models: stroke models by brush name.
    """

    def __init__(self, folder: Path, canvas: Tensor, models: Mapping[str, StrokeModel], size: CanvasSize) -> None:
        grid = PixelGrid.of_height(size, _PREVIEW_ROWS)
        self._folder, self._size, self._models = folder, size, models
        self._canvas = images.fit(canvas, grid.rows, grid.columns)
        self._number, self._next = storage.next_number(folder, "growing-", 0), 0.0

    def draw(self, parts: Sequence[tuple[str, Strokes]]) -> str:
        """Returns the name of a new picture of strokes, by brush in painting order; "" if none is due."""
        started = time.monotonic()
        if not any(len(strokes) for _, strokes in parts) or started < self._next:
            return ""
        picture = self._canvas
        with torch.no_grad():
            for brush, strokes in parts:
                picture = render(strokes, self._models[brush], picture, self._size)
        name = f"growing-{self._number:04d}.jpg"
        images.save(picture, self._folder / name)
        (self._folder / f"growing-{self._number - 3:04d}.jpg").unlink(missing_ok=True)
        self._number += 1
        self._next = time.monotonic() + max(0.6, (time.monotonic() - started) / _SHARE)
        return name


class PlanPictures:
    """Draws the plans of a painting into `folder`, for a page that shows it; a full disk costs only the pictures.

    bare [3, H, W]: bare canvas.
    in_turns: True for a painting without a goal, whose plan grows with every answer.
    """

    def __init__(
        self, folder: Path, bare: Tensor, models: Mapping[str, StrokeModel], size: CanvasSize, *, in_turns: bool = False
    ) -> None:
        self._folder, self._models, self._size, self._in_turns = folder, models, size, in_turns
        self._canvas = bare
        self._growing: GrowingPlan | None = None

    def hear(self, event: Event) -> Event:
        """Draws what an event tells of a plan; returns the event with the names of the pictures."""
        with suppress(StorageError):
            match event:
                case events.PlanningStep() if self._growing is not None:
                    return replace(event, picture=self._growing.draw(event.parts))
                case events.Looked(photograph=canvas) | events.CanvasPicture(canvas=canvas):
                    self._canvas = canvas
                    self._growing = GrowingPlan(self._folder, canvas, self._models, self._size)
                case events.Planned(plan=plan) if event.done > 0 or (self._in_turns and len(plan) > 0):
                    prefix = f"plan-{storage.next_number(self._folder, 'plan-')}-"
                    return replace(event, shown=draw_plan(plan, self._models, self._canvas, self._folder, prefix))
        return event


def draw_plan(
    plan: Plan, models: Mapping[str, StrokeModel], canvas: Tensor, folder: Path, prefix: str = ""
) -> dict[str, Any]:
    """Writes pictures of a plan on a canvas [3, H, W] into `folder`; returns facts about it for the page.

    The files are the whole plan, the canvas after several numbers of strokes for the slider, and the paths of all
    strokes. All names begin with `prefix`. Raises StorageError.
    """
    count = min(_FRAMES, len(plan))
    frames = [0, *(len(plan) * (number + 1) // count for number in range(count))]
    grid = PixelGrid.of_height(plan.canvas, _FRAME_ROWS)
    picture = images.fit(canvas, grid.rows, grid.columns)
    for begin, end in zip([0, *frames], frames, strict=False):
        picture = render_on(plan.part(slice(begin, end)), models, picture) if end else picture
        images.save(picture, folder / f"{prefix}after-{end}.jpg")
    grid = PixelGrid.of_height(plan.canvas, _ROWS)
    images.save(render_on(plan, models, images.fit(canvas, grid.rows, grid.columns)), folder / f"{prefix}plan.jpg")
    storage.write_text(folder / f"{prefix}strokes.json", _strokes_json(plan, models))
    palette = [
        {"number": paint.number, "hex": paint.hex, "strokes": paint.strokes, "share": round(paint.share, 4)}
        for paint in paints(plan)
    ]
    return {"prefix": prefix, "frames": frames, "strokes": len(plan), "palette": palette}


def _strokes_json(plan: Plan, models: Mapping[str, StrokeModel]) -> str:
    """Returns the path, width and paint of every stroke as JSON.

    Lengths are in thousandths of the canvas width, positions from its top-left corner.
    """
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


def add_results(run: "PaintingRun", outcome: "RunOutcome") -> None:
    """Exports the plan of a painting for other programs, and tells who painted what if a person painted too.

    A fault of the latter costs only this picture.
    """
    painted = Plan.load(outcome.folder)
    if len(painted):
        export(painted, run.planner.models, outcome.folder, run.spec.drying)
    with suppress(FridaError):
        found = find_painters(outcome.folder, run.planner.models)
        if found.of(PERSON) and outcome.painting is not None:
            found.save(outcome.folder, outcome.painting.photograph)


def export(plan: Plan, models: Mapping[str, StrokeModel], folder: Path, drying: float) -> None:
    """Writes strokes.svg, strokes.csv and strokes.gcode (GRBL, with a pause at every dip) into a folder.

    models: stroke models by brush name.
    drying: drying time of a layer in minutes.
    Raises StorageError.
    """
    storage.write_text(folder / "strokes.svg", svg(plan, plan_widths(plan, models)))
    export_plan(plan, folder / "strokes.csv")
    export_plan(plan, folder / "strokes.gcode", options=ExportOptions(drying=drying))
