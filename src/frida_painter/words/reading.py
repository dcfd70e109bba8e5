"""Reading of prompts: their things, the relations between them, and the things that must not be seen.

spaCy's small English model (Honnibal et al. 2020) parses the grammar. No word lists decide which word is a thing.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import torch
from torch import Tensor

from frida_painter import registry, weights
from frida_painter.errors import WeightsError
from frida_painter.objectives.encoders.loading import EncoderRegistry
from frida_painter.objectives.encoders.sentence import SentenceEncoder
from frida_painter.objectives.word_settings import refuse_absent
from frida_painter.palette import from_lab, to_lab
from frida_painter.words.nouns import kinds_of

if TYPE_CHECKING:
    from spacy.language import Language
    from spacy.tokens import Doc, Token


_PLURAL = 3  # number of painted things for a plural without a number
_MAX = 12
MAX_THINGS = 12
"""Greatest number of a prompt's things that are painted, the first ones."""
_NUMBERS = ["zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve"]
_MANY = ("many", "several", "some", "few", "both")
_GROUPS = {"pair": 2, "couple": 2, "trio": 3, "dozen": 12}
GATHERED: dict[str, int | None] = {  # number of things, if "of" follows
    **_GROUPS, "family": 4, "group": 4, "row": 4, "line": 4,
    "pile": None, "stack": None, "heap": None, "bunch": None, "bouquet": None,
}  # fmt: skip
"""Nouns of several things, and their number."""
_DEPICTIONS = ("painting", "picture", "drawing", "sketch", "photo", "photograph", "image", "portrait", "watercolor",
                "watercolour")  # fmt: skip
_IN_A_NAME = ("amod", "compound", "nmod", "nummod", "npadvmod", "quantmod", "poss", "det")  # parts of speech
_SOMEBODY = ("some", "every")  # the pronouns that are people: somebody waits, but "it" and "you" are no things
_BASIC = ("black", "white", "red", "green", "yellow", "blue", "brown", "purple", "pink", "orange", "gray", "grey")
_VIVID = 72.0  # chroma
_LABEL = 60
_STEM, _ENDING = 4, 3  # least letters of a word with other forms and compounds, and greatest number of an ending's
_LONGEST = 400  # characters; a longer text is no description of one picture


@dataclass(frozen=True)
class Thing:
    """Thing that a prompt names.

    name: in the singular, with its adjectives and without its colour, such as "old man"
    noun: last word of the name; the whole name of a prompt without nouns, such as "growing up"
    color: word for its colour, such as "dark blue", or ""
    count: stated number; None for several without a number
    doing: verb for its action, such as "sleeping", or ""
    plural: the noun as written, for a plural with a form different from the singular, such as "scissors"
    uncounted: True if it has no number and no article, such as the coffee in "a cup of coffee"
    at: positions of its words in the prompt; two things with equal words are equal wherever they stand
    """

    name: str
    noun: str
    color: str = ""
    count: int | None = 1
    doing: str = ""
    plural: str = ""
    uncounted: bool = False
    at: tuple[int, ...] = field(default=(), compare=False)

    @property
    def shown(self) -> int:
        """Number of painted copies: 1 to 12."""
        return _PLURAL if self.count is None else max(1, min(self.count, _MAX))


@dataclass(frozen=True)
class Relation:
    """Relation of two things: their positions in `Reading.things`, and a preposition or verb between them.

    at: positions of its words in the prompt
    """

    subject: int
    word: str
    object: int
    at: tuple[int, ...] = field(default=(), compare=False)


@dataclass(frozen=True)
class SaidWord:
    """Word of a prompt that can be shown.

    at: position in the prompt
    text: as written
    lemma: in the singular, in small letters
    kind: "thing" for a noun, "quality" for an adjective, an adverb, and a noun before another; "number"; "action";
        "relation" for a preposition
    """

    at: int
    text: str
    lemma: str
    kind: str

    def says(self, caption: str) -> bool:
        """Returns True if a caption has this word, an inflected form, or a compound that ends with it."""
        stem, own = self.lemma[: max(_STEM, len(self.lemma) - 1)], (self.text.lower(), self.lemma)
        for word in re.findall(r"[\w']+", caption.lower()):
            is_form = word.startswith(stem) and len(word) <= len(self.lemma) + _ENDING
            if word in own or (len(stem) >= _STEM and (is_form or word.endswith(own))):
                return True
        return False


