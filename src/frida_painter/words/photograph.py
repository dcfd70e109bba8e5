"""Words beside a photograph: their thing is laid into it, their light and their weather over it.

Networks by class names cannot paint what a photograph does not show: towards "a cow" they turn mountains into confetti.
So a picture of the thing becomes a part of the photograph, and the painting is planned towards that. A CLIP paints
words itself.
"""

from dataclasses import replace

import torch
from torch import Tensor

from frida_painter import images
from frida_painter.drawing.composition import lay_setting
from frida_painter.drawing.places import Setting
from frida_painter.objectives.encoders.base import Seer
from frida_painter.objectives.encoders.classifiers import EfficientNetLite, class_names
from frida_painter.objectives.encoders.loading import EncoderRegistry
from frida_painter.objectives.image import ImageTerm
from frida_painter.objectives.objective import Goal
from frida_painter.objectives.pixel_loss import rise, spread
from frida_painter.words.account import Account, Mark
from frida_painter.words.casting import cast
from frida_painter.words.reading import prompt_reader, word_meanings
from frida_painter.words.retrieval import has_ground, picture_index
from frida_painter.words.scene import account_for, tell_thing, words_of
from frida_painter.words.setting import setting_of
from frida_painter.words.style_scene import composite_into_style
from frida_painter.words.world import known_like

_SIZES = (0.6, 0.5, 0.4)  # longer side of the thing, relative to the photograph's shorter one
_OWN = 0.5  # share of its own colours that it keeps
_STANDS, _FLIES = (0.65, 1.0), (0.0, 0.4)  # positions of its picture in the free space, down
_TALL, _TOWERS = 4.0, (0.3, 0.55)  # height in metres of distant things, and their position
_MATTERS = 8.0  # importance of the thing, relative to the rest
_HELD = 20.0  # weight of a photograph that is only begun with, relative to that of the words
_SEEN, _ALIKE = 3, 0.55  # classes that a photograph shows; similarity of the thing to the name of one of them
_SIDE = 224  # pixels
_FACE = 3.0  # importance of a place, relative to the least, from which no rain and no flakes cover it
_VISIBLE = 0.01  # mean change of sRGB from which a light or a weather is seen


def puts_into_photograph(goal: Goal, encoders: EncoderRegistry) -> bool:
    """Returns True if the goal has words and a photograph, and no CLIP that paints the words."""
    is_said = any(term.words is not None for term in goal.terms)
    is_shown = any(term.picture is not None for term in goal.initial or goal.terms)
    return is_said and is_shown and not encoders.reads_by_clip


@torch.no_grad()
def put_into_photograph(goal: Goal, encoders: EncoderRegistry, seed: int) -> Goal:
    """Returns the goal with the thing of the words in its photograph and in their light, and without the words.

    Nothing is laid into a photograph that shows the thing already, or if the words name what is drawn beside it.
    seed: of the places of rain and flakes
    """
    matters, photograph = next(
        (term.importance, term.picture) for term in goal.initial or goal.terms if term.picture is not None
    )
    words, weight = words_of(goal)
    shown, where = photograph, torch.zeros(photograph.shape[1:])
    if any(term.drawing is not None for term in goal.terms):
        encoders.remark(f"{words[:60]!r} adds nothing to the drawing on the photograph; that needs a CLIP.")
    else:
        shown, where = _lay(words, photograph, matters, encoders, seed)
    rest = tuple(term for term in goal.terms if term.words is None)
    weights = 1 + (_MATTERS - 1) * where
    if goal.initial:
        begun = ImageTerm(shown, importance=weights / weights.mean())
        return Goal((*rest, replace(begun, weight=_HELD * weight)), (begun,))
    both = weights if matters is None else spread(matters, *weights.shape) * weights
    changed = [
        term.with_picture(shown).weigh(both / both.mean())
        if term.picture is photograph and shown is not photograph
        else term
        for term in rest
    ]
    return Goal(tuple(changed))


def _lay(
    words: str, photograph: Tensor, matters: Tensor | None, encoders: EncoderRegistry, seed: int
) -> tuple[Tensor, Tensor]:
    """Returns a photograph [3, H, W] with the first thing of the words that it does not show, and what is new [H, W].

    The light and the weather of the words lie over both; rain and flakes keep clear of the thing and of faces.
    matters [h, w]: importance of each place of the photograph, with mean 1; None if uniform
    Remarks in `encoders` tell what is shown.
    """
    reading, index = prompt_reader(encoders).read(words), picture_index(encoders)
    account, shown, where = Account(reading), photograph, torch.zeros(photograph.shape[1:])
    meanings, classes = word_meanings(encoders), _classes_of(photograph, encoders)
    there = [
        thing for thing in reading.things
        if classes and float((meanings.embed(classes) @ meanings.embed([thing.name])[0]).max()) > _ALIKE
    ]  # fmt: skip
    for thing in there:
        account.mark(thing.at, Mark.SIMILAR, "what the photograph shows")
    setting, _, named = setting_of(reading, index, encoders)
    setting = Setting(light=replace(setting.light, stars=0), weather=setting.weather)
    used = {*setting.weather.name.split(", "), *setting.light.name.split(", ")}
    over = [one for one in named if one[2].name in used]
    named_alone = [thing for thing, word, _ in over if word == thing.noun]
    settled = {number for number, thing in enumerate(reading.things) if thing in named_alone}
    found = cast(reading, settled, words, index, encoders, in_place=True)
    usable = [one for one in found if one is not None and not has_ground(one.picture) and one.thing not in there]
    for one in usable[:1]:
        known = known_like(one.thing.name, meanings)
        rows = _FLIES if known.where == "air" else _TOWERS if known.height > _TALL else _STANDS
        shown, where = composite_into_style(one.colored, photograph, own=_OWN, sizes=_SIZES, rows=rows)
        encoders.remark(f"Laid into the photograph: {tell_thing(one, reading, account)}.")
    # Faces matter much more than other places.
    kept = where if matters is None else torch.maximum(where, rise(spread(matters, *where.shape), _FACE))
    lit = lay_setting(shown, setting, kept, seed)
    if float((lit.picture - shown).abs().mean()) > _VISIBLE:
        shown, where = lit.picture, torch.maximum(where, lit.where - kept)
        encoders.remark(f"Laid over the photograph: {', '.join(dict.fromkeys(part.name for *_, part in over))}.")
        account_for(usable[:1], reading, over, account)
    encoders.remark(account.told)
    return shown, where


def _classes_of(photograph: Tensor, encoders: EncoderRegistry) -> list[str]:
    """Returns the names of the most probable classes of a photograph [3, H, W]; none if no classifier sees it."""
    seer: Seer = encoders.meaning()
    if not isinstance(seer, EfficientNetLite):
        return []
    seen = seer.logits(images.fit(photograph, _SIDE, _SIDE)[None])[0].topk(_SEEN).indices.tolist()
    return [name for number in seen for name in class_names()[number]]
