"""Reading of prompts: their things, the relations between them, and the things that must not be seen.

spaCy's medium English model (Honnibal et al. 2020) parses the grammar. No word lists decide which word is a thing.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor

from frida_painter import registry, weights
from frida_painter.drawing.arrangement import RIDES, Relation, kind_of
from frida_painter.drawing.figures import wardrobe
from frida_painter.errors import WeightsError
from frida_painter.extras import install_command
from frida_painter.objectives.encoders.loading import EncoderRegistry
from frida_painter.objectives.encoders.sentence import SentenceEncoder
from frida_painter.objectives.word_settings import refuse_absent
from frida_painter.palette import from_lab, to_lab
from frida_painter.words.nouns import kind_of_name, kinds_of, noun_of, senses_of

if TYPE_CHECKING:
    from spacy.language import Language
    from spacy.tokens import Token


_PLURAL = 3  # number of painted things for a plural without a number
_MAX = 12
MAX_THINGS = 12
"""Greatest number of a prompt's things that are painted, the first ones."""
_NUMBERS = ["zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve"]
_MANY = ("many", "several", "some", "few", "both")
GROUPS = {"pair": 2, "couple": 2, "trio": 3, "dozen": 12, "family": 4, "group": 4, "row": 4, "line": 4, "herd": 5,
           "fleet": 5, "flock": 7, "pack": 5, "school": 7, "shoal": 7, "swarm": 9, "crowd": 9,
           **dict.fromkeys(("pile", "stack", "heap", "bunch", "bouquet", "lot", "plenty", "handful"))}  # fmt: skip
"""Nouns of several things, and their number."""
_COUNTS = {**GROUPS, **{word: number for number, word in enumerate(_NUMBERS)}}
_DEPICTIONS = ("painting", "picture", "drawing", "sketch", "photo", "photograph", "image", "portrait", "watercolor",
                "watercolour", "life")  # fmt: skip
_IN_A_NAME = ("amod", "compound", "nmod", "nummod", "npadvmod", "quantmod")  # kinds of dependents
SOMEBODY = "somebody"
"""Actor of a prompt without one: dancing in the rain."""
PEOPLE = (SOMEBODY, "someone", "everybody", "everyone")
"""Pronouns of people; "it" and "something" are no things."""
_TOGETHER = {"twin": 2, "parent": 2, "grandparent": 2, "newlywed": 2, "triplet": 3}  # numbers of people in a plural
_TOLD_OF = ("he", "she", "they")  # pronouns for the first thing: my dog, he is brown
_SIDES = {"front": "in front of", "foreground": "in front of", "top": "on", "middle": "in", "side": "beside",
          "sides": "beside", "inside": "in", "it": "", "them": "",  # in it
          **dict.fromkeys(("mouth", "beak", "paws", "trunk"), "in the mouth of"), "head": "on the head of",
          "nose": "on the head of", **dict.fromkeys(("back", "background", "distance"), "behind")}  # fmt: skip
"""Nouns for the place of a thing by another one: a cake with strawberries on top."""
_NEVER = ("come", "arrive", "return", "exist", "answer")  # somebody who doesn't come is not seen
_ASKED = re.compile(
    r"(please|(can|could|would|will) you|i (want|wish|need)( you)?( to)?|i('d| would) (like|love)( you)?( to)?|see|"
    r"have|(paint|draw|sketch|show|make|give|create)( (me|us)|(?= (an?|the|my|our|some|what|how|something)\b)))[, ]+",
    re.I,
)  # fmt: skip
COLORS = ("black", "white", "red", "green", "yellow", "blue", "brown", "purple", "pink", "orange", "gray", "grey")
"""Common names of colours; as nouns they are no things."""
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
        words = re.findall(r"[\w']+", caption.lower())
        forms = [word for word in words if word.startswith(stem) and len(word) <= len(self.lemma) + _ENDING]
        is_long = len(stem) >= _STEM
        return any(word in own or (is_long and (word in forms or word.endswith(own))) for word in words)


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

    @property
    def colors(self) -> dict[int, Tensor]:
        """sRGB [3] of the words for colours, by their positions."""
        said = {
            word.at: paint_of(word.lemma)
            for word in self.said
            if word.lemma in COLORS and word.kind in ("quality", "thing")
        }
        return {at: paint for at, paint in said.items() if paint is not None}


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
        folder = weights.find("english", encoders.cache) if registry.is_installed("spacy") else None
        if folder is None:
            steps = [] if registry.is_installed("spacy") else [install_command("words")]
            todo = ", then ".join([*steps, "frida-painter models fetch english"])
            encoders.remark(f"The prompt is taken for one thing; to have its grammar read: {todo}")
        return PromptReader(folder)

    return encoders.keep("prompt reader", make)


