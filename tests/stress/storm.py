"""Throws senseless requests at a studio, as somebody would who means harm, and looks whether anything comes of it.

    make stress PROGRAM=storm OPTIONS="--requests 10000 --seed 1"

Half are what schemathesis makes of the studio's own description (OpenAPI): what it allows, and what it does not. Most
others are made from its routes with something wrong in them; the rest are malformed multipart bodies, paths that climb
out of folders, headers and bodies that are too large, requests that break off, and clients that send a byte now and
then. None may be answered with an accident (5xx), tell a path, or keep the studio from answering.
"""

import argparse
import contextlib
import json
import math
import random
import re
import signal
import socket
import subprocess
import sys
import tempfile
import time
from http.client import HTTPConnection, HTTPException
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

import schemathesis
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis.errors import Unsatisfiable
from schemathesis import GenerationMode

from frida_painter_studio.security import Presence
from frida_painter_studio.server import application
from frida_painter_studio.store import PaintingStore
from frida_painter_studio.web_app_easel import WebAppEasel
from frida_painter_studio.web_studio import Studio

Request = tuple[str, str, dict[str, str], bytes]
"""Method, path, headers, body."""

_LEFT_OUT = ("/events", "/delete")
NASTY = [
    "",
    " ",
    "..",
    "../../etc/passwd",
    "%2e%2e%2f",
    "\\\\host\\share",
    "C:\\x",
    "a\x00b",
    "<script>alert(1)</script>",
    "{{7*7}}",
    "' OR 1=1",
    "\x1b[2J",
    "ä" * 300,
    "𝕏",
    "\u202e",
    "NaN",
    "1e999",
    "-1",
    "0",
    "null",
    "9" * 40,
    "0" * 32,
    "0" * 16,
    "live",
    "painting",
    "1",
    "plan.jpg",
]
BODIES = [
    b"",
    b"{",
    b"[]",
    b"null",
    b'"x"',
    b"\xff\xfe\x00",
    b'{"a":' * 3000,
    b"[" * 3000,
    b"--x\r\nContent-Disposition: form-data; name=a\r\n\r\n",
    b"\x89PNG\r\n\x1a\n" + b"\0" * 40,
    b"GIF89a",
    b"<svg/>",
    b"x" * 5000,
    b'{"terms": [{"kind": "text", "words": "\\ud800"}]}',
]
TYPES = [
    "application/json",
    "multipart/form-data",
    "multipart/form-data; boundary=x",
    "text/plain",
    "image/png",
    "x",
    "",
]


def nonsense(chance: random.Random, depth: int = 0) -> Any:
    """Some JSON value."""
    kinds = [*NASTY, chance.randint(-5, 10**6), chance.random() * 1e9, True, None]
    if depth < 3 and chance.random() < 0.3:
        names = [
            "terms",
            "kind",
            "picture",
            "words",
            "weight",
            "strokes",
            "plan",
            "ready",
            "count",
            "only",
            chance.choice(NASTY),
        ]
        return {chance.choice(names): nonsense(chance, depth + 1) for _ in range(chance.randint(0, 4))}
    if depth < 3 and chance.random() < 0.2:
        return [nonsense(chance, depth + 1) for _ in range(chance.randint(0, 3))]
    return chance.choice(kinds)


def almost_sensible(chance: random.Random) -> dict[str, Any]:
    """A wish or an order with something wrong in it, or nothing."""
    painting_request = {"terms": [{"kind": "text", "words": "a ship"}], "strokes": 5, "title": chance.choice(NASTY)}
    order = chance.choice(
        [
            painting_request,
            {"plan": 1, "ready": True},
            {"kind": "pause"},
            {"picture": "0" * 32, "only": False},
            {"question": "0" * 16, "yes": True},
            {"question": "0" * 16, "corners": [[0, 0], [1, 0], [1, 1], [0, 1]]},
        ]
    )
    return {**order, chance.choice([*order, "effort", "seed", "width"]): nonsense(chance, 2)}


def request(chance: random.Random, paths: dict[str, Any], known: str) -> Request:
    """One request with something wrong in it, most likely."""
    template = chance.choice([*paths, "/static/{name}", "/{name}", "/"])
    path = "/".join(
        part
        if not part.startswith("{")
        else known
        if "identifier" in part and chance.random() < 0.6
        else chance.choice(NASTY)
        for part in template.split("/")
    )
    meant = paths.get(template, ["GET"])
    method = chance.choice(meant if chance.random() < 0.85 else ["GET", "POST", "PUT", "DELETE", "HEAD", "PATCH"])
    written = json.dumps(chance.choice([nonsense, almost_sensible])(chance)).encode()
    return (
        method,
        path,
        {"Content-Type": chance.choice(TYPES[:1] * 6 + TYPES)},
        chance.choice([written, written, chance.choice(BODIES)]),
    )


