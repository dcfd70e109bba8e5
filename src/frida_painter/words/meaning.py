"""The text objective: the painting should look like the prompt to networks that know both words and pictures."""

from collections.abc import Callable, Sequence

import torch
from torch import Tensor
from torch.nn import functional

from frida_painter.devices import Constant, send_to_device
from frida_painter.objectives.encoders.base import Reader
from frida_painter.objectives.encoders.classifiers import ConSE
from frida_painter.objectives.semantic_loss import Views

_VIEWS = 24
_AT_A_TIME = 2
_STEADY = 4  # number of fixed views for validation
_NOISE = 0.03  # standard deviation, of sRGB
_KEPT = 1.0  # weight of the distance from the initial picture, relative to the prompt's
_BALANCE = 1.0  # weight against a picture's squared difference, if both terms have weight 1


class Text:
    """Text objective, l_text of the paper (Eq. "clip_text_loss"): distance of meanings over augmented views.

    prompt: text to be shown
    readers: networks, used in turn, so that strokes cannot satisfy only one of them
    seed: of the views and the noise
    begun: [3, H, W] initial picture of the painting; readers by class names also keep to its features, place by
        place

    A call looks at a square of the picture in two random views (perspective, crop). Half of the calls blur them,
    and all add noise.
    """

    def __init__(self, prompt: str, readers: Sequence[Reader], seed: int, begun: Tensor | None = None) -> None:
        self._views = [Views(_VIEWS, reader.side, seed) for reader in readers]
        self._generator = torch.Generator().manual_seed(seed)
        self._next = 0
        elsewhere = torch.rand(_VIEWS - _STEADY, generator=self._generator)
        self._places = [0.5] * _STEADY + elsewhere.tolist()  # position of each view's square, from one end to the other
        self._distances = [
            distance_to(prompt, reader)
            if begun is None or not isinstance(reader, ConSE)
            else _Kept(prompt, reader, self._embed_views(number, begun, torch.arange(_VIEWS)))
            for number, reader in enumerate(readers)
        ]

    def __call__(self, picture: Tensor) -> Tensor:
        """Returns the distance of a picture [3, H, W] in [0, 1] in two random views; differentiable."""
        reader, self._next = self._next, (self._next + 1) % len(self._distances)
        which = torch.randperm(_VIEWS, generator=self._generator)[:_AT_A_TIME]
        seen = self._embed_views(reader, picture, which)
        if torch.rand((), generator=self._generator) < 0.5:
            seen = functional.avg_pool2d(seen, 3, 1, 1, count_include_pad=False)
        noise = send_to_device(torch.randn(seen.shape, generator=self._generator).to(seen.dtype), seen.device)
        return _BALANCE * self._distance(reader, seen + _NOISE * noise, which)

    def validation(self, picture: Tensor) -> Tensor:
        """Returns the mean distance by all readers, always in the same few views of the middle."""
        return self._steadily(picture, _STEADY)

    def glance(self, picture: Tensor) -> Tensor:
        """Returns the same distance in a single view: faster, and good enough for a first choice among pictures."""
        return self._steadily(picture, 1)

    def _steadily(self, picture: Tensor, views: int) -> Tensor:
        which = torch.arange(views)
        found = [
            self._distance(reader, self._embed_views(reader, picture, which), which)
            for reader in range(len(self._distances))
        ]
        return _BALANCE * torch.stack(found).mean()

    def _embed_views(self, reader: int, picture: Tensor, which: Tensor) -> Tensor:
        """Returns the views numbered `which` [n] of a picture [3, H, W] for a reader: [n, 3, side, side]."""
        return torch.cat(
            [self._views[reader].of(_square(picture, self._places[int(view)]), view[None]) for view in which]
        )

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


def _square(picture: Tensor, place: float) -> Tensor:
    """Returns the largest square of a picture [3, H, W] without distortion, from one end (0) to the other (1)."""
    _, rows, columns = picture.shape
    side = min(rows, columns)
    top, left = round(place * (rows - side)), round(place * (columns - side))
    return picture[:, top : top + side, left : left + side]


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
