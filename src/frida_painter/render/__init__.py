"""Differentiable renderer: from strokes to the picture that they paint.

Each name is loaded at its first use. The process that compiles the renderer's loops uses none of them and loads
no tensor library.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from frida_painter.render.painting import (
        Marks,
        Moments,
        composite,
        composite_moments,
        marks_of,
        render,
        render_moments,
    )


__all__ = ["Marks", "Moments", "composite", "composite_moments", "marks_of", "render", "render_moments"]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}; it offers {', '.join(__all__)}")
    return getattr(import_module(f"{__name__}.painting"), name)
