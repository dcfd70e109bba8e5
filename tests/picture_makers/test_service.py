"""The maker `http`: a service on this machine, in every way that it can go wrong."""

import base64
import io
import json
import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Event, Thread
from typing import Any

import pytest
import torch
from PIL import Image

from frida_painter.errors import ConfigError, Interrupted, MakingFailed
from frida_painter.system import transfer
from frida_painter_words.picture_makers import service
from frida_painter_words.picture_makers.making import STRENGTH, PictureRequest
from frida_painter_words.picture_makers.service import ServiceMaker

Answer = Callable[[BaseHTTPRequestHandler], None]


class Service(ThreadingHTTPServer):
    """A service whose answer a test writes; `asked` has the questions, `over` is set at the end."""

    daemon_threads = True
    answer: Answer
    asked: list[dict[str, Any]]
    over: Event

    @property
    def host(self) -> str:
        return f"127.0.0.1:{self.server_port}"


class _Handler(BaseHTTPRequestHandler):
    server: Service

    def log_message(self, *words: object) -> None:
        pass

    def do_POST(self) -> None:
        asked = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
        self.server.asked.append({"path": self.path, **asked})
        self.server.answer(self)

    def do_GET(self) -> None:
        self.server.asked.append({"method": "GET"})


@contextmanager
def open_service() -> Iterator[Service]:
    with Service(("127.0.0.1", 0), _Handler) as running:
        running.asked, running.over = [], Event()
        thread = Thread(target=running.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        yield running
        running.over.set()
        running.shutdown()
        thread.join()


@pytest.fixture
def server() -> Iterator[Service]:
    with open_service() as running:
        yield running


def picture(color: int = 200) -> bytes:
    file = io.BytesIO()
    Image.new("RGB", (40, 30), (color, 10, 10)).save(file, "PNG")
    return file.getvalue()


def sends(content: bytes, kind: str = "image/png", status: int = 200, **headers: str) -> Answer:
    def answer(handler: BaseHTTPRequestHandler) -> None:
        handler.send_response(status)
        given = {"Content-Type": kind, "Content-Length": str(len(content))}
        for name, value in (given | {name.replace("_", "-"): value for name, value in headers.items()}).items():
            handler.send_header(name, value)
        handler.end_headers()
        handler.wfile.write(content)

    return answer


def says(record: Any) -> Answer:
    return sends(json.dumps(record).encode(), "application/json")


def hangs(handler: BaseHTTPRequestHandler) -> None:
    handler.server.over.wait(60)


def drips(handler: BaseHTTPRequestHandler) -> None:
    """Sends a picture of unknown length, a little at a time, for ever."""
    handler.send_response(200)
    handler.send_header("Content-Type", "image/png")
    handler.end_headers()
    while not handler.server.over.wait(0.001):
        try:
            handler.wfile.write(b"x" * 50_000)
        except OSError:
            return


def ask(folder: Path, told: list[str] | None = None, seeds: tuple[int, ...] = (7,), seconds: float = 60.0,
        stop: Callable[[], bool] = lambda: False) -> PictureRequest:  # fmt: skip
    folder = folder / "place"
    folder.mkdir()
    tell = [].append if told is None else told.append
    return PictureRequest("a lemon", seeds, 128, 64, folder, torch.device("cpu"), seconds, stop, tell)


CODED = base64.b64encode(picture()).decode()


def test_a_service_is_sent_the_canvas_as_the_web_ui_of_stable_diffusion_takes_it(
    tmp_path: Path, server: Service
) -> None:
    server.answer, told = sends(picture()), list[str]()
    (tmp_path / "canvas.png").write_bytes(picture(1))
    (tmp_path / "free.png").write_bytes(picture(2))
    request = replace(ask(tmp_path, told), canvas=tmp_path / "canvas.png", free=tmp_path / "free.png")
    (made,) = ServiceMaker.parse(f"http://{server.host}/sdapi/v1/txt2img?key=1").make(request)
    assert isinstance(made, Path) and made.read_bytes() == picture()
    (asked,) = server.asked
    assert asked["path"] == "/sdapi/v1/img2img?key=1" and asked["denoising_strength"] == STRENGTH
    assert base64.b64decode(asked["init_images"][0]) == picture(1) and base64.b64decode(asked["mask"]) == picture(2)
    assert told[0].startswith("Your words and the canvas are sent to 127.0.0.1")


@pytest.mark.parametrize(
    "answer",
    [
        sends(picture()),
        says({"image": CODED}),
        says({"image": f"data:image/png;base64,{CODED}"}),
        says({"images": [CODED], "parameters": {}}),
        says({"data": [{"b64_json": CODED}]}),
    ],
)
def test_a_picture_comes_as_a_file_or_in_base64(tmp_path: Path, server: Service, answer: Answer) -> None:
    server.answer = answer
    told: list[str] = []
    (made,) = ServiceMaker.parse(f"http://{server.host}/make").make(ask(tmp_path, told))
    assert isinstance(made, Path) and made.read_bytes() == picture()
    question = {"words": "a lemon", "prompt": "a lemon", "seed": 7, "width": 128, "height": 64}
    assert server.asked == [{"path": "/make", **question}]
    assert told[0] == f"Your words, the seed and the size are sent to {server.host}, unencrypted."


def test_each_seed_is_asked_once_and_a_redirect_within_the_host_is_followed(tmp_path: Path, server: Service) -> None:
    def answer(handler: BaseHTTPRequestHandler) -> None:
        new = sends(b"", status=307, Location="/new") if handler.path == "/old" else sends(picture())
        new(handler)

    server.answer = answer
    maker = ServiceMaker.parse(f"//{server.host}/old")
    assert len(maker.make(ask(tmp_path, seeds=(7, 8)))) == 2
    assert [one["seed"] for one in server.asked] == [7, 7, 8, 8]


@pytest.mark.parametrize(
    ("answer", "says"),
    [
        (sends(b"<html>Sign in</html>", "text/html; charset=utf-8"), "returned text/html, not a picture"),
        (sends(b"", status=500), "answers 500 Internal Server Error"),
        (sends(b"", status=404), "answers 404 Not Found; mend it"),
        (sends(b'{"detail": "no model\n"}', status=503), r'Service Unavailable \({"detail": "no model "}\); mend it'),
        (sends(b"<html>no", status=502), "answers 502 Bad Gateway; mend it"),
        (sends(b"", Content_Length=str(50 * 10**9)), "sends more than 1 MB; a picture file is smaller"),
        (drips, "more than 1 MB"),
        (sends(b"", status=302, Location="http://example.invalid/x"), "redirects to http://example.invalid, which"),
        (sends(b"", status=307, Location="https://127.0.0.1/x"), "redirects to https://127.0.0.1, which nobody"),
        (sends(b"", status=307, Location="file:///etc/passwd"), "redirects to file://|answers 307"),
        (sends(b"", status=307, Location="/make"), "answers 307"),
        (sends(b"x", Content_Length="20"), "broke off after 1 of 20 bytes"),
        (says({"image": "no base64!"}), "returned JSON without a picture"),
        (says({"images": []}), "returned 0 pictures for one seed"),
        (says({"images": [CODED] * 3}), "returned 3 pictures for one seed"),
        (says({"error": "busy"}), "returned JSON without a picture"),
        (says([1]), "returned JSON without a picture"),
        (sends(b"[" * 100_000, "application/json"), "returned JSON without a picture"),
        (sends(b"{", "application/json"), "returned JSON without a picture"),
        (lambda handler: handler.connection.close(), "cannot be asked"),
    ],
)  # fmt: skip
def test_each_fault_is_one_sentence(
    tmp_path: Path, server: Service, monkeypatch: pytest.MonkeyPatch, answer: Answer, says: str
) -> None:
    monkeypatch.setattr(service, "MAX_BYTES", 10**6)
    server.answer = answer
    (fault,) = ServiceMaker.parse(f"http://{server.host}/make").make(ask(tmp_path))
    assert isinstance(fault, MakingFailed) and re.search(says, str(fault))
    assert str(fault).startswith(f"The service {server.host} ") and "\n" not in str(fault)
    assert all("words" in question for question in server.asked), "a redirect never becomes another question"


def test_a_service_that_hangs_is_left_in_time_and_at_a_stop(tmp_path: Path, server: Service) -> None:
    server.answer = hangs
    maker, began = ServiceMaker.parse(f"http://{server.host}/make"), time.monotonic()
    (fault,) = maker.make(ask(tmp_path, seconds=3.0))
    assert re.search(f"{server.host} (was not finished after|cannot be asked)", str(fault))
    (tmp_path / "place").rename(tmp_path / "before")
    with pytest.raises(Interrupted, match="You stopped the making"):
        maker.make(ask(tmp_path, stop=lambda: len(server.asked) > 1))
    assert time.monotonic() - began < 50


def test_a_service_that_drips_a_picture_is_left(
    server: Service, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def drip(handler: BaseHTTPRequestHandler) -> None:
        handler.send_response(200)
        handler.send_header("Content-Type", "image/png")
        handler.end_headers()
        while not handler.server.over.wait(0.02):  # type: ignore[attr-defined]
            with suppress(OSError):
                handler.wfile.write(b"x")

    server.answer = drip
    monkeypatch.setattr(transfer, "_WINDOW", 0.3)
    (fault,) = ServiceMaker.parse(f"http://{server.host}/").make(ask(tmp_path))
    assert re.search(r"is too slow: less than 2 kB a second came for 60 s; mend it, or name", str(fault))


def test_nobody_at_the_address(tmp_path: Path, server: Service) -> None:
    with Service(("127.0.0.1", 0), _Handler) as gone:
        host = gone.host
    (fault,) = ServiceMaker.parse(f"http://{host}").make(ask(tmp_path))
    assert re.search(f"The service {host} cannot be asked .*refused", str(fault))


@pytest.mark.parametrize(
    "text", ["", "//", "http:", "localhost:80", "ftp://here/x", "file:///etc/passwd", "http://a:b/", "http://a b/",
             "http://a/\n", "http://[::1", "http://a:99999/", "http://ä/"],
)  # fmt: skip
def test_what_is_no_address_is_refused_before_anything(text: str) -> None:
    with pytest.raises(ConfigError, match="is no address of a service; write for example http:http://localhost"):
        ServiceMaker.parse(text)


def test_a_password_is_refused_and_a_key_is_not_recorded() -> None:
    with pytest.raises(ConfigError, match="holds a name or a password"):
        ServiceMaker.parse("https://me:secret@host/make")
    assert ServiceMaker.parse("https://host/make?key=secret").facts == {"address": "https://host/make"}


def test_a_question_that_fails_in_another_way_is_told_at_once(
    tmp_path: Path, server: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*given: object) -> bytes:
        raise RuntimeError("out of luck")

    monkeypatch.setattr(service, "_ask", fail)
    began = time.monotonic()
    (fault,) = ServiceMaker.parse(f"http://{server.host}/make").make(ask(tmp_path))
    assert isinstance(fault, MakingFailed) and "out of luck" in str(fault) and time.monotonic() - began < 2
