"""Compilation of the planner's loops by numba: eligible tensors, modules, compiling processes.

numba compiles a loop at its first call with new argument types and stores the result on disk. All loops of the
planner take ten seconds or more, once on each machine. So separate processes compile them while a command loads
other modules. Threads would not help: they wait for Python's lock and for numba's lock.

The function `argument_types` of each module of loops lists the types that a plan uses. Each planning process
waits for the compiling processes (`await_loops`). Otherwise it would compile the same loops itself.
"""

import gc
import hashlib
import importlib.metadata
import os
import platform
import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import platformdirs

from frida_painter import locks, python_process, storage
from frida_painter.errors import StorageError

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from torch import Tensor


# Modules whose loops the planner calls, in two halves that take about as long to compile.
LOOPS = (
    ("frame_kernels", "brush.table_kernels", "planning.kernels"),
    ("render.kernels",),
)
_HERE = Path(__file__).parent
_SENTENCE = "Compiling the painter's loops, the first time only: up to ten seconds more."
_LOCK = "compiling.lock"
_PATIENCE = 60.0  # seconds, for a busy or small computer


def compiles_for(tensor: "Tensor") -> bool:
    """Returns True if compiled loops can use the tensor, because it is on the CPU; otherwise PyTorch computes."""
    return tensor.device.type == "cpu"


def array(tensor: "Tensor") -> "NDArray[Any]":
    """Returns the values of a CPU tensor without gradient; shares its memory if it is contiguous."""
    bare = tensor.detach() if tensor.requires_grad else tensor  # detach makes a new tensor at each call
    return (bare if bare.is_contiguous() else bare.contiguous()).numpy()


class LoopCompiler:
    """Context manager that compiles the planner's loops in separate processes.

    folder: folder of the notes about compiled loops; by default in the system's cache folder
    It starts no process if all loops are compiled or another process compiles them. The processes end with the
    block. If the folder cannot be written to, or is not this user's own, each loop is compiled at its first call.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self._folder = folder or _folder()
        self._processes: list[subprocess.Popen[bytes]] = []

    def __enter__(self) -> Self:
        missing = _missing(self._folder)
        if not missing:
            return self
        with suppress(OSError):
            self._folder.mkdir(parents=True, exist_ok=True)
            self._folder.chmod(0o700)  # refused if the folder is another user's
            lock = locks.open_lock(self._folder / _LOCK)
            try:
                if locks.take(lock):  # each process inherits the lock and holds it until it ends
                    quiet: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
                    for half in missing:
                        program = ("-m", "frida_painter.compiled", self._folder, *half)
                        self._processes.append(python_process.start(*program, pass_fds=(lock,), **quiet))
            finally:
                os.close(lock)
        return self

    def __exit__(self, *failure: object) -> None:
        for process in self._processes:
            process.kill()
            process.wait()


def await_loops(
    tell: Callable[[str], None] = lambda sentence: None, folder: Path | None = None, patience: float = _PATIENCE
) -> None:
    """Waits until the planner's loops are compiled or no process compiles them, for `patience` seconds at most.

    After a wait in vain this process compiles them itself, and later ones do not wait for the same holder.

    tell: receives a message if there is a wait, and if it was in vain
    """
    folder = folder or _folder()
    path = folder / _LOCK
    if not path.exists() or not _missing(folder):
        return
    with suppress(OSError):
        lock = os.open(path, os.O_RDWR)
        try:
            if not locks.take(lock, shared=True):
                tell(_SENTENCE)
                if not locks.take(lock, patience, shared=True):
                    tell(f"{path} is still locked by another process after {patience:.0f} s; not waiting any longer.")
                    path.unlink(missing_ok=True)  # who compiles next makes a new one
        finally:
            os.close(lock)


def compile_loops(folder: Path, modules: Sequence[str]) -> None:
    """Compiles the loops of `modules`, or finds them on disk, and writes a note about this to `folder`."""
    kept: set[str] = set()
    for name in modules:
        module = import_module(f"frida_painter.{name}")
        for loop, types in module.argument_types():
            loop.compile(types)
            pattern = f"{name.rpartition('.')[2]}.{loop.py_func.__name__}-*.nbi"
            found = [str(path) for path in Path(loop.stats.cache_path).glob(pattern)]
            if not found:
                return  # numba could not write its cache
            kept.update(found)
    with suppress(StorageError):
        storage.write_json(_note(folder, modules), {"kept": sorted(kept)})


def _missing(folder: Path) -> list[tuple[str, ...]]:
    """Returns the halves of the loops that are not compiled."""
    return [half for half in LOOPS if not _is_done(folder, half)]


def _is_done(folder: Path, modules: Sequence[str]) -> bool:
    """Returns True if numba has stored all loops of these modules and none has changed since."""
    with suppress(StorageError):
        kept = storage.read_json(_note(folder, modules), "a note of compiled loops").get("kept")
        return isinstance(kept, list) and len(kept) > 0 and all(Path(path).is_file() for path in kept)
    return False


def _folder() -> Path:
    return platformdirs.user_cache_path("frida-painter", appauthor=False) / "loops"


def _note(folder: Path, modules: Sequence[str]) -> Path:
    """Returns the path of the note; its name depends on all facts that make numba's cache valid."""
    sources = [(_HERE / f"{name.replace('.', '/')}.py").stat() for name in modules]
    facts = (
        sys.version,
        importlib.metadata.version("numba"),
        platform.node(),  # another computer may have another processor
        os.environ.get("NUMBA_CACHE_DIR"),
        str(_HERE),
        [(facts.st_mtime_ns, facts.st_size) for facts in sources],
    )
    return folder / f"{hashlib.sha256(repr(facts).encode()).hexdigest()[:32]}.json"


if __name__ == "__main__":
    gc.disable()  # numba makes many objects, but little garbage
    compile_loops(Path(sys.argv[1]), sys.argv[2:])
