"""A drawing beside a photograph is drawn on it: the photograph stays, and the lines are seen on top."""

import torch
from torch import Tensor

from frida_painter import images
from frida_painter.goal import Goal, Term

_DARK = 0.4  # lightness of a photograph under a drawing below which its lines are light


def overlaid(goal: Goal) -> Goal:
    """The goal, in which the lines of every sketch are drawn on the pictures that are to be painted with it.

    The pictures show them then, and the sketch asks for the edges of lines and picture together: asking for
    the lines' alone, it would fight all that the picture has. A goal without both stays as it is.
    """
    drawings = [term.drawing for term in goal.terms if term.drawing is not None]
    picture = next((term.picture for term in goal.terms if term.is_pixelwise), None)
    if picture is None or not drawings:
        return goal

    def drawn(image: Tensor) -> Tensor:
        for drawing in drawings:
            image = drawn_on(image, images.fit(drawing, *image.shape[1:]))
        return image

    together = drawn(picture)

    def shown(term: Term) -> Term:
        if term.is_pixelwise and term.picture is not None:
            return term.with_picture(together if term.picture is picture else drawn(term.picture))
        return term.on_picture(together)

    return Goal(tuple(shown(term) for term in goal.terms), goal.initial)


def drawn_on(picture: Tensor, drawing: Tensor) -> Tensor:
    """A cleaned drawing, dark on white, on a picture, both [3, H, W]: in its own colours, or in chalk where it is dark.

    A drawing stays of one kind: by the lightness of the picture under all of its lines.
    """
    strength = 1 - drawing.amin(0)
    under = float((picture.mean(0) * strength).sum() / strength.sum().clamp(min=1e-6))
    own = (drawing - (1 - strength)) / strength.clamp(min=1e-3)
    line = torch.ones_like(own) if under < _DARK else own.clamp(0, 1)
    return (picture + strength * (line - picture)).clamp(0, 1)
