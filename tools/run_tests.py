"""Runs the whole test suite in groups, some at a time; a group that fails stops none.

Each group has a test process of its own: one that ran all tests would keep every library and cache that any of them
loads. These processes are forked from this one, which has loaded the large libraries that most of them use: that
takes four seconds of a processor. Groups that take longest come first, so that no processor waits at the end for the
other; and there is one process more than processors, because some tests wait for a clock.

Tests that failed run once more at the end, alone: some of them talk to programs that have deadlines of their own, which
a busy machine may miss. A test that then passes is named, and fails nothing.

`--quick` runs only the tests that are not slow, with few examples of each property, in few processes. A test is slow if
it is marked so, or named in tests/slow_tests.txt. `--renew` adds to that file what took too long in this run; leave the
machine alone meanwhile.
`--plain-processor` computes with the instructions that every 64-bit PC has, and with two threads: sums come in another
order, and last digits differ, as they do between processors. No test's verdict may depend on that.
`--jobs N` runs N groups at a time. All other words go to pytest.
"""

import argparse
import atexit
import contextlib
import gc
import importlib
import os
import re
import runpy
import sys
import tempfile
import time
import traceback
from collections import deque
from pathlib import Path
from typing import IO, NoReturn

ROOT = Path(__file__).parents[1]
# Rooms by how long their tests take, the longest first. All others, and tests of single modules, are the last group.
GROUPS = (
    ("session",),
    ("lab",),
    ("cli",),
    ("web",),
    ("procedures", "easel"),
    ("benchmarks", "docs", "examples"),
    ("planning",),
    ("runs", "report", "export", "tools"),
    ("sawyer", "hardware"),
    ("words", "weights"),
    ("objectives",),
    ("render", "brush", "perception", "virtual"),
)
PARTS = {"session": 6, "web": 2, "lab": 14, "objectives": 3}  # rooms that are more than one group
SLOW_TESTS = ROOT / "tests" / "slow_tests.txt"
# No temporary file of Python: the first of the forked processes that ends would remove it.
TIMES = ROOT / ".pytest_cache" / "times"
MAX_PROCESSOR_TIME, MAX_TIME = 0.15, 0.5  # seconds that a quick test takes, of a processor and of a clock
QUICK = ("-m", "not slow", "--hypothesis-profile", "quick")
# Libraries that are loaded once. None of them is a plugin of pytest, which has to load those itself.
LARGE = ("torch", "numba", "scipy.stats", "cv2", "pydantic")
MAX_JOBS = 6  # each may take 2 GB of memory
NO_TESTS = 5  # exit status of pytest
# What PyTorch, its two libraries of kernels, numba, NumPy's linear algebra, OpenCV and libvips read as they are loaded.
PLAIN_PROCESSOR = {
    "ATEN_CPU_CAPABILITY": "default",
    "MKL_CBWR": "COMPATIBLE",
    "ONEDNN_MAX_CPU_ISA": "SSE41",
    "NUMBA_CPU_NAME": "generic",
    "OPENBLAS_CORETYPE": "Nehalem",
    "OPENCV_IPP": "sse42",
    "OPENCV_CPU_DISABLE": "AVX,FMA3,AVX2,AVX512-SKX",
    "VIPS_NOVECTOR": "1",
}
MAX_WHY = 40  # lines
_WHY = re.compile("E  |FAILED|ERROR")
_DOTS = re.compile(r"[.sxX]*( +\[ *\d+%\])?")


