import os
import signal
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import pytest

from frida_painter.easel import watchdog
from frida_painter.easel.watchdog import CpuActivity


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="the system does not tell of other processes")
def test_a_process_that_was_stopped_is_told_from_one_that_computes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(watchdog, "_LOOK_EVERY", 0.1)
    with subprocess.Popen([sys.executable, "-c", "while True: pass"]) as busy:
        try:
            asked = CpuActivity(busy.pid)

            def becomes(what: bool) -> bool:
                deadline = time.monotonic() + 60
                while asked.thinking() is not what and time.monotonic() < deadline:
                    time.sleep(0.02)
                return asked.thinking() is what

            assert becomes(True)
            busy.send_signal(signal.SIGSTOP)
            assert becomes(False)
            busy.send_signal(signal.SIGCONT)
            assert becomes(True)
        finally:
            busy.kill()


def test_of_a_process_that_is_gone_nothing_is_believed() -> None:
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    asked = CpuActivity(gone.pid)
    time.sleep(0.6)
    assert not asked.thinking() and asked.starved_seconds() == 0.0


@pytest.mark.skipif(not Path("/proc/self/schedstat").exists(), reason="the system does not count waits")
def test_what_waits_for_a_processor_is_told_from_what_waits_for_nothing() -> None:
    """Two busy processes that share one processor: each is ready about half of the time. A third one sleeps."""
    here = [min(os.sched_getaffinity(0))]
    with ExitStack() as stack:

        def start(program: str) -> CpuActivity:
            process = stack.enter_context(subprocess.Popen([sys.executable, "-c", program]))
            stack.callback(process.kill)
            os.sched_setaffinity(process.pid, here)
            return CpuActivity(process.pid)

        first, _ = start("while True: pass"), start("while True: pass")
        sleeper = start("import time; time.sleep(600)")
        time.sleep(1.0)  # by then it sleeps, on a busy computer too
        before = first.starved_seconds(), sleeper.starved_seconds()
        deadline = time.monotonic() + 60
        while first.starved_seconds() - before[0] < 0.5:
            sleeper.starved_seconds()
            assert time.monotonic() < deadline, "nothing was counted"
            time.sleep(0.05)
        assert sleeper.starved_seconds() - before[1] < 0.1


def test_a_wait_that_lasts_is_counted_before_the_system_counts_it_and_only_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked, now = CpuActivity(os.getpid()), [1000.0]
    monkeypatch.setattr(watchdog, "steady", lambda: now[0])
    asked._place, asked._counted_at = tmp_path, 1000.0
    (tmp_path / "task" / "7").mkdir(parents=True)
    for state, ran, delayed, waited in (
        ("R", 7, 1.0, 0.0),
        ("R", 7, 1.0, 1.0),  # ready, and does not run: it waits
        ("R", 7, 1.0, 2.0),
        ("R", 9, 3.4, 3.0),  # it ran at last, and the system counts the whole wait
        ("S", 9, 3.4, 3.0),  # it sleeps
        ("T", 9, 3.4, 3.0),  # and was halted
        ("R", 10, 3.7, 3.3),  # it waited and ran since
    ):
        (tmp_path / "task" / "7" / "stat").write_text(f"7 (a name) {state} " + "0 " * 12)
        (tmp_path / "task" / "7" / "schedstat").write_text(f"{ran} {round(delayed * 1e9)} 5")
        now[0] += 1.0
        assert asked.starved_seconds() == pytest.approx(waited)
