"""strokes train and strokes evaluate, from the words on the command line to the files and figures."""

import csv
import json
import re
from pathlib import Path

import pytest

from frida_painter import registry
from frida_painter.brush.field import StrokeField
from frida_painter.brush.weights import load_stroke_model
from frida_painter_calibration.teaching import evaluation
from frida_painter_calibration.teaching.evaluation import evaluate
from frida_painter_calibration.teaching.param2stroke import Param2Stroke
from marks import small_library
from plugins import install

TRUE_PHOTOGRAPHS = True


@pytest.fixture
def run(tmp_path, call):
    small_library(20).save(tmp_path / "library.npz")
    return lambda *words: call("strokes", *words)


@pytest.fixture
def hasty(monkeypatch):
    """Trainings that are over at once."""

    thoroughly = evaluation.learn

    def hastily(name, library, kind=None, *, seed=0, notify=None):
        return thoroughly(name, library, kind, seed=seed, hasty=True, notify=notify)

    monkeypatch.setattr("frida_painter_calibration.teaching.evaluation.learn", hastily)
    monkeypatch.setattr("frida_painter_calibration.teaching.evaluation.learn", hastily)


def test_a_brush_is_learned_and_then_tested_on_other_strokes(run, monkeypatch):
    monkeypatch.setattr("frida_painter_calibration.teaching.training._STEPS", 60)
    status, out, _ = run("train", "library.npz", "--seed", 3, "--out", "my/brush.safetensors")
    assert status == 0
    claimed = float(re.search(r"magnitude is (0\.\d+)", out)[1])
    assert isinstance(load_stroke_model("my/brush.safetensors"), StrokeField)
    with Path("my/brush.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [int(row["epoch"]) for row in rows] == list(range(1, len(rows) + 1))
    assert min(float(row["validation_error"]) for row in rows) == pytest.approx(claimed, abs=6e-5)

    other = small_library(30, seed=7)
    other.save(Path("other.npz"))
    status, out, _ = run("evaluate", "--weights", "my/brush.safetensors", "--library", "other.npz", "--json")
    found = json.loads(out)
    assert status == 0
    error = evaluate(load_stroke_model("my/brush.safetensors"), other).error
    assert found["mean_absolute_error"] == pytest.approx(error.mean())
    assert [stroke["error"] for stroke in found["per_stroke"]] == pytest.approx(error.tolist())
    assert found["mean_absolute_error"] < 0.2 * found["error_of_bare_paper"]


def test_an_evaluation_has_a_page_of_any_stroke_model_also_of_one_that_is_only_a_function(run, tmp_path, monkeypatch):
    text = """
from frida_painter.brush.kinds import BrushModel
from frida_painter.brush.kinds import StrokeFunction
from plugins import install
from marks import SMALL, ribbon
MODEL = BrushModel(SMALL, lambda: StrokeFunction(SMALL, ribbon(), ribbon().frame))
"""
    points = {registry.STROKE_MODELS: {"small": "small_ribbon:MODEL"}}
    install(tmp_path / "installed", monkeypatch, "small-ribbon", points, {"small_ribbon": text})
    words = ("--weights", "small", "--library", "library.npz")
    status, out, _ = run("evaluate", *words, "--page", "marks.html", "--json")
    assert status == 0 and json.loads(out)["brush"] == "small"
    page = Path("marks.html").read_text()
    count = min(24, page.count("<li>"))
    assert count > 0 and page.count("data:image/png;base64,") == 3 * count and "How it learned" not in page
    assert f"{json.loads(out)['strokes']} strokes that it had not seen" in page
    status, _, err = run("evaluate", *words, "--page", "marks.pdf")
    assert status == 2 and "ends in .html" in err


def test_the_papers_network_is_trained_where_it_is_asked_for(run, hasty):
    assert run("train", "library.npz", "--model", "param2stroke", "--out", "paper.safetensors")[0] == 0
    assert isinstance(load_stroke_model("paper.safetensors"), Param2Stroke)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("train", "few.npz"), "at least 5"),
        (("train", "torn.npz"), "damaged"),
        (("train", "library.npz", "--model", "vgg"), "models are field and param2stroke"),
        (("train", "library.npz", "--out", "library.npz/brush.safetensors"), "cannot be written"),
        (("train", "library.npz", "--out", "folder.safetensors"), "folder.safetensors"),
        (("evaluate", "--weights", "library.npz", "--library", "library.npz"), "weights"),
        (("evaluate", "--weights", "broad", "--library", "torn.npz"), "damaged"),
        (("evaluate", "--weights", "broad", "--library", "other.npz"), "outside what the model knows"),
    ],
)
def test_what_cannot_be_used_is_refused_in_one_sentence(run, words, told):
    small_library(4).save(Path("few.npz"))
    Path("torn.npz").write_bytes(Path("library.npz").read_bytes()[:500])
    Path("folder.safetensors").mkdir()
    bent = small_library(6)
    bent.bend_m[:] = 0.2
    bent.save(Path("other.npz"))
    before = sorted(Path().rglob("*"))
    status, out, err = run(*words)
    assert (status, out) == (2, "")
    assert told in err and err.strip().count("\n") == 0
    assert sorted(Path().rglob("*")) == before
