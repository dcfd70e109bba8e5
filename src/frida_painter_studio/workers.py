"""Worker processes of the studio, which plan and paint, and its queue; the processes outlive the page's process."""

import contextlib
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from frida_painter.errors import ConfigError, FridaError, Interrupted, ProcessLost, StorageError
from frida_painter.session.events import Began, Stopped
from frida_painter.system import operating_system, python_process, storage
from frida_painter_studio.store import Entry, PaintingStore
from frida_painter_studio.studio_folder import (
    PAINT_JOB,
    RESUME_JOB,
    PaintingFolder,
    PlanFolder,
    QueuedJob,
    WorkerLock,
    tell_once,
    working,
)
from frida_painter_studio.web_app_easel import WebAppEasel

_MAX = 2


_Started = tuple["subprocess.Popen[bytes]", PaintingFolder]


class Workers:
    """Worker processes that this studio started."""

    def __init__(self, easel: WebAppEasel) -> None:
        self.easel = easel
        self._started: list[_Started] = []

    @property
    def busy(self) -> bool:
        """True if the largest number of workers is at work; workers that are only ending do not count."""
        self._started = [(process, folder) for process, folder in self._started if process.poll() is None]
        at_work = {folder for _, folder in self._started if working(folder)}
        return len(at_work) >= _MAX

    @contextmanager
    def slot_at(self, folder: PaintingFolder) -> Iterator["WorkerSlot"]:
        """Yields the worker slot of a painting, and holds its lock while the work is prepared.

        Raises Interrupted if a worker is at this painting already, or if too many are at work.
        """
        busy = self.busy
        lock = WorkerLock(folder)
        try:
            if not lock.take():
                raise Interrupted("The painter is at work on this painting already.")
            if busy:
                raise Interrupted("The painter is busy with other paintings; wait until one is done, or stop it.")
            yield WorkerSlot(folder, lock, self._started, self.easel)
        finally:
            lock.release()


class WorkerSlot:
    """Right to start one worker for a painting."""

    def __init__(self, folder: PaintingFolder, lock: WorkerLock, started: list[_Started], easel: WebAppEasel) -> None:
        self.folder, self._lock, self._started, self._easel = folder, lock, started, easel

    def start(self, job: str, plan: PlanFolder) -> None:
        """Starts a worker in a new session, and hands it the painting's lock. Raises StorageError.

        It may outlive this process. A painting is started by the words that a person types at a terminal.
        """
        task = {"what": job, "path": self.folder.path, "number": plan.number, "lock": self._lock, "easel": self._easel}
        self._lock.sign(job)
        try:
            with (self.folder.path / "worker.log").open("ab") as log:
                how: dict[str, Any] = {**operating_system.APART, "stdout": log, "stderr": log}
                if job in (PAINT_JOB, RESUME_JOB):
                    words = self._words_to_paint(plan) if job == PAINT_JOB else (job, self.folder.painting)
                    led = ("--pace", self._easel.pace, "--page", self.folder.path)
                    process = python_process.start("-m", "frida_painter", *words, *led, files=[self._lock], **how)
                else:
                    process, wire = python_process.start_function(
                        "frida_painter_studio.worker_process:do_job", task, **how
                    )
                    wire.close()
        except (OSError, ProcessLost) as error:
            raise StorageError(f"The painter cannot be started ({error}).") from error
        self._lock.hand(process)
        self._started.append((process, self.folder))

    def _words_to_paint(self, plan: PlanFolder) -> tuple[object, ...]:
        """Returns the words that paint a plan. Raises ConfigError and StorageError."""
        spec = plan.request().spec(self._easel, plan.path, self.folder.families)
        exact = {"canvas": f"{spec.canvas.width!r}x{spec.canvas.height!r}m"}  # so that it is fitted as for the plan
        storage.write_json(plan.settings, spec.model_dump(mode="json", exclude_unset=True) | exact)
        return PAINT_JOB, "--settings", plan.settings, "--plan", plan.plan, "--out", self.folder.painting


# Queue of a studio: plans to be made and paintings to be painted, one after another.
#
# A stop holds the queue until a person lets it go on. With a real robot, no painting starts by itself, because
# somebody must put up a bare canvas; the queue only shows whose turn it is.

QUEUE = "queue"
"""Name of the queue's folder in the studio's folder."""
_PAINTING_QUEUE_MAX = 40
_BETWEEN = 1.0  # seconds


@dataclass(frozen=True)
class QueueEntry:
    """Plan that waits to be made, or to be painted.

    painting: id of the painting.
    """

    painting: str
    plan: int
    job: QueuedJob


