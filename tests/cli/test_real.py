"""Paintings from the command line on a real easel: a GRBL that is played, and a camera that fills a folder."""

import json
import shutil
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from frida_painter.calibration import Calibration
from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.open import open_easel
from frida_painter.easel.order import EaselOrder
from frida_painter.hardware.gcode import Gcode
from frida_painter.hardware.workcell import WorkcellConfig, example
from frida_painter.session.fold import PaintingState
from frida_painter.system.event_log import EventLog
from frida_painter_drivers.gcode import GcodeRobot
from killing import kill_when
from machines.grbl import GRBLHAL, QUICK, GrblController
from machines.simulated_time import Living
from support import data
from support.commandline import Command

SIZE = (120, 160)  # rows, columns of a photograph
SMALL = ("--render-height", 64, "--effort", 0.05, "--brush", "fine", "--colors", 1, "--strokes", 4, "--replans", 0)
Run = Callable[..., tuple[int, str]]


class Photographer:
    """Puts a photograph of a bare canvas on a dark table into a folder, again and again."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._noise = np.random.default_rng(0)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> "Photographer":
        self.folder.mkdir()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()

    def _run(self) -> None:
        number = 0
        while not self._over.wait(0.3):
            picture = np.full((*SIZE, 3), 60.0)
            picture[10:110, 10:150] = 225
            picture += self._noise.normal(0, 1.5, picture.shape)
            hidden = self.folder / ".next.png"
            Image.fromarray(picture.round().clip(0, 255).astype(np.uint8)).save(hidden)
            hidden.rename(self.folder / f"shot-{number:04d}.png")
            number += 1


@pytest.fixture
def easel(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder with a workspace, its calibration record, a photo to paint, and one that a camera fills."""
    monkeypatch.chdir(tmp_path)
    text = example().replace("width = 0.3556", "width = 0.14").replace("height = 0.2794", "height = 0.1")
    (tmp_path / "easel.toml").write_text(text)
    workcell = WorkcellConfig.load(tmp_path / "easel.toml")
    corners = ((9.5, 9.5), (149.5, 9.5), (149.5, 109.5), (9.5, 109.5))
    shots = f"folder:{tmp_path / 'shots'}"
    record = workcell.calibration("fine", SIZE, shots)
    record = record.with_canvas(corners, SIZE, camera=shots, canvas=workcell.canvas, residual=0.1)
    record = record.with_robot(record.placement, residual=0.0004).with_color(record.color, residual=1.0)
    record = record.with_brush("fine", record.touch_height, record.press_height, protrusion=None, residual=0.0002)
    record.save(tmp_path / "cal.json")
    Image.fromarray(data.coffee()).resize((140, 100)).save(tmp_path / "coffee.png")
    with Photographer(tmp_path / "shots"):
        yield tmp_path
    shutil.rmtree(tmp_path / "shots")


@pytest.fixture
def run(call: Command) -> Run:
    """run(word, ..., typing=[...]): exit status, and what was said, on one line."""
    return lambda *words, **typing: call(*words, **typing).briefly


def on(port: str) -> tuple[object, ...]:
    seen = ("--camera", "folder:shots", "--calibration", "cal.json")
    return ("--robot", f"gcode:{port}", "--workspace", "easel.toml", *seen)


STANDS = np.array([100.0, -250.0, 250.0])
FAST = {**QUICK, "112": 8000.0, "120": 3000.0, "121": 3000.0, "122": 3000.0}


class Grbl(Living):
    """A machine that somebody has set up, and whose zero was found; its tip stands at `STANDS` in mm."""

    def __init__(self) -> None:
        self.machine = GrblController(GRBLHAL, FAST)
        self.machine.slip = STANDS.copy()
        super().__init__(self.machine, pace=60)

    def __enter__(self) -> "Grbl":
        super().__enter__()
        robot = GcodeRobot(self.name, (0.0, 0.0, 0.25), Gcode())
        robot.connect()
        robot.set_zero(STANDS / 1000)
        robot.close()
        return self

    @property
    def moved(self) -> list[np.ndarray]:
        return self.machine.moved

    @property
    def received(self) -> list[str]:
        return self.machine.received


def told(folder: Path) -> PaintingState:
    return PaintingState.of_journal(EventLog.read(folder / "journal"), folder)


def test_a_person_paints_as_they_are_asked_and_is_asked_for_everything(run: Run, easel: Path) -> None:
    shots = f"folder:{easel / 'shots'}"
    size = CanvasSize(0.14, 0.1)
    known = open_easel(EaselOrder("human", size, ("fine",), easel, camera=shots)).easel.calibration
    corners = ((9.5, 9.5), (149.5, 9.5), (149.5, 109.5), (9.5, 109.5))
    replace(known, photograph=SIZE).with_canvas(corners, SIZE, camera=shots, canvas=size, residual=0.1).save(
        easel / "hand.json"
    )
    seen = ("--robot", "human", "--camera", "folder:shots", "--calibration", "hand.json", "--canvas", "140x100mm")
    words = ("paint", "coffee.png", *SMALL, *seen, "--out", "mine", "--strokes", 3)
    look, mix, one_by_one, left_out, wash = "y", "y", "n", ["n", "y"], "y"
    status, said = run(*words, typing=[look, mix, one_by_one, "y", *left_out, "y", look, wash])
    assert status == 0, said
    said = " ".join(said.split())
    assert said.count("Dip the brush into paint 1 (#") == 1 and said.count("Painted?") == 3
    assert "Mix these paints" in said and said.count("hands, brush and shadow") == 2 and "Wash the brush and" in said
    assert told(easel / "mine").progress.painted == 3 and (easel / "mine" / "question.png").exists()
    result = json.loads((easel / "mine" / "result.json").read_text())
    assert result["strokes_given_up"] == [2] and told(easel / "mine").progress.given_up == [2]
    assert "3 strokes" in said and (easel / "mine" / "painting.png").exists()
    status, said = run(*words[:-4], "--out", "given-up", "--strokes", 3, typing=[look, mix, one_by_one, "y", "n", "n"])
    assert status == 2 and "put the brush down" in said and "resume given-up" in said
    assert (easel / "given-up" / "index.html").exists() and told(easel / "given-up").progress.in_doubt == 2


