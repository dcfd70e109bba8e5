"""Retrieval of pictures for the things of a prompt: by captions, and then by the worth of the candidates."""

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import cv2
import torch
from torch import Tensor

from frida_painter.drawing.compositing import recolor
from frida_painter.drawing.figures import Figure
from frida_painter.drawing.scenery import DrawnScenery
from frida_painter.errors import ImageError
from frida_painter.objectives.encoders.loading import EncoderRegistry
from frida_painter.objectives.encoders.sentence import SentenceEncoder
from frida_painter.objectives.picture_library import PictureLibrary
from frida_painter.palette import to_lab
from frida_painter.words.libraries import PictureFolder, libraries_at_hand
from frida_painter.words.nouns import Sense, kinds_of, noun_of, senses_of
from frida_painter.words.reading import Thing, paint_of, word_meanings
from frida_painter.words.world import is_person

# Worth of a picture, independent of its thing.

_REALISM = 0.6  # bonus of a photograph over a sign
_FLAT = 0.4  # share of realism that a picture of flat areas loses: it is a drawing, whatever its file says
_PLAIN, _COLORLESS = 0.35, 0.7  # penalties: for lines, and for pictures with a ground; for drawings without colour
_COLORFUL = 8.0  # chroma
_MOSTLY = 0.5  # share of equal neighbouring pixels above which a picture is drawn
_SKETCHY = 0.25  # share of its box below which a thing consists of lines only
_FILLED = 0.95  # share of its box above which a picture is a rectangle
_COARSE, _FEW = 0.2, 56  # penalty for few pixels, and those of the longer side that are enough
_PARTED = 0.5  # penalty by the share of a picture that is not its largest piece: a lemon and a half
_HAS_COLOR, _NEAR_COLOR = 0.5, 45.0  # bonus by the share of a wanted colour, and the Lab distance within which it is


def worth_of(picture: Tensor, realism: float) -> float:
    """Returns the worth of a picture: cut-outs above rectangles, photographs above drawings, colours above outlines."""
    seen = picture[3] > 0.5
    if not bool(seen.any()):
        return -1.0
    pairs = seen[:, 1:] & seen[:, :-1]
    same = (picture[:3, :, 1:] == picture[:3, :, :-1]).all(0) & pairs
    flat = float(same.sum()) / max(1, int(pairs.sum()))  # near 0 in photographs, near 1 in signs
    chroma = float(to_lab(picture[:3, seen].T)[:, 1:].norm(dim=1).mean())
    is_colorless = flat > _MOSTLY and chroma < _COLORFUL
    is_plain = float(picture[3].mean()) < _SKETCHY or has_ground(picture)
    coarse = max(0.0, 1 - max(picture.shape[1:]) / _FEW)
    worth = _REALISM * realism * (1 - _FLAT * flat) - _PLAIN * is_plain - _COLORLESS * is_colorless
    return worth - _COARSE * coarse


def _fit_to(thing: Thing, picture: Tensor) -> float:
    """Returns a score for a picture of a thing: high if it has the thing's colour, and low if it is in pieces."""
    seen, paint, score = picture[3] > 0.5, paint_of(thing.color), 0.0
    if thing.count not in (None, 2):
        sizes = cv2.connectedComponentsWithStats(seen.byte().numpy())[2][1:, cv2.CC_STAT_AREA]
        score -= _PARTED * (1 - float(sizes.max(initial=1)) / max(1, int(sizes.sum())))
    if paint is not None and bool(seen.any()):
        for one in (picture, recolor(picture, paint)):  # a bicycle whose frame cannot be red is none to be painted so
            away = (to_lab(one[:3, seen].T) - to_lab(paint)).norm(dim=1)
            score += _HAS_COLOR / 2 * float((away < _NEAR_COLOR).float().mean())
    return score


def has_ground(picture: Tensor) -> bool:
    """Returns True if a picture [4, h, w] is a rectangle with its own ground, not a cut-out."""
    return float(picture[3].mean()) > _FILLED


def is_upright(picture: Tensor) -> bool:
    """Returns True if a picture [4, h, w] of a person probably shows all of them, from head to foot."""
    return picture.shape[1] > _TALL * picture.shape[2]


# Comparison of a picture's title with a thing of a prompt.

_SAYS, _ADDS = 0.2, 0.2  # bonus for each word of the prompt, and penalty for each other word
_REAL = 0.5  # realism above which a picture is a photograph
_ICON = 0.4  # penalty of an icon, which everything with colours goes before
_RATHER = 0.4  # similarity that another word for a thing needs
_KINDS = 4  # number of kinds of an animal or a plant that may stand for it: a bird for a robin, but no animal
_DEEP = 8  # number of kinds above one that is not too general: a bird, but no animal

