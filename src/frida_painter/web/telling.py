"""What a session's events become on the page: written events in the feed, and pictures beside it."""

import time
from collections.abc import Mapping
from dataclasses import dataclass, field

import torch
from torch import Tensor

from frida_painter import images
from frida_painter.brush.stroke_model import StrokeModel
from frida_painter.errors import StorageError
from frida_painter.frames import CanvasSize, PixelGrid
from frida_painter.report.difference import difference
from frida_painter.session.canvas_observer import TIMELAPSE_ROWS
from frida_painter.session.events import (
    BrushInHand,
    Dipped,
    Drying,
    Event,
    LastLookDoubted,
    LayerBegun,
    Looked,
    PaintsWanted,
    Planned,
    PlanningStep,
    Stopped,
    StrokeLeftOut,
    StrokePainted,
    TimelapseFrame,
    TouchCorrected,
)
from frida_painter.session.forecast import Forecast
from frida_painter.session.page_events import (
    Finishing,
    LookShown,
    Mixing,
    PhotographShown,
    PlanPreview,
    RestReplanned,
    TimeLeft,
)
from frida_painter.web.feed import Feed
from frida_painter.web.folder import PaintingFolder
from frida_painter.web.illustrations import Growing, illustrate

_KEPT = 4  # live photographs, of which the last is shown


@dataclass
class Reporter:
    """Listens to a painting session and tells the page; pictures go into the folder's `live`.

    done: strokes painted so far; seen [3, H, W]: the canvas as it was photographed last, before that: bare.
    """

    feed: Feed
    folder: PaintingFolder
    models: Mapping[str, StrokeModel]
    size: CanvasSize
    forecast: Forecast
    _photographs: int = field(default=0, init=False)
    _looks: int = field(default=0, init=False)
    _plans: int = field(default=0, init=False)
    done: int = field(default=0, init=False)
    seen: Tensor = field(init=False)
    _growing: Growing | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        grid = PixelGrid.of_height(self.size, TIMELAPSE_ROWS)
        self.seen = self._canvas = torch.ones(3, grid.rows, grid.columns)

    def hear(self, event: Event) -> None:
        """Tells it."""
        self.forecast.hear(event, time.monotonic())
        left = self.forecast.remaining
        match event:
            case PlanningStep(iteration=iteration, of=of, parts=parts):
                self.feed.step(iteration / of, left)
                if self._growing is not None:
                    self._growing.hear(parts)
            case Planned(done=done) if done > 0:
                self._replanned(event)
            case PaintsWanted():
                self.feed.tell(Mixing())
            case Dipped() | LayerBegun() | BrushInHand():
                self.feed.tell(event)
            case Drying():
                self.feed.tell(event)
                self.feed.tell(TimeLeft(round(left, 1)))
            case StrokePainted(done=done) | StrokeLeftOut(done=done):
                self.done = done
                self.feed.tell(event)
                self.feed.tell(TimeLeft(round(left, 1)))
            case TimelapseFrame(photograph=photograph, done=done):
                self._photograph(photograph, done)
            case Looked():
                self._looked(event)
            case Stopped() | Finishing() | TouchCorrected() | LastLookDoubted():
                self.feed.tell(event)
            case _:
                pass

    def _photograph(self, photograph: Tensor, done: int) -> None:
        self.seen = photograph
        name = f"photograph-{self._photographs:05d}.jpg"
        if self._save(photograph, name):
            self.feed.tell(PhotographShown(name, done))
            (self.folder.live / f"photograph-{self._photographs - _KEPT:05d}.jpg").unlink(missing_ok=True)
        self._photographs += 1

    def _looked(self, look: Looked) -> None:
        self._looks += 1
        rows, columns = look.expected.shape[1:]
        seen = images.fit(look.photograph, rows, columns)
        names = {part: f"look-{self._looks:03d}-{part}.jpg" for part in ("seen", "expected", "difference")}
        pictures = (look.photograph, look.expected, difference(look.expected, seen))
        kept = [self._save(picture, name) for name, picture in zip(names.values(), pictures, strict=True)]
        if all(kept):
            self.feed.tell(LookShown(look.done, **names))
        self._photograph(look.photograph, look.done)
        self._canvas = look.photograph
        self._growing = Growing(self.folder.live, look.photograph, self.models, self.size, self._tell_growing)

    def _replanned(self, planned: Planned) -> None:
        """The plan from here on, with pictures of every stroke, in a folder of the plan's own."""
        self._plans += 1
        try:
            told = illustrate(planned.plan, self.models, self._canvas, self.folder.live, f"plan-{self._plans}-")
        except StorageError:
            return
        self.feed.tell(RestReplanned(planned.done, round(planned.gain, 4), **told))

    def _tell_growing(self, name: str) -> None:
        self.feed.tell(PlanPreview(name))

    def _save(self, picture: Tensor, name: str) -> bool:
        try:
            images.save(picture, self.folder.live / name)
        except StorageError:
            return False
        return True
