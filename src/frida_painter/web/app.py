"""The studio's web application: its routes, its middleware, and errors as sentences."""

import secrets
import sys
import traceback
from pathlib import Path

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse, Response
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp

from frida_painter.errors import FridaError, Interrupted, RobotStopped
from frida_painter.web import gallery, goals, in_charge, painting, procedures
from frida_painter.web.access import AuthMiddleware, Keys
from frida_painter.web.lead import Lead, Led
from frida_painter.web.limits import Bucket, Limits
from frida_painter.web.painting_store import PaintingStore
from frida_painter.web.presence import Presence
from frida_painter.web.state_stream import StateStreams
from frida_painter.web.studio_easel import StudioEasel
from frida_painter.web.workers import Workers

_STATIC = Path(__file__).parent / "static"
_KINDS = {
    ".html": "text/html", ".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml", ".png": "image/png",
    ".webmanifest": "application/manifest+json",
}  # fmt: skip


def application(store: PaintingStore, easel: StudioEasel, presence: Presence) -> FastAPI:
    """The routes alone, for those who are already inside."""
    app = FastAPI(title="frida-painter studio", docs_url=None, redoc_url=None, openapi_url=None)
    app.state.store, app.state.streams, app.state.workers = store, StateStreams(), Workers(easel)
    app.state.lead, app.state.presence = Lead(), presence
    for part in (in_charge, goals, painting, procedures, gallery):
        app.include_router(part.router)

    # From memory, and on no thread: a page is there at once, however busy the machine is with planning.
    parts = {path.name: (path.read_bytes(), _KINDS[path.suffix]) for path in _STATIC.iterdir() if path.suffix in _KINDS}

    @app.get("/", include_in_schema=False)
    async def page() -> Response:
        """The page."""
        content, kind = parts["index.html"]
        return Response(content, media_type=kind)

    @app.get("/sw.js", include_in_schema=False)
    async def service_worker() -> Response:
        """The page's service worker, which may serve only what is below the place that it comes from."""
        content, kind = parts["sw.js"]
        return Response(content, media_type=kind)

    @app.get("/static/{name}", include_in_schema=False)
    async def page_part(name: str) -> Response:
        """A part of the page."""
        if name not in parts:
            raise HTTPException(404, "The page has no such part.")
        content, kind = parts[name]
        return Response(content, media_type=kind)

    app.add_exception_handler(FridaError, _mendable)
    app.add_exception_handler(HTTPException, _refused)
    app.add_exception_handler(RequestValidationError, _not_understood)
    app.add_exception_handler(Exception, _unforeseen)
    return app


def guarded(app: ASGIApp, keys: Keys, hosts: frozenset[str], cookie: str) -> ASGIApp:
    """The application with its middleware, to be served."""
    return AuthMiddleware(Limits(app, "/api/pictures", Bucket(rate=40, most=200)), keys, hosts, cookie)


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
