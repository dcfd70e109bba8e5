"""What a prompt says: its things, how they stand to each other, and what must not be seen.

The grammar is read by spaCy's small English model (Honnibal et al. 2020); no word lists decide what is a thing.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import torch
from torch import Tensor

from frida_painter import registry, weights
from frida_painter.errors import ConfigError, WeightsError
from frida_painter.objectives.encoders.classifiers import synonyms
from frida_painter.objectives.encoders.registry import EncoderRegistry
from frida_painter.palette import from_lab, to_lab

if TYPE_CHECKING:
    from spacy.language import Language
    from spacy.tokens import Doc, Token


_PLURAL = 3  # things that are painted for a plural without a number
_MOST = 12
MOST_THINGS = 12
"""Things of a prompt that are painted, the first ones."""
_NUMBERS = ["zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve"]
_MANY = ("many", "several", "some", "few", "both")
_GROUPS = {"pair": 2, "couple": 2, "trio": 3, "dozen": 12}
_GATHERED: dict[str, int | None] = {  # of things, where "of" follows
    **_GROUPS, "family": 4, "group": 4, "row": 4, "line": 4,
    "pile": None, "stack": None, "heap": None, "bunch": None, "bouquet": None,
}  # fmt: skip
_DEPICTIONS = ("painting", "picture", "drawing", "sketch", "photo", "photograph", "image", "portrait", "watercolor",
                "watercolour")  # fmt: skip
_MADE = ("building", "carving", "clothing", "crossing", "engraving", "etching", "evening", "railing", "wedding")
_EACH_OTHER = ("other", "another", "itself", "himself", "herself", "themselves")
_BASIC = ("black", "white", "red", "green", "yellow", "blue", "brown", "purple", "pink", "orange", "gray", "grey")
_VIVID = 72.0  # chroma
_PARTS = ("of", "with")  # what follows is part of the thing before alone
_LABEL = 60
_LONGEST = 400  # characters; more is no description of one picture


@dataclass(frozen=True)
class Thing:
    """A thing that a prompt names.

    name: what it is called, in the singular, with its adjectives and without its colour, as "old man"; noun: the last
    word of it; color: the word for its colour, as "dark blue", or nothing; count: the number of them that was said;
    None: several, without a number; doing: the verb for what it does, as "sleep", or nothing; plural: the noun as it
    was said, where it was a plural with a form of its own, as "scissors"; uncounted: whether nothing counted it, not
    even an article, as the "coffee" in a cup of coffee.
    """

    name: str
    noun: str
    color: str = ""
    count: int | None = 1
    doing: str = ""
    plural: str = ""
    uncounted: bool = False

    @property
    def shown(self) -> int:
        """How many of them are painted: 1 to 12."""
        return _PLURAL if self.count is None else max(1, min(self.count, _MOST))

    @property
    def label(self) -> str:
        """Its name for a sentence, 60 characters at the most."""
        return self.name[:_LABEL]


@dataclass(frozen=True)
class Relation:
    """How two things stand to each other: positions in `Reading.things`, and a preposition or verb between them."""

    subject: int
    word: str
    object: int


@dataclass(frozen=True)
class Reading:
    """The things of a prompt, their relations, and the nouns of what must not be seen; too_many: there were more."""

    things: tuple[Thing, ...]
    relations: tuple[Relation, ...] = ()
    absent: tuple[str, ...] = ()
    too_many: bool = False


def prompt_reader(encoders: EncoderRegistry) -> PromptReader:
    """Returns what reads prompts: by their grammar, or, with a remark on how to get it, as one thing."""

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
    """Reads prompts by their grammar. folder: of the fetched model; None: every prompt is one thing.

    Raises ConfigError and WeightsError.
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
        """What the prompt says. A prompt without any noun is one thing that is called like the prompt.

        Raises ConfigError where it says only what must not be seen.
        """
        text = prompt[:_LONGEST].strip().rstrip(".!")
        text = text.lower() if text.isupper() else text[:1].lower() + text[1:]
        walk = _Walk(self._words or _Words(frozenset(), frozenset(), frozenset()))
        for sentence in self._parsed(text).sents if self._language is not None else ():
            walk.sentence(sentence.root)
        if walk.absent and not walk.things:
            raise ConfigError(f"The words {text[:60]!r} say only what must not be seen; say what to paint.")
        plain = re.sub("^(an?|the) ", "", text)
        things = tuple(walk.things) or (Thing(plain, plain.rpartition(" ")[2]),)
        return Reading(things, tuple(dict.fromkeys(walk.relations)), tuple(dict.fromkeys(walk.absent)), walk.too_many)

    def _parsed(self, text: str) -> Doc:
        """The grammar of a text, where what the lexicon knows as a noun alone is no adjective: a croissant."""
        assert self._language is not None and self._words is not None
        read = self._language(text)
        for word in read:
            if word.pos_ in ("ADJ", "ADV", "X", "INTJ") and word.i > word.head.i and word.lemma_ in self._words.nouns:
                word.pos_ = "NOUN"
        return read