def strip_request(prompt: str) -> str:
    """Returns a prompt without the words of a request: "please paint me a fox" is a fox."""
    prompt = prompt.strip()
    while (request := _ASKED.match(prompt)) and request.end() < len(prompt):
        prompt = prompt[request.end() :]
    return prompt


class PromptReader:
    """Reader of prompts by their grammar.

    folder: of the fetched model; None to take every prompt as one thing

    Raises ConfigError if spaCy is missing, WeightsError if the folder does not hold the model.
    """

    def __init__(self, folder: Path | None) -> None:
        self._language: Language | None = None
        if folder is None:
            return
        registry.require("words", "spacy", "Reading a prompt")
        import spacy

        try:
            self._language = spacy.load(folder, exclude=["ner", "senter"])
        except (OSError, ValueError) as cause:
            raise WeightsError(f"{folder} does not hold the English grammar; fetch english again.") from cause
        names = "|".join(word for garment in wardrobe("garments.txt") for word in garment.words)
        self._dressed = re.compile(rf"\b({names})(?= \w+ing\b)")  # in a hat watering roses: who does is before the hat
        lemmas: Any = self._language.get_pipe("lemmatizer")
        index = lemmas.lookups.get_table("lemma_index")
        self._verbs, self._nouns = frozenset(index["verb"]), frozenset(index["noun"])
        self._only_nouns = self._nouns - self._verbs.union(index["adj"], index["adv"])

    def read(self, prompt: str) -> Reading:
        """Returns the content of a prompt. A prompt without any noun is one thing with the prompt as its name.

        Raises ConfigError if it only names things that must not be seen.
        """
        text = strip_request(prompt[:_LONGEST]).rstrip(".!?")
        first, _, rest = text.partition(" ")
        if text.isupper():
            text = text.lower()
        elif not kind_of_name(first) and not rest[:1].isupper():  # New York keeps its capitals
            text = text[:1].lower() + text[1:]
        parsed = self._parse(text)
        walk = _Walk(parsed)
        if parsed and not (walk.things or walk.absent):  # golden retriever: an article helps the parser
            parsed = self._parse(f"the {text}")
            walk = _Walk(parsed)
        is_negated = not parsed and text.startswith(("no ", "without "))
        if is_negated or (walk.absent and not walk.things):
            raise refuse_absent(text)
        plain = re.sub("^(an?|the) ", "", text)
        said = _list_said(parsed, {at for relation in walk.relations for at in relation.at})
        said = said or (SaidWord(0, plain, plain.lower(), "thing"),)
        if parsed and (rest := prompt.strip()[_LONGEST:].strip()):
            said = (*said, SaidWord(len(parsed), rest[:_LABEL], rest[:_LABEL].lower(), "thing"))
        noun = plain.rpartition(" ")[2] if self._language is None else plain
        whole = Thing(plain, noun, at=tuple(word.at for word in said))
        return Reading(tuple(walk.things) or (whole,), tuple(walk.relations), tuple(walk.absent), said)

    def _parse(self, text: str) -> Sequence[Token]:
        """Returns the parsed text, with mistakes of the parser corrected; empty without the model."""
        if self._language is None:
            return ()
        parsed = self._language(text := self._dressed.sub(r"\1,", text))
        first = parsed[0] if len(parsed) else None
        if first is not None and (
            first.tag_ in ("VBZ", "VB", "VBD") or (first.pos_ == "VERB" and kinds_of(first.lower_) == {"person"})
        ):
            # Without an article what begins looks like a verb: birds over a house, spotted mushroom with a door.
            parsed = self._language(f"the {text}")
        elif (
            first is not None
            and (first.tag_, first.pos_, first.dep_) == ("VBG", "VERB", "ROOT")
            and not _children(first, "nsubj")
        ):
            parsed = self._language(f"{SOMEBODY} {text}")
        for word in parsed:
            if word.tag_ == "VBZ" and (base := word.lower_.removesuffix("s")) in self._verbs:
                word.lemma_ = base  # rides come from ride, not rid
            before = word.nbor(-1) if word.i else word
            one, kind = word.text.removesuffix("s"), word.tag_
            only = next((form for form in (word.lower_, one.lower()) if form in self._only_nouns), "")
            if one != word.text and one in self._nouns and (kind == "NNP" or (kind == "NNS" and one[-2:] == "ie")):
                _make_noun(word, one)  # kids, and cookies, which are no cooks
            elif only and word.pos_ in ("VERB", "ADJ", "ADV", "X", "INTJ") and word.lemma_ not in self._verbs:
                _make_noun(word, only)  # rooftops
            if word.tag_ == "VBD" and before.head == word and (before.lower_ in COLORS or before.dep_ == "det"):
                role = ("amod", "ADJ") if before.lower_ in COLORS else ("det", "DET")
                _put_in_place(word, before, role[0], before.lefts)  # a red rose
                _make_noun(word, word.lower_)
                before.pos_ = role[1]
            if word.dep_ == "pcomp" and (subjects := _children(word, "nsubj")):  # with one ear missing
                _put_in_place(subjects[0], word, "acl", [])
                subjects[0].dep_ = "pobj"
            whole = noun_of(f"{before.lower_} {word.lower_}") if word.i and not _is_noun(word) else ""
            if " " in whole:  # a teddy bear, a watering can, church bells
                _make_noun(word, whole.rpartition(" ")[2])
                if word.head == before:
                    _put_in_place(word, before, "compound", before.lefts)
        for word in parsed:
            self._correct(word)
        return list(parsed)

    def _correct(self, noun: Token) -> None:
        """Puts another word into the place of a noun, if that is what is to be seen.

        This is the thing in a picture, or the content of a pile. The parser may take a verb for a noun, and its
        actor or its object for a part of the name: "a zebra drinking from a river", "a farmer feeding chickens". It may
        also take the last word of a name for a further noun: "a fire hydrant".
        """
        shown = {word.lower_: one for word in _children(noun, "prep") for one in _children(word, "pobj")}
        last = next((word for word in _children(noun, "acl") if word.i == noun.i + 1), None)
        before = [word for word in noun.lefts if word.dep_ in ("compound", "amod")]
        stem = noun.text.removesuffix("ing")
        is_verb = stem != noun.text and bool(self._verbs & {stem, f"{stem}e", stem[:-1]})
        actors = before or _children(noun, "nsubj")
        kinds = [kinds_of(word.lower_) for word in (*actors[-1:], noun)]
        is_acted = kinds[-1] == {"idea"} or ("idea" in kinds[-1] and kinds[0] == {"person"})  # a monk reading
        is_doing = is_verb and is_acted and kinds[0] != {"idea"}  # but a stone building, a winter evening
        if noun.lemma_.lower() in _DEPICTIONS and (inner := shown.get("of", shown.get("with"))):
            _put_in_place(inner, noun, "det", [word for word in noun.rights if word.i > inner.i])
        elif (
            is_verb
            and "idea" in kinds[-1]
            and _children(noun, "prep")
            and (inner := shown.get("of"))
            and (kinds_of(inner.lower_) != {"idea"} and not any(word.lower_ in ("a", "an") for word in noun.lefts))
        ):  # the ticking of a clock
            _put_in_place(inner, noun, "acl", [word for word in noun.rights if word.i > inner.i])
            noun.pos_ = "VERB"
        elif noun.dep_ in ("pobj", "dobj") and "body" in kinds_of(noun.lemma_) and (owners := _children(noun, "poss")):
            if "person" in kinds_of(owners[0].lower_) and _is_noun(owners[0]):  # asleep on his father's chest
                _put_in_place(owners[0], noun, "det", [])
        elif noun.lemma_ in GROUPS and (inner := shown.get("of")):
            _put_in_place(inner, noun, "nummod", [word for word in noun.rights if word.i > inner.i])
        elif actor := next((word for word in noun.lefts if _children(word, "acl")), None):  # a farmer feeding chickens
            _put_in_place(actor, noun, "dobj", [word for word in noun.lefts if word.i < actor.i])
            noun.head = _children(actor, "acl")[0]
        elif noun.dep_ == "compound" and noun.lemma_ in self._verbs and _children(noun, "nsubj"):
            bakes, noun.head = noun.head, noun.head.head  # her grandma bake cookies
            noun.pos_, noun.tag_, noun.dep_, bakes.head, bakes.dep_ = "VERB", "VB", "ccomp", noun, "dobj"
        elif last is not None and last.lower_.endswith("ing") and last.pos_ == "NOUN":
            last.pos_ = "VERB"  # a cowboy riding off
        elif before and before[-1].lower_.endswith("ing") and before[-1].i:
            verb, actor = before[-1], before[-1].nbor(-1)
            if "person" in kinds_of(actor.lower_) or noun.lower_ in COLORS:  # a jellyfish glowing pink
                _put_in_place(actor, noun, "dobj", [word for word in (*noun.lefts, *verb.lefts) if word.i < actor.i])
                verb.pos_, verb.dep_, verb.head, noun.head = "VERB", "acl", actor, verb
                noun.pos_ = "ADJ" if noun.lower_ in COLORS else noun.pos_
        elif actors and (is_doing or _children(noun, "dobj")) and noun.dep_ in ("ROOT", "pobj", "dobj"):
            _put_in_place(actors[-1], noun, "acl", [word for word in noun.lefts if word != actors[-1]])
            noun.pos_ = "VERB"
            self._correct(actors[-1])
        for verb in _children(noun, "acl") if before else ():  # kids ice skating
            is_one = {"person"} == kinds_of(before[-1].lemma_) and "person" not in kinds_of(noun.lemma_)
            if verb.i == noun.i + 1 and (before[-1].tag_ == "NNS" or is_one):
                _put_in_place(before[-1], noun, "dobj", [word for word in noun.children if word != before[-1]])
                noun.head = verb


