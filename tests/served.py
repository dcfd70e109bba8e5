"""A studio in processes of its own, and somebody at work in it who waits for a stop."""

import contextlib
import fcntl
import json
import re
import resource
import secrets
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from http.client import HTTPConnection
from pathlib import Path
from typing import Any

from frida_painter_studio.at_page import StopWatch
from frida_painter_studio.store import PaintingStore
from frida_painter_studio.studio_folder import WorkerLock

PATIENCE = 5.0
"""Seconds for a stop on a machine on which anything else may run; tests/stress/stop.py measures how long it takes."""


@dataclass
class Served:
    """A studio in a process of its own, started with these words; it may be killed and started again."""

    process: subprocess.Popen[str]
    host: str
    port: int
    tokens: dict[str, str]
    folder: Path
    words: tuple[str, ...]

    @property
    def address(self) -> str:
        return f"http://{self.host}:{self.port}/?token={self.tokens['operate']}"

    def ask(self, path: str, record: Any = None, role: str = "operate") -> Any:
        connection = HTTPConnection(self.host, self.port, timeout=60)
        signs = {"X-Nonce": secrets.token_hex(16), "X-Given": str(time.time()), "Content-Type": "application/json"}
        body = None if record is None else json.dumps(record)
        headers = {"Authorization": f"Bearer {self.tokens[role]}", **signs}
        with closing(connection):
            connection.request("GET" if record is None else "POST", path, body, headers)
            return json.loads(connection.getresponse().read())

    @property
    def way(self) -> dict[str, Any]:
        """Where its pages send a stop."""
        return dict(self.ask("/api/studio")["stop"])

    def press_enter(self) -> None:
        """Confirms, in the studio's terminal, that somebody stands beside the machine."""
        assert self.process.stdin is not None and self.process.stdout is not None
        self.process.stdin.write("\n")
        self.process.stdin.flush()
        while "Pressed." not in self.process.stdout.readline():
            assert self.process.poll() is None

    def fall_over_and_be_started_again(self) -> None:
        """Killed; the new one has another address and other tokens."""
        self.kill()
        self.__dict__.update(vars(open_studio(self.folder, *self.words)))

    def close(self) -> None:
        """Ends it as a person does, and whatever a test that failed has left at work."""
        for painting in self.folder.glob("*/feed.jsonl"):
            painting.with_name("stop").touch()
        self.process.send_signal(signal.SIGINT)
        self.process.wait(120)

    def kill(self) -> None:
        self.process.kill()
        self.process.wait(10)
        assert self.process.stdin is not None and self.process.stdout is not None
        self.process.stdin.close()
        self.process.stdout.close()


def open_studio(folder: Path, *words: str, files: int | None = None, port: int = 0) -> Served:
    program = [sys.executable, "-m", "frida_painter", "studio", "--folder", str(folder), "--port", str(port)]

    def few_files() -> None:
        resource.setrlimit(resource.RLIMIT_NOFILE, (files or 0, files or 0))

    process = subprocess.Popen(
        [*program, *words, "--no-browser"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
        text=True, preexec_fn=few_files if files else None,
    )  # fmt: skip
    assert process.stdout is not None
    links = [re.search(r"https?://(\S+):(\d+)/\?token=(\S+)", process.stdout.readline()) for _ in range(3)]
    (host, port_, operate), (_, _, plan), (_, _, watch) = [link.groups() for link in links if link]
    return Served(process, host, int(port_), {"operate": operate, "plan": plan, "watch": watch}, folder, words)


@contextlib.contextmanager
def opened_studio(folder: Path, *words: str, files: int | None = None) -> Iterator[Served]:
    """A studio whose paintings are in that folder; it is closed in the end, whatever happens."""
    served = open_studio(folder, *words, files=files)
    try:
        yield served
        served.close()
    finally:
        served.kill()


def end_listener(folder: Path) -> None:
    """Nobody works and no studio is open: it ends by itself."""
    for _ in range(400):
        with contextlib.suppress(OSError), (folder / ".stop-lock").open() as file:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return
        time.sleep(0.05)
    raise AssertionError("the listener for stops goes on though nobody needs it")


class Work:
    """Somebody at work, as the studio sees it: holds a painting's lock, and watches for a stop."""

    def __init__(self, store: PaintingStore) -> None:
        self.entry = store.begin("A painting")
        self.folder = self.entry.folder
        self.folder.painting.mkdir()
        self.lock = WorkerLock(self.folder)
        assert self.lock.take()
        self.watch = StopWatch(self.folder.stop, store.root)
        self.told = threading.Event()
        self.watch.then(self.told.set)
