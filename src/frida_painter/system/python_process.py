"""Python processes of the painter: their start, and calls of functions in them.

`python -m` and `python -c` put the current folder first on the path of modules, so that a file `filelock.py` of a
painting's folder would be imported. All Python processes of the painter are started here, and load no code from it.
Libraries that start Python themselves, such as multiprocessing, pass on the environment that `isolate` sets.

`python -m frida_painter.system.python_process MODULE:FUNCTION SOCKET` calls a function that is marked with
`in_own_process`. Its arguments come over the inherited socket, and its result, progress or error goes back
(messages.py).
"""

import importlib
import inspect
import math
import os
import re
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import traceback
from collections import abc
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import IO, Any, BinaryIO, Generic, ParamSpec, TypeVar, get_args, get_origin, get_type_hints

from frida_painter.errors import FridaError, ProcessLost
from frida_painter.system import operating_system
from frida_painter.system.messages import Arrays, Wire, decode_error, encode_error, pack, unpack

P = ParamSpec("P")
R = TypeVar("R")

_HOME = Path(__file__).parents[2]
_FOLDERS = (
    *("PYTHONPATH", "PYTHONHOME", "PYTHONUSERBASE", "PYTHONPYCACHEPREFIX", "NUMBA_CACHE_DIR", "TRITON_CACHE_DIR"),
    *("LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH", "PATH"),
)
"""Variables that name folders of code. An empty or relative entry means the current folder, or one below it."""
_DROPPED = ("PYTHONINSPECT", "PYTHONSTARTUP")  # with the first, Python would run what it finds on its standard input
_GLANCE = 0.05  # seconds between two looks at a process
_SAFE, _OURS = "PYTHONSAFEPATH", "frida-painter"  # any text counts as yes; this one is taken back for other programs


def command(*arguments: object) -> list[str]:
    """Returns the command that runs Python with these arguments; to be run in `environment`."""
    return [operating_system.python()[0], "-P", *map(str, arguments)]


def environment(**more: str) -> dict[str, str]:
    """Returns the environment for Python: this process's, without relative folders of code, and with `more`.

    A relative entry of PYTHONPATH stays, as an absolute one, if this package was found there: both processes must run
    the same version of it.
    """

    def absolute(entry: str) -> str:  # "" for a relative one, unless it is the folder of this package
        folder = Path(entry)
        if folder.is_absolute():
            return entry
        return str(_HOME) if folder.is_dir() and folder.samefile(_HOME) else ""

    kept = {name: value for name, value in os.environ.items() if name not in _DROPPED}
    for name in kept.keys() & set(_FOLDERS):
        if entries := [*filter(None, map(absolute, kept.pop(name).split(os.pathsep)))]:
            kept[name] = os.pathsep.join(entries)
    return {**kept, _SAFE: kept.get(_SAFE) or _OURS, **operating_system.python()[1], **more}


def environment_of_others() -> dict[str, str]:
    """Returns the environment for a program of the person's own, which may import what lies beside it."""
    return {name: value for name, value in os.environ.items() if (name, value) != (_SAFE, _OURS)}


def start(*arguments: object, files: Sequence[Any] = (), **options: Any) -> "subprocess.Popen[bytes]":
    """Starts Python.

    files: open files and sockets that it inherits (operating_system.py)
    options: those of `subprocess.Popen`; by default the process has no standard input
    Raises OSError.
    """
    usual = {"stdin": subprocess.DEVNULL, "env": environment(), **operating_system.inheriting(files)}
    process = subprocess.Popen(command(*arguments), **{**usual, **options})
    operating_system.hand_sockets(process, files)
    return process


def watch_program(arguments: Sequence[str], watch: Callable[[], None], **options: Any) -> int:
    """Runs a program of others to its end, and returns its exit status, or minus the signal that ended it.

    watch: called often; if it raises, the program is ended, with all processes of its group
    options: those of `subprocess.Popen`
    Raises ProcessLost, with the reason alone, if the program cannot be started, and the errors of `watch`.
    """
    try:
        program = subprocess.Popen(arguments, stdin=subprocess.DEVNULL, **operating_system.APART, **options)
    except (OSError, ValueError) as cause:
        raise ProcessLost(getattr(cause, "strerror", None) or str(cause)) from cause
    try:
        while program.poll() is None:
            watch()
            time.sleep(_GLANCE)
        watch()  # what is small may have come between two glances
    finally:
        operating_system.end_group(program)
        program.wait()
    return program.returncode


