"""Routes of the studio's web application: paintings, plans, queue, calibration, setup, control, gallery and events.

Each function here is thin: it checks the rights, and asks the studio.
"""

import io
import math
import os
import re
import stat
import time
import zipfile
from collections.abc import AsyncIterator, Callable, Iterator
from dataclasses import dataclass
from pathlib import Path as Path_module
from typing import Annotated, Any

from fastapi import APIRouter, Body, Depends, Header, HTTPException, Path, Query, Request, Response
from fastapi.concurrency import run_in_threadpool
from fastapi.exceptions import RequestValidationError
from fastapi.responses import FileResponse, StreamingResponse
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from starlette.types import Message, Receive, Scope, Send

from frida_painter import storage
from frida_painter.errors import StorageError
from frida_painter_studio.commands import Command, Reply, Role
from frida_painter_studio.jobs import JOBS, Imagining, JobState
from frida_painter_studio.picture_choosing import ChosenPicture, MakingRequest
from frida_painter_studio.security import Led, Session, refuse
from frida_painter_studio.state import MAX_TOPICS, EventStream
from frida_painter_studio.stop import press
from frida_painter_studio.store import Entry
from frida_painter_studio.studio_folder import KeptRequest, PaintingRequest, working
from frida_painter_studio.web_studio import Studio

# Files that are sent.


