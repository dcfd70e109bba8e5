"""Presses stop while everything else that a studio can be asked for is asked of it, all at once.

    make stress PROGRAM=stop OPTIONS="--stops 1000 --busy 10 --json FILE"

At once, from the first stop to the last: 20 streams and 28 requests a second; 16 pictures of 49 megapixels given; 80
ZIPs that nobody reads; a database that is locked for three seconds of every six while 120 reads wait; 1300 half-open
connections on each of the two ports, with 1024 files for each process of the studio; a watcher's link that is opened
again and again; the studio killed and opened again every twenty seconds, of which the page that stops knows nothing;
and, where there is a Chromium, seven pages of one painting, in the last of which every tenth stop is pressed. --busy
adds programs that only compute.

What is measured is the time from the press to the answer that the page gets, and to the moment at which the process
that paints has heard it and would stop the robot; a stop without an answer, or that was not heard, is a missed one. All
of this runs on one machine: the load is part of what the stops compete with.
"""

import argparse
import asyncio
import contextlib
import io
import json
import random
import re
import resource
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, field
from http.client import HTTPConnection, HTTPException
from pathlib import Path
from typing import Any

import numpy as np
from measure import Table, arguments, publish
from PIL import Image

from frida_painter.session.events import Began
from frida_painter_studio.at_page import HEARD, STOP, WORK, Feed, call
from frida_painter_studio.store import Entry, PaintingStore
from frida_painter_studio.studio_folder import PaintingRequest, WorkerLock

FILES = 1024
HALF_OPEN, STREAMS, RATE, ZIPS, READS, PICTURES = 1300, 20, 28, 80, 120, 16
PATIENCE = 10.0  # seconds, after which a stop is a missed one
RESTART_EVERY = 20.0


@dataclass
class Studio:
    """A studio with few files, which is killed and opened again now and then."""

    folder: Path
    process: subprocess.Popen[str] | None = None
    port: int = 0
    tokens: dict[str, str] = field(default_factory=dict)

    def open(self) -> None:
        program = [sys.executable, "-m", "frida_painter", "studio", "--folder", str(self.folder), "--no-browser"]
        for _ in range(50):
            self.process = subprocess.Popen(
                [*program, "--port", str(self.port)], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL, text=True,
                preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (FILES, FILES)),
            )  # fmt: skip
            lines = [self.process.stdout.readline() for _ in range(3)]
            found = [re.search(r"http://[^:]+:(\d+)/\?token=(\S+)", line) for line in lines]
            if all(found):
                self.port = int(found[0][1])
                self.tokens = {role: each[2] for role, each in zip(("operate", "plan", "watch"), found, strict=True)}
                return
            self.kill()
            time.sleep(0.2)
        raise SystemExit("The studio cannot be opened.")

    def kill(self) -> None:
        self.process.kill()
        self.process.wait()
        self.process.stdout.close()

    def ask(self, path: str) -> Any:
        with closing(HTTPConnection("127.0.0.1", self.port, timeout=30)) as connection:
            connection.request("GET", path, headers={"Authorization": f"Bearer {self.tokens['operate']}"})
            return json.loads(connection.getresponse().read())


