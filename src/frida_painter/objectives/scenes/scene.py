"""From a prompt to a scene: it is read, pictures of its things are found, and they are composed in their setting."""

from collections.abc import Sequence
from dataclasses import replace

from frida_painter.frames import PixelGrid
from frida_painter.objectives.encoders.registry import EncoderRegistry
from frida_painter.objectives.encoders.sentence import SentenceEncoder
from frida_painter.objectives.scenes.appearance import has_ground
from frida_painter.objectives.scenes.arrangement import ScenePart, arranged, copies
from frida_painter.objectives.scenes.casting import NAMED_ALONE, SceneThing, cast
from frida_painter.objectives.scenes.composition import ComposedScene, composed, photographed
from frida_painter.objectives.scenes.drawings import faded
from frida_painter.objectives.scenes.people import with_figures
from frida_painter.objectives.scenes.reading import MOST_THINGS, Reading, Relation, Thing, paint_of
from frida_painter.objectives.scenes.retrieval import PictureIndex
from frida_painter.objectives.scenes.saliency import saliency
from frida_painter.objectives.scenes.settings import (
    CLEAR,
    DAY,
    FOREST,
    GREY,
    HILLS,
    PAPER,
    SKY,
    TIMES,
    Setting,
    implied_place,
    in_color,
    named_light,
    named_place,
    named_weather,
)
from frida_painter.objectives.scenes.world import known_like
from frida_painter.objectives.text import Text

_UNDER = ("under", "beneath", "underneath", "below")
_BY_THINGS = (*_UNDER, "beside", "next to", "behind", "in front of", "with")
_BEFORE = ("behind", "in front of")  # a forest and mountains, but no mountain, are the place of what is before them
_CARRIED = ("on", "on top of", "upon", "riding", "in", "inside", "from")  # a duck on a tractor is not on a lake
_SUPPORTS = ("on", "on top of", "upon")
_TABLES, _SMALL = ("table", "desk", "shelf"), 0.65  # and the height in metres of what they carry
_ROUNDING = 1e-3
_SURE = 0.8  # similarity from which a word of a name says where a thing is: a watering can is not in water
_TREES = 5  # of a forest that is named alone
_IMPLIED = 0.42  # similarity to what is found at a place, from which things imply it


def scene_of(
    prompt: str, grid: PixelGrid, encoders: EncoderRegistry, seed: int, use: str = "begun with"
) -> ComposedScene:
    """The scene of a prompt; the encoders remember what it was made of, and what `use` the painting makes of it."""
    reading, index = encoders.prompts().read(prompt), encoders.picture_index()
    sentences = encoders.sentences()
    reading = replace(reading, relations=tuple(_laid(one, reading.things, sentences) for one in reading.relations))
    setting, settled = _setting(reading, index, encoders)
    if len(settled) == len(reading.things) and setting.place is not PAPER:
        reading = _peopled(reading, setting, sentences)
    reading = with_figures(reading, lambda thing: index is not None and index.has_own(thing))
    things, relations = cast(reading, settled, prompt, index, encoders, seed, in_place=setting.place is not PAPER)
    shown = [one for one in things if one is not None and one.found is not None]
    whole = next((one for one in shown if _fills_the_canvas(one, shown)), None)
    if whole is not None and whole.found is not None:
        left_out = [one.thing.label for one in shown if one is not whole]
        _tell(reading, [whole], replace(setting, is_named=False), encoders, use, index)
        if left_out:
            encoders.remark(
                f"That picture has a ground of its own and fills the canvas; {', '.join(left_out)} could not be added."
            )
        picture, words = whole.colored[:3], Text(whole.thing.name, encoders.readers(), seed)
        return photographed(picture, saliency(picture, words.glance, seed), setting, grid, seed)
    if setting.place is PAPER:
        carried = {id(things[one.subject]) for one in relations if one.word in _CARRIED}
        standing = [one for one in shown if id(one) not in carried] or shown
        names = [name for one in standing for name in (one.thing.name, one.found.caption if one.found else "")]
        names = names or [thing.name for thing in reading.things[:1]]
        asked = setting.is_named or not shown
        outside = setting.weather != CLEAR
        place = implied_place(names, sentences, _IMPLIED, outside=outside)
        place = HILLS if place is PAPER and asked else place
        setting = replace(setting, place=place, is_named=asked)
    things = _dressed(things, relations, sentences)
    among = len(shown) > 1 or setting.is_named
    pasted = [
        one for one in shown if among and one.found and one.found.library.is_own and has_ground(one.found.picture)
    ]
    is_flown = any(relation.word == "flying" for relation in reading.relations)  # a kite, by somebody on the ground
    parts: list[ScenePart | None] = []
    for number, one in enumerate(things):
        if one is None or one.found is None:
            parts.append(None)
            continue
        known = known_like(one.thing.name, sentences)
        if one.thing.doing == "flying" and not is_flown:
            known = known._replace(where="air")
        between = any(relation.object == number and relation.word == "between" for relation in relations)
        pictures = [faded(one.colored)] if any(one is each for each in pasted) else one.each
        parts.append(ScenePart(copies(pictures, one.thing.shown, known.where, seed + number, apart=between), known))
    known_parts = [part.known for part in parts if part is not None]
    over = {
        one.subject for one in reading.relations if one.word in ("over", "above", "across") and one.object in settled
    }
    in_the_air = bool(known_parts) and (all(part.where == "air" for part in known_parts) or _subjects(things, over))
    scene = composed(arranged(parts, relations), setting, grid, seed, in_the_air=in_the_air)
    _tell(reading, things, setting, encoders, use, index)
    for one in pasted:
        encoders.remark(
            f"Your picture of {one.thing.label!r} has a ground of its own, whose edges fade; as a PNG without "
            "its ground it would stand free."
        )
    return scene


