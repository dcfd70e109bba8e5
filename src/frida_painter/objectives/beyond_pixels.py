"""Goals that a picture gives beyond its pixels: its content, the lines of a drawing, its style."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Self

from frida_painter.errors import ConfigError
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


SEMANTIC = GoalKind(
    name="semantic",
    gives=Gives.PICTURE,
    help="A picture to paint by its content, not pixel by pixel.",
    label="Content of",
    open=SemanticTerm.open,
    begin=ImageTerm.open,
    networks=(("efficientnet-lite0",),),
)

SKETCH = GoalKind(
    name="sketch",
    gives=Gives.PICTURE,
    help="A drawing whose lines the painting follows, on paper or with a transparent background.",
    label="Sketch",
    open=SketchTerm.open,
    begin=ImageTerm.open,
    networks=(("hed",),),
)

STYLE = GoalKind(
    name="style",
    gives=Gives.PICTURE,
    help="A style picture. The painting takes its colours, textures and marks.",
    label="Style of",
    open=StyleTerm.open,
    initial_help="A style picture to start from. The painting also keeps its composition.",
    networks=(("vgg16", "hed"),),
)
