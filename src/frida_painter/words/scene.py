"""From a prompt to a scene: reads the prompt, finds pictures of its things, and composes them in a setting."""

from collections.abc import Callable, Sequence
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
from frida_painter.words.composition import ComposedScene, compose_mood, compose_photograph, compose_scene, saliency
from frida_painter.words.libraries import fade_edges
from frida_painter.words.meaning import Text
from frida_painter.words.places import (
    CLEAR,
    DAY,
    FOREST,
    LAKE,
    LIGHTS,
    MEADOW,
    NOWHERE,
    PLACES,
    ROOM,
    SKY,
    TABLE,
    TIMES,
    WEATHERS,
    Light,
    Place,
    Setting,
    Weather,
    find_mood,
    find_part,
    in_color,
    infer_place,
    mix_lights,
    rank_lights,
)
from frida_painter.words.reading import Reading, Relation, Thing, paint_of, prompt_reader, word_meanings
from frida_painter.words.retrieval import (
    FoundPicture,
    PictureIndex,
    has_ground,
    is_colorless,
    is_upright,
    picture_index,
)
from frida_painter.words.style_scene import composite_into_style, in_style

# Casting: the choice of a picture for each thing, alone or together with others.

_FIGURES, _FIGURE = (
    ("woman", "man", "girl", "boy"),
    0.5,
)  # who stand for people; least similarity to those with a picture
_IN_A_FIELD = 7  # number of things that a place is full of
_WHOLE = 0.80  # similarity of a caption to two things and their relation above which it shows both
_PART = 0.75  # the same for a part of a thing
_HELD = 0.72  # the same for "a bowl of cherries"
_BETTER = 0.08  # gain of similarity that justifies a picture with a ground
NAMED_ALONE = 0.9  # the same for coffee, if there is no cup of coffee
_TITLE = 60  # characters of a caption in a remark


@dataclass(frozen=True)
class SceneThing:
    """Thing of a scene with its picture, if one was found."""

    thing: Thing
    found: FoundPicture | None

    @property
    def colored(self) -> Tensor:
        """The picture, recolored to the prompt's colour unless it already has it."""
        assert self.found is not None
        return self._in_color(self.found.picture)

    @property
    def each(self) -> list[Tensor]:
        """Recolored picture, and further ones of the same thing if several are wanted."""
        assert self.found is not None
        return [self.colored, *map(self._in_color, self.found.others)]

    def _in_color(self, picture: Tensor) -> Tensor:
        assert self.found is not None
        color, paint = self.thing.color, paint_of(self.thing.color)
        named = set(color.split()) <= set(self.found.caption.split())
        if paint is None or " and " in color or named or is_colored(picture, paint):
            return picture
        return recolor(picture, paint)

    @property
    def told(self) -> str:
        """Description of the picture for messages."""
        assert self.found is not None
        times = f", {self.thing.shown} times" if self.thing.shown > 1 else ""
        stands = "" if self.found.exact else f" for {self.thing.label!r}"
        return f"{self.found.caption[:_TITLE]!r} ({self.found.library.name}{times}){stands}"

    @property
    def credit(self) -> str:
        """Credit of the picture, for the end of a sentence."""
        assert self.found is not None
        return f"; picture by {self.found.library.credit}" if self.found.library.credit else ""


def thing_of(prompt: str, encoders: EncoderRegistry, seed: int) -> SceneThing | None:
    """Returns the first thing of a prompt that has a picture; None if there is none."""
    index = picture_index(encoders)
    if index is None:
        return None
    for thing in prompt_reader(encoders).read(prompt).things:
        found = index.find(thing, prompt, looks(thing.name, encoders, seed))
        if found is not None:
            return SceneThing(thing, found)
    return None


