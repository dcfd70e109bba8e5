"""From a prompt to a scene: reads the prompt, finds pictures of its things, and composes them in a setting."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from frida_painter import images
from frida_painter.frames import PixelGrid
from frida_painter.objectives.encoders.loading import EncoderRegistry
from frida_painter.objectives.encoders.sentence import SentenceEncoder
from frida_painter.objectives.image import ImageTerm
from frida_painter.objectives.objective import Goal
from frida_painter.objectives.sketch_loss import color_drawing
from frida_painter.words import places
from frida_painter.words.account import Account, Mark
from frida_painter.words.arrangement import (
    ScenePart,
    arrange_parts,
    copies,
    is_person,
    kind_of,
    known_like,
    known_things,
)
from frida_painter.words.compositing import is_colored, recolor
from frida_painter.words.composition import ComposedScene, compose_mood, compose_photograph, compose_scene
from frida_painter.words.places import Light, Place, Setting, Weather
from frida_painter.words.reading import Reading, Relation, Thing, paint_of, prompt_reader, word_meanings
from frida_painter.words.retrieval import FoundPicture, PictureIndex, has_ground, is_upright, picture_index
from frida_painter.words.style_scene import composite_into_style, in_style

# Casting: the choice of a picture for each thing.

_FIGURES, _FIGURE = ("woman", "man", "girl", "boy"), 0.5  # who stand for people; least similarity to the others
_IN_A_FIELD = 7  # number of things that a place is full of
_CALLED = 0.9  # similarity above which a picture is of the thing itself
_TITLE = 60  # characters of a caption in a remark


@dataclass(frozen=True)
class SceneThing:
    """Thing of a scene with its picture."""

    thing: Thing
    found: FoundPicture

    @property
    def colored(self) -> Tensor:
        """The picture, recolored to the prompt's colour unless it already has it."""
        color, paint = self.thing.color, paint_of(self.thing.color)
        named = set(color.split()) <= set(self.found.caption.split())
        if paint is None or " and " in color or named or is_colored(self.found.picture, paint):
            return self.found.picture
        return recolor(self.found.picture, paint)

    @property
    def told(self) -> str:
        """Description of the picture for messages."""
        times = f", {self.thing.shown} times" if self.thing.shown > 1 else ""
        stands = "" if self.found.exact else f" for {self.thing.label!r}"
        return f"{self.found.caption[:_TITLE]!r} ({self.found.library.name}{times}){stands}"


_Cast = list[SceneThing | None]


def cast(
    reading: Reading,
    settled: set[int],
    prompt: str,
    index: PictureIndex | None,
    encoders: EncoderRegistry,
    *,
    in_place: bool,
) -> _Cast:
    """Returns a picture for each thing; None for a thing without one, or a thing of the setting.

    settled: numbers of the things that belong to the setting
    in_place: True if the scene shows a place too, so that pictures without a ground are needed

    A measure and its content are one thing: a cup of coffee has one picture.
    """
    things: _Cast = [None] * len(reading.things)
    if index is None:
        return things
    wanted = {number: thing for number, thing in enumerate(reading.things) if number not in settled}
    for one in reading.relations:
        if one.word == "of" and {one.subject, one.object} <= {*wanted} and wanted[one.object].uncounted:
            first, second = wanted[one.subject], wanted.pop(one.object)
            name, at = f"{first.name} of {second.name}", (*first.at, *second.at)
            wanted[one.subject] = replace(first, name=name, noun=second.noun, color=second.color, at=at)
    for number, thing in wanted.items():
        among = len(wanted) > 1 or in_place or thing.shown > 1
        found = _find(thing, prompt, index, encoders, among=among)
        if found is None and number == min(wanted):  # a picture with a ground may be the whole scene
            found = _find(thing, prompt, index, encoders, among=False)
        others = {one.found.caption for one in things if one is not None}
        if found is not None and (found.exact or found.caption not in others):  # a king is no throne
            things[number] = SceneThing(replace(thing, count=1) if found.several else thing, found)
    for one in reading.relations:
        member = things[one.object]
        if one.word == "of" and one.subject in settled and member is not None and member.thing.count is None:
            things[one.object] = replace(member, thing=replace(member.thing, count=_IN_A_FIELD))
    return things