def isolate() -> None:
    """Makes this process, and Python that libraries start from it, load no more code from the current folder."""
    isolated = environment()
    given, kept = (each.get("PYTHONPATH", "").split(os.pathsep) for each in (os.environ, isolated))
    if given != [""]:
        with suppress(FileNotFoundError):  # the current folder is gone
            dropped = {str(Path(entry).absolute()) for entry in given} - {*kept}
            sys.path[:] = [entry for entry in sys.path if entry not in dropped]
    for name in os.environ.keys() - isolated:
        del os.environ[name]
    os.environ.update(isolated)


@cache
def prepare_forks() -> None:
    """Keeps PyTorch in processes that are forked from this one from waiting for ever for threads of this one.

    multiprocessing forks on Linux, and so does gymnasium's AsyncVectorEnv. PyTorch's own DataLoader does the same.
    """

    def use_one_thread() -> None:
        if torch := sys.modules.get("torch"):
            torch.set_num_threads(1)

    if hasattr(os, "register_at_fork"):
        os.register_at_fork(after_in_child=use_one_thread)


# Calls of functions in processes of their own.

_ENDING = 5.0  # seconds in which a process whose link is closed ends
_LONGEST = 160  # characters of a foreign sentence in a message
_NAME = re.compile(r"frida_painter(_\w+)?(\.\w+)*:\w+")


@dataclass(frozen=True)
class ProcessLimits:
    """Limits of a process; 0 for none.

    seconds: time until the answer
    processor: seconds of a processor
    memory, written: bytes of its memory, and of each file that it writes
    niceness: by how much other processes go before
    """

    seconds: float = math.inf
    processor: int = 0
    memory: int = 0
    written: int = 0
    niceness: int = 0

    def apply(self) -> None:
        """Limits this process, for good; the time until the answer is for the other one to watch."""
        operating_system.limit_process(self.memory, self.processor, self.written, self.niceness)


@dataclass(frozen=True)
class OwnProcess(Generic[P, R]):
    """Function that is called in a process of its own, which ends with the call, or with this process.

    function: its arguments and its result travel by their types; an open file or a socket is inherited, and an
        argument that is a function of one value is called here
    limits: limits of the process
    variables: environment of the process, beside the usual one
    heed: called during the call, several times a second; an error of it ends the call

    Raises the errors of the function as themselves. Raises ProcessLost if the process was killed, for example at a
    limit, or failed by an error that is no FridaError.
    """

    function: Callable[P, R]
    limits: ProcessLimits
    variables: Mapping[str, str]
    heed: Callable[[], None] = lambda: None

    def __call__(self, *given: P.args, **named: P.kwargs) -> R:
        """Calls the function."""
        arguments = inspect.signature(self.function).bind(*given, **named).arguments
        heard = {name: value for name, value in arguments.items() if callable(value)}
        sent = {name: value for name, value in arguments.items() if name not in heard}
        kinds = get_type_hints(self.function)
        name = f"{self.function.__module__}:{self.function.__qualname__}"
        until = time.monotonic() + self.limits.seconds
        with tempfile.TemporaryFile() as said:
            process, wire = start_function(
                name, sent, self.limits, awaited=True,
                stdout=subprocess.DEVNULL, stderr=said, env=environment(**self.variables), **operating_system.APART,
            )  # fmt: skip
            try:
                while True:
                    words, arrays = self._receive(wire, until)
                    if (told := words.get("tell")) is None:
                        break
                    heard[told](unpack(words["result"], get_args(kinds[told])[0][0], arrays))
            except ProcessLost as lost:
                raise describe_end(process, wire, lost, said) from lost
            finally:
                wire.close()
                operating_system.end_group(process)
                process.wait()
        if "error" in words:
            raise decode_error(words, FridaError)
        result: R = unpack(words["result"], kinds["return"], arrays)
        return result

    def _receive(self, wire: Wire, until: float) -> tuple[dict[str, Any], Arrays]:
        self.heed()
        while not wire.waits(_GLANCE):
            self.heed()
            if not time.monotonic() < until:
                raise ProcessLost(f"It did not answer within {self.limits.seconds:g} s.")
        return wire.receive(until - time.monotonic())


def in_own_process(
    limits: ProcessLimits = ProcessLimits(), **variables: str
) -> Callable[[Callable[P, R]], OwnProcess[P, R]]:
    """Marks a function of a module: each call starts a process for it, in an environment with these variables."""
    return partial(OwnProcess, limits=limits, variables=variables)