@dataclass(frozen=True)
class Reading:
    """Content of a prompt.

    things: things to be shown
    relations: between the things
    absent: nouns of things that must not be seen
    said: all its words that can be shown, in its order
    """

    things: tuple[Thing, ...]
    relations: tuple[Relation, ...] = ()
    absent: tuple[str, ...] = ()
    said: tuple[SaidWord, ...] = ()


class WordMeanings(SentenceEncoder):
    """Sentence encoder that keeps its embeddings, so that the words of tables are read once."""

    def __init__(self, encoder: SentenceEncoder) -> None:
        self._encoder = encoder
        self._read: dict[str, Tensor] = {}

    def embed(self, sentences: Sequence[str]) -> Tensor:
        """Returns embeddings of sentences: [n, d], each of unit length."""
        new = [sentence for sentence in dict.fromkeys(sentences) if sentence not in self._read]
        self._read |= dict(zip(new, self._encoder.embed(new), strict=True)) if new else {}
        return torch.stack([self._read[sentence] for sentence in sentences])


def word_meanings(encoders: EncoderRegistry) -> WordMeanings:
    """Returns the encoder of words that keeps what it has read."""
    return encoders.keep("word meanings", lambda: WordMeanings(encoders.sentences()))


def prompt_reader(encoders: EncoderRegistry) -> PromptReader:
    """Returns the reader of prompts; without the grammar model it takes a prompt as one thing, with a remark."""

    def make() -> PromptReader:
        folder = weights.find("english", encoders.cache)
        if folder is None or not registry.is_installed("spacy"):
            encoders.remark(
                "The prompt is taken for one thing; to have its grammar read: pip install 'frida-painter[words]', "
                "frida-painter models fetch english"
            )
            folder = None
        return PromptReader(folder)

    return encoders.keep("prompt reader", make)


class PromptReader:
    """Reader of prompts by their grammar.

    folder: of the fetched model; None to take every prompt as one thing

    Raises ConfigError if spaCy is missing, WeightsError if the folder does not hold the model.
    """

    def __init__(self, folder: Path | None) -> None:
        self._language: Language | None = None
        self._words: _Words | None = None
        if folder is None:
            return
        registry.require("words", "spacy", "Reading a prompt")
        import spacy

        try:
            self._language = spacy.load(folder, exclude=["ner", "senter"])
        except (OSError, ValueError) as cause:
            raise WeightsError(f"{folder} does not hold the English grammar; fetch english again.") from cause
        lemmas: Any = self._language.get_pipe("lemmatizer")
        index = lemmas.lookups.get_table("lemma_index")
        verbs, adjectives, adverbs = (frozenset(index[kind]) for kind in ("verb", "adj", "adv"))
        nouns = frozenset(index["noun"])
        self._words = _Words(verbs, adjectives, nouns, nouns - verbs - adjectives - adverbs)

    def read(self, prompt: str) -> Reading:
        """Returns the content of a prompt. A prompt without any noun is one thing with the prompt as its name.

        Raises ConfigError if it only names things that must not be seen.
        """
        text = prompt[:_LONGEST].strip().rstrip(".!")
        text = text.lower() if text.isupper() else text[:1].lower() + text[1:]
        parsed = self._parse(text) if self._language is not None else None
        walk = _Walk(list(parsed or ()), self._words or _Words(frozenset(), frozenset(), frozenset(), frozenset()))
        if walk.absent and not walk.things:
            raise refuse_absent(text)
        plain = re.sub("^(an?|the) ", "", text)
        between = {at for relation in walk.relations for at in relation.at}
        said = () if parsed is None else _list_said(parsed, between)
        said = said or (SaidWord(0, plain, plain.lower(), "thing"),)
        if parsed is not None and (rest := prompt.strip()[_LONGEST:].strip()):
            said = (*said, SaidWord(len(parsed), rest[:_LABEL], rest[:_LABEL].lower(), "thing"))
        noun = plain if parsed is not None else plain.rpartition(" ")[2]
        whole = Thing(plain, noun, at=tuple(word.at for word in said))
        relations, absent = tuple(dict.fromkeys(walk.relations)), tuple(dict.fromkeys(walk.absent))
        return Reading(tuple(walk.things) or (whole,), relations, absent, said)

    def _parse(self, text: str) -> Doc:
        """Returns the parsed text. Words that are only nouns in the lexicon are never adjectives: a croissant."""
        assert self._language is not None and self._words is not None
        read = self._language(text)
        if len(read) and (read[0].pos_ in ("NOUN", "PROPN", "ADJ") or read[0].tag_ == "VBZ"):
            read = self._language(f"the {text}")  # cows under a tree: without an article "cows" looks like a verb
        last = read[-1] if len(read) > 1 and _is_noun(read[-2]) and read[-1].pos_ in ("AUX", "ADJ") else None
        if last is not None and last.lower_ in self._words.nouns and paint_of(last.lower_) is None:
            last.pos_, last.lemma_ = "NOUN", last.lower_  # a watering can, a steam locomotive
            for child in _children(last, "nsubj"):
                child.dep_ = "compound"
        for word in read:
            is_after = word.pos_ in ("ADJ", "ADV", "X", "INTJ") and word.i > word.head.i
            if is_after and word.lemma_ in self._words.only_nouns:
                word.pos_ = "NOUN"
        return read


