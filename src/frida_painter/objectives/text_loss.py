"""The text objective: the painting should look like the prompt to networks that know both words and pictures."""

from collections.abc import Callable, Sequence
from functools import partial

import torch
from torch import Tensor
from torch.nn import functional

from frida_painter.devices import Constant, send_to_device
from frida_painter.objectives.encoders.base import Reader
from frida_painter.objectives.encoders.classifiers import ConSE
from frida_painter.objectives.semantic_loss import Views
from frida_painter.objectives.word_settings import USUAL, WordSettings

_VIEWS = 24
_WHOLES = 11  # views of the whole picture for a CLIP, of these: it knows places and counts, which a crop changes
_AT_A_TIME = 2  # views of networks by class names, which see small pictures
_STEADY = 4  # number of fixed views for validation
_STEADY_OF_CLIP = 2  # the same of a CLIP, which is ten times as slow
_CALLS_A_VIEW = 16  # calls after which a CLIP sees one view more, from one view on: forms stand before their details
_NOISE = 0.03  # standard deviation, of sRGB
_AVOIDED = 0.5  # weight of words to avoid, relative to the prompt's
_KEPT = 1.0  # weight of the distance from the initial picture, relative to the prompt's
_BALANCE = 1.0  # weight against a picture's squared difference, if both terms have weight 1


class Sight:
    """Last embedding of a picture, for several objectives of words that look at it in the same views."""

    def __init__(self) -> None:
        self._known: tuple[object, ...] = ()
        self._picture = self._embedding = torch.empty(0)

    def embed(self, picture: Tensor, look: tuple[object, ...], embed: Callable[[], Tensor]) -> Tensor:
        """Returns the embedding [n, d] of views of a picture, from `embed` if it is not the last one.

        look: all that decides the views besides the picture; () if nobody else looks so
        """
        if not look:
            return embed()
        known = (look, picture._version, torch.is_grad_enabled(), picture.requires_grad)
        if picture is not self._picture or known != self._known:
            self._embedding = embed()
            self._picture, self._known = picture, known
        return self._embedding