class Worker:
    """Hears stops as the process that paints does, and notes when."""

    def __init__(self, store: PaintingStore, entry: Entry) -> None:
        self.heard: list[float] = []
        self._store, self._entry = store, entry
        self.lock = WorkerLock(entry.folder)
        self.lock.take()
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self) -> None:
        while True:
            with contextlib.suppress(OSError), call(self._store.root) as line:
                line.sendall(f"{WORK} {self._entry.folder.path.name}\n".encode())
                while line.recv(1) == STOP:
                    self.heard.append(time.monotonic())
                    line.sendall(HEARD)
            time.sleep(0.05)


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--stops", type=int, default=1000)
    parser.add_argument("--busy", type=int, default=0, help="how many programs compute meanwhile")
    parser.add_argument("--between", type=float, default=0.1, help="seconds between two stops, on average")
    parser.add_argument("--load", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.load:
        asyncio.run(load(json.loads(options.load)))
        return
    stops = 20 if options.quick else options.stops
    resource.setrlimit(resource.RLIMIT_NOFILE, (resource.getrlimit(resource.RLIMIT_NOFILE)[1],) * 2)
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory())) / "paintings"
        studio = Studio(folder)
        studio.open()
        stack.callback(lambda: studio.kill())
        store = PaintingStore(folder)
        entry = begun(store)
        worker = Worker(store, entry)
        way = studio.ask("/api/studio")["stop"]
        while not press(way)[1]:  # the worker is heard
            time.sleep(0.1)
        pages = stack.enter_context(browser(studio, entry))
        for number in range(options.busy):
            stack.enter_context(ended([sys.executable, "-c", "while True: pass"], number))
        loads = stack.enter_context(loading(studio, folder))
        time.sleep(3)
        took, heard, missed = [], [], 0
        pressed_in_page = 0
        chance, opened = random.Random(0), time.monotonic()
        for number in range(stops):
            time.sleep(chance.expovariate(1 / options.between))
            if time.monotonic() - opened > RESTART_EVERY:
                studio.kill()
                studio.open()
                loads()
                opened = time.monotonic()
            before, at = len(worker.heard), time.monotonic()
            if pages is not None and number % 10 == 9:
                pages()
                pressed_in_page += 1
                answered = True
            else:
                answered = press(way)[0]
                took.append(time.monotonic() - at)
            until = at + PATIENCE
            while len(worker.heard) == before and time.monotonic() < until:
                time.sleep(0.0005)
            if answered and len(worker.heard) > before:
                heard.append(worker.heard[before] - at)
            else:
                missed += 1
        operators = studio.ask("/api/studio")["role"] == "operate"
        worker.lock.release()
    rows = [
        ("stops, of these in the seventh page of a browser", f"{stops}, {pressed_in_page}", ""),
        ("missed", str(missed), "none"),
        ("answered after: median, 99th percentile, longest", figures(took), "99th < " + wanted(options.busy)),
        ("heard by the painting process after: the same", figures(heard), "99th < " + wanted(options.busy)),
        ("the operator still comes in", "yes" if operators else "no", "yes"),
    ]
    title = "Stop, while everything else is asked of the studio" + (
        f", beside {options.busy} busy programs" * bool(options.busy)
    )
    publish([Table(title, ("", "", "wanted"), rows)], {"answered": took, "heard": heard, "missed": missed}, options)


def wanted(busy: int) -> str:
    return "1000 ms" if busy else "250 ms"


def figures(seconds: list[float]) -> str:
    if not seconds:
        return "-"
    return ", ".join(f"{1000 * value:.1f}" for value in [*np.percentile(seconds, [50, 99]), max(seconds)]) + " ms"


def begun(store: PaintingStore) -> Entry:
    """A painting of some size, which somebody works on."""
    entry = store.begin("A painting")
    painting_request = PaintingRequest.model_validate({"terms": [{"kind": "text", "words": "a ship"}]})
    Feed(entry.folder.path).tell(Began("plan", plan=1, detail=painting_request.model_dump(mode="json")))
    other = store.begin("Another one").folder  # which is taken along
    other.painting.mkdir()
    (other.painting / "film.mp4").write_bytes(bytes(50 * 2**20))
    return entry


def press(way: dict[str, Any]) -> tuple[bool, int]:
    """A stop as the page sends it: whether it was answered, and how many have heard it."""
    try:
        with closing(HTTPConnection("127.0.0.1", way["port"], timeout=PATIENCE)) as connection:
            connection.request("POST", "/stop", way["secret"], {"Content-Type": "text/plain"})
            said = json.loads(connection.getresponse().read())
            return "stopped" in said, said.get("heard", 0)
    except (OSError, HTTPException, ValueError):
        return False, 0


@contextmanager
def browser(studio: Studio, entry: Entry) -> Iterator[Any]:
    """What presses stop in the last of seven pages; None where there is no browser."""
    program = shutil.which("chromium") or shutil.which("google-chrome")
    if program is None:
        yield None
        return
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        arguments = ["--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"]
        opened = playwright.chromium.launch(executable_path=program, args=arguments)
        context = opened.new_context()
        context.set_default_timeout(60_000)
        page = context.new_page()
        page.goto(f"http://127.0.0.1:{studio.port}/?token={studio.tokens['operate']}")
        page.wait_for_url("**/#/")
        for _ in range(7):
            page = context.new_page()
            page.goto(f"http://127.0.0.1:{studio.port}/#/p/{entry.id}")
            page.locator("#view > *").first.wait_for()
        button = page.locator("#stop")
        yield lambda: button.dispatch_event("click")
        opened.close()


@contextmanager
def ended(program: list[str], number: int = 0) -> Iterator[subprocess.Popen[bytes]]:
    process = subprocess.Popen(program)
    try:
        yield process
    finally:
        process.kill()
        process.wait()


