"""Routes for who is in charge: stop, the second way beside the listener's own port, and taking the lead."""

from fastapi import APIRouter, Request

from frida_painter.web.requests import AnySession, OperatorSession, TheLead, ThePaintingStore, TheSigns
from frida_painter.web.stops import press

router = APIRouter(prefix="/api")


@router.post("/stop")
async def stop(request: Request, session: AnySession) -> dict[str, int]:
    """Stops everything that is being done in this studio; whoever may look may stop.

    Nothing on its way runs on a thread of the pool, or reads the database.
    """
    return await press(request.app.state.stops, request.app.state.store.root, session.id)


@router.post("/lead")
def take_lead(session: OperatorSession, signs: TheSigns, lead: TheLead, store: ThePaintingStore) -> dict[str, str]:
    """From now on this browser has the robot do things, and no other."""
    lead.take_over(session.id, signs.nonce, signs.given, signs.page)
    store.note(session.id, "", "lead")
    return {"leads": "you"}


@router.post("/lead/back")
def give_lead_back(session: OperatorSession, signs: TheSigns, lead: TheLead, store: ThePaintingStore) -> dict[str, str]:
    """The page that gave the last order is left: any browser may lead now."""
    if lead.give_back(session.id, signs.page):
        store.note(session.id, "", "lead given back")
    return {"leads": "nobody"}
