"""The engine of a sweep: does tasks in other processes, with retries. A failure stops no other task.

A task is some runs of a folder, whose requests are in its files: only their keys travel to another process.
"""

import json
import math
import os
import queue
import socket
import threading
import time
import traceback
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any

from frida_painter.errors import FridaError, ProcessLost, TryFailed, WorkerUnfit
from frida_painter.system import operating_system
from frida_painter.system.python_process import in_own_process
from frida_painter_lab.runs import Run

_STARTING = 300.0  # seconds for a process to load, on a busy machine


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
def do_tasks(work: str, threads: int, asked: socket.socket, tell: Callable[[bool], None]) -> None:
    """Does tasks until no more are asked for. Raises the error of one that fails: TryFailed if it is no FridaError.

    work: as MODULE:FUNCTION
    asked: a line of JSON for each task: its folder, and the keys of its runs
    tell: receives True after each task, and False when all is loaded
    """
    import torch

    name, _, function = work.partition(":")
    module = import_module(name)
    torch.set_num_threads(threads)
    tell(False)
    for keep, *keys in map(json.loads, asked.makefile(encoding="utf-8")):
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
        tell(True)


@dataclass(frozen=True)
class Engine:
    """Engine of processes on this machine, one for each slot. They serve many tasks and end with their parent.

    slots: number of tasks at the same time
    """

    limits: TaskLimits
    slots: int

    def run(self, work: Work, tasks: Sequence[Share]) -> Generator[Ended, None, None]:
        """Does `work` for every task, and yields each when it ends. Closing the iterator stops the running tasks.

        A WorkerUnfit error ends its task without further tries, because they would fail too.
        """
        rest, done, over = iter([*tasks]), queue.SimpleQueue[Ended](), threading.Event()
        given = f"{work.__module__}:{work.__qualname__}", rest, done, over
        threads = [threading.Thread(target=self._serve, args=given, daemon=True) for _ in range(self.slots)]
        for thread in threads:
            thread.start()
        try:
            for _ in tasks:
                yield done.get()
        finally:
            over.set()
            for thread in threads:
                thread.join()

    def _serve(self, work: str, rest: Iterator[Share], done: queue.SimpleQueue[Ended], over: threading.Event) -> None:
        """Does tasks of the rest in a process, and in another one after a failure; puts each into `done`."""
        task, tried, until = next(rest, None), 0, math.inf

        def hear(is_done: bool) -> None:
            nonlocal task, tried, until
            until = time.monotonic() + self.limits.seconds
            if is_done and task is not None:
                done.put(Ended(task))
                task, tried = next(rest, None), 0
            with suppress(OSError):  # its death is told otherwise
                if task is None:
                    near.shutdown(socket.SHUT_RDWR)
                else:
                    near.sendall(json.dumps([task.keep, *task.keys]).encode() + b"\n")

        def heed() -> None:
            if over.is_set() or not time.monotonic() < until:
                raise ProcessLost("It did not answer in time.")

        while task is not None and not over.is_set():
            error: Exception | None = None
            until = began = time.monotonic() + _STARTING
            near, far = operating_system.socket_pair()
            try:
                with near, far:
                    replace(do_tasks, heed=heed)(work, self.limits.threads, far, hear)
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
            if task is not None and error and (is_last or (until != began and isinstance(error, WorkerUnfit))):
                done.put(Ended(task, error))
                task, tried = next(rest, None), 0
