"""Routes of the studio's web application: paintings, plans, queue, calibration, control, gallery and events."""

import io
import math
import os
import re
import stat
import time
import zipfile
from collections.abc import Awaitable, Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path as Path_module
from typing import Annotated, Any, Literal, TypeVar

from fastapi import APIRouter, Depends, Header, HTTPException, Path, Query, Request, Response
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import FileResponse, StreamingResponse
from pydantic import BaseModel, ConfigDict, Field

from frida_painter import registry, storage
from frida_painter.easel.kinds import JOURNAL
from frida_painter.errors import Interrupted, StorageError
from frida_painter.objectives.objective import goal_kinds
from frida_painter.registry import are_here
from frida_painter.session.events import CalibrationStarted, PlanRequested, TakenUp
from frida_painter.web.commands import Reply, Role, reply, tell_painter
from frida_painter.web.security import Lead, Presence, Session
from frida_painter.web.state import (
    MAX_TOPICS,
    CalibrationState,
    EventStream,
    FeedStates,
    PaintingState,
    StateStreams,
    Topic,
)
from frida_painter.web.stop import press
from frida_painter.web.stop_process import StopProcess
from frida_painter.web.store import Entry, PaintingStore, Uploads
from frida_painter.web.studio_folder import (
    CalibrationRequest,
    Feed,
    Identifier,
    PaintingFolder,
    PaintingRequest,
    PlanFolder,
    require_disk,
    working,
)
from frida_painter.web.work_pace import PaceMemory
from frida_painter.web.workers import PaintingQueue, Workers, start_painting

# Dependencies of routes: the session, the painting, and the right to do something.
#
# All but the painting are async functions, which need no thread of the pool; the pool may be full.


async def session_of(request: Request) -> Session:
    """Returns the session of the request, which the middleware has accepted."""
    session: Session = request.state.session
    return session


Kept = TypeVar("Kept")


def _from_app_state(kind: type[Kept], name: str) -> Callable[[Request], Awaitable[Kept]]:
    """Returns a dependency for the object that the studio keeps under a name."""

    async def kept(request: Request) -> Kept:
        found: Kept = getattr(request.app.state, name)
        return found

    return kept


painting_store_of = _from_app_state(PaintingStore, "store")
streams_of = _from_app_state(StateStreams, "streams")
uploads_of = _from_app_state(Uploads, "uploads")
pace_of = _from_app_state(PaceMemory, "pace")
feeds_of = _from_app_state(FeedStates, "feeds")
workers_of = _from_app_state(Workers, "workers")
queue_of = _from_app_state(PaintingQueue, "queue")
lead_of = _from_app_state(Lead, "lead")
presence_of = _from_app_state(Presence, "presence")


async def stop_process_of(request: Request) -> StopProcess | None:
    """Returns the listener for stops; None for a studio that is not served on a port."""
    process: StopProcess | None = request.app.state.stop_process
    return process


def painting_of(
    identifier: Annotated[str, Path(max_length=64)], store: Annotated[PaintingStore, Depends(painting_store_of)]
) -> Entry:
    """Returns the painting of the path. Answers 404 for an unknown one."""
    entry = store.find(identifier)
    if entry is None:
        raise HTTPException(404, "There is no such painting; it may have been deleted.")
    return entry


async def may_plan(session: Annotated[Session, Depends(session_of)]) -> Session:
    """Returns the session. Answers 403 if it may only watch."""
    return _require(session, Role.plan)


async def operator(session: Annotated[Session, Depends(session_of)]) -> Session:
    """Returns the session. Answers 403 if it may not move the robot."""
    return _require(session, Role.operate)


@dataclass(frozen=True)
class Signs:
    """Signs of an order: its unique number, its time, and the page of the browser that gave it."""

    nonce: str
    given: float
    page: str


async def signs_of(
    x_nonce: Annotated[str, Header(max_length=64)] = "",
    x_given: Annotated[float, Header()] = math.nan,
    x_page: Annotated[str, Header(max_length=64)] = "",
) -> Signs:
    """Returns the signs of this order; `Lead` checks them."""
    return Signs(x_nonce, x_given, x_page)


