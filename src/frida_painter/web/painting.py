"""Routes for painting: watch, start, stop."""

from collections.abc import Mapping
from typing import Any

from fastapi import APIRouter, HTTPException
from pydantic import BaseModel, ConfigDict, Field

from frida_painter import storage
from frida_painter.web.feed import Feed
from frida_painter.web.requests import Operating, TheShelf, TheWatch, TheWorkers, ThisPainting
from frida_painter.web.watch import MOST_WATCHERS, EventStream, current

router = APIRouter(prefix="/api/paintings/{identifier}")


class Start(BaseModel):
    """Paint this plan now; ready: the person says that canvas and paints are."""

    model_config = ConfigDict(extra="forbid", strict=True)

    plan: int = Field(ge=1, le=99)
    ready: bool


@router.get("")
def state(entry: ThisPainting) -> dict[str, Any]:
    """Everything that the page shows of a painting, as it is now."""
    return {"id": entry.id, "title": entry.title, "begun": entry.begun, **current(entry.folder)}


@router.get("/events", response_model=None)
def events(entry: ThisPainting, watch: TheWatch) -> EventStream:
    """The same, told again whenever something changes (server-sent events)."""
    if watch.watchers >= MOST_WATCHERS:
        raise HTTPException(503, "Too many are watching already; close another page first.")
    return EventStream(watch, entry.id, entry.folder)


@router.post("/start")
def start(
    order: Start, entry: ThisPainting, session: Operating, shelf: TheShelf, workers: TheWorkers
) -> Mapping[str, str]:
    """Begins to paint one of the plans."""
    if not order.ready:
        raise HTTPException(422, "Say first that the canvas and the paints are ready.")
    folder = entry.folder
    plan = folder.plan(order.plan)
    if not plan.plan.is_file():
        raise HTTPException(422, "This plan is not finished; wait for it, or choose another one.")
    if folder.painting.exists():
        raise HTTPException(409, "This painting has been begun already; to paint it once more, take Paint again.")
    storage.require_space(folder.path, 200 * 2**20)
    with workers.place_at(folder) as place:
        folder.stop.unlink(missing_ok=True)
        shelf.note(session.id, entry.id, f"start plan {order.plan}")
        feed = Feed(folder)
        feed.tell("begun", plan=order.plan, of=plan.wish().strokes)
        feed.close()
        place.start("paint", plan)
    return {"id": entry.id}
