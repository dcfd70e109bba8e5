"""Paintings of people without a camera: `--camera none` from the command line, on a simulated GRBL."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from frida_painter.hardware.gcode import Gcode
from frida_painter.hardware.workcell import example
from frida_painter.session.fold import PaintingState
from frida_painter.system.event_log import EventLog
from machines.bench import tell_zero
from machines.grbl import GRBL, QUICK, GrblController
from machines.simulated_time import Living
from support import data
from support.commandline import Command

SMALL = ("--render-height", 64, "--effort", 0.05, "--brush", "fine", "--colors", 1, "--strokes", 5)
BLIND = ("--workspace", "easel.toml", "--camera", "none")
Run = Callable[..., tuple[int, str]]


@pytest.fixture
def desk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a workspace and a photo to paint, and nothing that was ever calibrated."""
    monkeypatch.chdir(tmp_path)
    text = example().replace("width = 0.3556", "width = 0.14").replace("height = 0.2794", "height = 0.1")
    (tmp_path / "easel.toml").write_text(text)
    Image.fromarray(data.coffee()).resize((140, 100)).save(tmp_path / "coffee.png")
    return tmp_path


@pytest.fixture
def run(call: Command) -> Run:
    """run(word, ..., typing=[...]): exit status, and what was said, on one line."""
    return lambda *words, **typing: call(*words, **typing).briefly


def told(folder: Path) -> PaintingState:
    return PaintingState.of_journal(EventLog.read(folder / "journal"), folder)


BEGINS = (0.1, -0.25, 0.25)  # where the tip stands first, metres


@pytest.fixture
def grbl() -> Iterator[Living]:
    controller = GrblController(GRBL, QUICK)
    controller.queue.tick = 0.02
    with Living(controller, pace=200, step=0.02) as machine:
        tell_zero(Gcode("grbl", 0.1), machine.name, BEGINS)
        yield machine


def test_a_missing_camera_is_answered_with_the_way_to_paint_without_one(run: Run, desk: Path) -> None:
    status, said = run("paint", "coffee.png", *SMALL, "--robot", "gcode:/dev/none", "--workspace", "easel.toml")
    assert status == 2 and "Without a camera, say --camera none" in said


@pytest.mark.parametrize(
    ("more", "says"),
    [
        (("--replans", 2), "--replans 2 was given, and with --camera none nobody looks at the canvas"),
        (("--replan-policy", "every:3"), "--replan-policy every:3 was given, and with --camera none nobody looks"),
        (("--on-canvas",), "--on-canvas begins on what a camera sees"),
        (("--camera", "none:0"), "write --camera none"),
    ],
)
def test_what_needs_a_camera_is_refused_without_one(run: Run, desk: Path, more: tuple[object, ...], says: str) -> None:
    status, said = run("paint", "coffee.png", *SMALL, "--robot", "gcode:/dev/none", *BLIND, *more)
    assert status == 2 and says in said
    assert not (desk / "paintings").exists()


def test_the_canvas_is_traced_in_the_air_before_anything_is_painted(run: Run, desk: Path, grbl: Living) -> None:
    status, said = run("trace", "--robot", f"gcode:{grbl.name}", "--workspace", "easel.toml", "--yes")
    assert status == 0 and "side 4 of 4 of the canvas" in said and "30 mm above it" in said, said
    seen = np.array(grbl.controller.moved) + 1000 * np.array(BEGINS)
    for x, y in ((300, -100), (440, -100), (440, 0), (300, 0)):
        assert np.linalg.norm(seen - (x, y, 150), axis=1).min() < 0.01, "the tip was above that corner"
    assert seen[:, 2].min() >= 149.9


def test_without_a_camera_the_plan_is_painted_and_everything_says_that_nobody_looked(
    run: Run, desk: Path, grbl: Living
) -> None:
    robot = ("--robot", f"gcode:{grbl.name}")
    status, said = run("paint", "coffee.png", *SMALL, *robot, *BLIND, "--out", "it", "--yes")
    assert status == 0 and "No camera: nobody looks at the canvas." in said, said
    assert "it/painting.png, as expected: nobody looked" in said and "it/film.mp4, as expected" in said
    assert told(desk / "it").pictures.count == 0
    assert told(desk / "it").end.finished and told(desk / "it").progress.painted == 5
    page = (desk / "it" / "index.html").read_text()
    assert "as it should look; nobody photographed it" in page and "nobody filmed the canvas" in page
    assert "no camera; only at pictures of a person" in page and "The painting against the photograph" not in page
    result = json.loads((desk / "it" / "result.json").read_text())
    assert result["photographed"] is False and result["looks"] == [] and result["strokes_painted"] == 5
    painting = np.asarray(Image.open(desk / "it" / "painting.png").convert("L"), np.float32)
    assert painting.min() < 200 < painting.max(), "it shows the strokes"
    status, said = run("check", "it", "--workspace", "easel.toml")
    assert status == 0 and said.startswith("No camera: nobody looks")
    (desk / "it" / "painting.png").unlink()
    status, said = run("resume", "it")
    assert status == 0 and "made again" in said and "as expected: nobody looked" in said
    assert (np.asarray(Image.open(desk / "it" / "painting.png").convert("L")) == painting).mean() > 0.99
