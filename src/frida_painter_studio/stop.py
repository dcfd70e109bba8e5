"""Stop of all work: reports it to all workers, then writes stop files and a record.

The report waits for nothing that could be blocked: no thread pool, no database, no disk. Files and record are
written by their own threads, which may wait for a disk.
"""

import asyncio
import contextlib
import hashlib
import hmac
import json
import os
import queue
import secrets
import socket
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self

from frida_painter.errors import StorageError
from frida_painter.system import storage
from frida_painter.system.operating_system import open_file
from frida_painter_studio.at_page import HEARD, HERE, LINE, STOP, WORK, find_listener
from frida_painter_studio.store import PaintingStore
from frida_painter_studio.studio_folder import PLAN_JOB, find_job, find_work
from frida_painter_studio.workers import QUEUE
from frida_painter_together.commands import Role

# Secrets of pages for stops: they outlive sessions and restarts of the studio, and serve for nothing else.

_FILE = ".stop-key"
_BYTES = 32
_DAY = 86400
_GOOD_FOR = {Role.watch: _DAY, Role.plan: _DAY, Role.operate: 30 * _DAY}  # seconds


@dataclass(frozen=True)
class StopKey:
    """Makes and checks secrets for stops; each names a role and its end, and is signed with the studio's key.

    Every role may stop: a watcher's secret ends after a day, an operator's after thirty.
    """

    key: bytes

    @classmethod
    def of(cls, folder: Path) -> Self:
        """Returns the key of the studio with its paintings in `folder`; makes it if it is missing.

        Raises StorageError.
        """
        path = folder / _FILE
        try:
            if not path.exists():
                _make(path)
            key = storage.read_bytes(path, "the key for stops", _BYTES)
        except OSError as error:
            raise StorageError(f"{path} cannot be kept ({error.strerror}); without it nobody could stop.") from error
        if len(key) != _BYTES:
            raise StorageError(f"{path} is damaged; delete it, and open the studio again.")
        return cls(key)

    def secret(self, role: Role) -> str:
        """Returns a secret for a page of that role."""
        claim = f"{role.name}.{int(time.time()) + _GOOD_FOR[role]}"
        return f"{claim}.{self._sign(claim)}"

    def role(self, secret: str) -> Role | None:
        """Returns the role of a secret; None if it is wrong or has ended."""
        claim, _, sign = secret.rpartition(".")
        if not hmac.compare_digest(self._sign(claim).encode(), sign.encode("utf-8", "replace")):
            return None
        name, _, ends = claim.partition(".")
        return Role[name] if time.time() <= int(ends) else None

    def _sign(self, claim: str) -> str:
        return hmac.new(self.key, claim.encode("utf-8", "replace"), hashlib.sha256).hexdigest()


