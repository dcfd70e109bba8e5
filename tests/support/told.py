"""Paintings of which a page is told, although nobody plans or paints."""

import contextlib
import json
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta

from PIL import Image
from playwright.sync_api import Page

from frida_painter.easel.kinds import JOURNAL, LIVE
from frida_painter.session.events import (
    Began,
    CommandDone,
    Dipped,
    DrawnRegion,
    Event,
    Finished,
    Looked,
    PaintingBegun,
    Paused,
    PersonMayPaint,
    PlanAdopted,
    Planned,
    ResultFound,
    Scheduled,
    StrokeOfPerson,
    StrokePainted,
    TimelapseFrame,
    record,
)
from frida_painter.system.event_log import FEED, EventLog
from frida_painter_studio.store import PaintingStore
from frida_painter_studio.studio_folder import WorkerLock
from served import Served

PICTURES = {"a" * 32: (200, 90, 40), "b" * 32: (40, 90, 200)}
REQUEST = {
    "title": "Cup", "terms": [{"kind": "image", "picture": "a" * 32, "weight": 1}], "initial": [], "strokes": 40,
    "colors": 2, "width": 120, "height": 90, "brushes": "broad", "replans": 2, "effort": 1, "seed": 0,
}  # fmt: skip
CHANGED = {**REQUEST, "terms": [*REQUEST["terms"], {"kind": "sketch", "picture": "b" * 32, "weight": 2}]}  # type: ignore[misc]
PALETTE = [
    {"number": 1, "hex": "#c06030", "strokes": 20, "share": 0.5},
    {"number": 2, "hex": "#203050", "strokes": 20, "share": 0.5},
]
_MIXTURE = {"well": 1, "hex": "#c03020", "recipe": "1 red", "amount": "3 ml", "also": "", "near": True}
MIXTURES = {
    "brushes": [{"title": "Layer 1: broad brush, 40 strokes", "mixtures": [_MIXTURE, _MIXTURE | {"well": 2}]}],
    "shopping": ["1 x 20 ml red"],
}
MADE = {"prefix": "", "frames": [0, 40], "strokes": 40, "palette": PALETTE}
PLANNED: list[Event] = [
    Began("plan", plan=1, detail=REQUEST),
    ResultFound("plan", plan=1, detail={"nearer": 0.5, "seconds": 10.0, **MIXTURES, **MADE}),
]
BEGUN: list[Event] = [Began("paint", plan=1), PaintingBegun({}, {})]
PAINTED: list[Event] = [
    *BEGUN,
    PlanAdopted("", 0, None, (0.0, 0.0, 0.0), ()),
    Scheduled(0, 40, seconds=160.0, after=((1, 4.0, 0.0), (40, 160.0, 0.0))),
    Dipped(1),
    *(StrokePainted(done, 40) for done in (1, 2, 3)),
    TimelapseFrame(3, 40, (0.0, 0.0, 0.0), "sketchbook/glimpse-000003.jpg"),
]
PAUSED = Paused("It has paused.", 3, "person")
PERSON: list[Event] = [
    PersonMayPaint(
        [{"name": name, "light": wide / 4, "hard": wide} for name, wide in (("fine", 0.004), ("medium", 0.008))],
        ["#c06030", "#203050"],
    ),
    *(StrokeOfPerson(number, {}, (0.0, 0.0, 0.0), painted=True) for number in (1, 2)),
]
LOOKED = Looked(3, dict.fromkeys(("seen", "expected", "difference"), "look.jpg"))
PROTECTED: list[Event] = [
    CommandDone(DrawnRegion("region-1.png")),
    LOOKED,
    Planned(3, 37, 1.0, 1.2, look="look.jpg", shown={**MADE, "strokes": 37, "prefix": "plan-1-"}),
]
FINISHED: list[Event] = [
    *(StrokePainted(done, 40) for done in range(4, 41)),
    Finished(40), Began("results"), ResultFound("results", detail={"film": True}),
]  # fmt: skip


class Told:
    """A painting of which the page is told.

    pictures: of plan and canvas, in place of plain ones.
    """

    def __init__(
        self,
        studio: Served,
        *told: Event,
        title: str = "Cup",
        pictures: dict[str, Image.Image] | None = None,
    ) -> None:
        entry = PaintingStore(studio.folder).begin(title)
        self.id, self.folder = entry.id, entry.folder
        shown = pictures or {}
        plan, live, painting = self.folder.path / "plans/1", self.folder.painting / LIVE, self.folder.painting
        begun = PaintingBegun in map(type, told)
        for folder in (plan, *((live, painting / "regions", painting / "sketchbook") if begun else ())):
            folder.mkdir(parents=True)
        (plan / "plan.json").write_text("{}")
        canvas = shown.get("canvas", Image.new("RGB", (120, 90), (250, 250, 250)))
        for name in ("plan", "after-0", "after-40"):
            shown.get("plan", Image.new("RGB", (120, 90), (30, 200, 90))).save(plan / f"{name}.jpg")
        if begun:
            for name in ("painting/look", "painting/sketchbook/glimpse-000003", "painting/live/plan-1-plan"):
                canvas.save(self.folder.path / f"{name}.jpg")
            shown.get("canvas", Image.new("RGB", (120, 90), (250, 0, 250))).save(painting / "painting.png")
            Image.new("L", (120, 90), 255).save(painting / "regions" / "region-1.png")
        paths = {"height": 750, "paths": [[[100, 100], [300, 300]]] * 40, "widths": [40] * 40, "paint": [0, 1] * 20}
        for strokes in (plan / "strokes.json", *([live / "plan-1-strokes.json"] if begun else [])):
            strokes.write_text(json.dumps(paths))
        self._feed = self._log = EventLog(self.folder.feed, FEED)
        self._clock = datetime.now(UTC)
        self.tell(*told)

    def tell(self, *told: Event) -> None:
        """Tells events, four seconds apart: orders in the feed, and a painting that has begun in its journal."""
        for event in told:
            if isinstance(event, PaintingBegun):
                self._log = EventLog(self.folder.painting / JOURNAL, FEED)  # which nobody owns
            log = self._feed if isinstance(event, Began) and event.what != "results" else self._log
            self._clock += timedelta(seconds=4)
            log.append({**record(event), "at": self._clock.isoformat()})

    def show(self, page: Page) -> None:
        page.evaluate("id => { location.hash = `#/p/${id}`; }", self.id)

    @contextlib.contextmanager
    def at_work(self) -> Iterator[None]:
        """Somebody holds what a worker holds."""
        lock = WorkerLock(self.folder)
        assert lock.take()
        try:
            yield
        finally:
            lock.release()
