"""The engine: every task ends once, whatever becomes of the processes that do it."""

import os
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

import sweep_works
from frida_painter.errors import ConfigError, TryFailed, WorkerUnfit
from frida_painter.sweeps.engine import LocalEngine, TaskLimits, slots_here

pytestmark = pytest.mark.slow


def engine(seconds: float = 60.0, tries: int = 2, slots: int = 1) -> LocalEngine:
    return LocalEngine(TaskLimits(seconds, threads=1, tries=tries), slots)


def test_every_task_ends_once_and_processes_stay() -> None:
    found = [ended.value for ended in engine(slots=2).run(sweep_works.square, range(9))]
    assert sorted(found) == [number * number for number in range(9)]
    processes = {ended.value for ended in engine().run(sweep_works.process, range(5))}
    assert len(processes) == 1 and os.getpid() not in processes


def test_a_task_has_the_threads_that_were_declared() -> None:
    (ended,) = LocalEngine(TaskLimits(60.0, threads=3), 1).run(sweep_works.threads, [0])
    assert ended.value == 3


def test_what_fails_is_told_and_stops_nothing_else() -> None:
    found = {ended.task: ended for ended in engine().run(sweep_works.fail_on_odd, range(4))}
    assert [found[number].value for number in range(4)] == [0, None, 2, None]
    assert isinstance(found[1].error, TryFailed)
    assert "ValueError: 1 is odd (sweep_works.py, line" in str(found[1].error)
    (refused,) = engine().run(sweep_works.refuse, [0])
    assert isinstance(refused.error, ConfigError) and str(refused.error) == "Never."
    (unfit,) = engine().run(sweep_works.unfit, [0])
    assert isinstance(unfit.error, WorkerUnfit)


@pytest.mark.parametrize("work", [sweep_works.die_at_first, sweep_works.hang_at_first])
def test_a_process_that_dies_or_hangs_is_replaced_and_its_task_done_again(tmp_path: Path, work) -> None:
    (ended,) = engine(seconds=2.0).run(work, [str(tmp_path)])
    assert ended.value == "done" and ended.error is None


def test_a_task_that_never_ends_is_given_up(tmp_path: Path) -> None:
    (ended,) = engine(seconds=0.5).run(sweep_works.hang, [str(tmp_path)])
    assert "was killed" in str(ended.error) and "0.5 s" in str(ended.error)
    assert len(list(tmp_path.iterdir())) == 2, "it was tried twice"


def test_closing_ends_what_is_going_on(tmp_path: Path) -> None:
    def tasks() -> Iterator[str]:
        yield str(tmp_path)
        while not any(tmp_path.iterdir()):
            time.sleep(0.01)
        raise KeyboardInterrupt

    started = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        list(engine(seconds=600.0).run(sweep_works.hang, tasks()))
    assert time.monotonic() - started < 300, "the task would have lasted 1000 s"
    (pid,) = (int(path.name) for path in tmp_path.iterdir())
    for _ in range(600):
        if not Path(f"/proc/{pid}").exists() or "Z" in Path(f"/proc/{pid}/stat").read_text().split(")")[1][:3]:
            return
        time.sleep(0.1)
    raise AssertionError("the process still lives")


def test_slots_follow_from_cores_and_memory() -> None:
    cores = len(os.sched_getaffinity(0))
    assert slots_here(TaskLimits(threads=1, memory=100)) == cores
    assert slots_here(TaskLimits(threads=cores, memory=100)) == 1
    assert slots_here(TaskLimits(threads=1, memory=2**20)) == 1, "a terabyte each"
    assert slots_here(TaskLimits(threads=1, memory=100), 1) == 1
