import numpy as np
import pytest
import torch

from frida_painter.errors import ConfigError
from frida_painter.runs.spec import RunSpec
from frida_painter.system import images
from frida_painter_lab.benchmark import suite
from frida_painter_lab.benchmark.suite import BUDGETS, GOALS, PICTURES, find_budget, find_goal, suite_digest

FROZEN = "e2bb2287624a7efec6230b44e1cbada385864315a775b3d1e4cd20cdd0d4f381"
"""Of version v1. A change of pictures, goals, budgets or seeds is a new version, never an edit."""


def test_the_suite_is_frozen():
    assert suite.VERSION == "v1" and suite_digest() == FROZEN


def test_it_has_24_pictures_of_every_kind_and_12_goals(tmp_path):
    assert len(PICTURES) == 24 and len(GOALS) == 12 and len(set(suite.SEEDS)) == 5
    for name in PICTURES:
        goal = find_goal(name, tmp_path)
        assert goal.picture is not None and sorted(goal.picture.shape[1:]) == [360, 480]
        assert goal.canvas.width / goal.canvas.height == pytest.approx(goal.picture.shape[2] / goal.picture.shape[1])
        assert suite._file_of(name).stat().st_size <= 40_000
    named = {part.strip() for line in (suite._file_of("cat").parent / "README.md").read_text().splitlines()
             if line.startswith("| ") for part in line.split("|")[1].split(",")}  # fmt: skip
    assert set(PICTURES) <= named, "each has its author and licence"


def test_every_goal_is_a_goal_of_the_project_and_every_budget_has_its_strokes(tmp_path):
    for name in GOALS:
        goal = find_goal(name, tmp_path)
        spec = RunSpec.of(goal=[dict(item) for item in goal.items], canvas=goal.canvas)
        assert len(spec.goal) == 2 and goal.picture is None
    assert [find_budget(strokes).strokes for strokes in BUDGETS] == [100, 300, 1000]
    with pytest.raises(ConfigError, match="budgets are 100, 300, 1000"):
        find_budget(200)


def test_an_edited_picture_is_refused(tmp_path, monkeypatch):
    kept = dict(suite._PICTURES)
    monkeypatch.setattr(suite, "_PICTURES", {**kept, "cat": ("animal", "0" * 64)})
    with pytest.raises(ConfigError, match="cat of the suite v1 was edited"):
        find_goal("cat", tmp_path)


def test_a_held_out_picture_follows_from_its_seed_alone(tmp_path):
    one, again = find_goal("cat~7", tmp_path / "a"), find_goal("cat~7", tmp_path / "b")
    other, public = find_goal("cat~8", tmp_path), find_goal("cat", tmp_path)
    assert torch.equal(one.picture, again.picture) and one.canvas == public.canvas
    assert one.name == "cat~7" and one.picture.shape == public.picture.shape
    for unlike in (other, public):
        assert float((one.picture - unlike.picture).square().mean()) > 0.005
    assert torch.equal(find_goal("cat~7", tmp_path / "a").picture, one.picture), "read from its file"


def test_a_drawing_stays_a_drawing_in_the_held_out_half():
    drawing = suite.held_out_picture("house", 3)
    assert float((drawing > 0.9).float().mean()) > 0.6 and float(drawing.min()) < 0.4


@pytest.mark.parametrize(
    "name", ["cat~", "cat~-1", "cat~1.5", "cat~99999999999", "cat~nan", "dog", "dog~7", "", "../cat"]
)
def test_an_unknown_picture_is_refused(tmp_path, name):
    with pytest.raises(ConfigError) as said:
        find_goal(name, tmp_path)
    assert str(said.value).endswith(".") and "\n" not in str(said.value)
    assert not list(tmp_path.iterdir())


def test_an_own_picture_has_a_canvas_of_its_proportions(tmp_path):
    path = tmp_path / "own.png"
    images.save(torch.from_numpy(np.full((3, 60, 30), 0.5, np.float32)), path)
    goal = find_goal(str(path), tmp_path)
    assert goal.name == "own" and (goal.canvas.width, goal.canvas.height) == (0.14, 0.28)
    images.save(torch.zeros(3, 20, 200), path)
    with pytest.raises(ConfigError, match="four times"):
        find_goal(str(path), tmp_path)
