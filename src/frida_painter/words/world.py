"""Knowledge of the world: sizes and usual places of things, and who is a person, from things of similar meaning."""

from functools import cache

import torch

from frida_painter.drawing.arrangement import Known
from frida_painter.drawing.figures import wardrobe
from frida_painter.drawing.tables import read_lines
from frida_painter.objectives.encoders.sentence import SentenceEncoder
from frida_painter.words.nouns import kinds_of

_NEIGHBOURS = 3
_SHARPNESS = 0.05  # difference of similarity at which a neighbour's weight falls to 1/e


@cache
def known_things() -> tuple[Known, ...]:
    """Returns the table of `world.txt`."""
    rows = [line.rsplit(" ", 2) for line in read_lines("words/world.txt")]
    return tuple(Known(name, float(height), where) for name, height, where in rows)


def known_like(name: str, sentences: SentenceEncoder) -> Known:
    """Returns an estimate for a named thing, from the known things of most similar meaning.

    The height is a weighted mean of theirs; the usual place is that of the most similar one. A person is like people,
    and a thing like things. A compound is not what it begins with: a horseshoe is no horse.
    """
    kinds, things = kinds_of(name), known_things()
    if "person" not in kinds or kinds == {"person"}:
        things = tuple(thing for thing in things if (thing.where == "person") == ("person" in kinds))
    things = tuple(thing for thing in things if name == thing.name or not name.startswith(thing.name))
    meanings = sentences.embed([name, *(thing.name for thing in things)])
    similarity, nearest = (meanings[1:] @ meanings[0]).topk(_NEIGHBOURS)
    share = (similarity / _SHARPNESS).softmax(0)
    heights = torch.tensor([things[at].height for at in nearest.tolist()])
    return Known(name, float((share * heights.log()).sum().exp()), things[int(nearest[0])].where)


_PERSON = 0.48  # least similarity of a word with other senses to a word for a person


def is_person(name: str, sentences: SentenceEncoder) -> bool:
    """Returns True if a name means a person.

    If its noun has other senses too, it means one if the noun after other words is a known person, or if it is rather
    near to the people among the known things or to those who have clothes of their own, and nearer than to any other
    known thing: a conductor, but no fox and no reed.
    """
    kinds = kinds_of(name)
    if "person" not in kinds or kinds == {"person"}:
        return "person" in kinds or any(name == word for clothes in wardrobe() for word in clothes.words)  # a gamer
    known = {one.name: one.where for one in known_things()}
    known |= {word: "person" for clothes in wardrobe() for word in clothes.words}
    _, *rest = name.split()
    if rest and known.get(rest[-1]) == "person":  # a sleeping baby
        return True
    similarity, nearest = (sentences.embed([*known]) @ sentences.embed([name])[0]).max(0)
    where = [*known.values()][int(nearest)]
    is_bodied = where == "body" and bool(rest) and is_person(rest[-1], sentences)  # a bearded man
    return float(similarity) >= _PERSON and (where == "person" or is_bodied)


def is_part_of_body(noun: str, sentences: SentenceEncoder) -> bool:
    """Returns True if a noun means a part of a body, such as a beard."""
    return "body" in kinds_of(noun) and known_like(noun, sentences).where == "body"
