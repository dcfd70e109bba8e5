"""Routes for who is in charge: stop, which needs nothing but the files of what is being done, and taking the lead."""

import contextlib

from fastapi import APIRouter

from frida_painter.errors import StorageError
from frida_painter.web.folder import PaintingFolder, working
from frida_painter.web.requests import AnySession, OperatorSession, TheLead, ThePaintingStore, TheSigns

router = APIRouter(prefix="/api")


@router.post("/stop")
async def stop(session: AnySession, store: ThePaintingStore) -> dict[str, int]:
    """Stops everything that is being done in this studio; whoever may look may stop."""
    stopped = [folder for folder in map(PaintingFolder, store.root.iterdir()) if working(folder)]
    for folder in stopped:
        folder.stop_now()
    with contextlib.suppress(StorageError):
        store.note(session.id, ", ".join(folder.path.name for folder in stopped), "stop")
    return {"stopped": len(stopped)}


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