class SentFile(FileResponse):
    """Response with a file that may be deleted while it is sent.

    If it is gone before the first byte, the answer is 404; after that, the connection ends early.
    """

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Sends the file."""
        held: list[Message] = []  # the beginning of the answer, until the file is open
        begun = False

        async def send_later(message: Message) -> None:
            nonlocal begun
            if message["type"] == "http.response.start":
                held.append(message)
                return
            begun = True
            while held:
                await send(held.pop(0))
            await send(message)

        try:
            self.stat_result = await run_in_threadpool(os.stat, self.path)
            self.set_stat_headers(self.stat_result)
            await super().__call__(scope, receive, send_later)
        except (FileNotFoundError, NotADirectoryError):
            if not begun:
                await refuse(404, "This file was deleted.")(scope, receive, send)


# Rights: the session of a request, and what it may do. They are async functions, which need no thread of the pool,
# which may be full; only an order that another browser's lead refuses needs one.


async def session_of(request: Request) -> Session:
    """Returns the session of the request, which the middleware has accepted."""
    session: Session = request.state.session
    return session


AnySession = Annotated[Session, Depends(session_of)]


async def may_plan(session: AnySession) -> Session:
    """Returns the session. Answers 403 if it may only watch."""
    return _require(session, Role.plan)


async def may_operate(session: AnySession) -> Session:
    """Returns the session. Answers 403 if it may not move the robot."""
    return _require(session, Role.operate)


def _require(session: Session, role: Role) -> Session:
    if session.role < role:
        may = {Role.watch: "watch here", Role.plan: "plan here, and not move the robot"}[session.role]
        raise HTTPException(403, f"With this link you may {may}; ask whoever started the studio for another link.")
    return session


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


Planner = Annotated[Session, Depends(may_plan)]
Operator = Annotated[Session, Depends(may_operate)]
OrderSigns = Annotated[Signs, Depends(signs_of)]


def leader_at(studio: Studio) -> Callable[..., AsyncIterator[Session]]:
    """Returns the check of an order that moves the robot."""

    async def leader(session: Operator, signs: OrderSigns) -> AsyncIterator[Session]:
        """Yields the session of an operator while the order is done.

        Raises Led if another browser leads, Interrupted if the order is old or repeated.
        """
        given = session.id, signs.nonce, signs.given, signs.page
        try:
            studio.lead.require(*given)
        except Led:
            led_until = studio.lead.until
            moves = await run_in_threadpool(studio.may_move)
            if moves or studio.lead.under_way or studio.lead.until != led_until:  # an order came meanwhile
                raise
            studio.lead.take_over(*given)  # nothing is painted: there is nothing to lead
        studio.lead.under_way += 1
        try:
            yield session
        finally:
            studio.lead.under_way -= 1

    return leader


def painting_at(studio: Studio) -> Callable[[str], Entry]:
    """Returns the search for the painting of a path."""

    def painting(identifier: Annotated[str, Path(max_length=64)]) -> Entry:
        """Returns the painting. Answers 404 for an unknown one."""
        entry = studio.store.find(identifier)
        if entry is None:
            raise HTTPException(404, "There is no such painting; it may have been deleted.")
        return entry

    return painting


# Routes for the current work, the queue, the stop and the lead.


def control_routes(studio: Studio) -> APIRouter:
    """Returns the routes for the current work and the queue, and for the stop and the lead.

    The stop is the second way beside the listener's own port.
    """
    router, this = APIRouter(prefix="/api"), Depends(painting_at(studio))

    @router.get("/work")
    def work(by: AnySession) -> dict[str, Any]:
        """Returns who is at work (ids of paintings, "calibration", "setup"), and the queue in order."""
        return studio.work()

    @router.post("/queue/go-on")
    def go_on(by: Operator) -> dict[str, Any]:
        """Lets the queue go on after a stop."""
        studio.store.note(by.id, "", "the queue goes on")
        studio.queue.go_on()
        return studio.queue.to_plain()

    @router.post("/queue/{identifier}/first")
    def first(by: Planner, entry: Entry = this) -> dict[str, Any]:
        """Puts a painting at the front of the queue."""
        studio.queue.first(entry.id)
        return studio.queue.to_plain()

    @router.post("/queue/{identifier}/remove")
    def remove(by: Planner, entry: Entry = this) -> dict[str, Any]:
        """Removes a painting from the queue."""
        studio.queue.remove(entry.id)
        return studio.queue.to_plain()

    @router.post("/stop")
    async def stop(by: AnySession) -> dict[str, int]:
        """Stops all work in this studio; every session may stop.

        The stop uses no thread of the pool and no database.
        """
        return await press(studio.stops, studio.store.root, by.id)

    @router.post("/lead")
    def take_lead(by: Operator, signs: OrderSigns) -> dict[str, str]:
        """Gives the lead to this browser; only it may then move the robot."""
        studio.lead.take_over(by.id, signs.nonce, signs.given, signs.page)
        studio.store.note(by.id, "", "lead")
        return {"leads": "you"}

    @router.post("/lead/back")
    def give_lead_back(by: Operator, signs: OrderSigns) -> dict[str, str]:
        """Gives up the lead, because the page of the last order was left; any browser may then lead."""
        if studio.lead.give_back(by.id, signs.page):
            studio.store.note(by.id, "", "lead given back")
        return {"leads": "nobody"}

    return router


# Routes for jobs beside paintings.


def job_routes(studio: Studio, job: type[JobState]) -> APIRouter:
    """Returns the routes of a job: its request, its state, answers to its questions, and its pictures."""
    router, leader = APIRouter(prefix=f"/api/{job.name}"), Depends(leader_at(studio))
    giver = leader if job is not Imagining else Depends(may_plan)

    @router.get("")
    def state(by: AnySession) -> dict[str, Any]:
        """Returns the state of the job, as the page shows it."""
        return studio.job(job)

    @router.post("/start")
    def start(request: Annotated[dict[str, Any], Body()], by: Session = giver) -> dict[str, str]:
        """Starts the job."""
        studio.begin_job(job, _checked(MakingRequest if job is Imagining else job.request, request), by)
        return {"id": job.name}

    @router.post("/answer")
    def answer(given: Reply, by: Session = leader) -> dict[str, str]:
        """Answers a question, moves brush or tip as asked, or leaves the setup."""
        studio.answer_job(job, given, by)
        return {"id": job.name}

    @router.get("/files/{name}")
    def file(name: str, by: AnySession) -> SentFile:
        """Returns a picture of a question or a result."""
        path = studio.store.job(job.name).find_shown("live", name)
        if path is None:
            raise HTTPException(404, "There is no such picture.")
        return SentFile(path, headers={**_ATTACHED, "Cache-Control": "no-store"})

    return router


def _checked(
    form: type[KeptRequest] | type[MakingRequest], request: dict[str, Any]
) -> KeptRequest | MakingRequest:  # fmt: skip
    """Returns a request in its form. Raises RequestValidationError."""
    try:
        return form.model_validate(request)
    except ValidationError as wrong:
        raise RequestValidationError([{**each, "loc": ("body", *each["loc"])} for each in wrong.errors()]) from wrong


def imagining_routes(studio: Studio) -> APIRouter:
    """Returns the further routes for making pictures from words: its stop, and the choice."""
    router = APIRouter(prefix="/api/imagining")

    @router.post("/stop")
    def stop(by: Planner) -> dict[str, str]:
        """Stops the making, and no other work."""
        studio.stop_imagining(by)
        return {"id": "imagining"}

    @router.post("/choose")
    def choose(chosen: ChosenPicture, by: Planner) -> dict[str, str]:
        """Takes a made picture among the pictures for goals; returns its id, and how it was made."""
        return studio.choose_picture(chosen, by)

    return router


# Routes for existing paintings: the gallery, downloads, and deletion.

_PIECE = 2**18  # bytes
_FIRST_ZIP_DATE = (1980, 1, 1, 0, 0, 0)
_ATTACHED = {"Content-Disposition": "attachment"}


def gallery_routes(studio: Studio) -> APIRouter:
    """Returns the routes for existing paintings: the gallery, downloads, and deletion."""
    router, this = APIRouter(), Depends(painting_at(studio))
    leader = Depends(leader_at(studio))

    @router.get("/api/paintings")
    def paintings(by: AnySession) -> list[dict[str, Any]]:
        """Returns all paintings, the newest first, each with its best picture."""
        return studio.cards()

    @router.post("/api/paintings/{identifier}/delete")
    def delete(entry: Entry = this, by: Session = leader) -> dict[str, str]:
        """Deletes a painting with all its files."""
        studio.delete(entry, by)
        return {"id": entry.id}

    @router.get("/paintings/{identifier}/{place}/{name}")
    def file(place: str, name: str, entry: Entry = this) -> SentFile:
        """Returns a file of a painting that may be shown."""
        path = entry.folder.find_shown(place, name)
        if path is None:
            raise HTTPException(404, "There is no such file.")
        caching = "private, max-age=3600" if place.isdecimal() else "no-store"  # a plan never changes
        return SentFile(path, headers={**_ATTACHED, "Cache-Control": caching})

    @router.get("/api/paintings/{identifier}/everything.zip")
    def everything(entry: Entry = this) -> StreamingResponse:
        """Returns the whole painting as a ZIP file: its page, pictures, film, plan and journal."""
        folder = entry.folder.painting
        linked = folder.is_symlink() or entry.folder.path.is_symlink()
        if linked or not folder.is_dir() or working(entry.folder):
            raise HTTPException(404, "There is nothing to take along yet; wait until the painting is finished.")
        headers = {"Content-Disposition": 'attachment; filename="painting.zip"'}
        return StreamingResponse(zip_folder(folder), media_type="application/zip", headers=headers)

    return router


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
                known = os.fstat(file.fileno())  # not by its path: it may be deleted now
                dated = max(time.localtime(known.st_mtime)[:6], _FIRST_ZIP_DATE)
                about = zipfile.ZipInfo(str(Path_module("painting") / inside), dated)
                about.file_size, about.external_attr = known.st_size, (known.st_mode & 0xFFFF) << 16
                with archive.open(about, "w", force_zip64=about.file_size >= 2**31) as part:
                    while content := file.read(_PIECE):
                        part.write(content)
                        yield outlet.take()
    yield outlet.take()


def _is_hidden(path: Path_module) -> bool:
    """Returns True for a hidden file, needed only during a painting, by its path inside the folder."""
    return any(part.startswith(".") for part in path.parts)


# Routes for requests: pictures, paintings and plans.


def goal_routes(studio: Studio) -> APIRouter:
    """Returns the routes for requests: facts about the studio, pictures, new paintings and plans."""
    router, this = APIRouter(prefix="/api"), Depends(painting_at(studio))

    @router.get("/studio")
    def facts(by: AnySession) -> dict[str, Any]:
        """Returns the facts about this studio for the page, with the port and the secret of its stops."""
        return studio.facts(by.role)

    @router.post("/pictures")
    async def give_picture(request: Request, by: Planner) -> dict[str, str]:
        """Stores a picture from the plain bytes of its file, and returns its id."""
        return {"id": await studio.uploads.keep(await request.body())}

    @router.get("/pictures/{picture}")
    def show_picture(picture: Annotated[str, Path(max_length=64)]) -> SentFile:
        """Returns an uploaded picture."""
        path = studio.store.pictures / f"{picture}.png"
        if not re.fullmatch(r"[0-9a-f]{32}", picture) or not path.is_file():
            raise HTTPException(404, "There is no such picture.")
        return SentFile(path, headers={**_ATTACHED, "Cache-Control": "private, max-age=86400"})

    @router.post("/paintings")
    def begin(request: PaintingRequest, by: Planner) -> dict[str, str]:
        """Begins a painting and its first plan."""
        return {"id": studio.begin(request).id}

    @router.post("/paintings/{identifier}/plans")
    def plan_again(request: PaintingRequest, by: Planner, entry: Entry = this) -> dict[str, str]:
        """Makes another plan for a painting, from the same request or another one."""
        studio.plan_again(entry, request)
        return {"id": entry.id}

    return router


# Routes for one painting.

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


def painting_routes(studio: Studio) -> APIRouter:
    """Returns the routes for one painting: its state, its camera, and orders to its painter."""
    router = APIRouter(prefix="/api/paintings/{identifier}")
    this, leader = Depends(painting_at(studio)), Depends(leader_at(studio))

    @router.get("")
    def state(entry: Entry = this) -> dict[str, Any]:
        """Returns the state of a painting, as the page shows it."""
        return studio.painting(entry)

    @router.get("/camera")
    def camera(entry: Entry = this) -> Response:
        """Returns the camera's current picture (JPEG). Answers 404 if there is none, or if it is older than 10 s."""
        path = entry.folder.camera
        try:
            if time.time() - path.stat().st_mtime > _LIVE_FOR:
                raise HTTPException(404, _NO_PICTURE)
            content = storage.read_bytes(path, "the camera's picture", _MAX_PICTURE)
        except (OSError, StorageError) as gone:
            raise HTTPException(404, _NO_PICTURE) from gone
        return Response(content, media_type="image/jpeg")

    @router.post("/start")
    def start(order: Start, entry: Entry = this, by: Session = leader) -> dict[str, str]:
        """Starts to paint one of the plans, or puts it into the queue."""
        studio.start(entry, order.plan, by, ready=order.ready, wait=order.wait)
        return {"id": entry.id}

    @router.post("/resume")
    def resume(entry: Entry = this, by: Session = leader) -> dict[str, str]:
        """Resumes a painting that was stopped, killed or failed."""
        studio.resume(entry, by)
        return {"id": entry.id}

    @router.post("/answer")
    def answer(given: Reply, entry: Entry = this, by: Session = leader) -> dict[str, str]:
        """Answers a question of the painter."""
        studio.answer(entry, given, by)
        return {"id": entry.id}

    @router.post("/say")
    def say(command: Command, entry: Entry = this, by: Session = leader) -> dict[str, str]:
        """Sends a command to the painter of a running painting: pause, go on, look, protect a region, and others."""
        studio.say(entry, command, by)
        return {"id": entry.id}

    @router.post("/choose")
    def choose(chosen: ChosenPicture, entry: Entry = this, by: Session = leader) -> dict[str, str]:
        """Takes a proposed picture among the pictures for goals; returns its id, and how it was made."""
        return studio.choose_proposal(entry, chosen, by)

    return router


