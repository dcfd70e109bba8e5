"""Words beside a photograph: their thing is laid into it, their light and their weather over it.

Networks by class names cannot paint what a photograph does not show: towards "a cow" they turn mountains into confetti.
So a picture of the thing becomes a part of the photograph, and the painting is planned towards that. A CLIP paints
words itself.
"""

from dataclasses import replace

import torch
from torch import Tensor

from frida_painter import images
from frida_painter.objectives.encoders.base import Seer
from frida_painter.objectives.encoders.classifiers import EfficientNetLite, class_names
from frida_painter.objectives.encoders.loading import EncoderRegistry
from frida_painter.objectives.image import ImageTerm
from frida_painter.objectives.objective import Goal
from frida_painter.objectives.pixel_loss import rise, spread
from frida_painter.words.account import Account, Mark
from frida_painter.words.arrangement import known_like
from frida_painter.words.casting import cast
from frida_painter.words.composition import lay_setting
from frida_painter.words.places import Setting
from frida_painter.words.reading import Thing, prompt_reader, word_meanings
from frida_painter.words.retrieval import has_ground, picture_index
from frida_painter.words.scene import account_for, setting_of, tell_thing, words_of
from frida_painter.words.style_scene import Composited, composite_into_style

_SIZES = (0.6, 0.5, 0.4)  # longer side of the thing, relative to the photograph's shorter one
_OWN = 0.5  # share of its own colours that it keeps
_STANDS, _FLIES = (0.65, 1.0), (0.0, 0.4)  # positions of its picture in the free space, down
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
    shown = Composited(photograph, torch.zeros(photograph.shape[1:]))
    if any(term.drawing is not None for term in goal.terms):
        encoders.remark(f"{words[:60]!r} adds nothing to the drawing on the photograph; that needs a CLIP.")
    else:
        shown = _lay(words, photograph, matters, encoders, seed)
    rest = tuple(term for term in goal.terms if term.words is None)
    matters = 1 + (_MATTERS - 1) * shown.where
    if goal.initial:
        begun = ImageTerm(shown.picture, importance=matters / matters.mean())
        return Goal((*rest, replace(begun, weight=_HELD * weight)), (begun,))
    changed = [
        term.with_picture(shown.picture).weigh(_times(term.importance, matters))
        if term.picture is photograph and shown.picture is not photograph
        else term
        for term in rest
    ]
    return Goal(tuple(changed))


def _lay(words: str, photograph: Tensor, matters: Tensor | None, encoders: EncoderRegistry, seed: int) -> Composited:
    """Returns a photograph [3, H, W] with the first thing of the words that has a picture, and that it does not show.

    The light and the weather of the words lie over both; rain and flakes keep clear of the thing and of faces.
    matters [h, w]: importance of each place of the photograph, with mean 1; None if uniform
    Remarks in `encoders` tell what is shown.
    """
    reading, index = prompt_reader(encoders).read(words), picture_index(encoders)
    account, shown = Account(reading), Composited(photograph, torch.zeros(photograph.shape[1:]))
    classes = _classes_of(photograph, encoders)
    there = [thing for thing in reading.things if _is_one_of(thing, classes, encoders)]
    for thing in there:
        account.mark(thing.at, Mark.SIMILAR, "what the photograph shows")
    setting, _, named = setting_of(reading, index, encoders)
    setting = Setting(light=replace(setting.light, stars=0), weather=setting.weather)
    used = {setting.weather.name, *setting.light.name.split(", ")}
    over = [one for one in named if one[2].name in used]
    nouns = [thing for thing, word, _ in over if word == thing.noun]
    settled = {number for number, thing in enumerate(reading.things) if thing in nouns}
    found = cast(reading, settled, words, index, encoders, in_place=True)
    usable = [one for one in found if one is not None and not has_ground(one.picture) and one.thing not in there]
    for one in usable[:1]:
        flies = known_like(one.thing.name, word_meanings(encoders)).where == "air"
        rows = _FLIES if flies else _STANDS
        shown = composite_into_style(one.colored, photograph, own=_OWN, sizes=_SIZES, rows=rows)
        encoders.remark(f"Laid into the photograph: {tell_thing(one, reading, account)}.")
    kept = shown.where if matters is None else torch.maximum(shown.where, _faces(matters, *shown.where.shape))
    lit = lay_setting(shown.picture, setting, kept, seed)
    if float((lit.picture - shown.picture).abs().mean()) > _VISIBLE:
        shown = Composited(lit.picture, torch.maximum(shown.where, lit.where - kept))
        encoders.remark(f"Laid over the photograph: {', '.join(dict.fromkeys(part.name for *_, part in over))}.")
        account_for(usable[:1], reading, over, account)
        for thing in nouns:  # "at night" alone: the photograph is at night
            before = [word.at for word in reading.said if word.kind == "relation" and word.at < min(thing.at)]
            account.mark(before[-1:], Mark.SHOWN, "the photograph")
    encoders.remark(account.told)
    return shown


def _faces(matters: Tensor, rows: int, columns: int) -> Tensor:
    """Returns how far each place [rows, columns] is one that matters much more than others, as faces do."""
    return rise(spread(matters, rows, columns), _FACE)


def _classes_of(photograph: Tensor, encoders: EncoderRegistry) -> list[str]:
    """Returns the names of the most probable classes of a photograph [3, H, W]; none if no classifier sees it."""
    seer: Seer = encoders.meaning()
    if not isinstance(seer, EfficientNetLite):
        return []
    seen = seer.logits(images.fit(photograph, _SIDE, _SIDE)[None])[0].topk(_SEEN).indices.tolist()
    return [name for number in seen for name in class_names()[number]]


def _is_one_of(thing: Thing, names: list[str], encoders: EncoderRegistry) -> bool:
    """Returns True if one of the names means the thing."""
    meanings = word_meanings(encoders).embed([thing.name, *names])
    return bool((meanings[1:] @ meanings[0] > _ALIKE).any())


def _times(one: Tensor | None, other: Tensor) -> Tensor:
    """Returns the product of the importance of places by two measures [h, w], with mean 1."""
    both = other if one is None else spread(one, *other.shape) * other
    return both / both.mean()
