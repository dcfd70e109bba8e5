"""How much an experiment about strokes does; one about paintings has a RunSpec in its place."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class ExperimentScale:
    """strokes: that are painted, in a sweep or for a library; held_out: strokes that no model learns from.

    sizes: numbers of strokes for training and validation, where there are several; folds: trainings of each;
    quick: as little as possible, so that figures mean nothing.
    """

    strokes: int
    held_out: int = 0
    sizes: tuple[int, ...] = ()
    folds: int = 1
    quick: bool = False
