"""The engines: every task ends once, whatever becomes of the processes that do it."""

import os
import socket
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Protocol

import pytest

import sweep_works
from frida_painter.errors import ConfigError, TryFailed, WorkerUnfit
from frida_painter.lab.sweeps import engine as engines
from frida_painter.lab.sweeps import engine as ray_engine
from frida_painter.lab.sweeps.engine import Engine, LocalEngine, RayEngine, TaskLimits, slots_here
from frida_painter.lab.sweeps.runner import open_engine

pytestmark = pytest.mark.slow


class OpenEngine(Protocol):
    def __call__(self, seconds: float = 60.0, tries: int = 2, slots: int = 1, threads: int = 1) -> Engine: ...


@pytest.fixture(autouse=True)
def _found_by_others(monkeypatch: pytest.MonkeyPatch) -> None:
    """Processes of Ray find `sweep_works` as this one does."""
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(path for path in sys.path if path))


@pytest.fixture(params=["processes", "ray"])
def engine(request: pytest.FixtureRequest) -> OpenEngine:
    if request.param == "ray":
        pytest.importorskip("ray", reason="Ray is not installed; say: pip install '.[ray]'")

    def opened(seconds: float = 60.0, tries: int = 2, slots: int = 1, threads: int = 1) -> Engine:
        made = LocalEngine if request.param == "processes" else RayEngine
        return made(TaskLimits(seconds, threads=threads, memory=100, tries=tries), slots)

    return opened


def test_every_task_ends_once_and_processes_stay(engine: OpenEngine) -> None:
    found = [ended.value for ended in engine(slots=2).run(sweep_works.square, range(9))]
    assert sorted(found) == [number * number for number in range(9)]


def test_a_task_has_the_threads_that_were_declared_in_another_process() -> None:
    one = LocalEngine(TaskLimits(60.0, threads=3), 1)
    assert [ended.value for ended in one.run(sweep_works.threads, [0])] == [3]
    processes = {ended.value for ended in one.run(sweep_works.process, range(5))}
    assert len(processes) == 1 and os.getpid() not in processes
    assert len(engines.PRELOADED) == len(set(engines.PRELOADED))
    loaded = {ended.task: ended.value for ended in one.run(sweep_works.is_loaded, engines.PRELOADED)}
    assert loaded == dict.fromkeys(engines.PRELOADED, True), "a process that was killed begins again without imports"


def test_what_fails_is_told_and_stops_nothing_else(engine: OpenEngine) -> None:
    found = {ended.task: ended for ended in engine().run(sweep_works.fail_on_odd, range(4))}
    assert [found[number].value for number in range(4)] == [0, None, 2, None]
    assert isinstance(found[1].error, TryFailed)
    assert "ValueError: 1 is odd (sweep_works.py, line" in str(found[1].error)


@pytest.mark.parametrize(("work", "kind"), [(sweep_works.refuse, ConfigError), (sweep_works.unfit, WorkerUnfit)])
def test_errors_keep_their_kind_and_their_sentence(engine: OpenEngine, work, kind: type[Exception]) -> None:
    (ended,) = engine().run(work, [0])
    assert isinstance(ended.error, kind) and str(ended.error) in ("Never.", "Another version.")


@pytest.mark.parametrize("work", [sweep_works.die_at_first, sweep_works.hang_at_first])
def test_a_process_that_dies_or_hangs_is_replaced_and_its_task_done_again(engine, tmp_path: Path, work) -> None:
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
    local = LocalEngine(TaskLimits(60.0, tries=1), 1)
    assert [ended.value for ended in local.run(sweep_works.square, [3])] == [9]
    monkeypatch.setattr(engines, "_STARTS", 0)
    (ended,) = LocalEngine(TaskLimits(60.0, tries=1), 1).run(sweep_works.square, [3])
    assert isinstance(ended.error, WorkerUnfit)


def test_a_task_that_never_ends_is_given_up(engine: OpenEngine, tmp_path: Path) -> None:
    (ended,) = engine(seconds=2.0).run(sweep_works.hang, [str(tmp_path)])
    assert "was killed" in str(ended.error) and "2 s" in str(ended.error)
    assert len(list(tmp_path.iterdir())) == 2, "it was tried twice"


def test_closing_ends_what_is_going_on(engine: OpenEngine, tmp_path: Path) -> None:
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


def test_two_machines_of_a_cluster_share_the_tasks() -> None:
    """Two raylets on one machine."""
    pytest.importorskip("ray", reason="Ray is not installed; say: pip install '.[ray]'")
    from ray.cluster_utils import Cluster

    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    try:
        cluster.add_node(num_cpus=1)
        joined = RayEngine(TaskLimits(60.0, memory=100), 1, cluster.address)
        assert joined.slots == 2
        nodes = [ended.value for ended in joined.run(sweep_works.node, range(8))]
        assert len(nodes) == 8 and len(set(nodes)) == 2
        with pytest.raises(ConfigError, match="64 cores and 100 MB for a run; ask for less"):
            RayEngine(TaskLimits(60.0, threads=64, memory=100), 1, cluster.address)
    finally:
        cluster.shutdown()


@pytest.mark.parametrize("address", ["127.0.0.1:1", "nowhere", "127.0.0.1:99999", ":", "ray://127.0.0.1:1"])
def test_an_address_that_does_not_answer_is_named(address: str) -> None:
    pytest.importorskip("ray", reason="Ray is not installed; say: pip install '.[ray]'")
    with pytest.raises(ConfigError, match="does not answer") as refused:
        RayEngine(TaskLimits(), 1, address)
    assert address in str(refused.value)


@pytest.mark.parametrize("said", [b"", b"HTTP/1.1 400 Bad Request\r\n\r\n"], ids=["silent", "a web server"])
def test_what_listens_and_is_no_ray_is_not_waited_for(monkeypatch: pytest.MonkeyPatch, said: bytes) -> None:
    pytest.importorskip("ray", reason="Ray is not installed; say: pip install '.[ray]'")
    monkeypatch.setattr(ray_engine, "_ANSWERING", 0.5)
    with socket.create_server(("127.0.0.1", 0)) as server:

        def answer() -> None:
            line, _ = server.accept()
            lines.append(line)
            line.sendall(said)

        lines: list[socket.socket] = []
        threading.Thread(target=answer, daemon=True).start()
        with pytest.raises(ConfigError, match="does not answer"):
            RayEngine(TaskLimits(), 1, f"127.0.0.1:{server.getsockname()[1]}")
        lines[0].close()


def test_without_ray_its_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(ConfigError, match=r'needs the extra "ray"'):
        open_engine(TaskLimits(), 1, address="127.0.0.1:6379")
    assert isinstance(open_engine(TaskLimits(), 1), LocalEngine)
    with pytest.raises(ConfigError, match="leave out one of them"):
        open_engine(TaskLimits(), 1, engine="processes", address="127.0.0.1:6379")