async def may_operate(
    session: Annotated[Session, Depends(operator)],
    lead: Annotated[Lead, Depends(lead_of)],
    signs: Annotated[Signs, Depends(signs_of)],
) -> Session:
    """Returns the session of an operator.

    Raises Led if another browser leads, Interrupted if the order is old or repeated.
    """
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


# Abilities of this studio: the kinds of goals, and the missing parts of each.

# Extra that a kind of goal needs besides its networks, and a package of that extra.
_EXTRAS = {"text": ("words", "transformers")}


def abilities() -> dict[str, dict[str, object]]:
    """Returns for each kind of goal: True if it is ready, missing weights, names to fetch, and a sentence of advice."""
    return {name: _ability(name, kind.networks) for name, kind in goal_kinds().by_name.items()}


def _ability(kind: str, groups: tuple[tuple[str, ...], ...]) -> dict[str, object]:
    missing = [group[-1] for group in groups if not any(map(are_here, group))]
    fetch = ["words"] if kind == "text" and missing else missing
    said = []
    if kind in _EXTRAS and not registry.is_installed(_EXTRAS[kind][1]):
        said.append(registry.advice(_EXTRAS[kind][0], "This"))
    if missing:
        command = f"frida-painter models fetch {' '.join(fetch)}"
        said.append(f"This needs a network that is not here yet; fetch it with: {command}")
    return {"ready": not said, "missing": missing, "fetch": fetch, "advice": ". ".join(said)}


# Routes for the current work and the queue.

queue_router = APIRouter(prefix="/api")


@queue_router.get("/work")
def work(session: AnySession, store: ThePaintingStore, queue: TheQueue) -> dict[str, Any]:
    """Returns who is at work (ids of paintings, and "calibration"), and the queue in order."""
    entries = store.all()
    at_work = [entry.id for entry in entries if working(entry.folder)]
    calibrating = ["calibration"] if working(store.calibration) else []
    titles = {entry.id: entry.title for entry in entries}
    shown = queue.to_plain()
    waiting = [{**each, "title": titles.get(each["painting"], "")} for each in shown["queue"]]
    return {"working": at_work + calibrating, **shown, "queue": waiting}


@queue_router.post("/queue/go-on")
def go_on(session: OperatorSession, store: ThePaintingStore, queue: TheQueue) -> dict[str, Any]:
    """Lets the queue go on after a stop."""
    store.note(session.id, "", "the queue goes on")
    queue.go_on()
    return queue.to_plain()


@queue_router.post("/queue/{identifier}/first")
def first(entry: ThisPainting, session: Planning, queue: TheQueue) -> dict[str, Any]:
    """Puts a painting at the front of the queue."""
    queue.first(entry.id)
    return queue.to_plain()


@queue_router.post("/queue/{identifier}/remove")
def remove(entry: ThisPainting, session: Planning, queue: TheQueue) -> dict[str, Any]:
    """Removes a painting from the queue."""
    queue.remove(entry.id)
    return queue.to_plain()


# Routes for calibration: the request, its state, and answers to the questions of procedures.

calibration_router = APIRouter(prefix="/api/calibration")
_ID = "calibration"


@calibration_router.get("")
def calibration_state(session: AnySession, store: ThePaintingStore, feeds: TheFeedStates) -> dict[str, Any]:
    """Returns the state of the calibration, as the page shows it."""
    return feeds.current(store.calibration, CalibrationState)


@calibration_router.post("/start")
def start_calibration(
    request: CalibrationRequest, session: Operating, presence: ThePresence, store: ThePaintingStore, workers: TheWorkers
) -> Mapping[str, str]:
    """Starts the calibration."""
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


