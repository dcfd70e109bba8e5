"""Routes for saying what is wanted: pictures, requests for paintings, plans."""

import re
import time
from collections.abc import Mapping
from dataclasses import asdict
from typing import Annotated, Any

from fastapi import APIRouter, HTTPException, Path, Request
from fastapi.responses import FileResponse

from frida_painter.errors import Interrupted
from frida_painter.session.page_events import PlanRequested
from frida_painter.web.abilities import abilities
from frida_painter.web.feed import Feed
from frida_painter.web.folder import PlanFolder, working
from frida_painter.web.painting_queue import PaintingQueue
from frida_painter.web.painting_request import PaintingRequest
from frida_painter.web.painting_store import Entry, PaintingStore
from frida_painter.web.requests import (
    AnySession,
    Planning,
    ThePace,
    ThePaintingStore,
    TheQueue,
    TheStopProcess,
    TheUploads,
    TheWorkers,
    ThisPainting,
)
from frida_painter.web.workers import Workers

router = APIRouter(prefix="/api")


@router.get("/studio")
def studio(
    session: AnySession, store: ThePaintingStore, workers: TheWorkers, stop: TheStopProcess, pace: ThePace
) -> dict[str, Any]:
    """What the page needs to know of this studio, and where and with which secret it stops."""
    easel = workers.easel
    return {
        "stop": None if stop is None else {"port": stop.port, "secret": stop.secret(session.role)},
        "role": session.role.name,
        "abilities": abilities(),
        "now": time.time(),
        "robot": easel.robot,
        "camera": bool(easel.camera) and not easel.simulated,
        "simulated": easel.simulated,
        "dangerous": easel.drives_machine,
        "pace": asdict(pace.pace(store, real_time=not easel.simulated)),
        "canvas": easel.canvas,
    }


@router.post("/pictures")
async def give_picture(request: Request, session: Planning, uploads: TheUploads) -> dict[str, str]:
    """Takes a picture, the plain bytes of its file, and gives it an id."""
    return {"id": await uploads.keep(await request.body())}


@router.get("/pictures/{picture}")
def show_picture(picture: Annotated[str, Path(max_length=64)], store: ThePaintingStore) -> FileResponse:
    """A picture that was given."""
    path = store.pictures / f"{picture}.png"
    if not re.fullmatch(r"[0-9a-f]{32}", picture) or not path.is_file():
        raise HTTPException(404, "There is no such picture.")
    return FileResponse(path, headers={"Content-Disposition": "attachment", "Cache-Control": "private, max-age=86400"})


@router.post("/paintings")
def begin(
    request: PaintingRequest, session: Planning, store: ThePaintingStore, workers: TheWorkers, queue: TheQueue
) -> Mapping[str, str]:
    """Begins a painting, and its first plan."""
    require_possible(request, store)
    entry = store.begin(request.title or "Untitled")
    _plan(entry, request, store, workers, queue)
    return {"id": entry.id}


@router.post("/paintings/{identifier}/plans")
def plan_again(
    request: PaintingRequest,
    entry: ThisPainting,
    session: Planning,
    store: ThePaintingStore,
    workers: TheWorkers,
    queue: TheQueue,
) -> Mapping[str, str]:
    """Has another plan made for a painting, of the same request or another."""
    require_possible(request, store)
    _plan(entry, request, store, workers, queue)
    return {"id": entry.id}


def require_possible(request: PaintingRequest, store: PaintingStore) -> None:
    """Answers 422 where a picture is gone, or a network that is needed is not here."""
    if not all((store.pictures / f"{name}.png").is_file() for name in request.pictures):
        raise HTTPException(422, "A picture of this goal is gone; choose it again.")
    kinds = {term.kind for term in (*request.terms, *request.initial)}
    missing = [kind for kind in kinds if not abilities()[kind]["ready"]]
    if missing:
        raise HTTPException(422, abilities()[missing[0]]["advice"])


def _plan(entry: Entry, request: PaintingRequest, store: PaintingStore, workers: Workers, queue: PaintingQueue) -> None:
    """Has the plan made, now or when those before it are done."""
    folder = entry.folder
    if working(folder):
        raise Interrupted("The painter is at work on this painting already.")
    if queue.must_wait():
        queue.add(entry, _requested(entry, request, store), "plan")
        return
    with workers.slot_at(folder) as slot:
        folder.stop.unlink(missing_ok=True)
        slot.start("plan", _requested(entry, request, store))


def _requested(entry: Entry, request: PaintingRequest, store: PaintingStore) -> PlanFolder:
    """The folder of a new plan, of which the page is told."""
    plan = entry.folder.begin_plan(request, store.pictures)
    feed = Feed(entry.folder)
    feed.tell(PlanRequested(plan.number, request.model_dump(mode="json")))
    feed.close()
    if request.title and request.title != entry.title:
        store.rename(entry.id, request.title)
    return plan
