"""First picture of a painting of words: a scene, coarse colours or nothing.

Without a CLIP, which reads words itself, the scene replaces the words: the plan is grown towards it alone.
"""

from dataclasses import replace

import torch
from torch import Tensor

from frida_painter import images
from frida_painter.errors import ConfigError
from frida_painter.frames import PixelGrid
from frida_painter.objectives.encoders.loading import EncoderRegistry
from frida_painter.objectives.image import ImageTerm
from frida_painter.objectives.objective import Goal, ObjectiveContext, Term
from frida_painter.objectives.pixel_loss import spread
from frida_painter.objectives.sketch_loss import color_drawing, filled_areas
from frida_painter.objectives.style_marks import in_style
from frida_painter.objectives.style_places import change_by_place, styles_of
from frida_painter.objectives.text_loss import Text, wish
from frida_painter.objectives.word_settings import WordSettings
from frida_painter.words.pyramid import color_in
from frida_painter.words.scene import find_cutout, scene_of, words_of
from frida_painter.words.style_scene import composite_into_style

_APART = 104_729  # added to the seed, so that the views of the choice are not those of the optimiser
_KEPT = 60.0  # weight of the composition against the words that a CLIP reads
_AMONG = 3.0  # the same if a style or a sketch has a term too
_STAGED = 20.0  # the same for a style picture, or a photograph, that is begun with
_MATTERS = 8.0  # weight of a thing, relative to its surroundings
_SIZES, _OWN = (0.6, 0.5, 0.4), 0.5  # of a thing in a photograph: possible sizes, and share of its colours
_STANDS = (0.65, 1.0)  # its position in the free space, down


def with_beginning(
    goal: Goal, context: ObjectiveContext, prompt: str | None, settings: WordSettings, *, is_alone: bool
) -> Goal:
    """Returns the goal with an initial picture, if its words come without one.

    prompt: words of the largest weight, with their settings; None if only the beginning has words
    is_alone: True if the goal has nothing but words

    Words with a CLIP need no other network: without the one that composes scenes, a goal of words alone begins with
    coarse colours, and another goal is returned unchanged.
    Raises ConfigError if the settings need a network that is not here; WeightsError if no network reads
    the words.
    """
    encoders, how = context.encoders, settings.beginning
    by_clip = encoders.reads_by_clip
    if how == "scene" and by_clip and not encoders.composes:
        raise ConfigError(
            "--beginning scene puts pictures of things together, and the network for it is not here; fetch it with "
            "`frida-painter models fetch words`, or give --beginning colors."
        )
    if not by_clip and how in ("colors", "nothing"):
        raise ConfigError(
            f"--beginning {how} paints words by a CLIP alone, and none is here; fetch one with `frida-painter models "
            "fetch clip-vit-b-32`, or leave it out."
        )
    if how == "nothing" or (by_clip and not encoders.composes and not is_alone):
        return goal
    if prompt is None or not is_alone or how == "scene" or not by_clip:
        return initial_composition(goal, context.grid, encoders, context.seed)
    readers, size = encoders.readers(), (context.grid.rows, context.grid.columns)
    wanted = wish(prompt, readers[0], settings)
    colors = color_in(wanted, readers[0], size, context.seed, settings.first_steps, encoders.tell, encoders.heed)
    told, remarks = "coloured for the words", list(encoders.remarks)
    if how == "auto" and encoders.composes:
        (scene,) = initial_composition(goal, context.grid, encoders, context.seed).initial
        judge = Text(prompt, readers, context.seed + _APART, settings=settings)
        with torch.no_grad():
            if scene.picture is not None and bool(judge.validation(scene.picture) < judge.validation(colors)):
                return replace(goal, initial=(ImageTerm(scene.picture),))
        encoders.remarks[:] = remarks
        told = "in which the words are seen better than in a scene"
    encoders.remark(f"Begun with a coarse picture, {told}.")
    return replace(goal, initial=(ImageTerm(colors),))


