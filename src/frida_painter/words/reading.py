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
from frida_painter.errors import ConfigError, WeightsError
from frida_painter.objectives.encoders.classifiers import synonyms
from frida_painter.objectives.encoders.loading import EncoderRegistry
from frida_painter.objectives.encoders.sentence import SentenceEncoder
from frida_painter.palette import from_lab, to_lab

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
_GATHERED: dict[str, int | None] = {  # number of things, if "of" follows
    **_GROUPS, "family": 4, "group": 4, "row": 4, "line": 4,
    "pile": None, "stack": None, "heap": None, "bunch": None, "bouquet": None,
}  # fmt: skip
_DEPICTIONS = ("painting", "picture", "drawing", "sketch", "photo", "photograph", "image", "portrait", "watercolor",
                "watercolour")  # fmt: skip
_MADE = ("building", "carving", "clothing", "crossing", "engraving", "etching", "evening", "railing", "wedding")
_EACH_OTHER = ("other", "another", "itself", "himself", "herself", "themselves")
_BASIC = ("black", "white", "red", "green", "yellow", "blue", "brown", "purple", "pink", "orange", "gray", "grey")
_VIVID = 72.0  # chroma
_PARTS = ("of", "with")  # these words introduce a part of the thing before them
_LABEL = 60
_STEM, _ENDING = 4, 3  # least letters of a word with other forms and compounds, and greatest number of an ending's
_LEXICON = 1000  # greatest number of new words in one call that are kept
_LONGEST = 400  # characters; a longer text is no description of one picture


@dataclass(frozen=True)
class Thing:
    """Thing that a prompt names.

    name: in the singular, with its adjectives and without its colour, such as "old man"
    noun: last word of the name
    color: word for its colour, such as "dark blue", or ""
    count: stated number; None for several without a number
    doing: verb for its action, such as "sleep", or ""
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

    @property
    def label(self) -> str:
        """Name for messages, at most 60 characters."""
        return self.name[:_LABEL]


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
    too_many: True if the prompt has more things than `things`
    said: all its words that can be shown, in its order
    """

    things: tuple[Thing, ...]
    relations: tuple[Relation, ...] = ()
    absent: tuple[str, ...] = ()
    too_many: bool = False
    said: tuple[SaidWord, ...] = ()


class WordMeanings(SentenceEncoder):
    """Sentence encoder that keeps its embeddings, so that the words of tables are read once."""

    def __init__(self, encoder: SentenceEncoder) -> None:
        self._encoder = encoder
        self._read: dict[str, Tensor] = {}

    def is_cut_off(self, sentence: str) -> bool:
        """Returns True if the end of a sentence is cut off."""
        return self._encoder.is_cut_off(sentence)

    def embed(self, sentences: Sequence[str]) -> Tensor:
        """Returns embeddings of sentences: [n, d], each of unit length."""
        new = [sentence for sentence in dict.fromkeys(sentences) if sentence not in self._read]
        if len(new) > _LEXICON:
            return self._encoder.embed(sentences)
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
        self._words = _Words(verbs, adjectives, frozenset(index["noun"]) - verbs - adjectives - adverbs)

    def read(self, prompt: str) -> Reading:
        """Returns the content of a prompt. A prompt without any noun is one thing with the prompt as its name.

        Raises ConfigError if it only names things that must not be seen.
        """
        text = prompt[:_LONGEST].strip().rstrip(".!")
        text = text.lower() if text.isupper() else text[:1].lower() + text[1:]
        walk = _Walk(self._words or _Words(frozenset(), frozenset(), frozenset()))
        parsed = self._parse(text) if self._language is not None else None
        for sentence in parsed.sents if parsed is not None else ():
            walk.sentence(sentence.root)
        if walk.absent and not walk.things:
            raise ConfigError(f"The words {text[:60]!r} say only what must not be seen; say what to paint.")
        plain = re.sub("^(an?|the) ", "", text)
        between = {at for relation in walk.relations for at in relation.at}
        said = () if parsed is None else _list_said(parsed, between)
        said = said or (SaidWord(0, plain, plain.lower(), "thing"),)
        if parsed is not None and (rest := prompt.strip()[_LONGEST:].strip()):
            said = (*said, SaidWord(len(parsed), rest[:_LABEL], rest[:_LABEL].lower(), "thing"))
        whole = Thing(plain, plain.rpartition(" ")[2], at=tuple(word.at for word in said))
        relations, absent = tuple(dict.fromkeys(walk.relations)), tuple(dict.fromkeys(walk.absent))
        return Reading(tuple(walk.things) or (whole,), relations, absent, walk.too_many, said)

    def _parse(self, text: str) -> Doc:
        """Returns the parsed text. Words that are only nouns in the lexicon are never adjectives: a croissant."""
        assert self._language is not None and self._words is not None
        read = self._language(text)
        for word in read:
            if word.pos_ in ("ADJ", "ADV", "X", "INTJ") and word.i > word.head.i and word.lemma_ in self._words.nouns:
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
    """Words of the grammar's lexicon: verbs, adjectives, and words that are only nouns."""

    verbs: frozenset[str]
    adjectives: frozenset[str]
    nouns: frozenset[str]