def cast(
    reading: Reading,
    settled: set[int],
    prompt: str,
    index: PictureIndex | None,
    encoders: EncoderRegistry,
    seed: int,
    *,
    in_place: bool,
) -> tuple[list[SceneThing | None], list[Relation]]:
    """Returns a picture for each thing, and the relations that remain.

    settled: numbers of the things that belong to the setting
    in_place: True if the scene shows a place too, so that pictures without a ground are needed

    A picture of two things and their relation belongs to the first one.
    """
    if index is None:
        return [SceneThing(thing, None) for thing in reading.things], []
    relations = [one for one in reading.relations if one.subject not in settled and one.object not in settled]
    caster = _Caster(prompt, index, encoders, seed)
    things: list[SceneThing | None] = [None] * len(reading.things)
    merged = set(settled)
    for relation in list(relations):
        if relation in relations and not merged & {relation.subject, relation.object}:
            first, second = reading.things[relation.subject], reading.things[relation.object]
            if (whole := caster.whole(first, relation.word, second)) is not None:
                things[relation.subject] = SceneThing(first, whole)
                merged |= {relation.subject, relation.object}
                relations = [one for one in relations if relation.object not in (one.subject, one.object)]
    had = {one.object for one in relations if one.word == "with"}  # parts, such as a roof, belong to their whole
    leading = next((number for number in range(len(things)) if number not in settled), None)
    for number, thing in enumerate(reading.things):
        if number not in merged:
            among = bool(relations) or in_place or thing.shown > 1
            found = caster.single(thing, among=among, is_part=number in had, leads=number == leading)
            others = {one.found.caption for one in things if one is not None and one.found is not None}
            if found is not None and not found.exact and found.caption in others:
                found = None  # a king is no throne
            once = replace(thing, count=1) if found is not None and found.several else thing
            things[number] = None if number in had and found is None else SceneThing(once, found)
    return _without_groups(things, relations, reading, settled)


@dataclass(frozen=True)
class _Caster:
    """Finder of pictures for the things of one prompt."""

    prompt: str
    index: PictureIndex
    encoders: EncoderRegistry
    seed: int

    def single(self, thing: Thing, *, among: bool, is_part: bool, leads: bool) -> FoundPicture | None:
        """Returns the picture of a single thing, None if there is none. For a person, somebody else may stand.

        among: True if it is among others, or in a place
        leads: True if a picture with a ground may determine the whole scene
        """
        least = _PART if is_part else 0.0
        acts = bool(thing.doing or among)
        found = self._find(thing, least=least, cut_out=among, acts=acts)
        is_whole = found is not None and (not acts or found.library.is_own or is_upright(found.picture))
        if not is_whole and not is_part and is_person(thing.name, word_meanings(self.encoders)):
            return self._somebody(thing, among=among, least=0.0 if found is None else _FIGURE) or found
        if not among or not leads or (found is not None and found.library.is_own):
            return found
        enough = found.similarity + _BETTER if found is not None and found.exact else -1.0
        if self.index.nearest(thing) <= enough:  # no other picture can be better
            return found
        whole = self._find(thing, least=least, acts=acts)
        return whole if whole is not None and whole.exact and whole.similarity > enough else found

    def _somebody(self, thing: Thing, *, among: bool, least: float) -> FoundPicture | None:
        """Returns a figure for a person without a picture from head to foot; of several, the nearest in meaning.

        least: similarity of the figure and the person
        """
        meanings = word_meanings(self.encoders).embed([thing.noun, *_FIGURES])
        similar = dict(zip(_FIGURES, (meanings[1:] @ meanings[0]).tolist(), strict=True))
        names = sorted((name for name in _FIGURES if similar[name] >= least), key=lambda name: -similar[name])
        shown = [self._find(replace(thing, name=name, noun=name, plural="", count=1), cut_out=among, acts=True)
                 for name in names[: thing.shown]]  # fmt: skip
        figures = [one for one in shown if one is not None]
        if not figures:
            return None
        return replace(figures[0], exact=False, others=tuple(one.picture for one in figures[1:]))

    def whole(self, first: Thing, word: str, second: Thing) -> FoundPicture | None:
        """Returns a picture of two things. For a measure such as "a cup of coffee", one of the second will do."""
        measured = word == "of" and second.uncounted
        is_figure = is_person(first.noun, word_meanings(self.encoders))
        # A cup of coffee is a measure, with any adjective of the cup; and a bearded person is an old man with a beard.
        subject = first.noun if measured or is_figure else first.name
        called = " ".join(f"{subject} {word} {second.color} {second.name}".split())
        least = _HELD if word == "of" else _WHOLE
        shows = (second.noun,) if is_figure else (first.noun, second.noun)
        found = self._find(Thing(called, called), least=least, shows=shows)
        has_own = self.index.has_own(first)
        if found is not None and not found.library.is_own:
            is_colored = measured or set(second.color.split()) <= set(found.caption.split())
            if has_own or self.index.has_own(second) or not is_colored or is_colorless(found.picture):
                found = None  # each by itself may be found in colour
        if found is None and measured and not has_own:
            return self._find(second, least=NAMED_ALONE, cut_out=True)
        return found

    def _find(
        self, thing: Thing, *, least: float = 0.0, shows: Sequence[str] = (), cut_out: bool = False, acts: bool = False
    ) -> FoundPicture | None:
        seen = looks(thing.name, self.encoders, self.seed)
        return self.index.find(thing, self.prompt, seen, least=least, shows=shows, cut_out=cut_out, acts=acts)