@calibration_router.post("/answer")
def answer_calibration(
    given: Reply, session: Operating, store: ThePaintingStore, feeds: TheFeedStates
) -> Mapping[str, str]:
    """Answers a question of a procedure, or moves the brush as asked."""
    store.note(session.id, _ID, f"answer: {given.words}")
    hand_on(given, store.calibration, feeds.current(store.calibration, CalibrationState)["question"], session.id)
    return {"id": _ID}


@calibration_router.get("/files/{name}")
def calibration_file(name: str, session: AnySession, store: ThePaintingStore) -> FileResponse:
    """Returns a picture of a question or a result."""
    path = store.calibration.find_shown("live", name)
    if path is None:
        raise HTTPException(404, "There is no such picture.")
    return FileResponse(path, headers={"Content-Disposition": "attachment", "Cache-Control": "no-store"})


def hand_on(given: Reply, folder: PaintingFolder, asked: Any, by: str) -> None:
    """Hands an answer to the waiting worker. Answers 409 if the question is no longer open; raises ConfigError."""
    if not isinstance(asked, dict) or asked.get("id") != given.question or not working(folder):
        raise HTTPException(409, "This is not asked any more; look at the page.")
    given.answering(str(asked["kind"]), asked)
    reply(folder, given, by)


# Routes for control: the stop, as the second way beside the listener's own port, and the lead.

control_router = APIRouter(prefix="/api")


@control_router.post("/stop")
async def stop(request: Request, session: AnySession) -> dict[str, int]:
    """Stops all work in this studio; every session may stop.

    The stop uses no thread of the pool and no database.
    """
    return await press(request.app.state.stops, request.app.state.store.root, session.id)


@control_router.post("/lead")
def take_lead(session: OperatorSession, signs: TheSigns, lead: TheLead, store: ThePaintingStore) -> dict[str, str]:
    """Gives the lead to this browser; only it may then move the robot."""
    lead.take_over(session.id, signs.nonce, signs.given, signs.page)
    store.note(session.id, "", "lead")
    return {"leads": "you"}


@control_router.post("/lead/back")
def give_lead_back(session: OperatorSession, signs: TheSigns, lead: TheLead, store: ThePaintingStore) -> dict[str, str]:
    """Gives up the lead, because the page of the last order was left; any browser may then lead."""
    if lead.give_back(session.id, signs.page):
        store.note(session.id, "", "lead given back")
    return {"leads": "nobody"}


# Routes for existing paintings: the gallery, downloads, and deletion.

gallery_router = APIRouter()
_PIECE = 2**18  # bytes


@gallery_router.get("/api/paintings")
def paintings(session: AnySession, store: ThePaintingStore, feeds: TheFeedStates) -> list[dict[str, Any]]:
    """Returns all paintings, the newest first, each with its best picture."""
    return cards(store, feeds)


@gallery_router.post("/api/paintings/{identifier}/delete")
def delete(entry: ThisPainting, session: Operating, store: ThePaintingStore, queue: TheQueue) -> dict[str, str]:
    """Deletes a painting with all its files."""
    if working(entry.folder):
        raise Interrupted("The painter is at work on this painting; stop it first.")
    queue.remove(entry.id)
    store.note(session.id, entry.id, "delete")
    store.delete(entry)
    return {"id": entry.id}


@gallery_router.get("/paintings/{identifier}/{place}/{name}")
def painting_file(entry: ThisPainting, place: str, name: str) -> FileResponse:
    """Returns a file of a painting that may be shown."""
    path = entry.folder.find_shown(place, name)
    if path is None:
        raise HTTPException(404, "There is no such file.")
    caching = "private, max-age=3600" if place.isdecimal() else "no-store"  # a plan never changes
    return FileResponse(path, headers={"Content-Disposition": "attachment", "Cache-Control": caching})


@gallery_router.get("/api/paintings/{identifier}/everything.zip")
def everything(entry: ThisPainting) -> StreamingResponse:
    """Returns the whole painting as a ZIP file: its page, pictures, film, plan and journal."""
    folder = entry.folder.painting
    linked = folder.is_symlink() or entry.folder.path.is_symlink()
    if linked or not folder.is_dir() or working(entry.folder):
        raise HTTPException(404, "There is nothing to take along yet; wait until the painting is finished.")
    headers = {"Content-Disposition": 'attachment; filename="painting.zip"'}
    return StreamingResponse(zip_folder(folder), media_type="application/zip", headers=headers)


