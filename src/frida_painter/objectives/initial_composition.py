"""A picture for words that come without one: the pictogram that they mean, on the ground where it is found."""

from collections.abc import Callable
from dataclasses import replace

import torch
from torch import Tensor

from frida_painter import images
from frida_painter.drawing import colored
from frida_painter.frames import PixelGrid
from frida_painter.goal import Goal
from frida_painter.objectives.compositing import lay, resized, side_by_side
from frida_painter.objectives.encoders.conse import synonyms
from frida_painter.objectives.encoders.registry import EncoderRegistry
from frida_painter.objectives.encoders.sentence import SentenceEncoder
from frida_painter.objectives.grounds import Ground, ground_of
from frida_painter.objectives.kinds.image import ImageTerm
from frida_painter.objectives.phrase import COLORS, Phrase, paint_of
from frida_painter.objectives.pictograms import CREDIT, Pictogram, Pictograms
from frida_painter.objectives.recoloring import recolored
from frida_painter.objectives.style_scene import composited_into_style
from frida_painter.objectives.text import Text

_KEPT = 1.0  # weight of the composition beside the words' own
_STAGED = 20.0  # the same of a style picture's, which words would soon take apart
_MATTERS = 8.0  # times as much as its surroundings, where a thing is in a style picture
_SCENE = 0.75  # similarity of a pictogram to a thing and its place together, from which it shows both
_PLURAL = 3
_ALOFT = frozenset(
    ("moon", "sun", "star", "stars", "comet", "cloud", "rainbow", "bird", "birds", "balloon", "kite", "plane",
     "airplane")
)  # fmt: skip
_PEOPLE = frozenset(
    ("man", "woman", "men", "women", "boy", "girl", "person", "people", "baby", "child", "couple", "kiss", "family",
     "adult", "face", "bride", "prince", "princess")
)  # fmt: skip
_SIMILAR = 0.45  # similarity of a name from which it stands for what has no look of its own, as happiness
_KINDRED = 40  # pictograms that are looked at where none has the right name
_WIDTHS = (1.0, 0.6)  # of their own, in which they are: a narrow house is a tower
_TRIED = ("red", "orange", "yellow", "green", "blue", "purple", "pink", "brown", "black", "white")
_MUCH = 0.15  # nearer to the words in another colour, by the networks, or a pictogram keeps its own
_CLEARLY = 0.05  # nearer to the words than the ground alone, by the networks, or it is not worth it


def initial_composition(goal: Goal, grid: PixelGrid, encoders: EncoderRegistry, seed: int) -> Goal:
    """The goal with a picture to begin with, where words are all there is to begin with.

    It stays in the goal, beside the words, so that the composition is kept while they shape it.
    A sketch that has neither photograph nor style is filled with that picture's colours. Where a style
    picture is begun with, what the words name is laid into it. A goal without words, and one with another
    picture of its own to begin with, stays as it is.
    """
    said = [(term.words, term.weight) for term in goal.terms if term.words is not None]
    words, weight = max(said, key=lambda pair: pair[1]) if said else ("", 0.0)
    if goal.initial:
        first = [term.words for term in goal.initial if term.words is not None]
        styles = [term.colors for term in goal.initial if term.colors is not None]
        if any(term.picture is not None for term in goal.initial):
            return goal
        if styles:
            return _begun_with_style(goal, styles[0], words, weight, grid, encoders, seed) if words else goal
        if not first:
            return goal
        begun = ImageTerm(_composed(first[0], grid, encoders, seed))
        return replace(goal, initial=(begun, *goal.initial))
    drawing = next((term.drawing for term in goal.terms if term.drawing is not None), None)
    if not words or any(term.picture is not None for term in goal.terms):
        return goal
    if drawing is not None and any(term.colors is not None for term in goal.terms):
        return goal
    if drawing is None:
        picture = _composed(words, grid, encoders, seed)
    else:
        drawing = images.fit(drawing, grid.rows, grid.columns)
        picture = colored(drawing, _composed(words, grid, encoders, seed, "coloured like"))
    begun = ImageTerm(picture, _KEPT * weight)
    return Goal((*goal.terms, begun), (replace(begun, weight=1.0),))


@torch.no_grad()
def _begun_with_style(
    goal: Goal, style: Tensor, words: str, weight: float, grid: PixelGrid, encoders: EncoderRegistry, seed: int
) -> Goal:
    """The goal, which begins with the style picture in which the pictogram of the words is seen, and keeps to it."""
    pictograms, phrase = encoders.pictograms(), Phrase.of(words)
    found = _found(replace(phrase, place=""), pictograms) if pictograms else None
    if pictograms is None or found is None:
        encoders.remark(f"No pictogram was found for {phrase.thing[:60]!r}; begun with the style picture alone.")
        return goal
    scene, paint = images.fit(style, grid.rows, grid.columns), paint_of(phrase.color)
    tinted = [one if paint is None else recolored(one, paint) for one in pictograms.drawings(found)]
    said = Text(words, encoders.readers(), seed)
    every = [composited_into_style(drawing, scene, keeps_colors=paint is not None) for drawing in tinted]
    shown = min(every, key=lambda one: float(said.validation(one.picture)))
    matters = 1 + (_MATTERS - 1) * shown.where
    kept = ImageTerm(shown.picture, _STAGED * weight, matters / matters.mean())
    encoders.remark(f"Begun with the pictogram {found.name!r} laid into the style picture; it is of {CREDIT}.")
    return Goal((*goal.terms, kept), (replace(kept, weight=1.0),))


