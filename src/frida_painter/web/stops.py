"""What a stop does, wherever it was asked for: says so to all who work, then leaves files and a record behind.

The first waits for nothing that anything else can fill: no pool of threads, no database, no disk. Files and record are
the business of threads of their own, which may wait for a disk as long as they like.
"""

import asyncio
import contextlib
import json
import queue
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path

from frida_painter.errors import StorageError
from frida_painter.web.folder import PaintingFolder, working
from frida_painter.web.painting_queue import QUEUE
from frida_painter.web.painting_store import PaintingStore
from frida_painter.web.stop_line import END, HEARD, PRESS, STOP, WORK, address

_HEARD_WITHIN = 0.3  # seconds for the workers' answers
_FILES_WITHIN = 0.1  # seconds more, where nobody has answered
_LISTENER_WITHIN = 1.0


@dataclass
class StopFiles:
    """Puts stop files where somebody works, on a thread of its own; asked while it does so, it does so once more.

    found: at how many places somebody worked; held: of these those that need no more than the file.
    """

    root: Path
    found: int = 0
    held: int = 0
    _asked: threading.Event = field(default_factory=threading.Event)
    _passes: int = 0

    def __post_init__(self) -> None:
        threading.Thread(target=self._keep, daemon=True, name="stop files").start()

    def ask(self) -> int:
        """Has files put; returns how often that was done before."""
        passes = self._passes
        self._asked.set()
        return passes

    def done_since(self, passes: int) -> bool:
        """Whether it was done since."""
        return self._passes > passes

    def _keep(self) -> None:
        while self._asked.wait():
            self._asked.clear()
            found = held = 0
            with contextlib.suppress(OSError):
                for folder in map(PaintingFolder, self.root.iterdir()):
                    with contextlib.suppress(OSError):
                        if working(folder):
                            found += 1
                            folder.stop_now()
                            held += folder.path.name == QUEUE
            self.found, self.held = found, held
            self._passes += 1


class StopRecorder:
    """Puts stops down in the studio's record once they were done, however long its database is locked."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._waiting: queue.Queue[tuple[str, str]] = queue.Queue(1000)
        threading.Thread(target=self._keep, daemon=True, name="record").start()

    def note(self, by: str, what: str) -> None:
        """Somebody stopped these paintings. Where a thousand wait already, this one is left out."""
        with contextlib.suppress(queue.Full):
            self._waiting.put_nowait((by, what))

    def _keep(self) -> None:
        while True:
            by, what = self._waiting.get()
            while True:
                try:
                    PaintingStore(self._root).note(by, what, "stop")
                    break
                except StorageError:
                    time.sleep(1)


class Stops:
    """Says a stop to everybody who works."""

    def __init__(self, root: Path) -> None:
        self._files, self._recorder = StopFiles(root), StopRecorder(root)
        self.lines: dict[asyncio.StreamWriter, str] = {}
        self._heard: dict[asyncio.StreamWriter, asyncio.Event] = {}

    async def press(self, by: str) -> dict[str, int]:
        """Stops everything; returns how many are at work, and how many of them have said that they heard it."""
        called = dict(self.lines)
        for line in called:
            self._heard[line].clear()
            line.write(STOP)
        passes = self._files.ask()
        waiting = [asyncio.create_task(self._heard[line].wait()) for line in called]
        done, late = await asyncio.wait(waiting, timeout=_HEARD_WITHIN) if waiting else (set(), set())
        for task in late:
            task.cancel()
        if late or not called:
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(_FILES_WITHIN):
                    while not self._files.done_since(passes):
                        await asyncio.sleep(0.005)
        self._recorder.note(by, ", ".join(sorted(called.values())))
        if called:
            return {"stopped": len(called), "heard": len(done)}
        return {"stopped": self._files.found, "heard": self._files.held}

    async def answer(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Talks with a caller on the local socket."""
        try:
            kind, _, name = (await reader.readline()).decode(errors="replace").strip().partition(" ")
            if kind == WORK:
                await self._keep_line(name, reader, writer)
            elif kind == PRESS:
                writer.write(json.dumps(await self.press(name)).encode())
                await writer.drain()
            elif kind == END:
                asyncio.get_running_loop().stop()
        except (OSError, ValueError):
            pass  # it is gone
        finally:
            writer.close()

    async def _keep_line(self, name: str, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.lines[writer], self._heard[writer] = name, asyncio.Event()
        try:
            while await reader.read(1) == HEARD:
                self._heard[writer].set()
        finally:
            del self.lines[writer], self._heard[writer]


async def press(stops: Stops, root: Path, by: str) -> dict[str, int]:
    """Stops everything by way of the listener, or, where it does not answer, by `stops` of this process."""
    try:
        async with asyncio.timeout(_LISTENER_WITHIN):
            with address(root) as place:
                reader, writer = await asyncio.open_unix_connection(place)
            try:
                writer.write(f"{PRESS} {by}\n".encode())
                answer: dict[str, int] = json.loads(await reader.read())
            finally:
                writer.close()
            return answer
    except (OSError, ValueError, TimeoutError):
        return await stops.press(by)
