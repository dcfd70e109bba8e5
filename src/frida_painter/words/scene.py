"""From a prompt to a scene: reads the prompt, finds pictures of its things, and composes them in a setting."""

import math
import zlib
from collections.abc import Sequence
from dataclasses import replace

from frida_painter.drawing.appearance import Appearance, change_looks, in_weather, looks_of
from frida_painter.drawing.arrangement import Relation, ScenePart, arrange_parts, copies, kind_of
from frida_painter.drawing.composition import ComposedScene, compose_mood, compose_photograph, compose_scene
from frida_painter.drawing.lights import CLEAR, DAY, Light, distance, dye, find_weather, go_together, rank_lights
from frida_painter.drawing.places import NOWHERE, Dressing, Place, Setting
from frida_painter.drawing.scenery import Stand, is_wood
from frida_painter.frames import PixelGrid
from frida_painter.objectives.encoders.loading import EncoderRegistry
from frida_painter.objectives.encoders.sentence import SentenceEncoder
from frida_painter.objectives.objective import Goal
from frida_painter.words.account import Account, Mark
from frida_painter.words.casting import Cast, cast
from frida_painter.words.nouns import senses_of
from frida_painter.words.reading import Reading, SaidWord, Thing, prompt_reader, strip_request, word_meanings
from frida_painter.words.retrieval import FoundPicture, PictureIndex, has_ground, picture_index
from frida_painter.words.setting import SKY, Seen, setting_of, usual_place
from frida_painter.words.world import is_person, known_like

_CROWDED = ("busy", "crowded", "bustling", "packed", "lively")
_HAS = ("with", "having", "on")  # words between a whole and its part
_NEAR_MOODS = 4  # number of lights from which the second colours of a mood are chosen
_IN_A_FIELD = 8  # number of things that a place or a bowl is full of


