"""Reports of a session to the page: events in the feed, and pictures beside it."""

import json
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from frida_painter import images, storage
from frida_painter.brush.kinds import StrokeModel
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import StorageError
from frida_painter.export.gcode import gcode
from frida_painter.export.vector import plan_widths, svg, table
from frida_painter.frames import PixelGrid
from frida_painter.hardware.gcode import Gcode
from frida_painter.mixing.recipe import PaintSet, volumes
from frida_painter.plan import Plan
from frida_painter.render import render
from frida_painter.render.painting import render_on
from frida_painter.report.sheets import difference, palette_sheet, sheet_file
from frida_painter.report.story import paints
from frida_painter.session import events, person_events
from frida_painter.session.choreography import BrushLoad, Choreography
from frida_painter.session.events import Event
from frida_painter.session.observer import TIMELAPSE_ROWS
from frida_painter.session.rehearsal import FlatbedWorkspace
from frida_painter.session.time_left import RemainingTime
from frida_painter.strokes import Strokes
from frida_painter_studio.studio_folder import Feed, PaintingFolder

# Pictures of a plan for the page: while it grows, stroke by stroke, and as a whole.

ROWS = 720
_PREVIEW_ROWS = 400
_FRAME_ROWS = 480
_FRAMES = 60
_POINTS = 9
_SHARE = 0.06  # largest share of the time for previews


class Growing:
    """Draws previews of a plan during planning, seldom enough not to slow it noticeably.

    canvas [3, H, W]: picture of the canvas below the strokes.
    models: stroke models by brush name.
    told: receives the name of each new picture in `folder`.
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
        self._number, self._next = storage.next_number(folder, "growing-", 0), 0.0

    def hear(self, parts: Sequence[tuple[str, Strokes]]) -> None:
        """Receives each brush and its current strokes, in painting order."""
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
    """Writes pictures of a plan on a canvas [3, H, W] into `folder`; returns facts about it for the page.

    The files are the whole plan, the canvas after several numbers of strokes for the slider, the paths of all
    strokes, and the palette. All names begin with `prefix`. Raises StorageError.
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
    """Returns the paints of a plan: number, colour, strokes and share of the painted length."""
    return [
        {"number": paint.number, "hex": paint.hex, "strokes": paint.strokes, "share": round(paint.share, 4)}
        for paint in paints(plan)
    ]


def mixtures(plan: Plan, owned: PaintSet) -> list[dict[str, Any]]:
    """Returns for each paint of a plan its recipe from the paints of a person and its millilitres.

    near: True if the recipe comes within reach of the paint's colour.
    """
    found = owned.mix(plan.palette.color)
    return [
        {"recipe": recipe.words, "millilitres": round(amount, 1), "near": recipe.within_reach}
        for recipe, amount in zip(found, volumes(plan).tolist(), strict=True)
    ]


def _frames(plan: Plan, models: Mapping[str, StrokeModel], canvas: Tensor, folder: Path, prefix: str) -> list[int]:
    """Writes pictures of the canvas after several numbers of strokes; returns these numbers."""
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


# Export of a plan for other programs and machines: its strokes as SVG, as a table, and as G-code.


def export(plan: Plan, models: Mapping[str, StrokeModel], folder: Path, drying: float) -> None:
    """Writes strokes.svg, strokes.csv and strokes.gcode (GRBL, with a pause at every dip) into a folder.

    models: stroke models by brush name.
    drying: drying time of a layer in minutes.
    Raises StorageError.
    """
    flatbed = FlatbedWorkspace()
    choreography = Choreography.of(flatbed.motion(plan.canvas), plan.brushes)
    actions = choreography.actions(plan, BrushLoad(), 0, len(plan))
    program = gcode(plan, list(actions), Gcode("grbl", flatbed.travel_speed), pauses=True, drying=60 * drying)
    storage.write_text(folder / "strokes.svg", svg(plan, plan_widths(plan, models)))
    storage.write_text(folder / "strokes.csv", table(plan))
    storage.write_text(folder / "strokes.gcode", program)


_AS_IT_IS = (
    events.Dipped, events.LayerBegun, events.BrushInHand, events.Stopped, events.Finishing, events.TouchCorrected,
    events.LastLookDoubted, person_events.PersonStrokePainted,
)  # fmt: skip
_KEPT = 4  # number of live photographs that are kept; the last one is shown