CLIMBING = [
    "/paintings/{id}/live/..%2f..%2fstudio.sqlite", "/paintings/{id}/..%2f..%2f..%2fetc/passwd.jpg",
    "/static/../app.py",
    "/static/..%2fapp.py", "/static/%2e%2e/app.py", "/static//etc/passwd", "/static/%2fetc%2fpasswd",
    "/api/pictures/..%2f..%2fstudio", "/paintings/{id}/live%00/x.jpg", "/paintings/{id}/painting/C:%5cwindows.jpg",
    "/calibration/../studio.sqlite", "/api/calibration/files/..%2fasked.json", "//evil.example/x", "/..", "/%ff%fe",
]  # fmt: skip
RAW = [
    b"GET / HTTP/1.1\r\n", b"\x00\x01\x02\r\n\r\n", b"GET " + b"/" * 70_000 + b" HTTP/1.1\r\n\r\n",
    b"POST /api/paintings HTTP/1.1\r\nHost: {host}\r\nTransfer-Encoding: chunked\r\n\r\nzz\r\n",
    b"POST /api/pictures HTTP/1.1\r\nHost: {host}\r\nContent-Length: 999999999999\r\n\r\nx",
    b"POST /api/pictures HTTP/1.1\r\nHost: {host}\r\nContent-Length: -5\r\n\r\n",
    b"GET / HTTP/1.1\r\nHost: {host}\r\nX: " + b"a" * 70_000 + b"\r\n\r\n",
    b"GET / HTTP/1.1\r\nHost: {host}\r\nHost: evil\r\n\r\n", b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n",
    b"GET /api/paintings HTTP/1.1\r\nHost: {host}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    b"Sec-WebSocket-Key: x\r\nSec-WebSocket-Version: 13\r\n\r\n",
]  # fmt: skip


def description(folder: Path) -> dict[str, Any]:
    """What a studio says of its own routes (OpenAPI), but for those that never end or destroy."""
    told = application(Studio(PaintingStore(folder), WebAppEasel(folder / "record.json"), Presence())).openapi()
    return {**told, "paths": {path: own for path, own in told["paths"].items() if not path.endswith(_LEFT_OUT)}}


def by_description(told: dict[str, Any], known: str, each: int, number: int) -> list[Request]:
    """What schemathesis makes of a description, the same for the same number.

    For every route, `each` requests that it allows and as many that it does not; every other one for the painting
    `known`.
    """
    made: list[Request] = []
    for found in schemathesis.openapi.from_dict(told).get_all_operations():
        operation = found.ok()
        for mode in (GenerationMode.POSITIVE, GenerationMode.NEGATIVE):

            @seed(number)
            @settings(
                max_examples=each, database=None, deadline=None, phases=[Phase.generate],
                suppress_health_check=list(HealthCheck),
            )  # fmt: skip
            @given(case=operation.as_strategy(generation_mode=mode))
            def make(case: schemathesis.Case) -> None:
                if len(made) % 2 and "identifier" in (case.path_parameters or {}):
                    case.path_parameters["identifier"] = known
                made.append(_written(case))

            with contextlib.suppress(Unsatisfiable):  # where all is allowed, or nothing can be made
                make()
    return made


def _written(case: schemathesis.Case) -> Request:
    parts = case.as_transport_kwargs(base_url="http://studio")
    body = json.dumps(parts["json"]) if "json" in parts else parts.get("data", b"")
    query = urlencode(parts.get("params") or {}, doseq=True)
    path = parts["url"].removeprefix("http://studio") + (f"?{query}" if query else "")
    headers = {"Content-Type": "application/json", **{k: str(v) for k, v in (parts.get("headers") or {}).items()}}
    told = {name: value for name, value in headers.items() if value.isascii() and value.isprintable()}
    content = body.encode("utf-8", "replace") if isinstance(body, str) else bytes(body)
    return case.method, path, told, content


def routes(folder: Path) -> dict[str, Any]:
    """The paths of a studio with their methods, from its own description."""
    return {path: [*map(str.upper, own)] for path, own in description(folder)["paths"].items()}


