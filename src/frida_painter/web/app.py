"""The studio's web application: its routes, its middleware, and errors as sentences."""

import gzip
import secrets
import sys
import traceback
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse, Response
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp

from frida_painter.errors import FridaError, Interrupted, RobotStopped
from frida_painter.web import following, gallery, goals, in_charge, painting, procedures, queueing
from frida_painter.web.access import AuthMiddleware, Keys
from frida_painter.web.feed_states import FeedStates
from frida_painter.web.lead import Lead, Led
from frida_painter.web.limits import Limits
from frida_painter.web.painting_queue import PaintingQueue
from frida_painter.web.painting_store import PaintingStore
from frida_painter.web.presence import Presence
from frida_painter.web.state_stream import StateStreams
from frida_painter.web.stops import Stops
from frida_painter.web.studio_easel import StudioEasel
from frida_painter.web.studio_pace import PaceMemory
from frida_painter.web.uploads import Uploads
from frida_painter.web.workers import Workers

_STATIC = Path(__file__).parent / "static"
_KINDS = {
    ".html": "text/html", ".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml", ".png": "image/png",
    ".webmanifest": "application/manifest+json",
}  # fmt: skip


@dataclass(frozen=True)
class _Part:
    """A file of the page, as it is and compressed; pictures are compressed already."""

    content: bytes
    kind: str
    compressed: bytes | None

    @classmethod
    def read(cls, path: Path) -> Self:
        content = path.read_bytes()
        compressed = None if path.suffix == ".png" else gzip.compress(content, mtime=0)
        return cls(content, _KINDS[path.suffix], compressed)

    def answer(self, request: Request) -> Response:
        if self.compressed is None or "gzip" not in request.headers.get("accept-encoding", ""):
            return Response(self.content, media_type=self.kind)
        headers = {"Content-Encoding": "gzip", "Vary": "Accept-Encoding"}
        return Response(self.compressed, media_type=self.kind, headers=headers)


def application(store: PaintingStore, easel: StudioEasel, presence: Presence) -> FastAPI:
    """The routes alone, for those who are already inside."""
    app = FastAPI(title="frida-painter studio", docs_url=None, redoc_url=None, openapi_url=None)
    app.state.store, app.state.streams, app.state.workers = store, StateStreams(), Workers(easel)
    app.state.feeds, app.state.lead, app.state.presence = FeedStates(), Lead(), presence
    app.state.stops, app.state.stop_process = Stops(store.root), None
    app.state.pace = PaceMemory()
    app.state.queue, app.state.uploads = PaintingQueue(store, app.state.workers), Uploads(store.pictures)
    for part in (in_charge, following, goals, painting, procedures, gallery, queueing):
        app.include_router(part.router)

    # From memory, and on no thread: a page is there at once, however busy the machine is with planning.
    parts = {path.name: _Part.read(path) for path in _STATIC.iterdir() if path.suffix in _KINDS}

    @app.get("/", include_in_schema=False)
    async def page(request: Request) -> Response:
        """The page."""
        return parts["index.html"].answer(request)

    @app.get("/sw.js", include_in_schema=False)
    async def service_worker(request: Request) -> Response:
        """The page's service worker, which may serve only what is below the place that it comes from."""
        return parts["sw.js"].answer(request)

    @app.get("/static/{name}", include_in_schema=False)
    async def page_part(name: str, request: Request) -> Response:
        """A part of the page."""
        if name not in parts:
            raise HTTPException(404, "The page has no such part.")
        return parts[name].answer(request)

    app.add_exception_handler(FridaError, _mendable)
    app.add_exception_handler(HTTPException, _refused)
    app.add_exception_handler(RequestValidationError, _not_understood)
    app.add_exception_handler(Exception, _unforeseen)
    return app


def guarded(
    app: ASGIApp, keys: Keys, hosts: frozenset[str], cookie: str, stop_hosts: frozenset[str] = frozenset()
) -> ASGIApp:
    """The application with its middleware, to be served."""
    return AuthMiddleware(Limits(app, "/api/pictures"), keys, hosts, cookie, stop_hosts)


def _mendable(request: Request, error: Exception) -> JSONResponse:
    store: PaintingStore = request.app.state.store
    sentence = str(error).replace(str(store.root), "the studio's folder")
    led = {"led": True} if isinstance(error, Led) else {}
    return JSONResponse({"sentence": sentence, **led}, 409 if isinstance(error, Interrupted | RobotStopped) else 422)


def _refused(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, HTTPException)
    return JSONResponse({"sentence": error.detail}, error.status_code, error.headers)


def _not_understood(request: Request, error: Exception) -> JSONResponse:
    """What is wrong with what was sent, without giving any of it back."""
    assert isinstance(error, RequestValidationError)
    first = error.errors()[0]
    own = str(first["msg"]).removeprefix("Value error, ")
    name = ".".join(str(part) for part in first["loc"] if isinstance(part, int) or str(part).isidentifier())[:80]
    sentence = own if first["type"] == "value_error" else f"{own} ({name})."
    return JSONResponse({"sentence": sentence}, 422)


def _unforeseen(request: Request, error: Exception) -> JSONResponse:
    mark = secrets.token_hex(4)
    print(mark, "".join(traceback.format_exception(error)), file=sys.stderr)
    return JSONResponse(
        {"sentence": f"Something went wrong that should not have; its number in the log is {mark}."}, 500
    )
