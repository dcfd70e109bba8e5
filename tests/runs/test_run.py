"""One painting from Python: planned, painted, and gone on with."""

import json
import shutil
import threading
import time
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from frida_painter.calibration import Calibration
from frida_painter.errors import ConfigError, Interrupted
from frida_painter.runs.painting_folder import RunRecord, history_of
from frida_painter.runs.run import PaintingRun
from frida_painter.runs.spec import RunSpec
from frida_painter.session.controls import Controls
from frida_painter.session.events import Began, Event, PaintsWanted, Planned, Stopped, StrokePainted
from frida_painter.session.loop import PaintingSession
from frida_painter.session.progress import Painting, PaintingProgress
from frida_painter.strokes.palette import from_hex
from frida_painter.system import images
from killing import began, kill_when
from support import data

SMALL = {"canvas": "120x90mm", "render_height": 64, "effort": 0.05, "brush": "fine", "colors": 2}


@pytest.fixture(scope="module")
def photo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("photos") / "coffee.jpg"
    Image.fromarray(data.coffee()).resize((120, 90)).save(path)
    return path


@pytest.fixture(scope="module")
def stopped(photo: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a painting of six strokes that a person stopped after the third; beside it, its picture then."""
    folder = tmp_path_factory.mktemp("stopped") / "painting"
    heard: list[Event] = []
    with stopping_after_three(photo, heard, folder) as run:
        outcome = run.start()
    assert outcome.painting is not None and outcome.painting.painted == 3 and outcome.trouble is None
    assert outcome.page == folder / "index.html"
    assert [it.done for it in heard if isinstance(it, StrokePainted)] == [1, 2, 3]
    shutil.copy(folder / "canvas.png", folder.parent)
    return folder


def stopping_after_three(photo: Path, heard: list[Event], folder: Path | None = None) -> PaintingRun:
    """A painting of six strokes that is stopped after the third."""
    stop = threading.Event()

    def hear(event: Event) -> None:
        heard.append(event)
        if isinstance(event, StrokePainted) and event.done == 3:
            stop.set()

    spec = RunSpec.of(goal=[{"image": str(photo)}], strokes=6, replans=1, **SMALL)
    return PaintingRun(spec, folder, listeners=[hear], controls=Controls(stop_asked=stop.is_set))


def test_the_same_seed_gives_the_same_strokes_planned_and_painted(photo: Path) -> None:
    heard: list[Event] = []
    spec = RunSpec.of(goal=[{"image": str(photo)}], strokes=6, replans=0, seed=3, **SMALL)
    with PaintingRun(spec) as run:
        alone = run.plan()
    with PaintingRun(spec, listeners=[heard.append]) as run:
        run.simulate()
    (painted,) = [event.plan for event in heard if isinstance(event, Planned)]
    assert torch.equal(painted.palette.color, alone.palette.color) and torch.equal(painted.paint, alone.paint)
    places = [sorted(map(tuple, plan.strokes.position.tolist())) for plan in (painted, alone)]
    assert places[0] == places[1], "only their order within a paint may differ: that of short ways"


def test_a_simulated_painting_is_the_same_and_leaves_no_file(
    photo: Path, stopped: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    heard: list[Event] = []
    with stopping_after_three(photo, heard) as run:
        painting = run.simulate()
    assert painting.painted == 3 and [it.done for it in heard if isinstance(it, StrokePainted)] == [1, 2, 3]
    with Image.open(stopped.parent / "canvas.png") as painted:
        assert np.array_equal(np.asarray(painted), images.to_uint8(painting.photograph))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("ground", ["#807060", "auto"])
def test_a_painting_begins_on_its_ground(photo: Path, ground: str) -> None:
    heard: list[Event] = []
    spec = RunSpec.of(goal=[{"image": str(photo)}], strokes=3, replans=1, ground=ground, **SMALL)
    with PaintingRun(spec, listeners=[heard.append]) as run:
        painting = run.simulate()
        chosen = from_hex("#ffffff" if run.spec.ground == "white" else run.spec.ground)
        (plan,) = (event.plan for event in heard if isinstance(event, Planned) and event.done == 0)
        assert torch.equal(torch.tensor(plan.ground), chosen) and torch.equal(run.planner.bare[:, 0, 0], chosen)
    wanted = [event.colors for event in heard if isinstance(event, PaintsWanted) and event.ground]
    assert wanted == ([] if run.spec.ground == "white" else [(run.spec.ground,)])
    near = (painting.photograph - chosen[:, None, None]).abs().amax(0) < 0.06
    assert float(near.float().mean()) > 0.25, "three strokes leave much of it to be seen"


def test_what_would_move_a_real_robot_is_not_simulated(photo: Path) -> None:
    spec = RunSpec.of(goal=[{"image": str(photo)}], strokes=6, robot="human", **SMALL)
    with PaintingRun(spec) as run, pytest.raises(ConfigError, match="'human'; use start"):
        run.simulate()


def test_a_stopped_painting_is_gone_on_with_to_its_last_stroke(stopped: Path) -> None:
    assert history_of(stopped).progress.painted == 3
    with PaintingRun.reopen(stopped) as run:
        assert run.history is not None and run.spec.strokes == 6
        outcome = run.resume()
    assert outcome.painting is not None and outcome.painting.painted == 6
    result = json.loads((stopped / "result.json").read_text())
    assert result["strokes_painted"] == 6 and result["sittings"] == 2 and history_of(stopped).end.finished
    checked = RunRecord.load(stopped).check()
    assert "resumed" in checked.obstacle and not checked.files and "as it was left" in checked.remark


def test_only_a_look_tells_how_much_of_a_stroke_that_was_given_up_is_on_the_canvas(
    photo: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    killed = tmp_path / "killed"
    spec = RunSpec.of(goal=[{"image": str(photo)}], strokes=3, replans=0, **SMALL)
    kill_when(killed / "journal", began(2), PaintingRun(spec, killed).start)
    until = time.monotonic() + 60
    while list(killed.rglob(".*-reserve")) and time.monotonic() < until:  # the easel's process ends after the painter's
        time.sleep(0.05)
    states: list[PaintingProgress] = []

    def keep(session: PaintingSession, where: PaintingProgress) -> Painting:
        states.append(where)
        raise Interrupted("Enough.")

    monkeypatch.setattr(PaintingSession, "resume", keep)
    for number, repaint in enumerate((True, False)):
        with PaintingRun.reopen(shutil.copytree(killed, tmp_path / str(number))) as run:
            run.controls = Controls(repaint=lambda number, picture, repaint=repaint: repaint)  # type: ignore[misc]
            run.resume()
    again, given_up = states
    assert (again.painted, given_up.painted, given_up.canvas.left_out) == (1, 2, {1})
    assert (again.canvas.strokes, given_up.canvas.strokes) == (0, 2) and not len(given_up.batch)


def test_a_finished_painting_teaches_its_calibration_record(photo: Path, tmp_path: Path) -> None:
    wanted = RunSpec.of(goal=[{"image": str(photo)}], strokes=12, replans=1, film=False, **SMALL)
    with PaintingRun(wanted, tmp_path / "first") as run:
        outcome = run.start()
        placement = run.session.hand.placement if run.session else None
    assert outcome.trouble is None and outcome.calibration is None and placement is not None
    record = tmp_path / "easel.json"
    shutil.copy(tmp_path / "first" / "calibration.json", record)
    before = Calibration.load(record)
    with PaintingRun(wanted.with_values(calibration=record), tmp_path / "second") as run:
        outcome = run.start()
    assert outcome.calibration == record
    assert Calibration.load(record) == placement.correct(before, wanted.canvas) != before
    assert Calibration.load(tmp_path / "second" / "calibration.json") == before, "as it was painted by"


def test_stopped_before_there_is_a_plan_nothing_is_left_to_finish(photo: Path, tmp_path: Path) -> None:
    heard: list[Event] = []
    spec = RunSpec.of(goal=[{"image": str(photo)}], strokes=6, **SMALL)
    with PaintingRun(spec, tmp_path / "painting", listeners=[heard.append], controls=Controls(lambda: True)) as run:
        outcome = run.start()
    assert outcome.page is None and any(isinstance(event, Stopped) for event in heard)
    assert not any(isinstance(event, Began) for event in heard)
