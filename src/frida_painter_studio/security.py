"""Security of the studio: middleware before all routes that checks tokens, hosts, origins and roles, and the lead.

The studio controls a machine, so no request is trusted because of its origin. A browser brings a token once, and
gets a cookie and a key. A cookie goes to every port of a host, so the cookie alone opens only the page's own files
and pictures with unguessable names. All other requests need the key, which only pages of exactly this address and
port can read. A program sends its token with every request.
"""

import asyncio
import contextlib
import hmac
import math
import os
import re
import secrets
import threading
import time
from collections import OrderedDict
from dataclasses import dataclass, field
from http.cookies import CookieError, SimpleCookie
from pathlib import Path
from urllib.parse import parse_qsl, urlencode

from h11 import LocalProtocolError
from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import HTMLResponse, JSONResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from frida_painter.errors import Interrupted, RobotStopped
from frida_painter.system.operating_system import is_in_background, is_typed
from frida_painter_studio.web_app_easel import WebAppEasel
from frida_painter_together.commands import Role
from frida_painter_together.inbox import LEAD_GOOD_FOR

_MAX_SESSIONS = {Role.watch: 200, Role.plan: 100, Role.operate: 50}
_FREE_FAILURES, _FAILURES_COUNT_FOR = 10, 60.0  # wrong tokens; seconds
_DELAY, _MAX_DELAYED = 1.0, 16  # seconds; answers to wrong tokens
_CODE_GOOD_FOR = 60.0
_MAX_HEADERS = 16 * 1024
_SAFE = ("GET", "HEAD")
_BY_COOKIE = re.compile(
    r"/|/(?:static|examples)/[^/]*|/sw\.js|/paintings/.*|/api/pictures/[^/]+"
    r"|/api/(?:calibration|setup|teaching|imagining)/files/[^/]+|/api/paintings/[^/]+/(?:everything\.zip|camera)"
)
_HEADERS = {
    "Content-Security-Policy": "default-src 'self'; img-src 'self' blob: data:; connect-src 'self'{stop}; "
    "object-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), microphone=(), geolocation=()",
}
# Page for a browser that the studio does not know, with the files that it needs. They tell nothing about the studio.
_STATIC = Path(__file__).parent / "static"
_PARTS_OF_CLOSED = {
    "closed.js": "text/javascript", "stop.js": "text/javascript", "session.js": "text/javascript",
    "base.css": "text/css", "studio.css": "text/css", "stop.css": "text/css", "icon.svg": "image/svg+xml",
}  # fmt: skip
_OPENING = """<!DOCTYPE html><html lang="en"><meta charset="utf-8"><title>The studio opens</title>
<meta http-equiv="refresh" content="0;url={address}"><p><a href="{address}">Open the studio</a></p></html>"""


@dataclass(frozen=True)
class Session:
    """Browser that came with a token, or program that always sends it.

    key: secret in all requests of the page.
    """

    id: str
    role: Role
    key: str


class Keys:
    """Tokens of one start of the studio, one for each role, and the sessions of browsers."""

    def __init__(self) -> None:
        self.tokens = {role: secrets.token_urlsafe(32) for role in Role}
        self._sessions: dict[Role, OrderedDict[str, Session]] = {role: OrderedDict() for role in Role}
        self._codes: dict[str, tuple[Role, float]] = {}

    def code(self, role: Role) -> str:
        """Returns a code in place of a token, valid once and for a minute.

        It is for places that others can read, such as the command line of a browser.
        """
        code = secrets.token_urlsafe(24)
        self._codes[code] = (role, time.monotonic() + _CODE_GOOD_FOR)
        return code

    def admit(self, token: str) -> Session | None:
        """Returns a new session for a token or a code, None for a wrong one.

        The number of sessions of a role is limited; a new session replaces the role's least recently used one.
        """
        role = self._role(token)
        if role is None:
            role, until = self._codes.pop(token, (None, 0.0))
            if role is None or time.monotonic() > until:
                return None
        session = Session(secrets.token_urlsafe(24), role, secrets.token_urlsafe(24))
        own = self._sessions[role]
        if len(own) >= _MAX_SESSIONS[role]:
            own.popitem(last=False)
        own[session.id] = session
        return session

    def session(self, cookie: str) -> Session | None:
        """Returns the session of a browser's cookie; None if it is unknown."""
        for own in self._sessions.values():
            if cookie in own:
                own.move_to_end(cookie)
                return own[cookie]
        return None

    def bearer(self, token: str) -> Session | None:
        """Returns the session of a program; None for a wrong token."""
        role = self._role(token)
        return None if role is None else Session(f"bearer-{role.name}", role, "")

    def _role(self, token: str) -> Role | None:
        given = token.encode("utf-8", "replace")
        matching = [role for role, known in self.tokens.items() if hmac.compare_digest(known.encode(), given)]
        return matching[0] if matching else None


