"""What routes need of a request: who asks, which painting is meant, and whether they may do that.

All but the painting is told without a thread of the pool, which may be full.
"""

import math
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Annotated, TypeVar

from fastapi import Depends, Header, HTTPException, Path, Request

from frida_painter.web.access import Session
from frida_painter.web.feed_states import FeedStates
from frida_painter.web.lead import Lead
from frida_painter.web.painting_queue import PaintingQueue
from frida_painter.web.painting_store import Entry, PaintingStore
from frida_painter.web.presence import Presence
from frida_painter.web.roles import Role
from frida_painter.web.state_stream import StateStreams
from frida_painter.web.stop_process import StopProcess
from frida_painter.web.studio_pace import PaceMemory
from frida_painter.web.uploads import Uploads
from frida_painter.web.workers import Workers


async def session_of(request: Request) -> Session:
    """The session of the request, which the middleware has accepted."""
    session: Session = request.state.session
    return session


Kept = TypeVar("Kept")


def _kept(kind: type[Kept], name: str) -> Callable[[Request], Awaitable[Kept]]:
    """What this studio keeps under a name, as a dependency."""

    async def kept(request: Request) -> Kept:
        found: Kept = getattr(request.app.state, name)
        return found

    return kept


painting_store_of = _kept(PaintingStore, "store")
streams_of = _kept(StateStreams, "streams")
uploads_of = _kept(Uploads, "uploads")
pace_of = _kept(PaceMemory, "pace")
feeds_of = _kept(FeedStates, "feeds")
workers_of = _kept(Workers, "workers")
queue_of = _kept(PaintingQueue, "queue")
lead_of = _kept(Lead, "lead")
presence_of = _kept(Presence, "presence")


async def stop_process_of(request: Request) -> StopProcess | None:
    """Where stops are listened to; None for a studio that is not served on a port."""
    process: StopProcess | None = request.app.state.stop_process
    return process


def painting_of(
    identifier: Annotated[str, Path(max_length=64)], store: Annotated[PaintingStore, Depends(painting_store_of)]
) -> Entry:
    """The painting that is meant. Answers 404 where there is none."""
    entry = store.find(identifier)
    if entry is None:
        raise HTTPException(404, "There is no such painting; it may have been deleted.")
    return entry


async def may_plan(session: Annotated[Session, Depends(session_of)]) -> Session:
    """Answers 403 to those who may only watch."""
    return _require(session, Role.plan)


async def operator(session: Annotated[Session, Depends(session_of)]) -> Session:
    """Answers 403 to those who may not have the robot move."""
    return _require(session, Role.operate)


@dataclass(frozen=True)
class Signs:
    """What an order carries: a number of its own, when it was given, and which page of a browser gave it."""

    nonce: str
    given: float
    page: str


async def signs_of(
    x_nonce: Annotated[str, Header(max_length=64)] = "",
    x_given: Annotated[float, Header()] = math.nan,
    x_page: Annotated[str, Header(max_length=64)] = "",
) -> Signs:
    """The signs of this order; who leads judges them."""
    return Signs(x_nonce, x_given, x_page)


async def may_operate(
    session: Annotated[Session, Depends(operator)],
    lead: Annotated[Lead, Depends(lead_of)],
    signs: Annotated[Signs, Depends(signs_of)],
) -> Session:
    """The same, and whether this order comes from the browser that leads, once, and not too late (409)."""
    lead.require(session.id, signs.nonce, signs.given, signs.page)
    return session


def _require(session: Session, role: Role) -> Session:
    if session.role < role:
        raise HTTPException(
            403, "You may watch here, but not do that; ask whoever started the studio for another link."
        )
    return session


AnySession = Annotated[Session, Depends(session_of)]
Planning = Annotated[Session, Depends(may_plan)]
OperatorSession = Annotated[Session, Depends(operator)]
Operating = Annotated[Session, Depends(may_operate)]
ThisPainting = Annotated[Entry, Depends(painting_of)]
ThePaintingStore = Annotated[PaintingStore, Depends(painting_store_of)]
TheFeedStates = Annotated[FeedStates, Depends(feeds_of)]
TheStopProcess = Annotated[StopProcess | None, Depends(stop_process_of)]
ThePace = Annotated[PaceMemory, Depends(pace_of)]
TheUploads = Annotated[Uploads, Depends(uploads_of)]
TheStreams = Annotated[StateStreams, Depends(streams_of)]
TheSigns = Annotated[Signs, Depends(signs_of)]
TheLead = Annotated[Lead, Depends(lead_of)]
ThePresence = Annotated[Presence, Depends(presence_of)]
TheQueue = Annotated[PaintingQueue, Depends(queue_of)]
TheWorkers = Annotated[Workers, Depends(workers_of)]