@dataclass
class Reporter:
    """Listener of a painting session that reports to the page; its pictures are in the folder's `live`.

    in_turns: True for a painting without a goal, whose plan grows with every answer.
    done: number of painted strokes.
    seen [3, H, W]: last photographed canvas, at first bare.
    """

    feed: Feed
    folder: PaintingFolder
    models: Mapping[str, StrokeModel]
    size: CanvasSize
    time_left: RemainingTime
    in_turns: bool = False
    _photographs: int = field(init=False)
    done: int = field(default=0, init=False)
    seen: Tensor = field(init=False)
    _growing: Growing | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        grid = PixelGrid.of_height(self.size, TIMELAPSE_ROWS)
        self._photographs = storage.next_number(self.folder.live, "photograph-", 0)
        self.seen = self._canvas = torch.ones(3, grid.rows, grid.columns)

    def hear(self, event: Event) -> None:
        """Reports an event."""
        self.time_left.hear(event, time.monotonic())
        left = self.time_left.remaining
        match event:
            case events.PlanningStep(iteration=iteration, of=of, parts=parts):
                self.feed.step(iteration / of, left)
                if self._growing is not None:
                    self._growing.hear(parts)
            case events.Planned(done=done, plan=plan) if done > 0 or (self.in_turns and len(plan) > 0):
                self._tell_replan(event)
            case events.PaintsWanted():
                self.feed.tell(events.Mixing())
            case events.Drying():
                self.feed.tell(event)
                self.feed.tell(events.TimeLeft(round(left, 1)))
            case events.StrokePainted(done=done) | events.StrokeLeftOut(done=done):
                self.done = done
                self.feed.tell(event)
                self.feed.tell(events.TimeLeft(round(left, 1)))
            case events.TimelapseFrame(photograph=photograph, done=done):
                self._photograph(photograph, done)
            case events.Looked():
                self._tell_look(event)
            case events.CanvasAssumed(canvas=canvas, done=done):
                self._photograph(canvas, done)
                self._go_on_from(canvas)
            case _ if isinstance(event, _AS_IT_IS):
                self.feed.tell(event)
            case _:
                pass

    def _photograph(self, photograph: Tensor, done: int) -> None:
        self.seen = photograph
        name = f"photograph-{self._photographs:05d}.jpg"
        if self._save(photograph, name):
            self.feed.tell(events.PhotographShown(name, done))
            (self.folder.live / f"photograph-{self._photographs - _KEPT:05d}.jpg").unlink(missing_ok=True)
        self._photographs += 1

    def _tell_look(self, look: events.Looked) -> None:
        number = storage.next_number(self.folder.live, "look-")
        rows, columns = look.expected.shape[1:]
        seen = images.fit(look.photograph, rows, columns)
        names = {part: f"look-{number:03d}-{part}.jpg" for part in ("seen", "expected", "difference")}
        pictures = (look.photograph, look.expected, difference(look.expected, seen))
        kept = [self._save(picture, name) for name, picture in zip(names.values(), pictures, strict=True)]
        if all(kept):
            self.feed.tell(events.LookShown(look.done, **names))
        self._photograph(look.photograph, look.done)
        self._go_on_from(look.photograph)

    def _go_on_from(self, canvas: Tensor) -> None:
        """Draws the next plan on this canvas [3, H, W]."""
        self._canvas = canvas
        self._growing = Growing(self.folder.live, canvas, self.models, self.size, self._tell_growing)

    def _tell_replan(self, planned: events.Planned) -> None:
        """Reports the new plan, with pictures of its strokes under a new prefix."""
        prefix = f"plan-{storage.next_number(self.folder.live, 'plan-')}-"
        try:
            told = illustrate(planned.plan, self.models, self._canvas, self.folder.live, prefix)
        except StorageError:
            return
        self.feed.tell(events.RestReplanned(planned.done, round(planned.gain, 4), **told))

    def _tell_growing(self, name: str) -> None:
        self.feed.tell(events.PlanPreview(name))

    def _save(self, picture: Tensor, name: str) -> bool:
        try:
            images.save(picture, self.folder.live / name)
        except StorageError:
            return False
        return True
