"""Loops that numba compiles: which tensors they can work on, the arrays that they take, and who compiles them.

numba compiles a loop when it is first called with arguments of some types, and keeps the result on disk. All loops of
the planner take ten seconds and more, on every machine once. So processes of their own compile them beside what a
command loads meanwhile; threads of one would wait for Python's lock, and for numba's. A module of loops tells by
`argument_types` what they take in a plan.

Every process that plans waits for those that compile (`await_loops`); without it each would compile the same.
"""

import fcntl
import gc
import hashlib
import importlib.metadata
import os
import platform
import subprocess
import sys
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import platformdirs

from frida_painter import storage
from frida_painter.errors import StorageError

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from torch import Tensor


# The modules whose loops the planner calls, in two halves that take about as long to compile.
LOOPS = (
    ("frame_kernels", "brush.table_kernels", "planning.variable_kernels"),
    ("render.kernels",),
)
_HERE = Path(__file__).parent
_SENTENCE = "Compiling the painter's loops, the first time only: up to ten seconds more."


def compiles_for(tensor: "Tensor") -> bool:
    """Whether compiled loops can work on it: it is on the CPU, and numba is installed. Elsewhere PyTorch does."""
    return tensor.device.type == "cpu" and find_spec("numba") is not None


def array(tensor: "Tensor") -> "NDArray[Any]":
    """The numbers of a tensor on the CPU, without its gradient, in its own memory where that has no gaps."""
    bare = tensor.detach() if tensor.requires_grad else tensor  # detach makes a tensor, each time
    return (bare if bare.is_contiguous() else bare.contiguous()).numpy()


class LoopCompiler:
    """Processes that compile the planner's loops, in a `with` block; none if that was done, or others are at it.

    They end with the block. folder: of the notes of what is compiled, by default the
    system's for caches. Where that cannot be written to, loops are compiled when they are needed.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self._folder = folder or _folder()
        self._processes: list[subprocess.Popen[bytes]] = []

    def __enter__(self) -> Self:
        missing = [half for half in LOOPS if not _is_done(self._folder, half)]
        if find_spec("numba") is None or not missing:
            return self
        with suppress(OSError):
            self._folder.mkdir(parents=True, exist_ok=True)
            lock = os.open(_lock(self._folder), os.O_RDWR | os.O_CREAT, 0o644)
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                self._processes = [self._start(half, lock) for half in missing]
            finally:
                os.close(lock)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for process in self._processes:
            process.kill()
            process.wait()

    def _start(self, modules: Iterable[str], lock: int) -> "subprocess.Popen[bytes]":
        """A process that inherits the lock, and holds it until it ends, however that happens."""
        return subprocess.Popen(
            [sys.executable, "-m", "frida_painter.compiled", str(self._folder), *modules],
            pass_fds=(lock,),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )


def await_loops(tell: Callable[[str], None] = lambda sentence: None, folder: Path | None = None) -> None:
    """Returns when no process compiles the planner's loops, at once if none does. tell: hears what is waited for."""
    with suppress(OSError):  # no folder, and nothing was compiled in it
        lock = os.open(_lock(folder or _folder()), os.O_RDWR)
        try:
            try:
                fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
            except BlockingIOError:
                tell(_SENTENCE)
                fcntl.flock(lock, fcntl.LOCK_SH)
        finally:
            os.close(lock)


def compile_loops(folder: Path, modules: Sequence[str]) -> None:
    """Compiles the loops of those modules, or finds them on disk, and notes in the folder that this was done."""
    kept: set[str] = set()
    for name in modules:
        module = import_module(f"frida_painter.{name}")
        for loop, types in module.argument_types():
            loop.compile(types)
            pattern = f"{name.rpartition('.')[2]}.{loop.py_func.__name__}-*.nbi"
            found = [str(path) for path in Path(loop.stats.cache_path).glob(pattern)]
            if not found:
                return  # numba could not write
            kept.update(found)
    with suppress(StorageError):
        storage.write_json(_note(folder, modules), {"kept": sorted(kept)})


def _is_done(folder: Path, modules: Sequence[str]) -> bool:
    """Whether numba has kept all loops of those modules, and none was changed since."""
    with suppress(StorageError):
        kept = storage.read_json(_note(folder, modules), "a note of compiled loops").get("kept")
        return isinstance(kept, list) and len(kept) > 0 and all(Path(path).is_file() for path in kept)
    return False


def _folder() -> Path:
    return platformdirs.user_cache_path("frida-painter", appauthor=False) / "loops"


def _lock(folder: Path) -> Path:
    return folder / "compiling.lock"


def _note(folder: Path, modules: Sequence[str]) -> Path:
    """Named after everything that numba looks at before it takes what it kept."""
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
    gc.disable()  # numba makes many objects, and few of them are garbage
    compile_loops(Path(sys.argv[1]), sys.argv[2:])