def test_a_painting_on_a_real_easel_waits_for_the_wells_and_is_resumed_on_the_same_robot(run: Run, easel: Path) -> None:
    with Grbl() as grbl:
        status, said = run("paint", "coffee.png", *SMALL, *on(grbl.name), "--no-film", "--out", "it", typing=["n"])
        assert status == 2 and "paints were not there" in said.replace("\n", " ")
        assert told(easel / "it").progress.painted == 0 and not any("Z118" in line for line in grbl.received)
        status, said = run("resume", "it", "--yes", "--robot", f"marlin:{grbl.name}")
        assert status == 2 and "only says where that robot is" in said.replace("\n", " ")
        status, said = run("resume", "it", "--yes", "--robot", f"gcode:{grbl.name},baud=57600")
        assert status == 0, said
        history = told(easel / "it")
        assert history.end.finished and history.progress.painted == 4 and history.sittings.count == 2
    pressed = [place for place in grbl.moved if place[0] > 300 and place[2] < 120.5]
    assert pressed, "it painted on the canvas"
    assert min(place[2] for place in grbl.moved) >= 107.9


RACK = """
[rack]
places = { fine = [0.12, 0.26, 0.118], medium = [0.20, 0.26, 0.118] }
slide = [0.0, -0.05]
lift = 0.04
"""
TWO = ("--brushes", "fine:50%,medium:50%", "--no-new-paints", "--drying", 0, "--no-film")


@pytest.fixture
def racked(easel: Path) -> Path:
    """The same easel with a rack of two brushes, both of which are calibrated."""
    (easel / "easel.toml").write_text((easel / "easel.toml").read_text() + RACK)
    record = Calibration.load(easel / "cal.json")
    record = record.with_brush("medium", record.touch_height, record.press_height, protrusion=None, residual=0.0002)
    record.save(easel / "cal.json")
    return easel


def held(folder: Path) -> list[str | None]:
    return [one["brush"] for one in EventLog.read(folder / "journal") if one["kind"] == "brush_in_hand"]


def test_a_robot_with_a_rack_changes_its_brush_by_itself(run: Run, racked: Path) -> None:
    with Grbl() as grbl:
        status, said = run("paint", "coffee.png", *SMALL, *TWO, *on(grbl.name), "--out", "it", typing=["y"])
        assert status == 0, said
    assert held(racked / "it") == [None, "fine", None, "", None, "medium", None, ""]
    assert told(racked / "it").end.finished and "put it, clean" not in said
    sent = [line.split("F")[0] for line in grbl.received if "Z118.000" in line]
    for x in (120, 200):
        assert sent.count(f"G1X{x}.000Y260.000Z118.000") == 2, "each was taken and put back"
        assert sent.count(f"G1X{x}.000Y210.000Z118.000") == 2, "through the open side of its fork"
    status, said = run("check", "it", "--workspace", "easel.toml")
    assert status == 0 and "changing brushes" in said


def test_killed_while_it_changes_brushes_a_person_is_asked_which_is_in_the_hand(
    run: Run, racked: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Fault F1: the painting process is killed."""
    with Grbl() as grbl:
        words = ("paint", "coffee.png", *SMALL, *TWO, *on(grbl.name), "--out", racked / "it", "--yes")

        def back(record: dict[str, Any]) -> bool:
            return record["kind"] == "motion_began" and record["what"] == ["put the fine brush back"]

        kill_when(racked / "it" / "journal", back, lambda: run(*words))
        assert told(racked / "it").brush.held is None
        moved = len(grbl.moved)
        status, said = run("resume", "it", "--yes")
        assert status == 2 and "which brush is in its hand" in " ".join(said.split()), said
        assert len(grbl.moved) == moved, "nothing moved"
        monkeypatch.setattr("frida_painter_cli.leading.confirm", lambda *_, **__: True)  # the arm may lift
        in_hand, wells = "y", "y"
        status, said = run("resume", "it", typing=[in_hand, wells])
        assert status == 0, said
    assert "Is the fine brush in the robot's hand?" in " ".join(said.split())
    assert held(racked / "it") == [None, "fine", None, None, "", None, "medium", None, ""]
    assert told(racked / "it").end.finished and told(racked / "it").progress.painted == 4


def test_a_brush_that_is_not_in_the_rack_is_refused_before_anything_moves(run: Run, racked: Path) -> None:
    text = (racked / "easel.toml").read_text().replace("fine = [", "broad = [")
    (racked / "easel.toml").write_text(text)
    with Grbl() as grbl:
        status, said = run("paint", "coffee.png", *SMALL, *on(grbl.name), "--no-film", "--out", "it", "--yes")
        assert status == 2 and "holds broad, medium, and this painting needs fine" in " ".join(said.split())
        assert grbl.moved == []