def _without_groups(
    things: list[SceneThing | None], relations: list[Relation], reading: Reading, settled: set[int]
) -> tuple[list[SceneThing | None], list[Relation]]:
    """Replaces groups without a picture by their members: a flock of birds becomes birds. A place holds many."""
    for relation in [one for one in reading.relations if one.word == "of"]:
        group, member = things[relation.subject], things[relation.object]
        if relation in relations and group is not None and (group.found is None or not group.found.exact):
            things[relation.subject] = None
            relations = [
                replace(one, subject=relation.object) if one.subject == relation.subject else one
                for one in relations
                if one != relation
            ]
        if relation.subject in settled and member is not None and member.thing.count is None:
            things[relation.object] = replace(member, thing=replace(member.thing, count=_IN_A_FIELD))
    return things, relations


def looks(name: str, encoders: EncoderRegistry, seed: int) -> Callable[[Tensor], float]:
    """Returns a function from a picture to its distance from a named thing, as the text objective's networks see it."""
    words = Text(name, encoders.readers(), seed)

    @torch.no_grad()
    def distance(picture: Tensor) -> float:
        return float(words.glance(picture))

    return distance


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
    sentences = word_meanings(encoders)
    account = Account(reading)
    setting, settled, seen = _setting(reading, index, encoders)
    if len(settled) == len(reading.things) and setting.place is not NOWHERE:
        reading = _people_place(reading, setting, sentences)
    things, relations = cast(reading, settled, prompt, index, encoders, seed, in_place=setting.place is not NOWHERE)
    shown = [one for one in things if one is not None and one.found is not None]
    whole = next((one for one in shown if _fills_the_canvas(one, shown)), None)
    if whole is not None and whole.found is not None:
        in_light = [one for one in seen if not isinstance(one[2], Place)]
        _account_for([whole], reading, in_light, account)
        _tell(reading, [whole], replace(setting, is_named=False), encoders, use, index, account)
        if len(shown) > 1:
            encoders.remark("The picture has a ground of its own and fills the canvas; nothing else is added.")
        picture = whole.colored[:3]
        return compose_photograph(picture, saliency(picture), setting, grid, seed)
    if not shown and setting.place is NOWHERE:
        near = rank_lights(prompt, sentences)
        first = near[0] if setting.light == DAY else setting.light
        second = setting.second or next(light for light in near if light.name not in first.name)
        _account_for(things, reading, seen, account)
        _tell(reading, things, replace(setting, light=first, is_named=True), encoders, use, index, account)
        return compose_mood(first, second, setting, grid, seed)
    if setting.place is NOWHERE:
        setting = replace(setting, place=_place_of(things, relations, setting, sentences))
    _account_for(things, reading, [one for one in seen if one[2] is not setting.second], account)
    things = _dress(things, relations, sentences)
    among = len(shown) > 1 or setting.is_named
    pasted = [
        one for one in shown if among and one.found and one.found.library.is_own and has_ground(one.found.picture)
    ]
    is_flown = any(relation.word == "flying" for relation in reading.relations)  # a kite of somebody on the ground
    parts: list[ScenePart | None] = []
    for number, one in enumerate(things):
        if one is None or one.found is None:
            parts.append(None)
            continue
        known = known_like(one.thing.name, sentences)
        if one.thing.doing == "flying" and not is_flown:
            known = known._replace(where="air")
        between = any(relation.object == number and relation.word == "between" for relation in relations)
        pictures = [fade_edges(one.colored)] if any(one is each for each in pasted) else one.each
        parts.append(ScenePart(copies(pictures, one.thing.shown, known.where, seed + number, apart=between), known))
    known_parts = [part.known for part in parts if part is not None]
    over = {one.subject for one in reading.relations if kind_of(one.word) == "over" and one.object in settled}
    in_the_air = bool(known_parts) and (all(part.where == "air" for part in known_parts) or _subjects(things, over))
    scene = compose_scene(arrange_parts(parts, relations), setting, grid, seed, in_the_air=in_the_air)
    _tell(reading, things, setting, encoders, use, index, account)
    for one in pasted:
        encoders.remark(
            f"Your picture of {one.thing.label!r} has a ground of its own, whose edges fade; as a PNG without "
            "its ground it would stand free."
        )
    return scene