def _list_said(parsed: Doc, between: set[int]) -> tuple[SaidWord, ...]:
    """Returns the words of a prompt that can be shown: all but articles, conjunctions, particles and pronouns.

    between: positions of the words of relations
    """
    kinds = {"NOUN": "thing", "PROPN": "thing", "INTJ": "thing", "X": "thing", "ADJ": "quality", "ADV": "quality",
             "NUM": "number", "VERB": "action", "ADP": "relation"}  # fmt: skip
    found = []
    for word in parsed:
        kind = "number" if _is_number(word) and word.lemma_ not in _GROUPS else kinds.get(word.pos_, "")
        if kind in ("thing", "action") and word.dep_ in ("amod", "compound", "npadvmod"):
            kind = "quality"
        if (word.i in between and kind != "action") or word.dep_ in ("prep", "agent"):
            kind = "relation"
        is_degree = word.pos_ == "ADV" and word.is_stop and kind == "quality"
        if kind and word.text.strip("-'\".,;:!?") and not is_degree:
            found.append(SaidWord(word.i, word.text, word.lemma_.lower(), kind))
    return tuple(found)


class _Words(NamedTuple):
    """Words of the grammar's lexicon: verbs, adjectives, nouns, and words that are only nouns."""

    verbs: frozenset[str]
    adjectives: frozenset[str]
    nouns: frozenset[str]
    only_nouns: frozenset[str]