_BROAD = 5  # the same for a thing that has no picture of its own: a tool, but no object
_OCCASION = 0.15  # penalty for keywords of an idea that the prompt does not have: a pumpkin of Halloween
_MORE = 0.3  # penalty for a picture of several, if a number of them is wanted
_ENDING = 2  # greatest number of an ending's letters: an older woman is old
_FURTHER = re.compile(r"\b(?:of|with|in|on|at|for|and)\b")  # the words after these are not the named thing
OWN = 2.0
"""Bonus in similarity of the user's own picture of a thing."""


def clean_caption(caption: str) -> str:
    """Returns a caption in small letters without article, numbers of files, underscores and brackets."""
    plain = " ".join(re.sub(r"\(.*?\)|(?<=[a-zA-Z])\d+|[^\w' -]+|_", " ", caption).lower().split())
    return re.sub("^(an?|the|another|some|my|our) (pair of )?", "", plain) or caption


def _names(title: str) -> list[str]:
    """Returns the words of a title that name its thing; the last one is the noun."""
    return _FURTHER.split(title)[0].split()


def _spoken(title: str, thing: Thing) -> float:
    """Returns a score for a title: high if it has the prompt's words for the thing, and little else."""
    words = set(title.split())
    wanted = {*thing.name.split(), *thing.color.split(), thing.doing, thing.plural} - {""}
    said = sum(any(word.startswith(one) and len(word) <= len(one) + _ENDING for one in wanted) for word in words)
    said += 2 * any(word in words for word in thing.doing.split())  # who sleeps is not awake
    said -= 2 * any(word.endswith("ing") for word in words - wanted)  # nor who is awake asleep
    is_more = thing.count not in (None, 2) and "".join(_names(title)[-1:]) in (f"{thing.noun}s", thing.plural)
    return _SAYS * said - _ADDS * (len(words) - said) - _MORE * is_more


def _is_modified(title: str, thing: Thing) -> bool:
    """Returns True if a title has the word for another thing: a mountain goat, or an owl on a branch."""
    last = "".join(_names(title)[-1:])
    ends = (thing.noun, f"{thing.noun}s", thing.plural or thing.noun, thing.doing or thing.noun)
    return thing.noun in title and not last.endswith(ends)


def _words_of(senses: Sequence[Sense]) -> set[str]:
    """Returns the words that have one of the senses, and no other."""
    return {word for one in senses for word in one.words if senses_of(word) == [one]}


def _raise(similarity: Tensor, names: Sequence[str], words: set[str], least: float) -> Tensor:
    """Returns similarities [n] of pictures that are at least `least` if their names are among the words.

    The name must be rather similar: a dot is no acid.
    """
    is_named = torch.tensor([name in words for name in names]) & (similarity >= _RATHER)
    return torch.where(is_named, similarity.clamp(min=least), similarity)


def _is_called(title: str, thing: Thing) -> bool:
    """Returns True if a title has the word, or a compound such as sailboat, and no different kind.

    For a washing machine, the title "sewing machine" does not count, but "machine" does.
    """
    kind, wanted = _names(title)[:-1], thing.name.split()[:-1]
    is_kind = not kind or not wanted or any(word.startswith((*wanted, *thing.color.split())) for word in kind)
    ends = (thing.noun, f"{thing.noun}s", thing.plural or thing.noun)
    return is_kind and any(word.endswith(ends) for word in title.split())


_MIN, _MIN_PERSON = 0.58, 0.52  # similarity of a caption to a thing, or a person, below which no picture is better
_LOOKED_AT_FOR_KIND = 60
_ABOUT = 0.7  # similarity above which a person's name is about a thing, and a special kind stands for a thing
_COMPOUND = 0.65  # similarity of a compound to its last word, above which it is one: a stone house (0.67)
_NAMED = 0.8  # similarity above which a caption means the thing, with any words: a duck (0.64) is no goose
_BAND = 0.35  # range of similarity below the best within which pictures are examined
_LOOKED_AT = 14
_UNSURE = 0.04  # difference of similarity to a prompt, within which several senses are meant
_TITLE = 60  # characters of a caption in a message

_COLORED, _SAME = 0.1, 0.95  # greatest bonus for a caption with the colour; similarity above which it has both
_KEYWORD, _AGREED = 0.05, 0.4  # loss of a keyword against a title; share of its similarity whatever the title says
_EXACT = 1.5  # weight of similarity against the look of a picture
_NOUN = 0.35  # weight of a name's last word in its meaning
_CONTEXT = 0.15  # weight of a caption's similarity to the whole prompt

