"""The package that readers are told to start from brings a robot, a camera and a stroke model that paint."""

import ast
import csv
import re
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from frida_painter.brush.kinds import StrokeFunction, brush_kind
from frida_painter.brush.library import StrokeLibrary
from frida_painter.brush.weights import load_stroke_model
from frida_painter.calibration import Calibration
from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.kinds import robot_forms
from frida_painter.easel.open import make_camera, make_robot
from frida_painter.easel.order import EaselOrder
from frida_painter.errors import CameraError, ConfigError
from frida_painter.hardware.workcell import WorkcellConfig, example
from frida_painter.objectives.objective import goal_kinds
from frida_painter.runs.spec import RunSpec
from frida_painter.session.replan_policy import looks_on_the_way, parse_replan_policy
from frida_painter.strokes.plan import Plan
from frida_painter.system import images
from frida_painter_cli import commands
from frida_painter_words.picture_makers.making import PictureRequest, open_picture_maker
from plugins import OWN_PARTS, install_own_parts
from session.easel_errands import easel_of, stroke
from support import data

SIZE = (120, 160)  # rows, columns of a photograph
# Stands for rpicam-still: photographs a bare canvas on a dark table, with noise, into the file after -o.
RPICAM = f"""#!{sys.executable}
import ast
import sys
import numpy as np
from PIL import Image
picture = np.full((120, 160, 3), 60.0)
picture[10:110, 10:150] = 225
picture += np.random.default_rng().normal(0, 1.5, picture.shape)
Image.fromarray(picture.round().clip(0, 255).astype(np.uint8)).save(sys.argv[sys.argv.index("-o") + 1])
"""
SMALL = ("--render-height", 64, "--effort", 0.05, "--colors", 1, "--strokes", 3, "--replans", 0, "--no-film")
Run = Callable[..., tuple[int, str]]


@pytest.fixture(autouse=True)
def table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, in_small_world: None) -> Iterator[Path]:
    """A folder with a workspace and a photo to paint; the package is installed, and so is the program of its camera."""
    install_own_parts(tmp_path / "installed", monkeypatch)
    (tmp_path / "bin").mkdir()
    program = tmp_path / "bin" / "rpicam-still"
    program.write_text(RPICAM)
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(program.parent), prepend=":")
    monkeypatch.chdir(tmp_path)
    text = example().replace("width = 0.3556", "width = 0.14").replace("height = 0.2794", "height = 0.1")
    (tmp_path / "easel.toml").write_text(text)
    Image.fromarray(data.coffee()).resize((140, 100)).save(tmp_path / "coffee.png")
    goal_kinds.cache_clear()
    yield tmp_path
    goal_kinds.cache_clear()


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """run(word, ...): exit status, and what was said."""

    def running(*words: object) -> tuple[int, str]:
        monkeypatch.setattr(sys, "argv", ["frida-painter", *map(str, words)])
        with pytest.raises(SystemExit) as end:
            commands.main()
        told = capsys.readouterr()
        return int(end.value.code or 0), " ".join((told.out + told.err).split())

    return running


def read(sheet: Path) -> list[dict[str, str]]:
    with sheet.open(newline="") as rows:
        return list(csv.DictReader(rows))