def _make_noun(word: Token, lemma: str) -> None:
    """Makes a word a noun; its subjects become the first words of its name: a teddy bear."""
    word.pos_, word.tag_, word.lemma_ = "NOUN", "NN" if lemma == word.lower_ else "NNS", lemma
    for child in _children(word, "nsubj"):
        child.dep_ = "compound"


def _put_in_place(noun: Token, other: Token, kind: str, taken: Iterable[Token]) -> None:
    """Puts a noun into the place of another word in the tree, which then depends on the noun, in that kind.

    taken: dependents of the other word that become dependents of the noun
    """
    taken = list(taken)
    if other.head != noun:
        noun.dep_, noun.head = other.dep_, noun if other.head == other else other.head
    for word in (*taken, other):
        word.head = noun
    other.dep_, noun.pos_ = kind, noun.pos_ if _is_noun(noun) else "NOUN"


def _list_said(parsed: Sequence[Token], between: set[int]) -> tuple[SaidWord, ...]:
    """Returns the words of a prompt that can be shown: all but articles, conjunctions, particles and pronouns.

    between: positions of the words of relations
    """
    kinds = {"NOUN": "thing", "PROPN": "thing", "INTJ": "thing", "X": "thing", "ADJ": "quality", "ADV": "quality",
             "NUM": "number", "VERB": "action", "ADP": "relation"}  # fmt: skip
    found = []
    for word in parsed:
        kind = "number" if _is_number(word) else kinds.get(word.pos_, "")
        if kind in ("thing", "action") and _is_in_a_name(word):
            kind = "quality"
        if (word.i in between and kind != "action") or word.dep_ in ("prep", "agent"):
            kind = "relation"
        is_degree = word.pos_ == "ADV" and word.is_stop and kind == "quality"
        if kind and not word.is_punct and not is_degree:
            found.append(SaidWord(word.i, word.text, word.lemma_.lower(), kind))
    return tuple(found)