def _find(
    thing: Thing, prompt: str, index: PictureIndex, encoders: EncoderRegistry, *, among: bool
) -> FoundPicture | None:
    """Returns the picture of a thing, None if there is none. For a person without one, a figure stands.

    among: True if the thing is among others, or in a place
    """
    acts = bool(thing.doing or among)

    def find(wanted: Thing) -> FoundPicture | None:
        return index.find(wanted, prompt, cut_out=among, acts=acts)

    found, sentences = find(thing), word_meanings(encoders)
    is_whole = found is not None and (not acts or found.library.is_own or is_upright(found.picture))
    if is_whole or not is_person(thing.name, sentences):
        return found
    meanings = sentences.embed([thing.noun, *_FIGURES])
    similarity, nearest = (meanings[1:] @ meanings[0]).max(0)
    if found is not None and float(similarity) < _FIGURE:
        return found
    name = _FIGURES[int(nearest)]
    figure = find(replace(thing, name=name, noun=name, plural=""))
    return found if figure is None else replace(figure, exact=False)


_BY_THINGS = ("under", "beside", "behind", "front", "with")  # kinds of relations to a thing, not to a place
_SMALL = 0.65  # metres: greatest height of things that stand on a table
_ROUNDING = 1e-3
_SURE = 0.8  # similarity above which a word of a name means a place: a watering can is not in water
_FELT = 0.75  # the same for an adjective and a light: a sad clown
_TREES = 5  # number of trees in a forest without other things
_IMPLIED = 0.42  # similarity to the usual things of a place above which things imply it


def scene_of(
    prompt: str, grid: PixelGrid, encoders: EncoderRegistry, seed: int, use: str = "begun with"
) -> ComposedScene:
    """Returns the scene of a prompt. Remarks in `encoders` tell its pictures.

    use: use of the scene by the painting, for the remarks
    """
    reading, index = prompt_reader(encoders).read(prompt), picture_index(encoders)
    sentences, account = word_meanings(encoders), Account(reading)
    setting, settled, seen = _setting(reading, index, encoders)
    if len(settled) == len(reading.things) and setting.place is not places.NOWHERE:
        reading = _people_place(reading, setting, sentences)
    things = cast(reading, settled, prompt, index, encoders, in_place=setting.place is not places.NOWHERE)
    shown = [one for one in things if one is not None]
    whole = next((one for one in shown if has_ground(one.found.picture)), None)
    if whole is not None:
        _account_for([whole], reading, [one for one in seen if not isinstance(one[2], Place)], account)
        _tell([whole], replace(setting, is_named=False), encoders, use, index, account)
        if len(shown) > 1:
            encoders.remark("The picture has a ground of its own and fills the canvas; nothing else is added.")
        return compose_photograph(whole.colored[:3], setting, grid, seed)
    if not shown and setting.place is places.NOWHERE:
        near = places.rank_lights(prompt, sentences)
        first = near[0] if setting.light == places.DAY else setting.light
        second = setting.second or next(light for light in near if light.name not in first.name)
        _account_for(things, reading, seen, account)
        _tell(shown, replace(setting, light=first, is_named=True), encoders, use, index, account)
        return compose_mood(first, second, setting, grid, seed)
    if setting.place is places.NOWHERE:
        setting = replace(setting, place=_place_of(things, reading.relations, setting, sentences))
    _account_for(things, reading, [one for one in seen if one[2] is not setting.second], account)
    _tell(shown, setting, encoders, use, index, account)
    is_flown = any(relation.word == "flying" for relation in reading.relations)  # a kite of somebody on the ground
    over = {one.subject for one in reading.relations if kind_of(one.word) == "over" and one.object in settled}
    parts: list[ScenePart | None] = []
    for number, one in enumerate(_dress(things, reading.relations, sentences)):
        if one is None:
            parts.append(None)
            continue
        known = known_like(reading.things[number].name, sentences)
        if number in over or (reading.things[number].doing == "flying" and not is_flown):
            known = known._replace(where="air")
        parts.append(ScenePart(copies(one.colored, one.thing.shown, known.where, seed + number), known))
    in_the_air = bool(shown) and all(part.known.where == "air" for part in parts if part is not None)
    return compose_scene(arrange_parts(parts, reading.relations), setting, grid, seed, in_the_air=in_the_air)


def _place_of(things: _Cast, relations: Sequence[Relation], setting: Setting, sentences: SentenceEncoder) -> Place:
    """Returns the usual place of things without a named one, by their meaning, else by their kind and size."""
    carried = {one.subject for one in relations if kind_of(one.word) in ("on", "in") and things[one.object] is not None}
    standing = [one for number, one in enumerate(things) if one is not None and number not in carried]
    shown = standing or [one for one in things if one is not None]
    names = [name for one in shown for name in (one.thing.name, one.found.caption)]
    outside = setting.weather != places.CLEAR or setting.light != places.DAY
    place = places.infer_place(names, sentences, _IMPLIED, outside=outside)
    if place is not places.NOWHERE:
        return place
    known = [known_like(one.thing.name, sentences) for one in shown]
    kinds = {one.where for one in known}
    if kinds <= {"air", "water"}:
        return places.SKY if "air" in kinds else places.LAKE
    if outside:
        return places.MEADOW
    return places.TABLE if max(one.height for one in known) < _SMALL else places.ROOM


