"""A picture for words that come without one: a scene of pictures of what they name."""

from dataclasses import replace

import torch
from torch import Tensor

from frida_painter import images
from frida_painter.drawing import colored
from frida_painter.frames import PixelGrid
from frida_painter.goal import Goal
from frida_painter.objectives.encoders.registry import EncoderRegistry
from frida_painter.objectives.kinds.image import ImageTerm
from frida_painter.objectives.scenes.casting import thing_of
from frida_painter.objectives.scenes.composition import ComposedScene
from frida_painter.objectives.scenes.scene import scene_of
from frida_painter.objectives.style_scene import composited_into_style

_KEPT = 60.0  # weight of the composition beside the words' own: networks give things colours that they do not have
_KEPT_SCENE = 600.0  # the same of several things, or of a place: networks know things, and take a scene for one of them
_AMONG = 3.0  # the same where a style or a sketch has a say too
_STAGED = 20.0  # the same of a style picture's, which words would soon take apart
_MATTERS = 8.0  # times as much as its surroundings, where a thing is in a style picture
_SUBJECT = 4.0  # the same, where things are in a scene


def initial_composition(goal: Goal, grid: PixelGrid, encoders: EncoderRegistry, seed: int) -> Goal:
    """The goal with a picture to begin with, where words are all there is to begin with.

    It stays in the goal, beside the words, so that the composition is kept while they shape it.
    A sketch without a photograph is filled with that picture's colours, or with those of a style. Where a style
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
        begun = _term(scene_of(first[0], grid, encoders, seed))
        return replace(goal, initial=(begun, *goal.initial))
    drawing = next((term.drawing for term in goal.terms if term.drawing is not None), None)
    if not words or any(term.picture is not None for term in goal.terms):
        return goal
    style = next((term.colors for term in goal.terms if term.colors is not None), None)
    if drawing is None:
        scene = scene_of(words, grid, encoders, seed)
        kept = _KEPT if scene.is_alone else _KEPT_SCENE
        begun = _term(scene, weight * (kept if all(term.words is not None for term in goal.terms) else _AMONG))
    else:
        drawing = images.fit(drawing, grid.rows, grid.columns)
        like = scene_of(words, grid, encoders, seed, "coloured like").picture if style is None else style
        begun = _filled(drawing, like, weight * _AMONG)
    return Goal((*goal.terms, begun), (replace(begun, weight=1.0),))


def _term(scene: ComposedScene, weight: float = 1.0) -> ImageTerm:
    """A scene to come near to: its things matter more than their ground."""
    matters = 1 + (_SUBJECT - 1) * scene.where
    return ImageTerm(scene.picture, weight, matters / matters.mean())


def _filled(drawing: Tensor, like: Tensor, weight: float) -> ImageTerm:
    """A drawing [3, H, W] in the colours of a picture, to come near to: lines, and what they enclose, matter more."""
    picture = colored(drawing, like)
    matters = 1 + (_SUBJECT - 1) * (picture != picture[:, :1, :1]).any(0).to(picture)
    return ImageTerm(picture, weight, matters / matters.mean())


@torch.no_grad()
def _begun_with_style(
    goal: Goal, style: Tensor, words: str, weight: float, grid: PixelGrid, encoders: EncoderRegistry, seed: int
) -> Goal:
    """The goal, which begins with the style picture in which the thing of the words is seen, and keeps to it."""
    thing = thing_of(words, encoders, seed)
    if thing is None:
        encoders.remark(f"No picture was found for {words[:60]!r}; begun with the style picture alone.")
        return goal
    scene = images.fit(style, grid.rows, grid.columns)
    shown = composited_into_style(thing.colored, scene, keeps_colors=bool(thing.thing.color))
    matters = 1 + (_MATTERS - 1) * shown.where
    kept = ImageTerm(shown.picture, _STAGED * weight, matters / matters.mean())
    encoders.remark(f"Begun with {thing.told}, laid into the style picture{thing.credit}.")
    return Goal((*goal.terms, kept), (replace(kept, weight=1.0),))
