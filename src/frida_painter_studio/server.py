"""Server of the studio: the web application, its address and its links."""

import asyncio
import contextlib
import gzip
import json
import secrets
import socket
import sys
import threading
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

import uvicorn
from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse, Response
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp

from frida_painter.errors import ConfigError, FridaError, Interrupted, RobotStopped, StorageError
from frida_painter.system import storage
from frida_painter.system.operating_system import IS_WINDOWS
from frida_painter_studio.network import Certificate, Connections, Limits, WaitingProtocol, most_connections, share_lock
from frida_painter_studio.picture_choosing import AllowedMakers
from frida_painter_studio.routes import all_routes
from frida_painter_studio.security import AuthMiddleware, Keys, Led, Presence, refuse
from frida_painter_studio.state import StateStreams
from frida_painter_studio.stop_listener import StopProcess
from frida_painter_studio.store import PaintingStore
from frida_painter_studio.web_app_easel import LOCAL, WebAppEasel
from frida_painter_studio.web_studio import Studio
from frida_painter_together.commands import Role

# Web application of the studio: its routes, its middleware, and errors as sentences.

_STATIC, _EXAMPLES = (Path(__file__).parent / name for name in ("static", "examples"))
_KINDS = {
    ".html": "text/html", ".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml", ".png": "image/png",
    ".jpg": "image/jpeg", ".webmanifest": "application/manifest+json",
}  # fmt: skip


def _read_page() -> dict[str, tuple[bytes, bytes | None, str]]:
    """Returns the files of the page by their path: plain, compressed unless they are pictures, and their kind."""
    page = {}
    for path in (path for folder in (_STATIC, _EXAMPLES) for path in folder.iterdir() if path.suffix in _KINDS):
        content = path.read_bytes()
        compressed = None if path.suffix in (".png", ".jpg") else gzip.compress(content, mtime=0)
        page[f"{path.parent.name}/{path.name}"] = content, compressed, _KINDS[path.suffix]
    # The scope of a service worker is the folder that it comes from.
    return page | {"": page["static/index.html"], "sw.js": page["static/sw.js"]}


def application(studio: Studio) -> FastAPI:
    """Returns the application with its routes, without the middleware that checks users."""
    app = FastAPI(title="frida-painter studio", docs_url=None, redoc_url=None, openapi_url=None)
    for router in all_routes(studio):
        app.include_router(router)
    # The files are in memory and need no thread, so the page loads quickly even while planning uses the machine.
    files = _read_page()

    @app.get("/{path:path}", include_in_schema=False)
    async def page(path: str, request: Request) -> Response:
        if path not in files:
            raise HTTPException(404, "The page has no such part.")
        content, compressed, kind = files[path]
        if compressed is None or "gzip" not in request.headers.get("accept-encoding", ""):
            return Response(content, media_type=kind)
        return Response(compressed, media_type=kind, headers={"Content-Encoding": "gzip", "Vary": "Accept-Encoding"})

    def refuse_mendable(request: Request, error: Exception) -> JSONResponse:
        sentence = str(error).replace(str(studio.store.root), "the studio's folder")
        led = {"led": True} if isinstance(error, Led) else {}
        return refuse(409 if isinstance(error, Interrupted | RobotStopped) else 422, sentence, **led)

    def refuse_plainly(request: Request, error: Exception) -> JSONResponse:
        assert isinstance(error, HTTPException)
        return JSONResponse({"sentence": error.detail}, error.status_code, error.headers)

    app.add_exception_handler(FridaError, refuse_mendable)
    app.add_exception_handler(HTTPException, refuse_plainly)
    app.add_exception_handler(RequestValidationError, _refuse_invalid)
    app.add_exception_handler(Exception, _refuse_unforeseen)
    return app


def add_middleware(
    app: ASGIApp, keys: Keys, hosts: frozenset[str], cookie: str, stop_hosts: frozenset[str] = frozenset()
) -> ASGIApp:
    """Returns the application with its middleware, ready to be served."""
    return AuthMiddleware(Limits(app, "/api/pictures"), keys, hosts, cookie, stop_hosts)


def _refuse_invalid(request: Request, error: Exception) -> JSONResponse:
    """Answers 422 with the fault of a request, without repeating its content.

    The sentence is for a person at the page; `fault` names the field, for programs.
    """
    assert isinstance(error, RequestValidationError)
    first = error.errors()[0]
    own = str(first["msg"]).removeprefix("Value error, ")
    places = [str(part) for part in first["loc"][1:] if isinstance(part, int) or str(part).isidentifier()]
    unknown = "The studio does not take this request. Reload the page, and ask again."
    sentence = own if first["type"] == "value_error" else unknown
    return refuse(422, sentence, fault=f"{'.'.join(places)[:80]}: {own}" if places else own)


def _refuse_unforeseen(request: Request, error: Exception) -> JSONResponse:
    mark = secrets.token_hex(4)
    print(mark, "".join(traceback.format_exception(error)), file=sys.stderr)
    return refuse(500, f"Something went wrong that should not have; its number in the log is {mark}.")


_BACKLOG = 1024
_MAX_HEAD = 16 * 1024
_PATIENCE = 10.0  # seconds for the head of a request