def initial_composition(goal: Goal, grid: PixelGrid, encoders: EncoderRegistry, seed: int) -> Goal:
    """Returns the goal with an initial picture, if it has words and no other picture to begin with.

    The picture is also a term, beside the words that a CLIP reads and in place of others. It has the colours and the
    marks of the styles, in proportion if these are lighter than the words. A sketch is filled with the picture's
    colours, or with those of the heaviest style; a style picture or a photograph gets the thing of the words laid in.
    """
    words, weight = words_of(goal)
    said = goal.terms if encoders.reads_by_clip else tuple(term for term in goal.terms if term.words is None)
    pictured = next((term for term in goal.initial or goal.terms if term.picture is not None), None)
    if pictured is not None or not (words or goal.initial):
        if not words or encoders.reads_by_clip:
            return goal
        return goal if pictured is None else _lay_into_photograph(goal, pictured, said, words, weight, encoders)
    if goal.initial:
        first = next((term.words for term in goal.initial if term.words is not None), None)
        staged = next((term.colors for term in goal.initial if term.colors is not None), None)
        if staged is not None and words:
            return _start_with_style(goal, staged, said, words, weight, encoders, grid)
        if staged is not None or first is None:
            return goal
        scene = scene_of(first, grid, encoders, seed)
        return replace(goal, initial=(_term(scene.picture, scene.where), *goal.initial))
    styles = styles_of(goal)
    style = max(styles, key=lambda term: term.weight).colors if styles else None
    drawing = next((term.drawing for term in goal.terms if term.drawing is not None), None)
    if drawing is None:
        scene = scene_of(words, grid, encoders, seed)
        kept = _AMONG if any(term.words is None for term in goal.terms) else _KEPT if said else 1.0
        picture = scene.picture
        if styles:
            shown = change_by_place(picture, styles, lambda style: in_style(scene.picture, scene.where, style))
            picture = torch.lerp(picture, shown, min(1.0, sum(one.weight for one in styles) / weight))
        begun = _term(picture, scene.where, weight * kept)
    else:
        like = scene_of(words, grid, encoders, seed, "coloured like").picture if style is None else style
        filled = color_drawing(images.fit(drawing, grid.rows, grid.columns), like)
        begun = _term(filled, filled_areas(filled), weight * _AMONG)
    return Goal((*said, begun), (replace(begun, weight=1.0),))


def _term(picture: Tensor, where: Tensor, weight: float = 1.0, importance: Tensor | None = None) -> ImageTerm:
    """Returns a picture [3, H, W] as a term: what is at `where` [H, W] has more weight than its ground.

    importance [h, w]: of each place, besides that
    """
    matters = 1 + (_MATTERS - 1) * where
    matters = matters if importance is None else matters * spread(importance, *where.shape)
    return ImageTerm(picture, weight, matters / matters.mean())


@torch.no_grad()
def _start_with_style(
    goal: Goal, style: Tensor, said: tuple[Term, ...], words: str, weight: float, encoders: EncoderRegistry,
    grid: PixelGrid,
) -> Goal:  # fmt: skip
    """Returns the goal that begins with the style picture, with the thing of the words in it, and keeps to it."""
    thing = find_cutout(words, encoders, "laid into the style picture")
    if thing is None:
        return replace(goal, terms=said) if said else goal
    scene = images.fit(style, grid.rows, grid.columns)
    kept = _term(*composite_into_style(thing.picture, scene, own=float(thing.has_color)), _STAGED * weight)
    return Goal((*said, kept), (replace(kept, weight=1.0),))


@torch.no_grad()
def _lay_into_photograph(
    goal: Goal, pictured: Term, said: tuple[Term, ...], words: str, weight: float, encoders: EncoderRegistry
) -> Goal:
    """Returns the goal with the thing of the words in its photograph, and without the words."""
    photograph = pictured.picture
    assert photograph is not None
    shown, where = photograph, torch.zeros(photograph.shape[1:])
    if any(term.drawing is not None for term in goal.terms):
        encoders.remark(f"{words[:60]!r} adds nothing to the drawing on the photograph; that needs a CLIP.")
    elif (thing := find_cutout(words, encoders, "laid into the photograph")) is not None:
        shown, where = composite_into_style(thing.picture, photograph, own=_OWN, sizes=_SIZES, rows=_STANDS)
    begun = _term(shown, where, importance=pictured.importance)
    if goal.initial:
        return Goal((*said, replace(begun, weight=_STAGED * weight)), (replace(begun, weight=1.0),))
    matters = begun.importance
    assert matters is not None
    return Goal(tuple(
        term.with_picture(shown).weigh(matters) if term.picture is photograph and shown is not photograph else term
        for term in said
    ))  # fmt: skip
