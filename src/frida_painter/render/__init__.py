"""The differentiable renderer: from strokes to the picture that they would paint.

A name is loaded when it is first used: the process that compiles the renderer's loops needs none, and no tensors.
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
