"""A picture to come near to, pixel by pixel."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from frida_painter.goal import Term, require_weight
from frida_painter.objectives.kind import Gives, GoalKind
from frida_painter.objectives.objective import ObjectiveContext, ObjectiveTerm

if TYPE_CHECKING:
    from pathlib import Path

    from torch import Tensor


@dataclass(frozen=True)
class ImageTerm(Term):
    """Paint this picture: `image` [3, H, W] in [0, 1], mattering by `weight` > 0. Raises ConfigError.

    importance [h, w]: how much each of its places matters, 1 in the mean; None: all the same.
    """

    image: Tensor
    weight: float = 1.0
    importance: Tensor | None = None
    initial_order = 0
    is_pixelwise = True

    def __post_init__(self) -> None:
        require_weight(self.weight, "a picture")

    @property
    def picture(self) -> Tensor:
        """The picture itself."""
        return self.image

    def with_picture(self, picture: Tensor) -> ImageTerm:
        """The same for another picture, in which the same places matter."""
        return replace(self, image=picture)

    def fitted(self, rows: int, columns: int, *, pad: bool = False) -> ImageTerm:
        """The picture as it fills so many rows and columns."""
        from frida_painter import images

        return replace(self, image=(images.pad if pad else images.fit)(self.image, rows, columns))

    def prepare(self, context: ObjectiveContext) -> ObjectiveTerm:
        """The mean squared difference to the picture."""
        from frida_painter.objectives.replication import replication, replication_of_variance

        return ObjectiveTerm(
            replication(self.image, context.grid, self.importance),
            of_variance=replication_of_variance(context.grid, self.importance),
        )


def open_image(path: Path, weight: float = 1.0) -> ImageTerm:
    """The term of a picture's file. Raises ConfigError and ImageError."""
    from frida_painter import images

    return ImageTerm(images.load(path), weight)


KIND = GoalKind(
    name="image",
    gives=Gives.PICTURE,
    help="Another picture to reproduce, pixel by pixel.",
    label="Picture",
    open=open_image,
    initial_help="A picture to start from. The painting keeps its composition.",
)