class _Words(NamedTuple):
    """What the grammar's lexicon knows as verbs, as adjectives, and as nouns alone."""

    verbs: frozenset[str]
    adjectives: frozenset[str]
    nouns: frozenset[str]


class _Walk:
    """Collects the things of a dependency tree."""

    def __init__(self, words: _Words) -> None:
        self._words = words
        self.things: list[Thing] = []
        self.relations: list[Relation] = []
        self.absent: list[str] = []
        self.too_many = False

    def sentence(self, root: Token) -> None:
        """Starts at the nouns that a depiction shows, at a verb, or at the root itself."""
        actor = self._actor(root)
        if _is_depiction(root) and (shown := _shown(root)) is not None:
            self._hanging(root, self._thing(shown), but=shown.head)
        elif root.pos_ in ("VERB", "AUX") or actor is not None:
            self._clause(root, [] if actor is None else self._thing(actor, root))
        elif root.pos_ == "ADP":
            self._preposition(root, [])
        else:
            self._thing(root)
        for noun in root.subtree:
            # "A lemon and two pears", where the parser takes the lemon for a "both".
            if noun.dep_ == "preconj" and _is_noun(noun):
                self._thing(noun)

    def _actor(self, root: Token) -> Token | None:
        """Who does what the root of a sentence says; None where it is no verb, or nobody is named.

        A last word may be what the word before it does, as in "a zebra drinking from a river", though it is read as a
        noun and the zebra as part of its name. What the lexicon knows as no adjective may be read as one.
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
        """The numbers of this noun and of those joined to it by "and"; what hangs on them is read too.

        whole: the word on which the noun's own adjectives and numbers hang, where that is a verb.
        """
        if noun.lower_ in _EACH_OTHER:
            return []
        if _is_none(noun):
            self.absent.append(noun.lemma_)
            present = [at for other in _joined(noun) for at in self._thing(other)]
            self._hanging(noun, present)
            return present
        if len(self.things) >= MOST_THINGS:
            self.too_many = True
            return []
        if _is_depiction(noun) and (shown := _shown(noun)) is not None:
            return self._thing(shown)
        counted = next((word for word in _children(noun, "prep") if word.lower_ == "of"), None)
        inner = None if counted is None or noun.lemma_ not in _GATHERED else _child(counted, "pobj")
        if inner is not None:
            numbers = self._thing(inner)
            for first in numbers[:1]:
                self.things[first] = replace(self.things[first], count=_GATHERED[noun.lemma_])
            self._hanging(noun, numbers, but=counted)
            return [*numbers, *(at for other in _joined(noun) for at in self._thing(other))]
        number = len(self.things)
        if (doing := _mistaken_clause(noun)) is not None:
            # The parser takes "a farmer feeding chickens" for chickens of a kind; "a" tells that it is not.
            self.things.append(_described(doing.nbor(-1), doing.nbor(-1)))
            self.things[number] = replace(self.things[number], doing=doing.lower_)
            self.things.append(_described(noun, noun, after=doing.i))
            joined = [at for other in _joined(noun) for at in self._thing(other)]
            self._relate([number], doing.lower_, [number + 1, *joined])
            self._hanging(noun, [number])
            return [number]
        self.things.append(self._in_one_word(_described(noun, whole or noun)))
        before = len(self.relations)
        joined = [at for other in _joined(noun) for at in self._thing(other)]
        if joined and not _children(noun, "prep", "acl", "relcl"):
            # "A teapot and three cups on a table": what is said of the last place is said of all.
            no_place = (*_PARTS, self.things[joined[-1]].doing)
            said = [one for one in self.relations[before:] if one.subject == joined[-1] and one.word not in no_place]
            self.relations += [replace(one, subject=number) for one in said]
        self._hanging(noun, [number])
        return [number, *joined]

    def _in_one_word(self, thing: Thing) -> Thing:
        """A thing whose name the lexicon knows in one word: a lamp post is a lamppost."""
        before, _, last = thing.name.removesuffix(thing.noun).rstrip().rpartition(" ")
        noun = f"{last}{thing.noun}"
        if not last or last in self._words.adjectives or noun not in self._words.nouns:
            return thing
        return replace(
            thing, name=f"{before} {noun}".strip(), noun=noun, plural=f"{last}{thing.plural}" if thing.plural else ""
        )

    def _hanging(self, noun: Token, subjects: list[int], but: Token | None = None) -> None:
        """What is said of a thing: where it is, what it has, and what it does."""
        full = (one for word in _children(noun, "amod") if word.i > noun.i for one in _children(word, "prep"))  # of
        for word in (*_children(noun, "prep", "advmod"), *full):
            if word != but:
                self._preposition(word, subjects)
        for verb in _children(noun, "acl", "relcl", "advcl"):
            self._clause(verb, subjects)

    def _preposition(self, word: Token, subjects: list[int], said: str = "") -> None:
        """One relation for each subject and each object; "in front of" and "next to" are one word."""
        said = f"{said} {word.lower_}".strip()
        for inner in _children(word, "prep"):
            self._preposition(inner, subjects, said)
        for noun in _children(word, "pobj"):
            further = [one for one in _children(noun, "prep") if one.lower_ == "of"]
            if (
                further
                and noun.pos_ == "NOUN"
                and not any(child.dep_ in ("det", "amod", "nummod", "compound") for child in noun.children)
            ):
                for one in further:
                    self._preposition(one, subjects, f"{said} {noun.lower_}")
                continue
            if said == "without":
                self.absent.append(noun.lemma_)
                continue
            self._relate(subjects, said, self._object(noun, subjects))

    def _object(self, noun: Token, subjects: list[int]) -> list[int]:
        """The numbers of an object; where it is in its turn is said of the subjects as well."""
        before = len(self.relations)
        numbers = self._thing(noun)
        raised = []
        for relation in self.relations[before:]:
            if relation.subject in numbers and subjects and relation.word not in _PARTS:
                raised += [Relation(subject, relation.word, relation.object) for subject in subjects]
            else:
                raised.append(relation)
        self.relations[before:] = raised
        return numbers

    def _clause(self, verb: Token, subjects: list[int]) -> None:
        for number in subjects:
            self.things[number] = replace(self.things[number], doing=verb.lower_)
        for noun in _children(verb, "dobj", "attr"):
            self._relate(subjects, verb.lower_, self._object(noun, subjects))
        for word in _children(verb, "prep", "advmod"):
            self._preposition(word, subjects)
        for other in _children(verb, "advcl", "xcomp", "conj"):
            self._clause(other, subjects)

    def _relate(self, subjects: list[int], word: str, objects: list[int]) -> None:
        self.relations += [Relation(subject, word, other) for subject in subjects for other in objects]


def _mistaken_clause(noun: Token) -> Token | None:
    """What somebody does to several things, where the parser takes that and him for words of their name."""
    if noun.tag_ != "NNS" or not any(child.lower_ in ("a", "an") for child in _children(noun, "det")):
        return None
    doing = next((word for word in _children(noun, "compound") if word.lower_.endswith("ing")), None)
    return doing if doing is not None and doing.i > 0 and _is_noun(doing.nbor(-1)) else None


def _last_word(noun: Token) -> Token | None:
    """The noun after a noun that ends its name, where the parser does not see that: the hydrant of a fire hydrant."""
    after = (word for word in _children(noun, "appos", "amod", "advmod") if word.i == noun.i + 1)
    return next((word for word in after if word.pos_ == "NOUN"), None)


def _described(noun: Token, whole: Token, after: int = -1) -> Thing:
    """The thing of a noun, by the words before it that come after a place in the text."""
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
    return Thing(" ".join([*name, lemma]), lemma, color, count, plural=said, uncounted=uncounted)


def _belongs(word: Token, noun: Token) -> bool:
    """Whether a word before a noun is part of what it is called, or of its colour or number."""
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
    """The value of a number in words or digits; None for many."""
    if word.isdecimal():
        return int(word[:4])
    return _NUMBERS.index(word) if word in _NUMBERS else _GROUPS.get(word)


def _children(word: Token, *kinds: str) -> list[Token]:
    return [child for child in word.children if child.dep_ in kinds]


def _child(word: Token, *kinds: str) -> Token | None:
    return next(iter(_children(word, *kinds)), None)


def _is_noun(word: Token) -> bool:
    return word.pos_ in ("NOUN", "PROPN", "PRON")


def _joined(noun: Token) -> list[Token]:
    """The nouns that are joined to one by "and", or stand beside it; not what is only its name, or ends it."""
    others = [one for one in _children(noun, "conj", "appos") if _is_noun(one) and not _is_called(one)]
    return [one for one in others if one != _last_word(noun)]


def _is_none(noun: Token) -> bool:
    """Whether there is none of it, as of "no cats"."""
    return any(child.lower_ in ("no", "zero", "0") for child in _children(noun, "det", "nummod"))


def _is_called(noun: Token) -> bool:
    """Whether a noun is only the name of the one before it, as in "my cat Tom"."""
    return bool(noun.dep_ == "appos" and noun.pos_ == "PROPN")


def _is_depiction(noun: Token) -> bool:
    return noun.lemma_.lower() in _DEPICTIONS or (noun.lemma_ == "life" and noun.nbor(-1).lower_ == "still")


def _shown(depiction: Token) -> Token | None:
    """The noun that a depiction shows: a portrait of one, a still life with one."""
    shown = {word.lower_: noun for word in _children(depiction, "prep") if (noun := _child(word, "pobj")) is not None}
    return shown.get("of", shown.get("with"))


def _color(words: list[Token]) -> tuple[str, list[Token]]:
    """The longest run of words that names a colour, or colours joined by "and", with those words."""
    runs = [words[first:last] for first in range(len(words)) for last in range(len(words), first, -1)]
    for run in sorted(runs, key=len, reverse=True):
        said = " ".join(word.lower_ for word in run)
        named = run[-1].pos_ == "ADJ" or run[-1].lower_ in _BASIC  # an apple tree and a rose garden are no colours
        if named and all(paint_of(part) is not None for part in said.split(" and ")):
            return said, run
    return "", []


@cache
def _paints() -> dict[str, str]:
    """Names of colours: those that the web has, and those of the xkcd survey (CC0), by matplotlib."""
    from matplotlib.colors import CSS4_COLORS, XKCD_COLORS

    surveyed = {name.removeprefix("xkcd:"): paint for name, paint in XKCD_COLORS.items()}
    return {**CSS4_COLORS, **surveyed, **{name.replace("grey", "gray"): surveyed[name] for name in surveyed}}


def paint_of(color: str) -> Tensor | None:
    """A colour's name, as "dark blue" or "black and white", as sRGB [3] in [0, 1], its first; None for no name."""
    from matplotlib.colors import to_rgb

    first = color.split(" and ")[0]
    if first not in _paints():
        return None
    lab = to_lab(torch.tensor(to_rgb(_paints()[first])))
    # No paint is as vivid as a screen.
    return from_lab(torch.cat((lab[:1], lab[1:] * min(1.0, _VIVID / max(float(lab[1:].norm()), 1e-6)))))


