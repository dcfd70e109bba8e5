"""Kills workers and the driver of a sweep, and looks whether every run was done, and once; then speed-up and overhead.

    python benchmarks/sweep.py [--runs 500] [--every 10] [--drivers 2] [--engine processes|ray] [--speed 40] [--quick]

The runs are tiny plans of a photograph with different seeds. A worker, drawn at random, is killed (SIGKILL) every so
many seconds, and the driver at evenly spaced shares of the runs, after which the same command is given again. Every
result must be there in the end, and none may have been written twice: a result that was seen is the same file ever
after. Speed-up and overhead are measured without kills, on --speed runs, by one and by two slots; what else the
machine does spoils them, so its load is told.
"""

import argparse
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from datetime import datetime
from pathlib import Path

from frida_painter import images
from measure import Table, arguments, photograph, publish

_SETTINGS = """
kind = "plan"
tries = 20
[settings]
strokes = 12
layers = 1
colors = 4
render_height = 64
effort = 0.05
canvas = "120x90mm"
brush = "fine"
image = "photo.png"
[grid]
seed = [{seeds}]
"""
_LONGEST = 3600.0  # seconds


@dataclass
class Watch:
    """The results in a sweep's folder, each as the file that it was when it was first seen."""

    folder: Path
    seen: dict[str, tuple[int, int]] = field(default_factory=dict)
    rewritten: set[str] = field(default_factory=set)

    def look(self) -> int:
        """Looks again; the number of results."""
        for path in self.folder.glob("runs/*/result.json"):
            facts = path.stat()
            identity = (facts.st_ino, facts.st_mtime_ns)
            if self.seen.setdefault(path.parent.name, identity) != identity:
                self.rewritten.add(path.parent.name)
        return len(self.seen)


@dataclass(frozen=True)
class Speed:
    """What a sweep without kills took. seconds: from the first run's start to the last one's end; working: the sum over
    the runs; lost: seconds of slots in which no run was at work; driver: its CPU seconds."""

    slots: int
    seconds: float
    working: float
    lost: float
    driver: float


def main() -> int:
    """Prints what was found; exit status 1 where a result is missing or was made twice."""
    parser = arguments(__doc__)
    parser.add_argument("--runs", type=int, default=500)
    parser.add_argument("--every", type=float, default=10.0, metavar="SECONDS")
    parser.add_argument("--drivers", type=int, default=2, help="how often the driver is killed")
    parser.add_argument("--engine", choices=("processes", "ray"), default="processes")
    parser.add_argument("--speed", type=int, default=40, metavar="RUNS")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    if given.quick:
        given.runs, given.drivers, given.speed = 4, 1, 4
    tables, figures, whole = [], {}, True
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        images.save(images.fit(photograph("coffee"), 90, 120), folder / "photo.png")
        if given.runs:
            row, whole = survive(folder, given)
            columns = ("runs", "results", "made twice", "workers killed", "driver killed", "calls", "seconds")
            tables.append(Table(f"A sweep whose processes are killed ({given.engine})", columns, [row]))
            figures["killed"] = dict(zip(columns, row, strict=True))
        if given.speed:
            one, two = (speed(folder, given.engine, given.speed, slots) for slots in (1, 2))
            columns = ("slots", "seconds", "sum of the runs", "lost for a run", "driver's CPU for a run", "speed-up")
            rows = [
                (
                    str(it.slots), f"{it.seconds:.1f}", f"{it.working:.1f}", f"{1000 * it.lost / given.speed:.0f} ms",
                    f"{1000 * it.driver / given.speed:.0f} ms", f"{one.seconds / it.seconds:.2f}",
                )
                for it in (one, two)
            ]  # fmt: skip
            note = f"{given.speed} runs. Load of the machine at the end: {os.getloadavg()[0]:.0f}."
            tables.append(Table(f"A sweep in peace ({given.engine})", columns, rows, [note]))
            figures["peace"] = [asdict(one), asdict(two)]
    publish(tables, figures, given)
    return 0 if whole else 1


