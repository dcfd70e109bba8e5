import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from frida_painter.errors import Interrupted
from frida_painter.web.studio_folder import PaintingFolder, working
from frida_painter.web.web_app_easel import WebAppEasel
from frida_painter.web.workers import Workers

ENDING = """#!{python} -I
import os, sys, time
os.close(int(sys.argv[6]))  # the work is done, and the lock free; the process takes its time to end
time.sleep(60)
"""


@pytest.fixture
def workers(tmp_path: Path) -> Iterator[Workers]:
    opened = Workers(WebAppEasel(tmp_path / "record.json"))
    yield opened
    for one in opened._started:
        one.process.kill()
        one.process.wait()


def begin(workers: Workers, path: Path) -> PaintingFolder:
    folder = PaintingFolder(path)
    folder.path.mkdir(exist_ok=True)
    with workers.slot_at(folder) as slot:
        slot.start("plan", folder.plan(1))
    return folder


def stand_in(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, source: str) -> None:
    program = tmp_path / "worker"
    program.write_text(source.format(python=sys.executable))
    program.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(program))


def test_workers_that_have_done_their_work_and_take_their_time_to_end_keep_nobody_out(
    workers: Workers, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stand_in(monkeypatch, tmp_path, ENDING)
    for number in range(4):
        folder = begin(workers, tmp_path / str(number % 2))
        patience = time.monotonic() + 30
        while working(folder) and time.monotonic() < patience:
            time.sleep(0.01)
    assert not workers.busy
    assert all(one.process.poll() is None for one in workers._started)


def test_a_third_painting_waits_while_two_are_at_work(
    workers: Workers, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stand_in(monkeypatch, tmp_path, "#!{python} -I\nimport time\ntime.sleep(60)\n")
    for name in ("one", "two"):
        begin(workers, tmp_path / name)
    assert workers.busy
    with pytest.raises(Interrupted, match="busy with other paintings"):
        begin(workers, tmp_path / "three")
    with pytest.raises(Interrupted, match="on this painting already"):
        begin(workers, tmp_path / "one")