def test_help_doctor_and_errors_list_it(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    goal_kinds.cache_clear()
    _, said = run("paint", "--help-all")
    assert "--mirror" in said and "Make the painting its own mirror image" in said
    assert re.search(r",[\s│]*rosbridge,[\s│]*trace\.", said) and re.search(r"none,[\s│]*rpicam\.", said)
    status, said = run("doctor")
    assert status == 0 and "trace:FILE[,append=yes] a sheet of what" in said and "rpicam[:NUMBER] the camera of" in said
    assert "marker of own-parts" in said and "--mirror of own-parts" in said and "late of own-parts" in said
    status, said = run("calibrate", "canvas", "--robot", "kuka")
    assert status == 2 and "take human, virtual, sawyer-sim, or a real one: xarm:" in said
    assert "trace:FILE[,append=yes]" in said
    assert "trace:FILE[,append=yes]" in robot_forms()
    with pytest.raises(ConfigError, match="brushes are fine, medium, broad, marker"):
        brush_kind("broom")


def test_its_picture_maker_makes_pictures_of_words_and_seeds(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="between 0 and 1"):
        open_picture_maker("gradient:2")
    name, maker = open_picture_maker("gradient:0.5")
    places = [tmp_path / words for words in ("dawn", "dusk", "again")]
    made = []
    for place, words in zip(places, ("dawn", "dusk", "dawn"), strict=True):
        place.mkdir()
        files = maker.make(PictureRequest(words, (1, 2), 128, 64, place, torch.device("cpu"), 60.0))
        made.append([images.load(file) for file in files])
    assert name == "gradient" and maker.facts == {"horizon": "horizon at 0.5"}
    assert all(picture.shape == (3, 64, 128) for pictures in made for picture in pictures)
    assert torch.equal(made[0][0], made[2][0])
    assert not torch.equal(made[0][0], made[0][1]) and not torch.equal(made[0][0], made[1][0])


def test_its_policy_and_its_kind_of_goal_are_taken_by_name() -> None:
    policy = parse_replan_policy("late:0.5")
    assert looks_on_the_way(policy, 16) == [8, 12, 14, 15]
    with pytest.raises(ConfigError, match="between 0 and 1"):
        parse_replan_policy("late:nan")
    goal_kinds.cache_clear()
    assert goal_kinds()["mirror"].open_term("top-bottom", 2.0, beginning=False).weight == 2
    assert RunSpec.of(goal=[{"mirror": "left-right"}], replan_policy="late:0.25").replan_policy == "late:0.25"


@pytest.mark.usefixtures("fresh_easel")
def test_robot_and_camera_work_in_the_process_of_the_easel(table: Path) -> None:
    order = EaselOrder(
        f"trace:{table / 'sheet.csv'}", CanvasSize(0.14, 0.1), ("fine",), table, table,
        workspace=table / "easel.toml", camera="rpicam:1",
    )  # fmt: skip
    with easel_of(order) as (easel, _):
        path = stroke(easel, 1)
        report = easel.robot.follow(path)
        assert easel.camera.capture(report.finished_at).image.shape == (*SIZE, 3)
    rows = read(table / "sheet.csv")
    assert [row["motion"] for row in rows] == ["stroke 1"] * len(path.position)
    np.testing.assert_allclose([[float(row[axis]) for axis in "xyz"] for row in rows], path.position)


def test_names_that_make_no_sense_are_told(table: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    workspace = WorkcellConfig.load(table / "easel.toml").workspace
    for name, says in (("trace", "write trace:FILE"), ("trace:x,append=perhaps", "append=perhaps is not understood")):
        with pytest.raises(ConfigError, match=says):
            make_robot(name, workspace)
    with pytest.raises(ConfigError, match="write rpicam, or rpicam:NUMBER"):
        make_camera("rpicam:front")
    shutil.rmtree(table / "bin")
    monkeypatch.setenv("PATH", str(table))
    with pytest.raises(CameraError, match="took no photograph"):
        make_camera("rpicam").connect()


def test_a_stroke_model_that_is_a_function_plans_renders_and_paints_in_the_studio(run: Run, table: Path) -> None:
    model = load_stroke_model("marker")
    assert isinstance(model, StrokeFunction)
    thickness, length, bend = torch.tensor([0.0, 1.0]), torch.tensor([0.03, 0.03]), torch.tensor([0.0, 0.01])
    light, hard = model(thickness, length, bend)
    assert 0 < light.sum() < hard.sum() and hard.max() == 1 and light.min() == 0
    status, said = run("paint", "coffee.png", *SMALL, "--brush", "marker", "--canvas", "140x100mm", "--out", "it")
    assert status == 0, said
    plan = Plan.load(table / "it")
    assert plan.layers[0].brush == "marker" and len(plan) == 3 and plan.strokes.length.max() <= 0.05 + 1e-6
    assert run("render", "it", "--out", "seen.png")[0] == 0 and run("export", "it", "--to", "svg")[0] == 0
    painted = np.asarray(Image.open(table / "it" / "painting.png").convert("L"), float)
    assert painted.min() < 0.75 * np.median(painted), "the studio's brush has left its marks"


def test_its_brush_is_calibrated_and_photographed_in_the_studio(run: Run, table: Path) -> None:
    status, said = run("calibrate", "canvas", "--brush", "marker", "--canvas", "140x100mm", "--record", "marker.json")
    assert status == 0, said
    assert Calibration.load(table / "marker.json").brush == "marker"
    status, said = run("strokes", "paint", "--brush", "marker", "--count", 2, "--out", "strokes.npz")
    assert status == 0, said
    library = StrokeLibrary.load(table / "strokes.npz")
    assert len(library) == 2 and library.length_m.max() <= 0.05 + 1e-6


def test_a_painting_with_all_three_of_them(run: Run, table: Path) -> None:
    workcell = WorkcellConfig.load(table / "easel.toml")
    record = workcell.calibration("marker", SIZE, "rpicam")
    corners = ((9.5, 9.5), (149.5, 9.5), (149.5, 109.5), (9.5, 109.5))
    record = record.with_canvas(corners, SIZE, camera="rpicam", canvas=workcell.canvas, residual=0.1)
    record = record.with_robot(record.placement, residual=0.0004).with_color(record.color, residual=1.0)
    record = record.with_brush("marker", record.touch_height, record.press_height, protrusion=None, residual=0.0002)
    record.save(table / "cal.json")
    there = ("--robot", f"trace:{table / 'sheet.csv'}", "--camera", "rpicam", "--workspace", "easel.toml")
    words = ("paint", "coffee.png", *SMALL, "--brush", "marker", *there, "--calibration", "cal.json", "--yes")
    status, said = run(*words, "--out", "it")
    assert status == 0, said
    motions = dict.fromkeys(row["motion"] for row in read(table / "sheet.csv"))
    assert sum(motion.startswith("stroke") for motion in motions) == 3 and "home" in motions


def test_the_example_needs_nothing_that_is_no_promise() -> None:
    imported = set[str]()
    for file in (OWN_PARTS / "own_parts").glob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.ImportFrom):
                imported.add(node.module or "")
            elif isinstance(node, ast.Import):
                imported |= {one.name for one in node.names}
    ours = {name for name in imported if name.startswith("frida_painter")}
    assert ours == {"frida_painter", "frida_painter.plugins"}
