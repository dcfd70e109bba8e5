"""Goal "style": a picture whose style the painting takes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Self

from frida_painter.errors import ConfigError
from frida_painter.objectives.image import PictureTerm
from frida_painter.objectives.objective import GRADIENT_LASTS, Gives, Goal, GoalKind, ObjectiveContext, ObjectiveTerm

if TYPE_CHECKING:
    from torch import Tensor


_FLAT = 0.01  # standard deviation below which a picture has a single colour


@dataclass(frozen=True)
class StyleTerm(PictureTerm):
    """Term of a goal: paint in the style of a picture. Raises ConfigError if the picture has a single colour.

    free [h, w]: places of the painting that are free of the style, such as faces, 1, and others, 0; None if none is
    """

    free: Tensor | None = None

    called = "a style"
    is_tried = False
    longest = 1024  # pixels; styles are compared in small pictures
    initial_order = 3
    interpretation_order = 3

    def __post_init__(self) -> None:
        super().__post_init__()
        if not float(self.image.flatten(1).std(1).max()) >= _FLAT:
            raise ConfigError("A style picture of a single colour was given, which has no style; give another picture.")

    @property
    def colors(self) -> Tensor:
        """Style picture."""
        return self.image

    def fit_to(self, rows: int, columns: int, *, pad: bool = False) -> Self:
        """Returns the term unchanged: a style does not fill the canvas."""
        return self

    def prepare(self, context: ObjectiveContext) -> ObjectiveTerm:
        """Returns the distance in style by VGG16, and by a CLIP's layers too if there is one."""
        from frida_painter.objectives.style_loss import Style, pixels_of

        encoders, pixels = context.encoders, pixels_of(context.grid)
        judge = Style(self.image, encoders.style(), context.seed, pixels, self.free, encoders.clip_of_style())
        return ObjectiveTerm(judge, lasts=GRADIENT_LASTS, smooth=True)

    @classmethod
    def interpret(cls, goal: Goal, context: ObjectiveContext) -> Goal:
        """Moves the colours of the pictures to paint to those of the styles, and puts photographs into their marks.

        A drawing without a photograph gets a picture in the style. Faces are free of all styles.
        """
        from frida_painter.objectives.pixel_loss import rise
        from frida_painter.objectives.style_flow import FACE
        from frida_painter.objectives.style_loss import in_style_colors
        from frida_painter.objectives.style_marks import fill_drawing_in_style, in_style_marks

        made = fill_drawing_in_style(in_style_marks(in_style_colors(goal)), context.grid.rows, context.grid.columns)
        matters = next((term.importance for term in made.terms if term.importance is not None), None)
        if matters is None or any(term.words is not None for term in made.terms):
            return made
        free = rise(matters, FACE)
        return replace(
            made, terms=tuple(replace(one, free=free) if isinstance(one, cls) else one for one in made.terms)
        )


KIND = GoalKind(
    name="style",
    gives=Gives.PICTURE,
    help="A style picture. The painting takes its colours, textures and marks.",
    label="Style of",
    open=StyleTerm.open,
    initial_help="A style picture to start from. The painting also keeps its composition.",
    networks=(("vgg16", "hed"),),
)
