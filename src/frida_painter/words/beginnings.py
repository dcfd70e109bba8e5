"""First picture of a painting of words: a scene, coarse colours or nothing.

The settings choose, or a CLIP.
"""

from dataclasses import replace

import torch
from torch import Tensor

from frida_painter import images
from frida_painter.drawing.composition import lay_setting
from frida_painter.drawing.places import Setting
from frida_painter.errors import ConfigError
from frida_painter.frames import PixelGrid
from frida_painter.objectives.encoders.loading import EncoderRegistry
from frida_painter.objectives.image import ImageTerm
from frida_painter.objectives.objective import Goal, ObjectiveContext
from frida_painter.objectives.sketch_loss import color_drawing, filled_areas
from frida_painter.objectives.style_marks import in_style
from frida_painter.objectives.style_places import change_by_place, styles_of
from frida_painter.objectives.text_loss import Text, wish
from frida_painter.objectives.word_settings import WordSettings
from frida_painter.words.account import Account
from frida_painter.words.casting import cast
from frida_painter.words.photograph import put_into_photograph, puts_into_photograph
from frida_painter.words.pyramid import color_in
from frida_painter.words.reading import prompt_reader
from frida_painter.words.retrieval import picture_index
from frida_painter.words.scene import scene_of, tell_thing, words_of
from frida_painter.words.setting import setting_of
from frida_painter.words.style_scene import composite_into_style

_APART = 104_729  # added to the seed, so that the views of the choice are not those of the optimiser


def with_beginning(
    goal: Goal, context: ObjectiveContext, prompt: str | None, settings: WordSettings, *, is_alone: bool
) -> Goal:
    """Returns the goal with an initial picture, if its words come without one.

    prompt: words of the largest weight, with their settings; None if only the beginning has words
    is_alone: True if the goal has nothing but words

    Words with a CLIP need no other network: without those that compose scenes, a goal of words alone begins with
    coarse colours, and another goal is returned unchanged.
    Raises ConfigError if the settings ask for a scene, and its networks are not here; WeightsError if no network
    reads the words.
    """
    encoders = context.encoders
    if puts_into_photograph(goal, encoders):
        return put_into_photograph(goal, encoders, context.seed)
    how, by_clip = settings.beginning, encoders.reads_by_clip
    if how == "scene" and by_clip and not encoders.composes:
        raise ConfigError(
            "--beginning scene puts pictures of things together, and the networks for it are not here; fetch them with "
            "`frida-painter models fetch words`, or give --beginning colors."
        )
    if how == "nothing" or (by_clip and not encoders.composes and not is_alone):
        return goal
    if prompt is None or not is_alone or how == "scene" or (how == "auto" and not by_clip):
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


# Scenes composed from the things that the words name, as first pictures.

_KEPT = 60.0  # weight of the composition against the words: networks invent colours of things
_KEPT_SCENE = 600.0  # the same for several things, or a place: networks take a scene for a single thing
_AMONG = 3.0  # the same if a style or a sketch has a term too
_STAGED = 20.0  # the same for a style picture, which words would soon destroy
_MATTERS = 8.0  # weight of a thing, relative to its surroundings


def initial_composition(goal: Goal, grid: PixelGrid, encoders: EncoderRegistry, seed: int) -> Goal:
    """Returns the goal with an initial picture, if it has words and no other picture to begin with.

    The picture is also a term beside the words, so that the composition lasts while the words change it. It has the
    colours and the marks of the styles, in proportion if these are lighter than the words. A sketch is filled with the
    picture's colours, or with those of the heaviest style; a style to begin with gets the thing of the words laid in.
    """
    words, weight = words_of(goal)
    pictures = [term for term in (goal.initial or goal.terms) if term.picture is not None]
    if pictures or not (words or goal.initial):
        return goal
    if goal.initial:
        first = next((term.words for term in goal.initial if term.words is not None), None)
        staged = next((term.colors for term in goal.initial if term.colors is not None), None)
        if staged is not None and words:
            return _start_with_style(goal, staged, words, weight, grid, encoders)
        if staged is not None or first is None:
            return goal
        scene = scene_of(first, grid, encoders, seed)
        return replace(goal, initial=(_term(scene.picture, scene.where), *goal.initial))
    styles = styles_of(goal)
    style = max(styles, key=lambda term: term.weight).colors if styles else None
    drawing = next((term.drawing for term in goal.terms if term.drawing is not None), None)
    if drawing is None:
        scene = scene_of(words, grid, encoders, seed)
        kept = _KEPT if scene.is_alone else _KEPT_SCENE
        kept = kept if all(term.words is not None for term in goal.terms) else _AMONG
        if styles:
            shown = change_by_place(scene.picture, styles, lambda style: in_style(scene.picture, scene.where, style))
            # The styles do not know the light and the weather of the words.
            setting = setting_of(prompt_reader(encoders).read(words), picture_index(encoders), encoders)[0]
            over = Setting(light=setting.light, weather=setting.weather)
            shown = shown if over == Setting() else lay_setting(shown, over, scene.where, seed).picture
            share = min(1.0, sum(one.weight for one in styles) / weight)
            scene = replace(scene, picture=torch.lerp(scene.picture, shown, share))
        begun = _term(scene.picture, scene.where, weight * kept)
    else:
        like = scene_of(words, grid, encoders, seed, "coloured like").picture if style is None else style
        filled = color_drawing(images.fit(drawing, grid.rows, grid.columns), like)
        begun = _term(filled, filled_areas(filled), weight * _AMONG)
    # Networks by class names know photographs. A scene in a style does not please them, whatever is painted, so they
    # choose the scene and leave its painting to the style; a CLIP knows paintings.
    leads = style is None or drawing is not None or encoders.reads_by_clip
    terms = goal.terms if leads else tuple(term for term in goal.terms if term.words is None)
    return Goal((*terms, begun), (replace(begun, weight=1.0),))


def _term(picture: Tensor, where: Tensor, weight: float = 1.0) -> ImageTerm:
    """Returns a picture [3, H, W] as a term: what is at `where` [H, W] has more weight than its ground."""
    matters = 1 + (_MATTERS - 1) * where
    return ImageTerm(picture, weight, matters / matters.mean())


@torch.no_grad()
def _start_with_style(
    goal: Goal, style: Tensor, words: str, weight: float, grid: PixelGrid, encoders: EncoderRegistry
) -> Goal:
    """Returns the goal that begins with the style picture, with the thing of the words in it, and keeps to it."""
    reading, index = prompt_reader(encoders).read(words), picture_index(encoders)
    found = cast(reading, set(), words, index, encoders, in_place=False)
    thing, account = next((one for one in found if one is not None), None), Account(reading)
    if thing is None:
        encoders.remark(f"No picture was found for {words[:60]!r}; begun with the style picture alone.")
        encoders.remark(account.told)
        return goal
    scene = images.fit(style, grid.rows, grid.columns)
    shown = composite_into_style(thing.colored, scene, own=float(bool(thing.thing.color)))
    kept = _term(*shown, _STAGED * weight)
    encoders.remark(f"Begun with {tell_thing(thing, reading, account)}, laid into the style picture.")
    encoders.remark(account.told)
    return Goal((*goal.terms, kept), (replace(kept, weight=1.0),))
