"""Setting that a prompt names: its place with the scenery, its light and its weather, by the meaning of its words."""

import math
from collections.abc import Sequence
from dataclasses import replace

from frida_painter.drawing import places, scenery
from frida_painter.drawing.appearance import looks_of
from frida_painter.drawing.arrangement import Relation, kind_of
from frida_painter.drawing.lights import (
    CLEAR,
    DAY,
    Light,
    Weather,
    known_lights,
    known_weathers,
    mix_lights,
    mix_weathers,
    nearest_part,
)
from frida_painter.drawing.places import NOWHERE, Dressing, Place, PlaceLayer, Setting
from frida_painter.drawing.scenery import Stand
from frida_painter.objectives.encoders.loading import EncoderRegistry
from frida_painter.objectives.encoders.sentence import SentenceEncoder
from frida_painter.words.casting import CALLED, Cast
from frida_painter.words.nouns import kind_of_name, kinds_of, senses_of
from frida_painter.words.reading import Reading, Thing, paint_of, word_meanings
from frida_painter.words.retrieval import OWN, PictureIndex
from frida_painter.words.world import is_part_of_body, is_person, known_like, known_things

SKY = "sky"
"""Place without a land of its own."""
_BY_THINGS = ("under", "beside", "behind", "front", "with", "hold")  # kinds of relations to a thing, not to a place
_HAS_PARTS = ("with", "hold", "doing", "around")  # kinds of relations to a part of somebody's body
_AROUND = ("behind", "front", "near", "beside", "over")  # kinds of relations to things that are all around
_PICTURED = 0.8  # similarity above which a picture probably shows the thing of a noun
_ROUNDING = 1e-3
_SURE = 0.8  # similarity above which a word of a name means a place: a watering can is not in water
_EXACTLY = 0.95  # the same for a place that things are beside: a tent beside a lake
_FELT = 0.75  # the same for an idea or an adjective and a light: a sad clown
_ABSTRACT = 0.25  # margin of an abstract noun with a picture
_FRONT = (0.56, "", 0.74, 0.86)  # size, colour and place of the front of a shop in a street
_SEEN, _ROW = 0.86, 4  # similarity of a name and words of no thing to a place; least number of houses in a row
_OF_BUILDINGS = ("roof", "door", "window")  # what drawn buildings have
_BUILDING = 4.0  # least height of a building, in metres
_FEELINGS = ("feel", "feeling", "mood")  # first words of a prompt for a mood: the feeling when school is over

Part = Place | Light | Weather | Dressing
Seen = list[tuple[Thing, str, Part | Stand]]
"""Words of a setting, each with the thing that it belongs to and the part of the setting that it means."""


def setting_of(
    reading: Reading, index: PictureIndex | None, encoders: EncoderRegistry
) -> tuple[Setting, set[int], Seen]:
    """Returns the setting that the words name, the numbers of the things that are only part of it, and its words."""
    sentences, settled, seen = word_meanings(encoders), set[int](), Seen()
    for number in range(len(reading.things)):
        is_settled, parts = _parts_of(number, reading, index, sentences)
        settled |= {number} if is_settled else set()
        seen += parts
    owned = {at for thing in reading.things for at in thing.at}
    for word in reading.said:  # it is still dark
        if word.kind in ("quality", "action") and word.at not in owned:
            felt = _felt(word.lemma, sentences)
            if felt := felt or places.find_part(word.lemma, places.known_places(), sentences, _EXACTLY):  # a stable
                seen.append((Thing(word.text, word.lemma, at=(word.at,)), word.lemma, felt))
    if reading.said and reading.said[0].lemma in _FEELINGS:
        settled = set(range(len(reading.things)))
        seen = [one for one in seen if not isinstance(one[2], Place)]
    light, weather = _mix([part for *_, part in seen])
    named = _order_places(seen)
    place = places.join(named[0], named[1:]) if named else NOWHERE
    trees = [name for one in named[1:] if one.is_open for name in scenery.trees_of(one)]
    place = scenery.plant(place, trees) if trees and place.is_open else place
    seen = [one for one in seen if one[2] in named or not isinstance(one[2], Place)]
    here = [thing for thing, _, part in seen if part in named]
    for stand in [part for *_, part in seen if isinstance(part, Stand) and place.is_open]:  # a birch forest
        place = scenery.line_with(place, stand)
    for number, stand in _stands_in(place, reading, settled, index, sentences).items():
        place = _put_into(place, stand, reading.things[number], sentences)
        seen.append((reading.things[number], reading.things[number].noun, stand))
        settled.add(number)
    if not place.is_open:  # the house that a room is in
        around = {one.object for one in reading.relations if one.word in ("in", "at", "of")}
        settled |= {number for number in around if is_building(reading.things[number].noun)}
    if place.name == "room" and len(settled) == len(reading.things):  # somebody's room
        place = replace(place, layers=places.find_place("bedroom").layers)
    has_building = any(is_building(thing.noun) for thing in reading.things)
    for _, _, part in seen:
        place = _dress(place, part, has_building=has_building) if isinstance(part, Dressing) else place
    related = {kind_of(one.word) for one in reading.relations if reading.things[one.object] in here}
    is_atop = place.kind == "hill" or place.has("bridge", "planks")
    is_ashore = place.bank is not None and not related & {"on", "over", "in"}
    raising = (
        {"on", "over", "behind"} if is_atop else {"beside", "near", "front", "with", "hold"} if is_ashore else set()
    )
    return Setting(place, light, weather, is_named=bool(seen), is_raised=bool(related & raising)), settled, seen


