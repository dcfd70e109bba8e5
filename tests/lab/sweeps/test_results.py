"""What a sweep gave: its page, its table, its statistics, and the best of several seeds."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from scipy import stats

import frida_painter as fp
from frida_painter.errors import PlanError, TryFailed
from frida_painter.runs.settle import ground_of
from frida_painter.system import images
from frida_painter_lab import experiment as carrier
from frida_painter_lab import targets
from frida_painter_lab.engine import Share
from frida_painter_lab.experiment import silent
from frida_painter_lab.statistics import Mean, Result, holm, means, paired_tests
from frida_painter_lab.sweeps import runner
from frida_painter_lab.sweeps.report import SweepState, flat, keep_table, read_state, write_report, write_table
from frida_painter_lab.sweeps.runner import best_candidate, rank_plans, sweep
from frida_painter_lab.sweeps.sweep_spec import SweepSpec
from sweep_engine import Here

# The page.


def test_the_report_shows_pictures_curves_tests_and_failures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def figures(kind: str, opened: Any, plan: Any, folder: Any) -> dict[str, float]:
        spec = opened.spec
        images.save(torch.full((3, 30, 40), spec.seed / 8), folder.path / "plan.png")
        return {"plan dB": 20 + spec.strokes / 20 + spec.seed + 3 * (spec.brushes == "fine")}

    def fail(share: Share) -> None:
        if dict(share.runs[0].labels) == {"strokes": 4, "brush": "broad", "seed": 3}:
            raise TryFailed("It <exploded>.")

    monkeypatch.setattr(carrier, "Engine", lambda limits, slots: Here(fail))
    monkeypatch.setattr(runner, "_figures", figures)
    grid = {"strokes": [4, 8], "brush": ["broad", "fine"], "seed": [0, 1, 2, 3]}
    made = sweep({"title": "A & B", "settings": {"text": "a lemon", "colors": 2}, "grid": grid}, tmp_path / "sweep")
    html = write_report(read_state(made.folder)).read_text()
    assert "<h1>A &amp; B</h1>" in html and "15 of 16 runs done, 1 failed." in html
    assert html.count("<figcaption>") == 15 and "strokes 4, broad, seed 0: 20.2" in html
    assert "It &lt;exploded&gt;." in html
    assert re.search(r"<td>brush</td><td>broad → fine</td><td>\+3</td>", html)
    for file in re.findall(r'(?:src|href)="([^"]+)"', html):
        assert (made.folder / file).exists(), file
    for run in made.runs:
        (made.folder / "runs" / run.key / "result.json").unlink(missing_ok=True)
    html = write_report(read_state(made.folder)).read_text()
    assert "0 of 16 runs done, 1 failed, and nobody works on it; run the sweep again to continue." in html


# The table.


def record(seed: int, **more: Any) -> dict[str, Any]:
    return {
        "key": f"k{seed}", "kind": "plan", "labels": {"seed": seed},
        "settings": {"seed": seed, "strokes": 5, "palette": None, "goal": [["Photograph", "cat.jpg"]]},
        "figures": {"plan dB": 20.5 + seed}, "times": {"wall_seconds": 2.0, "ended": "2026-11-22"},
        "versions": {"torch": "2"}, "host": "here", **more,
    }  # fmt: skip


def test_a_row_holds_settings_figures_times_and_versions_and_columns_may_mix_kinds(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed; say: pip install '.[table]'")
    failure = {"key": "k2", "kind": "plan", "labels": {"seed": 2}, "error": "It exploded.", "host": "here"}
    write_table(tmp_path / "t.parquet", [flat(record(0)), flat(record(1)), flat(failure)])
    table = parquet.read_table(tmp_path / "t.parquet")
    assert table["seed"].to_pylist() == [0, 1, 2] and table["plan dB"].to_pylist() == [20.5, 21.5, None]
    assert table["status"].to_pylist() == ["done", "done", "failed"] and table["error"].to_pylist()[2] == "It exploded."
    assert table["set strokes"].to_pylist() == [5, 5, None] and "set seed" not in table.column_names
    assert table["goal"].to_pylist()[0] == "Photograph: cat.jpg" and table["version torch"].to_pylist()[0] == "2"
    assert str(table.schema.field("seed").type) == "int64" and str(table.schema.field("plan dB").type) == "double"
    write_table(tmp_path / "t.parquet", [{"a": 1, "b": 1, "c": None}, {"a": 0.5, "b": "every:75", "c": None}])
    table = parquet.read_table(tmp_path / "t.parquet")
    assert table["a"].to_pylist() == [1.0, 0.5] and table["b"].to_pylist() == ["1", "every:75"]


def test_without_pyarrow_there_is_no_table_and_a_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    nothing = SweepState(tmp_path, SweepSpec.of(), (), {}, {}, 1)
    monkeypatch.setattr("frida_painter.registry.is_installed", lambda package: False)
    assert 'the extra "table"' in keep_table(nothing)[0] and list(tmp_path.iterdir()) == []


# Statistics, against what is known of them.


def results(effect: float, seeds: int = 8, noise: float = 0.1, draw: int = 0) -> list[Result]:
    chance = np.random.default_rng(draw)
    easy = chance.normal(25, 3, seeds)  # photographs differ far more than the effect
    return [
        Result({"strokes": strokes, "seed": seed}, float(easy[seed] + gain + noise * chance.normal()))
        for strokes, gain in ((50, 0.0), (100, effect))
        for seed in range(seeds)
    ]


def test_the_interval_holds_the_true_mean_as_often_as_it_says() -> None:
    chance = np.random.default_rng(1)
    found = [Mean.of(chance.normal(3.0, 2.0, 5).tolist()) for _ in range(1000)]
    assert 0.93 <= np.mean([one.low <= 3.0 <= one.high for one in found]) <= 0.97
    assert Mean.of([2.0]) == Mean(2.0, 2.0, 2.0, 1)


def test_pairs_show_what_means_hide_by_the_tests_of_scipy() -> None:
    some = results(0.3)
    (test,) = paired_tests(some, ["strokes"])
    assert (test.first, test.second, test.difference.count, test.more) == (50, 100, 8, 8)
    assert test.t < 0.001 and abs(test.difference.value - 0.3) < 0.15
    points = means(some, "strokes", None)[None]
    assert points[50.0].high > points[100.0].value, "the intervals of the means overlap"
    before, after = ([one.figure for one in some if one.labels["strokes"] == strokes] for strokes in (50, 100))
    assert test.t == pytest.approx(stats.ttest_rel(after, before).pvalue)
    assert test.wilcoxon == pytest.approx(stats.wilcoxon(after, before).pvalue)
    same = [Result({"strokes": strokes, "seed": seed}, 1.0) for strokes in (5, 9) for seed in range(4)]
    assert paired_tests(same, ["strokes"])[0].t == 1.0
    assert paired_tests(results(0.3, seeds=2), ["strokes"]) == (), "two pairs are too few"


def test_only_runs_that_differ_in_one_field_are_pairs() -> None:
    some = [
        Result({"image": image, "strokes": strokes, "seed": seed}, seed + strokes + 10 * (image == "b"))
        for image, strokes in (("a", 50), ("a", 100), ("b", 50))
        for seed in range(3)
    ]
    tests = {(one.field, one.first, one.second): one for one in paired_tests(some, ["image", "strokes"])}
    assert tests["strokes", 50, 100].difference.value == 50 and tests["strokes", 50, 100].difference.count == 3
    assert tests["image", "a", "b"].difference.value == 10
    found = means([Result({"n": n, "way": way}, n + 10 * (way == "x")) for n in (1, 2) for way in "xy"], "n", "way")
    assert [one.value for one in found["x"].values()] == [11.0, 12.0]


@given(st.lists(st.floats(0, 1), max_size=12))
def test_holm_keeps_the_order_and_lies_between_the_value_and_bonferroni(values: list[float]) -> None:
    adjusted = holm(values)
    for value, its in zip(values, adjusted, strict=True):
        assert value <= its <= min(1.0, len(values) * value) + 1e-12
    assert [adjusted[index] for index in np.argsort(values, kind="stable")] == sorted(adjusted)
    assert holm([0.01, 0.04, 0.03]) == pytest.approx([0.03, 0.06, 0.06])


# The best of several seeds.


@pytest.fixture
def spec(tmp_path: Path, in_small_world: None) -> fp.RunSpec:
    Image.open(Path(targets.__file__).with_name("coffee.jpg")).resize((120, 90)).save(tmp_path / "coffee.png")
    small = {"strokes": 4, "canvas": "120x90mm", "render_height": 64, "effort": 0.05, "brush": "fine", "colors": 2}
    return fp.RunSpec.of(**small, ground="auto", goal=[{"image": str(tmp_path / "coffee.png")}], seed=7)


def test_the_plan_of_the_best_seed_is_chosen_on_its_ground(tmp_path: Path, spec: fp.RunSpec, monkeypatch) -> None:
    monkeypatch.setattr(carrier, "Engine", lambda limits, slots: Here())
    best, plan_of_best, told = best_candidate(spec, 2, tmp_path / "candidates", silent)
    expected = {}
    for seed in (7, 8):
        with fp.PaintingRun(spec.with_values(seed=seed)) as run:
            plan = run.plan()
            expected[seed] = run.planner.forecast(plan, run.planner.bare).expected, plan
    assert best.seed == max(expected, key=lambda seed: expected[seed][0])
    assert torch.equal(plan_of_best.strokes.position, expected[best.seed][1].strokes.position)
    assert told.startswith(f"The best of 2 seeds is {best.seed}: expected dB ")
    assert best == spec.with_values(seed=best.seed, ground=ground_of(plan_of_best))


def test_words_are_judged_by_what_they_say_and_no_plan_is_told(tmp_path: Path, spec: fp.RunSpec, monkeypatch) -> None:
    near, right = (
        {"figures": {"expected dB": decibels, "loss of the plan": loss}}
        for decibels, loss in ((20.0, 0.9), (15.0, 0.4))
    )
    words = fp.RunSpec.of(goal=[{"text": "a lemon"}])
    assert rank_plans(words, [near, right]) == ("loss of the plan", [right, near])
    assert rank_plans(spec, [right, near]) == ("expected dB", [near, right])
    assert rank_plans(spec, [near, {"figures": {"loss of the plan": 0.4}}])[0] == "loss of the plan"

    def fail(share: object) -> None:
        raise TryFailed("It exploded.")

    monkeypatch.setattr(carrier, "Engine", lambda limits, slots: Here(fail))
    with pytest.raises(PlanError, match="None of the 2 seeds made a plan: It exploded"):
        best_candidate(spec, 2, tmp_path / "candidates", silent)