class _Outlet(io.RawIOBase):
    """Write-only stream that holds the written bytes until they are taken."""

    def __init__(self) -> None:
        super().__init__()
        self._held = bytearray()

    def writable(self) -> bool:
        return True

    def write(self, content: Any) -> int:
        self._held += content
        return len(content)

    def take(self) -> bytes:
        held, self._held = bytes(self._held), bytearray()
        return held


def zip_folder(folder: Path_module) -> Iterator[bytes]:
    """Yields a ZIP file of a folder in pieces, without temporary files, links or hidden files."""
    outlet = _Outlet()
    with zipfile.ZipFile(outlet, "w", zipfile.ZIP_STORED) as archive:
        for path in sorted(folder.rglob("*")):
            inside = path.relative_to(folder)
            if _is_hidden(inside) or any((folder / part).is_symlink() for part in (inside, *inside.parents)):
                continue
            try:
                file = os.fdopen(os.open(path, os.O_RDONLY | os.O_NOFOLLOW), "rb")
            except OSError:
                continue  # deleted meanwhile, or not readable
            with file:
                if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
                    continue
                about = zipfile.ZipInfo.from_file(path, Path_module("painting") / inside)
                with archive.open(about, "w", force_zip64=about.file_size >= 2**31) as part:
                    while content := file.read(_PIECE):
                        part.write(content)
                        yield outlet.take()
    yield outlet.take()


def _is_hidden(path: Path_module) -> bool:
    """Returns True for a hidden file, needed only during a painting, by its path inside the folder."""
    return any(part.startswith(".") for part in path.parts)


def cards(store: PaintingStore, feeds: FeedStates) -> list[dict[str, Any]]:
    """Returns the gallery's data of every painting."""
    return [
        {
            "id": entry.id, "title": entry.title, "begun": entry.begun,
            "stage": feeds.view(entry.folder, PaintingState, lambda state: state.stage),
            "working": working(entry.folder), "picture": _best_picture(entry.folder),
        }
        for entry in store.all()
    ]  # fmt: skip


def _best_picture(folder: PaintingFolder) -> str | None:
    """Returns the picture of the painting, or else of its newest plan; None if there is none."""
    candidates = ["painting/painting.png", *(f"{plan.number}/plan.jpg" for plan in reversed(folder.plans()))]
    for candidate in candidates:
        place, _, name = candidate.partition("/")
        if folder.find_shown(place, name) is not None:
            return candidate
    return None


# Routes for requests: pictures, paintings and plans.

goals_router = APIRouter(prefix="/api")


@goals_router.get("/studio")
def studio(
    session: AnySession, store: ThePaintingStore, workers: TheWorkers, stop: TheStopProcess, pace: ThePace
) -> dict[str, Any]:
    """Returns the facts about this studio for the page, with the port and the secret of its stops."""
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


@goals_router.post("/pictures")
async def give_picture(request: Request, session: Planning, uploads: TheUploads) -> dict[str, str]:
    """Stores a picture from the plain bytes of its file, and returns its id."""
    return {"id": await uploads.keep(await request.body())}


@goals_router.get("/pictures/{picture}")
def show_picture(picture: Annotated[str, Path(max_length=64)], store: ThePaintingStore) -> FileResponse:
    """Returns an uploaded picture."""
    path = store.pictures / f"{picture}.png"
    if not re.fullmatch(r"[0-9a-f]{32}", picture) or not path.is_file():
        raise HTTPException(404, "There is no such picture.")
    return FileResponse(path, headers={"Content-Disposition": "attachment", "Cache-Control": "private, max-age=86400"})


