"""Goal "image": a picture to reproduce pixel by pixel."""

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
    """Base class of terms with a picture.

    image [3, H, W]: sRGB in [0, 1]
    called: name in messages
    longest: longer side in pixels to which a file is shrunk; None to keep its size
    Raises ConfigError if the weight is invalid.
    """

    image: Tensor
    weight: float = 1.0
    called: ClassVar[str] = "a picture"
    longest: ClassVar[int | None] = None

    def __post_init__(self) -> None:
        require_weight(self.weight, self.called)

    def as_start(self, goal: Goal) -> ImageTerm:
        """Returns an ImageTerm with the same picture, weight and importance."""
        return ImageTerm(self.image, self.weight, self.importance)

    def fit_to(self, rows: int, columns: int, *, pad: bool = False) -> Self:
        """Returns the term with its picture fitted to `rows` x `columns`."""
        from frida_painter import images

        return replace(self, image=(images.pad if pad else images.fit)(self.image, rows, columns))

    def crop(self, box: tuple[float, float, float, float]) -> Self:
        """Returns the term with a part of its picture. Raises ConfigError if that part is no goal of this kind."""
        from frida_painter import images

        return replace(self, image=images.crop(self.image, box))

    @classmethod
    def open(cls, path: Path, weight: float = 1.0) -> Self:
        """Returns the term of a picture file. Raises ConfigError and ImageError."""
        from frida_painter import images

        picture = images.load(path) if cls.longest is None else images.load(path, longest=cls.longest)
        return cls(picture, weight)


@dataclass(frozen=True)
class ImageTerm(PictureTerm):
    """Term of a goal: reproduce a picture pixel by pixel.

    importance [h, w]: importance of each place, with mean 1; None if uniform
    wanted [3, h, w]: picture that the planner compares with, so that the painting looks like `image`; None for
    `image`
    """

    importance: Tensor | None = None
    wanted: Tensor | None = None
    initial_order = 0
    interpretation_order = 5
    is_tried = False
    is_pixelwise = True
    can_be_weighed = True

    def weigh(self, importance: Tensor) -> Self:
        """Returns the term with this importance of each place."""
        return replace(self, importance=importance)

    def as_start(self, goal: Goal) -> ImageTerm:
        """Returns the term itself, with its importance."""
        return self

    @property
    def picture(self) -> Tensor:
        """Picture to paint."""
        return self.image

    @property
    def guide(self) -> Tensor:
        """Picture that the planner compares with."""
        return self.image if self.wanted is None else self.wanted

    def fit_to(self, rows: int, columns: int, *, pad: bool = False) -> Self:
        """Returns the term with its picture fitted to `rows` x `columns`; a smaller picture keeps its pixels.

        It is shrunk again later to the planning image, so it is not softened here.
        """
        from frida_painter import images

        if pad:
            return super().fit_to(rows, columns, pad=True)
        scale = min(1.0, self.image.shape[1] / rows, self.image.shape[2] / columns)
        fewer = max(1, round(scale * rows)), max(1, round(scale * columns))
        return replace(self, image=images.resize_by_area(self.image, *fewer))

    def with_picture(self, picture: Tensor) -> ImageTerm:
        """Returns the term with another picture and the same importance."""
        return replace(self, image=picture, wanted=None)

    def prepare(self, context: ObjectiveContext) -> ObjectiveTerm:
        """Returns the mean squared difference to `guide`."""
        from frida_painter.objectives.pixel_loss import Replication

        return _term_of(Replication.of(self.guide, context.grid, self.importance))

    @classmethod
    def interpret(cls, goal: Goal, context: ObjectiveContext) -> Goal:
        """Sharpens photographs to compensate for the blur of painting, if the goal has no other terms.

        Beside other terms, photographs stay unchanged, because the other terms set the edges.
        """
        from frida_painter.objectives.pixel_loss import fit_and_sharpen

        photographs = [term for term in goal.terms if isinstance(term, cls)]
        if context.sharpness == 0 or len(photographs) < len(goal.terms):
            return goal
        terms = [
            replace(one, wanted=fit_and_sharpen(one.image, context.sharpness, context.grid)) for one in photographs
        ]
        return replace(goal, terms=tuple(terms))


def _term_of(judge: Replication) -> ObjectiveTerm:
    return ObjectiveTerm(judge, of_variance=judge.of_variance, on_rows=lambda rows: _term_of(judge.on_rows(rows)))


IMAGE = GoalKind(
    name="image",
    gives=Gives.PICTURE,
    help="Another picture to reproduce, pixel by pixel.",
    label="Picture",
    open=ImageTerm.open,
    initial_help="A picture to start from. The painting keeps its composition.",
)