def survive(folder: Path, given: argparse.Namespace) -> tuple[tuple[str, ...], bool]:
    """Does a sweep whose processes are killed; a row of what came of it, and whether all is there once."""
    chance, out = random.Random(given.seed), folder / "killed"
    file = written(folder, given.runs)
    watch, started = Watch(out), time.monotonic()
    workers = drivers = calls = 0
    while watch.look() < given.runs and calls <= given.drivers + 3:
        calls += 1
        driver = begun(file, out, given.engine)
        last = time.monotonic()
        while driver.poll() is None and time.monotonic() - started < _LONGEST:
            time.sleep(0.3)
            done = watch.look()
            if drivers < given.drivers and done >= given.runs * (drivers + 1) / (given.drivers + 1):
                driver.kill()
                drivers += 1
            elif time.monotonic() - last > given.every:
                last = time.monotonic()
                victims = list(workers_of(driver.pid))
                if victims:
                    with suppress(ProcessLookupError):
                        os.kill(chance.choice(victims), signal.SIGKILL)
                        workers += 1
        driver.kill()
        driver.wait()
    found = watch.look()
    seconds = time.monotonic() - started
    row = (given.runs, found, len(watch.rewritten), workers, drivers, calls, f"{seconds:.0f}")
    return tuple(map(str, row)), found == given.runs and not watch.rewritten


def speed(folder: Path, engine: str, runs: int, slots: int) -> Speed:
    """What a sweep takes by so many slots."""
    out = folder / f"speed-{slots}"
    driver, used = begun(written(folder, runs), out, engine, "--jobs", str(slots)), 0.0
    while driver.poll() is None:
        with suppress(OSError, IndexError):
            ticks = Path(f"/proc/{driver.pid}/stat").read_text().rpartition(")")[2].split()[11:13]
            used = sum(map(int, ticks)) / os.sysconf("SC_CLK_TCK")
        time.sleep(0.2)
    times = [json.loads(path.read_text())["times"] for path in out.glob("runs/*/result.json")]
    assert len(times) == runs, f"{runs - len(times)} runs are missing"
    ends = [datetime.fromisoformat(its["ended"]).timestamp() for its in times]
    first = min(end - its["wall_seconds"] for end, its in zip(ends, times, strict=True))
    seconds, working = max(ends) - first, sum(its["wall_seconds"] for its in times)
    return Speed(slots, seconds, working, slots * seconds - working, used)


def written(folder: Path, runs: int) -> Path:
    """The sweep's file."""
    path = folder / f"{runs}.toml"
    path.write_text(_SETTINGS.format(seeds=", ".join(map(str, range(runs)))))
    return path


def begun(file: Path, out: Path, engine: str, *more: str) -> "subprocess.Popen[bytes]":
    """The driver of a sweep."""
    command = [sys.executable, "-m", "frida_painter", "sweep", str(file), "--out", str(out), "--engine", engine, *more]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def workers_of(pid: int) -> Iterator[int]:
    """The processes that do runs: those of Ray by their name, otherwise the children of the fork server."""
    for child in descendants(pid):
        with suppress(OSError):
            line = Path(f"/proc/{child}/cmdline").read_bytes().replace(b"\0", b" ")
            of_ray = line.startswith(b"ray::") and b"IDLE" not in line
            if of_ray or (b"forkserver" in line and parent_of(child) != pid):
                yield child


def descendants(pid: int) -> Iterator[int]:
    """All processes below one."""
    for path in Path("/proc").glob("[0-9]*"):
        with suppress(OSError, IndexError):
            if parent_of(int(path.name)) == pid:
                yield int(path.name)
                yield from descendants(int(path.name))


def parent_of(pid: int) -> int:
    """The process that started one."""
    return int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])


if __name__ == "__main__":
    sys.exit(main())