def scene_of(
    prompt: str, grid: PixelGrid, encoders: EncoderRegistry, seed: int, use: str = "begun with"
) -> ComposedScene:
    """Returns the scene of a prompt. Remarks in `encoders` tell its pictures.

    use: use of the scene by the painting, for the remarks
    """
    prompt = strip_request(prompt)
    reading, index = prompt_reader(encoders).read(prompt), picture_index(encoders)
    sentences, account = word_meanings(encoders), Account(reading)
    setting, settled, seen = setting_of(reading, index, encoders)
    named = [light for *_, light in seen if isinstance(light, Light) and light is not DAY]
    feels = any(isinstance(part, Light) and part.kind == "mood" and word == thing.noun for thing, word, part in seen)
    is_placed = any(isinstance(part, Place | Stand) or _dresses(part) for *_, part in seen)
    is_busy = any(isinstance(part, Place) and {*thing.name.split()} & {*_CROWDED} for thing, _, part in seen)
    is_full = any(layer.what for layer in setting.place.layers)
    if is_placed and len(settled) == len(reading.things) and (is_busy or not (feels or is_full)):
        reading = _people_place(reading, setting.place, is_busy=is_busy)
    reading = _grow_crops(_fill_fields(reading, seen), seen)
    things = cast(reading, settled, prompt, index, encoders, in_place=setting.place is not NOWHERE)
    shown = [one for one in things if one is not None]
    whole = next((one for one in shown if has_ground(one.picture)), None)
    is_mood = not shown and setting.place is NOWHERE
    lights = named + rank_lights(prompt, sentences)
    if whole is not None:
        things, setting, is_placed = [whole], replace(setting, is_named=False), False
        seen = [one for one in seen if not isinstance(one[2], Place)]
    elif is_mood:
        light, said = lights[0] if setting.light == DAY else setting.light, reading.colors
        light = dye(light, [*said.values()]) if said else light
        setting = replace(setting, light=light, is_named=True)
        account.mark(said, Mark.SHOWN, light.name)
        seen += [(reading.things[number], reading.things[number].noun, setting.light) for number in settled]
    elif setting.place is NOWHERE:
        setting = replace(setting, place=usual_place(things, reading.relations, setting, sentences))
    others = [light for light in lights if light.name not in setting.light.name]
    alike = [light for light in others if go_together(light, setting.light)][:_NEAR_MOODS]
    also = [light for light in others if light in named] or sorted(alike, key=lambda one: distance(one, setting.light))
    second = next(iter(also), setting.light)
    second = setting.light if is_mood and reading.colors else second
    used = {setting.place.name, *setting.light.name.split(", ")}
    used |= {
        part.name
        for *_, part in seen
        if isinstance(part, Stand | Dressing) or (isinstance(part, Place) and part.layers)
    }
    used |= {*setting.weather.name.split(", ")} if setting.place.is_open else set()
    used |= set() if setting.light.stars else {DAY.name}
    used |= {second.name} if is_mood else {SKY} if setting.place.is_open else set()
    account_for(things, reading, [one for one in seen if one[2].name in used], account)
    looks: dict[int, dict[SaidWord, Appearance]] = {}
    missing = {number for number, one in enumerate(things) if one is None} - settled
    for number, one in enumerate(things if whole is None else ()):
        if one is not None:
            looks[number] = _looks_of(number, reading, one, missing, sentences)
            account.mark([word.at for word in looks[number]], Mark.SHOWN, one.caption)
    _tell([one for one in things if one is not None], setting, encoders, use, index, account)
    if whole is not None:
        if len(shown) > 1:
            encoders.remark("The picture has a ground of its own and fills the canvas; nothing else is added.")
        return compose_photograph(whole.colored[:3], setting, grid, seed)
    if is_mood:
        return compose_mood(setting.light, second, setting, grid, zlib.crc32(f"{seed} {prompt}".encode()))
    if not setting.place.is_open:  # no rain falls indoors, and no wind blows
        setting = replace(setting, weather=CLEAR)
    parts = _parts_of(things, looks, reading, setting, seed, sentences)
    usual = {part.known.where for part in parts if part is not None}
    in_the_air = usual == {"air"}
    is_ashore = setting.place.bank is not None and usual == {"ground"}  # a lighthouse does not float
    setting = replace(setting, is_raised=(setting.is_raised or is_ashore) and not in_the_air and "water" not in usual)
    beyond = {one.subject for one in reading.relations if kind_of(one.word) == "behind" and one.object in settled}
    relations = [_as_meant(one, things) for one in reading.relations]
    near, far = (
        arrange_parts([part if (number in beyond) == is_far else None for number, part in enumerate(parts)], relations)
        for is_far in (False, True)
    )
    place = setting.place
    if place.name == SKY and not in_the_air:  # cranes against an orange sky
        place = replace(
            usual_place(things, reading.relations, replace(setting, weather=find_weather("wind")), sentences),
            above=place.above,
        )
        is_placed = False
    if not is_placed:  # what nobody asked for is not seen, but the sea that a beach or a lighthouse is at
        place = replace(place, layers=tuple(one for one in place.layers if one.kind in ("band", "waves")))
    setting = replace(setting, place=place)
    absent = *reading.absent, *(one.thing.noun for one in things if one is not None)  # a lonely tree
    return compose_scene(near, setting, grid, seed, in_the_air=in_the_air, absent=absent, far=far)


def _parts_of(
    things: Cast,
    looks: dict[int, dict[SaidWord, Appearance]],
    reading: Reading,
    setting: Setting,
    seed: int,
    sentences: SentenceEncoder,
) -> list[ScenePart | None]:
    """Returns the things with their looks, in the weather, and all their copies, ready to be placed."""
    held = {one.subject for one in (_as_meant(one, things) for one in reading.relations) if kind_of(one.word) == "in"}
    is_flown = any(relation.word == "flying" for relation in reading.relations)  # a kite of somebody on the ground
    parts: list[ScenePart | None] = [None] * len(things)
    for number, one in enumerate(things):
        if one is None:
            continue
        called, mine = [word.text.lower() for word in looks[number]], [*looks[number].values()]
        thing = reading.things[number]
        said = thing.plural if thing.plural == one.caption else thing.name  # glasses on a nose are no glass
        name = " ".join(word for word in said.split() if word.lower() not in called)
        known = known_like(name, sentences)  # a small house is no small bird
        if one.thing.doing == "flying" and not is_flown:
            known = known._replace(where="air")
        if one.figure is not None and one.figure.afloat:
            known = known._replace(where="water")
        colored = one.colored if one.figure is None else one.picture  # the clothes have the colour
        picture, size = change_looks(colored, mine)
        picture = in_weather(picture, setting.weather, known.where, mine)
        leans = picture.shape != colored.shape
        where = "bunch" if number in held and known.where == "plant" else known.where
        picture = copies([picture] * one.shown, where, seed + number, leans=leans)
        parts[number] = ScenePart(picture, known, one.figure, size)
    return parts


