"""The account of 200 sentences: 160 by a grammar whose words no library chose, and 40 odd ones (`odd.txt`).

A line of `odd.txt` says: sentence = words that the account must have.
"""

import random
import re
from collections.abc import Sequence
from pathlib import Path

import pytest
import torch
from torch import Tensor

from downloads import fetched
from frida_painter.frames import PixelGrid
from frida_painter.objectives.picture_library import Captioned
from frida_painter.words.account import Account, Mark
from frida_painter.words.nouns import kinds_of
from frida_painter.words.reading import PromptReader, Reading, SaidWord, Thing
from frida_painter.words.retrieval import PictureIndex
from frida_painter.words.scene import scene_of
from support.networks import QuickEncoders, WordBag
from support.planning import CANVAS

GRID = PixelGrid.of_height(CANVAS, 24)
ODD = (Path(__file__).parent / "odd.txt").read_text("utf-8").splitlines()

_NOUNS = [
    "kitten",
    "city",
    "wall",
    "baker",
    "anvil",
    "wombat",
    "zeppelin",
    "loom",
    "quarry",
    "apple",
    "lantern",
    "orchard",
    "stairway",
    "beggar",
    "mill",
    "tugboat",
    "violinist",
    "chimney",
    "scarecrow",
    "ferry",
    "hammock",
    "stork",
    "canal",
    "cellar",
    "donkey",
    "goat",
    "tree",
    "boat",
    "mirror",
    "glacier",
    "tunnel",
    "tailor",
    "puddle",
    "sofa",
    "kettle",
    "monk",
    "herring",
    "balcony",
    "rope",
    "harvest",
    "sorrow",
    "silence",
    "thunder",
    "noon",
    "childhood",
]
_ADJECTIVES = [
    "rusty",
    "mossy",
    "crooked",
    "solemn",
    "enormous",
    "wooden",
    "pale",
    "frozen",
    "empty",
    "gilded",
    "noisy",
    "sleepy",
    "ragged",
    "blue",
    "red",
]
_BETWEEN = ["in", "on", "under", "behind", "beside", "near", "above", "in front of", "next to", "against", "through"]
_DOING = ["climbing", "holding", "watching", "carrying", "mending", "chasing"]
_NUMBERS = ["two", "three", "seven", "eleven"]
HERE = ("goat", "tree", "boat", "kettle", "old sofa", "blue apple")  # captions


class Pictures:
    name, credit, is_own = "pictures", "", False

    def list_captioned(self) -> Sequence[Captioned]:
        return [Captioned(said, (said,), 0.8) for said in HERE]

    def pictures(self, file: str) -> list[Tensor]:
        picture = torch.rand(4, 30, 45, generator=torch.Generator().manual_seed(1))
        picture[3], picture[3, :10, :20] = 1, 0
        return [picture]


def plural(noun: str) -> str:
    return {"city": "cities", "ferry": "ferries", "balcony": "balconies", "kettle": "kettles"}.get(
        noun, f"{noun}es" if noun.endswith(("s", "sh", "ch")) else f"{noun}s"
    )


def make_sentence(chance: random.Random) -> tuple[str, list[str]]:
    """A sentence, and its nouns, adjectives, numbers, verbs and prepositions in their order."""
    said: list[str] = []

    def thing() -> str:
        noun, words = chance.choice(_NOUNS), []
        counted = chance.random() < 0.2 and noun not in ("sorrow", "silence", "thunder", "noon", "childhood")
        if counted:
            words.append(chance.choice(_NUMBERS))
        if chance.random() < 0.5:
            words.append(chance.choice(_ADJECTIVES))
        words.append(plural(noun) if counted else noun)
        said.extend(words)
        article = "" if counted else "an " if words[0][0] in "aeiou" else "a "
        return f"{article}{' '.join(words)}"

    def between() -> str:
        words = chance.choice([*_BETWEEN, *_DOING])
        said.extend(words.split())
        return words

    parts = [thing()]
    for _ in range(chance.choice((0, 1, 1, 2))):
        parts += [between(), thing()]
    if chance.random() < 0.2:
        parts += ["and", thing()]
    return " ".join(parts), said


@pytest.fixture(scope="module")
def reader() -> PromptReader:
    return PromptReader(fetched("english"))


def account_of(prompt: str, reader: PromptReader, folder: Path) -> str:
    """The account as a person reads it."""
    quick = QuickEncoders()
    quick.own["picture index"], quick.own["prompt reader"] = PictureIndex([Pictures()], WordBag(), folder), reader
    scene_of(prompt, GRID, quick, 0)
    (told,) = [remark for remark in quick.remarks if remark.startswith("Your words: ")]
    return told.removeprefix("Your words: ").removesuffix(".")


