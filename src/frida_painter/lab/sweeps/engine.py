"""The engine of a sweep: runs one function on many tasks in other processes, with retries.

A failure stops no other task. Two engines have the same interface: processes of this machine, and a Ray cluster. A
task is a small plain value; large data are in files. A system alarm in the process ends a try that takes too long;
no code can block it.
"""

import logging
import multiprocessing
import os
import signal
import socket
import threading
import traceback
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, ThreadPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import islice
from multiprocessing import parent_process
from pathlib import Path
from queue import SimpleQueue
from typing import Any, Generic, Protocol, TypeVar

from frida_painter import python_process, registry
from frida_painter.errors import ConfigError, FridaError, TryFailed, WorkerUnfit

Task = TypeVar("Task")
Work = Callable[[Any], Any]
"""Function of a module, which other processes find by its name."""

_STARTING = 300.0  # seconds for a process to load, on a busy machine
_STARTS = 4
_GRACE = 20.0  # seconds after the alarm
PRELOADED = [
    "frida_painter.lab.sweeps.runner",
    "frida_painter.brush.table_kernels",
    "frida_painter.render.scanline",
]
"""Imports of a run, including late ones. They are loaded once, and every process starts with them."""
_MB = 2**20


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


class Engine(Protocol):
    """Engine that runs tasks."""

    @property
    def slots(self) -> int:
        """Number of tasks at the same time."""
        ...

    def run(self, work: Work, tasks: Iterable[Task]) -> Generator[Ended[Task], None, None]:
        """Runs `work` on every task, and yields each when it ends. Closing the iterator stops the running tasks.

        A WorkerUnfit error ends its task without further tries, because they would fail too.
        """
        ...


def slots_here(limits: TaskLimits, most: int | None = None) -> int:
    """Returns the number of tasks for which this machine has cores and memory, at least one.

    most: upper limit; None for no limit
    """
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // _MB
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


class LocalEngine:
    """Engine with processes of this machine, one for each slot. They serve many tasks and end with their parent.

    slots: number of tasks at the same time
    """

    def __init__(self, limits: TaskLimits, slots: int) -> None:
        self._limits, self.slots = limits, slots
        self._context = multiprocessing.get_context("forkserver")
        self._context.set_forkserver_preload(PRELOADED)
        self._stopping = threading.Event()
        self._workers = [_Worker(self._context) for _ in range(slots)]

    def run(self, work: Work, tasks: Iterable[Task]) -> Generator[Ended[Task], None, None]:
        """Runs `work` on every task, and yields each when it ends."""
        self._stopping.clear()
        rest, waiting = iter(tasks), set[Future[Ended[Task]]]()
        free: SimpleQueue[_Worker] = SimpleQueue()
        for worker in self._workers:
            free.put(worker)
        with ThreadPoolExecutor(self.slots) as threads:
            try:
                while True:
                    for task in islice(rest, 2 * self.slots - len(waiting)):
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
        pool = self._open_pool()
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

    def _open_pool(self) -> ProcessPoolExecutor:
        failure: Exception | None = None
        for _ in range(_STARTS):  # a process that is killed while it loads is started again
            if self._pool is not None:
                return self._pool
            with python_process.isolate_children():
                pool = ProcessPoolExecutor(1, mp_context=self._context, initializer=_end_with_parent)
            try:
                with python_process.isolate_children():
                    starting = pool.submit(os.getpid)
                self._pid = starting.result(_STARTING)
                self._pool = pool
            except (BrokenProcessPool, TimeoutError, EOFError, OSError) as error:  # the fork server may die as well
                failure = error
                pool.shutdown(wait=False, cancel_futures=True)
        if self._pool is not None:
            return self._pool
        raise WorkerUnfit(
            "No process for the runs could be started; in a script of your own, call it below "
            '`if __name__ == "__main__":`, and see what was said above.'
        ) from failure

    def kill(self) -> None:
        """Kills the process at once."""
        if self._pool is not None and self._pid:
            with suppress(ProcessLookupError):
                os.kill(self._pid, signal.SIGKILL)
            self._pool.shutdown(wait=False, cancel_futures=True)
            self._pool, self._pid = None, 0


