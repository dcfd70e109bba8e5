"""A stop is answered, and heard by who works, whatever else the studio is asked for: in real processes."""

import asyncio
import contextlib
import json
import os
import shutil
import signal
import socket
import sqlite3
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import closing
from http.client import HTTPConnection
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

from frida_painter.system import python_process
from frida_painter_studio.at_page import StopWatch, call
from frida_painter_studio.network import share_lock
from frida_painter_studio.stop import END, StopKey
from frida_painter_studio.stop_listener import StopProcess
from frida_painter_studio.store import PaintingStore
from frida_painter_studio.studio_folder import PaintingFolder
from frida_painter_together.commands import Role
from served import PATIENCE, Served, Work, end_listener, open_studio, opened_studio


@pytest.fixture
def studio(tmp_path: Path) -> Iterator[Served]:
    with opened(tmp_path / "paintings") as served:
        yield served


@contextlib.contextmanager
def opened(folder: Path, files: int | None = None) -> Iterator[Served]:
    with opened_studio(folder, files=files) as served:
        yield served
    end_listener(folder)


@contextlib.contextmanager
def at_work(studio: Served) -> Iterator[Work]:
    working = Work(PaintingStore(studio.folder))
    yield working
    working.lock.release()


@pytest.fixture
def work(studio: Served) -> Iterator[Work]:
    with at_work(studio) as working:
        yield working


def press_way(host: str, way: dict[str, Any], *, origin: str | None = None) -> dict[str, Any]:
    connection = HTTPConnection(host, way["port"], timeout=PATIENCE)
    with closing(connection):
        headers = {"Content-Type": "text/plain", **({"Origin": origin} if origin else {})}
        connection.request("POST", "/stop", way["secret"], headers)
        return dict(json.loads(connection.getresponse().read()))


def require_stopped(studio: Served, work: Work, way: dict[str, Any]) -> None:
    """By both ways, each in time, and heard by who works."""
    began = time.monotonic()
    assert press_way(studio.host, way, origin=f"http://{studio.host}:{studio.port}")["stopped"] == 1
    assert work.told.wait(PATIENCE)
    assert time.monotonic() - began < PATIENCE


def test_a_stop_is_heard_by_line_and_leaves_files_and_a_record(studio: Served, work: Work) -> None:
    way = studio.way
    deadline = time.monotonic() + 20
    while press_way(studio.host, way) != {"stopped": 1, "heard": 1}:
        assert time.monotonic() < deadline, "the worker calls, and is heard"
    assert work.told.is_set()
    for file in (work.folder.stop, work.folder.robot_stop):
        while not file.exists():
            assert time.monotonic() < deadline
    studio.ask("/api/stop", {}, "watch")
    while True:
        with closing(sqlite3.connect(studio.folder / "studio.sqlite")) as base:
            by = {by for (by,) in base.execute("SELECT by FROM deed WHERE what = 'stop'")}
        if by >= {"operate", "bearer-watch"}:
            break
        assert time.monotonic() < deadline
        time.sleep(0.05)


@pytest.mark.parametrize("after", [0.0, 2.0])
def test_a_planner_ends_at_once_at_every_moment_of_its_loading(studio: Served, after: float) -> None:
    Image.new("RGB", (64, 48), (200, 120, 60)).save(studio.folder / "pictures" / f"{'a' * 32}.png")
    request = {"terms": [{"kind": "image", "picture": "a" * 32}], "strokes": 300}
    identifier = studio.ask("/api/paintings", request)["id"]
    assert studio.ask("/api/work")["working"] == [identifier] and not studio.ask("/api/work")["moves"]
    time.sleep(after)
    began = time.monotonic()
    told = press_way(studio.host, studio.way)
    assert told == {"stopped": 1, "heard": 1}, "no alarm for what cannot move"
    while studio.ask("/api/work")["working"]:
        assert time.monotonic() - began < PATIENCE
        time.sleep(0.02)
    print(f"ended {time.monotonic() - began:.2f} s after the stop")
    shown = studio.ask(f"/api/paintings/{identifier}")
    assert (shown["stage"], shown["trouble"], shown["resumable"]) == ("plan stopped", "", False)


def test_a_locked_database_and_threads_that_wait_for_it_hold_no_stop_up(studio: Served, work: Work) -> None:
    way, paths = studio.way, ["/api/paintings", "/api/studio", f"/api/paintings/{'0' * 16}"]
    with closing(sqlite3.connect(studio.folder / "studio.sqlite", isolation_level=None)) as base:
        base.execute("BEGIN EXCLUSIVE")
        waiting = [raw_get(studio, paths[number % 3]) for number in range(120)]
        time.sleep(0.5)
        require_stopped(studio, work, way)
        began = time.monotonic()
        assert studio.ask("/api/stop", {})["stopped"] == 1
        assert time.monotonic() - began < PATIENCE
        for each in waiting:
            each.close()
        base.execute("ROLLBACK")


def raw_get(studio: Served, path: str) -> socket.socket:
    """A question whose answer nobody reads."""
    connection = socket.create_connection((studio.host, studio.port), timeout=PATIENCE)
    head = f"GET {path} HTTP/1.1\r\nHost: {studio.host}:{studio.port}\r\nAuthorization: Bearer {studio.tokens['watch']}"
    connection.sendall(f"{head}\r\n\r\n".encode())
    return connection