def _make(path: Path) -> None:
    temporary = path.with_name(f"{_FILE}-{secrets.token_hex(8)}")
    with os.fdopen(open_file(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
        file.write(secrets.token_bytes(_BYTES))
        file.flush()
        os.fsync(file.fileno())
    try:
        with contextlib.suppress(FileExistsError):
            os.link(temporary, path)  # atomic; does not overwrite the key of another process
    finally:
        temporary.unlink()


# Line from the listener to the processes at work (at_page.py).

PRESS, END = "press", "end"
"""First words of other callers, followed by a name and a line's end: a stop, the listener's end."""


def listen_locally(folder: Path) -> socket.socket:
    """Returns a listening socket, whose secret only the folder's owner can read. Raises OSError, StorageError."""
    listening = socket.create_server((HERE, 0), backlog=64)
    with storage.replacing(folder / LINE, mode=0o600) as temporary:
        temporary.write_text(f"{listening.getsockname()[1]} {secrets.token_hex(16)}\n", encoding="ascii")
    return listening


_HEARD_WITHIN = 0.3  # seconds for the workers' answers
_FILES_WITHIN = 0.1  # more seconds if a worker has not answered
_LISTENER_WITHIN = 1.0


@dataclass(eq=False)
class _Line:
    """Line of a worker: the name of its folder, its job, and the sign that it has reacted to the last stop."""

    name: str
    job: str
    writer: asyncio.StreamWriter
    heard: asyncio.Event = field(default_factory=asyncio.Event)


class Stops:
    """Sends a stop to all workers by their lines, then by stop files; a record of it follows.

    Files and record are written by threads of their own. The files need no database, which may be locked for long; a
    stop while they are being written has them written once more.
    secret: of those who call the line (`answer`)
    """

    def __init__(self, root: Path, secret: str = "") -> None:
        self._root, self._secret = root, secret
        self._lines: set[_Line] = set()
        self._files_asked, self._passes = threading.Event(), 0
        self._found = self._held = 0  # workers of the last pass, and those that need only the file, or move nothing
        self._records: queue.Queue[tuple[str, str]] = queue.Queue(1000)
        for work in (self._write_files, self._write_records):
            threading.Thread(target=work, daemon=True, name="stop files").start()

    async def press(self, by: str) -> dict[str, int]:
        """Stops all work; returns the number of workers, and the number of those that have confirmed.

        A planner counts as one that has: it moves nothing, and ends without an answer.
        """
        called = list(self._lines)
        for line in called:
            line.heard.clear()
            line.writer.write(STOP)
        passes = self._passes
        self._files_asked.set()
        waiting = [asyncio.create_task(line.heard.wait()) for line in called if line.job != PLAN_JOB]
        _, late = await asyncio.wait(waiting, timeout=_HEARD_WITHIN) if waiting else (set(), set())
        for task in late:
            task.cancel()
        if late or not called:
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(_FILES_WITHIN):
                    while self._passes == passes:
                        await asyncio.sleep(0.005)
        with contextlib.suppress(queue.Full):
            self._records.put_nowait((by, ", ".join(sorted(line.name for line in called))))
        if called:
            return {"stopped": len(called), "heard": len(called) - len(late)}
        return {"stopped": self._found, "heard": self._held}

    def _write_files(self) -> None:
        while self._files_asked.wait():
            self._files_asked.clear()
            found = held = 0
            with contextlib.suppress(OSError):
                for folder in find_work(self._root):
                    found += 1
                    held += folder.path.name == QUEUE or find_job(folder) == PLAN_JOB
                    with contextlib.suppress(OSError):  # its folder was deleted
                        folder.stop_now()
            self._found, self._held = found, held
            self._passes += 1

    def _write_records(self) -> None:
        while True:
            by, what = self._records.get()
            while True:
                try:
                    PaintingStore(self._root).note(by, what, "stop")
                    break
                except (StorageError, OSError):
                    time.sleep(1)

    async def answer(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Serves a caller on the line, after its secret."""
        try:
            async with asyncio.timeout(_LISTENER_WITHIN):
                secret = (await reader.readline()).strip()
            if not hmac.compare_digest(secret, self._secret.encode()):
                return
            writer.write(HEARD)
            kind, _, name = (await reader.readline()).decode(errors="replace").strip().partition(" ")
            if kind == WORK:
                name, _, job = name.partition(" ")
                line = _Line(name, job, writer)
                self._lines.add(line)
                try:
                    while await reader.read(1) == HEARD:
                        line.heard.set()
                finally:
                    line.heard.set()  # its process is gone
                    self._lines.remove(line)
            elif kind == PRESS:
                writer.write(json.dumps(await self.press(name)).encode())
                await writer.drain()
            elif kind == END:
                asyncio.get_running_loop().stop()
        except (OSError, ValueError, TimeoutError):
            pass  # the caller is gone, or a stranger
        finally:
            writer.close()

    async def press_at_listener(self, by: str) -> dict[str, int]:
        """Stops all work through the listener; if it does not answer, from this process."""
        try:
            async with asyncio.timeout(_LISTENER_WITHIN):
                port, secret = find_listener(self._root)
                reader, writer = await asyncio.open_connection(HERE, port)
                try:
                    writer.write(f"{secret}\n{PRESS} {by}\n".encode())
                    answer: dict[str, int] = json.loads((await reader.read()).removeprefix(HEARD))
                finally:
                    writer.close()
                return answer
        except (OSError, ValueError, TimeoutError):
            return await self.press(by)
