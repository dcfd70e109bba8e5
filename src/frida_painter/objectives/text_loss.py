"""The text objective: the painting should look like the prompt to networks that know both words and pictures."""

import time
from collections.abc import Callable, Sequence

import torch
from torch import Tensor
from torch.nn import functional

from frida_painter.objectives.encoders.base import Reader
from frida_painter.objectives.semantic import Views
from frida_painter.objectives.word_settings import USUAL, ClipWork, WordSettings
from frida_painter.system.devices import Constant, send_to_device

_VIEWS = 72
_WHOLES = 35  # views of the whole picture for a CLIP, of these: it knows places and counts, which a crop changes
_STEADY = 2  # number of fixed views for validation
_MIDDLE = 15  # views of the middle square; the others lie anywhere
_CALLS_A_VIEW = 16  # calls after which a CLIP sees one view more, from one view on: forms stand before their details
_NOISE = 0.03  # standard deviation, of sRGB
_AVOIDED = 0.5  # weight of words to avoid, relative to the prompt's
_DRIFT = 0.1  # mean change of sRGB by which words may move the picture that they begin with
_COARSE = 24  # cells along each side of a picture, about the size of strokes
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
    reader: network that compares words with pictures, such as a CLIP
    seed: of the views and the noise
    settings: words to avoid, and the effort
    sight: shared with objectives of other words, with the same reader, seed and settings of views; the reader then
        sees a picture once for all of them

    A call looks at squares of the picture in random views (perspective, crop); half of them show the whole square.
    Half of the calls blur them, and all add noise.
    """

    def __init__(
        self, prompt: str, reader: Reader, seed: int, settings: WordSettings = USUAL, sight: Sight | None = None
    ) -> None:
        self._reader, self._seed, self._sight = reader, seed, sight or Sight()
        self._calls = 0
        self._most = settings.budget(reader).views
        self._views = Views(_VIEWS, reader.side, seed, wholes=_WHOLES)
        self._generator = torch.Generator().manual_seed(seed)
        elsewhere = torch.rand(_VIEWS - _MIDDLE, generator=self._generator)
        self._places = [0.5] * _MIDDLE + elsewhere.tolist()  # of each view's square, from end to end
        self._meaning = _distance_from(prompt, reader, settings)

    def __call__(self, picture: Tensor) -> Tensor:
        """Returns the distance of a picture [3, H, W] in [0, 1] in a few random views; differentiable."""
        many = min(self._most, 1 + self._calls // _CALLS_A_VIEW)
        self._calls += 1
        which = self._views.some(many, self._generator)
        blurs = bool(torch.rand((), generator=self._generator) < 0.5)
        side = self._reader.side
        noise = _NOISE * torch.randn((many, 3, side, side), generator=self._generator)

        def embed() -> Tensor:
            seen = self._look(picture, which)
            if blurs:
                seen = functional.avg_pool2d(seen, 3, 1, 1, count_include_pad=False)
            return self._reader.embed_pictures(seen + send_to_device(noise.to(seen.dtype), seen.device))

        look = (self._seed, f"call {self._calls}", *which.tolist())
        return _BALANCE * self._meaning(self._sight.embed(picture, look, embed)).mean()

    def validation(self, picture: Tensor) -> Tensor:
        """Returns the distance in always the same few views of the middle.

        The reader sees the whole square here, but never straight on, which is the same for all seeds: an objective with
        another seed judges by views that this one never draws.
        """
        which = torch.arange(1, 1 + _STEADY)
        # With gradients, each look needs a graph of its own.
        look = () if torch.is_grad_enabled() else (self._seed, "steady", *which.tolist())
        seen = self._sight.embed(picture, look, lambda: self._reader.embed_pictures(self._look(picture, which)))
        return _BALANCE * self._meaning(seen).mean()

    def _look(self, picture: Tensor, which: Tensor) -> Tensor:
        """Returns the views numbered `which` [n] of a picture [3, H, W]: [n, 3, side, side]."""
        return self._views.of_squares(picture, which, [self._places[int(view)] for view in which])


def _distance_from(prompt: str, reader: Reader, settings: WordSettings) -> Callable[[Tensor], Tensor]:
    """Returns a function from embeddings [n, d] to their distances [n] from a prompt, away from words to avoid.

    The mean of cosine distances is the distance from the mean: the network sees each picture once.
    """
    wanted = reader.embed_text(prompt)
    unwanted = reader.embed_text(settings.avoid) if settings.avoid else torch.zeros_like(wanted)
    meaning, level = Constant(wanted - _AVOIDED * unwanted), 1.0 - (_AVOIDED if settings.avoid else 0.0)
    return lambda seen: level - seen @ meaning.like(seen)


def holding_weight(text: Text, picture: Tensor) -> float:
    """Returns the weight of the squared difference from a picture [3, H, W] with which words move it little.

    It is so large that at first the words pull the picture's coarse colours `_DRIFT` away from it in the mean, and no
    further. Fine patterns do not count: no stroke can follow them.
    """
    with torch.enable_grad():
        at = picture.detach().clone().requires_grad_()
        (slope,) = torch.autograd.grad(text.validation(at), at)
    rows, columns = picture.shape[1:]
    coarse = functional.adaptive_avg_pool2d(slope, (min(rows, _COARSE), min(columns, _COARSE)))
    return max(1.0, float(coarse.square().mean().sqrt()) * slope.numel() / (2 * _DRIFT))


def wish(prompt: str, reader: Reader, settings: WordSettings) -> Callable[[Tensor], Tensor]:
    """Returns a function from pictures [n, 3, h, w] to their distances [n] from a prompt, away from words to avoid."""
    distance = _distance_from(prompt, reader, settings)
    return lambda pictures: distance(reader.embed_pictures(pictures))


# First pictures of coarse colours: a pyramid of small pictures, coloured until a network sees the words in it
#
# The coarse levels are coloured first and the fine ones later, so that large forms stand before small ones. The finest
# level has a few hundred cells, too few for the fine patterns by which a network is fooled. Compare "octaves" in
# Mordvintsev et al., "Inceptionism", 2015, and the pyramids in Olah et al., "Feature visualization", 2017.

_LEVELS = (1, 3, 6, 12, 20)  # cells of the shorter side
_BEGUN = (1.0, 1.0, 0.3, 0.3, 0.3)  # standard deviation of each level at the beginning, before the logistic function
_FROM = (0.0, 0.0, 0.0, 0.3, 0.6)  # share of the steps after which a level takes part
_COLORED = 2  # pictures; the best one is taken
_PYRAMID_VIEWS = 24
_ROWS = 48  # of a picture while it is coloured
_RATE = 0.08
_PYRAMID_NOISE = 0.05  # standard deviation, of sRGB
_MUCH_LONGER, _SOON = 1.5, 5  # times the told time, and seconds for which nothing is told anew
_SMOOTH = 1.0  # weight of the mean difference between neighbours


def draw_pyramid(levels: Sequence[Tensor], rows: int, columns: int) -> Tensor:
    """Returns the pictures of levels [n, 3, h, w], coarse to fine: [n, 3, rows, columns] in [0, 1]. Differentiable."""
    every = [functional.interpolate(level, [rows, columns], mode="bicubic", align_corners=False) for level in levels]
    return torch.stack(every).sum(0).sigmoid()


def color_in(
    wish: Callable[[Tensor], Tensor],
    reader: Reader,
    size: tuple[int, int],
    seed: int,
    budget: ClipWork,
    tell: Callable[[str], None] = lambda sentence: None,
    heed: Callable[[], None] = lambda: None,
) -> Tensor:
    """Returns the picture [3, H, W] of coarse colours that is nearest to the words for a network.

    wish: distances [n] of pictures [n, 3, h, w] from the words
    reader: network that measures them; only its size counts here
    size: H and W
    budget: number of steps in which the colours change, and of views, half of them for each picture
    tell: receives a sentence about the expected time, after the second step, and again if it takes much longer
    heed: called before each step; may raise to end the work
    """
    steps, at_a_time = budget.first_steps, max(1, budget.views // _COLORED)
    rows, columns = (side * _ROWS // min(size) for side in size)
    views, judge = (Views(_PYRAMID_VIEWS, reader.side, seed + number, _PYRAMID_VIEWS // 2 - 1) for number in (0, 1))
    generator = torch.Generator().manual_seed(seed)
    levels = []
    for cells, spread in zip(_LEVELS, _BEGUN, strict=True):
        shape = (max(1, round(cells * side / _ROWS)) for side in (rows, columns))
        levels.append(spread * torch.randn(_COLORED, 3, *shape, generator=generator))
    adam = torch.optim.Adam([level.requires_grad_() for level in levels], _RATE, (0.9, 0.98))
    expected, began = 0.0, time.monotonic()
    for step in range(steps):
        heed()
        if step == 1:
            began = time.monotonic()  # the first step is slower
        done = step / steps
        taking_part = [level for level, first in zip(levels, _FROM, strict=True) if done >= first]
        picture = draw_pyramid(taking_part, rows, columns)
        which = views.some(at_a_time, generator)
        seen = torch.cat([views.of_squares(one, which, [0.5] * at_a_time) for one in picture])
        distance = wish(seen + _PYRAMID_NOISE * torch.randn(seen.shape, generator=generator)).sum()
        uneven = (picture.diff(dim=2).abs().mean() + picture.diff(dim=3).abs().mean()) * _COLORED
        adam.zero_grad()
        torch.autograd.backward(distance + _SMOOTH * uneven)
        adam.param_groups[0]["lr"] = _RATE * (1 - 0.8 * done)
        adam.step()
        whole = (steps - 1) * (time.monotonic() - began) / max(step, 1)
        left = max(1, round(whole * (1 - step / max(steps - 1, 1))))
        if step and whole >= _MUCH_LONGER * expected:
            expected = whole
            if step == 1:
                tell(f"A first picture is coloured for the words, in about {left} s; the plan follows.")
            elif left > _SOON:
                tell(f"The first picture takes longer, about {left} s more; this machine is busy.")
    with torch.no_grad():
        found = draw_pyramid(levels, *size)
        which = torch.tensor([1, 2, 3])
        seen = torch.cat([judge.of_squares(one, which, [0.5] * 3) for one in found])
        return found[int(wish(seen).reshape(_COLORED, 3).mean(1).argmin())].clamp(0, 1)
