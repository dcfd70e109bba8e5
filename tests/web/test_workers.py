"""Worker processes, the easel that they are given, and the locks by which they are known."""

import json
import re
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from frida_painter import registry
from frida_painter.easel.kinds import state_folder
from frida_painter.errors import ConfigError, Interrupted
from frida_painter.hardware.workcell import example
from frida_painter.runs.painting_easel import order
from frida_painter.runs.spec import RunSpec
from frida_painter.session.events import Stopped
from frida_painter.system.event_log import LogReader
from frida_painter.system.messages import pack, unpack
from frida_painter_studio import worker_process
from frida_painter_studio.at_page import Feed, StopWatch
from frida_painter_studio.studio_folder import PaintingFolder, PaintingRequest, WorkerLock, read_events, working
from frida_painter_studio.web_app_easel import WebAppEasel
from frida_painter_studio.worker import Job
from frida_painter_studio.workers import Workers
from plugins import install

ENDING = """#!{python} -I
import os, sys, time
os.closerange(3, 100)  # the work is done, and the lock free; the process takes its time to end
time.sleep(60)
"""


@pytest.fixture
def workers(tmp_path: Path) -> Iterator[Workers]:
    opened = Workers(WebAppEasel(tmp_path / "record.json"))
    yield opened
    for process, _ in opened._started:
        process.kill()
        process.wait()


def begin(workers: Workers, path: Path) -> PaintingFolder:
    folder = PaintingFolder(path)
    folder.path.mkdir(exist_ok=True)
    with workers.slot_at(folder) as slot:
        slot.start("plan", folder.plan(1))
    return folder


def test_the_settings_of_a_plan_are_read_as_they_were_asked_for(workers: Workers, tmp_path: Path) -> None:
    folder = PaintingFolder(tmp_path / "painting")
    for width in (99.99995, 355.6, 1000 / 7):
        wish = PaintingRequest(together=True, width=width, height=120.0, brushes="fine")
        (plan,) = folder.begin_plans([wish], tmp_path)
        with workers.slot_at(folder) as slot:
            words = slot._words_to_paint(plan)
        assert RunSpec.from_toml(str(words[2])).canvas == wish.size


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
    assert all(process.poll() is None for process, _ in workers._started)


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
    easel = WebAppEasel(tmp_path / "record.json")
    with (tmp_path / "lock").open("wb") as lock, pytest.raises(ValueError, match="no goal"):
        worker_process.do_job.function("plan", folder.path, 1, lock, easel)
    (told,) = [event for event, _ in read_events(LogReader(folder.feed)) if isinstance(event, Stopped)]
    assert re.match(says, told.reason)
    assert "Traceback" in capsys.readouterr().err, "the log has the whole of it"


@pytest.mark.parametrize(
    ("robot", "says"), [("toaster", "no robot 'toaster'"), ("axidraw", "workspace file"), ("xarm:10.0.0.1", "camera")]
)
def test_what_cannot_paint_is_refused_before_the_page_opens(tmp_path: Path, robot: str, says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        WebAppEasel(tmp_path / "record.json", robot).validate()


@pytest.mark.parametrize(
    ("robot", "simulated", "dangerous"),
    [("virtual", True, False), ("sawyer-sim", True, False), ("human", False, False), ("axidraw", False, True)],
)
def test_whose_stops_hold_where(tmp_path: Path, robot: str, simulated: bool, dangerous: bool) -> None:
    easel = WebAppEasel(tmp_path / "record.json", robot, "opencv:0", tmp_path / "easel.toml", 0.5)
    assert (easel.simulated, easel.drives_machine) == (simulated, dangerous)
    assert unpack(json.loads(json.dumps(pack(easel, WebAppEasel, {}))), WebAppEasel, {}) == easel
    folder = PaintingFolder(tmp_path)
    feed, stop = Feed(folder.path), StopWatch(folder.stop, folder.path.parent)
    wish = PaintingRequest.model_validate({"terms": [{"kind": "text", "words": "a sea"}]})
    (plan,) = folder.begin_plans([wish], tmp_path)
    job = Job(folder, easel, feed, stop)
    wanted = order(wish.spec(easel, plan.path, folder.families), "broad", folder.painting, job.state)
    assert wanted.state == (folder.easel if simulated else state_folder())
    assert wanted.simulation.pace == (0.5 if simulated else 0.0) and wanted.folder == folder.painting


def test_the_canvas_is_the_one_of_the_workspace_file(tmp_path: Path) -> None:
    file = tmp_path / "easel.toml"
    file.write_text(example().replace("width = 0.3556", "width = 0.3"))
    easel = WebAppEasel(tmp_path / "record.json", "xarm:10.0.0.1", "opencv:0", file).validate()
    assert easel.canvas == pytest.approx((300, 279.4))
    file.write_text("canvas = 3")
    with pytest.raises(ConfigError, match="is no workspace"):
        easel.validate()


def test_a_record_counts_once_it_is_there(tmp_path: Path) -> None:
    easel = WebAppEasel(tmp_path / "record.json")
    assert easel.known is None and easel.canvas is None
    easel.record.write_text("{}")
    assert easel.known == easel.record


@pytest.mark.parametrize("job", ["plan", "paint"])
def test_a_stop_of_a_planner_is_none_of_a_robot(tmp_path: Path, job: str) -> None:
    folder = PaintingFolder(tmp_path / "cup")
    folder.painting.mkdir(parents=True)
    lock = WorkerLock(folder)
    assert lock.take()
    lock.sign(job)
    folder.stop_now()
    assert folder.stop.exists() and folder.robot_stop.exists() == (job == "paint")
    lock.release()


def test_a_painting_that_nobody_works_on_is_free(tmp_path: Path) -> None:
    folder = PaintingFolder(tmp_path)
    assert not working(folder)
    lock, other = WorkerLock(folder), WorkerLock(folder)
    assert lock.take() and not other.take() and working(folder)
    lock.release()
    assert other.take()
    other.release()
    assert not working(folder)


def test_somebody_who_only_looks_whether_it_is_free_keeps_nobody_out(tmp_path: Path) -> None:
    folder = PaintingFolder(tmp_path)
    looking, lock = WorkerLock(folder), WorkerLock(folder)
    assert looking.try_once()
    threading.Timer(0.2, looking.release).start()
    assert lock.take()
    lock.release()


def test_a_lock_that_was_handed_to_a_child_is_the_child_s_until_it_ends(tmp_path: Path) -> None:
    folder = PaintingFolder(tmp_path)
    lock = WorkerLock(folder)
    assert lock.take()
    child = subprocess.Popen(
        [sys.executable, "-c", "import sys; sys.stdin.read()"], stdin=subprocess.PIPE, pass_fds=[lock.fileno()]
    )
    with child:
        lock.release()
        assert working(folder), "the page lets go, or dies, and the worker goes on"
        child.kill()
    assert not working(folder)