def _order_places(seen: Seen) -> list[Place]:
    """Returns the named places; the first one counts most."""
    where = [(part, thing.name) for thing, _, part in seen if isinstance(part, Place)]
    where = [one for one in where if not kind_of_name(one[1])] or where  # the roofs of Paris
    where.sort(key=lambda one: " " not in one[1] or one[1] not in one[0].words)  # an Italian town
    is_view = any(part.name == "view" for *_, part in seen)  # from an office
    return sorted((part for part, _ in where), key=lambda one: (one.name == SKY, one.is_open == is_view, one.is_way))


def _put_into(place: Place, stand: Stand, thing: Thing, sentences: SentenceEncoder) -> Place:
    """Returns a place with a drawn thing of the prompt in it; a place that is not named is the usual one."""
    words = thing.name.split()[:-1] if stand.is_indoors else ()  # a kitchen window
    rooms = [places.find_part(word, places.known_places(), sentences, _EXACTLY) for word in words]
    usual = next((one for one in rooms if one is not None and not one.is_open), None)
    land = "forest" if scenery.is_tree(stand.name) and place is NOWHERE else "meadow"
    usual = usual or places.find_place("room" if stand.is_indoors else land)
    if place is NOWHERE or place.name == SKY:
        place = replace(usual, above=place.above)
    if _is_front(thing, stand, place):
        return places.with_layers(place, [*place.layers, PlaceLayer("near", stand.name, *_FRONT)])
    paint = paint_of(thing.color)
    return scenery.line_with(place, stand, "" if paint is None else tuple(paint.tolist()))


def _dress(place: Place, dressing: Dressing, *, has_building: bool) -> Place:
    """Returns a place with the things of an occasion or a state.

    has_building: True if the prompt names a building, which is seen from outside
    """
    if not dressing.outdoors:
        return place
    is_inside = dressing.indoors and not has_building
    usual = places.find_place("living room" if is_inside else "meadow") if place is NOWHERE else place
    added = dressing.outdoors if usual.is_open else dressing.indoors
    return places.with_layers(usual, dict.fromkeys((*usual.layers, *added)))


def is_idea(noun: str, things: Sequence[str], sentences: SentenceEncoder, *, is_pictured: bool) -> bool:
    """Returns True for an abstract noun: a feeling, a time, a sound. Nouns with other senses are nearer to a light.

    is_pictured: True if there is a picture of that name, so that it must be much nearer
    """
    kinds = kinds_of(noun)
    if "idea" not in kinds or (kinds == {"idea"} and not is_pictured):
        return "idea" in kinds
    around = [word for place in places.known_places() for word in (*place.words, *place.found)]
    margin = nearest_part([noun], known_lights(), sentences)[1] - float(
        (sentences.embed([*things, *around]) @ sentences.embed([noun])[0]).max()
    )
    return margin > (_ABSTRACT if is_pictured else 0.0)


