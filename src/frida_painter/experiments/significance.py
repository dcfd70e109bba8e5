"""Whether one model is really better than another on the same strokes: paired tests."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats


@dataclass(frozen=True)
class PairedTest:
    """What two tests say of paired errors.

    difference: mean of first minus second; better: for how many pairs the first is smaller; t_p:
    two-sided p of the paired t-test; wilcoxon_p: of Wilcoxon's signed-rank test, which asks for no
    normal distribution. Both are 1 where all pairs are equal.
    """

    difference: float
    better: int
    t_p: float
    wilcoxon_p: float

    @classmethod
    def of(cls, first: NDArray[np.float64], second: NDArray[np.float64]) -> "PairedTest":
        """The tests of two rows of errors [n] on the same n >= 2 things."""
        apart = first - second
        if not apart.any():
            return cls(0.0, 0, 1.0, 1.0)
        return cls(
            float(apart.mean()),
            int((apart < 0).sum()),
            float(stats.ttest_rel(first, second).pvalue),
            float(stats.wilcoxon(first, second).pvalue),
        )
