import os
import re
import sys
import time
from collections.abc import Iterator
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from frida_painter import registry
from frida_painter.errors import Interrupted
from frida_painter.session.events import Failed
from frida_painter_studio import worker_process
from frida_painter_studio.studio_folder import FeedReader, PaintingFolder, working
from frida_painter_studio.web_app_easel import WebAppEasel
from frida_painter_studio.workers import Workers
from plugins import install

ENDING = """#!{python} -I
import os, sys, time
os.close(int(sys.argv[-2]))  # the work is done, and the lock free; the process takes its time to end
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


@pytest.mark.parametrize(
    ("whose", "says"),
    [
        ("a package's", r"The package sad-parts failed \(ValueError: no goal; sad_goal.py, line 2\); mend it"),
        ("ours", "Something went wrong that should not have; its number in the log is"),
    ],
)
def test_the_page_is_told_whose_part_failed(
    whose: str, says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(*order: object) -> None:
        raise ValueError("no goal")

    module = "def fail(*order):\n    raise ValueError('no goal')\n"
    install(tmp_path, monkeypatch, "sad-parts", {registry.OBJECTIVES: {"sad": "sad_goal:fail"}}, {"sad_goal": module})
    failing = fail if whose == "ours" else EntryPoint("sad", "sad_goal:fail", "").load()
    monkeypatch.setattr("frida_painter_studio.worker.work", failing)
    folder = PaintingFolder(tmp_path / "painting")
    folder.path.mkdir()
    lock = os.open(tmp_path, os.O_RDONLY)
    easel = WebAppEasel(tmp_path / "record.json").to_json()
    monkeypatch.setattr(sys, "argv", ["worker", "paint", str(folder.path), "1", str(lock), easel])
    with pytest.raises(ValueError, match="no goal"):
        worker_process.main()
    (told,) = [event for event in FeedReader(folder.feed).read() if isinstance(event, Failed)]
    assert re.match(says, told.reason)
    assert "Traceback" in capsys.readouterr().err, "the log has the whole of it"