def _parts_of(
    number: int, reading: Reading, index: PictureIndex | None, sentences: SentenceEncoder
) -> tuple[bool, Seen]:
    """Returns the parts of the setting that the words of a thing mean; and True if the thing is nothing else."""
    thing, seen, known = reading.things[number], Seen(), places.known_places()
    nearest = 0.0 if index is None else index.nearest(thing)
    part: Part | None = None
    others = [one.noun for one in reading.things if one is not thing and one.noun not in _OF_BUILDINGS]
    has_building = any(is_building(one) and not places.find_part(one, known, sentences, _EXACTLY) for one in others)
    stand = scenery.find_stand(_whole(thing), sentences)
    if has_building and stand is not None and stand.name in _OF_BUILDINGS:  # it has them already
        return True, [(thing, thing.noun, Dressing((thing.noun,), (), ()))]
    rest = _rest(thing, reading)
    stand = scenery.find_stand(f"{thing.noun} {rest}", sentences) if rest else None
    if stand is not None and thing.noun in stand.name.split():  # lace curtains
        return True, [(thing, thing.noun, stand)]
    is_object = any(one.object == number and kind_of(one.word) in ("", *_HAS_PARTS) for one in reading.relations)
    is_settled = is_object and nearest < OWN and is_part_of_body(thing.noun, sentences)  # somebody's beard
    if nearest < OWN and not is_settled:
        names = dict.fromkeys((_whole(thing), thing.noun))  # after the rain
        before = [f"{one.word} {name}" for name in names for one in reading.relations if one.object == number]
        before += [  # leaves on the ground
            f"{_whole(thing)} {one.word} {reading.things[one.object].noun}"
            for one in reading.relations if one.subject == number
        ]  # fmt: skip
        for said in (*before, _whole(thing), thing.noun):
            part = part or places.find_part(said, places.known_dressings(), sentences)
            part = part or places.find_part(said, known_weathers(), sentences, _EXACTLY)
        if places.find_part(thing.noun, known, sentences, _EXACTLY) is None:  # water is not wet weather
            part = part or places.find_part(thing.noun, known_weathers(), sentences)
        around = [one.name for one in known_things()]
        is_abstract = " " in thing.noun or is_idea(thing.name, around, sentences, is_pictured=nearest >= _PICTURED)
        least = _FELT if is_abstract else _EXACTLY
        light = _light_named(_whole(thing), sentences, _EXACTLY)  # northern lights
        for said in (thing.noun, _whole(thing)):
            light = light or _light_named(said, sentences, least)
        if part is None and is_abstract and (light or not is_person(thing.noun, sentences)):
            part, is_settled = light, True
        elif light and (light.kind == "hour" or not isinstance(part, Dressing)):  # a thing with a light: the moon
            ends = max(thing.at, default=0) + 1
            after = next(
                (f"{thing.noun} {word.text}" for word in reading.said if word.at == ends), ""
            )  # the sun rising
            light = (_light_named(after, sentences, _SURE) if after else None) or light
            seen.append((thing, thing.noun, light))
            comes = bool(light.body or thing.plural or light is DAY)
            of = [one.object for one in reading.relations if one.subject == number and one.word == "of"]
            shines = any(_light_named(reading.things[one].noun, sentences, _EXACTLY) for one in of)  # the light of dawn
            is_settled = is_settled or (comes and len(reading.things) > 1) or shines
    if part := part or _place_named(number, reading, nearest, sentences):
        named = thing.name.lower().split() if kind_of_name(thing.name) else [thing.noun]
        seen += [(thing, word, part) for word in named]
    words = thing.name.split()
    tails = (" ".join(words[first:]) for first in range(max(1, len(words) - 1)))
    is_whole = any(places.find_part(one, known, sentences, _EXACTLY) for one in tails)  # an old city skyline
    is_placed = isinstance(part, Place) or (part is None and nearest < _PICTURED)  # a mountain pass
    like = _EXACTLY if is_placed else _SEEN if is_building(thing.noun) else 1.1  # a mountain hut
    for at, word in enumerate(words):
        forms = () if is_whole or (part and word == thing.noun) else (word, f"{word}s")[: 2 if words[at + 1 :] else 1]
        also = [places.find_part(one, known, sentences, like) for one in forms]
        seen += [(thing, word, one) for one in also if one is not None][:1]  # a forest path, a mountain lake
        grown = scenery.find_stand(word, sentences) if isinstance(part, Place) and word != thing.noun else None
        seen += [(thing, word, grown)] if grown is not None and grown.usual == "plant" else []  # a birch forest
    for word in (*words[:-1], *(thing.doing.split() if part else ())):
        if nearest < _EXACTLY and (felt := _felt(word, sentences)):  # a hot air balloon tells of no heat
            seen.append((thing, word, felt))
    return is_settled or part is not None, seen


