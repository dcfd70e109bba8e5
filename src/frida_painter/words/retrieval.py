"""Retrieval of pictures for the things of a prompt: by captions, and then by the look of the candidates."""

import itertools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from frida_painter.errors import ImageError
from frida_painter.objectives.encoders.classifiers import has_class, kin, synonyms
from frida_painter.objectives.encoders.loading import EncoderRegistry
from frida_painter.objectives.encoders.sentence import SentenceEncoder
from frida_painter.palette import to_lab
from frida_painter.words.arrangement import is_person
from frida_painter.words.compositing import lay, muted_color, recolor
from frida_painter.words.libraries import PictureFolder, PictureLibrary, libraries_at_hand
from frida_painter.words.reading import (
    SEVERAL,
    Thing,
    clean_caption,
    in_small_letters,
    is_called,
    is_modified,
    split_title,
    spoken,
    word_meanings,
)

# Appearance of a picture, independent of its thing: its worth as a start of a painting.

_REALISM = 0.6  # bonus of a photograph over a sign
_OWN = 0.3  # bonus of the user's own picture
_FLAT = 0.4  # share of realism that a picture of flat areas loses: it is a drawing, whatever its file says
_PLAIN, _COLORLESS = 0.25, 0.7  # penalties: for lines, and for pictures with a ground; for drawings without colour
_COLORFUL = 8.0  # chroma
_BLACK, _SILHOUETTE = 12.0, 0.4  # L* of black, and its share of a picture that makes a silhouette
_SKETCHY = 0.25  # share of its box below which a thing consists of lines only
_MOSTLY = 0.5  # share of equal neighbouring pixels above which a picture is drawn
_FILLED = 0.95  # share of its box above which a picture is a rectangle


def is_colorless(picture: Tensor) -> bool:
    """Returns True if a picture [4, h, w] is a drawing without colour: an outline, or a silhouette."""
    lab = to_lab(picture[:3, picture[3] > 0.5].T)
    black, chroma = float((lab[:, 0] < _BLACK).float().mean()), float(lab[:, 1:].norm(dim=1).mean())
    return len(lab) == 0 or (_flatness(picture) > _MOSTLY and (chroma < _COLORFUL or black > _SILHOUETTE))


def appearance(picture: Tensor, realism: float, *, is_own: bool) -> float:
    """Returns the worth of a picture before comparison: cut-outs above rectangles, colours above outlines."""
    if not bool((picture[3] > 0.5).any()):
        return -1.0
    worth = _REALISM * realism * (1 - _FLAT * _flatness(picture))
    if is_own:
        return worth + _OWN
    lines = float(picture[3].mean()) < _SKETCHY
    return worth - _PLAIN * (lines + has_ground(picture)) - _COLORLESS * is_colorless(picture)


def has_ground(picture: Tensor) -> bool:
    """Returns True if a picture [4, h, w] is a rectangle with its own ground, not a cut-out."""
    return float(picture[3].mean()) > _FILLED


def is_upright(picture: Tensor) -> bool:
    """Returns True if a picture [4, h, w] of a person probably shows all of them, from head to foot."""
    return picture.shape[1] > _TALL * picture.shape[2]


def _flatness(picture: Tensor) -> float:
    """Returns the share of equal neighbouring pixels in a thing [4, h, w]: near 0 in photographs, near 1 in signs."""
    opaque = picture[3] > 0.98
    pairs = opaque[:, 1:] & opaque[:, :-1]
    same = (picture[:3, :, 1:] == picture[:3, :, :-1]).all(0)
    return float((same & pairs).sum()) / max(1, int(pairs.sum()))


_MIN = 0.6  # similarity of a caption to a thing below which it means something else, and no picture is better
_MIN_PERSON = 0.5  # the same for a person; only a person can replace one
_LOOKED_AT_FOR_KIND = 60
_KIN = 0.42  # least worth of a relative, as similarity
_NAMED = 0.8  # similarity above which a caption means the thing, with any words: a duck (0.64) is no goose
_FARTHER_KIN = 0.005  # loss for each living thing that is more similar
_AGREES = 0.35  # similarity to the prompt's own words that a synonym's caption needs
_BAND = 0.25  # range of similarity below the best within which pictures are examined
_LOOKED_AT = 9

_EXACT = 1.5  # weight of similarity against the look of a picture
_KEYWORD = 0.05  # loss of a keyword against a title
_COLORED = 0.1  # greatest bonus for a caption with the colour
_SAME = 0.95  # similarity of a caption to name and colour above which it has both
_AGREED = 0.4  # share of a keyword's similarity that does not depend on the title
_NOUN = 0.35  # weight of a name's last word in its meaning
_CONTEXT = 0.15  # weight of a caption's similarity to the whole prompt

