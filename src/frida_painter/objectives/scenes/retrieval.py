"""Pictures of the things that a prompt names: found by their captions, and chosen by looking at them."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from frida_painter.errors import ImageError
from frida_painter.objectives.compositing import lay
from frida_painter.objectives.encoders.conse import has_class, synonyms
from frida_painter.objectives.encoders.sentence import SentenceEncoder
from frida_painter.objectives.scenes.libraries import PictureLibrary
from frida_painter.objectives.scenes.reading import Thing, paint_of
from frida_painter.palette import to_lab

_LEAST = 0.55  # similarity of a caption to a thing, below which it speaks of something else
_AKIN = 0.42  # the same for what stands for a thing that has no picture
_NAMED = 0.8  # the same from which it means the thing, whatever its words: a duck (0.64) is no goose
_AGREES = 0.35  # similarity to the prompt's own words that a caption needs where a synonym found it
_BAND = 0.25  # of similarity below the best, within which pictures are looked at
_LOOKED_AT = 9
_EXACT = 1.5  # of similarity, against how a picture looks
_KEYWORD = 0.05  # less than a title
_COLORED = 0.1  # more, at the most, for a caption that has the colour too
_SAME = 0.95  # similarity of a caption to the name with its colour, from which it says both
_AGREED = 0.4  # of a keyword, however little the title agrees with it
_NOUN = 0.35  # share of the last word of a name in what a name means
_CONTEXT = 0.15  # of the similarity of a caption to the whole prompt
_WORD, _OTHERS = 0.15, 0.05  # for the very word, for all of several words, and for each word too many
_SAID = 0.3  # for the word for what it does, and for a name that begins with the colour: a red panda
_MODIFIES = 0.4  # against a title in which the word only says more of another
_FURTHER = re.compile(r"\b(?:of|with|in|on|at|for|and)\b")  # what follows is not what is named
_NEARER, _FARTHER = 0.4, 0.25  # the most that looking nearer to the words than a bare ground, or farther, counts
_UNCLASSED = 0.3  # of that, where the networks know no class of that kind and take what is near for it
_REALISM = 0.6  # of a photograph before a sign
_OWN = 0.3  # of a person's own picture
_FROM_HEAD_TO_FOOT, _TALL = 0.3, 1.3  # of who is shown so, by height over width: who does something has hands and feet
_FLAT = 0.4  # of its realism, against a picture of flat areas alone: a drawing, whatever its file says
_PLAIN = 0.25  # against drawings without colour, and pictures that are no cut-outs
_COLORFUL = 8.0  # chroma
_BLACK, _SILHOUETTE = 12.0, 0.4  # L*, and share of a picture, from which it is a silhouette
_SKETCHY = 0.25  # share of its box that a thing fills, below which there are only lines
_FILLED = 0.95  # share of its box, from which a picture is a rectangle
_SEVERAL = (None, 2)  # things of a plural that one picture may show: flowers, or a pair of scissors
_SPEAKS = 0.45  # similarity of a caption to one of several things that it shows
_GROUND = (0.93, 0.92, 0.88)
_LOOK = 160  # pixels


@dataclass(frozen=True)
class FoundPicture:
    """A picture for a thing: colour and opacity [4, h, w], its caption and library, and how like the thing that is.

    exact: whether it shows the thing that was named, rather than one that is similar; several: whether it shows as many
    of them as were asked for.
    """

    picture: Tensor
    caption: str
    library: PictureLibrary
    similarity: float
    exact: bool
    several: bool = False


@dataclass(frozen=True)
class _Entry:
    library: PictureLibrary
    file: str
    title: str
    rows: tuple[int, ...]  # of its captions among the meanings, the title's first
    realism: float


class PictureIndex:
    """All captions of several libraries as directions, computed once and kept in the folder `keep`.

    faults: what was wrong with the person's own pictures that could not be read, one sentence each.
    """

    def __init__(self, libraries: Sequence[PictureLibrary], sentences: SentenceEncoder, keep: Path) -> None:
        self._sentences = sentences
        self._entries: list[_Entry] = []
        self._meanings = torch.zeros(0, 1)
        self.faults: list[str] = []
        parts: list[Tensor] = []
        before = 0
        for library in libraries:
            captioned = library.captioned()
            said = list(dict.fromkeys(_cleaned(caption) for one in captioned for caption in one.captions))
            at = {caption: before + number for number, caption in enumerate(said)}
            for one in captioned:
                rows = tuple(at[_cleaned(caption)] for caption in one.captions)
                self._entries.append(_Entry(library, one.file, _cleaned(one.captions[0]), rows, one.realism))
            parts.append(sentences.embed_once(said, keep))
            before += len(said)
        self._meanings = torch.cat(parts)
        longest = max(len(entry.rows) for entry in self._entries)
        self._titles = torch.tensor([entry.rows[0] for entry in self._entries])
        self._kinds = np.array([" ".join(_named(entry.title)[-1:]) for entry in self._entries])
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
        upright: bool = False,
    ) -> FoundPicture | None:
        """The picture that shows a thing best, a person's own before all others; None where none does.

        distance: how far a picture [3, h, w] looks from the thing, to networks; 0 is near. least: similarity that a
        caption needs, where nothing that is only similar will do; shows: words of each of which the caption speaks;
        cut_out: whether it stands among others, so that no picture with a ground of its own, and of no other thing of
        a similar name, will do, unless it is a person's own; upright: whether it is somebody from head to foot.
        """
        thing = _in_small_letters(thing)
        similarity = self._similarity(thing)
        for words in shows:
            speaks = self._captioned(words)  # a banana alone is no monkey with a banana
            similarity = similarity.masked_fill((speaks < _SPEAKS) | (speaks > similarity), 0)
        own = self._own(thing, similarity, shows)
        exact = bool(own) or float(similarity.max()) >= (least or _LEAST)
        if (least or cut_out) and not exact:
            return None
        least = least or (_LEAST if exact else _AKIN)
        context = self._similar(prompt)[self._titles]
        order = (similarity + _CONTEXT * context).argsort(descending=True)[: 4 * _LOOKED_AT].tolist()
        near = [at for at in order if similarity[at] >= max(least, float(similarity.max()) - _BAND)]
        mine = sorted(own, key=lambda at: -float(similarity[at]))[:_LOOKED_AT]
        near = [*mine, *(at for at in near[:_LOOKED_AT] if at not in own)]
        trusted = 1.0 if has_class(thing.noun) else _UNCLASSED
        ground = torch.tensor(_GROUND)[:, None, None].expand(3, _LOOK, _LOOK)
        bare = distance(ground)
        best, found = -float("inf"), None
        for at in near:
            if at not in own and found is not None and found.library.is_own:
                break
            entry = self._entries[at]
            is_own = entry.library.is_own
            if cut_out and not is_own and _is_modified(entry, thing):
                continue
            if shows and not is_own and shows[0] in _named(entry.title)[:-1]:  # a spider web shows no spider
                continue
            try:
                shown = entry.library.pictures(entry.file)
            except ImageError as fault:
                if is_own:
                    self.faults.append(str(fault))
                continue
            for picture in shown:
                if cut_out and not is_own and has_ground(picture):
                    continue
                looks = bare - distance(lay(picture, ground))
                worth = (
                    _EXACT * float(similarity[at])
                    + _spoken(entry, thing)
                    + _CONTEXT * float(context[at])
                    + trusted * max(-_FARTHER, min(looks, _NEARER))
                    + _prior(entry, picture)
                    + _FROM_HEAD_TO_FOOT * (upright and picture.shape[1] > _TALL * picture.shape[2])
                )
                if worth > best:
                    best = worth
                    several = thing.count in _SEVERAL and thing.plural in entry.title.split()
                    named = at in own or (exact and (float(similarity[at]) >= _NAMED or _is_called(entry, thing)))
                    found = FoundPicture(picture, entry.title, entry.library, float(similarity[at]), named, several)
        return found

    def nearest(self, thing: Thing) -> float:
        """How like the thing the captions are that are most like it."""
        return float(self._similarity(_in_small_letters(thing)).max())

    def has_own(self, thing: Thing) -> bool:
        """Whether one of the person's own pictures is of the thing."""
        thing = _in_small_letters(thing)
        return bool(self._own(thing, self._similarity(thing)))

    def _own(self, thing: Thing, similarity: Tensor, shows: Sequence[str] = ()) -> list[int]:
        """The person's own pictures that are called by the thing, or are nearly called so; shows: by all of these."""
        names = [{thing.noun, thing.plural} - {""}] if not shows else [{noun} for noun in shows]
        found = []
        for at, entry in enumerate(self._entries):
            if entry.library.is_own:
                words = set(entry.title.split() if shows else _named(entry.title))
                if similarity[at] >= _NAMED or all(words & name for name in names):
                    found.append(at)
        return found

    def _similarity(self, thing: Thing) -> Tensor:
        """How like the thing each picture's captions are, [n]."""
        named = self._captioned(thing.name)
        if thing.color:
            colored = self._captioned(f"{thing.color} {thing.name}")
            said = torch.where(colored >= _SAME, colored + _COLORED, torch.minimum(colored, named + _COLORED))
            named = torch.maximum(named, said)
        if thing.doing:
            for words in (f"{thing.name} {thing.doing}", f"{thing.doing} {thing.name}"):
                named = torch.maximum(named, self._captioned(words))
        if thing.plural and thing.count in _SEVERAL:
            named = torch.maximum(named, self._captioned(f"{thing.name.removesuffix(thing.noun)}{thing.plural}"))
        for other in synonyms(thing.name):
            named = torch.maximum(named, self._captioned(other).masked_fill(named < _AGREES, 0))
        if thing.noun == thing.name:
            return named
        # An older man is a man, and a slot machine no sewing machine.
        is_one = torch.from_numpy(self._kinds == thing.noun) & (named >= _LEAST)
        noun = self._captioned(thing.noun).masked_fill(is_one, 1)
        return ((1 - _NOUN) * named + _NOUN * noun).masked_fill(noun < _SPEAKS, 0)  # stones are no stone bridge

    def _captioned(self, words: str) -> Tensor:
        """The same for words: the title's, or a keyword's as far as the title agrees with it."""
        similar = self._similar(words)
        title, keyword = similar[self._titles], similar[self._words].amax(1) - _KEYWORD
        return torch.maximum(title, keyword * (_AGREED + (1 - _AGREED) * title))

    def _similar(self, words: str) -> Tensor:
        return self._meanings @ self._sentences.embed([words])[0]


