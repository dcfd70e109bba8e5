"""A picture for words that come without one: the pictogram that they mean, on the ground where it is found."""

from dataclasses import replace

import torch
from torch import Tensor
from torch.nn import functional

from frida_painter.frames import PixelGrid
from frida_painter.goal import Goal, ImageTerm, SemanticTerm, SketchTerm, TextTerm
from frida_painter.objectives.encoders.shelf import Encoders
from frida_painter.objectives.grounds import Ground, ground_of
from frida_painter.objectives.pictograms import CREDIT
from frida_painter.objectives.text import Text

_FILLS = 0.85  # of the canvas's shorter side
_KEPT = 1.0  # weight of the composition beside the words' own


def imagined(goal: Goal, grid: PixelGrid, encoders: Encoders, seed: int) -> Goal:
    """The goal with a picture to begin with, where words are all there is to begin with.

    It stays in the goal, beside the words, so that the composition is kept while they shape it.
    A goal without words, and one with a picture of its own to begin with, stays as it is.
    """
    if goal.initial:
        words = [term for term in goal.initial if isinstance(term, TextTerm)]
        if not words or any(isinstance(term, ImageTerm) for term in goal.initial):
            return goal
        begun = ImageTerm(_composed(words[0].prompt, grid, encoders, seed))
        return replace(goal, initial=(begun, *goal.initial))
    words = [term for term in goal.terms if isinstance(term, TextTerm)]
    if not words or any(isinstance(term, ImageTerm | SemanticTerm | SketchTerm) for term in goal.terms):
        return goal
    main = max(words, key=lambda term: term.weight)
    begun = ImageTerm(_composed(main.prompt, grid, encoders, seed), _KEPT * main.weight)
    return Goal((*goal.terms, begun), (replace(begun, weight=1.0),))


def _composed(prompt: str, grid: PixelGrid, encoders: Encoders, seed: int) -> Tensor:
    """The picture [3, H, W] of the grid; the encoders remember what it was made of."""
    pictograms = encoders.pictograms()
    ground = Ground.paper() if pictograms is None else ground_of(prompt, encoders.sentences())
    picture = ground.picture(grid)
    found = None if pictograms is None else pictograms.nearest(prompt)
    if pictograms is None or found is None:
        encoders.remark(f"No pictogram was found for {prompt[:60]!r}; begun with {ground.name} alone.")
        return picture
    encoders.remark(f"Begun with the pictogram {found.name!r} on {ground.name}; it is of {CREDIT}.")
    words = Text(prompt, encoders.readers(), seed)
    with torch.no_grad():
        laid = [lay(drawing, picture) for drawing in pictograms.drawings(found)]
        return min(laid, key=lambda one: float(words.judge(one)))


def lay(drawing: Tensor, ground: Tensor) -> Tensor:
    """The ground [3, H, W] with a drawing, colour and opacity [4, h, w], large in its middle."""
    _, rows, columns = ground.shape
    scale = _FILLS * min(rows, columns) / max(drawing.shape[1:])
    size = [max(1, round(side * scale)) for side in drawing.shape[1:]]
    # Colours are resampled as far as they are seen: what is transparent has none.
    seen = torch.cat((drawing[:3] * drawing[3:], drawing[3:]))[None]
    small = functional.interpolate(seen, size, mode="bilinear", antialias=True)[0].clamp(0, 1)
    top, left = (rows - size[0]) // 2, (columns - size[1]) // 2
    place = (slice(None), slice(top, top + size[0]), slice(left, left + size[1]))
    laid = ground.clone()
    laid[place] = small[:3] + (1 - small[3:]) * laid[place]
    return laid.clamp(0, 1)
