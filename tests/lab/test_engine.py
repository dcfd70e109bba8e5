"""The engine: every task ends once, whatever becomes of the processes that do it."""

import os
import time
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

import sweep_works
from frida_painter.errors import ConfigError, TryFailed, WorkerUnfit
from frida_painter.system import python_process
from frida_painter_lab.engine import Engine, TaskLimits, slots_here
from sweep_works import Note


@pytest.fixture(autouse=True)
def _found(monkeypatch: pytest.MonkeyPatch) -> None:
    """Other processes find the works of tests."""
    monkeypatch.setenv(
        "PYTHONPATH", os.pathsep.join([str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH", "")])
    )


def engine(seconds: float = 60.0, tries: int = 2, slots: int = 1, threads: int = 1) -> Engine:
    return Engine(TaskLimits(seconds, threads=threads, memory=100, tries=tries), slots)


def notes(folder: Path, count: int = 1) -> list[Note]:
    return [Note(str(folder), [str(number)]) for number in range(count)]


def told(folder: Path) -> dict[str, list[str]]:
    return {path.name: path.read_text().split() for path in folder.iterdir()}


def test_every_task_ends_once_in_processes_that_stay_and_failures_stop_nothing(tmp_path: Path) -> None:
    tasks = [Note(str(tmp_path), [number]) for number in ("0", "2", "1", "3")]
    ended = engine(threads=3, tries=1).run(sweep_works.fail_on_odd, tasks)
    found = {one.task.keys[0]: one.error for one in ended}
    assert found["0"] is None is found["2"] and isinstance(found["1"], TryFailed)
    assert "ValueError: 1 is odd (sweep_works.py, line" in str(found["1"])
    (process, threads), again = told(tmp_path)["0"], told(tmp_path)["2"]
    assert [process, threads] == again and threads == "3" and process != str(os.getpid())
    tasks = notes(tmp_path, 3)
    ended = list(engine(slots=2).run(sweep_works.tell_process, tasks))
    assert sorted(one.task.keys for one in ended) == [task.keys for task in tasks]
    assert not any(one.error for one in ended)


@pytest.mark.parametrize(("work", "kind"), [(sweep_works.refuse, ConfigError), (sweep_works.unfit, WorkerUnfit)])
def test_errors_keep_their_kind_and_their_sentence(work: Any, kind: type[Exception], tmp_path: Path) -> None:
    (ended,) = engine().run(work, notes(tmp_path))
    assert isinstance(ended.error, kind) and str(ended.error) in ("Never.", "Another version.")


@pytest.mark.parametrize("work", [sweep_works.die_at_first, sweep_works.hang_at_first])
def test_a_process_that_dies_or_hangs_is_replaced_and_its_task_done_again(tmp_path: Path, work: Any) -> None:
    (ended,) = engine(seconds=2.0).run(work, notes(tmp_path))
    assert ended.error is None and (tmp_path / "tried").exists()


def test_a_process_that_is_killed_while_it_starts_is_started_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    start, starts, killed = python_process.start_function, [], {1, 3, 4}

    def start_and_kill(*words: Any, **more: Any) -> Any:
        process, wire = start(*words, **more)
        starts.append(process)
        if len(starts) in killed:
            process.kill()
        return process, wire

    monkeypatch.setattr(python_process, "start_function", start_and_kill)
    (ended,) = engine().run(sweep_works.tell_process, notes(tmp_path))
    assert ended.error is None and len(starts) == 2
    (ended,) = engine().run(sweep_works.tell_process, notes(tmp_path))
    assert isinstance(ended.error, WorkerUnfit) and "No process for the runs could be started" in str(ended.error)


def test_an_unexpected_error_ends_its_task_and_no_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    start, starts = python_process.start_function, []

    def fail_at_first(*words: Any, **more: Any) -> Any:
        starts.append(words)
        if len(starts) == 1:
            raise ValueError("no sockets")
        return start(*words, **more)

    monkeypatch.setattr(python_process, "start_function", fail_at_first)
    first, second = engine().run(sweep_works.tell_process, notes(tmp_path, 2))
    assert isinstance(first.error, ValueError) and second.error is None


def test_a_task_that_never_ends_is_given_up(tmp_path: Path) -> None:
    (ended,) = engine(seconds=2.0).run(sweep_works.hang, notes(tmp_path))
    assert "was killed" in str(ended.error) and "2 s" in str(ended.error)
    assert len(list(tmp_path.iterdir())) == 2, "it was tried twice"


def test_closing_ends_what_is_going_on(tmp_path: Path) -> None:
    (tmp_path / "done").mkdir()
    works = [Note(str(tmp_path / "done"), ["1"]), Note(str(tmp_path), ["2"])]
    started = time.monotonic()
    with closing(engine(seconds=600.0).run(sweep_works.hang_in_place, works)) as ended:
        assert next(ended).error is None
        for _ in range(6000):
            if len(list(tmp_path.iterdir())) > 1:
                break
            time.sleep(0.01)
    assert time.monotonic() - started < 300, "the task would have lasted 1000 s"
    (pid,) = (int(path.name) for path in tmp_path.iterdir() if path.is_file())
    assert not Path(f"/proc/{pid}").exists()


def test_slots_follow_from_cores_and_memory() -> None:
    cores = len(os.sched_getaffinity(0))
    assert slots_here(TaskLimits(threads=1, memory=100)) == cores
    assert slots_here(TaskLimits(threads=cores, memory=100)) == 1
    assert slots_here(TaskLimits(threads=1, memory=2**20)) == 1, "a terabyte each"
    assert slots_here(TaskLimits(threads=1, memory=100), 1) == 1