def _spoken(entry: _Entry, thing: Thing) -> float:
    """What it is worth that a title has the very word, is no more than it, and speaks of little else."""
    title = _title(entry, thing)
    words = title.split()
    others = max(0, len(words) - len(thing.name.split()) - 1)
    name = thing.name.split()
    worth = -_MODIFIES * _is_modified(entry, thing) - _OTHERS * others
    worth += _SAID * bool(thing.doing and thing.doing in entry.title.split())
    worth += _SAID * bool(thing.color and entry.title == f"{thing.color} {thing.name}")
    worth += _WORD * (thing.noun in words) + _WORD * (title == thing.name)
    return worth + _WORD * (len(name) > 1 and set(name) <= set(words))


def _is_modified(entry: _Entry, thing: Thing) -> bool:
    """Whether a title names another thing by the word, as a mountain goat is no mountain, and a fencer is no fence, or
    one that is there: an owl on a branch is no branch.

    Of words that make one name the last says what it is, but a hyphen makes a name of its own: a jack-o'-lantern.
    """
    named = _named(_title(entry, thing))
    endings = [word.removeprefix(thing.noun) for word in entry.title.split() if word.startswith(thing.noun)]
    is_derived = any(ending not in ("", "s", "es") for ending in endings)
    is_joined = any(word.endswith(f"-{thing.noun}") for word in named)
    is_around = re.search(rf"\b(?:on|in|with) (?:\w+ )*{re.escape(thing.noun)}\b", _title(entry, thing)) is not None
    return thing.noun not in named[-1:] and (thing.noun in named or is_derived or is_joined or is_around)


