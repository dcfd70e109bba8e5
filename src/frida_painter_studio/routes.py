"""Routes of the studio's web application: paintings, plans, queue, jobs, control, downloads and events.

Each of them is thin: it checks the rights, and asks the studio.
"""

import io
import math
import os
import re
import stat
import time
import zipfile
from collections.abc import AsyncIterator, Callable, Iterator
from pathlib import Path as Path_module
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Header, HTTPException, Path, Query, Request, Response
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import FileResponse, StreamingResponse
from pydantic import BaseModel, ConfigDict, Field
from starlette.types import Message, Receive, Scope, Send

from frida_painter.easel.kinds import INBOX, LIVE
from frida_painter.errors import StorageError
from frida_painter.system import storage
from frida_painter.system.operating_system import NOT_LINKS, open_file
from frida_painter_studio.jobs import JOBS, Imagining, JobState
from frida_painter_studio.picture_choosing import ChosenPicture, MakingRequest
from frida_painter_studio.security import Led, Session, refuse
from frida_painter_studio.state import MAX_TOPICS, EventStream
from frida_painter_studio.store import Entry
from frida_painter_studio.studio_folder import PaintingRequest, working
from frida_painter_studio.web_studio import Studio
from frida_painter_together.commands import PageCommand, Role
from frida_painter_together.inbox import Reply

# Files that are sent.


class SentFile(FileResponse):
    """Response with a file that may be deleted while it is sent.

    If it is gone before the first byte, the answer is 404; after that, the connection ends early.
    """

    def __init__(self, path: Path_module | None, what: str = "file", caching: str = "no-store") -> None:
        """path: None raises the answer 404 that says there is no such `what`."""
        if path is None:
            raise HTTPException(404, f"There is no such {what}.")
        super().__init__(path, headers={"Content-Disposition": "attachment", "Cache-Control": caching})

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


_PIECE = 2**18  # bytes
_FIRST_ZIP_DATE = (1980, 1, 1, 0, 0, 0)


class _Outlet(io.RawIOBase):
    """Stream that holds the written bytes until they are taken."""

    held = b""

    def write(self, content: Any) -> int:
        self.held += content
        return len(content)

    def take(self) -> bytes:
        held, self.held = self.held, b""
        return held


def zip_folder(folder: Path_module) -> Iterator[bytes]:
    """Yields a ZIP file of a painting in pieces, without what serves only its page, links or hidden files."""
    outlet = _Outlet()
    with zipfile.ZipFile(outlet, "w", zipfile.ZIP_STORED) as archive:
        for path in sorted(folder.rglob("*")):
            inside = path.relative_to(folder)
            hidden = inside.parts[0] in (INBOX, LIVE) or any(part.startswith(".") for part in inside.parts)
            if hidden or any((folder / part).is_symlink() for part in (inside, *inside.parents)):
                continue
            try:
                file = os.fdopen(open_file(path, os.O_RDONLY | NOT_LINKS), "rb")
            except OSError:
                continue  # deleted meanwhile, or not readable
            with file:
                known = os.fstat(file.fileno())  # not by its path: it may be deleted now
                if not stat.S_ISREG(known.st_mode):
                    continue
                dated = max(time.localtime(known.st_mtime)[:6], _FIRST_ZIP_DATE)
                about = zipfile.ZipInfo(str(Path_module("painting") / inside), dated)
                about.file_size, about.external_attr = known.st_size, (known.st_mode & 0xFFFF) << 16
                with archive.open(about, "w", force_zip64=about.file_size >= 2**31) as part:
                    while content := file.read(_PIECE):
                        part.write(content)
                        yield outlet.take()
    yield outlet.take()


# Rights: the session of a request, and what it may do. They are async functions, which need no thread of the pool,
# which may be full; only an order that another browser's lead refuses needs one.


async def session_of(request: Request) -> Session:
    """Returns the session of the request, which the middleware has accepted."""
    session: Session = request.state.session
    return session


AnySession = Annotated[Session, Depends(session_of)]


def _at_least(role: Role) -> Any:
    """Returns the dependency that answers 403 if the session has a lower role."""

    async def require(session: AnySession) -> Session:
        if session.role < role:
            may = {Role.watch: "watch here", Role.plan: "plan here, and not move the robot"}[session.role]
            raise HTTPException(403, f"With this link you may {may}; ask whoever started the studio for another link.")
        return session

    return Depends(require)


async def signs_of(
    x_nonce: Annotated[str, Header(max_length=64)] = "",
    x_given: Annotated[float, Header()] = math.nan,
    x_page: Annotated[str, Header(max_length=64)] = "",
) -> tuple[str, float, str]:
    """Returns the number and the time of an order, and the page that gave it; `Lead` checks them."""
    return x_nonce, x_given, x_page