class _Walk:
    """Collector of the things in a dependency tree."""

    def __init__(self, words: _Words) -> None:
        self._words = words
        self.things: list[Thing] = []
        self.relations: list[Relation] = []
        self.absent: list[str] = []
        self.too_many = False

    def sentence(self, root: Token) -> None:
        """Starts at the nouns that a depiction shows, at a verb, or at the root itself."""
        actor = self._actor(root)
        if _is_depiction(root) and (shown := _find_depicted(root)) is not None:
            self._hanging(root, self._thing(shown), but=shown.head)
        elif root.pos_ in ("VERB", "AUX") or actor is not None:
            self._clause(root, [] if actor is None else self._thing(actor, root))
        elif root.pos_ == "ADP":
            self._preposition(root, [])
        else:
            self._thing(root)
        for noun in root.subtree:
            # "A lemon and two pears": the parser may take the lemon for a "both".
            if noun.dep_ == "preconj" and _is_noun(noun):
                self._thing(noun)

    def _actor(self, root: Token) -> Token | None:
        """Returns the noun that does the action of a sentence; None if there is none.

        The parser makes two mistakes, which this method corrects. It may read a verb at the end as a noun, and its
        actor as part of the name: "a zebra drinking from a river". It may also read the actor as an adjective,
        although the lexicon has no adjective of that name.
        """
        if root.pos_ in ("VERB", "AUX"):
            return next((word for word in reversed(list(root.lefts)) if _is_noun(word)), None)
        before = next((one for one in reversed(_children(root, "compound", "amod")) if one.i < root.i), None)
        stem = root.text.removesuffix("ing")
        if before is None or stem == root.text or root.lower_ in _MADE:
            return None
        is_name = before.dep_ == "compound" or before.lower_ not in self._words.adjectives
        return before if is_name and self._words.verbs & {stem, f"{stem}e", stem[:-1]} else None

    def _thing(self, noun: Token, whole: Token | None = None) -> list[int]:
        """Adds a noun and the nouns joined to it by "and", with their dependents; returns their numbers.

        whole: word that carries the noun's adjectives and numbers, if that is a verb
        """
        if noun.lower_ in _EACH_OTHER:
            return []
        if _is_none(noun):
            self.absent.append(noun.lemma_)
            present = [at for other in _join_nouns(noun) for at in self._thing(other)]
            self._hanging(noun, present)
            return present
        if len(self.things) >= MAX_THINGS:
            self.too_many = True
            return []
        if _is_depiction(noun) and (shown := _find_depicted(noun)) is not None:
            return self._thing(shown)
        counted = next((word for word in _children(noun, "prep") if word.lower_ == "of"), None)
        inner = None if counted is None or noun.lemma_ not in _GATHERED else _child(counted, "pobj")
        if inner is not None and counted is not None:
            numbers = self._thing(inner)
            for first in numbers[:1]:
                inside = self.things[first]
                self.things[first] = replace(inside, count=_GATHERED[noun.lemma_], at=(*inside.at, noun.i, counted.i))
            self._hanging(noun, numbers, but=counted)
            return [*numbers, *(at for other in _join_nouns(noun) for at in self._thing(other))]
        number = len(self.things)
        if (doing := _mistaken_clause(noun)) is not None:
            # The parser takes "a farmer feeding chickens" for a kind of chickens; the article "a" shows the mistake.
            self.things.append(_describe_noun(doing.nbor(-1), doing.nbor(-1)))
            self._act(number, doing)
            self.things.append(_describe_noun(noun, noun, after=doing.i))
            joined = [at for other in _join_nouns(noun) for at in self._thing(other)]
            self._relate([number], doing.lower_, [number + 1, *joined], (doing.i,))
            self._hanging(noun, [number])
            return [number]
        self.things.append(self._in_one_word(_describe_noun(noun, whole or noun)))
        before = len(self.relations)
        joined = [at for other in _join_nouns(noun) for at in self._thing(other)]
        if joined and not _children(noun, "prep", "acl", "relcl"):
            # "A teapot and three cups on a table": the place of the last noun holds for all.
            no_place = (*_PARTS, self.things[joined[-1]].doing)
            said = [one for one in self.relations[before:] if one.subject == joined[-1] and one.word not in no_place]
            self.relations += [replace(one, subject=number) for one in said]
        self._hanging(noun, [number])
        return [number, *joined]

    def _in_one_word(self, thing: Thing) -> Thing:
        """Returns a thing with its name as one word if the lexicon has that: a lamp post is a lamppost."""
        before, _, last = thing.name.removesuffix(thing.noun).rstrip().rpartition(" ")
        noun = f"{last}{thing.noun}"
        if not last or last in self._words.adjectives or noun not in self._words.nouns:
            return thing
        return replace(
            thing, name=f"{before} {noun}".strip(), noun=noun, plural=f"{last}{thing.plural}" if thing.plural else ""
        )

    def _hanging(self, noun: Token, subjects: list[int], but: Token | None = None) -> None:
        """Reads the dependents of a thing: places, parts and actions."""
        full = (one for word in _children(noun, "amod") if word.i > noun.i for one in _children(word, "prep"))  # of
        for word in (*_children(noun, "prep", "advmod"), *full):
            if word != but:
                self._preposition(word, subjects)
        for verb in _children(noun, "acl", "relcl", "advcl"):
            self._clause(verb, subjects)

    def _preposition(self, word: Token, subjects: list[int], said: str = "", at: tuple[int, ...] = ()) -> None:
        """Adds a relation for each subject and each object. "In front of" and "next to" count as one word."""
        said, at = f"{said} {word.lower_}".strip(), (*at, word.i)
        for inner in _children(word, "prep"):
            self._preposition(inner, subjects, said, at)
        for noun in _children(word, "pobj"):
            further = [one for one in _children(noun, "prep") if one.lower_ == "of"]
            if (
                further
                and noun.pos_ == "NOUN"
                and not any(child.dep_ in ("det", "amod", "nummod", "compound") for child in noun.children)
            ):
                for one in further:
                    self._preposition(one, subjects, f"{said} {noun.lower_}", (*at, noun.i))
                continue
            if said == "without":
                self.absent.append(noun.lemma_)
                continue
            self._relate(subjects, said, self._object(noun, subjects), at)

    def _object(self, noun: Token, subjects: list[int]) -> list[int]:
        """Returns the numbers of an object. Its own relations to further places are moved to the subjects."""
        before = len(self.relations)
        numbers = self._thing(noun)
        raised = []
        for relation in self.relations[before:]:
            if relation.subject in numbers and subjects and relation.word not in _PARTS:
                raised += [replace(relation, subject=subject) for subject in subjects]
            else:
                raised.append(relation)
        self.relations[before:] = raised
        return numbers

    def _clause(self, verb: Token, subjects: list[int]) -> None:
        for number in subjects:
            self._act(number, verb)
        for noun in _children(verb, "dobj", "attr"):
            self._relate(subjects, verb.lower_, self._object(noun, subjects), (verb.i,))
        for word in _children(verb, "prep", "advmod"):
            self._preposition(word, subjects)
        for other in _children(verb, "advcl", "xcomp", "conj"):
            self._clause(other, subjects)

    def _act(self, number: int, verb: Token) -> None:
        """Gives a thing its action."""
        thing = self.things[number]
        self.things[number] = replace(thing, doing=verb.lower_, at=(*thing.at, verb.i))

    def _relate(self, subjects: list[int], word: str, objects: list[int], at: tuple[int, ...]) -> None:
        self.relations += [Relation(subject, word, other, at) for subject in subjects for other in objects]


