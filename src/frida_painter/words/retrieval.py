"""Retrieval of pictures by their captions. A picture stands for a thing only if its caption names that thing."""

from __future__ import annotations

import math
import re
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import dropwhile, takewhile
from pathlib import Path

import torch
from torch import Tensor

from frida_painter.errors import ImageError
from frida_painter.objectives.encoders.loading import EncoderRegistry
from frida_painter.objectives.encoders.sentence import SentenceEncoder
from frida_painter.objectives.picture_library import PictureLibrary
from frida_painter.palette import to_lab
from frida_painter.words.libraries import GROUND, MOOD, SHIPPED, PictureFolder, libraries_at_hand
from frida_painter.words.reading import (
    AGES,
    COLORS,
    FUNCTION_WORDS,
    Phrase,
    Reading,
    contents,
    read_phrase,
    singular,
    stem,
)

_SAME = 0.845  # similarity of two nouns from which they mean the same: couch and sofa, but not waiter and waitress
SAME_MOOD = 0.7
"""Similarity from which a mood is what a prompt says."""
_ABOUT = 0.42  # similarity of names from which two things with the same noun are alike: no hot dog for a dog
_LIKE, _SAID, _ADDED = 0.4, 0.1, 0.12  # score by similarity, for each word that both say, and loss for an added one
_BAND, _LOOKED_AT = 0.35, 8  # of scores: difference within which pictures compete, and their greatest number
_READ = 48  # captions that are compared with the words, of those that name the thing
_WORTH = 0.4  # weight of a picture's worth in its score
_OURS = 0.1  # the same of the shipped library's
_OWN = 2.0  # bonus of the person's own pictures
_PEOPLE = frozenset(("man", "woman", "boy", "girl", "child", "person", "coupl", "lady", "gentleman"))
_KINDS = {"child": ("boy", "girl"), "kid": ("child", "boy", "girl"), "person": ("man", "woman", "boy", "girl"),
          "somebody": ("man", "woman"), "someon": ("man", "woman"), "lady": ("woman",)}  # fmt: skip
"""Stems of nouns for people of several kinds, and those kinds."""

# Worth of a picture, independent of its thing.

_REALISM = 0.6  # bonus of a photograph over a sign
_FLAT = 0.4  # share of realism that a picture of flat areas loses: it is a drawing, whatever its file says
_GROUNDED, _LINES, _COLORLESS = 0.35, 0.8, 0.7  # penalties for a ground, for lines, and for drawings without colour
_COLORFUL = 8.0  # chroma
_MOSTLY = 0.5  # share of equal neighbouring pixels above which a picture is drawn
_SKETCHY = 0.25  # share of its box below which a thing consists of lines only
_FILLED = 0.95  # share of its box above which a picture is a rectangle
_COARSE, _FEW = 0.4, 200  # penalty for few pixels, and those of the longer side that are enough


def worth_of(picture: Tensor, realism: float) -> float:
    """Returns the worth of a picture: cut-outs above rectangles, photographs above drawings, colours above outlines."""
    seen = picture[3] > 0.5
    if not bool(seen.any()):
        return -1.0
    pairs = seen[:, 1:] & seen[:, :-1]
    same = (picture[:3, :, 1:] == picture[:3, :, :-1]).all(0) & pairs
    flat = float(same.sum()) / max(1, int(pairs.sum()))  # near 0 in photographs, near 1 in signs
    chroma = float(to_lab(picture[:3, seen].T[::7])[:, 1:].norm(dim=1).mean())
    is_colorless = flat > _MOSTLY and chroma < _COLORFUL
    is_lines = float(picture[3].mean()) < _SKETCHY
    coarse = max(0.0, 1 - max(picture.shape[1:]) / _FEW)
    worth = _REALISM * realism * (1 - _FLAT * flat) - _COLORLESS * is_colorless
    return worth - _LINES * is_lines - _GROUNDED * has_ground(picture) - _COARSE * coarse


def has_ground(picture: Tensor) -> bool:
    """Returns True if a picture [4, h, w] is a rectangle with its own ground, not a cut-out."""
    return float(picture[3].mean()) > _FILLED


@dataclass(frozen=True)
class FoundPicture:
    """Picture found for a phrase: colour and opacity [4, h, w], its caption and library.

    says: stems of the words of all its captions
    similar: True if its noun is another word of the same meaning
    """

    picture: Tensor
    caption: str
    library: PictureLibrary
    says: frozenset[str]
    similar: bool = False