# Route of the event stream: one connection for all that a browser shows.


def event_routes(studio: Studio) -> APIRouter:
    """Returns the route of the event stream."""
    router = APIRouter(prefix="/api")

    @router.get("/events", response_model=None)
    async def events(by: AnySession, of: Annotated[list[str], Query(max_length=MAX_TOPICS)]) -> EventStream:
        """Streams states to a browser at each change, as server-sent events.

        of: names of topics: ids of paintings, names of jobs, and "paintings" for the gallery.
        Answers 404 for an unknown painting, 503 if too many streams are open.
        """
        found = await run_in_threadpool(lambda: [studio.topic(name) for name in dict.fromkeys(of)])
        topics = [topic for topic in found if topic is not None]
        if len(topics) < len(found):
            raise HTTPException(404, "There is no such painting; it may have been deleted.")
        if not studio.streams.take_seat(by.role):
            raise HTTPException(503, "Too many are watching already; close another page first.")
        return EventStream(studio.streams, by.role, topics)

    return router


def all_routes(studio: Studio) -> Iterator[APIRouter]:
    """Yields all routes of a studio."""
    yield from (make(studio) for make in (control_routes, event_routes, goal_routes, painting_routes))
    yield from (job_routes(studio, job) for job in JOBS.values())
    yield from (imagining_routes(studio), gallery_routes(studio))