def _mistaken_clause(noun: Token) -> Token | None:
    """Returns the verb of a clause that the parser took for part of a name, None if there is none."""
    if noun.tag_ != "NNS" or not any(child.lower_ in ("a", "an") for child in _children(noun, "det")):
        return None
    doing = next((word for word in _children(noun, "compound") if word.lower_.endswith("ing")), None)
    return doing if doing is not None and doing.i > 0 and _is_noun(doing.nbor(-1)) else None


def _last_word(noun: Token) -> Token | None:
    """Returns the noun that ends a name, if the parser attached it wrongly: the hydrant of a fire hydrant."""
    after = (word for word in _children(noun, "appos", "amod", "advmod") if word.i == noun.i + 1)
    return next((word for word in after if word.pos_ == "NOUN"), None)


def _describe_noun(noun: Token, whole: Token, after: int = -1) -> Thing:
    """Returns the thing of a noun, from the words before it that come after position `after` of the text."""
    before = [word for word in whole.subtree if after < word.i < noun.i and _belongs(word, whole)]
    if (last := _last_word(noun)) is not None:
        before, noun = [*before, noun], last
    color, colored = _color(before)
    name = [word.text for word in before if word not in colored and not _is_number(word)]
    lemma = noun.text if noun.pos_ == "PROPN" else noun.lemma_
    beside = [word for word in (*whole.children, *(noun.children if noun is not whole else ())) if word.i > after]
    numbers = [word for word in beside if _is_number(word) and word.i < noun.i]
    single = any(child.dep_ == "det" and child.lower_ in ("a", "an") for child in beside)
    plural = noun.tag_ in ("NNS", "NNPS") and not single
    count = _number(numbers[0].lower_) if numbers else None
    count = 1 if count is None and not plural else count
    said = noun.lower_ if plural and noun.lower_ != lemma.lower() else ""
    uncounted = not plural and not numbers and not _children(whole, "det", "poss")
    at = tuple(sorted({noun.i, *(word.i for word in (*before, *numbers))}))
    return Thing(" ".join([*name, lemma]), lemma, color, count, plural=said, uncounted=uncounted, at=at)