class _Walk:
    """Collector of a text's things and the relations between them, from its dependency tree."""

    def __init__(self, parsed: Sequence[Token]) -> None:
        self.things: list[Thing] = []
        self.relations: list[Relation] = []
        self.absent: list[str] = []
        self._numbers: dict[Token, int] = {}  # of the nouns that are things
        for step in (self._add, self._relate, self._act, self._share, self._carry):
            for word in parsed:
                step(word)

    def _add(self, noun: Token) -> None:
        """Adds a noun to the things, if it is one."""
        is_part = _is_in_a_name(noun) or noun.dep_ in ("det", "poss", "advmod") or noun.lower_ == "o'clock"
        is_part = is_part or _is_side(noun) or _is_owner(noun)
        is_name = noun.dep_ == "appos" and noun.pos_ == "PROPN"  # my cat Tom
        is_nobody = noun.pos_ == "PRON" and noun.lower_ not in PEOPLE
        if not _is_noun(noun) or is_part or is_name or is_nobody or _is_between(noun):
            return
        first = next(word for word in (noun, *noun.ancestors) if word.dep_ not in ("conj", "appos"))
        is_without = first.dep_ == "pobj" and first.head.lower_ == "without"
        is_missed = any(one.lemma_ in _NEVER and _children(one, "neg") for one in _children(noun, "relcl"))
        if is_without or is_missed or any(_is_none(child) for child in _children(noun, "det", "nummod")):
            self.absent.append(noun.lemma_)
        elif len(self.things) < MAX_THINGS:
            self._numbers[noun] = len(self.things)
            self.things.append(_describe_noun(noun))

    def _relate(self, noun: Token) -> None:
        """Adds the relations of the object of a preposition. "In front of" and "taller than" count as one word."""
        if noun.dep_ == "advmod" and noun.lower_ == "inside":
            self._turn(self._subjects(noun.head), _SIDES[noun.lower_], (noun.i,))
        if noun.dep_ != "pobj":
            return
        words = [noun.head]
        while words[0].dep_ not in ("conj", "ROOT") and (
            words[0].head.pos_ in ("ADP", "ADV")
            or words[0].head.tag_ == "JJR"
            or _is_between(words[0].head)
            or (
                kind_of(f"{words[0].head.lower_} {words[0].lower_}") in ("hang", "made")
                and not _children(words[0].head, "dobj")
            )
        ):
            words.insert(0, words[0].head)
        subjects = self._subjects(words[0] if words[0].pos_ == "VERB" else words[0].head)
        told = [one for one in _children(words[0].head, "dative", "prep") if one.lower_ == "to" and one.i < words[0].i]
        heard = [one for word in told for one in _children(word, "pobj") if "person" in kinds_of(one.lemma_)]
        subjects = self._joined(heard[-1]) if heard else subjects  # the listeners are in bed
        at = tuple(word.i for word in words)
        if _is_side(noun):
            side, above = _SIDES[noun.lower_] or words[0].lower_, words[0].head
            self._turn(subjects, side, (*at, noun.i))
            verb = above.head if above.dep_ == "dobj" else above
            held = [one for word in _children(verb, "dobj") for one in self._joined(word) if side.endswith(" of")]
            pairs = [(one, other) for one in held for other in self._subjects(verb)]  # a basket on her head
            self.relations += [Relation(one, side, other, (*at, noun.i)) for one, other in pairs if one != other]
        self._join(subjects, " ".join(word.lower_ for word in words), noun, at)

    def _turn(self, subjects: list[int], said: str, at: tuple[int, ...]) -> None:
        """Says where a thing is that another one is "with"."""
        for number, one in enumerate(self.relations):
            if one.word == "with" and {one.subject, one.object} & {*subjects}:
                self.relations[number] = Relation(one.object, said, one.subject, (*one.at, *at))

    def _act(self, verb: Token) -> None:
        """Gives the actors of a verb their action, and adds its relations to its objects."""
        is_state = verb.pos_ == "ADJ" and (verb.i > verb.head.i or bool(_children(verb, "nsubj")))  # asleep in a chair
        if is_state and (
            verb.tag_ == "JJR" or verb.head.pos_ == "ADP" or (verb.dep_ == "conj" and verb.head.pos_ == "ADJ")
        ):
            return
        if not is_state and (verb.pos_ not in ("VERB", "AUX") or _is_in_a_name(verb)):
            return
        if any(word.pos_ == "VERB" for word in _children(verb, "xcomp")):  # he used to hum, or she learns to ride
            return
        taught = _children(verb.head, "dobj") if verb.dep_ == "xcomp" else []  # she teaches her son to ride
        subjects = [number for one in taught for number in self._joined(one)] or self._subjects(verb)
        if verb.dep_ == "acl":  # mother and child, walking
            beside = [one for one in verb.head.conjuncts if one.i < verb.i and "person" in kinds_of(one.lower_)]
            subjects = subjects if not beside or "person" in kinds_of(verb.head.lemma_) else []
            subjects += [self._numbers[one] for one in beside if one in self._numbers]
        has = verb.lemma_ in ("have", "wear")
        doing = "" if verb.pos_ == "AUX" or has else _gerund(verb)
        last = max((verb, *verb.conjuncts), key=lambda one: one.i).i
        painted, run = (
            _color([*verb.doc[verb.left_edge.i : last + 1]], verb.head) if is_state else ("", [])
        )  # a teapot, blue
        for number in subjects:
            thing = self.things[number]
            at = (*thing.at, *(word.i for word in run or (verb,)))
            does = thing.doing if verb.dep_ != "advmod" or not is_state else ""  # a cat curled up asleep in a basket
            does = does or ("" if painted else doing)
            self.things[number] = replace(thing, at=at, color=thing.color or painted, doing=does)
        for noun in _children(verb, "dobj", "attr", "dative"):
            self._join(subjects, "with" if has else doing or verb.lower_, noun, (verb.i,))

    def _share(self, noun: Token) -> None:
        """Gives a noun the place of the last one joined to it: a teapot and three cups on a table."""
        if noun in self._numbers and _children(noun, "conj", "appos") and not _children(noun, "prep", "acl", "relcl"):
            last = self._joined(noun)[-1]
            alone = ("of", "with", self.things[last].doing)
            places = [one for one in self.relations if one.subject == last and one.word not in alone]
            self.relations += [replace(one, subject=self._numbers[noun]) for one in places]

    def _carry(self, noun: Token) -> None:
        """Puts what somebody has or carries on the part of the body that is said: a woman with a baby on her lap."""
        for where in self.relations if _children(noun, "poss") else ():
            said = f"{where.word} {noun.lemma_}"
            is_on = where.object == self._numbers.get(noun) and kind_of(said) in RIDES
            for one in self.relations if is_on else ():
                if where.subject in (one.subject, one.object) and kind_of(one.word) in ("with", "hold"):
                    ridden = Relation(one.object, said, one.subject, (*one.at, *where.at, noun.i))
                    self.relations = [*(each for each in self.relations if each not in (where, one)), ridden]

    def _join(self, subjects: list[int], said: str, noun: Token, at: tuple[int, ...]) -> None:
        """Adds a relation of each subject to a noun, or a part of its body, and to those joined to it."""
        for part in _children(noun, "det"):
            said, at = (f"{said} {part.lemma_}", (*at, part.i)) if "body" in kinds_of(part.lemma_) else (said, at)
        self.relations += [Relation(one, said, other, at) for one in subjects for other in self._joined(noun)]

    def _joined(self, noun: Token) -> list[int]:
        """Returns the number of a noun, and those of the nouns joined to it by "and"."""
        others = [number for one in _children(noun, "conj", "appos") for number in self._joined(one)]
        return [self._numbers[noun], *others] if noun in self._numbers else others

    def _subjects(self, head: Token) -> list[int]:
        """Returns the things that a preposition or a verb below `head` belongs to, the nearest ones."""
        if head in self._numbers:
            return [self._numbers[head]]
        actors = [word for word in head.lefts if _is_noun(word) and word.dep_ != "dobj"]
        if head.pos_ in ("VERB", "AUX", "ADJ") and actors:
            said = actors[-1].lower_
            is_told = said in _TOLD_OF or (said == "it" and head.lemma_ in ("be", "have"))  # but it rains
            return [0] if is_told and self.things else self._joined(actors[-1])
        above = head.head
        taught = _children(above, "dobj") if head.dep_ == "xcomp" else []  # a father teaching his son to ride
        owners = self._subjects(above.head) if head.dep_ == "acl" and above.dep_ == "pobj" else []
        people = [one for one in owners if "person" in kinds_of(self.things[one].noun)]
        if people and kinds_of(above.lower_) != {"person"}:  # a man in a suit, running
            return people
        if above == head:
            return [0] if head.lower_ in ("it", *_TOLD_OF) and self.things else []
        return self._joined(taught[0]) if taught else self._subjects(above)