def _felt(word: str, sentences: SentenceEncoder) -> Part | None:
    dressing = places.find_part(word, places.known_dressings(), sentences)
    weather = places.find_part(word, known_weathers(), sentences, _SURE)
    return dressing or weather or _light_named(word, sentences, _FELT)


def _light_named(word: str, sentences: SentenceEncoder, least: float) -> Light | None:
    return places.find_part(word, (*known_lights(), DAY), sentences, least)


def _whole(thing: Thing) -> str:
    """Returns the name of a thing with its colour and its noun as written."""
    return f"{thing.color} {thing.name.removesuffix(thing.noun)}{thing.plural or thing.noun}".strip()


def _mix(parts: Sequence[Part | Stand]) -> tuple[Light, Weather]:
    """Returns the light and the weather of all parts of a setting: those of a winter evening, or of grief at dawn."""
    weather = mix_weathers(list(dict.fromkeys(part for part in parts if isinstance(part, Weather))))
    lights = [part for part in parts if isinstance(part, Light) and part is not DAY]
    hours = [light for light in lights if light.kind == "hour"]
    seasons = [light for light in lights if light.kind == "season"]
    moods = [light for light in lights if light.kind == "mood"]
    if hours and seasons:
        hours = [replace(hours[0], words=(f"{hours[0].name}, {seasons[0].name}",))]
    outside = [*hours, *seasons, *([] if weather is CLEAR else [weather.light])]
    light = next(iter((*outside, *moods)), DAY)
    return (mix_lights(outside[0], moods[0]) if outside and moods else light), weather


def _stands_in(
    place: Place, reading: Reading, settled: set[int], index: PictureIndex | None, sentences: SentenceEncoder
) -> dict[int, Stand]:
    """Returns the things that are scenery of a place, by their numbers: several trees, or the window of a room."""
    left = [number for number in range(len(reading.things)) if number not in settled]
    has_glass = any(scenery.stands()[name].has_glass for layer in place.layers for name in layer.names)
    found: dict[int, Stand] = {}
    held = [one for one in reading.relations if one.word in ("of", "in") and {one.subject, one.object} <= {*left}]
    inner = {one.object if one.word == "of" else one.subject for one in held}  # fish in a bowl are none of a room
    for number in sorted({*left} - inner):
        thing = reading.things[number]
        is_own = index is not None and index.nearest(thing) >= OWN
        is_mass = thing.uncounted and any(one.object == number for one in reading.relations)  # in blossom
        is_compound = " " in thing.name and thing.count == 1 and index is not None and index.nearest(thing) >= _EXACTLY
        is_compound = is_compound and thing.name not in scenery.stand_words()
        is_other = is_own or is_compound or is_person(thing.name, sentences)  # a wine glass is no window
        before = next((one.noun for one in reading.things if one.at and _rest(one, reading) == _whole(thing)), "")
        stand = None if is_other else scenery.find_stand(f"{before} {_whole(thing)}".strip(), sentences, place)
        is_row = stand is not None and stand.has_glass and (thing.count or 0) >= _ROW
        is_some = thing.count is None or is_mass or is_row
        if stand is not None and stand.is_indoors:
            alone = all(known_like(reading.things[one].name, sentences).height < _BUILDING for one in left)
            is_inside = not place.is_open or (place is NOWHERE and len(left) > 1 and alone)  # a church has its own
            found |= {number: stand} if is_inside or has_glass else {}
        elif stand is not None and place.is_open and (is_some or _is_front(thing, stand, place)):
            is_around = any(one.object == number and kind_of(one.word) in _AROUND for one in reading.relations)
            is_land = place is NOWHERE and (is_around or scenery.is_tree(stand.name))
            found |= {number: stand} if place.layers or place.name == SKY or is_land else {}
    return found


def _rest(thing: Thing, reading: Reading) -> str:
    """Returns the name of the thing in the word after a thing, or ""."""
    return next((_whole(one) for one in reading.things if thing.at and one.at and one.at[0] == thing.at[-1] + 1), "")


