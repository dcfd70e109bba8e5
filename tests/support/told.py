"""Paintings of which a page is told, although nobody plans or paints."""

import contextlib
import json
from collections.abc import Iterator
from typing import Any

from PIL import Image
from playwright.sync_api import Page

from frida_painter.event_log import FEED, EventLog
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
MIXTURES = [{"recipe": "1 red", "millilitres": 3.0, "near": True}] * 2
MADE = {"prefix": "", "frames": [0, 40], "strokes": 40, "palette": PALETTE}
PLANNED: list[dict[str, Any]] = [
    {"kind": "plan_requested", "plan": 1, "wish": REQUEST},
    {"kind": "plan_made", "plan": 1, "nearer": 0.5, "seconds": 10.0, "mixtures": MIXTURES, **MADE},
]
PAINTED: list[dict[str, Any]] = [
    {"kind": "painting_started", "plan": 1, "of": 40},
    {"kind": "dipped", "paint": 1},
    *({"kind": "stroke_painted", "done": done, "of": 40} for done in (1, 2, 3)),
    {"kind": "photograph_shown", "picture": "photograph-00000.jpg", "done": 3},
]
PAUSED = {"kind": "paused", "reason": "It has paused.", "done": 3, "cause": "person"}
PERSON: list[dict[str, Any]] = [
    {
        "kind": "person_may_paint",
        "brushes": [
            {"name": name, "light": wide / 4, "hard": wide} for name, wide in (("fine", 0.004), ("medium", 0.008))
        ],
        "wells": ["#c06030", "#203050"],
    },
    *({"kind": "person_stroke_painted", "number": number, "done": 3} for number in (1, 2)),
]
PROTECTED: list[dict[str, Any]] = [
    {"kind": "considering"},
    {"kind": "region_protected", "region": "regions/1.png", "only": False, "picture": "region-1.png"},
    {"kind": "look_shown", "done": 3, "seen": "look.jpg", "expected": "look.jpg", "difference": "look.jpg"},
    {"kind": "rest_replanned", "done": 3, "gain": -0.2, **MADE, "strokes": 37, "prefix": "plan-1-"},
]
FINISHED: list[dict[str, Any]] = [
    *({"kind": "stroke_painted", "done": done, "of": 40} for done in range(4, 41)),
    {"kind": "finishing"}, {"kind": "painting_kept", "film": True}, {"kind": "rests"},
]  # fmt: skip


class Told:
    """A painting of which the page is told.

    pictures: of plan and canvas, in place of plain ones.
    """

    def __init__(
        self,
        studio: Served,
        *lines: dict[str, Any],
        title: str = "Cup",
        pictures: dict[str, Image.Image] | None = None,
    ) -> None:
        entry = PaintingStore(studio.folder).begin(title)
        self.id, self.folder = entry.id, entry.folder
        shown = pictures or {}
        plan, live, painting = self.folder.path / "plans/1", self.folder.live, self.folder.painting
        for folder in (plan, live):
            folder.mkdir(parents=True)
        (plan / "plan.json").write_text("{}")
        for name in ("photograph-00000", "look", "plan-1-plan"):
            shown.get("canvas", Image.new("RGB", (120, 90), (250, 250, 250))).save(live / f"{name}.jpg")
        for name in ("plan", "after-0", "after-40"):
            shown.get("plan", Image.new("RGB", (120, 90), (30, 200, 90))).save(plan / f"{name}.jpg")
        if any(line["kind"] == "painting_started" for line in lines):
            painting.mkdir()
            shown.get("canvas", Image.new("RGB", (120, 90), (250, 0, 250))).save(painting / "painting.png")
        Image.new("L", (120, 90), 255).save(live / "region-1.png")
        paths = {"height": 750, "paths": [[[100, 100], [300, 300]]] * 40, "widths": [40] * 40, "paint": [0, 1] * 20}
        for strokes in (plan / "strokes.json", live / "plan-1-strokes.json"):
            strokes.write_text(json.dumps(paths))
        self._log = EventLog(self.folder.feed, FEED)
        self.tell(*lines)

    def tell(self, *lines: dict[str, Any]) -> None:
        for line in lines:
            self._log.append(line)

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