@contextmanager
def loading(studio: Studio, folder: Path) -> Iterator[Any]:
    """The load, from a process of its own; what is given starts it anew for a studio that was opened again."""
    running: list[subprocess.Popen[bytes]] = []

    def end() -> None:
        for process in running:
            process.send_signal(signal.SIGKILL)
            process.wait()
        running.clear()

    def start() -> None:
        end()
        told = {"port": studio.port, "stop": studio.ask("/api/studio")["stop"]["port"], "folder": str(folder)}
        told["tokens"] = studio.tokens
        running.append(subprocess.Popen([sys.executable, __file__, "--load", json.dumps(told)]))

    start()
    try:
        yield start
    finally:
        end()


async def load(told: dict[str, Any]) -> None:
    """All of it, until this process is ended."""
    resource.setrlimit(resource.RLIMIT_NOFILE, (resource.getrlimit(resource.RLIMIT_NOFILE)[1],) * 2)
    port, tokens, folder = told["port"], told["tokens"], Path(told["folder"])
    threading.Thread(target=lock_database, args=(folder,), daemon=True).start()
    with closing(sqlite3.connect(folder / "studio.sqlite")) as base:
        paintings = [identifier for (identifier,) in base.execute("SELECT id FROM painting ORDER BY rowid")]
    picture = io.BytesIO()
    Image.new("L", (7000, 7000), 128).save(picture, "PNG")
    zipped = f"/api/paintings/{paintings[1]}/everything.zip"
    work = [
        *(ask(port, tokens["watch"], f"/api/events?of={paintings[0]}") for _ in range(STREAMS)),
        *(ask(port, tokens["watch"], zipped, read=False) for _ in range(ZIPS)),
        *(ask(port, tokens["operate"], f"/api/paintings/{paintings[0]}") for _ in range(READS)),
        *(ask(port, tokens["plan"], "/api/pictures", body=picture.getvalue()) for _ in range(PICTURES)),
        *(half_open(each, number) for each in (port, told["stop"]) for number in range(HALF_OPEN)),
        requests(port, tokens["operate"]), logins(port, tokens["watch"]),
    ]  # fmt: skip
    await asyncio.gather(*work)


async def ask(port: int, token: str, path: str, *, read: bool = True, body: bytes = b"") -> None:
    """Asks again and again; without `read` for an answer that is not read."""
    method = "POST" if body else "GET"
    head = f"{method} {path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nAuthorization: Bearer {token}\r\n"
    head += f"Content-Length: {len(body)}\r\nConnection: close\r\n\r\n"
    while True:
        with contextlib.suppress(OSError):
            reader, writer = await asyncio.open_connection("127.0.0.1", port, limit=1024)
            writer.write(head.encode() + body)
            if read:
                while await reader.read(1 << 16):
                    pass
            else:
                await asyncio.sleep(20)
            writer.close()
        await asyncio.sleep(0.5)


async def half_open(port: int, number: int) -> None:
    """A connection that begins a request and says no more, for as long as it is left."""
    await asyncio.sleep(2 * number / HALF_OPEN)
    while True:
        with contextlib.suppress(OSError):
            reader, writer = await asyncio.open_connection("127.0.0.1", port)
            if number % 2:
                writer.write(b"POST /stop HTTP/1.1\r\nHost: ")
            await reader.read(1)
            writer.close()
        await asyncio.sleep(1)


async def requests(port: int, token: str) -> None:
    """So many a second, whether they are answered or not."""
    tasks = set()
    while True:
        task = asyncio.create_task(once(port, f"/api/{random.choice(['studio', 'paintings'])}", token))
        tasks.add(task)
        task.add_done_callback(tasks.discard)
        await asyncio.sleep(1 / RATE)


async def logins(port: int, token: str) -> None:
    """A watcher's link, opened again and again."""
    while True:
        await once(port, f"/?token={token}", "")
        await asyncio.sleep(0.02)


async def once(port: int, path: str, token: str) -> None:
    with contextlib.suppress(OSError):
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        bearer = f"Authorization: Bearer {token}\r\n" if token else ""
        writer.write(f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n{bearer}Connection: close\r\n\r\n".encode())
        while await reader.read(1 << 16):
            pass
        writer.close()


def lock_database(folder: Path) -> None:
    """Locked for three seconds, free for three."""
    while True:
        with (
            contextlib.suppress(sqlite3.Error),
            closing(sqlite3.connect(folder / "studio.sqlite", isolation_level=None)) as base,
        ):
            base.execute("BEGIN EXCLUSIVE")
            time.sleep(3)
            base.execute("ROLLBACK")
        time.sleep(3)


if __name__ == "__main__":
    main()
