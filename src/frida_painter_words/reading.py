"""Reading of prompts by patterns: subjects with counts and colours, the ground, names, and what must not be seen.

Captions of pictures are read in the same way. Which words are things is known from the captions.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import dropwhile, takewhile

from frida_painter.objectives.word_settings import refuse_absent

COLORS = {"black": (30, 30, 32), "white": (245, 245, 242), "red": (205, 35, 40), "green": (50, 140, 60),
          "yellow": (245, 205, 45), "blue": (45, 85, 185), "brown": (115, 72, 42), "purple": (115, 50, 145), "pink":
          (240, 130, 170), "orange": (235, 125, 35), "gray": (130, 130, 132), "grey": (130, 130, 132)}  # fmt: skip
"""Common names of colours, and sRGB that paints can have, 0 to 255."""
SHADES = {"dark": -18, "light": 18, "bright": 6, "pale": 22}  # words before a colour, and what they add to its L*
OLD = frozenset(("old", "elderly"))  # words that make another person of a person
Knows = Callable[[str], bool]  # returns True if a word is the noun of a caption
LONGEST = 400  # characters of a prompt that are read; a longer text is no description of one picture
NUMBERS = ("zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve")
_WORDS = re.compile(r"\w+")
_GROUPS = {"pair": 2, "couple": 2, "trio": 3, **dict.fromkeys(_WORDS.findall(
    "group row herd flock pack school swarm crowd bunch lot lots pile bouquet"))}  # fmt: skip
_PLACING = _WORDS.findall(
    "in on at by under over near behind above below beneath beside through across along inside into onto among between "
    "before against around outside next during after underneath atop amid upon")  # fmt: skip
_OTHERS = _WORDS.findall(
    "a an the my our your his her its their this that these those of and or with to is are was were be as it who which "
    "while from for me us you i he she they there very front top middle back out up many several some few both day"
)
FUNCTION_WORDS = frozenset((*_PLACING, *_OTHERS))  # words that name nothing to be seen
_PLACE = rf"\b(?:{'|'.join(_PLACING)})\b"
_BETWEEN = r"\band\b|[,;&]"  # two things
_TWO_COLORS = re.compile(rf"\b({'|'.join(COLORS)}) and (?=(?:{'|'.join(COLORS)})\b)")
_ASKED = re.compile(
    r"(?i)(please|(can|could|would|will) you|i (want|wish|need|would like|'d like)( you)?( to)?|"
    r"(paint|draw|sketch|show|make|give|create)( (me|us)|(?= (an?|the|my|our|some)\b)))[, ]+"
)
_DEPICTED = re.compile(
    r"(?i)((an?|the|some) )?([\w-]+ )?(painting|picture|portrait|drawing|sketch|photo|photograph|image|watercolou?r|"
    r"illustration|still life)s? (of|showing|with) "
)
_STYLE = re.compile(
    r"(?i),? *\b(in|after) (the|an?) ([\w-]+ )?(style|manner|spirit)( of [^,;.]+)?|,? *\bin [\w-]+ style\b"
)
_ABSENT = re.compile(
    r"(?i),? *\b(?:and |but |with )?(?:no|not|without|neither|nor)\b(?! (?:more|longer|\w+'s)\b)(?: any| an?| the)?"
    rf"((?: (?!{_PLACE}|(?:with|for|but|only|and an?|and the)\b)[\w'-]+)+)"
)
_PLURALS = {"children": "child", "people": "person", "mice": "mouse", "geese": "goose", "feet": "foot"}
_ARTICLES = ("a", "an", "the", "my", "his", "her", "their")
_SHORT = 3  # letters of a word that keeps its ending
_WORD = re.compile(r"[^\W\d_][\w'’-]*|\d+")


@dataclass(frozen=True)
class Phrase:
    """Phrase of a prompt or a caption, in small letters: all its words, and what they say.

    name: words that name its thing, with their adjectives and without count and colour; the last one is the noun
    count: stated number; None for several without a number
    color: such as "dark blue", or ""
    proper: words of a proper name; () if the noun is none
    """

    words: tuple[str, ...]
    name: tuple[str, ...]
    count: int | None = 1
    color: str = ""
    proper: tuple[str, ...] = ()

    @property
    def noun(self) -> str:
        """Stem of the noun; of the first word that names something, if it has none."""
        known = self.name or [word for word in self.words if word not in FUNCTION_WORDS]
        return stem(known[-1 if self.name else 0]) if known else ""

    @property
    def part(self) -> Phrase:
        """Content or material of the thing, such as the coffee of a cup of coffee; without words if there is none."""
        at = self.words.index("of") if "of" in self.words else 0
        of = read_phrase(self.words[at + 1 :], lambda word: True)
        return of if self.name and at == self.words.index(self.name[-1]) + 1 else Phrase((), ())


@dataclass(frozen=True)
class Reading:
    """Content of a prompt: its text without request, style and absent things, and the words for the latter two.

    subjects: of the words before the first preposition of place
    ground, places: the words after it, and the stems of the nouns there
    """

    text: str
    subjects: tuple[Phrase, ...]
    ground: str
    places: frozenset[str]
    absent: tuple[str, ...]
    style: str


def stem(word: str) -> str:
    """Returns a word without the endings of plurals and of common forms of verbs and adjectives."""
    word = singular(re.sub("['’]s$", "", word.lower()))
    for ending in ("ing", "ed", "y"):
        if len(word) - len(ending) > _SHORT - (ending != "y"):
            word = word.removesuffix(ending)
    word = word.removesuffix("e") if len(word) > _SHORT else word
    doubled = len(word) > _SHORT and word[-1] == word[-2] and word[-1] not in "sle"
    word = word[:-1] if doubled else word
    return f"{word[:-1]}f" if word.endswith("v") else word


def singular(word: str) -> str:
    """Returns the singular of a noun."""
    one = _PLURALS.get(word, f"{word[:-3]}man" if word.endswith("men") else word)
    if one != word or word.endswith(("ss", "us", "is")) or not word.endswith("s") or len(word) <= _SHORT:
        return one
    return f"{word[:-3]}y" if word.endswith("ies") else word[:-1]


def noun_of(title: str) -> str:
    """Returns the noun of a title in the singular: its last word before a preposition, an article or a verb in -ing."""
    words = list(dropwhile(FUNCTION_WORDS.__contains__, title.split()))
    named = list(takewhile(lambda word: word not in FUNCTION_WORDS, words))
    while named and named[-1].endswith("ing") and (len(named) > 1 or (*words, "")[1] in _ARTICLES):
        named.pop()
    return singular(named[-1]) if named else ""


def contents(words: Sequence[str] | str) -> frozenset[str]:
    """Returns the stems of the words that name something."""
    words = _WORD.findall(words.lower()) if isinstance(words, str) else words
    return frozenset(stem(word) for word in words if word not in FUNCTION_WORDS)


def split_absent(prompt: str) -> tuple[str, tuple[str, ...]]:
    """Returns a prompt without its negations, and their words."""
    absent = [word.lower() for said in _ABSENT.findall(prompt) for word in said.split() if word not in FUNCTION_WORDS]
    return _ABSENT.sub("", prompt).strip(" ,.;!?"), tuple(absent)


def read(prompt: str, knows: Knows) -> Reading:
    """Returns the content of a prompt. Raises ConfigError if it says only what must not be seen."""
    names, text = _proper_names(prompt[:LONGEST]), " ".join(prompt[:LONGEST].split())
    while (found := _ASKED.match(text) or _DEPICTED.match(text)) and found.end() < len(text):
        text = text[found.end() :]
    style = " ".join(found.group().strip(" ,") for found in _STYLE.finditer(text))
    text, absent = split_absent(_STYLE.sub("", text))
    if absent and not contents(text):
        raise refuse_absent(prompt)
    said = _TWO_COLORS.sub(r"\1 ", text.lower())  # black and white is one
    things = re.split(_PLACE, said)[0]
    places = {one.noun for one in _phrases(rf"{_PLACE}|\bwith\b|{_BETWEEN}", said[len(things) :], knows)}
    subjects = _phrases(_BETWEEN, things, knows, names)
    return Reading(text, subjects, said[len(things) :], frozenset(places), absent, style)


def _phrases(between: str, text: str, knows: Knows, names: frozenset[str] = frozenset()) -> tuple[Phrase, ...]:
    parts = (_WORD.findall(part) for part in re.split(between, text))
    return tuple(read_phrase(part, knows, names) for part in parts if contents(part))


def read_phrase(words: Sequence[str], knows: Knows, names: frozenset[str] = frozenset()) -> Phrase:
    """Returns the phrase of words in small letters. names: words of proper names."""
    count, color, name, single = None, list[str](), list[str](), False
    said = tuple(words)
    for word, after in zip(said, (*said, "of")[1:], strict=True):
        if not name and word in _GROUPS and after == "of" and word != said[-1]:
            single, count = False, _GROUPS[word]
        elif not name and (word in NUMBERS or word.isdecimal()):
            count = int(word[:4]) if word.isdecimal() else NUMBERS.index(word)
        elif (word in COLORS or (word in SHADES and after in COLORS)) and (not name or after not in FUNCTION_WORDS):
            color.append(word)
        elif word in FUNCTION_WORDS:
            if name:
                break
            single, count = single or word in ("a", "an"), 1 if word in ("a", "an") else count
        elif name and word not in names and _is_verb(word, name[-1], after, knows, names):
            break  # a cat sleeps; a robot painting a picture
        else:
            name.append(word)
    if not name and color:
        name, color = [color[-1]], color[:-1]  # an orange
    if len(name) == 1 and name[0].endswith("ing") and not knows(name[0]):
        name = []  # dancing
    is_plural = bool(name) and not single and name[-1] != singular(name[-1])
    count = 1 if count is None and not is_plural else count
    proper = tuple(word for word in said if word in names) if name and name[-1] in names else ()
    return Phrase(said, tuple(name), count, " ".join(color), proper)


def _is_verb(word: str, before: str, after: str, knows: Knows, names: frozenset[str]) -> bool:
    """Returns True if a word between two others is a verb: a cat sleeps, a robot painting a door, Einstein dancing."""
    is_noun = knows(word) and after not in _ARTICLES and before not in names
    return not is_noun and (word.endswith(("ing", "ed")) or (word.endswith("s") and knows(before)))


def _proper_names(prompt: str) -> frozenset[str]:
    """Returns the words of proper names in small letters: capitals inside a sentence that has small letters too."""
    words = [word for word in _WORD.findall(prompt) if word != "I"]
    later = [word for word in words[1:] if word[0].isupper()]
    begins = bool(words) and words[0][0].isupper() and words[0].lower() not in FUNCTION_WORDS
    is_title = len(words) > 3 and len(later) == len(words) - 1 and words[0][0].isupper()
    if is_title or any(word.lower() in FUNCTION_WORDS for word in later):
        return frozenset()
    first = words[:1] if begins and later and words[1] == later[0] else []
    return frozenset(word.lower() for word in (*first, *later))