def _belongs(word: Token, noun: Token) -> bool:
    """Returns True if a word before a noun is part of its name, colour or number."""
    head = word
    while head != noun:
        if head.dep_ not in (
            "amod",
            "compound",
            "nmod",
            "conj",
            "cc",
            "advmod",
            "nummod",
            "punct",
            "npadvmod",
            "quantmod",
        ):
            return False
        head = head.head
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


def _child(word: Token, *kinds: str) -> Token | None:
    return next(iter(_children(word, *kinds)), None)


def _is_noun(word: Token) -> bool:
    return word.pos_ in ("NOUN", "PROPN", "PRON")


def _join_nouns(noun: Token) -> list[Token]:
    """Returns the nouns joined to a noun by "and" or apposition, without proper names and ends of its name."""
    others = [one for one in _children(noun, "conj", "appos") if _is_noun(one) and not _is_called(one)]
    return [one for one in others if one != _last_word(noun)]


def _is_none(noun: Token) -> bool:
    """Returns True if a noun is negated, as in "no cats"."""
    return any(child.lower_ in ("no", "zero", "0") for child in _children(noun, "det", "nummod"))


def _is_called(noun: Token) -> bool:
    """Returns True if a noun is only the proper name of the one before it, as in "my cat Tom"."""
    return bool(noun.dep_ == "appos" and noun.pos_ == "PROPN")


def _is_depiction(noun: Token) -> bool:
    return noun.lemma_.lower() in _DEPICTIONS or (noun.lemma_ == "life" and noun.nbor(-1).lower_ == "still")


def _find_depicted(depiction: Token) -> Token | None:
    """Returns the noun that a depiction shows: a portrait of it, a still life with it."""
    shown = {word.lower_: noun for word in _children(depiction, "prep") if (noun := _child(word, "pobj")) is not None}
    return shown.get("of", shown.get("with"))


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


# Comparison of a picture's title with a thing of a prompt.