def main(words: list[str]) -> int:
    """Returns 0 if all tests passed, else 1."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="only the tests that are not slow")
    usual = min(MAX_JOBS, (os.cpu_count() or 1) + 1)
    parser.add_argument("--jobs", type=int, default=usual, help=f"groups at a time (default here {usual})")
    parser.add_argument("--plain-processor", action="store_true", help="compute as a processor of another make would")
    parser.add_argument("--renew", action="store_true", help="add tests that took too long to tests/slow_tests.txt")
    options, more = parser.parse_known_args(words)
    groups = list_groups()
    if options.plain_processor:
        os.environ |= PLAIN_PROCESSOR
        more = ["--threads", "2", *more]
    if options.quick:
        groups, more = deal_files(groups, options.jobs), [*QUICK, *more]
    TIMES.parent.mkdir(exist_ok=True)
    TIMES.unlink(missing_ok=True)
    began = time.monotonic()
    told = run_groups(groups, [*more, "--times", str(TIMES)] if options.renew else more, options.jobs)
    took = time.monotonic() - began
    if options.renew:
        renew_slow_tests(TIMES.read_text())
    failures = [line for why in told for line in why]
    print(
        "\n".join([*failures, f"{told.count([])} of {len(groups)} groups of tests passed in {took / 60:.1f} minutes."]),
        flush=True,
    )
    return 1 if failures else 0


def list_groups() -> list[list[str]]:
    """Returns the paths of every group; together they are all tests."""
    named = [room for group in GROUPS for room in group]
    groups = [part for group in GROUPS for part in split_rooms(group)]
    inside = sorted((ROOT / "tests").iterdir())
    rooms = [path.name for path in inside if path.is_dir() and path.name not in named and any(path.rglob("test_*.py"))]
    single = [path.name for path in inside if path.match("test_*.py")]
    return [*groups, [f"tests/{name}" for name in rooms + single]]


def split_rooms(rooms: tuple[str, ...]) -> list[list[str]]:
    """Returns the paths of a group of rooms; of a room of PARTS, every n-th file in a group of its own."""
    if len(rooms) > 1 or rooms[0] not in PARTS:
        return [[f"tests/{room}" for room in rooms]]
    files = sorted(str(path.relative_to(ROOT)) for path in (ROOT / "tests" / rooms[0]).rglob("test_*.py"))
    return [files[first :: PARTS[rooms[0]]] for first in range(PARTS[rooms[0]])]


def deal_files(groups: list[list[str]], count: int) -> list[list[str]]:
    """Returns `count` groups that take about as long: files in turn, since those of a room are alike.

    There are no more groups than processes at a time, because each has to load all that its tests use.
    """
    paths = [ROOT / path for group in groups for path in group]
    files = [file for path in paths for file in (sorted(path.rglob("test_*.py")) if path.is_dir() else [path])]
    return [[str(file.relative_to(ROOT)) for file in files[first::count]] for first in range(count)]


def renew_slow_tests(times: str) -> None:
    """Adds the tests that took too long to tests/slow_tests.txt; drops those that are no longer there.

    times: one test a line: seconds of a processor, seconds of a clock, name
    """
    slow = {
        name.split("[")[0]
        for processor, clock, name in (line.split(" ", 2) for line in times.splitlines())
        if float(processor) > MAX_PROCESSOR_TIME or float(clock) > MAX_TIME
    }
    slow |= set(SLOW_TESTS.read_text().splitlines())
    SLOW_TESTS.write_text("".join(f"{name}\n" for name in sorted(slow) if is_test(name)))


def is_test(name: str) -> bool:
    """Returns True if a file has a test of this name ("tests/room/test_file.py::test_name")."""
    file, _, function = name.partition("::")
    path = ROOT / file
    return path.is_file() and f"def {function}(" in path.read_text()


def run_groups(groups: list[list[str]], options: list[str], jobs: int) -> list[list[str]]:
    """Runs the tests of all groups, so many at a time, and prints what pytest said of each when it has ended.

    Returns of each group why it failed, for the end of all; nothing of one that passed.
    """
    os.environ["OMP_NUM_THREADS"] = "1"  # read as they are loaded: as tests/conftest.py has it
    # Otherwise each of the programs that tests start compiles all that it imports.
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    sys.dont_write_bytecode = False
    for name in LARGE:
        with contextlib.suppress(ImportError):
            importlib.import_module(name)
    gc.collect()
    gc.freeze()  # otherwise every test process looks through all of them for garbage, and so copies them
    waiting, running, told = deque(enumerate(groups)), dict[int, tuple[int, IO[str]]](), list[list[str]]()
    again: list[int] = []
    while waiting or running:
        while waiting and len(running) < jobs:
            number, paths = waiting.popleft()
            child, said = start_group([*options, *remember(number), *paths])
            running[child] = number, said
        child, status = os.wait()
        if child in running:
            number, said = running.pop(child)
            why = tell_of_group(groups[number], said, os.waitstatus_to_exitcode(status))
            if why:
                again.append(number)
            else:
                told.append(why)
    for number in again:
        child, said = start_group([*options, *remember(number), "--last-failed", "--lfnf=none", *groups[number]])
        _, status = os.waitpid(child, 0)
        code = os.waitstatus_to_exitcode(status)
        print("Once more, alone:", flush=True)
        told.append(tell_of_group(groups[number], said, 1 if code == NO_TESTS else code))
    return told


def remember(number: int) -> list[str]:
    """Returns the options with which pytest keeps the failures of a group apart from those of others."""
    return ["-o", f"cache_dir=.pytest_cache/group-{number}"]


def start_group(words: list[str]) -> tuple[int, IO[str]]:
    """Starts pytest in a process that is forked; returns its number, and the file of its output."""
    said = tempfile.TemporaryFile("w+", errors="replace")  # noqa: SIM115 (closed when it was read)
    sys.stdout.flush()
    sys.stderr.flush()
    if (child := os.fork()) == 0:
        become_pytest(words, said)
    return child, said


def become_pytest(words: list[str], said: IO[str]) -> NoReturn:
    """Does in a process that was forked what `python -m pytest` does, and ends it."""
    status: int | str | None = 1
    try:
        os.chdir(ROOT)
        os.dup2(said.fileno(), 1)
        os.dup2(said.fileno(), 2)
        sys.path[0] = str(ROOT)
        sys.argv = ["pytest", *words]
        runpy.run_module("pytest", run_name="__main__", alter_sys=True)
    except SystemExit as end:
        status = end.code
    except BaseException:
        traceback.print_exc()
    finally:
        atexit._run_exitfuncs()
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(int(status or 0))


def tell_of_group(paths: list[str], file: IO[str], status: int) -> list[str]:
    """Prints what pytest said of a group; returns why it failed."""
    with file:
        file.seek(0)
        lines = file.read().splitlines()
    passed = status in (0, NO_TESTS)
    said = [line for line in lines if not (passed and _DOTS.fullmatch(line))]
    shown = paths if len(paths) < 9 else [*paths[:8], f"and {len(paths) - 8} more"]
    print("\n".join([f"Tests of {' '.join(shown)}:", *(f"  {line}" for line in said)]), flush=True)
    why = [line for line in said if _WHY.match(line)]
    return [] if passed else [f"Failed: {' '.join(shown)}", *(f"  {line}" for line in why[-MAX_WHY:])]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
