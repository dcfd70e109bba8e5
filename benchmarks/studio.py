"""What many watching browsers cost the painting, and how fast the studio stops, opens and tells.

    python benchmarks/studio.py [--trials 200] [--rounds 3] [--json FILE]

--rounds 0 leaves out the comparison of plans and strokes, which needs a machine that does nothing else.

One studio, its painting with the robot at a fifth of its real pace, without anybody watching and with 20 clients that
watch (state as it changes, two photographs a second) and 5 that connect and never read. A machine that is busy with
something else spoils all of it.
"""

import argparse
import contextlib
import fcntl
import io
import json
import os
import re
import secrets
import signal
import socket
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.client import HTTPConnection
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw

from frida_painter.easel.watchdog import StopFile
from frida_painter.session.events import Failed, StrokePainted
from frida_painter.web.studio_folder import Feed, PaintingFolder
from measure import Table, arguments, publish

WATCHING, DEAF = 20, 5
PACE = "0.2"


@dataclass
class Studio:
    """A studio that was started for this, and how to speak to it."""

    process: subprocess.Popen[str]
    host: str
    token: str
    folder: Path

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

    def memory(self) -> float:
        """Megabytes that the process holds."""
        status = Path(f"/proc/{self.process.pid}/status").read_text()
        return int(re.search(r"VmRSS:\s+(\d+)", status)[1]) / 1024

    def cpu(self) -> float:
        """Seconds that it has worked."""
        fields = Path(f"/proc/{self.process.pid}/stat").read_text().rsplit(") ", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@contextmanager
def studio(folder: Path) -> Iterator[Studio]:
    program = [sys.executable, "-m", "frida_painter", "studio", "--folder", str(folder), "--port", "0", "--no-browser"]
    process = subprocess.Popen([*program, "--pace", PACE], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True)
    try:
        address, token = re.search(r"http://(\S+?)/\?token=(\S+)", process.stdout.readline()).groups()
        yield Studio(process, address, token, folder)
    finally:
        process.send_signal(signal.SIGINT)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(20)
        process.kill()
        process.stdout.close()


@dataclass
class Crowd:
    """Clients on threads of a process of their own would be fairer to the planner; here they are what they cost."""

    studio: Studio
    painting: str
    heard: list[tuple[float, str]] = field(default_factory=list)
    _sockets: list[socket.socket] = field(default_factory=list)
    _left: threading.Event = field(default_factory=threading.Event)

    def __enter__(self) -> "Crowd":
        for number in range(WATCHING):
            threading.Thread(target=self._watch, args=(number,), daemon=True).start()
        for _ in range(DEAF):
            self._sockets.append(self._connect(small=True))
        time.sleep(1)
        return self

    def __exit__(self, *_: object) -> None:
        self._left.set()
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
        return connection

    def _watch(self, number: int) -> None:
        connection = self._connect()
        self._sockets.append(connection)
        rest, looked = b"", 0.0
        while not self._left.is_set():
            try:
                got = connection.recv(1 << 16)
            except OSError:
                return
            if not got:
                return
            now = time.monotonic()
            rest = (rest + got)[-(1 << 18) :]
            found = re.findall(rb'"photograph": "([a-z0-9.-]+)"', got)
            marks = re.findall(rb"mark-\d+", got)
            self.heard += [(now, mark.decode()) for mark in marks]
            if found and now - looked > 0.5:
                looked = now
                with contextlib.suppress(OSError, RuntimeError):
                    self.studio.ask(f"/paintings/{self.painting}/live/{found[-1].decode()}")


def picture() -> bytes:
    sheet, file = Image.new("RGB", (160, 120), (236, 226, 206)), io.BytesIO()
    ImageDraw.Draw(sheet).ellipse((40, 20, 120, 100), fill=(190, 60, 40))
    sheet.save(file, "PNG")
    return file.getvalue()


def finish(studio: Studio, identifier: str) -> dict[str, Any]:
    while (state := studio.ask(f"/api/paintings/{identifier}"))["working"]:
        time.sleep(0.2)
    if state["trouble"]:
        raise RuntimeError(state["trouble"])
    return state


def planned(studio: Studio, painting_request: dict[str, Any], identifier: str) -> float:
    """Seconds that one plan takes."""
    studio.ask(f"/api/paintings/{identifier}/plans", painting_request)
    return finish(studio, identifier)["plans"][-1]["made"]["seconds"]


def intervals(studio: Studio, painting_request: dict[str, Any], crowd: bool) -> np.ndarray:
    """Seconds of every stroke of a painting, from the robot being told of it to its being done, from the journal."""
    identifier = studio.ask("/api/paintings", painting_request)["id"]
    finish(studio, identifier)
    with Crowd(studio, identifier) if crowd else contextlib.nullcontext():
        studio.ask(f"/api/paintings/{identifier}/start", {"plan": 1, "ready": True})
        finish(studio, identifier)
    folder = next(studio.folder.glob(f"*-{identifier[:6]}"))
    began, took = 0.0, []
    for line in (folder / "painting" / "journal").read_bytes().splitlines():
        record = json.loads(line[line.index(b"{") :])
        at = time.mktime(time.strptime(record["at"][:19], "%Y-%m-%dT%H:%M:%S")) + float(f"0{record['at'][19:23]}")
        if record["kind"] == "motion_began" and record["stroke"] is not None:
            began = at
        elif record["kind"] == "stroke_painted":
            took.append(at - began)
    return np.array(took)


def told_after(crowd: Crowd, folder: PaintingFolder, count: int) -> list[float]:
    """Milliseconds from a line of the feed to every watching client."""
    feed, delays = Feed(folder), []
    for number in range(count):
        mark, at = f"mark-{number}", time.monotonic()
        feed.tell(Failed(mark))
        time.sleep(0.5)
        delays += [1000 * (heard - at) for heard, what in list(crowd.heard) if what == mark]
    return delays


def stops(studio: Studio, folder: PaintingFolder, trials: int) -> tuple[list[float], int]:
    """Milliseconds from the click to the robot's stop being called by the watch of the easel's process, and misses."""
    took, missed = [], 0
    folder.painting.mkdir(exist_ok=True)
    lock = os.open(folder.path / ".worker", os.O_RDWR | os.O_CREAT)
    fcntl.flock(lock, fcntl.LOCK_EX)  # as a worker that paints
    feed = Feed(folder)
    chance = np.random.default_rng(0)
    for number in range(trials):
        called = threading.Event()
        watch = StopFile(folder.robot_stop, lambda reason, called=called: called.set())
        time.sleep(chance.uniform(0, 0.1))
        feed.tell(StrokePainted(number, trials))
        at = time.monotonic()
        studio.ask("/api/stop", {})
        if called.wait(2):
            took.append(1000 * (time.monotonic() - at))
        else:
            missed += 1
        watch.dismiss()
    os.close(lock)
    return took, missed


def first_page(studio: Studio) -> float | None:
    """Milliseconds until a fresh browser shows the gallery; None where there is no browser."""
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        return None
    import shutil

    program = shutil.which("chromium") or shutil.which("google-chrome")
    if program is None:
        return None
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=["--no-sandbox", "--disable-gpu"])
        took = []
        for _ in range(5):
            context = browser.new_context()
            page = context.new_page()
            at = time.monotonic()
            page.goto(f"http://{studio.host}/?token={studio.token}")
            page.get_by_text("What shall we paint?").wait_for(timeout=20_000)
            took.append(1000 * (time.monotonic() - at))
            context.close()
        browser.close()
    return statistics.median(took)


