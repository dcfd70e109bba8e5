"""Means, intervals and paired tests, against what is known of them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from frida_painter.lab.sweeps.report import Mean, Result, holm, means, paired_tests


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
    found = [Mean.of(chance.normal(3.0, 2.0, 5).tolist()) for _ in range(2000)]
    share = np.mean([one.low <= 3.0 <= one.high for one in found])
    assert 0.935 <= share <= 0.965
    assert Mean.of([2.0]) == Mean(2.0, 2.0, 2.0, 1)


def test_pairs_show_what_means_hide() -> None:
    some = results(0.3)
    (test,) = paired_tests(some, ["strokes"])
    assert (test.first, test.second, test.difference.count, test.more) == (50, 100, 8, 8)
    assert test.t < 0.001 and abs(test.difference.value - 0.3) < 0.15
    points = means(some, "strokes", None)[None]
    assert points[50.0].high > points[100.0].value, "the intervals of the means overlap"


@pytest.mark.slow
def test_nothing_is_found_where_there_is_nothing() -> None:
    found = [paired_tests(results(0.0, draw=draw), ["strokes"])[0] for draw in range(300)]
    assert 0.02 <= np.mean([test.t < 0.05 for test in found]) <= 0.09
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


def test_means_by_series() -> None:
    found = means([Result({"n": n, "way": way}, n + 10 * (way == "x")) for n in (1, 2) for way in "xy"], "n", "way")
    assert {way: [one.value for one in points.values()] for way, points in found.items()} == {
        "x": [11.0, 12.0],
        "y": [1.0, 2.0],
    }


@given(st.lists(st.floats(0, 1), max_size=12))
def test_holm_keeps_the_order_and_lies_between_the_value_and_bonferroni(values: list[float]) -> None:
    adjusted = holm(values)
    for value, its in zip(values, adjusted, strict=True):
        assert value <= its <= min(1.0, len(values) * value) + 1e-12
    assert [adjusted[index] for index in np.argsort(values, kind="stable")] == sorted(adjusted)


def test_holm_by_an_example() -> None:
    assert holm([0.01, 0.04, 0.03]) == pytest.approx([0.03, 0.06, 0.06])


def test_the_tests_are_those_of_scipy() -> None:
    some = results(0.05)
    (test,) = paired_tests(some, ["strokes"])
    before, after = ([one.figure for one in some if one.labels["strokes"] == strokes] for strokes in (50, 100))
    assert test.t == pytest.approx(stats.ttest_rel(after, before).pvalue)
    assert test.wilcoxon == pytest.approx(stats.wilcoxon(after, before).pvalue)