def _place_of(
    things: Sequence[SceneThing | None], relations: Sequence[Relation], setting: Setting, sentences: SentenceEncoder
) -> Place:
    """Returns the usual place of things without a named one, by their meaning, else by their kind and size."""
    shown = [one for one in things if one is not None and one.found is not None]
    carried = {id(things[one.subject]) for one in relations if kind_of(one.word) in ("on", "in")}
    standing = [one for one in shown if id(one) not in carried] or shown
    names = [name for one in standing for name in (one.thing.name, one.found.caption if one.found else "")]
    place = infer_place(names, sentences, _IMPLIED, outside=setting.weather != CLEAR or setting.light != DAY)
    if place is not NOWHERE:
        return place
    known = [known_like(one.thing.name, sentences) for one in standing]
    kinds = {one.where for one in known}
    if kinds <= {"air", "water"}:
        return SKY if "air" in kinds else LAKE
    if setting.weather != CLEAR or setting.light != DAY:
        return MEADOW
    return TABLE if max(one.height for one in known) < _SMALL else ROOM


def _fills_the_canvas(one: SceneThing, shown: list[SceneThing]) -> bool:
    """Returns True if a picture with a ground fills the canvas; the user's own only if it is the only one."""
    if one.found is None or not has_ground(one.found.picture):
        return False
    return not one.found.library.is_own or (len(shown) == 1 and one.thing.shown == 1)


def _dress(
    things: list[SceneThing | None], relations: list[Relation], sentences: SentenceEncoder
) -> list[SceneThing | None]:
    """Merges clothes into their wearers, who take the colour of the clothes."""
    dressed = list(things)
    for relation in relations:
        wearer, worn = dressed[relation.subject], dressed[relation.object]
        if relation.word in ("in", "with", "wearing") and wearer is not None and worn is not None:
            if known_like(worn.thing.name, sentences).where != "worn":
                continue
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
    thing = Thing(name, name.rpartition(" ")[2], count=_TREES if setting.place is FOREST else 2)
    return replace(reading, things=(*reading.things, thing), relations=(*reading.relations, Relation(number, "in", 0)))


def _subjects(things: list[SceneThing | None], over: set[int]) -> bool:
    """Returns True if all visible things are over a place."""
    shown = {number for number, one in enumerate(things) if one is not None and one.found is not None}
    return bool(shown) and shown <= over


_Seen = list[tuple[Thing, str, Place | Light | Weather]]


