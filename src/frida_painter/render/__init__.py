"""The differentiable renderer: from strokes to the picture that they would paint."""

from frida_painter.render.painting import Moments, composite, composite_moments, render, render_moments

__all__ = ["Moments", "composite", "composite_moments", "render", "render_moments"]
