"""A picture in whose style is painted."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from frida_painter.errors import ConfigError
from frida_painter.goal import Goal, Term, require_weight
from frida_painter.objectives.kind import Gives, GoalKind
from frida_painter.objectives.kinds.image import ImageTerm
from frida_painter.objectives.objective import ObjectiveContext, ObjectiveTerm

if TYPE_CHECKING:
    from pathlib import Path

    from torch import Tensor

_FLAT = 0.01  # standard deviation under which a picture is of one colour
_LONGEST = 1024  # pixels; styles are compared in small pictures


@dataclass(frozen=True)
class StyleTerm(Term):
    """Paint in the style of this picture: `image` [3, H, W] in [0, 1], more than one colour. Raises ConfigError."""

    image: Tensor
    weight: float = 1.0
    initial_order = 3
    interpretation_order = 3

    def __post_init__(self) -> None:
        require_weight(self.weight, "a style")
        if not float(self.image.flatten(1).std(1).max()) >= _FLAT:
            raise ConfigError("A style picture of a single colour was given, which has no style; give another picture.")

    @property
    def colors(self) -> Tensor:
        """The style picture."""
        return self.image

    def begun(self, goal: Goal) -> ImageTerm:
        """The style picture, as the picture that it is."""
        return ImageTerm(self.image, self.weight)

    def prepare(self, context: ObjectiveContext) -> ObjectiveTerm:
        """The distance of styles as VGG16 sees them."""
        from frida_painter.objectives.style import Style

        return ObjectiveTerm(Style(self.image, context.encoders.style(), context.seed))

    @classmethod
    def interpret(cls, goal: Goal, context: ObjectiveContext) -> Goal:
        """Pictures to paint are wanted in the colours of the styles."""
        from frida_painter.objectives.style_colors import in_style_colors

        return in_style_colors(goal)


def _open(path: Path, weight: float) -> StyleTerm:
    from frida_painter import images

    return StyleTerm(images.load(path, longest=_LONGEST), weight)


KIND = GoalKind(
    name="style",
    gives=Gives.PICTURE,
    help="A style picture. The painting takes its colours, textures and marks.",
    label="Style of",
    open=_open,
    initial_help="A style picture to start from. The painting also keeps its composition.",
    networks=(("vgg16", "hed"),),
)