def _is_in_a_name(word: Token) -> bool:
    """Returns True if a word is a part of a name; a train that is crossing a bridge, and "a barn, evening" are none."""
    is_apart = word.i > word.head.i and _is_noun(word)
    return word.dep_ in _IN_A_NAME and word.head.pos_ not in ("VERB", "PRON") and not is_apart


def _gerund(verb: Token) -> str:
    """Returns "riding" for "rides" and "rode"; other forms of a verb as they are."""
    if verb.tag_ not in ("VB", "VBZ", "VBP", "VBD"):
        return verb.lower_
    base = verb.lemma_.lower()
    for ending, instead in (("ie$", "y"), ("(?<=[^e])e$", ""), ("^([^aeiou]+[aeiou])([^aeiouwxy])$", r"\1\2\2")):
        stem, changes = re.subn(ending, instead, base)
        if changes:
            return f"{stem}ing"
    return f"{base}ing"


def _is_side(noun: Token) -> bool:
    """Returns True for the place of another thing: strawberries on top, hills in the background, but no red top."""
    is_body = _SIDES.get(noun.lower_, "").endswith(" of")
    is_side = all(word.tag_ == "PRP$" if is_body else word.lower_ in ("the", "both") for word in noun.lefts)
    return noun.lower_ in _SIDES and noun.dep_ == "pobj" and is_side