def _dress(things: _Cast, relations: Sequence[Relation], sentences: SentenceEncoder) -> _Cast:
    """Merges clothes into their wearers, who take the colour of the clothes."""
    dressed = list(things)
    for relation in relations:
        wearer, worn = dressed[relation.subject], dressed[relation.object]
        if relation.word not in ("in", "with", "wearing") or wearer is None or worn is None:
            continue
        if known_like(worn.thing.name, sentences).where == "worn":
            dressed[relation.subject] = replace(wearer, thing=replace(wearer.thing, color=worn.thing.color))
            dressed[relation.object] = None
    return dressed


def _people_place(reading: Reading, setting: Setting, sentences: SentenceEncoder) -> Reading:
    """Adds the usual things to a place that is named alone: boats in a harbour."""
    found = [name for name in setting.place.found if name not in reading.absent]
    if not found:
        return reading
    meanings = sentences.embed([reading.things[0].name, *found])
    name = found[int((meanings[1:] @ meanings[0]).argmax())]
    number = len(reading.things)
    thing = Thing(name, name.rpartition(" ")[2], count=_TREES if setting.place is places.FOREST else 2)
    return replace(reading, things=(*reading.things, thing), relations=(*reading.relations, Relation(number, "in", 0)))


_Seen = list[tuple[Thing, str, Place | Light | Weather]]


def _setting(
    reading: Reading, index: PictureIndex | None, encoders: EncoderRegistry
) -> tuple[Setting, set[int], _Seen]:
    """Returns the setting that the words name, the numbers of the things that are only part of it, and its words.

    Each of its words comes with the thing that it belongs to and the part of the setting that it means.
    """
    sentences, settled = word_meanings(encoders), set[int]()
    people = [one.name for one in known_things() if one.where == "person"]
    others = [one.name for one in known_things() if one.where != "person"]
    seen: _Seen = []
    for number, thing in enumerate(reading.things):
        nearest = 0.0 if index is None else index.nearest(thing)
        part: Place | Light | Weather | None = None
        if index is None or not index.has_own(thing):
            mood = places.find_mood(thing.noun, people, others, sentences, is_pictured=nearest >= _CALLED)
            light = mood and (places.find_part(thing.noun, places.LIGHTS, sentences) or mood)
            part = places.find_part(thing.noun, places.WEATHERS, sentences) or light
        if part is None and (place := _place_named(number, reading, nearest, sentences)) is not None:
            paint = paint_of(thing.color)
            part = place if paint is None else places.in_color(place, paint)
        if part is not None:
            settled.add(number)
            seen.append((thing, thing.noun, part))
        for word in thing.name.split()[:-1]:
            felt = places.find_part(word, places.WEATHERS, sentences, _SURE) or places.find_part(
                word, places.LIGHTS, sentences, _FELT
            )
            if felt is not None:
                seen.append((thing, word, felt))
    named = [part for *_, part in seen if isinstance(part, Place)]
    weathers = [part for *_, part in seen if isinstance(part, Weather)]
    times = [part for *_, part in seen if isinstance(part, Light) and part in places.TIMES]
    moods = [part for *_, part in seen if isinstance(part, Light) and part not in places.TIMES]
    weather = weathers[0] if weathers else places.CLEAR
    lights = [*times[:1], *([weather.light] if weathers else []), *dict.fromkeys(moods)] or [places.DAY]
    light = places.mix_lights(times[0], moods[0]) if times and moods else lights[0]
    second = next((one for one in lights if one.name not in light.name), None)
    open_places = [place for place in named if place is not places.SKY] or named
    place = open_places[0] if open_places else places.NOWHERE
    used = {place.name, places.SKY.name if place.is_open else "", weather.name, *light.name.split(", ")}
    used |= {second.name} if second is not None and place is places.NOWHERE else set()
    setting = Setting(place, light, weather, second, is_named=bool(seen))
    return setting, settled, [one for one in seen if one[2].name in used]


