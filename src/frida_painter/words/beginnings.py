"""First picture of a painting of words: a scene, coarse colours or nothing.

The settings choose, or a CLIP.
"""

from dataclasses import replace

import torch
from torch import Tensor

from frida_painter.errors import ConfigError
from frida_painter.objectives.image import ImageTerm
from frida_painter.objectives.objective import Goal, ObjectiveContext
from frida_painter.objectives.text_loss import Text, wish
from frida_painter.objectives.word_settings import WordSettings
from frida_painter.words.photograph import put_into_photograph, puts_into_photograph
from frida_painter.words.pyramid import color_in

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
    how = settings.beginning
    by_clip = encoders.reads_by_clip
    if how == "scene" and by_clip and not encoders.composes:
        raise ConfigError(
            "--beginning scene puts pictures of things together, and the networks for it are not here; fetch them with "
            "`frida-painter models fetch words`, or give --beginning colors."
        )
    if how == "nothing" or (by_clip and not encoders.composes and not is_alone):
        return goal
    if prompt is None or not is_alone or how == "scene" or (how == "auto" and not by_clip):
        return _compose(goal, context)
    reader = encoders.readers()[0]
    size = context.grid.rows, context.grid.columns
    wanted = wish(prompt, reader, settings)
    picture = color_in(wanted, reader, size, context.seed, settings.first_steps, encoders.tell, encoders.heed)
    if how == "auto" and encoders.composes:
        return _choose(goal, prompt, settings, picture, context)
    encoders.remark("Begun with a coarse picture, coloured for the words.")
    return _begin_with(goal, picture)


def _choose(goal: Goal, prompt: str, settings: WordSettings, colors: Tensor, context: ObjectiveContext) -> Goal:
    """Returns the goal that begins with a scene or with coarse colours: with the one that is nearer to the words."""
    judge = Text(prompt, context.encoders.readers(), context.seed + _APART, settings=settings)
    remarks = list(context.encoders.remarks)
    scene = next((one.picture for one in _compose(goal, context).initial if one.picture is not None), colors)
    with torch.no_grad():
        is_scene = bool(judge.validation(scene) < judge.validation(colors))
    if not is_scene:
        context.encoders.remarks[:] = remarks
        context.encoders.remark("Begun with a coarse picture, in which the words are seen better than in a scene.")
    return _begin_with(goal, scene if is_scene else colors)


def _compose(goal: Goal, context: ObjectiveContext) -> Goal:
    from frida_painter.words.scene import initial_composition  # loads the readers of grammar and pictures

    return initial_composition(goal, context.grid, context.encoders, context.seed)


def _begin_with(goal: Goal, picture: Tensor) -> Goal:
    """Returns the goal that begins with a picture, and need not keep to it."""
    return replace(goal, initial=(ImageTerm(picture),))
