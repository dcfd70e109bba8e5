import contextlib
import csv
import json
import os
import re
import signal
import time
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image

from frida_painter.canvas_size import CanvasSize
from frida_painter.hardware.workcell import example
from frida_painter.strokes.plan import Plan
from killing import ForkedCommand
from support import data
from support.commandline import Command

TRUE_PHOTOGRAPHS = True

Run = Callable[..., str]
SMALL = ("--canvas", "120x90mm", "--fit", "crop", "--render-height", "64", "--effort", "0.05", "--brush", "fine")


@pytest.fixture(scope="module")
def photo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("photos") / "a_cup-of coffee.jpg"
    Image.fromarray(data.coffee()).resize((300, 200)).save(path)
    return path


@pytest.fixture
def run(call: Command) -> Run:
    """run(word, ...): what the command says when all goes well."""

    def running(*words: object) -> str:
        said = call(*words)
        assert not said.status, said.err
        return said.out

    return running


def test_a_plan_becomes_pictures_of_any_size_and_files_for_machines(run: Run, photo: Path, tmp_path: Path) -> None:
    out = run("plan", photo, "--strokes", 14, "--colors", 3, *SMALL, "--out", "planned")
    plan = Plan.load(tmp_path / "planned")
    assert len(plan) == 14 and len(plan.palette) == 3 and plan.canvas == CanvasSize(0.12, 0.09)
    names = {path.name for path in (tmp_path / "planned").iterdir()}
    sheets = {"palette.png", "mixing.png", "shopping.png", "shopping.txt"}
    assert {"plan.json", "plan.png", "record.json", "goal", *sheets} < names and len(names) == 9
    assert all(str(Path("planned") / name) in out for name in ("plan.json", "plan.png", "palette.png"))
    assert re.search(r"Similarity: +[\d.]+ dB expected, [\d.]+ to [\d.]+ \(PSNR at 85 x 64 pixels\)", out)

    pictures = []
    for height, name in ((64, "small.png"), (300, "large.jpg")):
        said = run("render", "planned", "--height", height, "--out", name)
        assert f"14 strokes at {round(height * 4 / 3)} x {height} pixels: {name}" in said
        with Image.open(tmp_path / name) as picture:
            assert picture.size == (round(height * 4 / 3), height)
            pictures.append(np.asarray(picture.convert("RGB").resize((85, 64), Image.Resampling.BOX), float))
    assert np.abs(pictures[0] - pictures[1]).mean() < 6, "the same picture, whatever its size"
    with Image.open(tmp_path / "planned" / "plan.png") as planned:
        assert np.abs(np.asarray(planned.convert("RGB").resize((85, 64)), float) - pictures[0]).mean() < 6

    assert "14 strokes in 3 paints: strokes.svg" in run("export", tmp_path / "planned" / "plan.json")
    drawing = ElementTree.parse(tmp_path / "strokes.svg").getroot()
    assert (drawing.get("width"), drawing.get("height")) == ("120mm", "90mm")
    assert len(drawing.findall(".//{http://www.w3.org/2000/svg}path")) == 14
    run("export", "planned", "--to", "svg", "--dips", "--out", "dips.svg")
    assert 'inkscape:label="!1 paint 1' in (tmp_path / "dips.svg").read_text()
    run("export", "planned", "--to", "gcode", "--press", 1)
    program = (tmp_path / "strokes.gcode").read_text()
    assert program.count("; stroke ") == 14 and "\nM0 (dip into paint 1" in program
    (tmp_path / "place.toml").write_text(re.sub(r"(?m)^(width|height) = .*$", "", example()).replace(
        "[canvas]", "[canvas]\nwidth = 0.12\nheight = 0.09"))  # fmt: skip
    run("export", "planned", "--to", "gcode", "--workspace", "place.toml", "--out", "whole.gcode")
    program = (tmp_path / "whole.gcode").read_text()
    assert "M0" not in program and "; dip into well 3\n" in program and "; wipe\n" in program
    run("export", "planned", "--to", "gcode", "--per-paint", "--refill", 5, "--out", "one.gcode")
    programs = [path.read_text() for path in sorted(tmp_path.glob("one-*.gcode"))]
    assert [program.count("; stroke ") > 0 for program in programs] == [True, True, True]
    assert sum(program.count("; stroke ") for program in programs) == 14
    assert all(f"dip into paint {number}" in program for number, program in enumerate(programs, 1))
    assert sum(program.count("\nM0 (dip") for program in programs) == 14, "5 mm is less than a stroke"
    pytest.importorskip("HersheyFonts")
    for kind in ("svg", "gcode"):
        run("export", "planned", "--to", kind, "--title", "Hill", "--signature", "Ada", "--out", f"signed.{kind}")
    signed = (tmp_path / "signed.gcode").read_text()
    assert signed.index("take a pen") > signed.rindex("; stroke ") and "Z-" not in signed[signed.index("take a pen") :]
    written = ElementTree.parse(tmp_path / "signed.svg").getroot().findall("{http://www.w3.org/2000/svg}g")[-1]
    assert written.get("{http://www.inkscape.org/namespaces/inkscape}label", "").startswith("!") and len(written) > 6
    run("export", "planned", "--to", "csv", "--out", "list.csv")
    with (tmp_path / "list.csv").open() as file:
        assert len(list(csv.reader(file))) == 15


@pytest.mark.usefixtures("in_small_world")
def test_the_same_seed_makes_the_same_plan(run: Run, photo: Path, tmp_path: Path) -> None:
    for name, seed in (("one", 4), ("same", 4), ("other", 5)):
        run("plan", photo, "--strokes", 5, "--colors", 2, *SMALL, "--seed", seed, "--out", name)
    one, same, other = (Plan.load(tmp_path / name).digest for name in ("one", "same", "other"))
    assert one == same != other