def _is_called(entry: _Entry, thing: Thing) -> bool:
    """Whether a title has the very word, or ends in it as a sailboat does, or a synonym, and means no other kind.

    A washing machine is no sewing machine, where a machine may be one.
    """
    kind, wanted = set(_named(entry.title)[:-1]), set(thing.name.split()[:-1])
    if kind and wanted and not kind & wanted:
        return False
    words = _title(entry, thing).split()
    names = (thing.noun, *(other.split()[-1].lower() for other in synonyms(thing.name)))
    return any(word.endswith(name) for word in words for name in names)


def _in_small_letters(thing: Thing) -> Thing:
    """The thing as captions call it: the Eiffel Tower is the eiffel tower."""
    return replace(thing, name=thing.name.lower(), noun=thing.noun.lower(), plural=thing.plural.lower())


def _named(title: str) -> list[str]:
    """The words of a title that name what it shows; the last one says what it is."""
    return _FURTHER.split(title)[0].split()


def _title(entry: _Entry, thing: Thing) -> str:
    """The title without the thing's colour and what it does; in the singular where one picture may show several."""
    told, title = {*thing.color.split(), thing.doing}, entry.title
    words = [word for word in title.split() if word not in told]
    if thing.plural and thing.count in _SEVERAL:
        words = [thing.noun if word == thing.plural else word for word in words]
    return " ".join(words) or title


