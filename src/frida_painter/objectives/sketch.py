"""Goal "sketch": a drawing whose lines the painting follows."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from frida_painter.errors import ConfigError
from frida_painter.objectives.image import ImageTerm, PictureTerm
from frida_painter.objectives.objective import GRADIENT_LASTS, Gives, Goal, GoalKind, ObjectiveContext, ObjectiveTerm

if TYPE_CHECKING:
    from torch import Tensor


_FEWEST = 2e-4  # smallest share of line pixels; fewer are a speck
_BROAD = 1 / 40  # of a canvas's shorter side: about the finest lines of the brushes


@dataclass(frozen=True)
class SketchTerm(PictureTerm):
    """Term of a goal: paint along the lines of a drawing, which has at least one line.

    The drawing has dark lines on light paper, scanned or photographed, or chalk on a dark board.
    shown [3, h, w]: the drawing on a photograph that is painted with it; None for white paper
    Raises ConfigError if there is no line.
    """

    shown: Tensor | None = None
    called = "a sketch"
    is_tried = False
    initial_order = 1
    interpretation_order = 1

    def __post_init__(self) -> None:
        from frida_painter.objectives.sketch_loss import clean_drawing, ink

        super().__post_init__()
        if not float(ink(clean_drawing(self.image)).float().mean()) >= _FEWEST:
            raise ConfigError(
                "A sketch without a single line was given; give a drawing of dark lines on light paper, or of chalk."
            )

    @property
    def drawing(self) -> Tensor:
        """Lines on white paper, at least as broad as a brush paints: [3, H, W] in [0, 1]."""
        from frida_painter.objectives.sketch_loss import broaden_lines, clean_drawing

        return broaden_lines(clean_drawing(self.image), _BROAD)

    @property
    def guide(self) -> Tensor:
        """Drawing as it was given."""
        return self.image

    def as_start(self, goal: Goal) -> ImageTerm:
        """Returns the drawing as a picture."""
        return ImageTerm(self.drawing, self.weight)

    def on_picture(self, picture: Tensor) -> SketchTerm:
        """Returns the term for a drawing on a picture: its edges are those of lines and picture together."""
        return replace(self, shown=picture)

    def prepare(self, context: ObjectiveContext) -> ObjectiveTerm:
        """Returns the difference of edges by HED, with a small part for the content."""
        from frida_painter import images
        from frida_painter.objectives.semantic_loss import Semantic
        from frida_painter.objectives.sketch_loss import Sketch

        lines = self.drawing if self.shown is None else self.shown
        drawing = images.fit(lines, context.grid.rows, context.grid.columns)
        shown = Semantic(drawing, context.encoders.meaning(), context.seed)
        hed = context.encoders.edges()
        lasts = GRADIENT_LASTS if context.is_held else 1
        validation = Sketch(drawing, hed, shown.validation)
        return ObjectiveTerm(Sketch(drawing, hed, shown), validation, lasts=lasts, smooth=context.is_held)

    @classmethod
    def interpret(cls, goal: Goal, context: ObjectiveContext) -> Goal:
        """Draws the sketches on the pictures of the goal."""
        from frida_painter.objectives.sketch_loss import overlaid

        return overlaid(goal)


KIND = GoalKind(
    name="sketch",
    gives=Gives.PICTURE,
    help="A drawing whose lines the painting follows, on paper or with a transparent background.",
    label="Sketch",
    open=SketchTerm.open,
    begin=ImageTerm.open,
    networks=(("hed",),),
)