def _as_meant(relation: Relation, things: Cast) -> Relation:
    """Returns a relation as one of the hands, if its word belongs to an action: to write on a blackboard."""
    figure = getattr(things[relation.subject], "figure", None)
    is_part = figure is not None and not figure.seat and f" {relation.word} " in figure.does
    is_part = is_part or (figure is not None and relation.word == "out of")  # to take bread out of an oven
    if relation.word == "with" and _contains(things[relation.subject]) > _contains(things[relation.object]):
        relation = Relation(relation.object, "in", relation.subject, relation.at)  # a vase with tulips
    return replace(relation, word="doing") if is_part else relation


def _dresses(part: object) -> bool:
    """Returns True for an occasion or a state that adds things to a place."""
    return isinstance(part, Dressing) and bool(part.outdoors)


def _contains(one: FoundPicture | Thing | None) -> bool:
    """Returns True for a container; a cup of tea is shown with its tea, so it is none."""
    thing = one.thing if isinstance(one, FoundPicture) else one
    kinds = [kind.words for sense in senses_of(thing.noun)[:3] for kind in sense.kinds] if thing is not None else []
    return thing is not None and " of " not in thing.name and any("container" in words for words in kinds)


def _looks_of(
    number: int, reading: Reading, found: FoundPicture, missing: set[int], sentences: SentenceEncoder
) -> dict[SaidWord, Appearance]:
    """Returns the words for the appearance of a thing that its picture does not already have.

    A word that belongs to no thing tells of the one before it: the snowman is melting. That of a part which is not
    shown tells of the whole: a teapot with a chipped spout.

    missing: numbers of the things that are not shown
    """
    thing, owned = found.thing, {at for one in reading.things for at in one.at}
    parts = {
        one.object
        for one in reading.relations
        if one.subject == number and (one.word in _HAS or kind_of(one.word) == "made")
    } & missing
    own = {*thing.at, *(at for part in parts for at in reading.things[part].at)}
    ends = max(thing.at, default=0)
    after = min((at for at in owned if at > ends), default=math.inf)
    said = {
        word: word.text.lower()
        for word in reading.said
        if word.kind in ("quality", "action") or word.at in own - {*thing.at}
    }
    mine = {
        word: text for word, text in said.items() if not word.says(found.caption) and (word.at in own or (
            word.at not in owned and ends < word.at < after))
    }  # fmt: skip
    looks = looks_of([*mine.values()], sentences, is_person=is_person(thing.name, sentences))
    return {word: looks[text] for word, text in mine.items() if text in looks}


def _is_absent(name: str, absent: Sequence[str]) -> bool:
    return name in absent or name.rpartition(" ")[2] in absent


def _people_place(reading: Reading, place: Place, *, is_busy: bool) -> Reading:
    """Adds the usual things to a place that is named alone: boats in a harbour, but none to grief in a harbour.

    is_busy: True to add people too
    """
    name = next((name for name in place.found if not _is_absent(name, reading.absent)), None)
    added = [Thing(name, name.rpartition(" ")[2], count=2)] if name is not None else []
    added = [*(Thing(who, who, doing="walking") for who in ("woman", "man", "girl") if is_busy), *added]
    relations = (Relation(len(reading.things) + number, "in", 0) for number in range(len(added)))
    return replace(reading, things=(*reading.things, *added), relations=(*reading.relations, *relations))


def _fill_fields(reading: Reading, seen: Seen) -> Reading:
    """Returns the reading with many things in a full place or vessel: a field of tulips, a bowl of lemons."""
    fields = [thing.at for thing, _, part in seen if isinstance(part, Place)]
    wholes = {number for number, thing in enumerate(reading.things) if thing.at in fields or _contains(thing)}
    full = {one.object for one in reading.relations if one.word == "of" and one.subject in wholes}
    things = tuple(
        replace(thing, count=_IN_A_FIELD) if number in full and (thing.count is None or thing.uncounted) else thing
        for number, thing in enumerate(reading.things)
    )
    return replace(reading, things=things)


