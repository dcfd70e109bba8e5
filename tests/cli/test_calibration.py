from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from frida_painter.brush.weights import load_stroke_model
from frida_painter.calibration import OF_A_BRUSH, Calibration
from frida_painter.canvas_size import CanvasSize
from frida_painter.objectives.image import ImageTerm
from frida_painter.objectives.objective import Goal
from frida_painter.runs.settle import open_planner
from frida_painter.runs.spec import RunSpec
from frida_painter.virtual.studio import open_studio
from frida_painter_calibration.calibrating import default_record
from support.commandline import Command

TRUE_PHOTOGRAPHS = True

STUDIO = ("--canvas", "160x120mm", "--brush", "fine", "--seed", "3")
ASKEW = ("--placement-error", "4mm,2deg")


@pytest.fixture(scope="module")
def photo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("photos") / "grey.png"
    Image.fromarray(np.full((30, 40, 3), 128, np.uint8)).save(path)
    return path


def test_procedures_are_entered_one_by_one_and_the_doctor_tells_how_they_stand(call: Command, tmp_path: Path) -> None:
    record = ("--record", "cal.json")
    assert call("doctor", *STUDIO)[0] == 0, "the studio paints without a record"
    status, out, _ = call("calibrate", "canvas", *STUDIO, *ASKEW, *record)
    assert status == 0 and "The canvas was found" in out
    status, out, _ = call("calibrate", "robot", *STUDIO, *ASKEW, *record)
    assert status == 0 and "6 dots" in out
    known = Calibration.load(tmp_path / "cal.json")
    assert list(known.done) == ["canvas", "robot"] and known.easel == "virtual studio 3"
    assert known.placement[0][2] < -0.001
    assert {path.name for path in tmp_path.iterdir()} == {
        "cal.json", "cal.json.prev", "cal-canvas.png", "cal-robot.png"
    }  # fmt: skip
    status, out, _ = call("doctor", *STUDIO, *record)
    assert status == 0 and "would go ahead" in out and out.count("good") == 2 and out.count("never done") == 3
    assert call("calibrate", "canvas", *STUDIO, *ASKEW, *record)[0] == 0
    status, out, _ = call("doctor", *STUDIO, *record)
    assert status == 1 and "would be refused" in out and "frida-painter calibrate robot" in out


def test_the_heights_of_a_canvas_come_from_its_marks_or_from_a_file(call: Command, tmp_path: Path) -> None:
    record = ("--brush", "fine", "--canvas", "200x200mm", "--record", "cal.json")
    status, out, err = call("calibrate", "surface", *record, "--marks", "--points", 2)
    assert status == 0 and "(4 points)" in out and "cal-surface.png" in out, err
    surface = Calibration.load(tmp_path / "cal.json").surface
    assert surface is not None and -0.001 < surface.lowest <= surface.highest < 0.001, "the studio's canvas is flat"
    (tmp_path / "map.toml").write_text(
        "across = [0.01, 0.19]\nup = [0.01, 0.19]\nheight = [[0.12, 0.121], [0.12, 0.12]]"
    )
    status, out, err = call("calibrate", "surface", *record, "--heights", "map.toml")
    assert status == 0 and "(4 points)" in out, err
    assert Calibration.load(tmp_path / "cal.json").surface != surface
    status, _, err = call("calibrate", "canvas", *record, "--heights", "map.toml")
    assert status == 2 and "are for calibrate surface" in err


def test_all_five_are_done_in_order(call: Command, tmp_path: Path) -> None:
    status, out, err = call("calibrate", "all", "--brush", "fine", "--count", 12, "--record", "cal.json")
    assert status == 0, err
    known = Calibration.load(tmp_path / "cal.json")
    assert list(known.done) == ["canvas", "robot", "color", "brush", "strokes"]
    assert known.library is not None and Path(known.library.path).is_absolute()
    assert known.weights is not None
    learned = load_stroke_model(Path(known.weights.path))
    spec = RunSpec.of(brush="fine", render_height=64, calibration=tmp_path / "cal.json")
    planner = open_planner(spec, Goal((ImageTerm(torch.rand(3, 20, 20)),)))
    shape = torch.tensor([0.5]), torch.tensor([0.02]), torch.tensor([0.0])
    assert (planner.models["fine"](*shape) - learned(*shape)).abs().mean() < 0.01
    assert (planner.models["fine"](*shape) - load_stroke_model("fine")(*shape)).abs().mean() > 1e-4
    for name in known.done:
        picture = tmp_path / f"cal-{name}{'-fine' if name in OF_A_BRUSH else ''}.png"
        assert f"{name}: " in out and picture.exists() == (name != "color")
    status, out, _ = call("doctor", "--brush", "fine", "--record", "cal.json")
    assert status == 0 and out.count("good") == 5


