"""Routes for what is being done in the studio, and what waits for it."""

from typing import Any

from fastapi import APIRouter

from frida_painter.web.folder import working
from frida_painter.web.requests import AnySession, OperatorSession, Planning, ThePaintingStore, TheQueue, ThisPainting

router = APIRouter(prefix="/api")


@router.get("/work")
def work(session: AnySession, store: ThePaintingStore, queue: TheQueue) -> dict[str, Any]:
    """Who is at work (ids of paintings, and "calibration"), and who waits for it, in order."""
    entries = store.all()
    at_work = [entry.id for entry in entries if working(entry.folder)]
    calibrating = ["calibration"] if working(store.calibration) else []
    titles = {entry.id: entry.title for entry in entries}
    shown = queue.shown()
    waiting = [{**each, "title": titles.get(each["painting"], "")} for each in shown["queue"]]
    return {"working": at_work + calibrating, **shown, "queue": waiting}


@router.post("/queue/go-on")
def go_on(session: OperatorSession, store: ThePaintingStore, queue: TheQueue) -> dict[str, Any]:
    """Lets the queue go on after a stop."""
    store.note(session.id, "", "the queue goes on")
    queue.go_on()
    return queue.shown()


@router.post("/queue/{identifier}/first")
def first(entry: ThisPainting, session: Planning, queue: TheQueue) -> dict[str, Any]:
    """Puts a painting before all others that wait."""
    queue.first(entry.id)
    return queue.shown()


@router.post("/queue/{identifier}/remove")
def remove(entry: ThisPainting, session: Planning, queue: TheQueue) -> dict[str, Any]:
    """Takes a painting out of the queue."""
    queue.remove(entry.id)
    return queue.shown()