_NEARER, _FARTHER = 0.4, 0.25  # greatest bonus and penalty for the look, against a bare ground
_UNCLASSED = 0.3  # factor of that if the networks have no class for the noun
_FROM_HEAD_TO_FOOT, _TALL = 0.3, 1.3  # bonus for a whole figure, by height over width: actors have hands and feet
_UNTOLD = 0.6  # penalty for a requested colour in a picture with a ground, which cannot be recolored
_SPEAKS = 0.45  # similarity of a caption to one of several things that it shows
_LOOKED_AT_FOR_COLOR = 40
_MODELLED = 0.3  # realism above which a picture has the true colours of its thing
_GROUND = (0.93, 0.92, 0.88)
_LOOK = 160  # pixels


@dataclass(frozen=True)
class FoundPicture:
    """Picture found for a thing.

    picture: colour and opacity [4, h, w]
    caption: of the picture
    library: which has the picture
    similarity: of the caption to the thing
    exact: True if it shows the named thing, False for a similar one
    several: True if it shows as many things as requested
    others: further pictures of the same thing, if several are wanted
    """

    picture: Tensor
    caption: str
    library: PictureLibrary
    similarity: float
    exact: bool
    several: bool = False
    others: tuple[Tensor, ...] = ()


@dataclass(frozen=True)
class _Entry:
    library: PictureLibrary
    file: str
    title: str
    keywords: tuple[str, ...]
    rows: tuple[int, ...]  # rows of its captions in the matrix of meanings, the title's first
    realism: float

    @property
    def kind(self) -> tuple[str, str, float]:
        """Key of pictures that look alike: library, title and realism."""
        return self.library.name, self.title, self.realism