class _Server(uvicorn.Server):
    """Server that limits its connections, and ends event streams before it waits for open requests."""

    def __init__(
        self, config: uvicorn.Config, streams: StateStreams, listening: socket.socket, stop: StopProcess
    ) -> None:
        super().__init__(config)
        self._streams, self._listening, self._stop = streams, listening, stop
        self._tls = None if stop.certificate is None else stop.certificate.context()
        self._tasks: list[asyncio.Task[None]] = []

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets=[])  # `Connections` accepts them

        def make() -> WaitingProtocol:
            return WaitingProtocol(self.config, self.server_state, self.lifespan.state, asyncio.get_running_loop())

        connections = Connections(self._listening, make, most=most_connections(), patience=_PATIENCE, tls=self._tls)
        self._tasks = [asyncio.create_task(work) for work in (connections.accept(), self._stop.keep())]

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        for task in self._tasks:
            task.cancel()
        self._streams.end()
        await super().shutdown([self._listening])


def listen(address: str, port: int) -> socket.socket:
    """Returns a listening socket on that address; port 0 takes a free one. Raises ConfigError if it cannot be used."""
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    listening = socket.socket(family, socket.SOCK_STREAM)
    try:
        if not IS_WINDOWS:  # another program could take the port there
            listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind((address, port))
        listening.listen(_BACKLOG)  # browsers now wait instead of being refused
    except OSError as error:
        listening.close()
        raise ConfigError(
            f"--address {address} --port {port} cannot be used ({error.strerror}); give another one; "
            "port 0 takes one that is free."
        ) from error
    return listening


def names_of(address: str, names: tuple[str, ...] = ()) -> frozenset[str]:
    """Returns the host names of this machine in browsers, for a studio on that address."""
    return frozenset({address, *names, *(("localhost",) if address in (LOCAL, "::1") else ())})


def hosts(address: str, port: int, names: tuple[str, ...] = ()) -> frozenset[str]:
    """Returns the host names with the port, as in the Host header, for a studio on that address."""
    return frozenset(f"[{name}]:{port}" if ":" in name else f"{name}:{port}" for name in names_of(address, names))


_LINKS = ".links.json"
OPENING_PAGE = "open-the-studio.html"
"""Name of a page in the studio's folder that leads to its link."""


@dataclass(frozen=True)
class Links:
    """Links that open the studio.

    roles: link of each role, valid while the studio is open.
    once: link for an operator, valid once and for a minute.
    """

    roles: dict[Role, str]
    once: str

    def keep(self, root: Path) -> None:
        """Writes the links of the roles for `read_links`, readable by the owner of the folder alone."""
        with storage.replacing(root / _LINKS, mode=0o600) as temporary:
            temporary.write_text(json.dumps({role.name: link for role, link in self.roles.items()}), encoding="utf-8")


def read_links(root: Path) -> dict[Role, str]:
    """Returns the links of the studio that is open in a folder. Raises ConfigError if none is."""
    try:
        kept = json.loads(storage.read_bytes(root / _LINKS, "the links of a studio", _MAX_HEAD))
        links = {role: str(kept[role.name]) for role in Role}
        place = urlsplit(links[Role.operate])
        with socket.create_connection((place.hostname or "", place.port or 0), timeout=_PATIENCE):
            return links
    except (StorageError, KeyError, TypeError, ValueError, OSError) as error:
        raise ConfigError(f"No studio is open in {root}; open it with: frida-painter studio --folder {root}") from error


def forget_links(root: Path) -> None:
    """Removes the links of a studio that closes, and the page that opens it."""
    for name in (_LINKS, OPENING_PAGE):
        (root / name).unlink(missing_ok=True)


def serve(
    store: PaintingStore,
    easel: WebAppEasel,
    listening: socket.socket,
    names: tuple[str, ...],
    tell: Callable[[Links], None],
    stop_port: int = 0,
    certificate: Certificate | None = None,
    makers: AllowedMakers | None = None,
) -> None:
    """Serves the studio until it is interrupted; `tell` receives the links when the studio is ready.

    Each line typed into the standard input confirms that somebody stands at the machine.
    stop_port: port of the listener for stops, by default the one after the page's port.
    makers: picture makers that visitors may choose.
    Raises ConfigError and StorageError.
    """
    address, port = listening.getsockname()[:2]
    share_lock(store.root)
    called = names_of(address, names)
    stop = StopProcess(
        store.root, lambda wanted: listen(address, wanted), called, stop_port or min(port + 1, 65535), certificate
    )
    stop.start()
    known = hosts(address, port, names)
    keys, studio = Keys(), Studio(store, easel, Presence(), stop, makers)
    config = uvicorn.Config(
        add_middleware(application(studio), keys, known, f"studio-{port}", stop_hosts=hosts(address, stop.port, names)),
        log_level="warning",
        access_log=False,
        server_header=False,
        timeout_keep_alive=10,
        timeout_graceful_shutdown=2,
        ws="none",
        h11_max_incomplete_event_size=_MAX_HEAD,
    )
    with contextlib.suppress(OSError, ValueError):  # there may be no standard input at all
        studio.presence.listen(sys.stdin.fileno())
    for name, work in (("queue", studio.queue.run), ("reading", studio.read_ahead)):
        threading.Thread(target=work, daemon=True, name=name).start()
    server = _Server(config, studio.streams, listening, stop)
    first = f"{names[0]}:{port}" if names else sorted(known)[0]
    page = f"{'http' if certificate is None else 'https'}://{first}/?token="
    links = Links({role: f"{page}{token}" for role, token in keys.tokens.items()}, page + keys.code(Role.operate))
    links.keep(store.root)
    tell(links)
    try:
        server.run()
    finally:
        forget_links(store.root)