@pytest.fixture
def record(tmp_path: Path) -> Path:
    """A record of the studio in which nothing was measured yet."""
    path = tmp_path / "cal.json"
    open_studio(CanvasSize(0.16, 0.12), "fine", seed=3).easel.calibration.save(path)
    return path


@pytest.mark.parametrize("command", ["paint", "doctor", "calibrate"])
def test_a_damaged_record_is_refused(call: Command, record: Path, photo: Path, command: str) -> None:
    record.write_bytes(record.read_bytes().replace(b"0.12", b"0.13", 1))
    before = record.read_bytes()
    words = {
        "paint": (photo, "--strokes", 5, "--calibration", record, "--render-height", 64),
        "doctor": ("--record", record),
        "calibrate": ("canvas", "--record", record),
    }[command]
    status, out, err = call(command, *words, *STUDIO)
    assert (status, "calibrate all" in out + err) == (1 if command == "doctor" else 2, True)
    assert record.read_bytes() == before and not (record.parent / "paintings").exists()


@pytest.mark.parametrize(
    ("studio", "says"),
    [
        (("--brush", "medium", "--seed", 3, "--canvas", "160x120mm"), "calibrate brush"),
        (("--brush", "fine", "--seed", 3, "--canvas", "180x120mm"), "calibrate canvas"),
        (
            ("--brush", "fine", "--seed", 4, "--canvas", "160x120mm"),
            "'virtual studio 3', and this is 'virtual studio 4'",
        ),
    ],
)
def test_a_foreign_record_is_told_by_the_doctor(
    call: Command, record: Path, studio: tuple[object, ...], says: str
) -> None:
    status, out, _ = call("doctor", "--record", record, *studio)
    assert status == 1 and says in out


def test_with_a_foreign_record_nothing_is_begun(call: Command, record: Path, photo: Path) -> None:
    studio = ("--brush", "fine", "--seed", 4, "--canvas", "160x120mm")
    status, _, err = call("paint", photo, "--strokes", 5, "--calibration", record, "--render-height", 64, *studio)
    assert status == 2 and "'virtual studio 3', and this is 'virtual studio 4'" in err and err.count("\n") == 1
    assert not (record.parent / "paintings").exists(), "no folder is left behind"


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("walls",), "walls"),
        (("canvas", "--robot", "kuka"), "There is no robot 'kuka'; take human, virtual"),
        (("canvas", "--brush", "huge"), "no brush 'huge'"),
        (("canvas", "--canvas", "big"), "not understood"),
        (("robot", "--placement-error", "far"), "4mm,2deg"),
        (("strokes", "--count", "4"), "4 is not from 5"),
    ],
)
def test_what_cannot_be_meant_is_refused(call: Command, tmp_path: Path, words: tuple[str, ...], says: str) -> None:
    status, out, err = call("calibrate", *words, "--record", "cal.json")
    assert status == 2 and says in err and not out and not list(tmp_path.iterdir())


def test_without_a_file_every_easel_has_a_record_of_its_own() -> None:
    one, other = default_record("virtual studio 1"), default_record("virtual studio 2")
    assert one != other and one.is_absolute() and one.parts[-3:] == ("easels", "virtual-studio-1", "calibration.json")


def test_a_person_is_asked_where_they_want_to_be(
    call: Command, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    lines = iter(["where?", ""])
    monkeypatch.setattr("builtins.input", lambda *_: next(lines))
    status, out, err = call("calibrate", "canvas", "--ask", *STUDIO, "--record", "cal.json")
    assert status == 0 and "The canvas was found" in out and "eight numbers" in err
