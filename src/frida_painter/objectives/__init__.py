"""Objectives: losses of the rendered picture that a plan is optimised for; and the kinds of goals that are pictures."""

from frida_painter.objectives.objective import Gives, GoalKind
from frida_painter.registry import Later

USUAL_FREEDOM = 0.5
"""Freedom of colours with which a painting by content is bold, and shows what it is."""
_open_image = Later("frida_painter.objectives.image:ImageTerm.open")

IMAGE = GoalKind(
    name="image",
    gives=Gives.PICTURE,
    help="Another picture to reproduce, pixel by pixel.",
    label="Picture",
    open=_open_image,
    initial_help="A picture to start from. The painting keeps its composition.",
)
SEMANTIC = GoalKind(
    name="semantic",
    gives=Gives.PICTURE,
    help="A picture to paint by its content, not pixel by pixel.",
    label="Content of",
    open=Later("frida_painter.objectives.semantic:SemanticTerm.open"),
    begin=_open_image,
    networks=(("efficientnet-lite0",),),
)
SKETCH = GoalKind(
    name="sketch",
    gives=Gives.PICTURE,
    help="A drawing whose lines the painting follows, on paper or with a transparent background.",
    label="Sketch",
    open=Later("frida_painter.objectives.sketch:SketchTerm.open"),
    begin=_open_image,
    networks=(("hed",),),
)
STYLE = GoalKind(
    name="style",
    gives=Gives.PICTURE,
    help="A style picture. The painting takes its colours, textures and marks.",
    label="Style of",
    open=Later("frida_painter.objectives.style:StyleTerm.open"),
    initial_help="A style picture to start from. The painting also keeps its composition.",
    networks=(("vgg16", "hed"),),
)