_FROM_HEAD_TO_FOOT, _TALL = 0.3, 1.3  # bonus for a whole figure, by height over width: actors have hands and feet


@dataclass(frozen=True)
class FoundPicture:
    """Picture found for a thing: colour and opacity [4, h, w], its caption and library.

    library: None for a drawn figure
    exact: True if it shows the named thing, False for a similar one
    figure: that the picture shows, with its hand and seat
    """

    thing: Thing
    picture: Tensor
    caption: str
    library: PictureLibrary | None
    exact: bool
    figure: Figure | None = None

    @property
    def several(self) -> bool:
        """True if it shows as many things as requested: flowers, or a pair of scissors."""
        in_one = self.thing.count in (None, 2) and self.thing.plural in self.caption.split()
        return in_one or (self.figure is not None and self.thing.shown > 1)

    @property
    def shown(self) -> int:
        """Number of its copies in a scene."""
        return 1 if self.several else self.thing.shown

    @property
    def colored(self) -> Tensor:
        """The picture, recolored to the prompt's colour unless it already has it."""
        color, paint = self.thing.color, paint_of(self.thing.color)
        named = set(color.split()) <= set(self.caption.split())
        return self.picture if paint is None or " and " in color or named else recolor(self.picture, paint)

    @property
    def told(self) -> str:
        """Description for messages."""
        times = f", {self.shown} times" if self.shown > 1 else ""
        stands = "" if self.exact else f" for {self.thing.name[:_TITLE]!r}"
        by = "drawn" if self.library is None else self.library.name
        return f"{self.caption[:_TITLE]!r} ({by}{times}){stands}"


@dataclass(frozen=True)
class _Entry:
    library: PictureLibrary
    file: str
    captions: list[str]  # the title, and keywords
    realism: float

    @property
    def title(self) -> str:
        return self.captions[0]

    @cached_property
    def names(self) -> list[str]:
        """Words of the title that name its thing; the last one is the noun."""
        return _names(self.title)

    @cached_property
    def noun(self) -> str:
        return noun_of(" ".join(self.names))


