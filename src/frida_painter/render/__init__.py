"""The differentiable renderer: from strokes to the picture that they would paint."""

from frida_painter.render.marks import Marks, marks_of
from frida_painter.render.painting import Moments, composite, composite_moments, render, render_moments

__all__ = ["Marks", "Moments", "composite", "composite_moments", "marks_of", "render", "render_moments"]
