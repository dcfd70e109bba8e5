"""Requests of all kinds, most of them senseless: none does any harm, learns a path, or has something run or fetched."""

import random
import sys
import threading
import traceback
import typing
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import CodeType, FrameType, ModuleType
from typing import Any

import pytest

from frida_painter.system import python_process
from frida_painter_studio import network
from frida_painter_studio.workers import WorkerSlot
from support.programs import load_program
from support.studio import Studio, Visitor, order

COUNT, EACH = 150, 3


@pytest.fixture(scope="module")
def storm() -> ModuleType:
    """tests/stress/storm.py, which throws ten thousand and more at a studio that is really served."""
    return load_program(Path(__file__).parents[1] / "stress" / "storm.py")


class Guard:
    """Hears, while it watches, of everything that Python tells its auditors; what no request may bring about it keeps.

    That is: pickles, code made of texts, programs started, and connections to anywhere. (Hooks cannot be taken away
    again, so there is one for all tests.)
    """

    def __init__(self) -> None:
        self.watching, self.seen = False, list[str]()
        sys.addaudithook(self._hear)

    @contextmanager
    def watch(self) -> Iterator[None]:
        self.watching = True
        try:
            yield
        finally:
            self.watching = False

    def _hear(self, event: str, what: tuple[Any, ...]) -> None:
        # A worker's thread that other tests left behind calls the listener of stops; no request has to do with it.
        elsewhere = threading.current_thread().name == "stop line"
        if self.watching and not elsewhere and self._is_forbidden(event, what) and not loading():
            self.seen.append(f"{event} {what!r}"[:300])

    def _is_forbidden(self, event: str, what: tuple[Any, ...]) -> bool:
        if event == "exec":
            file = what[0].co_filename if isinstance(what[0], CodeType) else ""
            return file.startswith("<") and not file.startswith("<frozen")
        if event == "compile":
            return str(what[1]).startswith("<")
        decoding = python_process.command("-m", python_process.__name__, "frida_painter_studio.reader:decode_upload")
        if event == "subprocess.Popen" and what[1][:-1] == decoding:
            return False  # every picture is decoded in a process of its own
        if event == "socket.connect" and isinstance(what[1], str):
            return not what[1].endswith("/the-store/.stop")  # the listener for stops
        started = ("os.system", "os.exec", "os.posix_spawn", "subprocess.Popen", "pty.spawn")
        return event in started or event.startswith(("pickle.", "socket.connect", "socket.getaddrinfo", "urllib."))


def loading() -> bool:
    """True while a library makes classes of texts, a traceback parses its line, or an annotation is evaluated."""
    frame: FrameType | None = sys._getframe()
    while frame is not None:
        file = frame.f_code.co_filename
        if file.startswith("<frozen importlib") or file in (traceback.__file__, typing.__file__):
            return True
        frame = frame.f_back
    return False


@pytest.fixture(scope="module")
def guard() -> Guard:
    return Guard()


def test_the_guard_hears_what_it_is_there_for(guard: Guard) -> None:
    with guard.watch():
        eval("1 + 1")
        __import__("pickle").loads(b"cbuiltins\nlen\n.")
        __import__("subprocess").run(["true"], check=True)
    heard = " ".join(guard.seen)
    assert all(event in heard for event in ("exec", "compile", "pickle.find_class", "subprocess.Popen"))
    guard.seen.clear()


def test_nothing_senseless_does_any_harm(
    storm: ModuleType, guard: Guard, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(WorkerSlot, "start", lambda self, job, plan: None)
    monkeypatch.setattr(network.Bucket, "take", lambda self, who: True)
    studio = Studio(tmp_path / "the-store")
    visitor: Visitor = studio.visitor()
    known = studio.store.begin("Known").id
    told, paths = storm.description(tmp_path / "another-store"), storm.routes(tmp_path / "another-store")
    chance = random.Random(1)
    made = storm.by_description(told, known, EACH, 1)
    assert len(made) > 10 * EACH
    made += [storm.request(chance, paths, known) for _ in range(COUNT)]
    answered = set()
    for method, path, headers, body in made:
        url = path.replace("\x00", "%00")
        if not url.isprintable():
            continue
        signed = {**headers, "Origin": "http://127.0.0.1:8350", "X-Page-Key": visitor.key, **order()}
        with guard.watch():
            answer = visitor.client.request(method, url, headers=signed, content=body)
        said = answer.text if method != "HEAD" and "image" not in answer.headers.get("content-type", "") else ""
        assert answer.status_code < 500, (method, url, body[:200], said)
        assert str(tmp_path) not in said and "Traceback" not in said, (method, url, said)
        answered.add(answer.status_code)
    assert guard.seen == []
    assert {200, 404, 409, 422} <= answered
    assert "Traceback" not in capsys.readouterr().err
    assert visitor.get("/api/studio").status_code == 200