def words_of(told: str) -> dict[str, list[str]]:
    """The words under each heading of an account."""
    found: dict[str, list[str]] = {}
    for part in told.split("; "):
        name, _, phrases = part.partition(": ")
        plain = re.sub(r" \(by [^)]*\)", "", phrases)
        quoted = re.findall(r"""'((?:[^']|'(?=s\b))*)'|"([^"]*)\"""", plain)
        found[name] = [word.lower() for one, two in quoted for word in (one or two).split()]
    return found


@pytest.mark.slow
def test_the_account_of_160_sentences_of_a_grammar_has_every_word_once_and_shows_only_what_is_there(
    reader: PromptReader, tmp_path: Path
) -> None:
    chance, incomplete, untrue = random.Random(33), [], []
    here = {word for caption in HERE for word in caption.split()}
    places = {
        "city",
        "canal",
        "orchard",
        "glacier",
        "chimney",
        "balcony",
        "noon",
        "sorrow",
    }
    people = {noun for noun in _NOUNS if kinds_of(noun) == {"person"}} | {
        "mirror"
    }  # who are drawn, and a tool of theirs
    for prompt, said in [make_sentence(chance) for _ in range(160)]:
        found = words_of(account_of(prompt, reader, tmp_path))
        if sorted(word for words in found.values() for word in words) != sorted(said):
            incomplete.append((prompt, said, found))
        nouns = {word for word in found.get("shown", ()) if word in _NOUNS}
        if not nouns <= here | places | people:
            untrue.append((prompt, found))
    assert not incomplete and not untrue


@pytest.mark.slow
def test_the_account_of_40_odd_sentences_has_every_word(reader: PromptReader, tmp_path: Path) -> None:
    incomplete = []
    for line in ODD:
        prompt, _, said = line.rpartition(" = ")
        found = words_of(account_of(prompt, reader, tmp_path))
        told = [word for words in found.values() for word in words]
        if not {word.lower() for word in said.split()} <= set(told):
            incomplete.append((line, found))
    assert len(ODD) == 40 and not incomplete


@pytest.mark.slow
@pytest.mark.parametrize(
    ("prompt", "shown", "missing"),
    [
        ("a goat under a tree", "goat under tree", ""),
        ("a rusty goat on a loom", "rusty goat", "on loom"),
        ("two goats beside a red kettle", "two goats beside red kettle", ""),
        ("a tree without leaves", "tree", "without"),
        ("a rusty monk", "monk", "rusty"),
        ("an old monk climbing a loom", "old monk climbing", "loom"),
        ("a monk beside a loom", "monk", "beside loom"),
    ],
)
def test_what_is_shown_and_what_is_not(
    prompt: str, shown: str, missing: str, reader: PromptReader, tmp_path: Path
) -> None:
    found = words_of(account_of(prompt, reader, tmp_path))
    assert found.get("shown", []) == shown.split() and found.get("not shown", []) == missing.split()
    assert "leaves" not in prompt or found["left out as you asked"] == ["leaves"]


def test_a_mark_never_becomes_worse_and_a_substitute_is_named() -> None:
    said = (SaidWord(1, "rusty", "rusty", "quality"), SaidWord(2, "kitten", "kitten", "thing"))
    account = Account(Reading((Thing("rusty kitten", "kitten", at=(1, 2)),), said=said))
    assert [line.mark for line in account.lines] == [Mark.NOT_SHOWN, Mark.NOT_SHOWN]
    account.mark_picture(Thing("rusty kitten", "kitten", at=(1, 2)), "cat", exact=False, several=False)
    assert account.told == "Your words: shown by something similar: 'kitten' (by 'cat'); not shown: 'rusty'."
    account.mark([2], Mark.SHOWN, "kitten")
    account.mark([2], Mark.SIMILAR, "cat")
    assert [line.mark for line in account.lines] == [Mark.NOT_SHOWN, Mark.SHOWN]


@pytest.mark.parametrize(
    ("word", "caption", "says"),
    [("boat", "sailboat", True), ("king", "kingfisher", False), ("cat", "caterpillar", False), ("old", "gold", False),
     ("sleep", "a dog sleeping", True), ("mouse", "mice", False), ("kitten", "kittens", True)],
)  # fmt: skip
def test_a_caption_says_a_word_in_its_forms_and_compounds(word: str, caption: str, says: bool) -> None:
    assert SaidWord(0, word, word, "thing").says(caption) == says