@goals_router.post("/paintings")
def begin(
    request: PaintingRequest, session: Planning, store: ThePaintingStore, workers: TheWorkers, queue: TheQueue
) -> Mapping[str, str]:
    """Begins a painting and its first plan."""
    require_possible(request, store)
    entry = store.begin(request.title or "Untitled")
    _plan(entry, request, store, workers, queue)
    return {"id": entry.id}


@goals_router.post("/paintings/{identifier}/plans")
def plan_again(
    request: PaintingRequest,
    entry: ThisPainting,
    session: Planning,
    store: ThePaintingStore,
    workers: TheWorkers,
    queue: TheQueue,
) -> Mapping[str, str]:
    """Makes another plan for a painting, from the same request or another one."""
    require_possible(request, store)
    _plan(entry, request, store, workers, queue)
    return {"id": entry.id}


def require_possible(request: PaintingRequest, store: PaintingStore) -> None:
    """Answers 422 if a picture of the request is missing, or if a kind of goal is not ready."""
    if not all((store.pictures / f"{name}.png").is_file() for name in request.pictures):
        raise HTTPException(422, "A picture of this goal is gone; choose it again.")
    kinds = {term.kind for term in (*request.terms, *request.initial)}
    missing = [kind for kind in kinds if not abilities()[kind]["ready"]]
    if missing:
        raise HTTPException(422, abilities()[missing[0]]["advice"])


def _plan(entry: Entry, request: PaintingRequest, store: PaintingStore, workers: Workers, queue: PaintingQueue) -> None:
    """Starts the plan, or puts it into the queue if other work comes first."""
    folder = entry.folder
    if working(folder):
        raise Interrupted("The painter is at work on this painting already.")
    if queue.must_wait():
        queue.add(entry, _request_plan(entry, request, store), "plan")
        return
    with workers.slot_at(folder) as slot:
        folder.stop.unlink(missing_ok=True)
        slot.start("plan", _request_plan(entry, request, store))


def _request_plan(entry: Entry, request: PaintingRequest, store: PaintingStore) -> PlanFolder:
    """Makes the folder of a new plan and reports it to the page."""
    plan = entry.folder.begin_plan(request, store.pictures)
    feed = Feed(entry.folder)
    feed.tell(PlanRequested(plan.number, request.model_dump(mode="json")))
    feed.close()
    if request.title and request.title != entry.title:
        store.rename(entry.id, request.title)
    return plan


painting_router = APIRouter(prefix="/api/paintings/{identifier}")
_LIVE_FOR = 10.0  # seconds
_MAX_PICTURE = 2**22  # bytes
_NO_PICTURE = "The camera has no picture at the moment."


class Start(BaseModel):
    """Order to paint a plan.

    plan: its number.
    ready: True if the person confirms canvas and paints.
    wait: True to put it into the queue.
    """

    model_config = ConfigDict(extra="forbid", strict=True)

    plan: int = Field(ge=1, le=99)
    ready: bool
    wait: bool = False


class Say(BaseModel):
    """Command to the painter with at most a number."""

    model_config = ConfigDict(extra="forbid", strict=True)

    kind: Literal["pause", "go on", "look", "leave out", "turns", "free"]
    count: int = Field(0, ge=0, le=20_000)


class Drawn(BaseModel):
    """Drawing of a part of the canvas, light on dark.

    only: True if only this part may be painted, False if it is protected.
    """

    model_config = ConfigDict(extra="forbid", strict=True)

    picture: Identifier
    only: bool


@painting_router.get("")
def painting_state(entry: ThisPainting, feeds: TheFeedStates) -> dict[str, Any]:
    """Returns the state of a painting, as the page shows it."""
    return {"id": entry.id, "title": entry.title, "begun": entry.begun, **feeds.current(entry.folder, PaintingState)}


@painting_router.get("/camera")
def camera(entry: ThisPainting) -> Response:
    """Returns the current picture of the camera (JPEG). Answers 404 if there is none, or if it is older than 10 s."""
    path = entry.folder.camera
    try:
        if time.time() - path.stat().st_mtime > _LIVE_FOR:
            raise HTTPException(404, _NO_PICTURE)
        content = storage.read_bytes(path, "the camera's picture", _MAX_PICTURE)
    except (OSError, StorageError) as gone:
        raise HTTPException(404, _NO_PICTURE) from gone
    return Response(content, media_type="image/jpeg")


