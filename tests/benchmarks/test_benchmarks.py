"""The benchmarks still run, and the comparator of the planner's iteration still draws what the renderer draws."""

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from downloads import fetched
from frida_painter.brush.weights import load_stroke_model
from frida_painter.canvas_size import CanvasSize
from frida_painter.planning.initialize import uniform
from frida_painter.render import render
from support.programs import load_program

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


def program(name):
    return load_program(BENCHMARKS / f"{name}.py")


def original():
    return program("original")


@pytest.mark.slow
def test_the_comparator_paints_what_the_renderer_paints():
    size, network = CanvasSize(0.3556, 0.2794), load_stroke_model("broad")
    strokes = uniform(12, network.limits, size, torch.Generator().manual_seed(0))
    canvas = torch.ones(3, 256, 326)
    with torch.no_grad():
        theirs = original().OriginalPlan(strokes, network)(canvas, size)
        ours = render(strokes, network, canvas, size)
    assert (ours - canvas).abs().mean() > 0.02
    # The comparator places padded maps to the nearest pixel, and samples them twice.
    assert (theirs - ours).abs().mean() < 0.002


def test_an_iteration_of_the_comparator_lowers_the_loss():
    module = original()
    size, network = CanvasSize(0.2, 0.15), load_stroke_model("broad")
    strokes = uniform(3, network.limits, size, torch.Generator().manual_seed(1))
    canvas, target = torch.ones(3, 64, 85), torch.zeros(3, 64, 85)
    plan = module.OriginalPlan(strokes, module.PaperNetwork(network.frame, weight_gradients=False))
    losses = [plan.iterate(canvas, size, target) for _ in range(5)]
    assert losses[-1] < losses[0]


