"""Which picture shows which thing of a prompt, alone or together with others."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from frida_painter.objectives.encoders.registry import EncoderRegistry
from frida_painter.objectives.recoloring import is_colored, recolored
from frida_painter.objectives.scenes.appearance import is_colorless
from frida_painter.objectives.scenes.reading import Reading, Relation, Thing, paint_of
from frida_painter.objectives.scenes.retrieval import FoundPicture, PictureIndex
from frida_painter.objectives.scenes.world import is_person
from frida_painter.objectives.text import Text

_WHOLE = 0.80  # similarity of a caption to two things and what is between them, from which it shows both
_PART = 0.75  # the same for what a thing has
_HELD = 0.72  # the same for "a bowl of cherries"
_BETTER = 0.08  # of similarity, by which a picture with a ground says more exactly what the thing is
NAMED_ALONE = 0.9  # the same for coffee, where there is no cup of coffee
_TITLE = 60  # characters of a caption in a remark


@dataclass(frozen=True)
class SceneThing:
    """A thing of a scene, and its picture, if one was found."""

    thing: Thing
    found: FoundPicture | None

    @property
    def colored(self) -> Tensor:
        """The picture that was found, in the colour that the words name, unless it has it."""
        assert self.found is not None
        return self._in_color(self.found.picture)

    @property
    def each(self) -> list[Tensor]:
        """That picture, and further ones of the same where several are wanted."""
        assert self.found is not None
        return [self.colored, *map(self._in_color, self.found.others)]

    def _in_color(self, picture: Tensor) -> Tensor:
        assert self.found is not None
        color, paint = self.thing.color, paint_of(self.thing.color)
        named = set(color.split()) <= set(self.found.caption.split())
        if paint is None or " and " in color or named or is_colored(picture, paint):
            return picture
        return recolored(picture, paint)

    @property
    def told(self) -> str:
        """The picture that was found, for a person."""
        assert self.found is not None
        times = f", {self.thing.shown} times" if self.thing.shown > 1 else ""
        stands = "" if self.found.exact else f" for {self.thing.label!r}"
        return f"{self.found.caption[:_TITLE]!r} ({self.found.library.name}{times}){stands}"

    @property
    def credit(self) -> str:
        """Who made the picture, for the end of a sentence."""
        assert self.found is not None
        return f"; picture by {self.found.library.credit}" if self.found.library.credit else ""


def thing_of(prompt: str, encoders: EncoderRegistry, seed: int) -> SceneThing | None:
    """The first thing of a prompt that has a picture; None where none has."""
    index = encoders.picture_index()
    if index is None:
        return None
    for thing in encoders.prompts().read(prompt).things:
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
    """A picture for each thing; where one shows two things and what is between them, it is the first one's.

    in_place: whether they are somewhere that is painted too, so that pictures without a ground are wanted.
    """
    if index is None:
        return [SceneThing(thing, None) for thing in reading.things], []
    relations = [one for one in reading.relations if one.subject not in settled and one.object not in settled]
    caster = _Caster(reading, prompt, index, encoders, seed)
    things, relations, merged = caster.wholes(relations)
    had = {one.object for one in relations if one.word == "with"}  # parts, such as a roof, belong to their whole
    leading = next((number for number in range(len(things)) if number not in settled), None)
    for number, thing in enumerate(reading.things):
        if number not in settled and number not in merged:
            among = bool(relations) or in_place or thing.shown > 1
            found = caster.found(thing, among=among, is_part=number in had, leads=number == leading)
            if found is not None and not found.exact and found.caption in _captions(things):
                found = None  # a king is no throne
            once = replace(thing, count=1) if found is not None and found.several else thing
            things[number] = None if number in had and found is None else SceneThing(once, found)
    return _without_groups(things, relations, reading, settled)


class _Caster:
    """Looks for pictures of the things of one prompt."""

    def __init__(
        self, reading: Reading, prompt: str, index: PictureIndex, encoders: EncoderRegistry, seed: int
    ) -> None:
        self._reading, self._prompt, self._index = reading, prompt, index
        self._encoders, self._seed = encoders, seed

    def found(self, thing: Thing, *, among: bool, is_part: bool, leads: bool) -> FoundPicture | None:
        """The picture of a thing by itself. among: others, or in a place; leads: whether all may be about it."""
        looks, least = self._looks(thing.name), _PART if is_part else 0.0
        upright = bool(thing.doing or among) and is_person(thing.name, self._encoders.sentences())
        found = self._index.find(thing, self._prompt, looks, least=least, cut_out=among, upright=upright)
        if not among or not leads or (found is not None and found.library.is_own):
            return found
        enough = found.similarity + _BETTER if found is not None and found.exact else -1.0
        if self._index.nearest(thing) <= enough:  # no other one can be better
            return found
        whole = self._index.find(thing, self._prompt, looks, least=least, upright=upright)
        return whole if whole is not None and whole.exact and whole.similarity > enough else found

    def wholes(self, relations: list[Relation]) -> tuple[list[SceneThing | None], list[Relation], set[int]]:
        """Pictures that show two things and what is between them, each as the first one's.

        Also the relations that are left, and the numbers of all things that have a picture then.
        """
        things: list[SceneThing | None] = [None] * len(self._reading.things)
        merged = set[int]()
        for relation in list(relations):
            if relation.subject in merged or relation.object in merged:
                continue
            whole = self._whole(relation)
            if whole is not None:
                things[relation.subject] = SceneThing(self._reading.things[relation.subject], whole)
                merged |= {relation.subject, relation.object}
                relations = [one for one in relations if not {one.subject, one.object} & {relation.object}]
        return things, relations, merged

    def _whole(self, relation: Relation) -> FoundPicture | None:
        """A picture of both; of what is only measured, the picture of that."""
        first, second = self._reading.things[relation.subject], self._reading.things[relation.object]
        measured = relation.word == "of" and second.uncounted
        # Of coffee a cup is the measure, whatever is said of the cup.
        called = f"{first.noun if measured else first.name} {relation.word} {second.color} {second.name}"
        called = called.replace("  ", " ")
        least = _HELD if relation.word == "of" else _WHOLE
        nouns = first.noun, second.noun
        whole = self._index.find(Thing(called, called), self._prompt, self._looks(called), least=least, shows=nouns)
        has_own = self._index.has_own
        if whole is not None and not whole.library.is_own and (has_own(first) or has_own(second)):
            whole = None
        if whole is not None and not whole.library.is_own and is_colorless(whole.picture):
            whole = None  # each by itself may be found in colour
        if whole is not None and not set(second.color.split()) <= set(whole.caption.split()) and not measured:
            whole = None
        if whole is None and measured and not has_own(first):
            looks = self._looks(second.name)
            whole = self._index.find(second, self._prompt, looks, least=NAMED_ALONE, cut_out=True)
        return whole

    def _looks(self, name: str) -> Callable[[Tensor], float]:
        return looks(name, self._encoders, self._seed)


def _captions(things: list[SceneThing | None]) -> set[str]:
    """What the pictures that were found so far are called."""
    return {one.found.caption for one in things if one is not None and one.found is not None}


def _without_groups(
    things: list[SceneThing | None], relations: list[Relation], reading: Reading, settled: set[int]
) -> tuple[list[SceneThing | None], list[Relation]]:
    """The things, where a group that has no picture is what it is made of: a flock of birds is birds."""
    things = list(things)
    for relation in [one for one in relations if one.word == "of"]:
        group = things[relation.subject]
        if group is not None and (group.found is None or not group.found.exact):
            things[relation.subject] = None
            relations = [one for one in relations if one != relation]
            relations = [
                replace(one, subject=relation.object) if one.subject == relation.subject else one for one in relations
            ]
    for relation in reading.relations:
        group = things[relation.object]
        if relation.word == "of" and relation.subject in settled and group is not None and group.thing.count is None:
            things[relation.object] = replace(group, thing=replace(group.thing, count=7))
    return things, relations


def looks(name: str, encoders: EncoderRegistry, seed: int) -> Callable[[Tensor], float]:
    """How far pictures look from a thing, to the networks that the painting is seen through."""
    words = Text(name, encoders.readers(), seed)

    @torch.no_grad()
    def distance(picture: Tensor) -> float:
        return float(words.glance(picture))

    return distance
