"""Words for people whom no picture shows as such: a couple is a woman and a man, children are a girl and a boy."""

from collections.abc import Callable
from dataclasses import replace

from frida_painter.objectives.scenes.reading import MOST_THINGS, Reading, Relation, Thing

_SHOWN_BY = {
    "couple": ("woman", "man"), "people": ("woman", "man"), "person": ("woman", "man"), "human": ("woman", "man"),
    "lover": ("woman", "man"), "friend": ("girl", "boy"), "child": ("girl", "boy"), "kid": ("girl", "boy"),
    "mother": ("woman",), "father": ("man",), "lady": ("woman",), "gentleman": ("man",), "guy": ("man",),
    "teenager": ("girl", "boy"),
}  # fmt: skip
_ALWAYS_TWO = "couple"


def with_figures(reading: Reading, has_own: Callable[[Thing], bool]) -> Reading:
    """The reading, where people who do something, or are somewhere, are such as pictures from head to foot show.

    Somebody alone, of whom nothing more is said, stays: that is a portrait. has_own: whether a person's own pictures
    show somebody; who is shown by them stays too.
    """
    things, relations = list(reading.things), list(reading.relations)
    for number, thing in enumerate(reading.things):
        who = _SHOWN_BY.get(thing.noun)
        adjective = thing.name.removesuffix(thing.noun).strip()
        if who is None or not (reading.relations or thing.doing or adjective or thing.noun == _ALWAYS_TWO):
            continue
        if has_own(thing):
            continue
        several = thing.shown > 1 or thing.noun == _ALWAYS_TWO
        count = 2 if thing.noun == _ALWAYS_TWO else thing.shown
        figures = [replace(thing, name=f"{adjective} {noun}".strip(), noun=noun, plural="", count=1) for noun in who]
        if not several or len(figures) == 1:
            things[number] = replace(figures[0], count=thing.count)
        elif len(things) < MOST_THINGS:
            things[number] = replace(figures[0], count=count - count // 2)
            relations.append(Relation(len(things), "beside", number))
            things.append(replace(figures[1], count=count // 2))
    return replace(reading, things=tuple(things), relations=tuple(relations))