class Visitor:
    """A browser that came with the token."""

    def __init__(self, host: str, token: str) -> None:
        self._host = host
        entered = self._request("GET", f"/?token={token}", {}, b"")
        self._cookie = entered[1]["set-cookie"].split(";")[0]
        self._key = re.search(rb"#key=([\w-]+)", entered[2])[1].decode()

    def ask(self, method: str, path: str, headers: dict[str, str], body: bytes) -> tuple[int, dict[str, str], bytes]:
        signs = {"Cookie": self._cookie, "Origin": f"http://{self._host}", "X-Given": str(time.time())}
        signs |= {"X-Page-Key": self._key, "X-Nonce": f"{random.getrandbits(100):032x}"}
        return self._request(method, path, {**signs, **headers}, body)

    def _request(
        self, method: str, path: str, headers: dict[str, str], body: bytes
    ) -> tuple[int, dict[str, str], bytes]:
        connection = HTTPConnection(self._host, timeout=30)
        try:
            connection.request(method, path, body or None, headers)
            answer = connection.getresponse()
            return answer.status, {k.lower(): v for k, v in answer.getheaders()}, answer.read()
        finally:
            connection.close()


def raw(host: str, content: bytes, pause: float = 0.0) -> bytes:
    """What is answered to bytes that are no request; with a pause they come one by one, and then no more."""
    name, port = host.split(":")
    with contextlib.suppress(OSError), socket.create_connection((name, int(port)), timeout=5) as connection:
        if pause:
            for byte in content[:20]:
                connection.sendall(bytes([byte]))
                time.sleep(pause)
            return b""
        connection.sendall(content.replace(b"{host}", host.encode()))
        connection.shutdown(socket.SHUT_WR)
        return connection.recv(1 << 16)
    return b""


def judged(status: int, body: bytes, folder: str, what: object) -> None:
    """Ends the storm where an answer is an accident or tells a path."""
    if status >= 500 or b"Traceback" in body or folder.encode() in body:
        raise SystemExit(f"{what}: {status} {body[:400]!r}")


def storm(host: str, token: str, folder: Path, count: int, chance: random.Random) -> dict[int, int]:
    """Sends `count` requests; returns how often each status came."""
    found: dict[int, int] = {}
    store = PaintingStore(folder)
    known = store.begin("Known").id
    told = description(folder)
    paths = {path: [*map(str.upper, own)] for path, own in told["paths"].items()}
    each = math.ceil(count / 2 / sum(2 * len(own) for own in paths.values()))
    ready = by_description(told, known, each, chance.randrange(2**32))
    visitor = Visitor(host, token)
    for number in range(count):
        if number % 150 == 149:
            visitor = Visitor(host, token)  # each may ask so much in a while, and no more
        kind = chance.random()
        if kind < 0.03:
            content = chance.choice(RAW)
            judged(0, raw(host, content, 0.01 if chance.random() < 0.05 else 0.0), str(folder), content[:80])
            continue
        if kind < 0.08:
            method, path, headers, body = "GET", chance.choice(CLIMBING).replace("{id}", known), {}, b""
        elif kind < 0.085:
            method, path, headers, body = (
                "POST",
                chance.choice(list(paths)),
                {},
                b"x" * chance.choice([300_000, 34_000_000]),
            )
        elif number % 2 and ready:
            method, path, headers, body = ready.pop(chance.randrange(len(ready)))
        else:
            method, path, headers, body = request(chance, paths, known)
        path = re.sub(r"[^\x21-\x7e]", lambda each: "".join(f"%{byte:02x}" for byte in each[0].encode()), path)
        headers = {name: value for name, value in headers.items() if value.isprintable()}
        try:
            status, _, answer = visitor.ask(method, path, headers, body)
        except (OSError, HTTPException):
            status, answer = -1, b""  # the studio does not listen to the end of what is too large
        judged(status, answer, str(folder), (method, path, body[:200]))
        found[status] = found.get(status, 0) + 1
    if visitor.ask("GET", "/api/studio", {}, b"")[0] != 200:
        raise SystemExit("The studio does not answer any more.")
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--requests", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as place, tempfile.TemporaryFile("w+") as complaints:
        folder = Path(place) / "the-store"
        program = [sys.executable, "-m", "frida_painter", "studio", "--folder", str(folder), "--port", "0"]
        studio = subprocess.Popen(
            [*program, "--no-browser"], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=complaints, text=True
        )
        try:
            host, token = re.search(r"http://(\S+?)/\?token=(\S+)", studio.stdout.readline()).groups()
            started = time.monotonic()
            found = storm(host, token, folder, options.requests, random.Random(options.seed))
        finally:
            studio.send_signal(signal.SIGINT)
            studio.wait(20)
        complaints.seek(0)
        said = complaints.read()
    if "Traceback" in said:
        raise SystemExit(said[-4000:])
    answers = ", ".join(f"{count} with {status}" for status, count in sorted(found.items()) if status > 0)
    print(f"{options.requests} requests in {time.monotonic() - started:.0f} s, answered {answers}.")
    print("No accident, no path, no traceback, and the studio still answers.")


if __name__ == "__main__":
    main()