class AuthMiddleware:
    """ASGI application that checks the requests to another one, and adds security headers to all answers.

    hosts: allowed Host headers, such as "127.0.0.1:8350".
    stop_hosts: hosts that the page may send a stop to.
    The session is in `scope["state"]["session"]`. After many wrong tokens, answers to wrong tokens are delayed;
    requests with a right token never are.
    """

    def __init__(
        self, app: ASGIApp, keys: Keys, hosts: frozenset[str], cookie: str, stop_hosts: frozenset[str] = frozenset()
    ) -> None:
        self._app, self._keys, self._hosts, self._cookie = app, keys, hosts, cookie
        self._stop_hosts = stop_hosts
        self._failures: list[float] = []
        self._delayed = 0
        self._closed = (_STATIC / "closed.html").read_bytes()
        self._parts = {
            f"/static/{name}": ((_STATIC / name).read_bytes(), kind) for name, kind in _PARTS_OF_CLOSED.items()
        }

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answers 401, 403, 429 or 431, or hands the request on."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
        elif scope["type"] == "http":
            answer = await self._judge(scope)
            # If the body is no valid HTTP, the server has refused it already, and nothing can be sent.
            with contextlib.suppress(LocalProtocolError):
                await (answer or self._app)(scope, receive, self._with_headers(scope, send))
        else:  # the studio has no WebSockets
            await receive()
            await send({"type": "websocket.close", "code": 1008})

    async def _judge(self, scope: Scope) -> Response | None:
        """Returns None if the request may go on, else the refusal."""
        headers, method = Headers(scope=scope), scope["method"]
        if sum(len(name) + len(value) for name, value in scope["headers"]) > _MAX_HEADERS:
            return refuse(431, "The headers of this request are too large.")
        if headers.getlist("host") != [host := headers.get("host", "")] or host not in self._hosts:
            return refuse(403, "The studio does not go by this name; use the address that it printed.")
        here = headers.get("sec-fetch-site", "none") in ("none", "same-origin")
        # True for a clicked link on another page. Requests and frames of such a page have other headers. For some
        # clicks, Chromium does not report a document as their target.
        way, aim = (headers.get(f"sec-fetch-{name}") for name in ("mode", "dest"))
        clicked = method == "GET" and way == "navigate" and aim in ("document", "empty")
        if not here and not clicked:
            return refuse(403, "Another page asked for this.")
        if method == "GET" and b"token=" in scope["query_string"]:
            return await self._enter(scope, counts=here)
        own = f"{scope['scheme']}://{host}"
        if given := headers.get("authorization"):
            scheme, _, token = given.partition(" ")
            session = self._keys.bearer(token.strip()) if scheme.lower() == "bearer" else None
            if session is None:
                return await self._delay(refuse(401, "The studio does not know you."))
            if method not in _SAFE and headers.get("origin") not in (None, own):
                return refuse(403, "Another page asked for this.")
            scope.setdefault("state", {})["session"] = session
            return None
        session = self._session(headers)
        if session is None:
            if not here and scope["path"] == "/":
                return _opening("/")  # the browser sends no cookie after a link of another page, but does after ours
            if here and method == "GET" and scope["path"] in self._parts:
                content, kind = self._parts[scope["path"]]
                return Response(content, media_type=kind)
            page = method in _SAFE and "text/html" in headers.get("accept", "")
            return HTMLResponse(self._closed, 401) if page else refuse(401, "The studio does not know you.")
        if not here:
            return _opening("/") if scope["path"] == "/" else refuse(403, "Another page asked for this.")
        if method not in _SAFE and headers.get("origin") != own:
            return refuse(403, "Another page asked for this.")
        by_cookie = method in _SAFE and _BY_COOKIE.fullmatch(scope["path"])
        if not by_cookie and not hmac.compare_digest(headers.get("x-page-key", "").encode(), session.key.encode()):
            return refuse(403, "This page has lost its key; open the studio with the link that its terminal shows.")
        scope.setdefault("state", {})["session"] = session
        return None

    async def _enter(self, scope: Scope, *, counts: bool) -> Response:
        """Returns a page with a cookie and a key for the token; the page opens the studio without the token.

        It is a page and no redirect, because after a redirect from another page's link the browser would not send
        the cookie.
        """
        query = parse_qsl(scope["query_string"].decode("latin-1"))
        session = self._keys.admit(dict(query).get("token", ""))
        if session is None:
            closed = HTMLResponse(self._closed, 401)
            return await self._delay(closed) if counts else closed
        rest = urlencode([(name, value) for name, value in query if name != "token"])
        answer = _opening("/" + (f"?{rest}" if rest else "") + f"#key={session.key}")
        secure = scope["scheme"] == "https"
        answer.set_cookie(self._cookie, session.id, httponly=True, samesite="strict", path="/", secure=secure)
        return answer

    async def _delay(self, answer: Response) -> Response:
        """Returns the answer to a wrong token, late after many of them; 429 if too many answers wait already."""
        now = time.monotonic()
        self._failures = [*(at for at in self._failures[-_FREE_FAILURES:] if now - at < _FAILURES_COUNT_FOR), now]
        if len(self._failures) > _FREE_FAILURES:
            if self._delayed >= _MAX_DELAYED:
                return refuse(429, "Too many wrong tokens came; wait a moment.")
            self._delayed += 1
            try:
                await asyncio.sleep(_DELAY)
            finally:
                self._delayed -= 1
        return answer

    def _session(self, headers: Headers) -> Session | None:
        try:
            jar = SimpleCookie("; ".join(headers.getlist("cookie")))
        except CookieError:
            return None
        return self._keys.session(jar[self._cookie].value) if self._cookie in jar else None

    def _with_headers(self, scope: Scope, send: Send) -> Send:
        stop = "".join(f" {scope['scheme']}://{host}" for host in sorted(self._stop_hosts) if "[" not in host)
        more = {"Cache-Control": "no-store", **_HEADERS}
        more["Content-Security-Policy"] = more["Content-Security-Policy"].replace("{stop}", stop)

        async def sending(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                del headers["server"]
                for name, value in more.items():
                    headers.setdefault(name, value)
            await send(message)

        return sending


def _opening(address: str) -> HTMLResponse:
    return HTMLResponse(_OPENING.format(address=address.replace("&", "&amp;")))


def refuse(status: int, sentence: str, **more: object) -> JSONResponse:
    """Returns the answer to a request that is not done: a sentence for a person, and `more` for programs."""
    return JSONResponse({"sentence": sentence, **more}, status)


# Confirmation at the machine: a person beside a dangerous robot must confirm before it moves.

GOOD_FOR = 60.0
"""Seconds after a press of Enter within which one job may begin from the page."""
_BETWEEN_GLANCES = 0.5


@dataclass
class Presence:
    """Confirmations by Enter in the studio's terminal; each is valid for one job.

    possible: True if there is a terminal for it.
    """

    possible: bool = False
    _pressed: float = field(default=-math.inf, init=False)

    def press(self) -> None:
        """Stores a confirmation now."""
        self._pressed = time.monotonic()

    def allow(self, easel: WebAppEasel) -> None:
        """Uses up a confirmation if a machine could hurt somebody; a simulated robot or a person needs none.

        Raises RobotStopped like `require`.
        """
        if easel.drives_machine:
            self.require()

    def require(self) -> None:
        """Uses up a confirmation. Raises RobotStopped, with instructions, if nobody confirmed in the last minute.

        (A stop of a real robot lasts until `frida-painter arm`.)
        """
        pressed, self._pressed = self._pressed, -math.inf
        if time.monotonic() - pressed <= GOOD_FOR:
            return
        if self.possible:
            raise RobotStopped(
                "Is nobody in the robot's way, and is its brush free? Then press Enter in the terminal of the studio, "
                f"beside the robot, and ask again within {GOOD_FOR:.0f} s."
            )
        raise RobotStopped(
            "Somebody has to be beside the robot: start `frida-painter studio` in a terminal there, and open its page."
        )

    def listen(self, file: int) -> None:
        """Starts a thread that takes each line typed into the terminal (a file descriptor) as a confirmation."""
        self.possible = True
        threading.Thread(target=self._listen, args=(file,), daemon=True, name="presence").start()

    def _listen(self, file: int) -> None:
        while True:
            try:
                if not is_typed(file, _BETWEEN_GLANCES):
                    continue
                if is_in_background(file):
                    time.sleep(_BETWEEN_GLANCES)  # in the background, typed text is for the shell
                    continue
                typed = os.read(file, 1024)
            except (OSError, ValueError):
                typed = b""
            if not typed:  # the terminal was closed
                self.possible = False
                return
            self.press()
            print(f"Pressed. For {GOOD_FOR:.0f} s one thing may be begun from the page.", flush=True)


# Lead: one browser at a time moves the robot, and each of its orders is done once, without delay.

KEPT_FOR = 60.0
"""Seconds after its last order during which a browser keeps the lead."""


class Led(Interrupted):
    """Error: another browser leads; this one may take over."""


@dataclass
class Lead:
    """Accepts the orders of one browser; each has its own nonce and time.

    A late order, of a browser that slept or a request that hung, is refused, because nobody expects it any more.
    The page of the last order may give up the lead when it is left.

    until: moment (s, monotonic) at which the lead ends
    under_way: number of accepted orders that are not done yet
    """

    until: float = field(default=0.0, init=False)
    under_way: int = field(default=0, init=False)
    _leads: str = field(default="", init=False)
    _page: str = field(default="", init=False)
    _used: dict[str, float] = field(default_factory=dict, init=False)

    def require(self, session: str, nonce: str, given: float, page: str = "") -> None:
        """Accepts an order from a page of a session.

        given: time of the order, seconds since 1970 by this machine's clock.
        Raises Led if another browser leads, Interrupted if the order is too old or repeated.
        """
        self._require_new(nonce, given)
        if self._leads != session and time.monotonic() < self.until:
            raise Led("Another browser leads the painting at the moment.")
        self.take_over(session, nonce, given, page)

    def take_over(self, session: str, nonce: str, given: float, page: str = "") -> None:
        """Gives the lead to this page of the session. Raises Interrupted like `require`."""
        self._require_new(nonce, given)
        self._used[nonce] = time.time()
        self._leads, self._page, self.until = session, page, time.monotonic() + KEPT_FOR

    def give_back(self, session: str, page: str) -> bool:
        """Gives up the lead if that page gave the last order; returns True if it did."""
        held = (self._leads, self._page) == (session, page) and time.monotonic() < self.until
        if held:
            self.until = 0.0
        return held

    def _require_new(self, nonce: str, given: float) -> None:
        now = time.time()
        self._used = {known: at for known, at in self._used.items() if now - at <= 4 * LEAD_GOOD_FOR}
        if not (16 <= len(nonce) <= 64 and math.isfinite(given)):
            raise Interrupted("This was asked without a number and a time of its own; reload the page.")
        if not -LEAD_GOOD_FOR <= now - given <= LEAD_GOOD_FOR:
            raise Interrupted("This was asked too long ago to be done now; look at the page, and ask again.")
        if nonce in self._used:
            raise Interrupted("This was asked already, and is done once.")
