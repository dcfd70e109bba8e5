"""Goal "semantic": a picture to paint by its content, not pixel by pixel."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from frida_painter.objectives.image import ImageTerm, PictureTerm
from frida_painter.objectives.objective import GRADIENT_LASTS, Gives, Goal, GoalKind, ObjectiveContext, ObjectiveTerm

if TYPE_CHECKING:
    from torch import Tensor


USUAL_FREEDOM = 0.5
"""Freedom of colours with which a painting is bold, and shows what it is."""


@dataclass(frozen=True)
class SemanticTerm(PictureTerm):
    """Term of a goal: paint the content of a picture, not its pixels.

    freedom: how far the colours may leave those of the picture, from 0, hardly, to 1, wild
    importance [h, w]: importance of each place, with mean 1; None if uniform
    """

    freedom: float = USUAL_FREEDOM
    importance: Tensor | None = None

    called = "a picture to be painted by its meaning"
    is_tried = False
    can_be_weighed = True
    is_loose = True
    initial_order = 2
    interpretation_order = 4

    @property
    def picture(self) -> Tensor:
        """Picture to paint."""
        return self.image

    def with_picture(self, picture: Tensor) -> SemanticTerm:
        """Returns the term with another picture."""
        return replace(self, image=picture)

    def weigh(self, importance: Tensor) -> SemanticTerm:
        """Returns the term with this importance of each place."""
        return replace(self, importance=importance)

    def free_colors(self, freedom: float) -> SemanticTerm:
        """Returns the term with this freedom of its colours; above 0.5 those of its picture are further apart."""
        from frida_painter.objectives.semantic_loss import spread_colors

        return replace(self, image=spread_colors(self.image, freedom), freedom=freedom)

    def prepare(self, context: ObjectiveContext) -> ObjectiveTerm:
        """Returns the difference as networks see it. The validation uses a network that the optimiser does not use."""
        from frida_painter import images
        from frida_painter.objectives.semantic_loss import Semantic

        # Only the part that fills the canvas counts as content.
        shown = images.fit(self.image, context.grid.rows, context.grid.columns)
        trunk = context.encoders.shapes()
        aside = Semantic(shown, context.encoders.aside(), context.seed, trunk, self.freedom, self.importance)
        seen = Semantic(shown, context.encoders.meaning(), context.seed, trunk, self.freedom, self.importance)
        lasts = GRADIENT_LASTS if context.in_style else 1
        return ObjectiveTerm(seen, aside.validation, lasts=lasts, smooth=context.in_style)

    @classmethod
    def interpret(cls, goal: Goal, context: ObjectiveContext) -> Goal:
        """Lets the plan begin with the pixels of the picture, weighted by their importance for its content."""
        from frida_painter.objectives.attention import start_from_meaning

        return start_from_meaning(goal, context.encoders)


KIND = GoalKind(
    name="semantic",
    gives=Gives.PICTURE,
    help="A picture to paint by its content, not pixel by pixel.",
    label="Content of",
    open=SemanticTerm.open,
    begin=ImageTerm.open,
    networks=(("efficientnet-lite0",),),
)
