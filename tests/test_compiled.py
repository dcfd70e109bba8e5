import fcntl
import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from PIL import Image

from frida_painter import compiled
from frida_painter.compiled import LOOPS, LoopCompiler, await_loops
from support import data
from test_house import SOURCES as EVERY_SOURCE

SOURCES = Path(compiled.__file__).parent

# Plans as `frida-painter plan` does, and tells which loops were compiled in this process, not found on disk.
PLANS = """
import sys
from importlib import import_module
from numba.core.dispatcher import Dispatcher
from frida_painter.calibration import WetPaint
from frida_painter.compiled import LOOPS
from frida_painter.planning.wet_paint import Wetness
from frida_painter.runs.run import PaintingRun
from frida_painter.runs.spec import RunSpec

spec = RunSpec.of(goal=[{"image": sys.argv[1]}], strokes=30, effort=0.05, render_height=64, brushes="broad,fine")
with PaintingRun(spec) as run:
    made = run.plan()
    wet = Wetness(WetPaint(10.0, 0.1, 300.0), [5.0 * number for number in range(len(made))])
    run.planner.forecast(made, run.planner.bare, wetness=wet)
parts = [part for half in LOOPS for name in half for part in vars(import_module(f"frida_painter.{name}")).values()]
loops = [part for part in parts if isinstance(part, Dispatcher)]
print(sorted({loop.py_func.__qualname__ for loop in loops if loop.stats.cache_misses}))
print(sum(len(loop.stats.cache_hits) for loop in loops))
"""


@pytest.fixture
def one_module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of the notes; there is one module of loops, and nothing was compiled yet."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "numba"))
    monkeypatch.setattr(compiled, "LOOPS", (("frame_kernels",),))
    return tmp_path / "notes"


def test_every_module_of_loops_is_compiled_before_it_is_needed_but_the_studios() -> None:
    """Those, the easel's process compiles (tests/virtual/test_kernels.py)."""
    with_loops = {path for path in EVERY_SOURCE if "from numba import" in path.read_text()}
    named = {SOURCES / f"{name.replace('.', '/')}.py" for half in LOOPS for name in half}
    assert {path for path in with_loops if "virtual" not in path.parts} == named


def test_loops_are_compiled_once_and_it_is_told(one_module: Path) -> None:
    said: list[str] = []
    with LoopCompiler(one_module):
        with LoopCompiler(one_module) as second:  # another command at the same time
            assert second._processes == []
        await_loops(said.append, one_module)
        assert len(said) == 1 and "first time" in said[0]
    with LoopCompiler(one_module) as later:
        assert later._processes == []
        await_loops(said.append, one_module)
    assert len(said) == 1


def test_what_numba_has_kept_no_longer_is_compiled_again(one_module: Path, tmp_path: Path) -> None:
    with LoopCompiler(folder=one_module):
        await_loops(folder=one_module)
    assert compiled._is_done(one_module, ("frame_kernels",))
    for kept in (tmp_path / "numba").rglob("*.nbi"):
        kept.unlink()
    assert not compiled._is_done(one_module, ("frame_kernels",))


def test_a_process_that_is_not_done_ends_with_its_block_and_nothing_is_noted(one_module: Path) -> None:
    with LoopCompiler(folder=one_module) as compiler:
        pass
    assert [process.poll() is not None for process in compiler._processes] == [True]
    assert not compiled._is_done(one_module, ("frame_kernels",))
    await_loops(folder=one_module)  # its lock went with it


def test_where_no_note_can_be_written_no_process_is_started(one_module: Path) -> None:
    one_module.write_text("a file where the folder should be")
    with LoopCompiler(folder=one_module) as compiler:
        assert compiler._processes == []
    await_loops(folder=one_module)


def test_planning_waits_for_whoever_compiles(tmp_path: Path) -> None:
    lock = os.open(tmp_path / "compiling.lock", os.O_RDWR | os.O_CREAT)
    fcntl.flock(lock, fcntl.LOCK_EX)
    waiting = threading.Thread(target=await_loops, kwargs={"folder": tmp_path})
    waiting.start()
    waiting.join(0.2)
    assert waiting.is_alive()
    os.close(lock)
    waiting.join(60)
    assert not waiting.is_alive()


def test_a_plan_finds_all_of_its_loops_compiled(tmp_path: Path) -> None:
    """What `argument_types` tell is what planning gives: else each command would compile on."""
    photograph = tmp_path / "coffee.png"
    Image.fromarray(data.coffee()).resize((120, 80)).save(photograph)
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "numba"), "XDG_CACHE_HOME": str(tmp_path / "cache")}
    plan = subprocess.run(
        [sys.executable, "-c", PLANS, str(photograph)], env=environment, capture_output=True, text=True, check=True
    )
    missed, hits = plan.stdout.splitlines()
    assert missed == "[]"
    assert int(hits) > 15
