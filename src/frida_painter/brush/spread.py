"""How much the coverage of a mark varies from stroke to stroke, where its mean is known.

Of a number in [0, full] with mean m the variance is at most m (full - m): it is that where the number is either 0 or
full, as at the edge of an opaque mark that lands now here, now there. Marks come near it by the same share nearly
everywhere, so that one number tells the variance of all places of all marks of a brush.
"""

from collections.abc import Callable
from typing import NamedTuple, Self

import torch
from torch import Tensor

from frida_painter.brush.stroke_model import StrokeModel

_FULL = (0.5, 1.0, 51)  # least, most and number of those that are tried


class CoverageSpread(NamedTuple):
    """The variance of coverage with mean m is `share` m (full - m), and 0 where m is above `full`.

    share: in [0, 1], 0 where every mark is as predicted; full: the coverage of a mark's solid parts, in (0, 1].
    """

    share: float = 0.0
    full: float = 1.0

    def variance(self, mean: Tensor) -> Tensor:
        """The variance of coverage of that mean, any shape, in [0, 1/4]."""
        return self.share * mean * (self.full - mean).clamp(min=0)

    @classmethod
    def fitted(cls, mean: Tensor, coverage: Tensor) -> Self:
        """What explains best, in least squares, how far coverage was from its mean; both any shape, in [0, 1].

        Take marks that the model of the mean did not learn from.
        """
        missed, best, least = (coverage - mean).square(), cls(), float("inf")
        for full in torch.linspace(*_FULL).tolist():
            whole = mean * (full - mean).clamp(min=0)
            share = min(1.0, float((missed * whole).sum() / whole.square().sum().clamp(min=1e-12)))
            left = float((missed - share * whole).square().sum())
            if left < least:
                best, least = cls(share, full), left
        return best

    def widened(self, factor: float) -> Self:
        """The spread of marks whose variance is `factor` times as large, as far as it can be."""
        return self._replace(share=min(1.0, factor * self.share))

    def require(self) -> Self:
        """Itself. Raises ValueError where a number is out of its range."""
        if not (0 <= self.share <= 1 and 0 < self.full <= 1):
            raise ValueError(f"a spread of {self.share} and {self.full}")
        return self


CERTAIN = CoverageSpread()
"""Of a model that says nothing of how marks vary."""


def median_of(model: StrokeModel) -> Callable[[Tensor, Tensor, Tensor], Tensor]:
    """What gives the median of a model's marks, from thickness, length and bend: the model, where it knows no other."""
    return getattr(model, "median", model)


def spread_of(model: object) -> CoverageSpread:
    """How the marks of a stroke model vary: its `spread`; CERTAIN for one that does not say."""
    return getattr(model, "spread", CERTAIN)
