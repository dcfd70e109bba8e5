"""A picture to come near to, pixel by pixel."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Self

from frida_painter.objectives.objective import (
    Gives,
    Goal,
    GoalKind,
    ObjectiveContext,
    ObjectiveTerm,
    Term,
    require_weight,
)

if TYPE_CHECKING:
    from pathlib import Path

    from torch import Tensor

    from frida_painter.objectives.pixel_loss import Replication


@dataclass(frozen=True)
class PictureTerm(Term):
    """A term with a picture, `image` [3, H, W] in [0, 1], mattering by `weight` > 0. Raises ConfigError.

    called: what messages call it; longest: pixels of the longer side to which a file is reduced, None: it is not.
    """

    image: Tensor
    weight: float = 1.0
    called: ClassVar[str] = "a picture"
    longest: ClassVar[int | None] = None

    def __post_init__(self) -> None:
        require_weight(self.weight, self.called)

    def begun(self, goal: Goal) -> ImageTerm:
        """The pixels of the picture."""
        return ImageTerm(self.image, self.weight)

    def fitted(self, rows: int, columns: int, *, pad: bool = False) -> Self:
        """The picture as it fills so many rows and columns."""
        from frida_painter import images

        return replace(self, image=(images.pad if pad else images.fit)(self.image, rows, columns))

    @classmethod
    def open(cls, path: Path, weight: float = 1.0) -> Self:
        """The term of a picture's file. Raises ConfigError and ImageError."""
        from frida_painter import images

        picture = images.load(path) if cls.longest is None else images.load(path, longest=cls.longest)
        return cls(picture, weight)


@dataclass(frozen=True)
class ImageTerm(PictureTerm):
    """Paint this picture.

    importance [h, w]: how much each of its places matters, 1 in the mean; None: all the same. wanted [3, h, w]: what is
    planned towards so that the painting looks like the picture; None: the picture itself.
    """

    importance: Tensor | None = None
    wanted: Tensor | None = None
    initial_order = 0
    interpretation_order = 5
    is_pixelwise = True

    def begun(self, goal: Goal) -> ImageTerm:
        """Itself, with the places that matter."""
        return self

    @property
    def picture(self) -> Tensor:
        """The picture itself."""
        return self.image

    @property
    def guide(self) -> Tensor:
        """What is planned towards."""
        return self.image if self.wanted is None else self.wanted

    def fitted(self, rows: int, columns: int, *, pad: bool = False) -> Self:
        """The picture as it fills so many rows and columns; a smaller one keeps the pixels that it has.

        It will be shrunk again, to where it is planned and judged, and is not softened on the way.
        """
        from frida_painter import images

        if pad:
            return super().fitted(rows, columns, pad=True)
        scale = min(1.0, self.image.shape[1] / rows, self.image.shape[2] / columns)
        fewer = max(1, round(scale * rows)), max(1, round(scale * columns))
        return replace(self, image=images.averaged(self.image, *fewer))

    def with_picture(self, picture: Tensor) -> ImageTerm:
        """The same for another picture, in which the same places matter."""
        return replace(self, image=picture, wanted=None)

    def prepare(self, context: ObjectiveContext) -> ObjectiveTerm:
        """The mean squared difference to what is planned towards."""
        from frida_painter.objectives.pixel_loss import Replication

        return _term_of(Replication.of(self.guide, context.grid, self.importance))

    @classmethod
    def interpret(cls, goal: Goal, context: ObjectiveContext) -> Goal:
        """Photographs alone are planned towards as much sharper as painting makes them softer.

        Beside anything else they stay as they are, for then other terms say what is wanted of edges.
        """
        from frida_painter.objectives.pixel_loss import sharpened

        photographs = [term for term in goal.terms if isinstance(term, cls)]
        if context.sharpness == 0 or len(photographs) < len(goal.terms):
            return goal
        terms = [replace(one, wanted=sharpened(one.image, context.sharpness, context.grid)) for one in photographs]
        return replace(goal, terms=tuple(terms))


def _term_of(judge: Replication) -> ObjectiveTerm:
    return ObjectiveTerm(judge, of_variance=judge.of_variance, on_rows=lambda rows: _term_of(judge.on_rows(rows)))


KIND = GoalKind(
    name="image",
    gives=Gives.PICTURE,
    help="Another picture to reproduce, pixel by pixel.",
    label="Picture",
    open=ImageTerm.open,
    initial_help="A picture to start from. The painting keeps its composition.",
)
