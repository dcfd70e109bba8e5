"""What an objective is, and how the terms of a goal become one."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import singledispatch
from typing import Any, Protocol

from torch import Tensor

from frida_painter import images
from frida_painter.errors import ConfigError
from frida_painter.frames import PixelGrid
from frida_painter.goal import Goal, ImageTerm, SemanticTerm, SketchTerm, StyleTerm, TextTerm
from frida_painter.objectives.encoders.registry import EncoderRegistry
from frida_painter.objectives.replication import replication


class Objective(Protocol):
    """Judges a picture of the canvas: the less, the nearer to the goal. Differentiable."""

    def __call__(self, picture: Tensor) -> Tensor:
        """picture [3, H, W] in [0, 1] -> a number."""


@dataclass(frozen=True)
class ObjectiveContext:
    """What objectives are prepared for: the pictures' grid, the networks at hand, the run's seed."""

    grid: PixelGrid
    encoders: EncoderRegistry
    seed: int


@dataclass(frozen=True)
class ObjectiveTerm:
    """One term, ready to judge pictures.

    judge: where the objective looks at a picture in another way every time, or could be fooled,
    what says in the end whether a picture is good: steady, and best a network kept aside.
    """

    objective: Callable[[Tensor], Tensor]
    judge: Callable[[Tensor], Tensor] | None = None


@singledispatch
def prepare_term(term: Any, setting: ObjectiveContext) -> ObjectiveTerm:
    """The objective of one term; a new kind of term registers its own. Targets are prepared here, once."""
    raise ConfigError(f"No objective is known for {type(term).__name__}; register one with prepare_term.")


@prepare_term.register
def _(term: ImageTerm, setting: ObjectiveContext) -> ObjectiveTerm:
    return ObjectiveTerm(replication(term.image, setting.grid, term.importance))


@prepare_term.register
def _(term: StyleTerm, setting: ObjectiveContext) -> ObjectiveTerm:
    from frida_painter.objectives.style import Style

    return ObjectiveTerm(Style(term.image, setting.encoders.style(), setting.seed))


@prepare_term.register
def _(term: SemanticTerm, setting: ObjectiveContext) -> ObjectiveTerm:
    from frida_painter.objectives.semantic import Semantic

    # What will fill the canvas is what is shown, and the judge is a network that the optimiser never asks.
    shown = images.fit(term.image, setting.grid.rows, setting.grid.columns)
    trunk = setting.encoders.shapes()
    aside = Semantic(shown, setting.encoders.aside(), setting.seed, trunk)
    return ObjectiveTerm(Semantic(shown, setting.encoders.meaning(), setting.seed, trunk), aside.judge)


@prepare_term.register
def _(term: SketchTerm, setting: ObjectiveContext) -> ObjectiveTerm:
    from frida_painter.objectives.semantic import Semantic
    from frida_painter.objectives.sketch import Sketch

    drawing = images.fit(term.drawing if term.shown is None else term.shown, setting.grid.rows, setting.grid.columns)
    shown = Semantic(drawing, setting.encoders.meaning(), setting.seed)
    hed = setting.encoders.edges()
    return ObjectiveTerm(Sketch(drawing, hed, shown), Sketch(drawing, hed, shown.judge))


@prepare_term.register
def _(term: TextTerm, setting: ObjectiveContext) -> ObjectiveTerm:
    from frida_painter.objectives.text import Text

    readers = setting.encoders.readers()
    if not all(reader.reads_all(term.prompt) for reader in readers):
        setting.encoders.remark(f"The words {term.prompt[:40]!r}... are too many to be read; the last were cut off.")
    words = Text(term.prompt, readers, setting.seed)
    aside = setting.encoders.reader_aside()
    judge = words if aside is None else Text(term.prompt, [aside], setting.seed)
    return ObjectiveTerm(words, judge.judge)


class WeightedObjective:
    """The weighted sum of a goal's terms (paper, Eq. for p_next): itself an objective."""

    def __init__(self, terms: Sequence[tuple[float, ObjectiveTerm]]) -> None:
        self._terms = tuple(terms)

    def __call__(self, picture: Tensor) -> Tensor:
        """picture [3, H, W] in [0, 1] -> a number, the less the better; differentiable."""
        total = picture.new_zeros(())
        for weight, term in self._terms:
            total = total + weight * term.objective(picture)
        return total

    @property
    def judge(self) -> Objective | None:
        """What says which of several pictures is best; None where the sum itself says it."""
        return self._judge if any(term.judge is not None for _, term in self._terms) else None

    def _judge(self, picture: Tensor) -> Tensor:
        total = picture.new_zeros(())
        for weight, term in self._terms:
            total = total + weight * (term.judge or term.objective)(picture)
        return total


def prepare(goal: Goal, grid: PixelGrid, encoders: EncoderRegistry | None = None, seed: int = 0) -> WeightedObjective:
    """The aim of the goal for pictures of that grid.

    encoders: the networks that terms other than pictures are seen through; by default those that
    were fetched. Raises WeightsError where one is missing.
    """
    setting = ObjectiveContext(grid, encoders or EncoderRegistry(), seed)
    return WeightedObjective([(term.weight, prepare_term(term, setting)) for term in goal.terms])