def start_function(
    name: str,
    given: Mapping[str, Any],
    limits: ProcessLimits = ProcessLimits(),
    *,
    awaited: bool = False,
    **options: Any,
) -> "tuple[subprocess.Popen[bytes], Wire]":
    """Starts a process that calls a function, and returns it with this end of its link.

    name: as MODULE:FUNCTION
    given: arguments by name; a parameter of the type Wire gets the other end of the link
    awaited: True if the process ends as soon as this end is closed
    options: those of `subprocess.Popen`
    Raises ProcessLost if it cannot be started.
    """
    near, far = operating_system.socket_pair()
    arrays: Arrays = {}
    files = {key: value for key, value in given.items() if hasattr(value, "fileno")}
    told = {
        key: operating_system.number_of(value) if key in files else pack(value, None, arrays)
        for key, value in given.items()
    }
    wire = Wire(near)
    try:
        with far:
            process = start(
                "-m", "frida_painter.system.python_process", name, far.fileno(), files=[far, *files.values()], **options
            )
    except OSError as cause:
        wire.close()
        raise ProcessLost(f"It cannot be started ({cause.strerror}).") from cause
    with suppress(ProcessLost):  # it ended at once: whoever waits for its answer hears of it
        wire.send({"with": told, "limits": pack(limits, None, arrays), "awaited": awaited}, arrays)
    return process, wire


def describe_end(process: "subprocess.Popen[bytes]", wire: Wire, lost: ProcessLost, said: IO[bytes]) -> ProcessLost:
    """Returns the error that says how a process ended, with its last line on the standard error, which is in `said`.

    lost: error of its link, returned if it has not ended
    """
    with suppress(subprocess.TimeoutExpired):
        process.wait(_ENDING if wire.waits(0) else 0)
    if (status := process.returncode) is None:
        return lost
    names = {one.value: one.name for one in signal.Signals}
    how = f"ended with status {status}" if status >= 0 else f"was ended by {names.get(-status, f'signal {-status}')}"
    said.seek(0)
    last = next(filter(None, reversed(said.read().decode("utf-8", "replace").splitlines())), "").strip()
    return ProcessLost(f"Its process {how}{'; it said: ' if last else ''}{last[:_LONGEST].rstrip('.')}.")


def serve(name: str, file: int) -> None:
    """Calls a function, as the process that `start_function` starts.

    file: inherited socket
    Raises ProcessLost if `name` is no marked function of the painter.
    """
    module, _, short = name.partition(":")
    marked = getattr(importlib.import_module(module), short, None) if _NAME.fullmatch(name) else None
    if not isinstance(marked, OwnProcess):
        raise ProcessLost(f"{name[:80]!r} is no function that is called in a process of its own.")
    wire = Wire(operating_system.inherited_socket(file))
    words, arrays = wire.receive()
    if words["awaited"]:
        threading.Thread(target=_end_with_parent, args=(wire,), daemon=True).start()
    unpack(words["limits"], ProcessLimits, arrays).apply()
    kinds = get_type_hints(marked.function)
    sent: Arrays = {}
    try:
        told = {key: _argument(kinds[key], value, arrays) for key, value in words["with"].items()}
        told |= {key: wire for key, kind in kinds.items() if kind is Wire}
        told |= {key: partial(_tell, wire, key) for key, kind in kinds.items() if get_origin(kind) is abc.Callable}
        answer = {"result": pack(marked.function(**told), kinds["return"], sent)}
    except FridaError as error:
        if isinstance(error, ProcessLost) and not words["awaited"]:
            return  # nobody is there who could hear of it
        answer = encode_error(error)
    except Exception as failure:
        if not words["awaited"]:
            raise
        traceback.print_exc()
        answer = encode_error(ProcessLost(" ".join(f"{type(failure).__name__}: {failure}".split())[:_LONGEST]))
    with suppress(ProcessLost):
        wire.send(answer, sent)


def _argument(kind: Any, plain: Any, arrays: Arrays) -> Any:
    if kind is socket.socket:
        return operating_system.inherited_socket(plain)
    if kind is BinaryIO:
        return os.fdopen(operating_system.inherited_file(plain), "rb", buffering=0)
    return unpack(plain, kind, arrays)


def _tell(wire: Wire, name: str, value: Any) -> None:
    arrays: Arrays = {}
    wire.send({"tell": name, "result": pack(value, None, arrays)}, arrays)


def _end_with_parent(wire: Wire) -> None:
    with suppress(ProcessLost):
        wire.receive()  # nothing comes any more: the other end was closed
    os._exit(1)


if __name__ == "__main__":
    importlib.import_module("frida_painter.system.python_process").serve(sys.argv[1], int(sys.argv[2]))