def _setting(
    reading: Reading, index: PictureIndex | None, encoders: EncoderRegistry
) -> tuple[Setting, set[int], _Seen]:
    """Returns the setting that the words name, the numbers of the things that are only part of it, and its words.

    Each of its words comes with the thing that it belongs to and the part of the setting that it means.
    """
    sentences, settled = word_meanings(encoders), set[int]()
    seen: _Seen = []
    for number, thing in enumerate(reading.things):
        nearest = 0.0 if index is None else index.nearest(thing)
        if index is None or not index.has_own(thing):
            people = [one.name for one in known_things() if one.where == "person"]
            others = [one.name for one in known_things() if one.where != "person"]
            mood = find_mood(thing.noun, people, others, sentences, is_pictured=nearest >= NAMED_ALONE)
            weather = find_part(thing.noun, WEATHERS, sentences)
            if mood is not None or weather is not None:
                settled.add(number)
                seen.append((thing, thing.noun, weather or find_part(thing.noun, LIGHTS, sentences) or mood or DAY))
        if number not in settled and (place := _place_named(number, reading, nearest, sentences)) is not None:
            settled.add(number)
            paint = paint_of(thing.color)
            seen.append((thing, thing.noun, place if paint is None else in_color(place, paint)))
        for word in thing.name.split()[:-1]:
            felt = find_part(word, WEATHERS, sentences, _SURE) or find_part(word, LIGHTS, sentences, _FELT)
            if felt is not None:
                seen.append((thing, word, felt))
    places = [part for *_, part in seen if isinstance(part, Place)]
    weathers = [part for *_, part in seen if isinstance(part, Weather)]
    times = [part for *_, part in seen if isinstance(part, Light) and part in TIMES]
    moods = [part for *_, part in seen if isinstance(part, Light) and part not in TIMES]
    weather = weathers[0] if weathers else CLEAR
    lights = [*times[:1], *([weather.light] if weathers else []), *dict.fromkeys(moods)] or [DAY]
    light = mix_lights(times[0], moods[0]) if times and moods else lights[0]
    second = next((one for one in lights if one.name not in light.name), None)
    open_places = [place for place in places if place is not SKY] or places
    place = open_places[0] if open_places else NOWHERE
    used = {place.name, SKY.name if place.is_open else "", weather.name, *light.name.split(", ")}
    used |= {second.name} if second is not None and place is NOWHERE else set()
    setting = Setting(place, light, weather, second, is_named=bool(seen))
    return setting, settled, [one for one in seen if one[2].name in used]


def _place_named(number: int, reading: Reading, nearest: float, sentences: SentenceEncoder) -> Place | None:
    """Returns the place that a thing of the prompt is, or None if it is a thing.

    nearest: similarity of the nearest picture: a thing with a picture of its own stays a thing, a tree is no forest
    """
    thing = reading.things[number]
    kinds = {kind_of(one.word) for one in reading.relations if one.object == number}
    beside = kinds & set(_BY_THINGS)
    if beside == {"under"} and find_part(thing.noun, PLACES, sentences) is SKY:
        return SKY
    if beside and not beside <= {"behind", "front"}:  # a forest or mountains are a background
        return None
    least = max(nearest - _ROUNDING, NAMED_ALONE if beside else 0.0)
    place = find_part(thing.noun, PLACES, sentences, least)
    if place is None and thing.count is None and thing.plural and number:  # mountains, but not a single mountain
        place = find_part(thing.plural, PLACES, sentences, least)
    if place is None and "on" in kinds:
        # A table that carries things is shown by its top.
        top = find_part(thing.noun, PLACES, sentences)
        place = top if top is not None and not top.is_open else None
    if place is None and thing.name != thing.noun:
        place = find_part(thing.name, PLACES, sentences, max(least, _SURE))
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
    whole = [one for one in things if one is not None and one.found is not None]
    for one in whole:
        assert one.found is not None
        inside = [reading.things[each.object] for each in reading.relations if each.word == "of"
                  and reading.things[each.subject].at == one.thing.at]  # fmt: skip
        # The lemon of "the taste of lemon" is no taste.
        is_of = any(_says_all(one.found.caption, each, reading) for each in inside)
        exact = one.found.exact and (not is_of or _says_all(one.found.caption, one.thing, reading))
        account.mark_picture(one.thing, one.found.caption, exact=exact, several=one.found.several)
    for relation in reading.relations:
        first, second = reading.things[relation.subject], reading.things[relation.object]
        for one in whole:  # one picture may show both and their relation
            if one.found is not None and one.thing.at == first.at and _says_all(one.found.caption, second, reading):
                account.mark_picture(second, one.found.caption, exact=True, several=False)
                account.mark(relation.at, Mark.SHOWN, one.found.caption)
        if account.shows(first.at) and account.shows(second.at):
            is_placed = kind_of(relation.word) not in ("", "hands")
            settles = any(second is thing or first is thing for thing, _, _ in seen)
            account.mark(relation.at, Mark.SHOWN if is_placed or settles else Mark.SIMILAR, "side by side")


