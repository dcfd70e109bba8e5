import ctypes
import gc
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from uuid import uuid4

import cv2
import pytest
import torch
from hypothesis import settings

import downloads
from killing import forked_easels, fresh_easels
from measured import MAX_TEST, function_of, read_seconds
from snapshots import Snapshots

try:
    import resource
except ImportError:  # Windows
    resource = None  # type: ignore[assignment]

for _profile, _examples in (("quick", 10), ("suite", 25), ("nightly", 100)):  # of each property; make asks for one
    settings.register_profile(_profile, deadline=None, max_examples=_examples)
settings.load_profile("suite")

_MB = 2**20
MAX_MEMORY = 2048 * _MB  # of a test process, at any moment
_MAX_GROWTH = 128 * _MB  # since what is free went back to the system; then it does again
_M_ARENA_MAX = -8  # malloc.h
_MAX_UNTRIMMED = 640 * _MB  # in use, before free pages between blocks go back to the system during a test too
_MAX_KEPT = 64 * _MB  # of what a painting frees, while it is tested
_LEFT = pytest.StashKey[int]()  # bytes in use after that
_SECONDS = pytest.StashKey[dict[str, tuple[float, str]]]()  # of slow tests, and why one may take long
_LONG = pytest.StashKey[list[tuple[float, str]]]()  # tests that took more than MAX_TEST, without a reason
_PEAKS = pytest.StashKey[dict[str, int]]()  # bytes, by the name of the test process


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--renew-snapshots", action="store_true", help="write tests/snapshots/*.png anew; look at them!")
    parser.addoption("--threads", type=int, default=1, help="threads of each test process")
    parser.addoption("--times", type=Path, help="append each test's seconds, of a processor and of a clock, to a file")


def pytest_configure(config: pytest.Config) -> None:
    """One thread for each test process, unless `--threads` says otherwise, as `prepare_process` has it for people.

    Two workers with a pool of threads each wait for one another on two cores: the same tests then take up to
    six times the processor time, and their sums come in another order on every machine.
    """
    threads = config.getoption("--threads")
    os.environ["OMP_NUM_THREADS"] = str(threads)  # of processes that are started from here, xdist's workers too
    # Under nohup a program ignores that its terminal was closed, and one that a script starts in the background ignores
    # Ctrl-C. Whatever it starts inherits that; the tests ask what a program does that ignores neither.
    if hasattr(signal, "SIGHUP"):
        signal.signal(signal.SIGHUP, signal.SIG_DFL)
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if not torch.cuda.is_available():
        os.environ["TRITON_INTERPRET"] = "1"  # read when Triton is imported, by whatever imports it first
    torch.set_num_threads(threads)
    cv2.setNumThreads(threads)
    config.stash[_PEAKS] = {}
    config.stash[_LONG] = []
    config.stash[_SECONDS] = read_seconds()
    config.pluginmanager.register(downloads)  # tells what was skipped, and why
    if (library := _glibc()) is not None:  # else each thread's arena keeps what was freed in it
        library.mallopt(_M_ARENA_MAX, 1)
        threading.Thread(target=_trim_again_and_again, args=(library,), daemon=True).start()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What was measured to take long is slow, as if it was marked so."""
    for item in items:
        if function_of(item.nodeid) in item.config.stash[_SECONDS]:
            item.add_marker(pytest.mark.slow)


def pytest_collection_finish() -> None:
    """What is loaded by now stays, and is not looked through again whenever garbage is collected."""
    gc.collect()
    gc.freeze()


def _trim_again_and_again(library: ctypes.CDLL) -> None:
    """Returns free memory to the system again and again; a test of fifteen paintings leaves half its heap free."""
    while True:
        time.sleep(0.2)
        if _memory() > _MAX_UNTRIMMED:
            library.malloc_trim(0)


def _glibc() -> ctypes.CDLL | None:
    """The C library, if it can be told to give memory back."""
    library = ctypes.CDLL(None) if sys.platform == "linux" else None
    return library if hasattr(library, "malloc_trim") else None


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> Iterator[None]:
    """Keeps the test process small: forgets what a module of tests cached, and gives memory back.

    A process that paints keeps what it frees (`prepare_process`); one that tests paints a hundred times.
    """
    if (devices := sys.modules.get("frida_painter.system.devices")) is not None:
        devices._KEPT = _MAX_KEPT
    began, clock = _processor_time(), time.monotonic()
    done = yield
    took = _processor_time() - began
    if (times := item.config.getoption("--times")) is not None:
        with times.open("a") as file:
            file.write(f"{took:.3f} {time.monotonic() - clock:.3f} {item.nodeid}\n")
    if (
        took > MAX_TEST
        and "EVERY" not in os.environ
        and not item.config.stash[_SECONDS].get(function_of(item.nodeid), (0, ""))[1]
    ):
        item.config.stash[_LONG].append((took, item.nodeid))
    module = getattr(item, "module", None)  # what is no function of Python has none
    if module is not None and (nextitem is None or nextitem.path != item.path):
        for thing in vars(module).values():
            if hasattr(thing, "cache_clear") and thing.__module__ == module.__name__:
                thing.cache_clear()
    library = _glibc()
    if library is not None and _memory() > item.config.stash.get(_LEFT, 0) + _MAX_GROWTH:
        gc.collect()  # pictures hang on what refers to itself
        library.malloc_trim(0)
        item.config.stash[_LEFT] = _memory()
    return done


def _processor_time() -> float:
    """Seconds that this process and those that it waited for have taken: as many, however busy the machine is."""
    return sum(os.times()[:4])


def _memory() -> int:
    """Bytes that this process has in use; for Linux."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: Any) -> None:
    """Hears, if xdist is used, how much memory each worker took, and which tests took long."""
    told = getattr(node, "workeroutput", {})
    node.config.stash[_PEAKS][node.gateway.id] = told.get("peak", 0)
    node.config.stash[_LONG] += [(took, name) for took, name in told.get("long", [])]


def pytest_sessionfinish(session: pytest.Session) -> None:
    """A process that took more than MAX_MEMORY fails the run; seconds of a processor differ, and are told."""
    used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss if resource else 0
    peak = used * (1 if sys.platform == "darwin" else 1024)
    if hasattr(session.config, "workeroutput"):  # xdist, which has it told by the process that asked for tests
        session.config.workeroutput["peak"] = peak
        session.config.workeroutput["long"] = session.config.stash[_LONG]
        return
    peaks = session.config.stash[_PEAKS]
    peaks["the test process"] = peak
    if max(peaks.values()) > MAX_MEMORY and session.exitstatus == pytest.ExitCode.OK:
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    peaks = config.stash[_PEAKS]
    took = ", ".join(f"{name} {peak / _MB:.0f} MB" for name, peak in sorted(peaks.items()))
    terminalreporter.write_line(f"Memory at most: {took}")
    terminalreporter.write_line(f"Processor time: {_processor_time():.0f} s")
    instructions = torch.backends.cpu.get_cpu_capability()
    terminalreporter.write_line(f"PyTorch's instructions: {instructions}; threads: {config.getoption('--threads')}")
    if long := sorted(config.stash[_LONG], reverse=True):
        told = f"More than {MAX_TEST:g} s of a processor, and no reason in tests/seconds.txt:"
        terminalreporter.write_line(told, yellow=True)
        for took, name in long:
            terminalreporter.write_line(f"  {took:5.1f} s  {name}")
    if max(peaks.values(), default=0) > MAX_MEMORY:
        terminalreporter.write_line(f"FAILED: a test process may take {MAX_MEMORY / _MB:.0f} MB", red=True)


@pytest.fixture(scope="session", autouse=True)
def _forked_easels() -> Iterator[None]:
    """Easels' processes load nothing again; where they are started as people have them, tests ask for `fresh_easel`."""
    with forked_easels():
        yield


@pytest.fixture
def fresh_easel() -> Iterator[None]:
    """Easels' processes are started as people have them, by an interpreter of their own."""
    with fresh_easels():
        yield


@pytest.fixture(scope="module")
def small_world() -> Iterator[None]:
    """Paintings of a module's tests are cheap: what they say holds for a camera of few pixels as well."""
    from support import small_world  # loads the planner, which most modules of tests do without

    with small_world.small_world():
        yield


@pytest.fixture
def in_small_world() -> Iterator[None]:
    """As `small_world`, for one test."""
    from support import small_world

    with small_world.small_world():
        yield


@pytest.fixture(scope="session", autouse=True)
def _state_of_fixtures(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """What fixtures of modules stop and lock is not the person's who runs the tests either."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))
        yield


@pytest.fixture(autouse=True)
def own_state(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    """Stops are latched, and robots locked, for one test only and never for the person who runs it."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path_factory.getbasetemp() / "state" / uuid4().hex))
    monkeypatch.setenv("FRIDA_PAINTER_STOPS", "")


@pytest.fixture
def snapshot(request: pytest.FixtureRequest, tmp_path: Path) -> Callable[..., None]:
    """snapshot(name, picture): fails unless the picture [3, H, W] looks like tests/snapshots/<name>.png."""
    folder = Path(__file__).parent / "snapshots"
    return Snapshots(folder, tmp_path, renew=request.config.getoption("--renew-snapshots")).check