# What the title of a picture says: what it names, and how well that is a thing of a prompt.

_SAID = 0.3  # for the word for what it does, and for a name that begins with the colour: a red panda
_MODIFIES = 0.6  # against a title in which the word only says more of another
_UNSAID = 0.2  # against a title that says more than the words, as an alien tree, or a nut and bolt
_FURTHER = re.compile(r"\b(?:of|with|in|on|at|for|and)\b")  # what follows is not what is named
_WORD, _ALL_WORDS, _OTHERS = 0.15, 0.4, 0.05  # for the very word, for all of several words, and for each too many
SEVERAL = (None, 2)  # things of a plural that one picture may show: flowers, or a pair of scissors


def cleaned(caption: str) -> str:
    """A caption without article, numbers, underscores and what is in brackets, but for a colour; in small letters."""
    colors = [word for word in re.findall(r"\((.*?)\)", caption.lower()) if paint_of(word) is not None]
    plain = re.sub(r"\(.*?\)|[^a-zA-Z' -]+", " ", caption)
    plain = re.sub("^(an?|the|another|some|my|our) ", "", " ".join(plain.split()).lower())
    return " ".join([*colors[:1], plain]).strip() or caption


def in_small_letters(thing: Thing) -> Thing:
    """The thing as captions call it: the Eiffel Tower is the eiffel tower."""
    return replace(thing, name=thing.name.lower(), noun=thing.noun.lower(), plural=thing.plural.lower())


