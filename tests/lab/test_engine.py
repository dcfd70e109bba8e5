"""The engine: every task ends once, whatever becomes of the processes that do it."""

import os
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

import pytest

import sweep_works
from frida_painter.errors import ConfigError, TryFailed, WorkerUnfit
from frida_painter_lab import engine as engines
from frida_painter_lab.engine import Engine, TaskLimits, slots_here


@pytest.fixture(autouse=True)
def _light(monkeypatch: pytest.MonkeyPatch) -> None:
    """Workers load what a task needs, and no planner, but for one test."""
    monkeypatch.setattr(engines, "PRELOADED", ["frida_painter.errors", "torch"])


def engine(seconds: float = 60.0, tries: int = 2, slots: int = 1, threads: int = 1) -> Engine:
    return Engine(TaskLimits(seconds, threads=threads, memory=100, tries=tries), slots)


def test_every_task_ends_once_in_processes_that_stay_and_failures_stop_nothing() -> None:
    one = engine(threads=3)
    found = {ended.task: ended for ended in one.run(sweep_works.fail_on_odd, range(4))}
    assert [found[number].value for number in range(4)] == [0, None, 2, None]
    assert isinstance(found[1].error, TryFailed)
    assert "ValueError: 1 is odd (sweep_works.py, line" in str(found[1].error)
    processes = {ended.value for ended in one.run(sweep_works.process, range(5))}
    assert len(processes) == 1 and os.getpid() not in processes
    assert [ended.value for ended in one.run(sweep_works.threads, [0])] == [3]
    assert sorted(ended.value for ended in engine(slots=2).run(sweep_works.square, range(9)))[-1] == 64


@pytest.mark.parametrize(("work", "kind"), [(sweep_works.refuse, ConfigError), (sweep_works.unfit, WorkerUnfit)])
def test_errors_keep_their_kind_and_their_sentence(work, kind: type[Exception]) -> None:
    (ended,) = engine().run(work, [0])
    assert isinstance(ended.error, kind) and str(ended.error) in ("Never.", "Another version.")


@pytest.mark.parametrize("work", [sweep_works.die_at_first, sweep_works.hang_at_first])
def test_a_process_that_dies_or_hangs_is_replaced_and_its_task_done_again(tmp_path: Path, work) -> None:
    (ended,) = engine(seconds=2.0).run(work, [str(tmp_path)])
    assert ended.value == "done" and ended.error is None


@pytest.mark.parametrize("death", [BrokenProcessPool, EOFError, ConnectionResetError])
def test_a_process_that_is_killed_while_it_starts_is_started_again(
    death: type[Exception], monkeypatch: pytest.MonkeyPatch
) -> None:
    class DiesAtFirst(ProcessPoolExecutor):
        starts = 0

        def submit(self, *words, **more):
            DiesAtFirst.starts += 1
            if DiesAtFirst.starts in (1, 2):
                raise death
            return super().submit(*words, **more)

    monkeypatch.setattr(engines, "ProcessPoolExecutor", DiesAtFirst)
    assert [ended.value for ended in engine(tries=1).run(sweep_works.square, [3])] == [9]
    monkeypatch.setattr(engines, "_STARTS", 0)
    (ended,) = engine(tries=1).run(sweep_works.square, [3])
    assert isinstance(ended.error, WorkerUnfit)


def test_a_task_that_never_ends_is_given_up(tmp_path: Path) -> None:
    (ended,) = engine(seconds=2.0).run(sweep_works.hang, [str(tmp_path)])
    assert "was killed" in str(ended.error) and "2 s" in str(ended.error)
    assert len(list(tmp_path.iterdir())) == 2, "it was tried twice"


def test_closing_ends_what_is_going_on(tmp_path: Path) -> None:
    def tasks() -> Iterator[str]:
        yield str(tmp_path)
        for _ in range(6000):
            if any(tmp_path.iterdir()):
                break
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
