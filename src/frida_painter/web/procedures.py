"""Routes for calibrating: what is asked for, how it stands, and answers to what the procedures want to know."""

from collections.abc import Mapping
from typing import Any

from fastapi import APIRouter, HTTPException
from fastapi.responses import FileResponse

from frida_painter.session.page_events import CalibrationStarted
from frida_painter.web.answers import Reply, reply
from frida_painter.web.calibration_request import CalibrationRequest
from frida_painter.web.calibration_state import CalibrationState
from frida_painter.web.feed import Feed
from frida_painter.web.folder import PaintingFolder, require_disk, working
from frida_painter.web.requests import AnySession, Operating, TheFeedStates, ThePaintingStore, ThePresence, TheWorkers

router = APIRouter(prefix="/api/calibration")
_ID = "calibration"


@router.get("")
def state(session: AnySession, store: ThePaintingStore, feeds: TheFeedStates) -> dict[str, Any]:
    """Everything that the page shows of it, as it is now."""
    return feeds.current(store.calibration, CalibrationState)


@router.post("/start")
def start(
    request: CalibrationRequest, session: Operating, presence: ThePresence, store: ThePaintingStore, workers: TheWorkers
) -> Mapping[str, str]:
    """Begins to calibrate."""
    folder = store.calibration
    require_disk(folder.path, 200 * 2**20)
    with workers.slot_at(folder) as slot:
        presence.allow(workers.easel)
        folder.stop.unlink(missing_ok=True)
        store.note(session.id, _ID, f"calibrate {', '.join(request.what)}")
        request.keep(folder)
        feed = Feed(folder)
        feed.tell(CalibrationStarted(list(request.what)))
        feed.close()
        slot.start("calibrate", folder.plan(1))
    return {"id": _ID}


@router.post("/answer")
def answer(given: Reply, session: Operating, store: ThePaintingStore, feeds: TheFeedStates) -> Mapping[str, str]:
    """Answers what a procedure has asked, or moves the brush as it is asked for."""
    store.note(session.id, _ID, f"answer: {given.words}")
    hand_on(given, store.calibration, feeds.current(store.calibration, CalibrationState)["question"], session.id)
    return {"id": _ID}


@router.get("/files/{name}")
def file(name: str, session: AnySession, store: ThePaintingStore) -> FileResponse:
    """A picture of what is asked, or was found."""
    path = store.calibration.shown("live", name)
    if path is None:
        raise HTTPException(404, "There is no such picture.")
    return FileResponse(path, headers={"Content-Disposition": "attachment", "Cache-Control": "no-store"})


def hand_on(given: Reply, folder: PaintingFolder, asked: Any, by: str) -> None:
    """Hands an answer to the worker that waits for it. Answers 409 where none does; raises ConfigError."""
    if not isinstance(asked, dict) or asked.get("id") != given.question or not working(folder):
        raise HTTPException(409, "This is not asked any more; look at the page.")
    given.answering(str(asked["kind"]), asked)
    reply(folder, given, by)
