"""The engine of a sweep: does tasks in other processes, with retries. A failure stops no other task.

A task is some runs of a folder, whose requests are in its files: only their keys travel to another process.
"""

import os
import queue
import subprocess
import threading
import traceback
from collections.abc import Callable, Generator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from frida_painter.errors import FridaError, ProcessLost, TryFailed, WorkerUnfit
from frida_painter.system import operating_system, python_process
from frida_painter.system.messages import Wire, decode_error, encode_error
from frida_painter.system.python_process import in_own_process
from frida_painter_lab.runs import Run

_STARTING = 300.0  # seconds for a process to load, on a busy machine
_DO_TASKS = "frida_painter_lab.engine:do_tasks"


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
def do_tasks(wire: Wire, work: str, threads: int) -> None:
    """Does tasks as they are asked for over the link, and ends with it. work: as MODULE:FUNCTION"""
    import torch

    name, _, function = work.partition(":")
    module = import_module(name)
    torch.set_num_threads(threads)
    asked = queue.SimpleQueue[dict[str, Any]]()

    def listen() -> None:
        with suppress(ProcessLost):
            while True:
                asked.put(wire.receive()[0])
        os._exit(1)  # whoever asked is gone, and nothing that goes on here is wanted

    threading.Thread(target=listen, daemon=True).start()
    wire.send({"ready": True})
    while True:
        told = asked.get()
        try:
            getattr(module, function)(module.reopen(told["keep"], told["keys"]))
            wire.send({})
        except FridaError as error:
            wire.send(encode_error(error))
        except Exception as error:
            last = traceback.extract_tb(error.__traceback__)[-1]
            place = f"{Path(last.filename).name}, line {last.lineno}"
            wire.send(encode_error(TryFailed(f"{type(error).__name__}: {error} ({place})"[:500])))


class Engine:
    """Engine of processes on this machine, one for each slot. They serve many tasks and end with their parent.

    slots: number of tasks at the same time
    """

    def __init__(self, limits: TaskLimits, slots: int) -> None:
        self._limits, self._slots = limits, slots

    def run(self, work: Work, tasks: Sequence[Share]) -> Generator[Ended, None, None]:
        """Does `work` for every task, and yields each when it ends. Closing the iterator stops the running tasks.

        A WorkerUnfit error ends its task without further tries, because they would fail too.
        """
        rest, done = queue.SimpleQueue[Share](), queue.SimpleQueue[Ended]()
        for task in tasks:
            rest.put(task)
        workers = [_Worker(f"{work.__module__}:{work.__qualname__}", self._limits) for _ in range(self._slots)]

        def serve(worker: _Worker) -> None:
            with suppress(queue.Empty):
                while not worker.is_over:
                    task = rest.get_nowait()
                    try:
                        error = worker.find_error(task)
                    except Exception as unexpected:  # without an end, its task would be awaited for ever
                        worker.bury()  # half an answer may wait in its link
                        error = unexpected
                    done.put(Ended(task, error))

        threads = [threading.Thread(target=serve, args=(worker,), daemon=True) for worker in workers]
        for thread in threads:
            thread.start()
        try:
            for _ in tasks:
                yield done.get()
        finally:
            for worker in workers:
                worker.end()
            for worker, thread in zip(workers, threads, strict=True):
                thread.join()
                worker.bury()


class _Worker:
    """Process for one slot, started when needed, and again after its death."""

    def __init__(self, work: str, limits: TaskLimits) -> None:
        self._work, self._limits = work, limits
        self._turn = threading.Lock()
        self._started: tuple[subprocess.Popen[bytes], Wire] | None = None
        self.is_over = self._is_ready = False

    def find_error(self, task: Share) -> Exception | None:
        """Does a task; returns the error of its last try, None if one succeeded."""
        error: Exception = TryFailed("It was not tried.")
        for _ in range(self._limits.tries):
            if self.is_over:
                break
            wire = None
            try:
                wire = self._open()
                wire.send({"keep": task.keep, "keys": task.keys})
                words, _ = wire.receive(self._limits.seconds)
            except ProcessLost as lost:
                self.bury()
                error = WorkerUnfit(f"No process for the runs could be started ({lost}); see what was said above.")
                if wire is not None:
                    error = TryFailed(
                        "Its process was killed: by the system for want of memory, by a person, or because the try "
                        f"lasted longer than {self._limits.seconds:g} s (time_limit)."
                    )
                continue
            if "error" not in words:
                return None
            error = decode_error(words, TryFailed)
            if isinstance(error, WorkerUnfit):
                break
        return error

    def _open(self) -> Wire:
        """Returns the link to the process, which is started if there is none. Raises ProcessLost."""
        with self._turn:
            if self._started is None and not self.is_over:
                given = {"work": self._work, "threads": self._limits.threads}
                self._started = python_process.start_function(_DO_TASKS, given, **operating_system.APART)
                self._is_ready = False
            if self._started is None:
                raise ProcessLost("its work is over")
            wire = self._started[1]
        if not self._is_ready:
            wire.receive(_STARTING)
            self._is_ready = True
        return wire

    def end(self) -> None:
        """Kills the process at once, and lets no other be started; the thread that waits for it hears of it."""
        self.is_over = True
        self._kill()

    def bury(self) -> None:
        """Kills the process, and waits for its end."""
        self._kill()
        if self._started is not None:
            process, wire = self._started
            self._started = None
            wire.close()
            process.wait()

    def _kill(self) -> None:
        with self._turn:
            if self._started is not None:
                operating_system.end_group(self._started[0])
