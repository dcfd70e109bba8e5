"""The route by which a browser follows everything that its pages show, on one connection."""

from typing import Annotated

from fastapi import APIRouter, HTTPException, Query
from fastapi.concurrency import run_in_threadpool

from frida_painter.web.calibration_state import CalibrationState
from frida_painter.web.feed_states import FeedStates
from frida_painter.web.folder import working
from frida_painter.web.gallery import cards
from frida_painter.web.painting_store import PaintingStore
from frida_painter.web.requests import AnySession, TheFeedStates, ThePaintingStore, TheStreams
from frida_painter.web.state import PaintingState
from frida_painter.web.state_stream import MOST_TOPICS, EventStream, Topic

router = APIRouter(prefix="/api")
_GALLERY_EVERY = 1.0  # seconds


@router.get("/events", response_model=None)
async def events(
    session: AnySession,
    store: ThePaintingStore,
    feeds: TheFeedStates,
    streams: TheStreams,
    of: Annotated[list[str], Query(max_length=MOST_TOPICS)],
) -> EventStream:
    """States of paintings (by id), of the "calibration" and of all "paintings", whenever they change (server-sent)."""
    topics = await run_in_threadpool(lambda: [_topic(name, store, feeds) for name in dict.fromkeys(of)])
    if not streams.take_seat(session.role):
        raise HTTPException(503, "Too many are watching already; close another page first.")
    return EventStream(streams, session.role, topics)


def _topic(name: str, store: PaintingStore, feeds: FeedStates) -> Topic:
    fresh: type[PaintingState] | type[CalibrationState]
    if name == "paintings":
        return Topic(name, lambda: cards(store, feeds), lambda: cards(store, feeds), every=_GALLERY_EVERY)
    if name == "calibration":
        folder, fresh = store.calibration, CalibrationState
    elif (entry := store.find(name)) is not None:
        folder, fresh = entry.folder, PaintingState
    else:
        raise HTTPException(404, "There is no such painting; it may have been deleted.")

    def mark() -> object:
        return feeds.seen(folder, fresh, lambda state: (state.version, working(folder)))

    return Topic(name, mark, lambda: feeds.current(folder, fresh))
