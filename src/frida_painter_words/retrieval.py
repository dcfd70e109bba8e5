"""Retrieval of pictures by their captions. A picture stands for a thing only if its caption names that thing."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import torch
from torch import Tensor

from frida_painter.errors import ImageError
from frida_painter.objectives.encoders.base import PictureLibrary
from frida_painter.objectives.encoders.loading import EncoderRegistry
from frida_painter.objectives.encoders.sentence import SentenceEncoder
from frida_painter_words.libraries import GROUND, KINDS, MOOD, PictureFolder, libraries_at_hand
from frida_painter_words.reading import OLD, Phrase, Reading, contents, noun_of, read_phrase, singular, stem

_SAME = 0.845  # similarity of two nouns from which they mean the same: couch and sofa, but not waiter and waitress
_SAME_MOOD, _NEAR_MOOD = 0.7, 0.5  # similarity from which a mood is what a prompt says, and is like one of its things
_ABOUT = 0.42  # similarity of names from which two things with the same noun are alike: no hot dog for a dog
_LIKE, _SAID, _ADDED = 1.0, 0.1, 0.12  # score by similarity, for each word that both say, and loss for an added one
_OWN, _LATER = 2.0, 0.06  # bonus of the person's own pictures, and loss for each library that comes before
_READ = 48  # captions that are compared with the words, of those that name the thing
_PEOPLE = frozenset(("man", "woman", "boy", "girl", "child", "person", "coupl", "lady", "gentleman"))
_KINDS_OF = {"child": ("boy", "girl"), "kid": ("child", "boy", "girl"), "person": ("man", "woman", "boy", "girl")}
_FILLED = 0.95  # share of its box above which a picture has a ground of its own


class Caption(NamedTuple):
    """Title of a picture, `text`. kind: its folder if all its captions are titles, otherwise "".

    titles, says: all titles of the picture, and the stems of their words
    bonus: part of the score that does not depend on the prompt
    """

    text: str
    phrase: Phrase
    library: PictureLibrary
    file: str
    kind: str
    titles: tuple[str, ...]
    says: frozenset[str]
    bonus: float


class FoundPicture(NamedTuple):
    """Picture found for a phrase, [4, h, w]. similar: True for a like thing, another kind of it, or several for one."""

    picture: Tensor
    caption: Caption
    similar: bool = False

    @property
    def has_ground(self) -> bool:
        """True for a rectangle with its own ground, False for a cut-out."""
        return float(self.picture[3].mean()) > _FILLED


def clean_caption(caption: str) -> str:
    """Returns a caption in small letters without numbers of files, underscores and brackets."""
    return " ".join(re.sub(r"\(.*?\)|(?<=[a-zA-Z])\d+|[^\w' -]+|_", " ", caption).lower().split()) or caption.lower()


class PictureIndex:
    """Index of the captions of several libraries, with embeddings that are computed once in the folder `keep`.

    tell: receives a sentence for each of the person's pictures that cannot be used
    """

    def __init__(
        self, libraries: Sequence[PictureLibrary], sentences: SentenceEncoder, keep: Path, tell: Callable[[str], None]
    ) -> None:
        self._sentences, self._keep, self._tell = sentences, keep, tell
        listed = list[tuple[tuple[str, ...], PictureLibrary, str, str, float]]()
        for place, library in enumerate(libraries):
            for file, captions in library.captions().items():
                kind = next((kind for kind in KINDS if file.startswith(f"{kind}/")), "")
                # Keywords after a title may name anything in a picture, or nothing.
                titles = (*map(clean_caption, captions if kind else captions[:1]),)
                listed.append((titles, library, file, kind, _OWN * library.is_own - _LATER * place))
        self._nouns = {noun_of(title) for titles, _, _, kind, _ in listed if kind != MOOD for title in titles}
        self._captions: list[Caption] = []
        self._by_noun = defaultdict[str, list[Caption]](list)
        for titles, library, file, kind, bonus in listed:
            says = contents(" ".join(titles))
            for title in titles:
                phrase = read_phrase(title.split(), self.knows)
                self._captions.append(Caption(title, phrase, library, file, kind, titles, says, bonus))
                self._by_noun[phrase.noun].append(self._captions[-1])

    def knows(self, word: str) -> bool:
        """Returns True if a word is the noun of a title."""
        return singular(word.lower()) in self._nouns

    def find_subject(self, phrase: Phrase, reading: Reading) -> FoundPicture | None:
        """Returns the best picture of a subject; None if no caption names it, or a ground or a mood does."""
        wanted, similar = contents(phrase.proper) or {phrase.noun}, False
        named = [one for one in self._captions if one.library.is_own and wanted <= one.says]
        if not self._names_scene(phrase):
            nouns = (phrase.noun, *_KINDS_OF.get(phrase.noun, ()))
            named += [one for noun in nouns for one in self._called(noun, phrase)]
            if not phrase.name:  # dancing
                named += [one for one in self._captions if one.kind and phrase.noun in one.says]
            part = phrase.part  # oranges may stand for a bowl of them, but no hot springs for a day of spring
            if part.noun and not self._names_scene(part):
                named += [one for one in self._by_noun[part.noun] if contents(one.phrase.name) == contents(part.name)]
            if not named and not phrase.proper:
                named = self._by_noun[self._same_noun(phrase.noun)]
                similar = bool(named)
        named = [one for one in named if one.kind not in (GROUND, MOOD)]
        fitting = [one for one in named if one.library.is_own or not _is_several(one, phrase)]
        found = self._best(fitting or named, reading, " ".join(phrase.words))
        kinds = {phrase.part.noun, *(stem(word) for word in phrase.name[-2:-1] if self.knows(word))}  # a sea lion
        return found and found._replace(
            similar=similar or _is_several(found.caption, phrase) or not kinds <= {"", *found.caption.says}
        )

    def find_ground(self, reading: Reading, others: Sequence[str] = ()) -> FoundPicture | None:
        """Returns the best ground for a prompt; None if no caption has its place, its light or its weather.

        others: words of subjects besides their names, which may name a place too: a train crossing a bridge
        """
        grounds = [one for one in self._captions if one.kind == GROUND]
        files = {one.file for one in grounds if one.phrase.noun in reading.places | contents(others)}
        named = [one for one in grounds if one.file in files]
        return self._best(named or [one for one in grounds if reading.places & one.says], reading)

    def find_mood(self, reading: Reading, *, is_said: bool = False) -> FoundPicture | None:
        """Returns the mood that is nearest to a prompt. is_said: True for one that means what the prompt says."""
        moods = [one for one in self._captions if one.kind == MOOD]
        like = self._similar([one.text for one in moods], [reading.text], once=True)
        if not moods or (is_said and float(like.max()) < _SAME_MOOD):
            return None
        return self._best([moods[int(like.argmax())]], reading)

    def is_like(self, mood: Caption, phrase: Phrase) -> bool:
        """Returns True if a title of a mood is near to the thing of a phrase, and one to its whole name."""
        said = (" ".join(phrase.name), *phrase.name[-1:])
        return all(float(self._similar(mood.titles, [one]).max()) >= _NEAR_MOOD for one in said)

    def _names_scene(self, phrase: Phrase) -> bool:
        """Returns True if a ground has the noun of a phrase, or a mood is called by all of it."""
        called, name = self._by_noun[phrase.noun], contents(phrase.name)
        return not phrase.proper and any(
            one.kind == GROUND or (one.kind == MOOD and contents(one.phrase.words) == name) for one in called
        )

    def _called(self, noun: str, phrase: Phrase) -> list[Caption]:
        """Returns the captions of a noun, that of a phrase or of a kind of its thing, that name the phrase.

        A proper name needs all its words. An old man is another person than a man, and a slice of cake another slice.
        """
        is_old, part = not OLD.isdisjoint(phrase.words), phrase.part.noun
        named = [one for one in self._by_noun[noun] if part in ("", *one.says) or len(contents(one.phrase.words)) == 1]
        if phrase.proper:
            return [one for one in named if contents(phrase.proper) <= contents(one.phrase.words)]
        if noun in _PEOPLE:
            named = [one for one in named if is_old != OLD.isdisjoint(one.phrase.words)]
        called = {one: " ".join(one.phrase.name or one.phrase.words) for one in named}
        names, name = sorted({*called.values()}), " ".join(phrase.name or phrase.words)
        like = dict(zip(names, self._similar(names, [name]).tolist(), strict=True))
        same = {one for one in names if contents(one) == contents(name) or like[one] >= _ABOUT}
        return [one for one in named if noun != phrase.noun or called[one] in same]

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

    def _best(self, named: Sequence[Caption], reading: Reading, words: str = "") -> FoundPicture | None:
        """Returns the best picture that can be read, by its caption; none that says what must not be seen.

        words: of the prompt, that count most; "" for all
        """
        queries, asked, absent = [words or reading.text, reading.text], contents(reading.text), contents(reading.absent)
        scores: dict[Caption, float] = {}
        for one in named:
            if not absent & one.says:
                said = _SAID * (len(one.says & asked) + len(one.says & contents(queries[0])))
                scores[one] = one.bonus + said - _ADDED * len(contents(one.phrase.words) - asked)
        likely = sorted(scores, key=lambda one: -scores[one])[:_READ]
        for one, like in zip(likely, self._similar([one.text for one in likely], queries).tolist(), strict=True):
            scores[one] += _LIKE * like
        for one in sorted(likely, key=lambda one: -scores[one]):
            try:
                return FoundPicture(one.library.picture(one.file), one)
            except ImageError as fault:
                if one.library.is_own:
                    self._tell(f"Of your own pictures one cannot be used: {fault}")
        return None


def _is_several(caption: Caption, phrase: Phrase) -> bool:
    """Returns True if a caption says several things and a phrase one."""
    is_part = caption.phrase.noun == phrase.part.noun
    same = caption.phrase.count == 1 or caption.phrase.name[-1:] == phrase.name[-1:]  # a lens
    return phrase.count == 1 and not is_part and not same


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
        return PictureIndex(libraries, encoders.sentences(), encoders.meanings, encoders.remark)

    return encoders.keep("picture index", make)
