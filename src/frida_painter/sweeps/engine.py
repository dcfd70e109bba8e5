"""The engine of a sweep: does one function with many tasks in other processes, tries again, and never stops for one.

Two engines have one interface: processes of this machine (here), and a Ray cluster (`ray_engine.py`). A task is a
small plain value; whatever is large lies in files. A try that lasts too long ends by an alarm of the system's in its
own process, which no code can miss.
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
from typing import Any, Generic, Protocol, TypeVar

from frida_painter.errors import FridaError, TryFailed, WorkerUnfit

Task = TypeVar("Task")
Work = Callable[[Any], Any]
"""A function of a module, by whose name other processes find it."""

_STARTING = 300.0  # seconds until a process has loaded, on a machine that is busy
_STARTS = 4
_GRACE = 20.0  # seconds after the alarm
PRELOADED = [
    "frida_painter.sweeps.worker",
    "frida_painter.brush.table_kernels",
    "frida_painter.render.moment_scanline",
    "frida_painter.render.scanline",
    "sklearn.cluster",
]
"""What a run imports, also where it is used first: loaded once, and every process begins with it."""
_MB = 2**20


@dataclass(frozen=True)
class TaskLimits:
    """What each task is given: seconds for a try, cores, MB of memory, and tries in all."""

    seconds: float = 3600.0
    threads: int = 1
    memory: int = 1000
    tries: int = 3


@dataclass(frozen=True)
class Ended(Generic[Task]):
    """A task that has ended: its value, or the error of the last try."""

    task: Task
    value: Any = None
    error: Exception | None = None


class Engine(Protocol):
    """Does tasks somewhere."""

    @property
    def slots(self) -> int:
        """How many tasks are done at the same time."""
        ...

    def run(self, work: Work, tasks: Iterable[Task]) -> Generator[Ended[Task], None, None]:
        """Does the work with every task, and tells of each when it ends; closing the iterator stops what is going on.

        A WorkerUnfit ends its task at once, for no other try would do better.
        """
        ...


def slots_here(limits: TaskLimits, most: int | None = None) -> int:
    """How many tasks this machine has cores and memory for, at least one. most: not more than so many."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // _MB
    return max(1, min(cores // limits.threads, memory // limits.memory, most or cores))


def within_limits(work: Work, task: Any, limits: TaskLimits) -> Any:
    """One try, in the process that does it: with so many threads, and killed by the system where it lasts too long.

    Raises TryFailed for errors of other packages, of which only the text can be sent to another process.
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


class LocalEngine:
    """Processes of this machine, one for each slot, which stay for many tasks and end with the one that started them.

    slots: how many tasks at the same time.
    """

    def __init__(self, limits: TaskLimits, slots: int) -> None:
        self._limits, self.slots = limits, slots
        self._context = multiprocessing.get_context("forkserver")
        self._context.set_forkserver_preload(PRELOADED)
        self._stopping = threading.Event()
        self._workers = [_Worker(self._context) for _ in range(slots)]

    def run(self, work: Work, tasks: Iterable[Task]) -> Generator[Ended[Task], None, None]:
        """Does the work with every task, and tells of each when it ends."""
        self._stopping.clear()
        rest, waiting = iter(tasks), set[Future[Ended[Task]]]()
        free: SimpleQueue[_Worker] = SimpleQueue()
        for worker in self._workers:
            free.put(worker)
        with ThreadPoolExecutor(self.slots) as threads:
            try:
                while True:
                    for task in islice(rest, 2 * self.slots - len(waiting)):
                        waiting.add(threads.submit(self._tried, free, work, task))
                    if not waiting:
                        return
                    done, waiting = wait(waiting, return_when=FIRST_COMPLETED)
                    for future in done:
                        yield future.result()
            finally:
                self._stopping.set()
                waiting = {future for future in waiting if not future.cancel()}
                while waiting:  # a process that was just being started is there in the next round
                    for worker in self._workers:
                        worker.kill()
                    waiting = wait(waiting, timeout=0.2).not_done
                for worker in self._workers:
                    worker.kill()

    def _tried(self, free: "SimpleQueue[_Worker]", work: Work, task: Task) -> Ended[Task]:
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
    """One process, started when it is needed, and again when it has died."""

    def __init__(self, context: Any) -> None:
        self._context = context
        self._pool: ProcessPoolExecutor | None = None
        self._pid = 0

    def call(self, work: Work, task: Any, limits: TaskLimits) -> Any:
        """The value of one try. Raises TryFailed where the process died or hung, and what the try raises."""
        pool = self._opened()
        try:
            future = pool.submit(within_limits, work, task, limits)
            error = future.exception(limits.seconds + _GRACE)
        except (BrokenProcessPool, TimeoutError) as failure:
            error = failure
        if error is None:
            return future.result()
        if isinstance(error, FridaError):
            raise error
        self.kill()
        self._pool = None
        raise TryFailed(
            "Its process was killed: by the system for want of memory, by a person, or because the try lasted longer "
            f"than {limits.seconds:g} s (time_limit)."
        ) from error

    def _opened(self) -> ProcessPoolExecutor:
        failure: Exception | None = None
        for _ in range(_STARTS):  # one that is killed while it loads is started again
            if self._pool is not None:
                return self._pool
            pool = ProcessPoolExecutor(1, mp_context=self._context, initializer=_end_with_parent)
            try:
                self._pid = pool.submit(os.getpid).result(_STARTING)
                self._pool = pool
            except (BrokenProcessPool, TimeoutError, EOFError, OSError) as error:  # the server of forks may die as well
                failure = error
                pool.shutdown(wait=False, cancel_futures=True)
        if self._pool is not None:
            return self._pool
        raise WorkerUnfit(
            "No process for the runs could be started; in a script of your own, call it below "
            '`if __name__ == "__main__":`, and see what was said above.'
        ) from failure

    def kill(self) -> None:
        """Ends the process at once."""
        if self._pool is not None and self._pid:
            with suppress(ProcessLookupError):
                os.kill(self._pid, signal.SIGKILL)
            self._pool.shutdown(wait=False, cancel_futures=True)
            self._pool, self._pid = None, 0


def _end_with_parent() -> None:
    """Ctrl-C is for the process that started this one, and where that dies, nothing goes on here."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = parent_process()

    def follow() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=follow, daemon=True).start()
