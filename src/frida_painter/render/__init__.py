"""The differentiable renderer: from strokes to the picture that they would paint."""

from frida_painter.render.painting import composite, render

__all__ = ["composite", "render"]