class _Walk:
    """Collector of a text's things and the relations between them, from its dependency tree."""

    def __init__(self, parsed: Sequence[Token], words: _Words) -> None:
        self._words = words
        self.things: list[Thing] = []
        self.relations: list[Relation] = []
        self.absent: list[str] = []
        self._numbers: dict[Token, int] = {}  # of the nouns that are things
        self._read_as: dict[Token, Token] = {}  # pictures, piles and mistaken verbs, and the nouns that they stand for
        self._actors: dict[Token, Token] = {}  # of verbs that the parser took for nouns
        for step in (self._correct, self._add, self._relate, self._act, self._share):
            for word in parsed:
                step(word)

    def _correct(self, noun: Token) -> None:
        """Finds out what a noun is read as, and corrects two mistakes of the parser.

        It may read a verb at the end as a noun, and its actor as part of the name: "a zebra drinking from a river".
        It may also take "a farmer feeding chickens" for a kind of chickens; the article "a" shows the mistake.
        """
        shown = {word.lower_: one for word in _children(noun, "prep") for one in _children(word, "pobj")}
        is_still_life = noun.lemma_ == "life" and noun.i > 0 and noun.nbor(-1).lower_ == "still"
        if noun.lemma_.lower() in _DEPICTIONS or is_still_life:
            inner = shown.get("of", shown.get("with"))
        else:
            inner = shown.get("of") if noun.lemma_ in GATHERED else None
        if inner is not None:
            self._read_as[noun] = inner
        before = next((one for one in reversed(_children(noun, "compound", "amod")) if one.i < noun.i), None)
        if before is None:
            return
        is_one = any(child.lower_ in ("a", "an") for child in _children(noun, "det"))
        stem = noun.text.removesuffix("ing")
        is_name = before.dep_ == "compound" or before.lower_ not in self._words.adjectives
        actor = before.nbor(-1) if before.i and before.lower_.endswith("ing") else None
        is_actor = actor is not None and kinds_of(actor.lower_) == {"person"}
        if actor is not None and (is_actor or (_is_noun(actor) and noun.tag_ == "NNS" and is_one)):
            self._actors[before] = actor
            return
        is_verb = kinds_of(noun.lower_) == {"idea"} and self._words.verbs & {stem, f"{stem}e", stem[:-1]}
        is_last = noun.dep_ in ("ROOT", "pobj", "dobj")
        if stem != noun.text and is_verb and is_name and is_last and noun not in self._read_as:
            self._actors[noun] = self._read_as[noun] = before

    def _add(self, noun: Token) -> None:
        """Adds a noun to the things, if it is one."""
        is_actor = noun in self._actors.values() or (noun.dep_ == "npadvmod" and noun.head.dep_ == "ROOT")
        is_part = noun.dep_ in _IN_A_NAME and noun.head.pos_ != "VERB"  # but a train crossing a bridge
        is_named = is_part or (noun.dep_ == "appos" and noun.pos_ == "PROPN")  # my cat Tom
        is_noun = _is_noun(noun) and not is_named and _last_word(noun.head) != noun and not _is_between(noun)
        is_nobody = noun.pos_ == "PRON" and not noun.lower_.startswith(_SOMEBODY)
        if is_nobody or noun in self._read_as or not (is_actor or is_noun):
            return
        first = next(word for word in (noun, *noun.ancestors) if word.dep_ not in ("conj", "appos"))
        is_without = first.dep_ == "pobj" and first.head.lower_ == "without"
        if is_without or any(child.lower_ in ("no", "zero", "0") for child in _children(noun, "det", "nummod")):
            self.absent.append(noun.lemma_)
        elif len(self.things) < MAX_THINGS:
            verb = next((verb for verb, actor in self._actors.items() if noun in (actor, verb.head)), None)
            whole = verb if verb in self._read_as and verb is not None else noun
            thing = _describe_noun(noun, whole, after=verb.i if verb is not None and verb.head == noun else -1)
            for group in (
                group for group, inner in self._read_as.items() if inner == noun and group.lemma_ in GATHERED
            ):
                thing = replace(thing, count=GATHERED[group.lemma_], at=(*thing.at, group.i, noun.head.i))
            self._numbers[noun] = len(self.things)
            self.things.append(thing)

    def _relate(self, noun: Token) -> None:
        """Adds the relations of the object of a preposition. "In front of" and "next to" count as one word."""
        if noun.dep_ != "pobj" or self._read_as.get(noun.head.head) == noun or _is_between(noun):
            return
        words = _prepositions(noun)
        said = " ".join(word.lower_ for word in words)
        subjects = [] if words[0].head == words[0] else self._subjects(words[0].head)
        self._join(subjects, said, noun, tuple(word.i for word in words))

    def _act(self, verb: Token) -> None:
        """Gives the actors of a verb their action, and adds its relations to its objects."""
        if verb not in self._actors and (verb.pos_ not in ("VERB", "AUX") or verb.dep_ in _IN_A_NAME):
            return
        subjects = self._subjects(verb)
        doing = "" if verb.pos_ == "AUX" else _gerund(verb, self._words.verbs)
        for number in subjects:
            thing = self.things[number]
            self.things[number] = replace(thing, doing=thing.doing or doing, at=(*thing.at, verb.i))
        fed = [verb.head] if verb in self._actors and verb not in self._read_as else []
        for noun in (*_children(verb, "dobj", "attr"), *fed):
            self._join(subjects, doing or verb.lower_, noun, (verb.i,))

    def _share(self, noun: Token) -> None:
        """Gives a noun the place of the last one joined to it: a teapot and three cups on a table."""
        if noun in self._numbers and _children(noun, "conj", "appos") and not _children(noun, "prep", "acl", "relcl"):
            last = self._joined(noun)[-1]
            alone = ("of", "with", self.things[last].doing)
            places = [one for one in self.relations if one.subject == last and one.word not in alone]
            self.relations += [replace(one, subject=self._numbers[noun]) for one in places]

    def _join(self, subjects: list[int], said: str, noun: Token, at: tuple[int, ...]) -> None:
        """Adds a relation of each subject to a noun, and to those joined to it."""
        self.relations += [Relation(one, said, other, at) for one in subjects for other in self._joined(noun)]

    def _joined(self, noun: Token) -> list[int]:
        """Returns the number of a noun, and those of the nouns joined to it by "and"."""
        mine = self._numbers.get(self._read_as.get(noun, noun))
        others = [number for one in _children(noun, "conj", "appos") for number in self._joined(one)]
        return others if mine is None else [mine, *others]

    def _subjects(self, head: Token) -> list[int]:
        """Returns the things that a preposition or a verb below `head` belongs to, the nearest ones."""
        above, is_root, head = head.head, head.head == head, self._read_as.get(head, head)
        if head in self._actors:
            return self._joined(self._actors[head])
        if head in self._numbers:
            return [self._numbers[head]]
        if head.pos_ in ("VERB", "AUX") and (actors := [word for word in head.lefts if _is_noun(word)]):
            return self._joined(actors[-1])
        return [] if is_root else self._subjects(above)


