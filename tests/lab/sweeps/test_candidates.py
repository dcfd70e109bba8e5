"""The best of several seeds."""

from pathlib import Path

import pytest
import torch
from PIL import Image

import frida_painter as fp
from frida_painter.errors import PlanError, TryFailed
from frida_painter.lab.sweeps import runner as sweeps
from frida_painter.lab.sweeps.runner import best_candidate, rank_plans
from frida_painter.runs.settle import ground_of
from support import data
from sweep_engine import Here

SMALL = {"strokes": 4, "canvas": "120x90mm", "render_height": 64, "effort": 0.05, "brush": "fine", "colors": 2}


@pytest.fixture
def spec(tmp_path: Path, in_small_world: None) -> fp.RunSpec:
    Image.fromarray(data.coffee()).resize((120, 90)).save(tmp_path / "coffee.png")
    return fp.RunSpec.of(**SMALL, goal=[{"image": str(tmp_path / "coffee.png")}], seed=7)


@pytest.mark.slow
def test_the_plan_of_the_best_seed_is_chosen(tmp_path: Path, spec: fp.RunSpec, monkeypatch) -> None:
    monkeypatch.setattr(sweeps, "open_engine", lambda *limits, **where: Here())
    best = best_candidate(spec, 3, tmp_path / "candidates", notify=lambda progress: None)
    expected = {}
    for seed in (7, 8, 9):
        with fp.PaintingRun(spec.with_values(seed=seed)) as run:
            plan = run.plan()
            expected[seed] = run.planner.forecast(plan, run.planner.bare).expected, plan
    assert best.spec.seed == max(expected, key=lambda seed: expected[seed][0])
    assert torch.equal(best.plan.strokes.position, expected[best.spec.seed][1].strokes.position)
    assert best.comparison.startswith(f"The best of 3 seeds is {best.spec.seed}: expected dB ")
    assert best.spec == spec.with_values(seed=best.spec.seed, ground="white")


@pytest.mark.slow
def test_the_ground_of_the_best_is_that_of_its_plan(tmp_path: Path, spec: fp.RunSpec, monkeypatch) -> None:
    monkeypatch.setattr(sweeps, "open_engine", lambda *limits, **where: Here())
    best = best_candidate(spec.with_values(ground="auto"), 1, tmp_path / "candidates", notify=lambda progress: None)
    assert best.spec.ground == ground_of(best.plan) != "white"


def test_words_are_judged_by_what_they_say_and_not_by_the_pixels_of_their_beginning(spec: fp.RunSpec) -> None:
    near, right = (
        {"figures": {"expected dB": decibels, "loss of the plan": loss}}
        for decibels, loss in ((20.0, 0.9), (15.0, 0.4))
    )
    words = fp.RunSpec.of(goal=[{"text": "a lemon"}])
    assert rank_plans(words, [near, right]) == ("loss of the plan", [right, near])
    assert rank_plans(spec, [right, near]) == ("expected dB", [near, right])
    assert rank_plans(spec, [near, {"figures": {"loss of the plan": 0.4}}])[0] == "loss of the plan"


def test_where_no_seed_makes_a_plan_the_reason_is_told(tmp_path: Path, spec: fp.RunSpec, monkeypatch) -> None:
    def fail(assignment: object) -> None:
        raise TryFailed("It exploded.")

    monkeypatch.setattr(sweeps, "open_engine", lambda *limits, **where: Here(fail))
    with pytest.raises(PlanError, match="None of the 2 seeds made a plan: It exploded"):
        best_candidate(spec, 2, tmp_path / "candidates", notify=lambda progress: None)