@painting_router.post("/start")
def begin_painting(
    order: Start,
    entry: ThisPainting,
    session: Operating,
    presence: ThePresence,
    store: ThePaintingStore,
    workers: TheWorkers,
    queue: TheQueue,
) -> Mapping[str, str]:
    """Starts to paint one of the plans, or puts it into the queue."""
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


@painting_router.post("/resume")
def resume(
    entry: ThisPainting,
    session: Operating,
    presence: ThePresence,
    store: ThePaintingStore,
    feeds: TheFeedStates,
    workers: TheWorkers,
) -> Mapping[str, str]:
    """Resumes a painting that was stopped, killed or failed."""
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


@painting_router.post("/answer")
def answer_painting(
    given: Reply, entry: ThisPainting, session: Operating, store: ThePaintingStore, feeds: TheFeedStates
) -> Mapping[str, str]:
    """Answers a question of the painter."""
    store.note(session.id, entry.id, f"answer: {given.words}")
    hand_on(given, entry.folder, feeds.current(entry.folder, PaintingState)["question"], session.id)
    return {"id": entry.id}


@painting_router.post("/say")
def say(order: Say, entry: ThisPainting, session: Operating, store: ThePaintingStore) -> Mapping[str, str]:
    """Sends a command to the painter: pause, go on, look, and others."""
    _require_painting(entry)
    store.note(session.id, entry.id, f"{order.kind} {order.count}")
    tell_painter(entry.folder, order.kind, session.id, count=order.count)
    return {"id": entry.id}


@painting_router.post("/region")
def protect(drawn: Drawn, entry: ThisPainting, session: Operating, store: ThePaintingStore) -> Mapping[str, str]:
    """Tells the painter the protected part of the canvas, or the only part that may be painted."""
    _require_painting(entry)
    number = entry.folder.keep_region(store.pictures / f"{drawn.picture}.png")
    store.note(session.id, entry.id, f"region {number}")
    tell_painter(entry.folder, "only" if drawn.only else "spare", session.id, record=number)
    return {"id": entry.id}


@painting_router.post("/goal")
def change_goal(
    request: PaintingRequest, entry: ThisPainting, session: Operating, store: ThePaintingStore
) -> Mapping[str, str]:
    """Changes the goal of a running painting; canvas, brush and paints stay."""
    _require_painting(entry)
    require_possible(request, store)
    number = entry.folder.begin_change(request, store.pictures)
    store.note(session.id, entry.id, f"goal {number}")
    tell_painter(entry.folder, "goal", session.id, record=number)
    return {"id": entry.id}


def _require_painting(entry: Entry) -> None:
    if not (entry.folder.painting.is_dir() and working(entry.folder)):
        raise HTTPException(409, "Nothing is being painted here at the moment.")


# Route of the event stream: one connection for all that a browser shows.

events_router = APIRouter(prefix="/api")
_GALLERY_EVERY = 1.0  # seconds


@events_router.get("/events", response_model=None)
async def events(
    session: AnySession,
    store: ThePaintingStore,
    feeds: TheFeedStates,
    streams: TheStreams,
    of: Annotated[list[str], Query(max_length=MAX_TOPICS)],
) -> EventStream:
    """Streams states to a browser at each change, as server-sent events.

    of: names of topics: ids of paintings, "calibration", and "paintings" for the gallery.
    Answers 404 for an unknown painting, 503 if too many streams are open.
    """
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
        return feeds.view(folder, fresh, lambda state: (state.version, working(folder)))

    return Topic(name, mark, lambda: feeds.current(folder, fresh))


ROUTERS = (
    control_router,
    events_router,
    goals_router,
    painting_router,
    calibration_router,
    gallery_router,
    queue_router,
)