def _prior(entry: _Entry, picture: Tensor) -> float:
    """What a picture is worth before it is compared: cut-outs before rectangles, colours before outlines."""
    seen = picture[:3, picture[3] > 0.5].T
    own = entry.library.is_own
    if len(seen) == 0:
        return -1.0
    flat = _flatness(picture)
    worth = _REALISM * entry.realism * (1 - _FLAT * flat) + _OWN * own
    lab = to_lab(seen[:: max(1, len(seen) // 2000)])
    chroma = float(lab[:, 1:].norm(dim=1).mean())
    worth -= _PLAIN * flat * float((lab[:, 0] < _BLACK).float().mean() > _SILHOUETTE) * (not own)
    worth -= _PLAIN * flat * (chroma < _COLORFUL and not own)
    worth -= _PLAIN * (float(picture[3].mean()) < _SKETCHY)
    return worth - _PLAIN * (has_ground(picture) and not own)


def has_ground(picture: Tensor) -> bool:
    """Whether a picture [4, h, w] is no cut-out, but a rectangle with a ground of its own."""
    return float(picture[3].mean()) > _FILLED


def _flatness(picture: Tensor) -> float:
    """Share of neighbours in a thing [4, h, w] of the very same colour: near 0 in photographs, near 1 in signs."""
    opaque = picture[3] > 0.98
    pairs = opaque[:, 1:] & opaque[:, :-1]
    same = (picture[:3, :, 1:] == picture[:3, :, :-1]).all(0)
    return float((same & pairs).sum()) / max(1, int(pairs.sum()))


def _cleaned(caption: str) -> str:
    """A caption without article, numbers, underscores and what is in brackets, but for a colour; in small letters."""
    colors = [word for word in re.findall(r"\((.*?)\)", caption.lower()) if paint_of(word) is not None]
    plain = re.sub(r"\(.*?\)|[^a-zA-Z' -]+", " ", caption)
    plain = re.sub("^(an?|the|another|some|my|our) ", "", " ".join(plain.split()).lower())
    return " ".join([*colors[:1], plain]).strip() or caption