def percentile(values: Any, share: float) -> float:
    return float(np.percentile(np.asarray(values), share))


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--trials", type=int, default=200, help="how often stop is pressed")
    parser.add_argument("--rounds", type=int, default=3, help="how often plans and paintings are compared")
    options: argparse.Namespace = parser.parse_args()
    trials, rounds = (10, 1) if options.quick else (options.trials, options.rounds)
    with tempfile.TemporaryDirectory() as place, studio(Path(place) / "paintings") as here:
        shown = first_page(here)
        identifier = here.ask("/api/pictures", raw=picture())["id"]
        painting_request = {
            "title": "Disc",
            "terms": [{"kind": "image", "picture": identifier}],
            "strokes": 30,
            "colors": 2,
        }
        painting_request |= {"effort": 0.1, "replans": 0, "seed": 1}
        painting = here.ask("/api/paintings", painting_request)["id"]
        finish(here, painting)
        folder = PaintingFolder(next(here.folder.glob(f"*-{painting[:6]}")))
        memory, worked, since = here.memory(), here.cpu(), time.monotonic()
        with Crowd(here, painting) as crowd:
            delays = told_after(crowd, folder, 10 if options.quick else 40)
            took, missed = stops(here, folder, trials)
            work = (here.cpu() - worked) / (time.monotonic() - since)
            grown = here.memory() - memory
        compared, figures = comparison(here, painting_request, rounds) if rounds else ([], {})
    rows = [
        ("first page in a fresh browser", "-" if shown is None else f"{shown:.0f} ms", "< 1000 ms"),
        (f"time until {WATCHING} clients see a change: median, 99th percentile",
         f"{percentile(delays, 50):.0f}, {percentile(delays, 99):.0f} ms", "< 300 ms"),
        (f"from the click to the robot's stop, {trials} times: median, longest",
         f"{percentile(took, 50):.0f}, {max(took):.0f} ms", "< 250 ms"),
        ("missed stops", str(missed), "none"),
        *compared,
        ("CPU of the web process meanwhile", f"{100 * work:.0f} % of a core", ""),
        ("memory of the web process, and of the clients in it", f"{memory:.0f} MB, {grown:+.0f} MB", "+50 MB"),
    ]  # fmt: skip
    title = f"The studio with {WATCHING} watching clients and {DEAF} clients that never read"
    table = Table(title, ("", "", "target"), rows)
    publish([table], {**figures, "stops": took, "told": delays}, options)


def comparison(
    here: Studio, painting_request: dict[str, Any], rounds: int
) -> tuple[list[tuple[str, str, str]], dict[str, Any]]:
    """How much longer strokes and plans take while everybody watches, turn by turn."""
    alone, watched, strokes_alone, strokes_watched = [], [], [], []
    longer = {**painting_request, "strokes": 100, "effort": 0.3}
    painting = here.ask("/api/paintings", painting_request)["id"]
    finish(here, painting)
    for _ in range(rounds):
        alone.append(planned(here, longer, painting))
        with Crowd(here, painting):
            watched.append(planned(here, longer, painting))
        strokes_alone.append(intervals(here, painting_request, crowd=False))
        strokes_watched.append(intervals(here, painting_request, crowd=True))
    base, under = np.concatenate(strokes_alone), np.concatenate(strokes_watched)
    p99 = percentile(under, 99) / percentile(base, 99) - 1
    slower = statistics.median(watched) / statistics.median(alone) - 1
    rows = [
        ("99th percentile of the time of a stroke, with clients against without", f"{100 * p99:+.1f} %", "within 10 %"),
        ("time of a plan, with clients against without (medians)", f"{100 * slower:+.1f} %", "within 5 %"),
    ]
    return rows, {"plans": [alone, watched], "strokes": [base.tolist(), under.tolist()]}


if __name__ == "__main__":
    main()
