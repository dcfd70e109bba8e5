"""Kinds of nouns: people, ideas, parts of the body, and things, by their senses in WordNet 3.1 (Miller 1995)."""

from functools import cache
from importlib import resources


@cache
def _kinds() -> dict[str, frozenset[str]]:
    lines = (resources.files(__package__) / "nouns.txt").read_text("utf-8").splitlines()
    rows = [line.partition(": ") for line in lines if not line.startswith("#")]
    return {noun: frozenset(kinds.split()) for kinds, _, nouns in rows for noun in nouns.split()}


def kinds_of(name: str) -> frozenset[str]:
    """Returns what the last word of a name may mean: "person", "idea", "body" and "thing", one or several of them."""
    noun, known = name.lower().rpartition(" ")[2], _kinds()
    single = f"{noun[:-2]}an" if noun.endswith("men") else noun.removesuffix("s")
    return known.get(noun) or known.get(single) or frozenset({"thing"})