def _composed(prompt: str, grid: PixelGrid, encoders: EncoderRegistry, seed: int, use: str = "begun with") -> Tensor:
    """The picture [3, H, W] of the grid; the encoders remember what it was made of, and what use the painting makes."""
    pictograms, phrase = encoders.pictograms(), Phrase.of(prompt)
    if pictograms is None:
        encoders.remark(f"No pictogram was found for {prompt[:60]!r}; {use} bare paper alone.")
        return Ground.paper().picture(grid)
    found = _found(phrase, pictograms)
    ground = _ground(phrase, found, encoders.sentences())
    bare, words = ground.picture(grid), Text(prompt, encoders.readers(), seed)
    if found is None:
        return _look_alike(phrase, ground, bare, pictograms, words, encoders, use)
    drawing, color = _painted(phrase, found, pictograms.drawings(found), bare, words)
    painted = f" in {color}" if color else ""
    count = _PLURAL if phrase.count == 1 and found.name == pictograms.singular(phrase.plain) else phrase.count
    things, names = [drawing] * count, repr(found.name) + (f", {count} times" if count > 1 else "")
    other = Phrase.of(phrase.beside)
    second = _found(other, pictograms) if phrase.beside else None
    if second is not None:
        said = Text(phrase.beside, encoders.readers(), seed)
        things.append(_painted(other, second, pictograms.drawings(second), bare, said)[0])
        names += f" and {second.name!r}"
    encoders.remark(f"{use.capitalize()} the pictogram {names}{painted} on {ground.name}; it is of {CREDIT}.")
    if len(things) > 1:
        return lay(side_by_side(things), bare, wide=True, raised=_is_aloft(phrase))
    return lay(drawing, bare, raised=_is_aloft(phrase))


def _is_aloft(phrase: Phrase) -> bool:
    """Whether the thing hangs in the air over its place, as the moon over a lake."""
    called, place = phrase.plain.split(), phrase.place.split()
    return bool(called and place) and called[-1] in _ALOFT and place[0] in ("over", "above")


def _found(phrase: Phrase, pictograms: Pictograms) -> Pictogram | None:
    """The pictogram of a thing, or of the thing where it is."""
    scene = pictograms.nearest([f"{phrase.thing} {phrase.place}"]) if phrase.place else None
    if scene is not None and scene.similarity >= _SCENE:
        return scene
    called = [phrase.thing, phrase.plain, pictograms.singular(phrase.plain), *synonyms(phrase.plain)]
    return pictograms.nearest([name for name in called if name])


@torch.no_grad()
def _painted(phrase: Phrase, found: Pictogram, drawings: list[Tensor], bare: Tensor, words: Text) -> tuple[Tensor, str]:
    """The drawing that is nearest to the words when it is laid on the ground, and the word for its new colour, if any.

    Its colour is the one that the words name. Where neither they nor the pictogram's name do, it has another
    one than its own only where the networks are much surer of the thing then: monarchs are orange. People keep
    their colours, and their outlines, which are all the faces that they have.
    """

    def nearest(color: str, judge: Callable[[Tensor], Tensor]) -> tuple[float, Tensor]:
        paint = paint_of(color)
        tinted = drawings if paint is None else [recolored(drawing, paint) for drawing in drawings]
        return min(((float(judge(lay(one, bare))), one) for one in tinted), key=lambda pair: pair[0])

    called = set(found.name.split())
    if called & _PEOPLE:
        return drawings[-1], ""
    named = called & set(COLORS)
    wanted = "" if called.issuperset(phrase.color.split()) else phrase.color
    if wanted or named:
        return nearest(wanted, words.validation)[1], wanted
    likely = min(_TRIED, key=lambda color: nearest(color, words.glance)[0])
    (own, drawing), (other, instead) = nearest("", words.validation), nearest(likely, words.validation)
    return (instead, likely) if other < own - _MUCH else (drawing, "")


def _ground(phrase: Phrase, found: Pictogram | None, sentences: SentenceEncoder) -> Ground:
    """Where the words say that the thing is, or else where such things are."""
    if phrase.place and (ground := ground_of([phrase.place], sentences)) != Ground.paper():
        return ground
    return ground_of([phrase.thing] if found is None else [phrase.thing, found.name], sentences)


@torch.no_grad()
def _look_alike(
    phrase: Phrase,
    ground: Ground,
    bare: Tensor,
    pictograms: Pictograms,
    words: Text,
    encoders: EncoderRegistry,
    use: str,
) -> Tensor:
    """For a thing that no pictogram is called, one of something similar that the networks take for it most."""
    best, name, paint = bare, "", paint_of(phrase.color)
    least = float(words.glance(bare)) - _CLEARLY
    similar = pictograms.kindred(phrase.plain, _KINDRED)
    for pictogram in similar:
        for drawing in pictograms.drawings(pictogram):
            painted = drawing if paint is None else recolored(drawing, paint)
            for width in _WIDTHS:
                laid = lay(resized(painted, 1.0, width), bare)
                if (distance := float(words.glance(laid))) < least:
                    best, name, least = laid, pictogram.name, distance
    shown = repr(phrase.thing[:60])
    if not name and phrase.thing == phrase.plain and similar and similar[0].similarity >= _SIMILAR:
        encoders.remark(
            f"{shown} has no look of its own; {use} the pictogram {similar[0].name!r}, whose name is nearest in "
            f"meaning, on {ground.name}; it is of {CREDIT}."
        )
        return lay(pictograms.drawings(similar[0])[-1], bare)
    if name:
        encoders.remark(
            f"No pictogram is called {shown}; {use} {name!r} on {ground.name}, which looks most like it to the "
            f"networks; it is of {CREDIT}."
        )
    else:
        encoders.remark(f"No pictogram was found for {shown}; {use} {ground.name} alone.")
    return best