class Text:
    """Text objective, l_text of the paper (Eq. "clip_text_loss"): distance of meanings over augmented views.

    prompt: text to be shown
    readers: networks, used in turn, so that strokes cannot satisfy only one of them
    seed: of the views and the noise
    begun: [3, H, W] initial picture of the painting; readers by class names also keep to its features, place by
        place
    settings: words to avoid, phrases, and the largest number of views of a CLIP
    sight: shared with objectives of other words, with the same readers, seed and settings of views; a CLIP then sees
        a picture once for all of them

    A call looks at squares of the picture in random views (perspective, crop); a CLIP sees the whole square in half
    of them. Half of the calls blur them, and all add noise.
    """

    def __init__(
        self,
        prompt: str,
        readers: Sequence[Reader],
        seed: int,
        begun: Tensor | None = None,
        settings: WordSettings = USUAL,
        sight: Sight | None = None,
    ) -> None:
        self._readers, self._seed, self._sight = tuple(readers), seed, sight or Sight()
        self._calls = 0
        self._at_a_time = [_AT_A_TIME if isinstance(reader, ConSE) else settings.cutouts for reader in readers]
        self._steady = [(0, _STEADY) if isinstance(reader, ConSE) else (1, _STEADY_OF_CLIP) for reader in readers]
        self._views = [
            Views(_VIEWS, reader.side, seed, wholes=0 if isinstance(reader, ConSE) else _WHOLES) for reader in readers
        ]
        self._generator = torch.Generator().manual_seed(seed)
        self._next = 0
        elsewhere = torch.rand(_VIEWS - _STEADY - 1, generator=self._generator)
        self._places = [0.5] * (_STEADY + 1) + elsewhere.tolist()  # of each view's square, from end to end
        self._distances = [
            _Meaning(prompt, reader, settings)
            if not isinstance(reader, ConSE)
            else wish(prompt, reader, settings)
            if begun is None
            else _Kept(prompt, reader, self._embed_views(number, begun, torch.arange(_VIEWS)))
            for number, reader in enumerate(readers)
        ]

    def __call__(self, picture: Tensor) -> Tensor:
        """Returns the distance of a picture [3, H, W] in [0, 1] in a few random views; differentiable."""
        reader, self._next = self._next, (self._next + 1) % len(self._distances)
        many = self._at_a_time[reader]
        if isinstance(self._distances[reader], _Meaning):
            many = min(many, 1 + self._calls // _CALLS_A_VIEW)
        self._calls += 1
        which = self._views[reader].some(many, self._generator)
        blurs = bool(torch.rand((), generator=self._generator) < 0.5)
        side = self._readers[reader].side
        noise = _NOISE * torch.randn((many, 3, side, side), generator=self._generator)

        def views() -> Tensor:
            seen = self._embed_views(reader, picture, which)
            if blurs:
                seen = functional.avg_pool2d(seen, 3, 1, 1, count_include_pad=False)
            return seen + send_to_device(noise.to(seen.dtype), seen.device)

        return _BALANCE * self._distance(reader, picture, which, views, f"call {self._calls}")

    def validation(self, picture: Tensor) -> Tensor:
        """Returns the mean distance by all readers, always in the same few views of the middle.

        A CLIP sees the whole square here, but never straight on, which is the same for all seeds: an objective with
        another seed judges by views that this one never draws.
        """
        found = []
        for reader, (first, steady) in enumerate(self._steady):
            which = torch.arange(first, first + steady)
            look = partial(self._embed_views, reader, picture, which)
            found.append(self._distance(reader, picture, which, look, "steady"))
        return _BALANCE * torch.stack(found).mean()

    def _embed_views(self, reader: int, picture: Tensor, which: Tensor) -> Tensor:
        """Returns the views numbered `which` [n] of a picture [3, H, W] for a reader: [n, 3, side, side]."""
        return self._views[reader].of_squares(picture, which, [self._places[int(view)] for view in which])

    def _distance(self, reader: int, picture: Tensor, which: Tensor, views: Callable[[], Tensor], how: str) -> Tensor:
        """Returns the mean distance of a picture [3, H, W] in the views numbered `which` [n].

        views: returns them: [n, 3, side, side]
        how: name of all that the views depend on besides the picture, the seed and their numbers
        """
        distance = self._distances[reader]
        if isinstance(distance, _Meaning):
            again = how == "steady" and torch.is_grad_enabled()  # each look then needs a graph of its own
            look = () if again else (reader, self._seed, how, *which.tolist())
            seen = self._sight.embed(picture, look, lambda: self._readers[reader].embed_pictures(views()))
            return distance.of_embeddings(seen).mean()
        return (distance(views(), which) if isinstance(distance, _Kept) else distance(views())).mean()


class _Meaning:
    """Distance of embeddings from a prompt, away from words to avoid.

    The mean of cosine distances is the distance from the mean: the network sees each picture once.
    """

    def __init__(self, prompt: str, reader: Reader, settings: WordSettings) -> None:
        wanted = torch.stack([reader.embed_text(words) for words in settings.say(prompt)]).mean(0)
        unwanted = reader.embed_text(settings.avoid) if settings.avoid else torch.zeros_like(wanted)
        self._meaning = Constant(wanted - _AVOIDED * unwanted)
        self._level = 1.0 - (_AVOIDED if settings.avoid else 0.0)

    def of_embeddings(self, seen: Tensor) -> Tensor:
        """Returns the distances [n] of embeddings [n, d]."""
        return self._level - seen @ self._meaning.like(seen)


class _Kept:
    """Distance from a prompt plus distance from the features of an initial picture.

    views: [v, 3, side, side] of the initial picture

    Features are compared by cosine distance, place by place: parts of things, and things.
    """

    def __init__(self, prompt: str, reader: ConSE, views: Tensor) -> None:
        self._reader = reader
        self._said = reader.distance_of(prompt)
        with torch.no_grad():
            seen = [reader.features(some) for some in torch.split(views, _STEADY)]
        self._wanted = [torch.cat(maps) for maps in zip(*seen, strict=True)]

    def __call__(self, seen: Tensor, which: Tensor) -> Tensor:
        """Returns the distances [n] of views [n, 3, side, side], which are numbered `which` [n]."""
        features = self._reader.features(seen)
        total = self._said(features)
        for maps, wanted in zip(features, self._wanted, strict=True):
            like = functional.cosine_similarity(maps, wanted[send_to_device(which, wanted.device)], dim=1)
            total = total + _KEPT * (1 - like).mean((1, 2))
        return total


def distance_to(prompt: str, reader: Reader) -> Callable[[Tensor], Tensor]:
    """Returns a function from pictures [n, 3, h, w] to their distances [n] from a prompt.

    The distance is 0 for the same meaning and about 1 for any other. It is the cosine distance of the embeddings,
    or the measure of a reader by class names.
    """
    if isinstance(reader, ConSE):
        return reader.distance_to(prompt)
    meaning = Constant(reader.embed_text(prompt))

    def apart(pictures: Tensor) -> Tensor:
        return 1 - reader.embed_pictures(pictures) @ meaning.like(pictures)

    return apart


def wish(prompt: str, reader: Reader, settings: WordSettings) -> Callable[[Tensor], Tensor]:
    """Returns a function from pictures [n, 3, h, w] to their distances [n] from a prompt, away from words to avoid."""
    if not isinstance(reader, ConSE):
        meaning = _Meaning(prompt, reader, settings)
        return lambda pictures: meaning.of_embeddings(reader.embed_pictures(pictures))
    said = [distance_to(words, reader) for words in settings.say(prompt)]
    away = distance_to(settings.avoid, reader) if settings.avoid else None
    return lambda pictures: (
        torch.stack([near(pictures) for near in said]).mean(0) - (0.0 if away is None else _AVOIDED * away(pictures))
    )