def _is_owner(noun: Token) -> bool:
    """Returns True for the owner of a thing: the kitchen of my grandparents."""
    owned = noun.dep_ == "pobj" and noun.head.lower_ == "of" and not _is_between(noun.head.head)
    return owned and bool(_children(noun, "poss"))


def _is_between(noun: Token) -> bool:
    """Returns True if a noun is part of a preposition, as in "in front of"."""
    is_bare = noun.dep_ == "pobj" and noun.tag_ == "NN" and noun.n_lefts == 0
    return is_bare and any(word.lower_ == "of" for word in noun.children)


def _describe_noun(noun: Token) -> Thing:
    """Returns the thing of a noun, from the words before it."""
    before = [word for word in noun.subtree if word.i < noun.i and _belongs(word, noun)]
    color, colored = _color(before, noun)
    called = noun
    if noun.lemma_ == "one":  # a black sheep among white ones
        called = next((word for word in reversed(noun.doc[: noun.i]) if word.pos_ == "NOUN"), noun)
    is_name = noun.pos_ == "PROPN" or (noun.tag_ == "NNS" and bool(kind_of_name(noun.text)))  # Mars
    lemma = noun.text if is_name else called.lemma_
    name = " ".join([*(word.text for word in before if word not in colored and not _is_number(word)), lemma])
    if noun.i > 1 and noun.nbor(-1).text == "-" and len(noun.nbor(-2)) == 1:  # a T-Rex
        name = lemma = f"{noun.nbor(-2).text}-{noun.text}"
    numbers = [word for word in noun.lefts if _is_number(word)]
    single = any(word.dep_ == "det" and word.lower_ in ("a", "an") for word in noun.lefts)
    plural = noun.tag_ in ("NNS", "NNPS") and not single and not (is_name and noun.tag_ == "NNS")
    count = _number(numbers[0].lower_) if numbers else None
    count = (_TOGETHER.get(noun.lemma_) if plural else 1) if count is None else count
    said = noun.lower_ if plural and noun.lower_ != lemma.lower() and called == noun else ""
    uncounted = not plural and not numbers and not _children(noun, "det", "poss")
    at = tuple(sorted({noun.i, *(word.i for word in (*before, *numbers))}))
    return Thing(name, lemma, color, count, plural=said, uncounted=uncounted, at=at)