Planner = Annotated[Session, _at_least(Role.plan)]
Operator = Annotated[Session, _at_least(Role.operate)]
Signs = Annotated[tuple[str, float, str], Depends(signs_of)]


def leader_at(studio: Studio) -> Callable[..., AsyncIterator[Session]]:
    """Returns the check of an order that moves the robot."""

    async def leader(session: Operator, signs: Signs) -> AsyncIterator[Session]:
        """Yields the session of an operator while the order is done.

        Raises Led if another browser leads, Interrupted if the order is old or repeated.
        """
        try:
            studio.lead.require(session.id, *signs)
        except Led:
            led_until = studio.lead.until
            moves = await run_in_threadpool(studio.may_move)
            if moves or studio.lead.under_way or studio.lead.until != led_until:  # an order came meanwhile
                raise
            studio.lead.take_over(session.id, *signs)  # nothing is painted: there is nothing to lead
        studio.lead.under_way += 1
        try:
            yield session
        finally:
            studio.lead.under_way -= 1

    return leader


def painting_at(studio: Studio) -> Callable[[str], Entry]:
    """Returns the search for the painting of a path, which answers 404 for an unknown one."""

    def painting(identifier: Annotated[str, Path(max_length=64)]) -> Entry:
        entry = studio.store.find(identifier)
        if entry is None:
            raise HTTPException(404, "There is no such painting; it may have been deleted.")
        return entry

    return painting


def studio_routes(studio: Studio) -> APIRouter:
    """Returns the routes for facts, events, pictures, the queue, the lead, and the second way of a stop."""
    router, this = APIRouter(prefix="/api"), Depends(painting_at(studio))

    @router.get("/studio")
    def facts(by: AnySession) -> dict[str, Any]:
        return studio.facts(by.role)

    @router.get("/work")
    def work(by: AnySession) -> dict[str, Any]:
        return studio.work()

    @router.get("/events", response_model=None)
    async def events(by: AnySession, of: Annotated[list[str], Query(max_length=MAX_TOPICS)]) -> EventStream:
        """Topics, `of`: ids of paintings, names of jobs, and "paintings" for the gallery."""
        found = await run_in_threadpool(lambda: [studio.topic(name) for name in dict.fromkeys(of)])
        topics = [topic for topic in found if topic is not None]
        if len(topics) < len(found):
            raise HTTPException(404, "There is no such painting; it may have been deleted.")
        if not studio.streams.take_seat(by.role):
            raise HTTPException(503, "Too many are watching already; close another page first.")
        return EventStream(studio.streams, by.role, topics)

    @router.post("/pictures")
    async def give_picture(request: Request, by: Planner) -> dict[str, str]:
        """Stores a picture from the plain bytes of its file."""
        return {"id": await studio.uploads.keep(await request.body())}

    @router.post(f"/{Imagining.name}/stop")
    def stop_imagining(by: Planner) -> dict[str, str]:
        """Stops the making of pictures from words, and no other work."""
        studio.stop_imagining(by)
        return {"id": Imagining.name}

    @router.post(f"/{Imagining.name}/choose")
    def choose(chosen: ChosenPicture, by: Planner) -> dict[str, str]:
        return studio.choose_picture(chosen, by)

    @router.get("/pictures/{picture}")
    def show_picture(picture: Annotated[str, Path(max_length=64)]) -> SentFile:
        path = studio.store.pictures / f"{picture}.png"
        known = re.fullmatch(r"[0-9a-f]{32}", picture) and path.is_file()
        return SentFile(path if known else None, "picture", "private, max-age=86400")

    @router.post("/queue/go-on")
    def go_on(by: Operator) -> dict[str, Any]:
        studio.store.note(by.id, "", "the queue goes on")
        studio.queue.go_on()
        return studio.queue.to_plain()

    @router.post("/queue/{identifier}/first")
    def first(by: Planner, entry: Entry = this) -> dict[str, Any]:
        studio.queue.first(entry.id)
        return studio.queue.to_plain()

    @router.post("/queue/{identifier}/remove")
    def remove(by: Planner, entry: Entry = this) -> dict[str, Any]:
        studio.queue.remove(entry.id)
        return studio.queue.to_plain()

    @router.post("/stop")
    async def stop(by: AnySession) -> dict[str, int]:
        """Stops all work, for every role; it uses no thread of the pool and no database."""
        return await studio.stops.press_at_listener(by.id)

    @router.post("/lead")
    def take_lead(by: Operator, signs: Signs) -> dict[str, str]:
        """Gives the lead to this browser; only it may then move the robot."""
        studio.lead.take_over(by.id, *signs)
        studio.store.note(by.id, "", "lead")
        return {"leads": "you"}

    @router.post("/lead/back")
    def give_lead_back(by: Operator, signs: Signs) -> dict[str, str]:
        """Gives up the lead, because the page of the last order was left; any browser may then lead."""
        if studio.lead.give_back(by.id, signs[2]):
            studio.store.note(by.id, "", "lead given back")
        return {"leads": "nobody"}

    return router