def _fills_the_canvas(one: SceneThing, shown: list[SceneThing]) -> bool:
    """Whether a picture has a ground of its own: a person's own only where it is the only one."""
    if one.found is None or not has_ground(one.found.picture):
        return False
    return not one.found.library.is_own or (len(shown) == 1 and one.thing.shown == 1)


def _laid(relation: Relation, things: Sequence[Thing], sentences: SentenceEncoder) -> Relation:
    """A relation, where a table that is "with" something small carries it: the lamp is on the desk."""
    if relation.word != "with":
        return relation
    table, other = things[relation.subject], things[relation.object]
    meanings = sentences.embed([table.noun, *_TABLES])
    if float((meanings[1:] @ meanings[0]).max()) < _SURE:
        return relation
    is_small = known_like(other.name, sentences).height < _SMALL
    return Relation(relation.object, "on", relation.subject) if is_small else relation


def _dressed(
    things: list[SceneThing | None], relations: list[Relation], sentences: SentenceEncoder
) -> list[SceneThing | None]:
    """The things, where clothes that somebody wears are no things of their own but give him their colour."""
    dressed = list(things)
    for relation in relations:
        wearer, worn = dressed[relation.subject], dressed[relation.object]
        if relation.word in ("in", "with", "wearing") and wearer is not None and worn is not None:
            if known_like(worn.thing.name, sentences).where != "worn":
                continue
            dressed[relation.subject] = replace(wearer, thing=replace(wearer.thing, color=worn.thing.color))
            dressed[relation.object] = None
    return dressed


def _peopled(reading: Reading, setting: Setting, sentences: SentenceEncoder) -> Reading:
    """A place that is named alone, with what is found there: boats in a harbour."""
    found = [name for name in setting.place.found if name not in reading.absent]
    if not found:
        return reading
    meanings = sentences.embed([reading.things[0].name, *found])
    name = found[int((meanings[1:] @ meanings[0]).argmax())]
    number = len(reading.things)
    thing = Thing(name, name.rpartition(" ")[2], count=_TREES if setting.place is FOREST else 2)
    return replace(reading, things=(*reading.things, thing), relations=(*reading.relations, Relation(number, "in", 0)))


