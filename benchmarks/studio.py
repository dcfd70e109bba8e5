"""The studio while many browsers watch: how fast it opens and tells, and what it costs.

Twenty clients watch the state as it changes, and five connect and never read. A machine that is busy with something
else spoils all of it.
"""

import contextlib
import io
import json
import os
import re
import secrets
import shutil
import signal
import socket
import statistics
import subprocess
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.client import HTTPConnection
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from clocks import Benchmark
from frida_painter.session.events import Stopped
from frida_painter.system import python_process
from frida_painter_lab.experiment import Measurement, Notify, Results, ResultTable
from frida_painter_lab.runs import Run
from frida_painter_studio.at_page import Feed
from frida_painter_studio.studio_folder import PaintingFolder

WATCHING, DEAF = 20, 5


@dataclass
class Studio:
    """A studio that was started for this, and how to speak to it."""

    process: "subprocess.Popen[bytes]"
    host: str
    token: str

    def ask(self, path: str, record: Any = None, raw: bytes | None = None) -> Any:
        body = raw if raw is not None else None if record is None else json.dumps(record).encode()
        connection = HTTPConnection(self.host, timeout=60)
        signs = {"X-Nonce": secrets.token_hex(16), "X-Given": str(time.time()), "Content-Type": "application/json"}
        headers = {"Authorization": f"Bearer {self.token}", **signs}
        connection.request("GET" if body is None else "POST", path, body, headers)
        answer = connection.getresponse()
        content = answer.read()
        connection.close()
        if answer.status != 200:
            raise RuntimeError(f"{path}: {answer.status} {content[:300]!r}")
        return json.loads(content) if answer.headers["content-type"] == "application/json" else content

    def load(self) -> tuple[float, float]:
        """CPU seconds that the process has worked, and megabytes that it holds."""
        fields = Path(f"/proc/{self.process.pid}/stat").read_text().rsplit(") ", 1)[1].split()
        pages = int(fields[21]) * os.sysconf("SC_PAGE_SIZE") / 2**20
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK"), pages

    def plan(self) -> str:
        """Has a small painting planned; its name."""
        sheet = io.BytesIO()
        Image.new("RGB", (160, 120), (190, 60, 40)).save(sheet, "PNG")
        picture = self.ask("/api/pictures", raw=sheet.getvalue())["id"]
        wanted = {"title": "Red", "terms": [{"kind": "image", "picture": picture}], "strokes": 10, "colors": 2}
        painting: str = self.ask("/api/paintings", {**wanted, "effort": 0.1, "replans": 0, "seed": 1})["id"]
        while self.ask(f"/api/paintings/{painting}")["working"]:
            time.sleep(0.2)
        return painting


@contextmanager
def studio(folder: Path) -> Iterator[Studio]:
    words = ("-m", "frida_painter", "studio", "--folder", folder, "--port", "0", "--no-browser")
    process = python_process.start(*words, stdout=subprocess.PIPE)
    try:
        host, token = re.search(rb"http://(\S+?)/\?token=(\S+)", process.stdout.readline()).groups()
        yield Studio(process, host.decode(), token.decode())
    finally:
        process.send_signal(signal.SIGINT)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(20)
        process.kill()
        process.stdout.close()


@dataclass
class Crowd:
    """Clients on threads of this process: those that watch note when they hear a mark."""

    studio: Studio
    painting: str
    heard: list[tuple[float, str]] = field(default_factory=list)
    _sockets: list[socket.socket] = field(default_factory=list)

    def __enter__(self) -> "Crowd":
        for _ in range(WATCHING):
            threading.Thread(target=self._watch, daemon=True).start()
        for _ in range(DEAF):
            self._connect(small=True)
        time.sleep(1)
        return self

    def __exit__(self, *_: object) -> None:
        for each in self._sockets:
            each.close()

    def _connect(self, *, small: bool = False) -> socket.socket:
        host, port = self.studio.host.split(":")
        connection = socket.socket()
        if small:
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
        connection.connect((host, int(port)))
        head = f"GET /api/events?of={self.painting} HTTP/1.1\r\nHost: {self.studio.host}\r\n"
        connection.sendall(f"{head}Authorization: Bearer {self.studio.token}\r\n\r\n".encode())
        self._sockets.append(connection)
        return connection

    def _watch(self) -> None:
        connection = self._connect()
        with contextlib.suppress(OSError):
            while got := connection.recv(1 << 16):
                now = time.monotonic()
                self.heard += [(now, mark.decode()) for mark in re.findall(rb"mark-\d+", got)]


def told_after(crowd: Crowd, folder: PaintingFolder, count: int) -> list[float]:
    """Milliseconds from a line of the feed to every watching client."""
    feed, delays = Feed(folder.path), []
    for number in range(count):
        mark, at = f"mark-{number}", time.monotonic()
        feed.tell(Stopped(mark))
        time.sleep(0.5)
        delays += [1000 * (heard - at) for heard, what in list(crowd.heard) if what == mark]
    return delays


def first_page(here: Studio) -> float:
    """Milliseconds until a fresh browser shows the gallery; NaN if there is no browser."""
    program = shutil.which("chromium") or shutil.which("google-chrome")
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        program = None
    if program is None:
        return float("nan")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=["--no-sandbox", "--disable-gpu"])
        took = []
        for _ in range(5):
            context = browser.new_context()
            page, at = context.new_page(), time.monotonic()
            page.goto(f"http://{here.host}/?token={here.token}")
            page.get_by_role("link", name="New painting").wait_for(timeout=20_000)
            took.append(1000 * (time.monotonic() - at))
            context.close()
        browser.close()
    return statistics.median(took)


@dataclass(frozen=True, kw_only=True)
class StudioLoad(Benchmark):
    """The studio's page while a crowd watches."""

    NAME = "studio"
    TITLE = "The studio under load"
    TEXT = (
        "Twenty clients watch a painting; five more connect and never read. [Reliability](lab/reliability.md) lists\n"
        "the loads that the studio is tested with; `make stress PROGRAM=stop` measures how fast it stops."
    )

    def runs(self) -> Sequence[Run]:
        return [Run({"clients": WATCHING, "that never read": DEAF})]

    def measure(self, run: Run, notify: Notify) -> Measurement:
        with tempfile.TemporaryDirectory() as place, studio(Path(place) / "paintings") as here:
            shown, painting = first_page(here), here.plan()
            folder = PaintingFolder(next((Path(place) / "paintings").glob(f"*-{painting[:6]}")))
            (worked, memory), since = here.load(), time.monotonic()
            with Crowd(here, painting) as crowd:
                delays = told_after(crowd, folder, 4 if self.quick else 40)
            (busy, grown), passed = here.load(), time.monotonic() - since
        return Measurement(
            {
                "first page in a fresh browser, ms": shown,
                "until all clients see a change, median, ms": float(np.percentile(delays, 50)),
                "until all clients see a change, 99th percentile, ms": float(np.percentile(delays, 99)),
                "CPU of the web process, % of a core": 100 * (busy - worked) / passed,
                "memory of the web process, MB": memory,
                "and more with the clients, MB": grown - memory,
            }
        )

    def tables(self, results: Results) -> Sequence[ResultTable]:
        most = {"first page": 1000, "until all": 300, "and more": 50}
        rows = [
            {"": name, "measured": value, "at most": next((m for w, m in most.items() if name.startswith(w)), None)}
            for name, value in results.found[0][1].numbers.items()
        ]
        return [ResultTable(f"The studio with {WATCHING} watching clients and {DEAF} that never read", rows)]
