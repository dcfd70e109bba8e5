"""A picture to be painted by what it shows, rather than pixel by pixel."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from frida_painter.objectives.image import ImageTerm, PictureTerm
from frida_painter.objectives.objective import Gives, Goal, GoalKind, ObjectiveContext, ObjectiveTerm

if TYPE_CHECKING:
    from torch import Tensor


@dataclass(frozen=True)
class SemanticTerm(PictureTerm):
    """Paint what this picture shows rather than its pixels."""

    called = "a picture to be painted by its meaning"
    initial_order = 2
    interpretation_order = 4

    @property
    def picture(self) -> Tensor:
        """The picture itself."""
        return self.image

    def with_picture(self, picture: Tensor) -> SemanticTerm:
        """The same for another picture."""
        return replace(self, image=picture)

    def prepare(self, context: ObjectiveContext) -> ObjectiveTerm:
        """The difference as networks see it; it is validated by a network that the optimiser never asks."""
        from frida_painter import images
        from frida_painter.objectives.semantic_loss import Semantic

        # What will fill the canvas is what is shown.
        shown = images.fit(self.image, context.grid.rows, context.grid.columns)
        trunk = context.encoders.shapes()
        aside = Semantic(shown, context.encoders.aside(), context.seed, trunk)
        seen = Semantic(shown, context.encoders.meaning(), context.seed, trunk)
        return ObjectiveTerm(seen, aside.validation)

    @classmethod
    def interpret(cls, goal: Goal, context: ObjectiveContext) -> Goal:
        """The plan begins with the picture's pixels, attended to where its meaning is."""
        from frida_painter.objectives.attention import attended

        return attended(goal, context.encoders)


KIND = GoalKind(
    name="semantic",
    gives=Gives.PICTURE,
    help="A picture to paint by its content, not pixel by pixel.",
    label="Content of",
    open=SemanticTerm.open,
    begin=ImageTerm.open,
    networks=(("efficientnet-lite0",),),
)