class PictureIndex:
    """Index of the captions of several libraries, as embeddings that are computed once and stored in the folder `keep`.

    faults: a sentence for each of the user's pictures that could not be read
    """

    def __init__(self, libraries: Sequence[PictureLibrary], sentences: SentenceEncoder, keep: Path) -> None:
        self._sentences = sentences
        self._entries: list[_Entry] = []
        self._meanings = torch.zeros(0, 1)
        self.faults: list[str] = []
        parts: list[Tensor] = []
        before = 0
        for library in libraries:
            captioned = library.list_captioned()
            said = list(dict.fromkeys(clean_caption(caption) for one in captioned for caption in one.captions))
            at = {caption: before + number for number, caption in enumerate(said)}
            for one in captioned:
                rows = tuple(at[clean_caption(caption)] for caption in one.captions)
                title, *keywords = map(clean_caption, one.captions)
                self._entries.append(_Entry(library, one.file, title, tuple(keywords), rows, one.realism))
            parts.append(sentences.embed_once(said, keep))
            before += len(said)
        self._meanings = torch.cat(parts)
        longest = max(len(entry.rows) for entry in self._entries)
        self._titles = torch.tensor([entry.rows[0] for entry in self._entries])
        self._kinds = np.array([" ".join(split_title(entry.title)[-1:]) for entry in self._entries])
        self._names = np.array([entry.title for entry in self._entries])
        self._words = torch.tensor(
            [entry.rows + (entry.rows[0],) * (longest - len(entry.rows)) for entry in self._entries]
        )

    def find(
        self,
        thing: Thing,
        prompt: str,
        distance: Callable[[Tensor], float],
        *,
        least: float = 0.0,
        shows: Sequence[str] = (),
        cut_out: bool = False,
        acts: bool = False,
    ) -> FoundPicture | None:
        """Returns the best picture of a thing, the user's own before all others; None if there is none.

        prompt: whole text, for the context
        distance: returns the distance of a picture [3, h, w] from the thing, as networks see it; 0 is near
        least: similarity that a caption needs; 0 for the default
        shows: words that the caption must all mention
        cut_out: True to exclude pictures with a ground, and other things with a similar name, except the user's own
        acts: True for somebody who does something or is among others, and should be seen from head to foot
        """
        thing = in_small_letters(thing)
        similarity = self._similarity(thing)
        for words in shows:
            speaks = self._embed_captions(words)  # a banana alone is no monkey with a banana
            similarity = similarity.masked_fill((speaks < _SPEAKS) | (speaks > similarity), 0)
        own = self._own(thing, similarity, shows)
        figure = is_person(thing.name, self._sentences)
        if figure or not shows:
            similarity = self._of_kind(thing, similarity, figure=figure)
        akin = None if own or shows else self._akin(thing, similarity)
        similarity = similarity if akin is None else akin
        exact = bool(own) or float(similarity.max()) >= (least or (_MIN_PERSON if figure else _MIN))
        if not exact and (least or akin is None):
            return None
        least = least or (_KIN if not exact else _MIN_PERSON if figure else _MIN)
        context = self._similar(prompt)[self._titles]
        order = (similarity + _CONTEXT * context).argsort(descending=True)[: 4 * _LOOKED_AT].tolist()
        near = [at for at in order if similarity[at] >= max(least, float(similarity.max()) - _BAND)]
        mine = sorted(own, key=lambda at: -float(similarity[at]))[:_LOOKED_AT]
        near = [*mine, *(at for at in near[:_LOOKED_AT] if at not in own)]
        kept = (at for at in near if at in own or self._may_show(at, thing, shows, among=cut_out))
        upright = figure and acts
        return self._best(kept, thing, similarity, context, distance, own, exact=exact, among=cut_out, upright=upright)

    def _of_kind(self, thing: Thing, similarity: Tensor, *, figure: bool) -> Tensor:
        """Returns the similarities without those of another kind: only a person stands for a person, and for no thing.

        figure: True if the thing is a person: a tooth is no dentist, and a farmer no farmhouse
        """
        similarity = similarity.clone()
        for at in similarity.topk(min(_LOOKED_AT_FOR_KIND, len(similarity))).indices.tolist():
            entry = self._entries[at]
            is_named = entry.library.is_own or is_called(entry.title, thing)
            if not is_named and is_person(entry.title, self._sentences) != figure:
                similarity[at] = 0
        return similarity

    def _may_show(self, at: int, thing: Thing, shows: Sequence[str], *, among: bool) -> bool:
        """Returns True if a picture is the user's own, or does not show another thing of that name."""
        entry = self._entries[at]
        if entry.library.is_own:
            return True
        another = bool(
            set(shows) & set(split_title(entry.title)[:-1])
        )  # a spider web shows no spider, a desk lamp no desk
        return not another and not (among and is_modified(entry.title, thing))

    def _best(
        self, candidates: Iterable[int], thing: Thing, similarity: Tensor, context: Tensor,
        distance: Callable[[Tensor], float], own: Sequence[int], *, exact: bool, among: bool, upright: bool,
    ) -> FoundPicture | None:  # fmt: skip
        """Returns the best usable candidate, the user's own first."""
        trusted = 1.0 if has_class(thing.noun) else _UNCLASSED
        ground = torch.tensor(_GROUND)[:, None, None].expand(3, _LOOK, _LOOK)
        bare = distance(ground)
        best, chosen, found = -float("inf"), -1, None
        for at in candidates:
            if at not in own and found is not None and found.library.is_own:
                break
            entry, like = self._entries[at], float(similarity[at])
            tells_color = set(thing.color.split()) <= set(entry.title.split())
            for picture in self._show(entry):
                grounded = not entry.library.is_own and has_ground(picture)
                if among and grounded:
                    continue
                looks = bare - distance(lay(picture, ground))
                worth = (
                    _EXACT * like
                    + spoken(entry.title, thing)
                    + _CONTEXT * float(context[at])
                    + trusted * max(-_FARTHER, min(looks, _NEARER))
                    + appearance(picture, entry.realism, is_own=entry.library.is_own)
                    + _FROM_HEAD_TO_FOOT * (upright and is_upright(picture))
                    - _UNTOLD * (grounded and not tells_color)
                )
                if worth > best:
                    best = worth
                    several = thing.count in SEVERAL and thing.plural in entry.title.split()
                    called = is_called(entry.title, thing) or thing.name in entry.keywords
                    shows_it = at in own or (exact and (like >= _NAMED or called))
                    found = FoundPicture(picture, entry.title, entry.library, like, shows_it, several)
                    chosen = at
        if found is None:
            return None
        if not found.library.is_own and not thing.color and is_colorless(found.picture):
            found = replace(found, picture=self._tint(found.picture, similarity))
        if found.several or thing.shown == 1:
            return found
        return replace(found, others=tuple(self._alike(chosen, thing.shown - 1)))

    def _tint(self, silhouette: Tensor, similarity: Tensor) -> Tensor:
        """Returns a silhouette in the colour of the most similar coloured picture: a tortoise like a turtle."""
        for at in similarity.argsort(descending=True)[:_LOOKED_AT_FOR_COLOR].tolist():
            entry = self._entries[at]
            if similarity[at] < _MIN or entry.realism < _MODELLED:
                continue
            for picture in self._show(entry)[:1]:
                if not has_ground(picture) and not is_colorless(picture):
                    return recolor(silhouette, muted_color(picture))
        return silhouette

    def _alike(self, chosen: int, most: int) -> list[Tensor]:
        """Returns other cut-outs of the same library with the same title."""
        kind = self._entries[chosen].kind
        alike = (entry for at, entry in enumerate(self._entries) if at != chosen and entry.kind == kind)
        shown = (picture for entry in alike for picture in self._show(entry)[:1])
        others = (picture for picture in shown if not has_ground(picture) and not is_colorless(picture))
        return list(itertools.islice(others, most))

    def _show(self, entry: _Entry) -> list[Tensor]:
        """Returns the variants of a picture; none if it cannot be read."""
        try:
            return entry.library.pictures(entry.file)
        except ImageError as fault:
            if entry.library.is_own:
                self.faults.append(str(fault))
            return []

    def nearest(self, thing: Thing) -> float:
        """Returns the similarity of the most similar caption to a thing."""
        return float(self._similarity(in_small_letters(thing)).max())

    def has_own(self, thing: Thing) -> bool:
        """Returns True if one of the user's own pictures shows the thing."""
        thing = in_small_letters(thing)
        return bool(self._own(thing, self._similarity(thing)))

    def _own(self, thing: Thing, similarity: Tensor, shows: Sequence[str] = ()) -> list[int]:
        """Returns the user's own pictures whose captions name the thing, or nearly so.

        shows: nouns that the caption must all mention instead
        """
        names = [{thing.noun, thing.plural} - {""}] if not shows else [{noun} for noun in shows]
        found = []
        for at, entry in enumerate(self._entries):
            if entry.library.is_own:
                words = set(entry.title.split() if shows else split_title(entry.title))
                if similarity[at] >= _NAMED or all(words & name for name in names):
                    found.append(at)
        return found

    def _similarity(self, thing: Thing) -> Tensor:
        """Returns the similarity of each picture's captions to a thing, [n]."""
        called = self._embed_captions(thing.name)
        if thing.color:
            colored = self._embed_captions(f"{thing.color} {thing.name}")
            said = torch.where(colored >= _SAME, colored + _COLORED, torch.minimum(colored, called + _COLORED))
            called = torch.maximum(called, said)
        if thing.doing:
            for words in (f"{thing.name} {thing.doing}", f"{thing.doing} {thing.name}"):
                called = torch.maximum(called, self._embed_captions(words))
        if thing.plural and thing.count in SEVERAL:
            called = torch.maximum(called, self._embed_captions(f"{thing.name.removesuffix(thing.noun)}{thing.plural}"))
        for other in synonyms(thing.name):
            called = torch.maximum(called, self._embed_captions(other).masked_fill(called < _AGREES, 0))
        if thing.noun == thing.name:
            return called
        # An older man is a man, and any picture called a man will do; but a slot machine is no sewing machine.
        called = torch.where(torch.from_numpy(self._names == thing.noun), called.clamp(min=_MIN), called)
        is_one = torch.from_numpy(self._kinds == thing.noun) & (called >= _MIN)
        noun = self._embed_captions(thing.noun).masked_fill(is_one, 1)
        return ((1 - _NOUN) * called + _NOUN * noun).masked_fill(noun < _SPEAKS, 0)  # stones are no stone bridge

    def _akin(self, thing: Thing, similarity: Tensor) -> Tensor | None:
        """Returns the similarities of related living things if a thing has no picture; None if there are none."""
        if float(torch.maximum(similarity, self._embed_captions(thing.noun)).max()) >= _NAMED:
            return None
        akin = torch.zeros(len(self._entries))
        for number, other in enumerate(kin(thing.name)):
            like = max(_KIN, _MIN - _FARTHER_KIN * (number + 1))
            akin = torch.maximum(akin, like * (self._embed_captions(other) >= _SAME))
        return akin if float(akin.max()) > 0 else None

    def _embed_captions(self, words: str) -> Tensor:
        """Returns the similarity of words to each picture: the title's, or a keyword's, weighted by the title's."""
        similar = self._similar(words)
        title, keyword = similar[self._titles], similar[self._words].amax(1) - _KEYWORD
        return torch.maximum(title, keyword * (_AGREED + (1 - _AGREED) * title))

    def _similar(self, words: str) -> Tensor:
        return self._meanings @ self._sentences.embed([words])[0]


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
        return PictureIndex(libraries, word_meanings(encoders), encoders.meanings)

    return encoders.keep("picture index", make)