class PictureIndex:
    """Index of the captions of several libraries, as embeddings that are computed once and stored in the folder `keep`.

    faults: a sentence for each of the user's pictures that could not be read
    """

    def __init__(self, libraries: Sequence[PictureLibrary], sentences: SentenceEncoder, keep: Path) -> None:
        self._sentences = sentences
        self._entries: list[_Entry] = []
        self.faults: list[str] = []
        parts, rows, owners, before = list[Tensor](), list[int](), list[int](), 0
        for library in libraries:
            known: dict[str, int] = {}  # rows of captions in the matrix of meanings
            for one in library.list_captioned():
                said = [clean_caption(caption) for caption in one.captions]
                rows += [known.setdefault(caption, before + len(known)) for caption in said]
                owners += [len(self._entries)] * len(said)
                self._entries.append(_Entry(library, one.file, said, one.realism))
            parts.append(sentences.embed_once([*known], keep))
            before += len(known)
        self._meanings, self._rows, self._owners = torch.cat(parts), torch.tensor(rows), torch.tensor(owners)
        self._titles = self._rows[self._owners.diff(prepend=torch.tensor([-1])) > 0]

    def find(
        self, thing: Thing, prompt: str, *, cut_out: bool = False, acts: bool = False, kin: bool = False
    ) -> FoundPicture | None:
        """Returns the best picture of a thing, the user's own before all others; None if there is none.

        prompt: whole text, for the context
        cut_out: True to exclude pictures with a ground, and other things with a similar name, except the user's own
        acts: True for somebody who does something or is among others, and should be seen from head to foot
        kin: True to take the nearest thing of the same kind if there is no picture: a flute for an oboe
        """
        thing = _in_small_letters(thing)
        one, several = senses_of(thing.noun), senses_of(thing.plural)
        if several != one and thing.plural and self._meant([*several, *one], f"{prompt}, {thing.plural}")[0] in several:
            thing = replace(thing, name=thing.plural, noun=thing.plural)  # spectacles, not two glasses
        figure, similarity = is_person(thing.name, self._sentences), self._similarity(thing)
        least = _MIN_PERSON if figure else _MIN
        meant = self._meant(senses_of(thing.name), clean_caption(prompt), _UNSURE)
        sure = meant if len(meant) == 1 else []
        synonyms = _words_of(sure) - {thing.noun}
        similarity = _raise(similarity, [entry.noun for entry in self._entries], synonyms, _SAME)
        above = [one for sense in sure for one in sense.kinds[:_KINDS] if len(one.kinds) >= _DEEP]
        living = [one for one in above if one.is_kind_of(senses_of("organism")[0])]
        names = [" ".join(entry.names) for entry in self._entries]
        similarity = _raise(similarity, names, _words_of(living), least)  # a robin is a bird
        context = (self._meanings @ self._sentences.embed([prompt])[0])[self._titles]
        order = (similarity + _CONTEXT * context).argsort(descending=True, stable=True)[:_LOOKED_AT_FOR_KIND].tolist()
        shown = [(self._entries[at], float(similarity[at])) for at in order]
        fits = [self._fits(entry, like, thing, meant, synonyms, prompt, figure=figure) for entry, like in shown]
        near = [at for at, fit in zip(order, fits, strict=True) if similarity[at] >= (least if fit else OWN)]
        near = near or (self._kin(similarity, meant) if kin and not figure else [])
        highest, found, best, seen = -float("inf"), None, 0.0, 0
        for at, picture in self._show(near[: 4 * _LOOKED_AT]):
            entry, like = self._entries[at], float(similarity[at])
            if like < OWN and has_ground(picture) and (cut_out or entry.realism < _REAL):  # a drawn one is a sign
                continue
            best, seen = (like, 1) if found is None else (best, seen + 1)
            if like < best - _BAND or seen > _LOOKED_AT:
                break
            ideas = {word for word in entry.captions[1:] if kinds_of(word) == {"idea"} and word not in prompt.lower()}
            worth = (
                _EXACT * like
                - _OCCASION * bool(ideas)
                - _ICON * (entry.realism == 0 and not (" " in thing.name and entry.title == thing.name))
                + _spoken(entry.title, thing)
                + _CONTEXT * float(context[at])
                + worth_of(picture, entry.realism)
                + _fit_to(thing, picture)
                + _FROM_HEAD_TO_FOOT * (figure and acts and is_upright(picture))
            )
            if worth > highest:
                exact = like >= _NAMED or _is_called(entry.title, thing) or thing.name in entry.captions
                highest, found = worth, FoundPicture(thing, picture, entry.title, entry.library, exact)
        return found

    def _kin(self, similarity: Tensor, meant: Sequence[Sense]) -> list[int]:
        """Returns the pictures of things that are of a kind with one of the senses, the nearest kind first."""
        nouns = [senses_of(entry.noun) if entry.realism else [] for entry in self._entries]
        for kind in (kind for sense in meant for kind in sense.kinds if len(kind.kinds) >= _BROAD):
            same = [at for at, senses in enumerate(nouns) if any(one.is_kind_of(kind) for one in senses[:1])]
            if same:
                return sorted(same, key=lambda at: -float(similarity[at]))[:_LOOKED_AT]
        return []

    def _fits(
        self,
        entry: _Entry,
        like: float,
        thing: Thing,
        meant: Sequence[Sense],
        synonyms: set[str],
        prompt: str,
        *,
        figure: bool,
    ) -> bool:
        """Returns True if a picture may stand for a thing: one of its kind, or of the kind that it is of.

        Only a person stands for a person; a farmer is no farmhouse, and a football player no chess player. An icon has
        no context, so that it needs the same name, and among other things one without abstract senses.

        like: similarity of the picture to the thing
        meant: senses of the thing
        synonyms: other words for just that sense
        figure: True if the thing is a person
        """
        is_called = _is_called(entry.title, thing)
        if entry.realism == 0:
            kinds, is_alone = kinds_of(entry.title), prompt.lower().endswith(thing.name)
            is_plain = bool(senses_of(entry.title)) and (kinds == {"thing"} or (is_alone and "thing" in kinds))
            return is_plain and entry.title in (thing.name, thing.noun, thing.plural, *synonyms)
        if entry.noun in synonyms:
            return True
        if _is_modified(entry.title, thing):
            return False  # an owl on a branch is no branch
        if figure:
            return is_called or (is_person(entry.title, self._sentences) and entry.names[-1:] != [thing.noun])
        kind = thing.name.split()[-2:]
        if len(kind) > 1:
            whole, title = self._sentences.embed([" ".join(kind), entry.title])
            alike = float(whole @ title)
            if is_called and alike >= _NAMED:
                return True
            if senses_of(kind[0]) and alike < _COMPOUND:
                return False  # a box is no lunch box
        shown = self._meant(senses_of(" ".join(entry.names)), entry.title)
        if meant and shown:
            is_same = like >= _NAMED and any(thing.noun in one.words for one in shown)  # a couch is a sofa
            is_special = like >= _ABOUT and any(one.is_kind_of(other) for one in shown for other in meant)
            return is_same or is_special or any(other.is_kind_of(one) for one in shown for other in meant)
        is_head = thing.noun.endswith(entry.title)  # a campfire is a fire
        return is_called or is_head or (like >= _ABOUT and thing.name in entry.captions)

    def _meant(self, senses: list[Sense], text: str, unsure: float = 0.0) -> list[Sense]:
        """Returns those of some senses that a text probably means: a board with bread on it is no game.

        unsure: difference of similarity to the text, within which several are meant
        """
        if len(senses) < 2 or text in senses[0].words:
            return senses
        said = [", ".join((*one.words, *(one.above.words[:2] if one.above else ()))) for one in senses]
        likely = self._sentences.embed(said) @ self._sentences.embed([text])[0]
        return [one for one, like in zip(senses, likely, strict=True) if like >= likely.max() - unsure]

    def _show(self, entries: Iterable[int]) -> Iterator[tuple[int, Tensor]]:
        """Yields the variants of pictures; those that cannot be read are left out."""
        for at in entries:
            entry = self._entries[at]
            try:
                yield from ((at, picture) for picture in entry.library.pictures(entry.file))
            except ImageError as fault:
                if entry.library.is_own:
                    self.faults.append(str(fault))

    def nearest(self, thing: Thing) -> float:
        """Returns the similarity of the most similar caption to a thing; at least `OWN` for a picture of the user's."""
        return float(self._similarity(_in_small_letters(thing)).max())

    def _similarity(self, thing: Thing) -> Tensor:
        """Returns the similarity of each picture's title to a thing [n], and more for the user's own pictures of it.

        Their names need only have the word.
        """
        similarity, nouns = self._titled(thing), {thing.noun, thing.plural} - {""}
        for at, entry in enumerate(self._entries):
            if entry.library.is_own and (similarity[at] >= _NAMED or nouns & {*entry.names}):
                similarity[at] += OWN
        return similarity

    def _titled(self, thing: Thing) -> Tensor:
        """Returns the similarity of each picture's title to a thing [n]: to its name, or one with its other words."""
        also = [f"{thing.doing} {thing.name}"] if thing.doing else []
        if thing.plural and thing.count in (None, 2):
            also.append(f"{thing.name.removesuffix(thing.noun)}{thing.plural}")
        called = torch.stack([self._similar(words) for words in (thing.name, *also)]).amax(0)
        if thing.color:
            colored = self._similar(f"{thing.color} {thing.name}")
            bounded = torch.where(colored >= _SAME, colored + _COLORED, colored.minimum(called + _COLORED))
            called = called.maximum(bounded)
        if thing.noun == thing.name:
            return called
        # An older man is a man; but a slot machine is no sewing machine.
        is_one = torch.tensor([entry.names[-1:] == [thing.noun] for entry in self._entries])
        noun = self._similar(thing.noun).masked_fill(is_one & (called >= _MIN), 1)
        return (1 - _NOUN) * called + _NOUN * noun

    def _similar(self, words: str) -> Tensor:
        """Returns the similarity of words to each picture: the title's, or a keyword's, weighted by the title's."""
        similar = self._meanings @ self._sentences.embed([words])[0]
        title = similar[self._titles]
        keyword = title.scatter_reduce(0, self._owners, similar[self._rows] - _KEYWORD, "amax")
        return torch.maximum(title, keyword * (_AGREED + (1 - _AGREED) * title))


def picture_index(encoders: EncoderRegistry) -> PictureIndex | None:
    """Returns the index of all available libraries; None, with a remark on how to get one, if there is none."""

    def make() -> PictureIndex | None:
        libraries = libraries_at_hand(encoders.cache, encoders.own_pictures())
        if not libraries:
            encoders.remark("Better begun from pictures: frida-painter models fetch words")
            return None
        unnamed = sum(one.unnamed for one in libraries if isinstance(one, PictureFolder))
        if unnamed:
            encoders.remark(
                f"{unnamed} of your pictures were left out, of which neither a name nor a text beside them says in "
                "Latin letters what they show."
            )
        return PictureIndex([*libraries, DrawnScenery()], word_meanings(encoders), encoders.meanings)

    return encoders.keep("picture index", make)


def _in_small_letters(thing: Thing) -> Thing:
    """Returns the thing in the small letters of captions: the Eiffel Tower is the eiffel tower."""
    return replace(thing, name=thing.name.lower(), noun=thing.noun.lower(), plural=thing.plural.lower())