def _subjects(things: list[SceneThing | None], over: set[int]) -> bool:
    """Whether all things that are shown are over a place."""
    shown = {number for number, one in enumerate(things) if one is not None and one.found is not None}
    return bool(shown) and shown <= over


def _setting(reading: Reading, index: PictureIndex | None, encoders: EncoderRegistry) -> tuple[Setting, set[int]]:
    """The setting that words name, and the numbers of the things that are no more than part of it."""
    sentences, setting, settled = encoders.sentences(), Setting(), set[int]()
    for number, thing in enumerate(reading.things):
        beside = {one.word for one in reading.relations if one.object == number and one.word in _BY_THINGS}
        under_sky = bool(beside) and beside <= set(_UNDER) and named_place(thing.noun, sentences) is SKY
        if beside and not under_sky and not beside <= set(_BEFORE):
            continue
        subject_only = len(reading.things) == 1
        # What has a picture of its own is a thing: a tree is no forest.
        least = 0.0 if index is None else index.nearest(thing) - _ROUNDING
        least = max(least, NAMED_ALONE) if beside <= set(_BEFORE) and beside else least
        place = named_place(thing.noun, sentences, least)
        if place is None and thing.count is None and thing.plural and number:  # mountains, and no mountain
            place = named_place(thing.plural, sentences, least)
        if place is None and any(one.object == number and one.word in _SUPPORTS for one in reading.relations):
            # Of a table that carries things, its top is shown.
            top = named_place(thing.noun, sentences)
            place = top if top is not None and not top.is_open else None
        light = named_light(thing.noun, sentences, least)
        weather = named_weather(thing.noun, sentences, least)
        if light is None and weather is None and place is None and thing.name != thing.noun:
            place = named_place(thing.name, sentences, max(least, _SURE))
        if under_sky:  # it is over any place: its light and weather are told by the words before it
            setting = replace(setting, is_named=True)
            settled.add(number)
        elif place is not None:
            paint = paint_of(thing.color)
            setting = replace(setting, place=place if paint is None else in_color(place, paint), is_named=True)
            settled.add(number)
        elif light is not None:
            setting = replace(setting, light=light, is_named=True)
            if not subject_only:
                settled.add(number)
            elif light in TIMES and least < _SURE:  # a peaceful morning is no picture of a thing
                setting = replace(setting, place=HILLS)
                settled.add(number)
        elif weather is not None:
            setting = replace(setting, weather=weather, is_named=True)
            settled.add(number)
        for word in thing.name.split()[:-1]:
            if setting.light == DAY and (felt := named_light(word, sentences, _SURE)) is not None:
                setting = replace(setting, light=felt, is_named=True)
            if setting.weather == CLEAR and (felt_weather := named_weather(word, sentences, _SURE)) is not None:
                setting = replace(setting, weather=felt_weather, is_named=True)
    if setting.weather.rain and setting.light == DAY:
        setting = replace(setting, light=GREY)
    return setting, settled


def _tell(
    reading: Reading,
    things: list[SceneThing | None],
    setting: Setting,
    encoders: EncoderRegistry,
    use: str,
    index: PictureIndex | None,
) -> None:
    """What the painting began with, who made it, and what was missing."""
    shown = [one for one in things if one is not None and one.found is not None]
    credits = dict.fromkeys(one.found.library.credit for one in shown if one.found and one.found.library.credit)
    made = f"; pictures by {'; '.join(credits)}" if credits else ""
    told = " and ".join(one.told for one in shown) or "no picture of a thing"
    place = f", on {setting.words}" if setting.is_named else ""
    encoders.remark(f"{use.capitalize()} {told}{place}{made}.")
    if reading.too_many:
        encoders.remark(f"The words name more than {MOST_THINGS} things; the first ones are painted.")
    missing = [one.thing.label for one in things if one is not None and not (one.found and one.found.exact)]
    if missing:
        encoders.remark(
            f"No picture of {', '.join(map(repr, missing))} was found; give one with --image, or a folder of your own "
            "with --pictures."
        )
    for fault in dict.fromkeys(() if index is None else index.faults):
        encoders.remark(f"Of your own pictures one cannot be used: {fault}")
