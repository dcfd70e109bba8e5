"""How much the coverage of a mark varies from stroke to stroke, where its mean is known.

Of a number in [0, full] with mean m the variance is at most m (full - m): it is that where the number is either 0 or
full, as at the edge of an opaque mark that lands now here, now there. Marks come near it by the same share nearly
everywhere, so that one number tells the variance of all places of all marks of a brush.
"""

import math
from typing import NamedTuple

from torch import Tensor


class CoverageSpread(NamedTuple):
    """The variance of coverage with mean m is `share` m (full - m), and 0 where m is above `full`.

    share: in [0, 1], 0 where every mark is as predicted; full: the coverage of a mark's solid parts, in (0, 1].
    """

    share: float = 0.0
    full: float = 1.0

    def variance(self, mean: Tensor) -> Tensor:
        """The variance of coverage of that mean, any shape, in [0, 1/4]."""
        return self.share * mean * (self.full - mean).clamp(min=0)

    @property
    def is_valid(self) -> bool:
        """Whether both numbers are in their ranges."""
        return 0 <= self.share <= 1 and 0 < self.full <= 1 and math.isfinite(self.share)


CERTAIN = CoverageSpread()
"""Of a model that says nothing of how marks vary."""


def spread_of(model: object) -> CoverageSpread:
    """How the marks of a stroke model vary: its `spread`; CERTAIN for one that does not say."""
    return getattr(model, "spread", CERTAIN)