def _place_named(number: int, reading: Reading, nearest: float, sentences: SentenceEncoder) -> Place | None:
    """Returns the place that a thing of the prompt is, or None if it is a thing.

    nearest: similarity of the nearest picture: a thing with a picture of its own stays a thing, a tree is no forest
    """
    thing = reading.things[number]
    kinds = {kind_of(one.word) for one in reading.relations if one.object == number}
    beside = kinds & set(_BY_THINGS)
    if beside == {"under"} and places.find_part(thing.noun, places.PLACES, sentences) is places.SKY:
        return places.SKY
    if beside and not beside <= {"behind", "front"}:  # a forest or mountains are a background
        return None
    least = max(nearest - _ROUNDING, _CALLED if beside else 0.0)
    place = places.find_part(thing.noun, places.PLACES, sentences, least)
    if place is None and thing.count is None and thing.plural and number:  # mountains, but not a single mountain
        place = places.find_part(thing.plural, places.PLACES, sentences, least)
    if place is None and "on" in kinds:
        # A table that carries things is shown by its top.
        top = places.find_part(thing.noun, places.PLACES, sentences)
        place = top if top is not None and not top.is_open else None
    if place is None and thing.name != thing.noun:
        place = places.find_part(thing.name, places.PLACES, sentences, max(least, _SURE))
    return place


def _account_for(things: Sequence[SceneThing | None], reading: Reading, seen: _Seen, account: Account) -> None:
    """Marks what a scene shows: the words of its setting, the things with pictures, and the relations of both.

    things: of the scene, before clothes are merged into their wearers
    seen: words of the setting
    """
    for thing, word, part in seen:
        account.mark_setting(thing.at, part.name, word)
        for color in thing.color.split() if isinstance(part, Place) else ():
            account.mark_setting(thing.at, f"{color} {part.name}", color)
    whole = [one for one in things if one is not None]
    for one in whole:
        account.mark_picture(one.thing, one.found.caption, exact=one.found.exact, several=one.found.several)
    for relation in reading.relations:
        first, second = reading.things[relation.subject], reading.things[relation.object]
        for one in whole:  # one picture may show both and their relation
            if one.thing.at == first.at and _says_all(one.found.caption, second, reading):
                account.mark_picture(second, one.found.caption, exact=True, several=False)
                account.mark(relation.at, Mark.SHOWN, one.found.caption)
        if account.shows(first.at) and account.shows(second.at):
            is_placed = kind_of(relation.word) not in ("", "doing")
            settles = any(second is thing or first is thing for thing, _, _ in seen)
            near = "side by side, or in the hands" if kind_of(relation.word) == "doing" else "side by side"
            account.mark(relation.at, Mark.SHOWN if is_placed or settles else Mark.SIMILAR, near)


def _says_all(caption: str, thing: Thing, reading: Reading) -> bool:
    """Returns True if a caption names a thing by its noun."""
    return any(word.at in thing.at and word.lemma == thing.noun.lower() and word.says(caption) for word in reading.said)