def job_routes(studio: Studio, job: type[JobState]) -> APIRouter:
    """Returns the routes of a job: its request, its state, answers to its questions, and its pictures."""
    router, leader = APIRouter(prefix=f"/api/{job.name}"), Depends(leader_at(studio))
    giver, form = (_at_least(Role.plan), MakingRequest) if job is Imagining else (leader, job.request)

    @router.get("")
    def state(by: AnySession) -> dict[str, Any]:
        return studio.job(job)

    @router.post("/start")
    def start(request: form, by: Session = giver) -> dict[str, str]:  # type: ignore[valid-type]
        studio.begin_job(job, request, by)
        return {"id": job.name}

    @router.post("/answer")
    def answer(given: Reply, by: Session = leader) -> dict[str, str]:
        studio.answer(job, given, by)
        return {"id": job.name}

    @router.get("/files/{name}")
    def file(name: str, by: AnySession) -> SentFile:
        return SentFile(studio.store.job(job.name).find_shown("live", name), "picture")

    return router


# Routes for paintings.

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
    """Returns the routes for paintings: requests, state, camera, orders to the painter, and their files."""
    router = APIRouter()
    this, leader, one = Depends(painting_at(studio)), Depends(leader_at(studio)), "/api/paintings/{identifier}"

    @router.get("/api/paintings")
    def paintings(by: AnySession) -> list[dict[str, Any]]:
        return studio.cards()

    @router.post("/api/paintings")
    def begin(request: PaintingRequest, by: Planner, variants: bool = False) -> dict[str, str]:
        return {"id": studio.begin(request, variants=variants).id}

    @router.post(f"{one}/plans")
    def plan_again(
        request: PaintingRequest, by: Planner, variants: bool = False, entry: Entry = this
    ) -> dict[str, str]:
        studio.plan_again(entry, request, variants=variants)
        return {"id": entry.id}

    @router.get(one)
    def state(entry: Entry = this) -> dict[str, Any]:
        return studio.painting(entry)

    @router.get(f"{one}/camera")
    def camera(entry: Entry = this) -> Response:
        path = entry.folder.camera
        try:
            if time.time() - path.stat().st_mtime > _LIVE_FOR:
                raise HTTPException(404, _NO_PICTURE)
            content = storage.read_bytes(path, "the camera's picture", _MAX_PICTURE)
        except (OSError, StorageError) as gone:
            raise HTTPException(404, _NO_PICTURE) from gone
        return Response(content, media_type="image/jpeg")

    @router.post(f"{one}/start")
    def start(order: Start, entry: Entry = this, by: Session = leader) -> dict[str, str]:
        studio.start(entry, order.plan, by, ready=order.ready, wait=order.wait)
        return {"id": entry.id}

    @router.post(f"{one}/resume")
    def resume(entry: Entry = this, by: Session = leader) -> dict[str, str]:
        studio.resume(entry, by)
        return {"id": entry.id}

    @router.post(f"{one}/answer")
    def answer(given: Reply, entry: Entry = this, by: Session = leader) -> dict[str, str]:
        studio.answer(entry, given, by)
        return {"id": entry.id}

    @router.post(f"{one}/say")
    def say(command: PageCommand, entry: Entry = this, by: Session = leader) -> dict[str, str]:
        studio.say(entry, command, by)
        return {"id": entry.id}

    @router.post(f"{one}/choose")
    def choose(chosen: ChosenPicture, entry: Entry = this, by: Session = leader) -> dict[str, str]:
        return studio.choose_picture(chosen, by, entry)

    @router.post(f"{one}/delete")
    def delete(entry: Entry = this, by: Session = leader) -> dict[str, str]:
        studio.delete(entry, by)
        return {"id": entry.id}

    @router.get("/paintings/{identifier}/{place}/{name}")
    def file(place: str, name: str, entry: Entry = this) -> SentFile:
        caching = "private, max-age=3600" if place.isdecimal() else "no-store"  # a plan never changes
        return SentFile(entry.folder.find_shown(place, name), "file", caching)

    @router.get(f"{one}/everything.zip")
    def everything(entry: Entry = this) -> StreamingResponse:
        folder = entry.folder.painting
        linked = folder.is_symlink() or entry.folder.path.is_symlink()
        if linked or not folder.is_dir() or working(entry.folder):
            raise HTTPException(404, "There is nothing to take along yet; wait until the painting is finished.")
        headers = {"Content-Disposition": 'attachment; filename="painting.zip"'}
        return StreamingResponse(zip_folder(folder), media_type="application/zip", headers=headers)

    return router


def all_routes(studio: Studio) -> Iterator[APIRouter]:
    """Yields all routes of a studio."""
    yield studio_routes(studio)
    yield painting_routes(studio)
    yield from (job_routes(studio, job) for job in JOBS.values())