def _grow_crops(reading: Reading, seen: Seen) -> Reading:
    """Returns the reading with the plants that the name of a place says: a pumpkin patch."""
    grown, relations = list[Thing](), list[Relation]()
    for number, thing in enumerate(reading.things):
        named = next(
            (
                part.words
                for one, _, part in seen
                if isinstance(part, Place) and one.at == thing.at and not is_wood(part)
            ),
            None,
        )  # an olive grove has its trees
        for word in reading.said if named is not None else ():
            is_said = word.at in {*thing.at} - {*reading.colors} and word.kind == "quality"
            crop = word.lemma if is_said else ""
            is_plant = any("plant" in kind.words for sense in senses_of(crop)[:1] for kind in sense.kinds)
            if is_plant and not any(crop in name for name in named or ()):
                relations.append(Relation(len(reading.things) + len(grown), "in", number))
                grown.append(Thing(crop, crop, count=_IN_A_FIELD, at=(word.at,)))
    return replace(reading, things=(*reading.things, *grown), relations=(*reading.relations, *relations))


def account_for(things: Sequence[FoundPicture | None], reading: Reading, seen: Seen, account: Account) -> None:
    """Marks what a scene shows: the words of its setting, the things with pictures, and the relations of both.

    seen: words of the setting
    """
    for thing, word, part in seen:
        account.mark_setting(thing.at, part.name, word)
        if isinstance(part, Stand) and {thing.name, f"{thing.name}s"} & {*part.words}:
            account.mark(thing.at, Mark.SHOWN, part.name)
        for color in thing.color.split() if isinstance(part, Place) else ():
            account.mark_setting(thing.at, f"{color} {part.name}", color)
    shown = [one for one in things if one is not None]
    for one in shown:
        account.mark_picture(one.thing, one.caption, exact=one.exact, several=one.several)
    carried = {one.thing.at: one.caption for one in shown}
    for relation in sorted(reading.relations, key=lambda one: one.word == "of"):  # tea, after the cup of it
        first, second = reading.things[relation.subject], reading.things[relation.object]
        nouns = [word for word in reading.said if word.at in second.at and word.lemma == second.noun.lower()]
        caption = carried.get(first.at, "")
        if any(word.says(caption) for word in nouns):  # one picture may show both and their relation
            account.mark_picture(second, caption, exact=True, several=False)
            account.mark(relation.at, Mark.SHOWN, caption)
            carried[second.at] = caption
        if account.shows(first.at) and account.shows(second.at):
            is_placed = kind_of(relation.word) not in ("", "doing")
            settles = any(second is thing or first is thing for thing, _, _ in seen)
            near = "side by side, or in the hands" if kind_of(relation.word) == "doing" else "side by side"
            account.mark(relation.at, Mark.SHOWN if is_placed or settles else Mark.SIMILAR, near)


def _tell(
    shown: Sequence[FoundPicture],
    setting: Setting,
    encoders: EncoderRegistry,
    use: str,
    index: PictureIndex | None,
    account: Account,
) -> None:
    """Makes remarks about the scene's pictures, their authors, and what is not shown."""
    place = f", on {setting.words}" if setting.is_named else ""
    told = f"{' and '.join(one.told for one in shown)}{place}{_credit(shown)}"
    if not shown:
        is_drawn = bool(setting.place.layers)
        told = f"the scenery of {setting.words}, drawn" if is_drawn else f"strokes and colours of {setting.words}"
    encoders.remark(f"{use.capitalize()} {told}.")
    encoders.remark(account.told)
    if any(line.mark is Mark.NOT_SHOWN and line.word.kind == "thing" for line in account.lines):
        encoders.remark("What is not shown needs a picture: give one with --image, or a folder with --pictures.")
    for fault in dict.fromkeys(() if index is None else index.faults):
        encoders.remark(f"Of your own pictures one cannot be used: {fault}")


def _credit(shown: Sequence[FoundPicture]) -> str:
    """Returns the authors of the pictures, for the end of a sentence."""
    credits = dict.fromkeys(one.library.credit for one in shown if one.library is not None and one.library.credit)
    return f"; pictures by {'; '.join(credits)}" if credits else ""


def words_of(goal: Goal) -> tuple[str, float]:
    """Returns the words of a goal as one sentence, the heaviest first, and their largest weight; "" and 0 if none."""
    said = [(term.words, term.weight) for term in goal.terms if term.words is not None]
    said.sort(key=lambda pair: -pair[1])
    return " and ".join(dict.fromkeys(some for some, _ in said)), said[0][1] if said else 0.0


def tell_thing(thing: FoundPicture, reading: Reading, account: Account) -> str:
    """Marks the words that are shown by the picture of a thing; returns its description with its authors."""
    account_for([thing], reading, [], account)
    return f"{thing.told}{_credit([thing])}"
