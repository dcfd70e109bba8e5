"""Nouns: their kinds, which are people, ideas, parts of the body and things, their senses, and names (WordNet 3.1)."""

from __future__ import annotations

from collections import defaultdict
from functools import cache
from typing import NamedTuple

from frida_painter.drawing.tables import read_lines


class Sense(NamedTuple):
    """Sense of a noun.

    words: all nouns with that sense
    above: the sense that it is a kind of, or None
    """

    words: tuple[str, ...]
    above: Sense | None

    @property
    def kinds(self) -> tuple[Sense, ...]:
        """The senses that this is a kind of, the nearest first."""
        return () if self.above is None else (self.above, *self.above.kinds)

    def is_kind_of(self, other: Sense) -> bool:
        """Returns True if this is the other sense, or a kind of it."""
        return other in (self, *self.kinds)


@cache
def _kinds() -> dict[str, frozenset[str]]:
    rows = [line.partition(": ") for line in read_lines("words/nouns.txt")]
    return {noun: frozenset(kinds.split()) for kinds, _, nouns in rows for noun in nouns.split()}


@cache
def _senses() -> dict[str, list[Sense]]:
    known, path = defaultdict[str, list[Sense]](list), list[Sense]()
    for line in read_lines("words/senses.txt"):
        depth, _, words = line.partition(" ")
        del path[int(depth) :]
        path.append(Sense(tuple(words.split(", ")), path[-1] if path else None))
        for word in path[-1].words:
            known[word].append(path[-1])
    return dict(known)


@cache
def _names() -> dict[str, str]:
    rows = [line.partition(": ") for line in read_lines("words/names.txt")]
    return {name: kind for kind, _, names in rows for name in names.split(", ")}


def kind_of_name(name: str) -> str:
    """Returns the kind of a place with a name of its own, such as "river"; "" for other names."""
    return _names().get(name.lower(), "")


def _singular(noun: str) -> str:
    return f"{noun[:-2]}an" if noun.endswith("men") else noun.removesuffix("s")


def kinds_of(name: str) -> frozenset[str]:
    """Returns what the last word of a name may mean: "person", "idea", "body" and "thing", one or several of them."""
    noun, known = name.lower().rpartition(" ")[2], _kinds()
    return known.get(noun) or known.get(_singular(noun)) or frozenset({"thing"})


def noun_of(name: str) -> str:
    """Returns the last two words of a name if they have senses, or else the last one, in the singular."""
    words, known = name.lower().split(), _senses()
    tried = [" ".join(words[-2:]), "".join(words[-2:]), *words[-1:]]  # a pine cone is a pinecone
    return next((form for noun in tried for form in (noun, _singular(noun)) if form in known), "")


def senses_of(name: str) -> list[Sense]:
    """Returns the senses of the noun of a name, for things that can be touched."""
    return _senses().get(noun_of(name), [])
