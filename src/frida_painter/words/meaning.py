"""The text objective: the painting should look like the prompt to networks that know both words and pictures."""

from collections.abc import Callable, Sequence

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
_NOISE = 0.03  # standard deviation, of sRGB
_AVOIDED = 0.5  # weight of words to avoid, relative to the prompt's
_KEPT = 1.0  # weight of the distance from the initial picture, relative to the prompt's
_BALANCE = 1.0  # weight against a picture's squared difference, if both terms have weight 1


class Text:
    """Text objective, l_text of the paper (Eq. "clip_text_loss"): distance of meanings over augmented views.

    prompt: text to be shown
    readers: networks, used in turn, so that strokes cannot satisfy only one of them
    seed: of the views and the noise
    begun: [3, H, W] initial picture of the painting; readers by class names also keep to its features, place by
        place
    settings: words to avoid, phrases, and the number of views of a CLIP

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
    ) -> None:
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
            wish(prompt, reader, settings)
            if begun is None or not isinstance(reader, ConSE)
            else _Kept(prompt, reader, self._embed_views(number, begun, torch.arange(_VIEWS)))
            for number, reader in enumerate(readers)
        ]

    def __call__(self, picture: Tensor) -> Tensor:
        """Returns the distance of a picture [3, H, W] in [0, 1] in a few random views; differentiable."""
        reader, self._next = self._next, (self._next + 1) % len(self._distances)
        which = self._views[reader].some(self._at_a_time[reader], self._generator)
        seen = self._embed_views(reader, picture, which)
        if torch.rand((), generator=self._generator) < 0.5:
            seen = functional.avg_pool2d(seen, 3, 1, 1, count_include_pad=False)
        noise = send_to_device(torch.randn(seen.shape, generator=self._generator).to(seen.dtype), seen.device)
        return _BALANCE * self._distance(reader, seen + _NOISE * noise, which)

    def validation(self, picture: Tensor) -> Tensor:
        """Returns the mean distance by all readers, always in the same few views of the middle.

        A CLIP sees the whole square here, but never straight on, which is the same for all seeds: an objective with
        another seed judges by views that this one never draws.
        """
        return self._steadily(picture, _STEADY)

    def glance(self, picture: Tensor) -> Tensor:
        """Returns the same distance in a single view: faster, and good enough for a first choice among pictures."""
        return self._steadily(picture, 1)

    def _steadily(self, picture: Tensor, views: int) -> Tensor:
        found = []
        for reader, (first, steady) in enumerate(self._steady):
            which = torch.arange(first, first + min(views, steady))
            found.append(self._distance(reader, self._embed_views(reader, picture, which), which))
        return _BALANCE * torch.stack(found).mean()

    def _embed_views(self, reader: int, picture: Tensor, which: Tensor) -> Tensor:
        """Returns the views numbered `which` [n] of a picture [3, H, W] for a reader: [n, 3, side, side]."""
        return self._views[reader].of_squares(picture, which, [self._places[int(view)] for view in which])

    def _distance(self, reader: int, seen: Tensor, which: Tensor) -> Tensor:
        """Returns the mean distance of views [n, 3, side, side], which are numbered `which` [n]."""
        distance = self._distances[reader]
        return (distance(seen, which) if isinstance(distance, _Kept) else distance(seen)).mean()


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
    said = [distance_to(words, reader) for words in settings.say(prompt)]
    away = distance_to(settings.avoid, reader) if settings.avoid else None
    if isinstance(reader, ConSE) or len(said) + bool(away) == 1:
        return lambda pictures: (
            torch.stack([near(pictures) for near in said]).mean(0)
            - (0.0 if away is None else _AVOIDED * away(pictures))
        )
    # The mean of cosine distances is the distance from the mean: the network sees each picture once.
    wanted = torch.stack([reader.embed_text(words) for words in settings.say(prompt)]).mean(0)
    unwanted = reader.embed_text(settings.avoid) if settings.avoid else torch.zeros_like(wanted)
    meaning = Constant(wanted - _AVOIDED * unwanted)
    level = 1.0 - (_AVOIDED if settings.avoid else 0.0)
    return lambda pictures: level - reader.embed_pictures(pictures) @ meaning.like(pictures)
