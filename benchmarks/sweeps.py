"""A sweep whose worker processes and driver are killed: is every run done, and once? And what does a run cost?"""

import json
import os
import random
import signal
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from statistics import median

from clocks import Benchmark
from frida_painter import python_process
from frida_painter_lab.experiment import Measurement, Notify, Results, ResultTable
from frida_painter_lab.runs import Run
from frida_painter_lab.targets import load_shipped_targets

SETTINGS = """
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
image = "{photo}"
[grid]
seed = {seeds}
"""
EVERY = 10.0  # seconds between two kills of a worker
LONGEST = 3600.0  # seconds


def stat_of(pid: int) -> list[str]:
    return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()


def descendants(pid: int) -> Iterator[int]:
    """All processes below one."""
    for path in Path("/proc").glob("[0-9]*"):
        with suppress(OSError, IndexError):
            if int(stat_of(int(path.name))[1]) == pid:
                yield int(path.name)
                yield from descendants(int(path.name))


@dataclass(frozen=True, kw_only=True)
class Sweeps(Benchmark):
    """Sweeps of tiny plans, left in peace and with processes that are killed (SIGKILL), the driver twice."""

    NAME = "sweep"
    TITLE = "A sweep whose processes are killed"
    TEXT = (
        "Tiny plans of a photograph with different seeds. A worker, drawn at random, is killed every ten seconds, and\n"
        "the driver at even shares of the runs, after which the same command is given again. Every result must be\n"
        "there in the end, and none may have been written twice."
    )

    def runs(self) -> Sequence[Run]:
        return [Run({"processes": "left in peace"}), Run({"processes": "killed"})]

    def measure(self, run: Run, notify: Notify) -> Measurement:
        count, deaths = (4, 1) if self.quick else (200, 2)
        deaths = deaths if run["processes"] == "killed" else 0
        with tempfile.TemporaryDirectory() as name:
            place = Path(name)
            photo = load_shipped_targets(["coffee"])[0].path
            (place / "tiny.toml").write_text(SETTINGS.format(photo=photo, seeds=list(range(count))))
            return self._survive(place, count, deaths)

    def _survive(self, place: Path, count: int, deaths: int) -> Measurement:
        chance, out, seen, twice = random.Random(1), place / "out", dict[str, tuple[int, int]](), set[str]()
        workers = drivers = calls = 0
        began = killed_at = time.monotonic()
        while len(seen) < count and calls <= deaths + 3 and time.monotonic() - began < LONGEST:
            calls += 1
            driver = python_process.start("-m", "frida_painter", "sweep", place / "tiny.toml", "--out", out, stdout=-3)
            while driver.poll() is None:
                time.sleep(0.3)
                for path in out.glob("runs/*/result.json"):
                    identity = (path.stat().st_ino, path.stat().st_mtime_ns)
                    if seen.setdefault(path.parent.name, identity) != identity:
                        twice.add(path.parent.name)
                if drivers < deaths and len(seen) >= count * (drivers + 1) / (deaths + 1):
                    driver.kill()
                    drivers += 1
                elif deaths and time.monotonic() - killed_at > EVERY:
                    killed_at = time.monotonic()
                    victims = [pid for pid in descendants(driver.pid) if int(stat_of(pid)[1]) != driver.pid]
                    with suppress(ProcessLookupError, IndexError):
                        os.kill(chance.choice(victims), signal.SIGKILL)
                        workers += 1
            driver.wait()
        spent = [json.loads(path.read_text())["times"]["cpu_seconds"] for path in out.glob("runs/*/result.json")]
        return Measurement(
            {
                "runs": count, "results": len(spent), "made twice": len(twice), "workers killed": workers,
                "driver killed": drivers, "seconds": round(time.monotonic() - began), "CPU s of a run": median(spent),
            }
        )  # fmt: skip

    def tables(self, results: Results) -> Sequence[ResultTable]:
        return [ResultTable("Sweeps in processes of this machine", results.rows())]