def named(title: str) -> list[str]:
    """The words of a title that name what it shows; the last one says what it is."""
    return _FURTHER.split(title)[0].split()


def spoken(title: str, thing: Thing) -> float:
    """What it is worth that a title has the very word, is no more than it, and speaks of little else."""
    plain = _plain(title, thing)
    words = plain.split()
    others = max(0, len(words) - len(thing.name.split()) - 1)
    name = thing.name.split()
    unsaid = set(named(plain)[:-1] + plain.partition(" and ")[2].split()) - {*name, thing.noun}
    worth = -_MODIFIES * is_modified(title, thing) - _OTHERS * others - _UNSAID * bool(unsaid)
    worth += _SAID * bool(thing.doing and thing.doing in title.split())
    worth += _SAID * bool(thing.color and title == f"{thing.color} {thing.name}")
    worth += _WORD * (thing.noun in words) + _WORD * (plain == thing.name)
    return worth + _ALL_WORDS * (len(name) > 1 and set(name) <= set(words))


def is_modified(title: str, thing: Thing) -> bool:
    """Whether a title names another thing by the word, as a mountain goat is no mountain, and a fencer is no fence, or
    one that is there: an owl on a branch is no branch.

    Of words that make one name the last says what it is, but a hyphen makes a name of its own: a jack-o'-lantern.
    """
    names = named(_plain(title, thing))
    endings = [word.removeprefix(thing.noun) for word in title.split() if word.startswith(thing.noun)]
    is_derived = any(ending not in ("", "s", "es") for ending in endings)
    is_joined = any(word.endswith(f"-{thing.noun}") for word in names)
    is_around = re.search(rf"\b(?:on|in|with) (?:\w+ )*{re.escape(thing.noun)}\b", _plain(title, thing)) is not None
    return thing.noun not in names[-1:] and (thing.noun in names or is_derived or is_joined or is_around)


def is_called(title: str, thing: Thing) -> bool:
    """Whether a title has the very word, or ends in it as a sailboat does, or a synonym, and means no other kind.

    A washing machine is no sewing machine, where a machine may be one.
    """
    kind, wanted = set(named(title)[:-1]), set(thing.name.split()[:-1])
    if kind and wanted and not kind & wanted:
        return False
    words = _plain(title, thing).split()
    names = (thing.noun, *(other.split()[-1].lower() for other in synonyms(thing.name)))
    return any(word.endswith((name, f"{name}s")) for word in words for name in names)


def _plain(title: str, thing: Thing) -> str:
    """The title without the thing's colour and what it does; in the singular where one picture may show several."""
    told = {*thing.color.split(), thing.doing}
    words = [word for word in title.split() if word not in told]
    if thing.plural and thing.count in SEVERAL:
        words = [thing.noun if word == thing.plural else word for word in words]
    return " ".join(words) or title