class PaintingQueue:
    """Ordered queue of jobs, kept in a file.

    While jobs wait, the queue counts as a worker at work in its own folder. A stop of all work therefore stops the
    queue too.
    """

    def __init__(self, store: PaintingStore, workers: Workers) -> None:
        self._store, self._workers = store, workers
        self._folder = PaintingFolder(store.root / QUEUE)
        self._file = self._folder.path / "queue.json"
        self._turn = threading.RLock()
        self._lock: WorkerLock | None = None
        self._entries: list[QueueEntry] = []
        with contextlib.suppress(StorageError, ValidationError):  # a damaged queue is replaced by an empty one
            if self._file.exists():
                kept = storage.read_json(self._file, "the studio's queue")
                self._entries = TypeAdapter(list[QueueEntry]).validate_python(kept["entries"])
        self._jobs = self._find_jobs(self._entries)
        self._watch()

    def find_job(self, folder: PaintingFolder) -> QueuedJob | None:
        """Returns the job for which a painting waits; None if it does not wait."""
        return self._jobs.get(folder.path)

    @property
    def held(self) -> bool:
        """True if somebody has stopped all work since the queue last went on."""
        return self._folder.stop.exists()

    def to_plain(self) -> dict[str, Any]:
        """Returns the queue as plain values for the page."""
        with self._turn:
            return {"held": self.held and bool(self._entries), "queue": [asdict(entry) for entry in self._entries]}

    def must_wait(self) -> bool:
        """Returns True if a new job must wait for others."""
        with self._turn:
            return bool(self._entries) or self._workers.busy

    def add(self, entry: Entry, make: Callable[[], PlanFolder], job: QueuedJob) -> None:
        """Adds the plan that `make` makes. Raises Interrupted if its painting waits already, or the queue is full."""
        with self._turn:
            if any(waiting.painting == entry.id for waiting in self._entries):
                raise Interrupted("This painting waits in the queue already.")
            if len(self._entries) >= _PAINTING_QUEUE_MAX:
                raise Interrupted(f"There are {_PAINTING_QUEUE_MAX} in the queue already; remove one of them first.")
            if not self._entries:
                self._folder.stop.unlink(missing_ok=True)  # an empty queue was not stopped
            self._keep([*self._entries, QueueEntry(entry.id, make().number, job)])

    def remove(self, identifier: str) -> bool:
        """Removes a painting, also if it was started by hand; returns True if it was in the queue."""
        with self._turn:
            gone = [waiting for waiting in self._entries if waiting.painting == identifier]
            if not gone:
                return False
            entry = self._store.find(identifier)
            if gone[0].job == "plan" and entry is not None and entry.folder.path.is_dir():
                tell_once(entry.folder, Stopped())
            self._keep([waiting for waiting in self._entries if waiting.painting != identifier])
            return True

    def first(self, identifier: str) -> None:
        """Puts a painting at the front."""
        with self._turn:
            self._keep(sorted(self._entries, key=lambda waiting: waiting.painting != identifier))

    def go_on(self) -> None:
        """Lets the queue go on after a stop."""
        self._folder.stop.unlink(missing_ok=True)

    def run(self) -> None:
        """Starts jobs in a loop; for its own thread."""
        while True:
            with contextlib.suppress(FridaError, OSError):
                self.advance()
            time.sleep(_BETWEEN)

    def advance(self) -> None:
        """Starts the jobs that can begin now, in order."""
        with self._turn:
            for waiting in tuple(self._entries):
                if self.held or self._workers.busy:
                    return
                if waiting.job == "plan" or self._workers.easel.simulated:
                    self._begin(waiting)

    def _begin(self, waiting: QueueEntry) -> None:
        entry = self._store.find(waiting.painting)
        if entry is None:
            self._keep([other for other in self._entries if other != waiting])
            return
        if working(entry.folder):
            return  # another plan of this painting is being made
        with self._workers.slot_at(entry.folder) as slot:
            self._keep([other for other in self._entries if other != waiting])
            entry.folder.stop.unlink(missing_ok=True)
            plan = entry.folder.plan(waiting.plan)
            if waiting.job == "paint":
                self._store.note("queue", entry.id, f"start plan {waiting.plan}")
                start_painting(slot, plan)
            else:
                slot.start("plan", plan)

    def _keep(self, entries: list[QueueEntry]) -> None:
        """Saves the queue. Raises StorageError, and then leaves the queue as it was."""
        jobs = self._find_jobs(entries)
        self._folder.path.mkdir(exist_ok=True)
        storage.write_json(self._file, {"entries": [asdict(entry) for entry in entries]})
        self._entries, self._jobs = entries, jobs
        self._watch()

    def _find_jobs(self, entries: list[QueueEntry]) -> dict[Path, QueuedJob]:
        """Returns the jobs of entries by the folders of their paintings."""
        found = ((self._store.find(each.painting), each.job) for each in entries)
        return {entry.folder.path: job for entry, job in found if entry is not None}

    def _watch(self) -> None:
        """Holds the lock of a worker at work while jobs wait."""
        if self._entries and self._lock is None:
            lock = WorkerLock(self._folder)
            if lock.take():
                self._lock = lock
            else:  # another studio on the same folder holds it
                lock.release()
        elif not self._entries and self._lock is not None:
            self._lock.release()
            self._lock = None


def start_painting(slot: WorkerSlot, plan: PlanFolder) -> None:
    """Starts to paint a plan; what rules it out is told on the page. Raises StorageError."""
    tell_once(slot.folder, Began(PAINT_JOB, plan=plan.number))
    try:
        slot.start(PAINT_JOB, plan)
    except ConfigError as fault:
        tell_once(slot.folder, Stopped(str(fault)))