@pytest.mark.usefixtures("in_small_world")
def test_settings_come_from_a_file_and_the_canvas_turns_with_the_picture(run: Run, photo: Path, tmp_path: Path) -> None:
    (tmp_path / "my.toml").write_text(
        'strokes = 4\ncolors = 2\nseed = 1\neffort = 0.05\nrender_height = 64\nbrush = "fine"\n'
    )
    upright = tmp_path / "upright.png"
    with Image.open(photo) as picture:
        picture.rotate(90, expand=True).save(upright)
    out = run("plan", upright, "--settings", "my.toml", "--strokes", 3)
    plan = Plan.load(next((tmp_path / "paintings").iterdir()))
    assert len(plan) == 3 and len(plan.palette) == 2
    assert (plan.canvas.width, plan.canvas.height) == pytest.approx((14 * 0.0254 * 200 / 300, 14 * 0.0254), rel=1e-5)
    assert "paintings/upright-" in out


def test_a_painting_from_the_command_line_leaves_everything_in_its_folder(
    run: Run, photo: Path, tmp_path: Path
) -> None:
    out = run("paint", photo, "--strokes", 9, "--colors", 2, "--replans", 1, *SMALL, "--out", "painted")
    folder = tmp_path / "painted"
    assert out.startswith("9 strokes in ") and str(Path("painted") / "film.mp4") in out
    result = json.loads((folder / "result.json").read_text())
    assert result["strokes_painted"] == 9 and result["stopped"] is False and len(result["looks"]) == 1
    assert set(result["files"]) == {path.name for path in folder.iterdir() if path.name[0] != "."}
    wanted = {"painting.png", "film.mp4", "index.html", "plan.json", "palette.png", "strokes.svg", "strokes.csv"}
    assert wanted <= set(result["files"])
    assert result["settings"]["photo"] == photo.name and result["title"] == "A cup of coffee"
    assert len(Plan.load(folder)) == 9
    with Image.open(folder / "painting.png") as painting, Image.open(folder / "card.jpg") as card:
        assert max(painting.size) >= 1417 and max(card.size) >= 1500, "120 mm at 300 dpi"
    with Image.open(folder / "canvas.png") as canvas:
        assert canvas.size == (1152, 864)
    with Image.open(folder / "plan.png") as plan:
        size = plan.size

    def compute(*names: str) -> float:
        """The PSNR of two files, as a reader computes it."""
        one, other = (
            np.asarray(Image.open(folder / name).convert("RGB").resize(size, Image.Resampling.BOX), float) / 255
            for name in names
        )
        return float(-10 * np.log10(((one - other) ** 2).mean()))

    near = compute("canvas.png", "target.jpg")
    assert compute("painting.png", "canvas.png") > 25, "the print is of the same canvas"
    assert f"The painting against the photograph: {near:.2f} dB (PSNR at {size[0]} x {size[1]} pixels)" in out
    page = (folder / "index.html").read_text()
    assert f"{size[0]} x {size[1]} pixels" in page and f"{near:.2f}<" in page
    pairs = ("plan.png", "target.jpg"), ("canvas.png", "target.jpg"), ("canvas.png", "plan.png")
    told = [(each["psnr_db"], each["pixels"]) for each in result["comparisons"]]
    assert told == [(pytest.approx(compute(*pair), abs=0.002), list(size)) for pair in pairs]


def test_help_is_written_for_painters(run: Run) -> None:
    pages = ("", "paint", "plan", "render", "export", "strokes", "strokes paint")
    for words in (*(f"{page} --help" for page in pages), "paint --help-all", "plan --help-all"):
        text = run(*words.split())
        assert len(text) > 300
        words = set(text.lower().replace("-", " ").replace("[", " ").replace("]", " ").split())
        jargon = {"tensor", "tensors", "none", "callable", "int", "integer", "float", "<str>", "<text>", "null"}
        assert not words & jargon, words & jargon


@pytest.mark.usefixtures("in_small_world")
@pytest.mark.skipif(os.name == "nt", reason="signals are sent otherwise there")
def test_ctrl_c_stops_after_the_stroke_and_keeps_what_was_made(photo: Path, tmp_path: Path) -> None:
    folder = tmp_path / "painted"
    words = (
        "paint",
        str(photo),
        "--pace",
        "0.3",
        "--strokes",
        "30",
        "--replans",
        "1",
        *SMALL,
        "--out",
        str(folder),
        "--no-film",
    )
    with contextlib.closing(ForkedCommand(tmp_path, *words)) as painter:
        deadline = time.monotonic() + 120
        while not (folder / "plan.json").exists():  # from then on it paints
            assert painter.poll() is None and time.monotonic() < deadline
            time.sleep(0.05)
        painter.send_signal(signal.SIGINT)
        out, err = painter.communicate(timeout=60)
    assert painter.returncode == 130, err
    result = json.loads((folder / "result.json").read_text())
    painted = result["strokes_painted"]
    assert result["stopped"] is True and 0 < painted < 30 and result["strokes_planned"] == 30
    assert f"Stopped after {painted} of 30 strokes; what was made is kept" in out
    assert "Stopping after this stroke" in err and "Traceback" not in err
    assert all((folder / name).exists() for name in ("painting.png", "index.html", "plan.json", "strokes.svg"))
    assert len(Plan.load(folder)) == 30
    with (folder / "strokes.csv").open() as file:
        assert len(list(csv.reader(file))) == painted + 1
