"""What the results of a sweep show: means with confidence intervals, and paired tests between the values of a field.

Two runs are a pair where they differ in one field alone: the same photograph, the same seed, and all else that was
varied. Of many tests some would be significant by chance, so their p-values are adjusted by Holm's method.
"""

import math
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from frida_painter.sweeps.run import Value

CONFIDENCE = 0.95
_FEWEST = 3  # pairs, for a test


@dataclass(frozen=True)
class Result:
    """One run: the fields that were varied, and a figure of it."""

    labels: Mapping[str, Value]
    figure: float


@dataclass(frozen=True)
class Mean:
    """A mean over runs, and the interval that holds the true one with 95 % confidence; of one run only the value."""

    value: float
    low: float
    high: float
    count: int

    @classmethod
    def of(cls, values: Sequence[float]) -> "Mean":
        """By Student's t distribution."""
        from scipy.stats import t

        mean = float(np.mean(values))
        if len(values) < 2:
            return cls(mean, mean, mean, len(values))
        half = float(t.ppf((1 + CONFIDENCE) / 2, len(values) - 1) * np.std(values, ddof=1) / math.sqrt(len(values)))
        return cls(mean, mean - half, mean + half, len(values))


@dataclass(frozen=True)
class FieldEffect:
    """How a figure changes where a field goes from one value to another, all else being equal.

    difference: the mean of second - first; t, wilcoxon: p-values of the paired t-test and of Wilcoxon's signed-rank
    test, adjusted by Holm's method over all tests of a list; more: in how many pairs the second is larger.
    """

    field: str
    first: Value
    second: Value
    difference: Mean
    more: int
    t: float
    wilcoxon: float


def means(results: Iterable[Result], field: str, series: str | None) -> dict[Value, dict[float, Mean]]:
    """Means by the value of `series` (None: all runs together) and of a field of numbers, in their order."""
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
    """A test for every two values of every field that has three pairs of runs or more."""
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
    """P-values adjusted for their number (Holm 1979)."""
    order = sorted(range(len(values)), key=lambda index: values[index])
    adjusted, largest = [0.0] * len(values), 0.0
    for rank, index in enumerate(order):
        largest = max(largest, min(1.0, (len(values) - rank) * values[index]))
        adjusted[index] = largest
    return adjusted


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
        with warnings.catch_warnings():  # of differences that are all the same
            warnings.simplefilter("ignore", RuntimeWarning)
            p_t, p_wilcoxon = float(ttest_rel(after, before).pvalue), float(wilcoxon(difference).pvalue)
    return FieldEffect(
        field, first, second, Mean.of(difference.tolist()), int((difference > 0).sum()),
        0.0 if math.isnan(p_t) else p_t, p_wilcoxon,
    )  # fmt: skip
