"""A picture for words that come without one: the pictogram that they mean, on the ground where it is found."""

from collections.abc import Callable
from dataclasses import replace

import torch
from torch import Tensor
from torch.nn import functional

from frida_painter import images
from frida_painter.drawing import colored
from frida_painter.frames import PixelGrid
from frida_painter.goal import Goal, ImageTerm, SemanticTerm, SketchTerm, StyleTerm, TextTerm
from frida_painter.objectives.encoders.class_names import synonyms
from frida_painter.objectives.encoders.sentence import SentenceEncoder
from frida_painter.objectives.encoders.shelf import Encoders
from frida_painter.objectives.grounds import Ground, ground_of
from frida_painter.objectives.phrase import COLORS, Phrase, paint_of
from frida_painter.objectives.pictograms import CREDIT, Pictogram, Pictograms
from frida_painter.objectives.recoloring import recolored
from frida_painter.objectives.text import Text

_FILLS = 0.85  # of the canvas's shorter side
_KEPT = 1.0  # weight of the composition beside the words' own
_KINDRED = 40  # pictograms that are looked at where none has the right name
_WIDTHS = (1.0, 0.6)  # of their own, in which they are: a narrow house is a tower
_TRIED = ("red", "orange", "yellow", "green", "blue", "purple", "pink", "brown", "black", "white")
_MUCH = 0.15  # nearer to the words in another colour, by the networks, or a pictogram keeps its own
_CLEARLY = 0.05  # nearer to the words than the ground alone, by the networks, or it is not worth it


def imagined(goal: Goal, grid: PixelGrid, encoders: Encoders, seed: int) -> Goal:
    """The goal with a picture to begin with, where words are all there is to begin with.

    It stays in the goal, beside the words, so that the composition is kept while they shape it.
    A sketch that has neither photograph nor style is filled with that picture's colours. A goal
    without words, and one with a picture of its own to begin with, stays as it is.
    """
    if goal.initial:
        words = [term for term in goal.initial if isinstance(term, TextTerm)]
        if not words or any(isinstance(term, ImageTerm) for term in goal.initial):
            return goal
        begun = ImageTerm(_composed(words[0].prompt, grid, encoders, seed))
        return replace(goal, initial=(begun, *goal.initial))
    words = [term for term in goal.terms if isinstance(term, TextTerm)]
    sketch = next((term for term in goal.terms if isinstance(term, SketchTerm)), None)
    if not words or any(isinstance(term, ImageTerm | SemanticTerm) for term in goal.terms):
        return goal
    if sketch is not None and any(isinstance(term, StyleTerm) for term in goal.terms):
        return goal
    main = max(words, key=lambda term: term.weight)
    if sketch is None:
        picture = _composed(main.prompt, grid, encoders, seed)
    else:
        drawing = images.fit(sketch.drawing, grid.rows, grid.columns)
        picture = colored(drawing, _composed(main.prompt, grid, encoders, seed, "coloured like"))
    begun = ImageTerm(picture, _KEPT * main.weight)
    return Goal((*goal.terms, begun), (replace(begun, weight=1.0),))


def _composed(prompt: str, grid: PixelGrid, encoders: Encoders, seed: int, use: str = "begun with") -> Tensor:
    """The picture [3, H, W] of the grid; the encoders remember what it was made of, and what use the painting makes."""
    pictograms, phrase = encoders.pictograms(), Phrase.of(prompt)
    if pictograms is None:
        encoders.remark(f"No pictogram was found for {prompt[:60]!r}; {use} bare paper alone.")
        return Ground.paper().picture(grid)
    found = pictograms.nearest([phrase.thing, phrase.plain, *synonyms(phrase.plain)])
    ground = _ground(phrase, found, encoders.sentences())
    bare, words = ground.picture(grid), Text(prompt, encoders.readers(), seed)
    if found is None:
        return _look_alike(phrase, ground, bare, pictograms, words, encoders, use)
    laid, color = _painted(phrase, found, pictograms.drawings(found), bare, words)
    painted = f" in {color}" if color else ""
    encoders.remark(f"{use.capitalize()} the pictogram {found.name!r}{painted} on {ground.name}; it is of {CREDIT}.")
    return laid


@torch.no_grad()
def _painted(phrase: Phrase, found: Pictogram, drawings: list[Tensor], bare: Tensor, words: Text) -> tuple[Tensor, str]:
    """The drawing that is nearest to the words, laid on the ground, and the word for its new colour, if any.

    Its colour is the one that the words name. Where neither they nor the pictogram's name do, it has another
    one than its own only where the networks are much surer of the thing then: monarchs are orange.
    """

    def nearest(color: str, judge: Callable[[Tensor], Tensor]) -> tuple[float, Tensor]:
        paint = paint_of(color)
        tinted = drawings if paint is None else [recolored(drawing, paint) for drawing in drawings]
        judged = [(float(judge(one)), one) for one in (lay(drawing, bare) for drawing in tinted)]
        return min(judged, key=lambda pair: pair[0])

    called = set(found.name.split())
    named = called & set(COLORS)
    wanted = "" if called.issuperset(phrase.color.split()) else phrase.color
    if wanted or named:
        return nearest(wanted, words.judge)[1], wanted
    likely = min(_TRIED, key=lambda color: nearest(color, words.glance)[0])
    (own, laid), (other, instead) = nearest("", words.judge), nearest(likely, words.judge)
    return (instead, likely) if other < own - _MUCH else (laid, "")


def _ground(phrase: Phrase, found: Pictogram | None, sentences: SentenceEncoder) -> Ground:
    """Where the words say that the thing is, or else where such things are."""
    if phrase.place and (ground := ground_of([phrase.place], sentences)) != Ground.paper():
        return ground
    return ground_of([phrase.thing] if found is None else [phrase.thing, found.name], sentences)


@torch.no_grad()
def _look_alike(
    phrase: Phrase, ground: Ground, bare: Tensor, pictograms: Pictograms, words: Text, encoders: Encoders, use: str
) -> Tensor:
    """For a thing that no pictogram is called, one of something akin that the networks take for it most."""
    best, name, paint = bare, "", paint_of(phrase.color)
    least = float(words.glance(bare)) - _CLEARLY
    for pictogram in pictograms.kindred(phrase.plain, _KINDRED):
        for drawing in pictograms.drawings(pictogram):
            painted = drawing if paint is None else recolored(drawing, paint)
            for width in _WIDTHS:
                laid = lay(_narrowed(painted, width), bare)
                if (distance := float(words.glance(laid))) < least:
                    best, name, least = laid, pictogram.name, distance
    shown = repr(phrase.thing[:60])
    if name:
        encoders.remark(
            f"No pictogram is called {shown}; {use} {name!r} on {ground.name}, which looks most like it to the "
            f"networks; it is of {CREDIT}."
        )
    else:
        encoders.remark(f"No pictogram was found for {shown}; {use} {ground.name} alone.")
    return best


def _narrowed(drawing: Tensor, width: float) -> Tensor:
    """A drawing [4, h, w] that is only so much of its width."""
    size = [drawing.shape[1], max(1, round(drawing.shape[2] * width))]
    return functional.interpolate(drawing[None], size, mode="bilinear", antialias=True)[0]


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