def test_half_open_connections_keep_nobody_out(tmp_path: Path) -> None:
    with opened(tmp_path / "paintings", files=200) as studio, at_work(studio) as work, contextlib.ExitStack() as stack:
        way = studio.way
        for number in range(300):
            for port in (studio.port, way["port"]):
                half = stack.enter_context(socket.create_connection((studio.host, port), timeout=PATIENCE))
                if number % 2:
                    with contextlib.suppress(OSError):  # it was cut already
                        half.sendall(b"POST /stop HTTP/1.1\r\nHost: ")
        require_stopped(studio, work, way)
        assert studio.ask("/api/studio")["role"] == "operate", "the page as well"


def test_what_waits_for_a_request_is_cut(studio: Served) -> None:
    with socket.create_connection((studio.host, studio.way["port"]), timeout=20) as slow:
        slow.sendall(b"POST /stop HTTP/1.1\r\nHost: ")
        assert slow.recv(100) == b""


def test_an_old_page_stops_while_the_studio_is_gone_and_after_it_was_opened_again(tmp_path: Path) -> None:
    """In a folder with a long name: addresses of local sockets are short, folders need not be."""
    with opened(tmp_path / ("a long name " * 12)) as studio, at_work(studio) as work:
        way = studio.way
        deadline = time.monotonic() + 20
        while press_way(studio.host, way)["heard"] != 1:
            assert time.monotonic() < deadline
            time.sleep(0.05)
        studio.kill()
        require_stopped(studio, work, way)
        again = open_studio(studio.folder, port=studio.port)
        try:
            assert again.way["port"] == way["port"], "the one that listens is taken over"
            assert press_way(again.host, way)["stopped"] == 1
        finally:
            again.kill()


def test_a_listener_that_was_killed_is_started_again_on_its_port(studio: Served, work: Work) -> None:
    way = studio.way
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        with contextlib.suppress(OSError):
            words = path.read_bytes().split(b"\0")
            if b"frida_painter_studio.stop_listener" in words and str(studio.folder).encode() in words:
                os.kill(int(path.parent.name), signal.SIGKILL)
    deadline = time.monotonic() + 20
    while True:
        with contextlib.suppress(OSError, ValueError):
            if press_way(studio.host, way)["stopped"] == 1:
                break
        assert time.monotonic() < deadline
        time.sleep(0.1)


def test_a_folder_that_was_deleted_and_made_again_has_one_listener(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One that ended at once would be started again every second."""
    started: list[subprocess.Popen[bytes]] = []
    begin = python_process.start

    def note(*words: object, **options: Any) -> subprocess.Popen[bytes]:
        started.append(begin(*words, **options))
        return started[-1]

    monkeypatch.setattr(python_process, "start", note)
    folder = tmp_path / "paintings"
    folder.mkdir()
    studio = share_lock(folder)
    process = StopProcess(folder, lambda port: socket.create_server(("127.0.0.1", 0)), frozenset({"localhost"}), 0)
    process.start()

    async def keep() -> None:
        keeping = asyncio.create_task(process.keep())
        shutil.rmtree(folder)
        await asyncio.sleep(1.5)
        folder.mkdir()
        async with asyncio.timeout(20):
            while len(started) < 2:
                await asyncio.sleep(0.05)
        await asyncio.sleep(4)
        keeping.cancel()

    asyncio.run(keep())
    assert len(started) == 2
    os.close(studio)
    with call(folder) as line:
        line.sendall(f"{END}\n".encode())
    for one in started:
        one.wait(PATIENCE + 20)


def test_other_pages_and_wrong_secrets_stop_nothing(studio: Served, work: Work) -> None:
    way = studio.way
    for origin in ("http://evil.example", "null", "http://127.0.0.1.evil.example"):
        assert "stopped" not in press_way(studio.host, way, origin=origin)
    for wrong in ("", "guess", way["secret"][:-1], way["secret"].replace("operate", "watch")):
        assert "stopped" not in press_way(studio.host, {**way, "secret": wrong})
    connection = HTTPConnection(studio.host, way["port"], timeout=PATIENCE)
    with closing(connection):
        connection.request("POST", "/stop", way["secret"], {"Host": "evil.example"})
        assert connection.getresponse().status == 403
    assert not work.told.is_set()


def test_secrets_end_a_watchers_before_an_operators(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    key = StopKey.of(tmp_path)
    secret = {role: key.secret(role) for role in Role}
    again = StopKey.of(tmp_path)
    assert all(again.role(text) is role for role, text in secret.items())
    assert (tmp_path / ".stop-key").stat().st_mode & 0o777 == 0o600
    assert StopKey(b"x" * 32).role(secret[Role.operate]) is None
    now = time.time()
    monkeypatch.setattr(time, "time", lambda: now + 2 * 86400)
    assert again.role(secret[Role.watch]) is None and again.role(secret[Role.operate]) is Role.operate
    monkeypatch.setattr(time, "time", lambda: now + 31 * 86400)
    assert again.role(secret[Role.operate]) is None


def test_no_stop_file_or_line_needs_the_other(tmp_path: Path) -> None:
    folder = PaintingFolder(tmp_path / "painting")
    folder.path.mkdir()
    watch, told = StopWatch(folder.stop, tmp_path), threading.Event()
    watch.then(told.set)
    folder.stop_now()
    assert told.wait(PATIENCE) and watch.asked
    later = threading.Event()
    watch.then(later.set)
    assert later.is_set(), "it was pressed before"
