"""Means with confidence intervals, and paired tests between two values of a field.

Two runs are a pair if they differ in one field only: the same photograph, the same seed, and all other varied fields.
Some of many tests would be significant by chance, so that their p-values are adjusted by Holm's method.
"""

import math
import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from frida_painter_lab.runs import Labels, Value

CONFIDENCE = 0.95
_FEWEST = 3  # pairs, for a test


@dataclass(frozen=True)
class Result:
    """Result of one run: the varied fields, and a figure."""

    labels: Labels
    figure: float


@dataclass(frozen=True)
class Mean:
    """Mean over runs with its 95 % confidence interval; for one run only the value."""

    value: float
    low: float
    high: float
    count: int

    @classmethod
    def of(cls, values: Sequence[float]) -> "Mean":
        """Returns the mean with its interval, by Student's t distribution."""
        from scipy.stats import t

        mean, count = float(np.mean(values)), len(values)
        error = np.std(values, ddof=1) / math.sqrt(count) if count > 1 else 0.0
        half = float(t.ppf((1 + CONFIDENCE) / 2, max(count - 1, 1)) * error)
        return cls(mean, mean - half, mean + half, count)


@dataclass(frozen=True)
class FieldEffect:
    """Effect of a field on a figure: the change from one value to another with all other fields equal.

    difference: mean of second - first
    more: number of pairs in which the second is larger
    t, wilcoxon: p-values of the paired t-test and of Wilcoxon's signed-rank test, adjusted by Holm's method over
        all tests of a list
    """

    field: str
    first: Value
    second: Value
    difference: Mean
    more: int
    t: float
    wilcoxon: float


def means(results: Iterable[Result], field: str, series: str | None) -> dict[Value, dict[float, Mean]]:
    """Returns the means by the value of `series` (None: all runs together), then by a numeric field, in order."""
    groups: dict[Value, dict[float, list[float]]] = {}
    for one in results:
        place = one.labels.get(field)
        if isinstance(place, int | float):
            name = one.labels.get(series) if series is not None else None
            groups.setdefault(name, {}).setdefault(float(place), []).append(one.figure)
    return {
        name: {place: Mean.of(values) for place, values in sorted(points.items())} for name, points in groups.items()
    }


def paired_tests(results: Sequence[Result], fields: Iterable[str]) -> tuple[FieldEffect, ...]:
    """Returns a test for every two values of every field that have at least three pairs of runs."""
    found = [
        test
        for field in fields
        for first, second in combinations(dict.fromkeys(one.labels.get(field) for one in results), 2)
        if (test := _test(results, field, first, second)) is not None
    ]
    t, wilcoxon = ([getattr(test, name) for test in found] for name in ("t", "wilcoxon"))
    adjusted = zip(found, holm(t), holm(wilcoxon), strict=True)
    return tuple(replace(test, t=its_t, wilcoxon=its_w) for test, its_t, its_w in adjusted)


def holm(values: Sequence[float]) -> list[float]:
    """Returns p-values adjusted for their number (Holm 1979)."""
    order, count = np.argsort(values, kind="stable"), len(values)
    adjusted = np.maximum.accumulate(np.minimum(1.0, (count - np.arange(count)) * np.array(values)[order]))
    return [float(one) for one in adjusted[np.argsort(order)]]


def _test(results: Sequence[Result], field: str, first: Value, second: Value) -> FieldEffect | None:
    from scipy.stats import ttest_rel, wilcoxon

    sides: tuple[dict[object, float], dict[object, float]] = ({}, {})
    for one in results:
        if one.labels.get(field) in (first, second):
            rest = tuple(sorted((name, repr(value)) for name, value in one.labels.items() if name != field))
            sides[int(one.labels.get(field) != first)][rest] = one.figure
    both = [key for key in sides[0] if key in sides[1]]
    if len(both) < _FEWEST:
        return None
    before, after = (np.array([side[key] for key in both]) for side in sides)
    difference = after - before
    if not difference.any():
        p_t = p_wilcoxon = 1.0
    else:
        with warnings.catch_warnings():  # of differences that are all equal
            warnings.simplefilter("ignore", RuntimeWarning)
            p_t, p_wilcoxon = float(ttest_rel(after, before).pvalue), float(wilcoxon(difference).pvalue)
    return FieldEffect(
        field, first, second, Mean.of(difference.tolist()), int((difference > 0).sum()),
        0.0 if math.isnan(p_t) else p_t, p_wilcoxon,
    )  # fmt: skip
