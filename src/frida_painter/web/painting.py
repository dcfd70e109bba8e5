"""Routes for painting: watch, start, stop."""

import time
from collections.abc import Mapping
from typing import Any, Literal

from fastapi import APIRouter, HTTPException, Response
from pydantic import BaseModel, ConfigDict, Field

from frida_painter import storage
from frida_painter.errors import StorageError
from frida_painter.session.names import JOURNAL
from frida_painter.session.page_events import TakenUp
from frida_painter.web.answers import Reply
from frida_painter.web.commands import tell_painter
from frida_painter.web.feed import Feed
from frida_painter.web.folder import require_disk, working
from frida_painter.web.goals import require_possible
from frida_painter.web.painting_queue import start_painting
from frida_painter.web.painting_request import Identifier, PaintingRequest
from frida_painter.web.painting_store import Entry
from frida_painter.web.procedures import hand_on
from frida_painter.web.requests import (
    Operating,
    TheFeedStates,
    ThePaintingStore,
    ThePresence,
    TheQueue,
    TheWorkers,
    ThisPainting,
)
from frida_painter.web.state import PaintingState

router = APIRouter(prefix="/api/paintings/{identifier}")
_LIVE_FOR = 10.0  # seconds
_MOST_PICTURE = 2**22  # bytes
_NO_PICTURE = "The camera has no picture at the moment."


class Start(BaseModel):
    """Paint this plan; ready: the person says that canvas and paints are; wait: in the queue, behind the others."""

    model_config = ConfigDict(extra="forbid", strict=True)

    plan: int = Field(ge=1, le=99)
    ready: bool
    wait: bool = False


class Say(BaseModel):
    """Something to tell the painter that needs no more than a number."""

    model_config = ConfigDict(extra="forbid", strict=True)

    kind: Literal["pause", "go on", "look", "leave out", "turns", "free"]
    count: int = Field(0, ge=0, le=20_000)


class Drawn(BaseModel):
    """A part of the canvas, drawn light on dark: not to be touched, or the only one that may be."""

    model_config = ConfigDict(extra="forbid", strict=True)

    picture: Identifier
    only: bool


@router.get("")
def state(entry: ThisPainting, feeds: TheFeedStates) -> dict[str, Any]:
    """Everything that the page shows of a painting, as it is now."""
    return {"id": entry.id, "title": entry.title, "begun": entry.begun, **feeds.current(entry.folder, PaintingState)}


@router.get("/camera")
def camera(entry: ThisPainting) -> Response:
    """What the camera sees now (JPEG). Answers 404 where there is no such camera, or its last picture is old."""
    path = entry.folder.camera
    try:
        if time.time() - path.stat().st_mtime > _LIVE_FOR:
            raise HTTPException(404, _NO_PICTURE)
        content = storage.read_bytes(path, "the camera's picture", _MOST_PICTURE)
    except (OSError, StorageError) as gone:
        raise HTTPException(404, _NO_PICTURE) from gone
    return Response(content, media_type="image/jpeg")


@router.post("/start")
def start(
    order: Start,
    entry: ThisPainting,
    session: Operating,
    presence: ThePresence,
    store: ThePaintingStore,
    workers: TheWorkers,
    queue: TheQueue,
) -> Mapping[str, str]:
    """Begins to paint one of the plans, or puts it into the queue."""
    if not order.ready and not order.wait:
        raise HTTPException(422, "Say first that the canvas and the paints are ready.")
    folder = entry.folder
    plan = folder.plan(order.plan)
    if not plan.plan.is_file():
        raise HTTPException(422, "This plan is not finished; wait for it, or choose another one.")
    if folder.painting.exists():
        raise HTTPException(409, "This painting has been begun already; to paint it once more, take Paint again.")
    require_disk(folder.path, 200 * 2**20)
    if order.wait:
        queue.add(entry, plan, "paint")
        store.note(session.id, entry.id, f"queue plan {order.plan}")
        return {"id": entry.id}
    with workers.slot_at(folder) as slot:
        presence.allow(workers.easel)
        folder.stop.unlink(missing_ok=True)
        store.note(session.id, entry.id, f"start plan {order.plan}")
        queue.remove(entry.id)
        start_painting(slot, plan)
    return {"id": entry.id}


@router.post("/resume")
def resume(
    entry: ThisPainting,
    session: Operating,
    presence: ThePresence,
    store: ThePaintingStore,
    feeds: TheFeedStates,
    workers: TheWorkers,
) -> Mapping[str, str]:
    """Goes on with a painting that was stopped, killed or broke off."""
    folder = entry.folder
    painting = feeds.current(folder, PaintingState)["painting"]
    if painting is None or not (folder.painting / JOURNAL).is_file():
        raise HTTPException(409, "There is nothing to go on with: no stroke was painted yet.")
    if painting["status"] == "finished":
        raise HTTPException(409, "This painting is finished; to paint it once more, take Paint again.")
    require_disk(folder.path, 100 * 2**20)
    with workers.slot_at(folder) as slot:
        presence.allow(workers.easel)
        folder.stop.unlink(missing_ok=True)
        folder.robot_stop.unlink(missing_ok=True)
        store.note(session.id, entry.id, "resume")
        feed = Feed(folder)
        feed.tell(TakenUp(painting["done"]))
        feed.close()
        slot.start("resume", folder.plan(painting["plan"]))
    return {"id": entry.id}


@router.post("/answer")
def answer(
    given: Reply, entry: ThisPainting, session: Operating, store: ThePaintingStore, feeds: TheFeedStates
) -> Mapping[str, str]:
    """Answers what the painter has asked."""
    store.note(session.id, entry.id, f"answer: {given.words}")
    hand_on(given, entry.folder, feeds.current(entry.folder, PaintingState)["question"], session.id)
    return {"id": entry.id}


@router.post("/say")
def say(order: Say, entry: ThisPainting, session: Operating, store: ThePaintingStore) -> Mapping[str, str]:
    """Tells the painter to pause, to go on, to look, and the like."""
    _require_painting(entry)
    store.note(session.id, entry.id, f"{order.kind} {order.count}")
    tell_painter(entry.folder, order.kind, session.id, count=order.count)
    return {"id": entry.id}


@router.post("/region")
def protect(drawn: Drawn, entry: ThisPainting, session: Operating, store: ThePaintingStore) -> Mapping[str, str]:
    """Tells the painter which part of the canvas it must not touch, or which alone it may."""
    _require_painting(entry)
    number = entry.folder.keep_region(store.pictures / f"{drawn.picture}.png")
    store.note(session.id, entry.id, f"region {number}")
    tell_painter(entry.folder, "only" if drawn.only else "spare", session.id, record=number)
    return {"id": entry.id}


@router.post("/goal")
def change_goal(
    request: PaintingRequest, entry: ThisPainting, session: Operating, store: ThePaintingStore
) -> Mapping[str, str]:
    """Tells the painter to go on towards something else; canvas, brush and paints stay."""
    _require_painting(entry)
    require_possible(request, store)
    number = entry.folder.begin_change(request, store.pictures)
    store.note(session.id, entry.id, f"goal {number}")
    tell_painter(entry.folder, "goal", session.id, record=number)
    return {"id": entry.id}


def _require_painting(entry: Entry) -> None:
    if not (entry.folder.painting.is_dir() and working(entry.folder)):
        raise HTTPException(409, "Nothing is being painted here at the moment.")
