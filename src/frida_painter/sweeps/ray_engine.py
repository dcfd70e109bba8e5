"""The engine on Ray: a cluster of this machine alone, or one that is there. Ray places, starts and repeats the tasks.

A run and its result are small; pictures lie in the sweep's folder, which all machines of the cluster have to see.
"""

import logging
import os
import signal
import socket
import threading
from collections.abc import Generator, Iterable, Iterator, Mapping
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import Any

from frida_painter import extras
from frida_painter.errors import ConfigError, FridaError, TryFailed
from frida_painter.sweeps.engine import Ended, Task, TaskLimits, Work, within_limits

_AHEAD = 2  # tasks for each slot that Ray is told of before they can begin
_MOST_AHEAD = 10_000
_ANSWERING = 5.0  # seconds
_SETTINGS = b"\x04"  # the type of the frame with which every speaker of HTTP/2 begins, as Ray's are (RFC 9113, 3.4)
_HELLO = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + bytes(3) + _SETTINGS + bytes(5)
_MB = 2**20
_OBJECTS = 100 * _MB  # bytes for values between processes; those of a sweep are small
_SILENT = {"log_to_driver": False, "logging_level": logging.CRITICAL + 1}  # a failure is told by the sweep


class RayEngine:
    """Tasks on Ray, from when it is made until `run` ends.

    slots: at the same time on this machine; address: of a cluster, HOST:PORT or "auto", whose own size decides instead.
    Raises ConfigError where Ray is not installed or the address does not answer.
    """

    def __init__(self, limits: TaskLimits, slots: int, address: str | None = None) -> None:
        extras.require("ray", "ray", "A sweep over several machines (--address)")
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # nobody is told of anything
        if address is not None:
            _show_token()
        import ray

        # Ray would print the stack of every try that fails, and all that a machine said before it was gone.
        ray._private.worker._worker_logs_enabled = False
        self._limits = limits
        if address is None:
            with _own_signals():
                ray.init(
                    address="local", num_cpus=slots * limits.threads, include_dashboard=False,
                    object_store_memory=_OBJECTS, _memory=slots * limits.memory * _MB, **_SILENT,
                )  # fmt: skip
            self.slots = slots
            return
        _require_answer(address)
        try:
            with _own_signals():
                ray.init(address=address, **_SILENT)
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
        """Does the work with every task, and tells of each when it ends."""
        import ray

        limits, ahead = self._limits, min(_AHEAD * self.slots + 2, _MOST_AHEAD)
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
                    yield _ended(waiting.pop(reference), reference, limits)
        finally:
            ray.shutdown()


@contextmanager
def _own_signals() -> Iterator[None]:
    """Keeps what this process does at SIGTERM, where Ray would print its own stack and go on."""
    before = signal.getsignal(signal.SIGTERM)
    yield
    if before is not None and threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, before)


def _show_token() -> None:
    """Has Ray show its token where this machine has one: clusters of `ray start` ask for it."""
    place = Path(os.environ.get("RAY_AUTH_TOKEN_PATH", "~/.ray/auth_token"))
    if "RAY_AUTH_TOKEN" in os.environ or place.expanduser().is_file():
        os.environ.setdefault("RAY_AUTH_MODE", "token")


def _room(resources: Mapping[str, float], limits: TaskLimits) -> int:
    """How many tasks a machine with these resources does at the same time."""
    memory = resources.get("memory", 0.0) / (limits.memory * _MB)
    return int(min(resources.get("CPU", 0.0) / limits.threads, memory))


def _ended(task: Task, reference: Any, limits: TaskLimits) -> Ended[Task]:
    """What became of a task."""
    import ray

    try:
        return Ended(task, ray.get(reference))
    except ray.exceptions.RayTaskError as error:
        cause = error.cause
        return Ended(task, error=cause if isinstance(cause, FridaError) else TryFailed(str(cause)[:500]))
    except ray.exceptions.RayError as error:
        return Ended(task, error=TryFailed(_lost(error, limits)))


def _lost(error: Exception, limits: TaskLimits) -> str:
    said = str(error).strip().split("\n")[0][:200]
    return (
        f"Its process was killed: by the system for want of memory, by a person, or because the try lasted longer than "
        f"{limits.seconds:g} s (time_limit). Ray says: {said}"
    )


def _require_answer(address: str) -> None:
    """Raises ConfigError unless something answers at the address, which Ray itself waits for by the minute."""
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
