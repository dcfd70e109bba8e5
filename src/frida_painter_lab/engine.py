"""The engine of a sweep: runs one function on many tasks in other processes, with retries.

A failure stops no other task. A task is a small plain value; large data are in files. A system alarm in the process
ends a try that takes too long; no code can block it.
"""

import multiprocessing
import os
import signal
import threading
import traceback
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, ThreadPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from multiprocessing import parent_process
from pathlib import Path
from queue import SimpleQueue
from typing import Any, Generic, TypeVar

from frida_painter.errors import FridaError, TryFailed, WorkerUnfit
from frida_painter.system import python_process

Task = TypeVar("Task")
Work = Callable[[Any], Any]
"""Function of a module, which other processes find by its name."""

_STARTING = 300.0  # seconds for a process to load, on a busy machine
_STARTS = 4
_GRACE = 20.0  # seconds after the alarm
PRELOADED = ["frida_painter_lab.sweeps.runner", "frida_painter.brush.table_kernels", "frida_painter.render.scanline"]
"""Imports of a run, including late ones. They are loaded once, and every process starts with them."""


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
class Ended(Generic[Task]):
    """Ended task with its value, or with the error of the last try."""

    task: Task
    value: Any = None
    error: Exception | None = None


def slots_here(limits: TaskLimits, most: int | None = None) -> int:
    """Returns the number of tasks for which this machine has cores and memory, at least one.

    most: upper limit; None for no limit
    """
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // 2**20
    return max(1, min(cores // limits.threads, memory // limits.memory, most or cores))


def within_limits(work: Work, task: Any, limits: TaskLimits) -> Any:
    """Runs one try in its own process, with limited threads; the system kills it if it takes too long.

    Raises TryFailed for errors of other packages, because only their text can be sent to another process.
    """
    import torch

    torch.set_num_threads(limits.threads)
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.setitimer(signal.ITIMER_REAL, limits.seconds)
    try:
        return work(task)
    except FridaError:
        raise
    except Exception as error:
        last = traceback.extract_tb(error.__traceback__)[-1]
        place = f"{Path(last.filename).name}, line {last.lineno}"
        raise TryFailed(f"{type(error).__name__}: {error} ({place})"[:500]) from None
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)


class Engine:
    """Engine of processes on this machine, one for each slot. They serve many tasks and end with their parent.

    slots: number of tasks at the same time
    """

    def __init__(self, limits: TaskLimits, slots: int) -> None:
        self._limits, self._stopping = limits, threading.Event()
        context = multiprocessing.get_context("forkserver")
        context.set_forkserver_preload(PRELOADED)
        self._workers = [_Worker(context) for _ in range(slots)]

    def run(self, work: Work, tasks: Iterable[Task]) -> Generator[Ended[Task], None, None]:
        """Runs `work` on every task, and yields each when it ends. Closing the iterator stops the running tasks.

        A WorkerUnfit error ends its task without further tries, because they would fail too.
        """
        self._stopping.clear()
        rest, waiting, slots = iter(tasks), set[Future[Ended[Task]]](), len(self._workers)
        free: SimpleQueue[_Worker] = SimpleQueue()
        for worker in self._workers:
            free.put(worker)
        with ThreadPoolExecutor(slots) as threads:
            try:
                while True:
                    for task in islice(rest, 2 * slots - len(waiting)):
                        waiting.add(threads.submit(self._try_task, free, work, task))
                    if not waiting:
                        return
                    done, waiting = wait(waiting, return_when=FIRST_COMPLETED)
                    for future in done:
                        yield future.result()
            finally:
                self._stopping.set()
                waiting = {future for future in waiting if not future.cancel()}
                while waiting:  # a process that is just starting is killed in the next round
                    for worker in self._workers:
                        worker.kill()
                    waiting = wait(waiting, timeout=0.2).not_done
                for worker in self._workers:
                    worker.kill()

    def _try_task(self, free: "SimpleQueue[_Worker]", work: Work, task: Task) -> Ended[Task]:
        worker = free.get()
        try:
            error: Exception = TryFailed("It was not tried.")
            for _ in range(self._limits.tries):
                if self._stopping.is_set():
                    break
                try:
                    return Ended(task, worker.call(work, task, self._limits))
                except WorkerUnfit as failure:
                    return Ended(task, error=failure)
                except (FridaError, OSError) as failure:
                    error = failure
            return Ended(task, error=error)
        finally:
            free.put(worker)


class _Worker:
    """Worker process, started when needed, and again after its death."""

    def __init__(self, context: Any) -> None:
        self._context = context
        self._pool: ProcessPoolExecutor | None = None
        self._pid = 0

    def call(self, work: Work, task: Any, limits: TaskLimits) -> Any:
        """Returns the value of one try. Raises TryFailed if the process died or hung, and the errors of the try."""
        pool = self._pool or self._start()
        try:
            return pool.submit(within_limits, work, task, limits).result(limits.seconds + _GRACE)
        except FridaError:
            raise
        except (BrokenProcessPool, TimeoutError) as failure:
            self.kill()
            raise TryFailed(
                "Its process was killed: by the system for want of memory, by a person, or because the try lasted "
                f"longer than {limits.seconds:g} s (time_limit)."
            ) from failure

    def _start(self) -> ProcessPoolExecutor:
        failure: Exception | None = None
        for _ in range(_STARTS):  # a process that is killed while it loads is started again
            with python_process.isolate_children():
                pool = ProcessPoolExecutor(1, mp_context=self._context, initializer=_end_with_parent)
            try:
                with python_process.isolate_children():
                    starting = pool.submit(os.getpid)
                self._pid, self._pool = starting.result(_STARTING), pool
                return pool
            except (BrokenProcessPool, TimeoutError, EOFError, OSError) as error:  # the fork server may die as well
                failure = error
                pool.shutdown(wait=False, cancel_futures=True)
        raise WorkerUnfit(
            "No process for the runs could be started; in a script of your own, call it below "
            '`if __name__ == "__main__":`, and see what was said above.'
        ) from failure

    def kill(self) -> None:
        """Kills the process at once."""
        if self._pool is not None:
            with suppress(ProcessLookupError):
                os.kill(self._pid, signal.SIGKILL)
            self._pool.shutdown(wait=False, cancel_futures=True)
            self._pool = None


def _end_with_parent() -> None:
    """Ignores Ctrl-C, which is for the parent process, and ends this process when the parent dies."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def follow() -> None:
        if (parent := parent_process()) is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=follow, daemon=True).start()