def _gerund(verb: Token, verbs: frozenset[str]) -> str:
    """Returns "riding" for "rides" and "rode"; other forms of a verb as they are."""
    if verb.tag_ not in ("VB", "VBZ", "VBP", "VBD"):
        return verb.lower_
    known = (verb.lower_, verb.lower_.removesuffix("s"), verb.lemma_.lower())
    base = next(form for form in known if form in verbs or form == known[-1])
    for ending, instead in (("ie$", "y"), ("(?<=[^e])e$", ""), ("^([^aeiou]+[aeiou])([^aeiouwxy])$", r"\1\2\2")):
        stem, changes = re.subn(ending, instead, base)
        if changes:
            return f"{stem}ing"
    return f"{base}ing"


def _prepositions(noun: Token) -> list[Token]:
    """Returns the words before the object of a preposition that make one: "in", "front", "of"."""
    words = [noun.head]
    while words[0].dep_ not in ("conj", "ROOT") and (
        words[0].head.pos_ in ("ADP", "ADV") or _is_between(words[0].head)
    ):
        words.insert(0, words[0].head)
    return words


def _is_between(noun: Token) -> bool:
    """Returns True if a noun is part of a preposition, as in "in front of"."""
    is_bare = noun.dep_ == "pobj" and noun.tag_ == "NN" and noun.n_lefts == 0
    return is_bare and any(word.lower_ == "of" for word in noun.children)


def _last_word(noun: Token) -> Token | None:
    """Returns the noun that ends a name, if the parser attached it wrongly: the hydrant of a fire hydrant."""
    after = (word for word in _children(noun, "appos", "amod", "advmod") if word.i == noun.i + 1)
    return next((word for word in after if word.pos_ == "NOUN"), None)


