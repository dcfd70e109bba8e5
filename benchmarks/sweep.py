"""Kills workers and the driver of a sweep, and looks whether every run was done, and once; then overhead and speed-up.

    python benchmarks/sweep.py [--runs 500] [--kill-every 10] [--driver-kills 2] [--engine processes|ray] [--speed 40]

The runs are tiny plans of a photograph with different seeds. A worker, drawn at random, is killed (SIGKILL) whenever
the sweep has used so many seconds of CPU time, whatever else the machine does meanwhile, and the driver at evenly
spaced shares of the runs, after which the same command is given again. Every result must be there in the end, none may
have been written twice (a result that was seen is the same file ever after), and the table must have one row for each.
Overhead and speed-up are measured without kills, on --speed runs, by one and by two slots. What else the machine does
spoils the speed-up, so its load is told.
"""

import argparse
import heapq
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
from statistics import median
from typing import Any

from frida_painter import images
from frida_painter.lab.sweeps.engine import LocalEngine, TaskLimits
from measure import Table, arguments, photograph, publish

_SETTINGS = """
kind = "plan"
tries = 20
[settings]
strokes = 2
layers = 1
colors = 1
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


@dataclass
class Spending:
    """CPU seconds of a driver and of all processes below it, as they were when they were last looked at."""

    seconds: dict[int, float] = field(default_factory=dict)

    def look(self, driver: int) -> float:
        """Looks again; the CPU seconds of the driver alone."""
        for pid in (driver, *descendants(driver)):
            with suppress(OSError, IndexError):
                ticks = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[11:13]
                self.seconds[pid] = sum(map(int, ticks)) / os.sysconf("SC_CLK_TCK")
        return self.seconds.get(driver, 0.0)


@dataclass(frozen=True)
class Speed:
    """What a sweep without kills took. seconds: from the first run's start to the last one's end; run: CPU seconds of
    a run; between: seconds from the end of a run to the start of the next one in its slot; driver: CPU seconds of the
    driver for a run; these are medians, but for the driver, whose seconds after the first result are divided."""

    slots: int
    seconds: float
    run: float
    between: float
    driver: float


def main() -> int:
    """Prints what was found; exit status 1 where a result is missing or was made twice."""
    parser = arguments(__doc__)
    parser.add_argument("--runs", type=int, default=500)
    parser.add_argument("--kill-every", type=float, default=10.0, metavar="CPU-SECONDS")
    parser.add_argument("--driver-kills", type=int, default=2, metavar="TIMES")
    parser.add_argument("--engine", choices=("processes", "ray"), default="processes")
    parser.add_argument("--speed", type=int, default=40, metavar="RUNS")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    if given.quick:
        given.runs, given.driver_kills, given.speed = 4, 1, 4
    tables, figures, whole = [], {}, True
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        images.save(images.fit(photograph("coffee"), 90, 120), folder / "photo.png")
        if given.runs:
            row, whole = survive(folder, given)
            title = f"A sweep whose processes are killed ({given.engine})"
            tables.append(Table(title, tuple(row), [tuple(row.values())]))
            figures["killed"] = row
        if given.speed:
            one, two = (speed(folder, given.engine, given.speed, slots) for slots in (1, 2))
            columns = ("slots", "seconds", "a run, CPU", "between runs", "driver's CPU for a run", "speed-up")
            rows = [
                (
                    str(it.slots), f"{it.seconds:.1f}", f"{1000 * it.run:.0f} ms", f"{1000 * it.between:.0f} ms",
                    f"{1000 * it.driver:.0f} ms", f"{one.seconds / it.seconds:.2f}",
                )
                for it in (one, two)
            ]  # fmt: skip
            nothing = overhead(given.speed)
            notes = [
                f"{given.speed} runs. Load of the machine at the end: {os.getloadavg()[0]:.0f}.",
                f"A task that does nothing, on the engine of processes: {1000 * nothing[0]:.1f} ms, of which "
                f"{1000 * nothing[1]:.1f} ms are CPU time of driver and worker.",
            ]
            tables.append(Table(f"A sweep in peace ({given.engine})", columns, rows, notes))
            figures["peace"] = [asdict(one), asdict(two), nothing]
    publish(tables, figures, given)
    return 0 if whole else 1


def survive(folder: Path, given: argparse.Namespace) -> tuple[dict[str, str], bool]:
    """Does a sweep whose processes are killed; what came of it, and whether all is there once."""
    chance, out = random.Random(given.seed), folder / "killed"
    file = written(folder, given.runs)
    watch, spending, started = Watch(out), Spending(), time.monotonic()
    workers = drivers = calls = 0
    used = killed_at = 0.0
    while watch.look() < given.runs and calls <= given.driver_kills + 3 and time.monotonic() - started < _LONGEST:
        calls += 1
        driver = begun(file, out, given.engine)
        while driver.poll() is None and time.monotonic() - started < _LONGEST:
            time.sleep(0.3)
            done = watch.look()
            spending.look(driver.pid)
            used = sum(spending.seconds.values())
            if drivers < given.driver_kills and done >= given.runs * (drivers + 1) / (given.driver_kills + 1):
                driver.kill()
                drivers += 1
            elif used - killed_at > given.kill_every and (victims := list(workers_of(driver.pid))):
                killed_at = used
                with suppress(ProcessLookupError):
                    os.kill(chance.choice(victims), signal.SIGKILL)
                    workers += 1
        driver.kill()
        driver.wait()
    found, rows = watch.look(), rows_of(out)
    seconds = time.monotonic() - started
    told = {
        "runs": given.runs, "results": found, "made twice": len(watch.rewritten), "rows of the table": rows,
        "workers killed": workers, "driver killed": drivers, "calls": calls, "seconds": round(seconds),
        "CPU s": round(used), "CPU s of the runs": round(sum(cpu_of_runs(out))),
    }  # fmt: skip
    whole = found == rows == given.runs and not watch.rewritten
    return {name: str(value) for name, value in told.items()}, whole


def rows_of(out: Path) -> int:
    """How many different runs the table of a sweep has, if none has two rows; otherwise -1."""
    from pyarrow import parquet

    keys = parquet.read_table(out / "table.parquet")["key"].to_pylist()
    return len(keys) if len(set(keys)) == len(keys) else -1


def cpu_of_runs(out: Path) -> list[float]:
    """CPU seconds of every run that is done."""
    return [json.loads(path.read_text())["times"]["cpu_seconds"] for path in out.glob("runs/*/result.json")]


def speed(folder: Path, engine: str, runs: int, slots: int) -> Speed:
    """What a sweep takes by so many slots."""
    out = folder / f"speed-{slots}"
    driver = begun(written(folder, runs), out, engine, "--jobs", str(slots))
    watch, spending = Watch(out), Spending()
    at_first = (0, 0.0)
    used = 0.0
    while driver.poll() is None:
        used = spending.look(driver.pid) or used
        if not at_first[0] and (done := watch.look()):
            at_first = (done, used)
        time.sleep(0.1)
    records = [json.loads(path.read_text())["times"] for path in out.glob("runs/*/result.json")]
    assert len(records) == runs, f"{runs - len(records)} runs are missing"
    spans = sorted((ended(its) - its["wall_seconds"], ended(its)) for its in records)
    seconds = max(end for _, end in spans) - spans[0][0]
    # A run begins in the slot that has been free the longest.
    free, between = [0.0] * slots, []
    for start, end in spans:
        since = heapq.heapreplace(free, end)
        if since:
            between.append(start - since)
    return Speed(
        slots, seconds, median(cpu_of_runs(out)), median(between), (used - at_first[1]) / max(1, runs - at_first[0])
    )


def ended(times: dict[str, Any]) -> float:
    """When a run ended, in seconds."""
    return datetime.fromisoformat(times["ended"]).timestamp()


def overhead(tasks: int) -> tuple[float, float]:
    """Seconds and CPU seconds that the engine of processes takes for a task that does nothing."""
    engine = LocalEngine(TaskLimits(memory=100), 1)
    found = engine.run(nothing, range(tasks + 1))
    worker = next(found).value
    started, driver = time.perf_counter(), time.process_time()
    last = [one.value for one in found][-1]
    wall, cpu = time.perf_counter() - started, time.process_time() - driver + last - worker
    return wall / tasks, cpu / tasks


def nothing(number: int) -> float:
    """Does nothing; the CPU seconds of the process until now."""
    return time.process_time()


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