def is_building(noun: str) -> bool:
    """Returns True for a noun that means a building."""
    return any("structure" in kind.words for sense in senses_of(noun)[:1] for kind in sense.kinds)


def _is_front(thing: Thing, stand: Stand, place: Place) -> bool:
    """Returns True for one house or shop in a street."""
    has_windows = any(shape[0] == "panes" for shape in stand.shapes)
    return has_windows and thing.count == 1 and place.is_open and place.has("walls", "sides")


def _place_named(number: int, reading: Reading, nearest: float, sentences: SentenceEncoder) -> Place | None:
    """Returns the place that a thing of the prompt is, or None if it is a thing.

    nearest: similarity of the nearest picture: a thing with a picture of its own stays a thing, a tree is no forest
    """
    thing = reading.things[number]
    if nearest < OWN and (named := kind_of_name(thing.name)):  # London is a city, and Norway like its landscape
        open_places = [place for place in places.known_places() if place.is_open]
        found = places.find_part(named, open_places, sentences)
        return found or places.infer_place([thing.name], sentences, outside=True)
    is_exact = any(
        places.find_part(name, places.known_places(), sentences, _EXACTLY) for name in (thing.noun, thing.name)
    )  # a moor, a haunted house
    is_one = thing.noun in scenery.stand_words() and not thing.plural  # a tree is no forest
    if not is_exact and (is_one or is_person(thing.noun, sentences)):
        return None
    kinds = {kind_of(one.word) for one in reading.relations if one.object == number}
    beside = kinds & set(_BY_THINGS)
    usual = places.find_part(thing.noun, places.known_places(), sentences)
    paint = paint_of(thing.color)
    if beside == {"under"} and usual is not None and usual.name == SKY:
        return usual if paint is None else places.in_color(usual, tuple(paint.tolist()))
    next_to = beside - {"behind", "front"}  # a forest or mountains are a background
    least = max(nearest - _ROUNDING, _EXACTLY if next_to else CALLED if beside else 0.0)
    several = thing.plural if thing.count is None and thing.plural else thing.noun  # mountains, but not one mountain
    full = f"{thing.name.removesuffix(thing.noun)}{several}"
    colored = places.find_part(f"{thing.color} {full}".strip(), places.known_places(), sentences, _EXACTLY)
    place = colored or places.find_part(full, places.known_places(), sentences, least)
    place = place or places.find_part(several, places.known_places(), sentences, least)
    said = [word.text for word in reading.said if not any(word.at in one.at for one in reading.things)]
    above = places.find_part(" ".join((several, *said)), places.known_places(), sentences, _SEEN) if place else None
    if above is not None and {*said} & {*" ".join(above.words).split()}:  # seen from above
        place = above
    if place is not None and (looks := looks_of(thing.name.split()[:-1], sentences, is_person=False)):
        place = places.in_size(place, math.prod(look.wide * look.size for look in looks.values()))  # a narrow street
    if place is not None and not place.is_open:
        others = (places.find_part(one.noun, places.known_places(), sentences) for one in reading.things)
        is_town, stand = any(one and one.has("walls", "sides") for one in others), scenery.find_stand(full, sentences)
        place = None if next_to or (is_town and stand is not None and not stand.is_indoors) else place
    if place is None and "on" in kinds and usual is not None and not usual.is_open:
        place = usual  # a table that carries things is shown by its top
    has_own = colored is not None  # a lavender field
    return place if place is None or paint is None or has_own else places.in_color(place, tuple(paint.tolist()))


def usual_place(things: Cast, relations: Sequence[Relation], setting: Setting, sentences: SentenceEncoder) -> Place:
    """Returns the usual place of things without a named one."""
    carried = {one.subject for one in relations if kind_of(one.word) in ("on", "in") and things[one.object] is not None}
    shown = [one for number, one in enumerate(things) if one is not None and number not in carried]
    shown = shown or [one for one in things if one is not None]
    outside = setting.weather != CLEAR or setting.light != DAY or any(is_building(one.thing.noun) for one in shown)
    names = [name for one in shown for name in (one.thing.name, one.caption, one.thing.doing) if name]
    afloat = any(one.figure is not None and one.figure.afloat for one in shown) or all(
        known_like(one.thing.name, sentences).where in ("water", "air") for one in shown
    )
    return places.infer_place(names, sentences, outside=outside, afloat=afloat)