def _describe_noun(noun: Token, whole: Token, after: int = -1) -> Thing:
    """Returns the thing of a noun, from the words before it that come after position `after` of the text.

    whole: word that carries the noun's adjectives and numbers, if that is a verb
    """
    before = [word for word in whole.subtree if after < word.i < noun.i and _belongs(word, whole)]
    if (last := _last_word(noun)) is not None:
        before, noun = [*before, noun], last
    color, colored = _color(before)
    name = [word.text for word in before if word not in colored and not _is_number(word)]
    lemma = noun.text if noun.pos_ == "PROPN" else noun.lemma_
    beside = [word for word in (*whole.children, *noun.children) if after < word.i]
    numbers = [word for word in beside if _is_number(word) and word.i < noun.i]
    single = any(child.dep_ == "det" and child.lower_ in ("a", "an") for child in beside)
    is_plain = noun.lower_ == lemma.lower() and not noun.lower_.endswith("s")  # one hedgehog, and one sheep
    plural = noun.tag_ in ("NNS", "NNPS") and not single and not is_plain
    count = _number(numbers[0].lower_) if numbers else None
    count = (GATHERED.get(lemma) or 1) if count is None and not plural else count
    said = noun.lower_ if plural and noun.lower_ != lemma.lower() else ""
    uncounted = not plural and not numbers and not _children(whole, "det", "poss")
    at = tuple(sorted({noun.i, *(word.i for word in (*before, *numbers))}))
    return Thing(" ".join([*name, lemma]), lemma, color, count, plural=said, uncounted=uncounted, at=at)


def _belongs(word: Token, noun: Token) -> bool:
    """Returns True if a word before a noun is part of its name, colour or number."""
    while word != noun:
        if word.dep_ not in (*_IN_A_NAME, "conj", "cc", "advmod", "punct") or word.dep_ in ("poss", "det"):
            return False
        word = word.head
    return True


def _is_number(word: Token) -> bool:
    return word.dep_ in ("nummod", "quantmod") or word.lower_ in _MANY or word.lemma_ in _GROUPS


def _number(word: str) -> int | None:
    """Returns the value of a number in words or digits; None for words such as "many"."""
    if word.isdecimal():
        return int(word[:4])
    return _NUMBERS.index(word) if word in _NUMBERS else _GROUPS.get(word)


def _children(word: Token, *kinds: str) -> list[Token]:
    return [child for child in word.children if child.dep_ in kinds]


def _is_noun(word: Token) -> bool:
    return word.pos_ in ("NOUN", "PROPN", "PRON")


def _color(words: list[Token]) -> tuple[str, list[Token]]:
    """Returns the longest run of words that names a colour, or colours joined by "and", with those words."""
    runs = [words[first:last] for first in range(len(words)) for last in range(len(words), first, -1)]
    for run in sorted(runs, key=len, reverse=True):
        said = " ".join(word.lower_ for word in run)
        named = run[-1].pos_ == "ADJ" or run[-1].lower_ in _BASIC  # an apple tree and a rose garden are no colours
        if named and all(paint_of(part) is not None for part in said.split(" and ")):
            return said, run
    return "", []


@cache
def _paints() -> dict[str, str]:
    """Returns the named colours of CSS and of the xkcd survey (CC0), from matplotlib."""
    from matplotlib.colors import CSS4_COLORS, XKCD_COLORS

    surveyed = {name.removeprefix("xkcd:"): paint for name, paint in XKCD_COLORS.items()}
    return {**CSS4_COLORS, **surveyed, **{name.replace("grey", "gray"): surveyed[name] for name in surveyed}}


def paint_of(color: str) -> Tensor | None:
    """Returns the sRGB [3] in [0, 1] of a colour's name, the first of "black and white"; None if it is unknown."""
    from matplotlib.colors import to_rgb

    first = color.split(" and ")[0]
    if first not in _paints():
        return None
    lab = to_lab(torch.tensor(to_rgb(_paints()[first])))
    # Paint is less vivid than a screen.
    return from_lab(torch.cat((lab[:1], lab[1:] * min(1.0, _VIVID / max(float(lab[1:].norm()), 1e-6)))))