@dataclass(frozen=True)
class _Caption:
    """Caption of a picture. kind: `GROUND`, `MOOD` or another folder of the shipped library; "" in other libraries.

    says: stems of the words of all captions of the picture
    """

    text: str
    phrase: Phrase
    library: PictureLibrary
    file: str
    realism: float
    kind: str
    says: frozenset[str]


def clean_caption(caption: str) -> str:
    """Returns a caption in small letters without numbers of files, underscores and brackets."""
    plain = " ".join(re.sub(r"\(.*?\)|(?<=[a-zA-Z])\d+|[^\w' -]+|_", " ", caption).lower().split())
    return plain or caption.lower()


def _noun_of(title: str) -> str:
    """Returns the noun of a title in the singular: its last word before a preposition, an article or a verb in -ing."""
    words = list(dropwhile(FUNCTION_WORDS.__contains__, title.split()))
    named = list(takewhile(lambda word: word not in FUNCTION_WORDS, words))
    while len(named) > 1 and named[-1].endswith("ing"):
        named.pop()
    return singular(named[-1]) if named else ""


class PictureIndex:
    """Index of the captions of several libraries.

    keep: folder of embeddings that are computed once
    faults: a sentence for each of the person's pictures that could not be read
    """

    def __init__(self, libraries: Sequence[PictureLibrary], sentences: SentenceEncoder, keep: Path) -> None:
        self._sentences, self._keep = sentences, keep
        self.faults: list[str] = []
        listed = [(library, one) for library in libraries for one in library.list_captioned()]
        # Keywords after the title of other libraries may name anything in a picture, or nothing.
        texts = [one.captions[: None if library.name == SHIPPED else 1] for library, one in listed]
        things = (several for several, (_, one) in zip(texts, listed, strict=True) if not one.file.startswith(MOOD))
        self._nouns = {_noun_of(clean_caption(text)) for several in things for text in several}
        self._captions: list[_Caption] = []
        self._by_noun = defaultdict[str, list[_Caption]](list)
        for (library, one), several in zip(listed, texts, strict=True):
            kind = one.file.partition("/")[0] if library.name == SHIPPED else ""
            says = contents(clean_caption(" ".join(several)))
            for text in map(clean_caption, several):
                phrase = read_phrase(text.split(), self.knows)
                self._captions.append(_Caption(text, phrase, library, one.file, one.realism, kind, says))
                self._by_noun[phrase.noun].append(self._captions[-1])

    def knows(self, word: str) -> bool:
        """Returns True if a word is the noun of a title."""
        return singular(word) in self._nouns

    def names_scene(self, phrase: Phrase) -> bool:
        """Returns True if a ground has the noun of a phrase, or a mood is called by all of it."""
        called = self._by_noun[phrase.noun] if not phrase.proper else []
        name = contents(phrase.name)
        return any(one.kind == GROUND or (one.kind == MOOD and one.phrase.content == name) for one in called)

    def find_subject(self, phrase: Phrase, reading: Reading) -> FoundPicture | None:
        """Returns the best picture of a subject; None if no caption names it, or a ground or a mood does."""
        wanted, other = contents(phrase.proper) or {phrase.noun}, ""
        named = [one for one in self._captions if one.library.is_own and wanted <= one.says]
        if not self.names_scene(phrase):
            nouns = filter(None, (phrase.noun, *_KINDS.get(phrase.noun, ())))
            named += [one for noun in nouns for one in self._by_noun[noun] if self._names(one.phrase, phrase)]
        part = phrase.part  # oranges may stand for a bowl of them, but no hot springs for a day of spring
        if part.noun and not self.names_scene(part):
            named += [one for one in self._by_noun[part.noun] if contents(one.phrase.name) == contents(part.name)]
        if not phrase.name and phrase.noun:  # dancing
            named += [one for one in self._captions if phrase.noun in one.says]
        if not named and not phrase.proper and not self.names_scene(phrase):
            other = self._same_noun(phrase.noun)
            named += self._by_noun[other] if other else []
        things = [one for one in named if one.kind not in (GROUND, MOOD)]
        return self._best(things, [phrase.text, reading.text], phrase.content, reading, similar=bool(other))

    def find_ground(self, words: str, reading: Reading) -> FoundPicture | None:
        """Returns the best ground for words; None if no caption has their place, light or weather."""
        wanted = contents(words) - {*map(stem, COLORS)}
        grounds = [
            one
            for one in self._captions
            if one.kind == GROUND
            and (one.phrase.noun in wanted or wanted & one.phrase.content - contents(one.phrase.name))
        ]
        return self._best(grounds, [words, reading.text], wanted, reading)

    def find_mood(self, reading: Reading, least: float = -1.0) -> FoundPicture | None:
        """Returns the mood that is nearest to a prompt; None if none has the similarity `least`."""
        moods = [one for one in self._captions if one.kind == MOOD]
        like = self._similar([one.text for one in moods], [reading.text], once=True)
        if not moods or float(like.max()) < least:
            return None
        return self._best([moods[int(like.argmax())]], [reading.text], frozenset(), reading)

    def _names(self, caption: Phrase, phrase: Phrase) -> bool:
        """Returns True if a caption of the right noun, or of a kind of its thing, names a phrase.

        A proper name needs all its words. An old man is another person than a man.
        """
        if phrase.proper:
            return contents(phrase.proper) <= caption.content
        if phrase.noun in _PEOPLE and {*AGES} & {*phrase.name} and not {*AGES} & {*caption.words}:
            return False
        if contents(caption.name) == contents(phrase.name) or caption.noun != phrase.noun:
            return True
        names = [" ".join(one.name) or one.text for one in (phrase, caption)]
        return float(self._similar(names[:1], names[1:])) >= _ABOUT

    def _same_noun(self, noun: str) -> str:
        """Returns the noun of a caption that means the same; "" if there is none."""
        known = sorted(self._nouns)
        if not noun or not known:
            return ""
        like = self._similar(known, [noun], once=True)
        other = known[int(like.argmax())]
        is_derived = other.startswith(noun) or noun.startswith(other)  # a violinist is no violin
        return stem(other) if float(like.max()) >= _SAME and not is_derived else ""

    def _similar(self, texts: Sequence[str], queries: Sequence[str], *, once: bool = False) -> Tensor:
        """Returns the similarity of each text to the nearest query [n]; once: True to keep the texts' embeddings."""
        if not texts:
            return torch.zeros(0)
        read = self._sentences.embed_once(texts, self._keep) if once else self._sentences.embed(texts)
        return (read @ self._sentences.embed(queries).T).amax(1)

    def _best(
        self, named: Sequence[_Caption], queries: Sequence[str], wanted: frozenset[str], reading: Reading, *,
        similar: bool = False,
    ) -> FoundPicture | None:  # fmt: skip
        """Returns the best picture by its caption and its worth; none that says what must not be seen.

        wanted: stems of the words that it should say
        Pictures that cannot be read are left out.
        """
        asked, absent = contents(reading.text), contents(reading.absent)
        scores: dict[_Caption, float] = {}
        for one in named:
            if not absent & one.says:
                said, own = one.phrase.content, _OWN * one.library.is_own
                scores[one] = own + _SAID * (len(said & asked) + len(said & wanted)) - _ADDED * len(said - asked)
        likely = sorted(scores, key=lambda one: -scores[one])[:_READ]
        for one, like in zip(likely, self._similar([one.text for one in likely], queries).tolist(), strict=True):
            scores[one] += _LIKE * like
        likely.sort(key=lambda one: -scores[one])
        found, highest, seen = None, -math.inf, set[str]()
        for one in likely:
            if one.file in seen:
                continue
            if len(seen) == _LOOKED_AT or (seen and scores[one] < scores[likely[0]] - _BAND):
                break
            try:
                picture = one.library.pictures(one.file)[0]
            except ImageError as fault:
                self.faults += [str(fault)] if one.library.is_own else []
                continue
            seen.add(one.file)
            score = scores[one] + (_OURS if one.kind else _WORTH * worth_of(picture, one.realism))
            if score > highest:
                found, highest = FoundPicture(picture, one.text, one.library, one.says, similar), score
        return found


def picture_index(encoders: EncoderRegistry) -> PictureIndex:
    """Returns the index of all libraries at hand, which is made once."""

    def make() -> PictureIndex:
        libraries = libraries_at_hand(encoders.cache, encoders.own_pictures())
        unnamed = sum(one.unnamed for one in libraries if isinstance(one, PictureFolder))
        if unnamed:
            encoders.remark(
                f"{unnamed} of your pictures were left out, of which neither a name nor a text beside them says in "
                "Latin letters what they show."
            )
        return PictureIndex(libraries, encoders.sentences(), encoders.meanings)

    return encoders.keep("picture index", make)