def _end_with_parent() -> None:
    """Ignores Ctrl-C, which is for the parent process, and ends this process when the parent dies."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = parent_process()

    def follow() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=follow, daemon=True).start()


# The engine on Ray: a cluster of this machine alone, or an existing one. Ray places, starts and repeats the tasks.
# A run and its result are small; pictures are in the sweep's folder, which all machines of the cluster must see.

_AHEAD = 2  # tasks per slot that Ray knows before they can start
_MAX_AHEAD = 10_000
_ANSWERING = 5.0  # seconds
_SETTINGS = b"\x04"  # type of the first frame in HTTP/2, which Ray uses (RFC 9113, 3.4)
_HELLO = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + bytes(3) + _SETTINGS + bytes(5)
_OBJECTS = 100 * _MB  # bytes for values between processes; those of a sweep are small
_SILENT = {"log_to_driver": False, "logging_level": logging.CRITICAL + 1}  # the sweep reports failures itself


class RayEngine:
    """Engine on Ray, from its construction to the end of `run`.

    slots: number of tasks at the same time on this machine
    address: HOST:PORT or "auto" of a cluster, whose size then decides instead of `slots`

    Raises ConfigError if Ray is not installed, the address does not answer, or no machine has enough cores and
    memory.
    """

    def __init__(self, limits: TaskLimits, slots: int, address: str | None = None) -> None:
        registry.require("ray", "ray", "A sweep over several machines (--address)")
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # no usage statistics are sent
        if address is not None:
            _show_token()
        import ray
        from ray.job_config import JobConfig

        # Ray puts the current folder first on the path of its workers, except for a job like this one.
        settings = {**_SILENT, "job_config": JobConfig(_client_job=True)}
        # Otherwise Ray prints the stack of every failed try, and the last output of a lost machine.
        ray._private.worker._worker_logs_enabled = False
        self._limits = limits
        if address is None:
            with _own_signals(), python_process.isolate_children():
                ray.init(
                    address="local", num_cpus=slots * limits.threads, include_dashboard=False,
                    object_store_memory=_OBJECTS, _memory=slots * limits.memory * _MB, **settings,
                )  # fmt: skip
            self.slots = slots
            return
        _require_answer(address)
        try:
            with _own_signals(), python_process.isolate_children():
                ray.init(address=address, **settings)
        except (ConnectionError, RuntimeError, ValueError) as error:
            said = str(error).split("\n")[0][:200]
            raise ConfigError(
                f"The Ray cluster at {address[:80]} cannot be joined ({said}); see `ray status` there, have one "
                "version of Ray and of Python everywhere, and on each machine the head's token (`ray get-auth-token`)."
            ) from error
        self.slots = sum(_room(node["Resources"], limits) for node in ray.nodes() if node["Alive"])
        if self.slots == 0:
            ray.shutdown()
            raise ConfigError(
                f"No machine of the Ray cluster at {address[:80]} has {limits.threads} cores and {limits.memory} MB "
                "for a run; ask for less (threads, memory)."
            )

    def run(self, work: Work, tasks: Iterable[Task]) -> Generator[Ended[Task], None, None]:
        """Runs `work` on every task, and yields each when it ends."""
        import ray

        limits, ahead = self._limits, min(_AHEAD * self.slots + 2, _MAX_AHEAD)
        tried = ray.remote(
            num_cpus=limits.threads,
            memory=limits.memory * _MB,
            max_retries=limits.tries - 1,
            retry_exceptions=[FridaError],
        )(within_limits)
        rest, waiting = iter(tasks), dict[Any, Task]()
        try:
            while True:
                for task in islice(rest, ahead - len(waiting)):
                    waiting[tried.remote(work, task, limits)] = task
                if not waiting:
                    return
                done, _ = ray.wait(list(waiting))
                for reference in done:
                    yield _end_task(waiting.pop(reference), reference, limits)
        finally:
            ray.shutdown()


@contextmanager
def _own_signals() -> Iterator[None]:
    """Preserves this process's handler of SIGTERM; Ray's own handler prints a stack and goes on."""
    before = signal.getsignal(signal.SIGTERM)
    yield
    if before is not None and threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, before)


def _show_token() -> None:
    """Makes Ray use its token if this machine has one, because clusters of `ray start` ask for it."""
    place = Path(os.environ.get("RAY_AUTH_TOKEN_PATH", "~/.ray/auth_token"))
    if "RAY_AUTH_TOKEN" in os.environ or place.expanduser().is_file():
        os.environ.setdefault("RAY_AUTH_MODE", "token")


def _room(resources: Mapping[str, float], limits: TaskLimits) -> int:
    """Returns the number of tasks for which a machine with these resources has room."""
    memory = resources.get("memory", 0.0) / (limits.memory * _MB)
    return int(min(resources.get("CPU", 0.0) / limits.threads, memory))


def _end_task(task: Task, reference: Any, limits: TaskLimits) -> Ended[Task]:
    """Returns the ended task of a reference."""
    import ray

    try:
        return Ended(task, ray.get(reference))
    except ray.exceptions.RayTaskError as error:
        cause = error.cause
        return Ended(task, error=cause if isinstance(cause, FridaError) else TryFailed(str(cause)[:500]))
    except ray.exceptions.RayError as error:
        return Ended(task, error=TryFailed(_describe_loss(error, limits)))


def _describe_loss(error: Exception, limits: TaskLimits) -> str:
    said = str(error).strip().split("\n")[0][:200]
    return (
        f"Its process was killed: by the system for want of memory, by a person, or because the try lasted longer than "
        f"{limits.seconds:g} s (time_limit). Ray says: {said}"
    )


def _require_answer(address: str) -> None:
    """Raises ConfigError unless Ray answers at the address; Ray itself would wait for minutes."""
    if address in ("auto", "local"):
        return
    host, _, port = address.removeprefix("ray://").rpartition(":")
    try:
        if not host or not port.isdigit():
            raise OSError("it is not HOST:PORT")
        with socket.create_connection((host, int(port)), timeout=_ANSWERING) as line:
            line.sendall(_HELLO)
            if "RAY_USE_TLS" not in os.environ and line.recv(9)[3:4] != _SETTINGS:
                raise OSError("what listens there is no Ray")
    except (OSError, OverflowError) as error:
        raise ConfigError(
            f"--address {address[:80]} does not answer ({error}); give the address that `ray start --head` named, like "
            "192.168.1.10:6379, or leave it out for this machine."
        ) from error
