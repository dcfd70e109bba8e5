"""Who may speak to the studio: middleware before all routes, which checks tokens, hosts, origins and roles.

The studio commands a machine, so nothing is trusted by where it comes from: every request needs the
token that was printed when the studio was started, or the cookie that was given for it. The host is
checked against other names for this machine (DNS rebinding), the origin and a second token against
other pages in the same browser (cross-site request forgery).
"""

import contextlib
import hmac
import secrets
import time
from dataclasses import dataclass, field
from enum import IntEnum
from http.cookies import CookieError, SimpleCookie
from urllib.parse import parse_qsl, urlencode

from h11 import LocalProtocolError
from starlette.datastructures import Headers
from starlette.responses import HTMLResponse, JSONResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

_MOST_SESSIONS = 200
_MOST_FAILURES = 10  # wrong tokens, after which only one a second is looked at
_SAFE = ("GET", "HEAD")
_HEADERS = {
    "Content-Security-Policy": "default-src 'self'; img-src 'self' blob: data:; object-src 'none'; base-uri 'none'; "
    "form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), microphone=(), geolocation=()",
}
_CLOSED = """<!DOCTYPE html><html lang="en"><meta charset="utf-8"><title>The studio is closed</title>
<p>This page opens with the address that the studio printed when it was started: look at its terminal.</p></html>"""


class Role(IntEnum):
    """What somebody may do; each may do what those before may."""

    watch = 1
    plan = 2
    operate = 3


@dataclass(frozen=True)
class Session:
    """A browser that came with a token, or a program that always brings it; `csrf` goes with all that it changes."""

    id: str
    role: Role
    csrf: str


@dataclass
class Keys:
    """The tokens of one start of the studio, one for each role, and the browsers that came with them."""

    tokens: dict[Role, str] = field(default_factory=lambda: {role: secrets.token_urlsafe(32) for role in Role})
    sessions: dict[str, Session] = field(default_factory=dict)
    _failures: list[float] = field(default_factory=list)

    def admit(self, token: str) -> Session | None:
        """A new session for a token; None for a wrong one, or where too many wrong ones came lately."""
        now = time.monotonic()
        self._failures = [at for at in self._failures if now - at < 60]
        if len(self._failures) >= _MOST_FAILURES and now - self._failures[-1] < 1:
            return None
        role = self._role(token)
        if role is None:
            self._failures.append(now)
            return None
        if len(self.sessions) >= _MOST_SESSIONS:
            del self.sessions[next(iter(self.sessions))]
        session = Session(secrets.token_urlsafe(24), role, secrets.token_urlsafe(24))
        self.sessions[session.id] = session
        return session

    def bearer(self, token: str) -> Session | None:
        """The session of a program, which keeps none."""
        role = self._role(token)
        return None if role is None else Session(f"bearer-{role.name}", role, "")

    def _role(self, token: str) -> Role | None:
        given = token.encode("utf-8", "replace")
        matching = [role for role, known in self.tokens.items() if hmac.compare_digest(known.encode(), given)]
        return matching[0] if matching else None


class AuthMiddleware:
    """An ASGI application before another one: lets in who may come in, and puts safe headers on all answers.

    hosts: what may stand in the Host header, like "127.0.0.1:8350"; the session is handed on in
    `scope["state"]["session"]`.
    """

    def __init__(self, app: ASGIApp, keys: Keys, hosts: frozenset[str], cookie: str) -> None:
        self._app, self._keys, self._hosts, self._cookie = app, keys, hosts, cookie

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answers 401 or 403 itself, or hands the request on."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
        elif scope["type"] == "http":
            answer = self._judge(scope)
            # Where what comes after the headers is no HTTP, the server has refused it already: nothing can be sent.
            with contextlib.suppress(LocalProtocolError):
                await (answer or self._app)(scope, receive, _with_headers(send))
        else:  # the studio has no WebSockets
            await receive()
            await send({"type": "websocket.close", "code": 1008})

    def _judge(self, scope: Scope) -> Response | None:
        """None where the request may go on."""
        headers, method = Headers(scope=scope), scope["method"]
        if headers.getlist("host") != [host := headers.get("host", "")] or host not in self._hosts:
            return _refused(403, "The studio does not go by this name; use the address that it printed.")
        if method == "GET" and b"token=" in scope["query_string"]:
            return self._enter(scope)
        session = self._session(headers)
        if session is None:
            page = method in _SAFE and "text/html" in headers.get("accept", "")
            return HTMLResponse(_CLOSED, 401) if page else _refused(401, "The studio does not know you.")
        by_cookie = session.id in self._keys.sessions
        if headers.get("sec-fetch-site", "none") not in ("none", "same-origin"):
            return _refused(403, "Another page asked for this.")
        if method not in _SAFE:
            origin = headers.get("origin")
            if origin != f"http://{host}" and not (origin is None and not by_cookie):
                return _refused(403, "Another page asked for this.")
            if by_cookie and not hmac.compare_digest(headers.get("x-csrf-token", "").encode(), session.csrf.encode()):
                return _refused(403, "Reload the page: what it sent did not carry the sign of this studio.")
        scope.setdefault("state", {})["session"] = session
        return None

    def _enter(self, scope: Scope) -> Response:
        """Takes the token out of the address and puts a cookie in its place."""
        query = parse_qsl(scope["query_string"].decode("latin-1"))
        session = self._keys.admit(dict(query).get("token", ""))
        if session is None:
            return HTMLResponse(_CLOSED, 401)
        rest = urlencode([(name, value) for name, value in query if name != "token"])
        answer = RedirectResponse("/" + (f"?{rest}" if rest else ""), 303)
        answer.set_cookie(self._cookie, session.id, httponly=True, samesite="strict", path="/")
        return answer

    def _session(self, headers: Headers) -> Session | None:
        scheme, _, token = headers.get("authorization", "").partition(" ")
        if scheme.lower() == "bearer":
            return self._keys.bearer(token.strip())
        try:
            jar = SimpleCookie("; ".join(headers.getlist("cookie")))
        except CookieError:
            return None
        return self._keys.sessions.get(jar[self._cookie].value) if self._cookie in jar else None


def _refused(status: int, sentence: str) -> Response:
    return JSONResponse({"sentence": sentence}, status)


def _with_headers(send: Send) -> Send:
    async def sending(message: Message) -> None:
        if message["type"] == "http.response.start":
            given = {name.lower() for name, _ in message["headers"]}
            more = {"Cache-Control": "no-store", **_HEADERS}
            message["headers"] = [
                *((name, value) for name, value in message["headers"] if name.lower() != b"server"),
                *((k.lower().encode(), v.encode()) for k, v in more.items() if k.lower().encode() not in given),
            ]
        await send(message)

    return sending
