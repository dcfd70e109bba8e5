"""Starting the processes that plan and paint; they outlive the page's own process."""

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Literal

from frida_painter.errors import Interrupted, StorageError
from frida_painter.web.folder import PaintingFolder, PlanFolder, WorkerLock, working
from frida_painter.web.studio_easel import StudioEasel

_MOST = 2


@dataclass(frozen=True)
class _Started:
    process: "subprocess.Popen[bytes]"
    folder: PaintingFolder


class Workers:
    """Those that were started here and are still at work."""

    def __init__(self, easel: StudioEasel) -> None:
        self.easel = easel
        self._started: list[_Started] = []

    @property
    def busy(self) -> bool:
        """Whether as many are at work as may be; one that has done its work, and takes its time to end, is not."""
        self._started = [one for one in self._started if one.process.poll() is None]
        at_work = {one.folder for one in self._started if working(one.folder)}
        return len(at_work) >= _MOST

    @contextmanager
    def slot_at(self, folder: PaintingFolder) -> Iterator["WorkerSlot"]:
        """The one worker slot of a painting, held while the work is prepared.

        Raises Interrupted where somebody is at this painting already, or too many are at work.
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
    """A painting that no worker works on: one worker may be started for it."""

    def __init__(self, folder: PaintingFolder, lock: WorkerLock, started: list[_Started], easel: StudioEasel) -> None:
        self.folder, self._lock, self._started, self._easel = folder, lock, started, easel

    def start(self, job: Literal["plan", "paint", "resume", "calibrate"], plan: PlanFolder) -> None:
        """Starts a worker in a session of its own, and hands it the lock on the painting. Raises StorageError."""
        program = [sys.executable, "-m", "frida_painter.web.worker", job, str(self.folder.path), str(plan.number)]
        program += [str(self._lock.fileno()), json.dumps(self._easel.plain())]
        try:
            with (self.folder.path / "worker.log").open("ab") as log:
                process = subprocess.Popen(
                    program, stdin=subprocess.DEVNULL, stdout=log, stderr=log, start_new_session=True,
                    pass_fds=[self._lock.fileno()],
                )  # fmt: skip
        except OSError as error:
            raise StorageError(f"The painter cannot be started ({error.strerror}).") from error
        self._started.append(_Started(process, self.folder))