_SAID = 0.3  # bonus for the word of its action, and for a name that begins with the colour: a red panda
_MODIFIES = 0.6  # penalty for a title in which the word only qualifies another
_UNSAID = 0.2  # penalty for a title with additional words: an alien tree, a nut and bolt
_FURTHER = re.compile(r"\b(?:of|with|in|on|at|for|and)\b")  # the words after these are not the named thing
_WORD, _ALL_WORDS, _OTHERS = 0.15, 0.4, 0.05  # bonus for the word, bonus for all words, penalty per extra one
SEVERAL = (None, 2)  # counts of a plural that one picture may show: flowers, or a pair of scissors


def clean_caption(caption: str) -> str:
    """Returns a caption in small letters without article, numbers, underscores and brackets, except for colours."""
    colors = [word for word in re.findall(r"\((.*?)\)", caption.lower()) if paint_of(word) is not None]
    plain = re.sub(r"\(.*?\)|[^a-zA-Z' -]+", " ", caption)
    plain = re.sub("^(an?|the|another|some|my|our) ", "", " ".join(plain.split()).lower())
    return " ".join([*colors[:1], plain]).strip() or caption


def in_small_letters(thing: Thing) -> Thing:
    """Returns the thing in the small letters of captions: the Eiffel Tower is the eiffel tower."""
    return replace(thing, name=thing.name.lower(), noun=thing.noun.lower(), plural=thing.plural.lower())


def split_title(title: str) -> list[str]:
    """Returns the words of a title that name its thing; the last one is the noun."""
    return _FURTHER.split(title)[0].split()


def spoken(title: str, thing: Thing) -> float:
    """Returns a score for a title: high if it has the thing's own word, is not another kind, and has little else."""
    plain = _plain(title, thing)
    words = plain.split()
    others = max(0, len(words) - len(thing.name.split()) - 1)
    name = thing.name.split()
    unsaid = set(split_title(plain)[:-1] + plain.partition(" and ")[2].split()) - {*name, thing.noun}
    worth = -_MODIFIES * is_modified(title, thing) - _OTHERS * others - _UNSAID * bool(unsaid)
    worth += _SAID * bool(thing.doing and thing.doing in title.split())
    worth += _SAID * bool(thing.color and title == f"{thing.color} {thing.name}")
    worth += _WORD * (thing.noun in words) + _WORD * (plain == thing.name)
    return worth + _ALL_WORDS * (len(name) > 1 and set(name) <= set(words))


def is_modified(title: str, thing: Thing) -> bool:
    """Returns True if a title uses the word for another thing: a mountain goat, a fencer, or an owl on a branch.

    The last word of a name is the noun, but a word with a hyphen is a separate name: a jack-o'-lantern.
    """
    names = split_title(_plain(title, thing))
    endings = [word.removeprefix(thing.noun) for word in title.split() if word.startswith(thing.noun)]
    is_derived = any(ending not in ("", "s", "es") for ending in endings)
    is_joined = any(word.endswith(f"-{thing.noun}") for word in names)
    is_around = re.search(rf"\b(?:on|in|with) (?:\w+ )*{re.escape(thing.noun)}\b", _plain(title, thing)) is not None
    return thing.noun not in names[-1:] and (thing.noun in names or is_derived or is_joined or is_around)


def is_called(title: str, thing: Thing) -> bool:
    """Returns True if a title has the word, a compound such as sailboat, or a synonym, and no different kind.

    For a washing machine, the title "sewing machine" does not count, but "machine" does.
    """
    kind, wanted = set(split_title(title)[:-1]), set(thing.name.split()[:-1])
    if kind and wanted and not kind & wanted:
        return False
    words = _plain(title, thing).split()
    names = (thing.noun, *(other.split()[-1].lower() for other in synonyms(thing.name)))
    return any(word.endswith((name, f"{name}s")) for word in words for name in names)


def _plain(title: str, thing: Thing) -> str:
    """Returns the title without the thing's colour and action; in the singular if one picture may show several."""
    told = {*thing.color.split(), thing.doing}
    words = [word for word in title.split() if word not in told]
    if thing.plural and thing.count in SEVERAL:
        words = [thing.noun if word == thing.plural else word for word in words]
    return " ".join(words) or title
