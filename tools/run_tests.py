"""Runs the whole test suite in groups, some at a time; a group that fails stops none.

Each group has a test process of its own: one that ran all tests would keep every library and cache that any of them
loads. These processes are forked from this one, which has loaded once what most of them use. tests/seconds.txt says how
long tests take: files of a room follow each other in groups of about a minute, and the longest group comes first, so
that no processor waits at the end for the other. There is one process more than processors, because some tests wait for
a clock.

Tests that failed run once more at the end, alone: some of them talk to programs that have deadlines of their own, which
a busy machine may miss. A test that then passes is named, and fails nothing. A group that was killed runs whole.

`--quick` runs only the tests that are not in tests/seconds.txt, with few examples of each property.
`--renew` writes what was measured in this run to tests/seconds.txt: tests that took too long for `--quick` are added,
and those that are gone, or have become quick, leave. Leave the machine alone meanwhile.
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
from collections import Counter, deque
from pathlib import Path
from typing import IO, NoReturn

ROOT = Path(__file__).parents[1]
sys.path.append(str(ROOT / "tests"))

from measured import list_tests, read_seconds, renew_seconds  # noqa: E402

# No temporary file of Python: the first of the forked processes that ends would remove it.
TIMES = ROOT / ".pytest_cache" / "times"
GROUP = 40.0  # seconds of a processor that the tests of a group take, more or less
QUICK_GROUP = 5.0  # small ones, so that no processor waits long for the last one
ANY_TEST = 0.03  # seconds of a processor that a test function takes that is not in tests/seconds.txt
QUICK = ("-m", "not slow", "--hypothesis-profile", "quick")
# Modules that are loaded once.
LARGE = (
    *("torch", "numba", "scipy.stats", "cv2", "pydantic", "transformers"),
    *("hypothesis.strategies", "hypothesis.extra.numpy"),
    *("frida_painter_cli.commands", "frida_painter_studio.server", "frida_painter.easel.host", "support.small_world"),
)
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
    parser.add_argument("--renew", action="store_true", help="write what was measured to tests/seconds.txt")
    options, more = parser.parse_known_args(words)
    if options.plain_processor:
        os.environ |= PLAIN_PROCESSOR
        more = ["--threads", "2", *more]
    if options.quick:
        more = [*QUICK, *more]
    groups = list_groups(quick=options.quick)
    TIMES.parent.mkdir(exist_ok=True)
    TIMES.write_text("")
    began = time.monotonic()
    told = run_groups(groups, ["--times", str(TIMES), *more], options.jobs)
    took = time.monotonic() - began
    if options.renew:
        renew_seconds(TIMES.read_text().splitlines(), ROOT, quick=options.quick)
    failures = [line for why in told for line in why]
    print("\n".join([*failures, tell_seconds(TIMES.read_text())]))
    print(f"{told.count([])} of {len(groups)} groups of tests passed in {took / 60:.1f} minutes.", flush=True)
    return 1 if failures else 0


def list_groups(*, quick: bool = False) -> list[list[str]]:
    """Returns the files of every group, the longest group first; together they are all that have a test to run."""
    slow = {name: took for name, (took, _) in read_seconds().items()}
    groups, sizes = list[list[str]](), list[float]()
    for file in sorted((ROOT / "tests").rglob("test_*.py")):
        path = str(file.relative_to(ROOT))
        tests = [f"{path}::{name}" for name in list_tests(file)]
        if quick and all(name in slow for name in tests):
            continue
        size = sum(ANY_TEST if quick else slow.get(name, ANY_TEST) for name in tests if not (quick and name in slow))
        if not groups or sizes[-1] + size > (QUICK_GROUP if quick else GROUP):
            groups.append([])
            sizes.append(0.0)
        groups[-1].append(path)
        sizes[-1] += size
    return [group for _, group in sorted(zip(sizes, groups, strict=True), reverse=True)]


def tell_seconds(times: str) -> str:
    """Returns a sentence about the seconds of a processor that the tests of each room took, the longest first.

    times: one test a line: seconds of a processor, seconds of a clock, name
    """
    rooms = Counter[str]()
    for processor, _, name in (line.split(" ", 2) for line in times.splitlines()):
        _, *folders, _ = name.split("::")[0].split("/")
        rooms[folders[0] if folders else "single modules"] += float(processor)
    each = ", ".join(f"{room} {took:.0f}" for room, took in rooms.most_common())
    return f"Seconds of a processor: {sum(rooms.values()):.0f} in all. {each}"


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
        child, said = start_group([*options, *remember(number), "--last-failed", "--lfnf=all", *groups[number]])
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
