import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from frida_painter.hardware.link import cpu_activity
from frida_painter.hardware.link.cpu_activity import CpuActivity


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="the system does not tell of other processes")
def test_a_process_that_was_stopped_is_told_from_one_that_computes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cpu_activity, "_LOOK_EVERY", 0.1)
    with subprocess.Popen([sys.executable, "-c", "while True: pass"]) as busy:
        try:
            asked = CpuActivity(busy.pid)

            def becomes(what: bool) -> bool:
                deadline = time.monotonic() + 60
                while asked() is not what and time.monotonic() < deadline:
                    time.sleep(0.02)
                return asked() is what

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
    assert not asked()