def _says_all(caption: str, thing: Thing, reading: Reading) -> bool:
    """Returns True if a caption names a thing by its noun."""
    return any(word.at in thing.at and word.lemma == thing.noun.lower() and word.says(caption) for word in reading.said)


def _tell(
    reading: Reading,
    things: list[SceneThing | None],
    setting: Setting,
    encoders: EncoderRegistry,
    use: str,
    index: PictureIndex | None,
    account: Account,
) -> None:
    """Makes remarks about the scene's pictures, their authors, and what is not shown."""
    shown = [one for one in things if one is not None and one.found is not None]
    credits = dict.fromkeys(one.found.library.credit for one in shown if one.found and one.found.library.credit)
    made = f"; pictures by {'; '.join(credits)}" if credits else ""
    told = " and ".join(one.told for one in shown)
    place = f", on {setting.words}" if setting.is_named else ""
    if not told:
        told, place = f"strokes and colours of {setting.words}, without a picture of a thing", ""
    encoders.remark(f"{use.capitalize()} {told}{place}{made}.")
    encoders.remark(account.told)
    if any(line.mark is Mark.NOT_SHOWN and line.word.kind == "thing" for line in account.lines):
        encoders.remark("What is not shown needs a picture: give one with --image, or a folder with --pictures.")
    for fault in dict.fromkeys(() if index is None else index.faults):
        encoders.remark(f"Of your own pictures one cannot be used: {fault}")


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
    words, weight = max(said, key=lambda pair: pair[1]) if said else ("", 0.0)
    if goal.initial:
        first = [term.words for term in goal.initial if term.words is not None]
        styles = [term.colors for term in goal.initial if term.colors is not None]
        if any(term.picture is not None for term in goal.initial):
            return goal
        if styles:
            return _start_with_style(goal, styles[0], words, weight, grid, encoders, seed) if words else goal
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
    goal: Goal, style: Tensor, words: str, weight: float, grid: PixelGrid, encoders: EncoderRegistry, seed: int
) -> Goal:
    """Returns the goal that begins with the style picture, with the thing of the words in it, and keeps to it."""
    thing, reading = thing_of(words, encoders, seed), prompt_reader(encoders).read(words)
    account = Account(reading)
    _account_for([thing], reading, [], account)
    if thing is None:
        encoders.remark(f"No picture was found for {words[:60]!r}; begun with the style picture alone.")
        encoders.remark(account.told)
        return goal
    scene = images.fit(style, grid.rows, grid.columns)
    shown = composite_into_style(thing.colored, scene, keeps_colors=bool(thing.thing.color))
    matters = 1 + (_MATTERS - 1) * shown.where
    kept = ImageTerm(shown.picture, _STAGED * weight, matters / matters.mean())
    encoders.remark(f"Begun with {thing.told}, laid into the style picture{thing.credit}.")
    encoders.remark(account.told)
    return Goal((*goal.terms, kept), (replace(kept, weight=1.0),))
