"""Start of Python processes that load no code from the current folder, in which anybody's files may lie.

`python -m` and `python -c` put the current folder first on the path of modules, so that a file `filelock.py` of a
painting's folder would be imported. All Python processes of the painter are started here. Libraries that start Python
themselves, such as multiprocessing, pass on the environment that `isolate` and `isolate_children` set.
"""

import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any

_HOME = Path(__file__).parents[1]
_FOLDERS = (
    *("PYTHONPATH", "PYTHONHOME", "PYTHONUSERBASE", "PYTHONPYCACHEPREFIX", "NUMBA_CACHE_DIR", "TRITON_CACHE_DIR"),
    *("LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH", "PATH"),
)
"""Variables that name folders of code. An empty or relative entry means the current folder, or one below it."""
_DROPPED = ("PYTHONINSPECT", "PYTHONSTARTUP")  # with the first, Python would run what it finds on its standard input
_TURN = threading.Lock()
_SAFE, _OURS = "PYTHONSAFEPATH", "frida-painter"  # any text counts as yes; this one is taken back for other programs


def command(*arguments: object) -> list[str]:
    """Returns the command that runs Python with these arguments; to be run in `environment`."""
    return [sys.executable, "-P", *map(str, arguments)]


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
    return {**kept, _SAFE: kept.get(_SAFE) or _OURS, **more}


def environment_of_others() -> dict[str, str]:
    """Returns the environment for a program of the person's own, which may import what lies beside it."""
    return {name: value for name, value in os.environ.items() if (name, value) != (_SAFE, _OURS)}


def start(*arguments: object, **options: Any) -> "subprocess.Popen[bytes]":
    """Starts Python. options: those of `subprocess.Popen`; by default the process has no standard input."""
    return subprocess.Popen(command(*arguments), **{"stdin": subprocess.DEVNULL, "env": environment(), **options})


def run(*arguments: object, **options: Any) -> "subprocess.CompletedProcess[Any]":
    """Runs Python to its end. options: those of `subprocess.run`; its output is captured by default."""
    if "input" not in options:
        options.setdefault("stdin", subprocess.DEVNULL)
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    return subprocess.run(command(*arguments), check=False, **{**streams, "env": environment(), **options})


def isolate() -> None:
    """Makes this process, and Python that libraries start from it, load no more code from the current folder."""
    isolated = environment()
    given, kept = (each.get("PYTHONPATH", "").split(os.pathsep) for each in (os.environ, isolated))
    if given != [""]:
        with suppress(FileNotFoundError):  # the current folder is gone
            dropped = {str(Path(entry).absolute()) for entry in given} - {*kept}
            sys.path[:] = [entry for entry in sys.path if entry not in dropped]
    _set_environment(isolated)


@contextmanager
def isolate_children() -> Iterator[None]:
    """Isolates this process as `isolate` does, for a library that starts Python within the block."""
    with _TURN:
        before, path = dict(os.environ), [*sys.path]
        isolate()
        try:
            yield
        finally:
            sys.path[:] = path
            _set_environment(before)


def _set_environment(wanted: dict[str, str]) -> None:
    for name in os.environ.keys() - wanted:
        del os.environ[name]
    os.environ.update(wanted)


@cache
def prepare_forks() -> None:
    """Keeps PyTorch in processes that are forked from this one from waiting for ever for threads of this one.

    multiprocessing forks on Linux, and so does gymnasium's AsyncVectorEnv. PyTorch's own DataLoader does the same.
    """

    def use_one_thread() -> None:
        if torch := sys.modules.get("torch"):
            torch.set_num_threads(1)

    os.register_at_fork(after_in_child=use_one_thread)