def _tell(
    shown: Sequence[SceneThing],
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
        told = f"strokes and colours of {setting.words}, without a picture of a thing"
    encoders.remark(f"{use.capitalize()} {told}.")
    encoders.remark(account.told)
    if any(line.mark is Mark.NOT_SHOWN and line.word.kind == "thing" for line in account.lines):
        encoders.remark("What is not shown needs a picture: give one with --image, or a folder with --pictures.")
    for fault in dict.fromkeys(() if index is None else index.faults):
        encoders.remark(f"Of your own pictures one cannot be used: {fault}")


def _credit(shown: Sequence[SceneThing]) -> str:
    """Returns the authors of the pictures, for the end of a sentence."""
    credits = dict.fromkeys(one.found.library.credit for one in shown if one.found.library.credit)
    return f"; pictures by {'; '.join(credits)}" if credits else ""


# Initial pictures for prompts without a picture: scenes composed from the things that they name.

_KEPT = 60.0  # weight of the composition against the words: networks invent colours of things
_KEPT_SCENE = 600.0  # the same for several things, or a place: networks take a scene for a single thing
_AMONG = 3.0  # the same if a style or a sketch has a term too
_STAGED = 20.0  # the same for a style picture, which words would soon destroy
_MATTERS = 8.0  # weight of a thing in a style picture or in its marks, relative to its surroundings
_SUBJECT = 4.0  # the same for things in a scene


def initial_composition(goal: Goal, grid: PixelGrid, encoders: EncoderRegistry, seed: int) -> Goal:
    """Returns the goal with an initial picture, if it has words and no other picture to begin with.

    The picture also becomes a term beside the words, so that the composition lasts while the words change it. It has
    the colours and the marks of the heaviest style, in proportion if that is lighter than the words; without a CLIP,
    it stands in place of the words then. A sketch without
    a photograph is filled with the colours of that picture or of a style. A style picture to begin with gets the
    thing of the words laid into it. All other goals are returned unchanged.
    """
    said = [(term.words, term.weight) for term in goal.terms if term.words is not None]
    said.sort(key=lambda pair: -pair[1])  # several words are read as one sentence
    words, weight = " and ".join(dict.fromkeys(some for some, _ in said)), said[0][1] if said else 0.0
    if goal.initial:
        first = [term.words for term in goal.initial if term.words is not None]
        styles = [term.colors for term in goal.initial if term.colors is not None]
        if any(term.picture is not None for term in goal.initial):
            return goal
        if styles:
            return _start_with_style(goal, styles[0], words, weight, grid, encoders) if words else goal
        if not first:
            return goal
        begun = _term(scene_of(first[0], grid, encoders, seed))
        return replace(goal, initial=(begun, *goal.initial))
    drawing = next((term.drawing for term in goal.terms if term.drawing is not None), None)
    if not words or any(term.picture is not None for term in goal.terms):
        return goal
    weighted = [(term.colors, term.weight) for term in goal.terms if term.colors is not None]
    style, style_weight = max(weighted, key=lambda pair: pair[1]) if weighted else (None, 0.0)
    if drawing is None:
        scene = scene_of(words, grid, encoders, seed)
        subject = _SUBJECT if style is None else _MATTERS
        if style is not None:
            shown = in_style(scene.picture, scene.where, style)
            scene = replace(scene, picture=torch.lerp(scene.picture, shown, min(1.0, style_weight / weight)))
        kept = _KEPT if scene.is_alone else _KEPT_SCENE
        kept = kept if all(term.words is not None for term in goal.terms) else _AMONG
        begun = _term(scene, weight * kept, subject)
    else:
        drawing = images.fit(drawing, grid.rows, grid.columns)
        like = scene_of(words, grid, encoders, seed, "coloured like").picture if style is None else style
        begun = _fill_drawing(drawing, like, weight * _AMONG)
    # Networks by class names know photographs. A scene in a style does not please them, whatever is painted, so they
    # choose the scene and leave its painting to the style; a CLIP knows paintings.
    leads = style is None or drawing is not None or encoders.reads_by_clip
    terms = goal.terms if leads else tuple(term for term in goal.terms if term.words is None)
    return Goal((*terms, begun), (replace(begun, weight=1.0),))


def _term(scene: ComposedScene, weight: float = 1.0, subject: float = _SUBJECT) -> ImageTerm:
    """Returns a scene as a term: its things have more weight than their ground."""
    matters = 1 + (subject - 1) * scene.where
    return ImageTerm(scene.picture, weight, matters / matters.mean())


def _fill_drawing(drawing: Tensor, like: Tensor, weight: float) -> ImageTerm:
    """Returns a drawing [3, H, W] in the colours of a picture, as a term: lines and enclosed areas have more weight."""
    picture = color_drawing(drawing, like)
    matters = 1 + (_SUBJECT - 1) * (picture != picture[:, :1, :1]).any(0).to(picture)
    return ImageTerm(picture, weight, matters / matters.mean())


@torch.no_grad()
def _start_with_style(
    goal: Goal, style: Tensor, words: str, weight: float, grid: PixelGrid, encoders: EncoderRegistry
) -> Goal:
    """Returns the goal that begins with the style picture, with the thing of the words in it, and keeps to it."""
    reading, index = prompt_reader(encoders).read(words), picture_index(encoders)
    found = cast(reading, set(), words, index, encoders, in_place=False)
    thing, account = next((one for one in found if one is not None), None), Account(reading)
    _account_for([thing], reading, [], account)
    if thing is None:
        encoders.remark(f"No picture was found for {words[:60]!r}; begun with the style picture alone.")
        encoders.remark(account.told)
        return goal
    scene = images.fit(style, grid.rows, grid.columns)
    shown = composite_into_style(thing.colored, scene, own=float(bool(thing.thing.color)))
    matters = 1 + (_MATTERS - 1) * shown.where
    kept = ImageTerm(shown.picture, _STAGED * weight, matters / matters.mean())
    encoders.remark(f"Begun with {thing.told}, laid into the style picture{_credit([thing])}.")
    encoders.remark(account.told)
    return Goal((*goal.terms, kept), (replace(kept, weight=1.0),))


def tell_thing(thing: SceneThing, reading: Reading, account: Account) -> str:
    """Marks the words that are shown by the picture of a thing; returns its description with its authors."""
    _account_for([thing], reading, [], account)
    return f"{thing.told}{_credit([thing])}"