def _belongs(word: Token, noun: Token) -> bool:
    """Returns True if a word before a noun is part of its name, colour or number."""
    return word == noun or (word.dep_ in (*_IN_A_NAME, "conj", "cc") and _belongs(word.head, noun))


def _is_number(word: Token) -> bool:
    return word.dep_ in ("nummod", "quantmod") or word.lower_ in _MANY


def _is_none(word: Token) -> bool:
    return word.lower_ in ("no", "zero", "0")


def _number(word: str) -> int | None:
    """Returns the value of a number in words or digits; None for words such as "many"."""
    return int(word[:4]) if word.isdecimal() else _COUNTS.get(word)


def _children(word: Token, *kinds: str) -> list[Token]:
    return [child for child in word.children if child.dep_ in kinds]


def _is_noun(word: Token) -> bool:
    return word.pos_ in ("NOUN", "PROPN", "PRON") and word.tag_ not in ("WDT", "WP")  # a dog that sits


def _color(words: list[Token], noun: Token) -> tuple[str, list[Token]]:
    """Returns the longest run of words that names a colour of a noun, or colours joined by "and", with those words."""
    runs = [words[first:last] for first in range(len(words)) for last in range(len(words), first, -1)]
    for run in sorted(runs, key=len, reverse=True):
        said = " ".join(word.lower_ for word in run)
        whole = f"{said} {noun.lower_}"  # an apple tree and a pine cone are no colours
        is_named = run[-1].lower_ in COLORS or (
            run[-1].pos_ == "ADJ" and senses_of(whole) == senses_of(whole.rpartition(" ")[2])
        )
        if is_named and all(paint_of(part) is not None for part in said.split(" and ")):
            return said, run
    return "", []


def paint_of(color: str) -> Tensor | None:
    """Returns the sRGB [3] in [0, 1] of a colour's name in the xkcd survey (CC0); None if it is unknown.

    Of "black and white", the first one counts.
    """
    from matplotlib.colors import to_rgb

    try:
        lab = to_lab(torch.tensor(to_rgb(f"xkcd:{color.split(' and ')[0]}")))
    except ValueError:
        return None
    # Paint is less vivid than a screen.
    return from_lab(torch.cat((lab[:1], lab[1:] * min(1.0, _VIVID / max(float(lab[1:].norm()), 1e-6)))))