@pytest.fixture
def run(monkeypatch):
    """run(name, word, ...): runs a benchmark in this process, which has loaded already what it needs."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))

    def running(name, *words):
        monkeypatch.setattr("sys.argv", [f"{name}.py", *map(str, words)])
        assert not program(name).main()

    return running


@pytest.mark.slow
def test_a_judge_names_the_style_of_pictures_that_are_there(tmp_path, run, capsys):
    style = Image.open(BENCHMARKS / "styles" / "great-wave.jpg")
    style.save(tmp_path / "starry-night-cat.png")  # as if it were the plan of a cat
    run("styles", "--quick", "--out", tmp_path, "--json", tmp_path / "figures.json")
    (figure,) = json.loads((tmp_path / "figures.json").read_text())["figures"]
    assert (figure["style"], figure["painted"]) == ("starry-night", "cat") and 1 / 6 < figure["probability"] <= 1
    assert figure["named"] != "udnie" and "Right: " in capsys.readouterr().out
    assert (tmp_path / "sheet.png").exists()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["content", "combined", "styles"])
def test_those_that_are_looked_at_plan_judge_and_make_a_sheet(name, tmp_path, run, in_small_world):
    for network in ("hed", "efficientnet-lite0", "efficientnet-lite1"):
        fetched(network)
    run(name, "--quick", "--out", tmp_path / "out", "--json", tmp_path / "figures.json")
    require_tables(tmp_path / "figures.json")
    figures = json.loads((tmp_path / "figures.json").read_text())["figures"]
    assert all(figure["cpu_seconds"] > 0 for figure in figures)
    assert len(list((tmp_path / "out").glob("*.png"))) == len(figures) + 1


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "more"),
    [
        ("planning", ()),
        ("replanning", ()),
        ("looks", ()),
        ("goals", ("--goals", "photograph", "sketch")),  # tests/planning plans towards all kinds
        ("gpu", ("--device", "cpu")),
    ],
)
def test_a_quick_run_prints_and_writes_tables(name, more, tmp_path, run, in_small_world, capsys):
    figures = tmp_path / "figures.json"
    run(name, "--quick", "--json", figures, *more)
    require_tables(figures)
    assert len(capsys.readouterr().out.splitlines()) > 5


@pytest.mark.slow
@pytest.mark.parametrize("name", ["iteration", "render", "sweep"])
def test_so_does_one_that_measures_in_processes_of_its_own(name, tmp_path):
    figures = tmp_path / "figures.json"
    command = [sys.executable, str(BENCHMARKS / f"{name}.py"), "--quick", "--json", str(figures)]
    subprocess.run(command, check=True, capture_output=True, timeout=300)
    require_tables(figures)


@pytest.mark.slow
def test_the_painter_of_most_pixels_is_found(tmp_path, run, capsys):
    run("painters", "--quick", "--keep", tmp_path)
    mean = capsys.readouterr().out.splitlines()[-1]
    of_all, of_painted, of_person = (float(share) for share in re.findall(r"([\d.]+)%", mean))
    assert of_all > 80 and of_painted > 80 and of_person > 70
    record = json.loads((tmp_path / "painting-0/painters.json").read_text())
    assert {stroke["painter"] for stroke in record["strokes"]} == {"robot", "person"}
    assert sum(record["shares"].values()) == pytest.approx(1, abs=1e-3)


def require_tables(figures):
    record = json.loads(figures.read_text())
    assert record["figures"] and record["tables"]
    assert all(len(row) == len(table["columns"]) for table in record["tables"] for row in table["rows"])


@pytest.mark.slow
def test_forecasts_stand_beside_what_was_painted(tmp_path, run):
    pictures, kept = tmp_path / "pictures", tmp_path / "kept"
    pictures.mkdir()
    down, across = np.mgrid[40:232:2, 40:232:2].astype(np.uint8)
    Image.fromarray(np.stack((down, across[:, ::-1], np.full_like(down, 90)), -1)).save(pictures / "ramp.png")
    run("forecasts", pictures, "--quick", "--kept", kept, "--json", tmp_path / "figures.json")
    (found,) = json.loads((tmp_path / "figures.json").read_text())["figures"]
    assert found == json.loads((kept / "ramp-31.json").read_text())
    assert found["picture"] == "ramp" and abs(found["by_camera"] - found["in_truth"]) < 2
    assert found["first"][1] < found["first"][0] < found["first"][2]


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_no_canvas_that_lies_still_is_said_to_have_moved_and_those_that_moved_are_found(tmp_path):
    figures = tmp_path / "figures.json"
    command = [sys.executable, str(BENCHMARKS / "moved_canvas.py"), "--quick", "--seed", "300", "--json", str(figures)]
    subprocess.run(command, check=True, capture_output=True, timeout=600)
    found = json.loads(figures.read_text())["figures"]
    assert found["still"] >= 21 and found["false"] == 0
    # Of 26, one may be in doubt: then a person is asked, or the canvas is looked at again.
    assert len(found["missed"]) <= 1 and all(one.startswith("unsure") for one in found["missed"])


# What two checkouts of one code have in common: everything but the time that they take.
ALIKE = {"plans": ("drawn", "expected"), "paintings": ("planned", "decibels"), "dips": ("dips", "minutes", "decibels")}


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("what", ALIKE)
def test_a_checkout_compared_with_itself_is_as_good_as_itself(tmp_path, what):
    figures = tmp_path / "figures.json"
    command = [sys.executable, str(BENCHMARKS / "compare.py"), what, "--quick", "--against", str(BENCHMARKS.parent)]
    command += ["--folder", str(tmp_path), "--json", str(figures)]
    subprocess.run(command, check=True, capture_output=True, timeout=600)
    record = json.loads(figures.read_text())
    found = {code: [one for one in record["figures"] if one["code"] == code] for code in ("this", "the other")}
    assert len(found["this"]) == len(found["the other"]) >= 1
    for here, there in zip(*found.values(), strict=True):
        assert all(here[name] == there[name] for name in ALIKE[what])
        assert all(here[name] > 3 for name in ALIKE[what] if name not in ("dips", "minutes")), "dB of six strokes"
    assert all(len(row) == len(table["columns"]) for table in record["tables"] for row in table["rows"])
    if what == "paintings":
        with Image.open(tmp_path / "coffee-0.jpg") as sheet:
            assert sheet.width > 4 * 384


def test_decibels_are_interpolated_between_efforts_and_not_beyond(monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    compare = program("compare")
    made = [compare.PlanFigures("this", "a", 0, 1.0, seconds, 0.0, dB) for seconds, dB in ((1, 10), (4, 9), (100, 30))]
    assert compare.decibels_after(1.0, made) == 10 and compare.decibels_after(4.0, made) == 10, "the best until then"
    assert 10 < compare.decibels_after(20.0, made) < 30
    assert np.isnan(compare.decibels_after(0.5, made)) and np.isnan(compare.decibels_after(101.0, made))
    assert compare.seconds_until(compare.decibels_after(20.0, made), made) == pytest.approx(20.0)
    assert compare.mean([1.0, float("nan"), 3.0], "{:.1f}") == "2.0" and compare.mean([], "{:.1f}") == "not reached"


@pytest.mark.slow
@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU here")
def test_without_a_gpu_its_benchmark_says_what_to_do():
    done = subprocess.run([sys.executable, str(BENCHMARKS / "gpu.py")], capture_output=True, text=True, timeout=120)
    assert done.returncode == 2 and done.stdout == ""
    assert done.stderr.startswith("There is no CUDA device here") and "--device cpu" in done.stderr
    assert done.stderr.count("\n") == 1


def test_the_page_holds_only_what_was_measured_on_the_present_source(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    report = program("report")
    monkeypatch.setattr(report, "FIGURES", tmp_path)
    assert report.page().count(report.MISSING) == len(report.SECTIONS)
    record = {
        "hardware": "another machine",
        "versions": {"torch": "9"},
        "tables": [],
        "figures": {},
        "sources": ["a.py"],
    }
    monkeypatch.setattr(report, "SOURCE", tmp_path)
    (tmp_path / "a.py").write_text("x = 1")
    for code, shown in ((report.digest(tmp_path, ["a.py"]), 1), ("of yesterday", 0)):
        (tmp_path / "gpu.json").write_text(json.dumps(record | {"code": code, "date": "2026-11-25"}))
        page = report.page()
        assert page.count(f"Measured on 2026-11-25: another machine; torch 9; source {code}.") == shown
        assert page.count(report.MISSING) == len(report.SECTIONS) - shown


def test_the_page_in_the_docs_is_what_the_command_writes(monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    report = program("report")
    page = report.PAGE.read_text()
    assert page.startswith(report.OPENING)
    heads = [section.head for section in report.SECTIONS]
    assert [head for head in heads if head not in page] == []
    assert page.count("\n## ") == len(heads)


def test_every_file_that_was_loaded_changes_the_digest_and_no_other(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    report = program("report")
    found = [report.digest(tmp_path, [])]
    for content in ("x = 1", "y = 1"):
        (tmp_path / "a.py").write_text(content)
        found.append(report.digest(tmp_path, ["a.py"]))
    (tmp_path / "b.py").write_text("")
    assert report.digest(tmp_path, ["a.py"]) == found[-1]
    found.append(report.digest(tmp_path, ["a.py", "b.py"]))
    (tmp_path / "a.py").unlink()
    found.append(report.digest(tmp_path, ["a.py", "b.py"]))
    assert len(set(found)) == len(found)


@pytest.mark.slow
def test_a_benchmark_names_the_sources_that_it_loaded():
    asked = "import json, measure; print(json.dumps(measure.loaded_sources()))"
    told = subprocess.run([sys.executable, "-c", asked], check=True, capture_output=True, text=True, cwd=BENCHMARKS)
    sources = json.loads(told.stdout)
    assert {"__init__.py", "planning/problem.py", "brush/table.py"} <= set(sources)
    assert not any(name.startswith("web/") for name in sources)
