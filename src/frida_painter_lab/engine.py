"""The engine of a sweep: does tasks in other processes, with retries. A failure stops no other task.

A task is some runs of a folder, whose requests are in its files: only their keys travel to another process.
"""

import math
import os
import queue
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any

from frida_painter.errors import FridaError, ProcessLost, TryFailed, WorkerUnfit
from frida_painter.system import operating_system
from frida_painter.system.python_process import in_own_process
from frida_painter_lab.runs import Run

_STARTING = 300.0  # seconds for a process to load, on a busy machine
_MANY = 100  # tasks of a process at most


@dataclass(frozen=True)
class Share:
    """Runs that one process does, one after another.

    keep: path of their folder
    experiment: that measures them; None for runs of a sweep
    """

    runs: tuple[Run, ...]
    keep: str
    experiment: Any = None

    @property
    def keys(self) -> list[str]:
        """Keys of the runs."""
        return [run.key for run in self.runs]


Work = Callable[[Share], Any]
"""Function of a module that does a share. Its module has a function `reopen`, which finds one by `keep` and `keys`."""


@dataclass(frozen=True)
class TaskLimits:
    """Limits of each task.

    seconds: of a try
    threads: cores
    memory: MB
    tries: in total
    """

    seconds: float = 3600.0
    threads: int = 1
    memory: int = 1000
    tries: int = 3


@dataclass(frozen=True)
class Ended:
    """Ended share, with the error of the last try if all have failed, or the unexpected one that ended it."""

    task: Share
    error: Exception | None = None


def slots_here(limits: TaskLimits, most: int | None = None) -> int:
    """Returns the number of tasks for which this machine has cores and memory, at least one.

    most: upper limit; None for no limit
    """
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    memory = operating_system.memory_here() // 2**20
    return max(1, min(cores // limits.threads, memory // limits.memory, most or cores))


@in_own_process()
def do_tasks(work: str, threads: int, tasks: tuple[tuple[str, ...], ...], tell: Callable[[int], None]) -> None:
    """Does tasks, one after another. Raises the error of one that fails: TryFailed if it is no FridaError.

    work: as MODULE:FUNCTION
    tasks: folder of each, and the keys of its runs
    tell: receives the number of tasks that are done, first 0 when all is loaded
    """
    import torch

    name, _, function = work.partition(":")
    module = import_module(name)
    torch.set_num_threads(threads)
    tell(0)
    for number, (keep, *keys) in enumerate(tasks, 1):
        try:
            getattr(module, function)(module.reopen(keep, keys))
        except ProcessLost as lost:  # of an easel: this process is not lost
            raise TryFailed(str(lost)) from lost
        except FridaError:
            raise
        except Exception as error:
            last = traceback.extract_tb(error.__traceback__)[-1]
            place = f"{Path(last.filename).name}, line {last.lineno}"
            raise TryFailed(f"{type(error).__name__}: {error} ({place})"[:500]) from error
        tell(number)


@dataclass(frozen=True)
class Engine:
    """Engine of processes on this machine, one for each slot. Each does many tasks, and ends with its parent.

    slots: number of tasks at the same time
    """

    limits: TaskLimits
    slots: int

    def run(self, work: Work, tasks: Sequence[Share]) -> Generator[Ended, None, None]:
        """Does `work` for every task, and yields each when it ends. Closing the iterator stops the running tasks.

        A WorkerUnfit error ends its task without further tries, because they would fail too.
        """
        rest, done, over = deque(tasks), queue.SimpleQueue[Ended](), threading.Event()
        taking, name = threading.Lock(), f"{work.__module__}:{work.__qualname__}"

        def serve() -> None:
            while True:
                with taking:  # fewer at the end, so that no process has nothing to do
                    count = min(_MANY, math.ceil(len(rest) / self.slots / 2))
                    mine = deque(rest.popleft() for _ in range(count))
                if not mine or over.is_set():
                    return
                self._do(name, mine, done, over)

        threads = [threading.Thread(target=serve, daemon=True) for _ in range(self.slots)]
        for thread in threads:
            thread.start()
        try:
            for _ in tasks:
                yield done.get()
        finally:
            over.set()
            for thread in threads:
                thread.join()

    def _do(self, work: str, mine: deque[Share], done: queue.SimpleQueue[Ended], over: threading.Event) -> None:
        """Does tasks in a process, and in another one after a failure; puts each into `done`."""
        tried, until = 0, math.inf

        def hear(count: int) -> None:
            nonlocal tried, until
            until = time.monotonic() + self.limits.seconds
            if count:
                tried = 0
                done.put(Ended(mine.popleft()))

        def heed() -> None:
            if over.is_set() or not time.monotonic() < until:
                raise ProcessLost("It did not answer in time.")

        while mine and not over.is_set():
            error: Exception | None = None
            until = began = time.monotonic() + _STARTING
            try:
                keys = tuple((task.keep, *task.keys) for task in mine)
                replace(do_tasks, heed=heed)(work, self.limits.threads, keys, hear)
            except ProcessLost as lost:
                error = TryFailed(
                    "Its process was killed: by the system for want of memory, by a person, or because the try "
                    f"lasted longer than {self.limits.seconds:g} s (time_limit)."
                )
                if until == began:
                    error = WorkerUnfit(f"No process for the runs could be started ({str(lost).rstrip('.')}).")
            except Exception as unexpected:  # without an end, its task would be awaited for ever
                error = unexpected
            tried += 1
            is_last = tried >= self.limits.tries or not isinstance(error, FridaError)
            if mine and error is not None and (is_last or (until != began and isinstance(error, WorkerUnfit))):
                done.put(Ended(mine.popleft(), error))
                tried = 0
