"""Cleaning: whatever the program tidies up, a person's files beside its own stay as they are."""

import os
import sqlite3
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from frida_painter.brush import table
from frida_painter.brush.kinds import brush_kind
from frida_painter.easel.kinds import SIMULATION_LOG
from frida_painter.errors import RobotError, StorageError
from frida_painter.runs import run
from frida_painter.runs.look_folder import USED, GivenPicture, LookFolder
from frida_painter.system import storage
from frida_painter.system.event_log import EventLog
from frida_painter_calibration.procedures.strokes import Recording, order_of
from frida_painter_lab import commands
from frida_painter_lab.experiment import Experiment
from frida_painter_lab.runs import RunFolder
from frida_painter_studio import side_jobs, worker
from frida_painter_studio.store import PaintingStore
from frida_painter_studio.studio_folder import PaintingFolder
from marks import ribbon
from support.belongings import files_of_a_person, require_untouched
from support.plans import made_up_plan


def save_a_plan_again(folder: Path) -> None:
    for angle in (0.0, 0.1, 0.2):
        made_up_plan().edit(angle=angle).save(folder / "cat.json")


def clear_leftovers(folder: Path) -> None:
    storage.clear_leftovers(folder, folder / "photographs", folder / "sketchbook")


def tabulate(folder: Path) -> None:
    for spans in ((2, 3, 3), (2, 3, 4)):
        table.cached_table(ribbon(), table.TableDetail(spans=spans, rank=12), folder)
    assert len([path for path in folder.glob("*.safetensors") if len(path.stem) == 32]) == 1


def experiment(folder: Path) -> None:
    class Writing(Experiment):
        runs = measure = None

        def run_in_processes(self, keep: Path, notify: object, jobs: int | None = None) -> Any:
            storage.write_text(keep / "run.json", "{}")
            return SimpleNamespace(save=lambda where: None, title="", notes=(), pictures={})

    commands.conduct(Writing(), folder)
    assert not (folder / commands.UNFINISHED).exists()


def fail_to_open(folder: Path) -> None:
    for made in (True, False):
        with pytest.raises(RobotError), run._take_back_on_failure(folder, made=made):
            EventLog.begin(folder / SIMULATION_LOG, {}).close()
            raise RobotError("no robot")
    assert not (folder / SIMULATION_LOG).exists()


def calibrate_again(folder: Path) -> None:
    EventLog.begin(folder / SIMULATION_LOG, {}).close()
    worker._make_ready(folder)
    assert not (folder / SIMULATION_LOG).exists()


def make_pictures(folder: Path) -> None:
    (folder / "live").mkdir()
    for number in range(12):
        place = folder / "made" / f"{number:024x}"
        storage.write_text(place / "a-1.png", "")
        storage.write_text(place / ("mine.png" if number == 0 else "a-2.png"), "")
        storage.write_json(
            place / "making.json", {"pictures": [{"file": "a-1.png"}, {"file": "a-2.png"}, {"file": "../../notes.txt"}]}
        )
        os.utime(place, (number, number))
    side_jobs._forget_old(PaintingFolder(folder))
    assert len(list((folder / "made").iterdir())) == 8, "the newest seven, and the one with a person's picture"
    assert [path.name for path in (folder / "made" / f"{0:024x}").iterdir()] == ["mine.png"]


def fail_and_do_a_run(folder: Path) -> None:
    place = RunFolder(folder.parent, "key")
    place.path = folder
    place.keep_failure({})
    place.keep({})


def keep_a_log(folder: Path) -> None:
    EventLog.begin(folder / "journal", {}).close()


@pytest.mark.parametrize(
    "clean",
    [
        save_a_plan_again, clear_leftovers, tabulate, experiment, fail_to_open, calibrate_again, make_pictures,
        fail_and_do_a_run, keep_a_log,
    ],
    ids=lambda clean: clean.__name__,
)  # fmt: skip
def test_a_persons_files_stay(clean: Callable[[Path], None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(table, "_MAX_KEPT", 1)
    monkeypatch.chdir(tmp_path)
    own = files_of_a_person(tmp_path / "it")
    clean(tmp_path / "it")
    require_untouched(own)


def test_a_folder_of_a_person_stays_if_no_easel_opens(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for made in (False, True):
        (tmp_path / "mine" / "empty").mkdir(parents=True, exist_ok=True)
        with pytest.raises(RobotError), run._take_back_on_failure(tmp_path / "mine" / "empty", made=made):
            raise RobotError("no robot")
        assert (tmp_path / "mine" / "empty").exists() is not made and (tmp_path / "mine").exists()


def test_a_recording_is_not_begun_among_other_files(tmp_path: Path) -> None:
    own = files_of_a_person(tmp_path)
    order = order_of("virtual", brush_kind("fine"), 3, 0, 1)
    with pytest.raises(StorageError):
        Recording(tmp_path, order, (4, 8))
    require_untouched(own)


@pytest.mark.parametrize("blocked", [False, True])
def test_no_picture_of_a_person_is_lost_on_its_way_out_of_looks(tmp_path: Path, blocked: bool) -> None:
    looks = LookFolder(tmp_path)
    (looks.path / ("" if blocked else USED)).mkdir(parents=True)
    if blocked:
        (looks.path / USED).touch()  # so that nothing can be moved there
    for time, content in enumerate(("one", "two", "three"), 1):
        (looks.path / "canvas.jpg").write_text(content)
        os.utime(looks.path / "canvas.jpg", (time, time))
        looks._next = 0.0
        given = looks.take_next()
        assert given == GivenPicture(looks.path / "canvas.jpg")
        looks.file_away(given, USED)
        looks._next = 0.0
        assert looks.take_next() is None, "it is taken once"
        if blocked:
            assert given.path.read_text() == content
            given.path.unlink()
    kept = {path.name: path.read_text() for path in looks.path.glob(f"{USED}/*")}
    assert kept == ({} if blocked else {"canvas.jpg": "one", "canvas-2.jpg": "two", "canvas-3.jpg": "three"})


@pytest.mark.parametrize("folder", ["..", "../mine", "mine", "pictures", "/etc", "a/../../mine"])
def test_a_studio_deletes_only_folders_that_it_made(tmp_path: Path, folder: str) -> None:
    own = files_of_a_person(tmp_path / "mine")
    store = PaintingStore(tmp_path / "studio")
    entry = store.begin("a")
    with sqlite3.connect(tmp_path / "studio" / "studio.sqlite") as base:
        base.execute("UPDATE painting SET folder = ?", (folder,))
    edited = store.find(entry.id)
    assert edited is not None
    with pytest.raises(StorageError):
        store.delete(edited)
    require_untouched(own)
    assert entry.folder.path.exists()
    store.delete(entry)
    assert not entry.folder.path.exists()
