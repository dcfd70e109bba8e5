"""Appearance of a thing that its words ask for: a fat pigeon, a rusty can, a melting snowman."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

from frida_painter.objectives.encoders.sentence import SentenceEncoder
from frida_painter.words.compositing import crop, resize, sample, soften, warp_rows
from frida_painter.words.places import Weather


def _bend(picture: Tensor, lean: float = 0.6) -> Tensor:
    """Returns a picture [4, h, w] bent to the left, its foot in place, by a share of its height."""
    up = torch.linspace(1, 0, picture.shape[1])
    return crop(warp_rows(picture, -lean * picture.shape[1] * up**1.4, torch.ones_like(up)))


def _bulge(picture: Tensor) -> Tensor:
    """Returns a picture [4, h, w] with a fat middle; its outermost parts stay small."""
    picture = resize(picture, 1.0, 1.25 if picture.shape[1] > picture.shape[2] else 0.75)
    wide = functional.pad(picture, (picture.shape[2] // 6, picture.shape[2] // 6, 0, 0))
    y, x = torch.meshgrid(*(torch.linspace(-1, 1, side) for side in wide.shape[1:]), indexing="ij")
    middle = (1 - x**2 - y**2).clamp(min=0)
    return sample(wide, torch.stack((x * (1 - 0.5 * middle), y * (1 - 0.2 * middle)), 2))


def _melt(picture: Tensor) -> Tensor:
    """Returns a picture that sags and runs into a puddle of its colour at its foot."""
    low = resize(picture, 0.8, 1.25)
    down = torch.linspace(0, 1, low.shape[1])
    wide = 1 + 0.25 * down + 0.6 * ((down - 0.8) / 0.2).clamp(min=0) ** 1.5
    run = warp_rows(low, 0.04 * picture.shape[2] * (down * 17).sin() * down, wide)
    pool = torch.linspace(-1, 1, run.shape[2]) ** 2 + ((down[:, None] - 0.92) / 0.08) ** 2 < 1
    color = (run[:3] * run[3:]).sum((1, 2), keepdim=True) / run[3].sum().clamp(min=1)
    return torch.cat((torch.lerp(color.expand_as(run[:3]), run[:3], run[3:]), torch.maximum(run[3:], pool[None])))


def _crack(picture: Tensor) -> Tensor:
    """Returns a picture in two pieces, with a dark jagged gap between them."""
    _, rows, columns = picture.shape
    points = torch.tensor([[[0.0, -0.03, 0.05, 0.01, 0.08, -0.04, -0.01, -0.06, 0.03, 0.01]]])
    middle = columns * (0.48 + functional.interpolate(points, rows, mode="linear", align_corners=True)[0, 0])[:, None]
    gap, across = max(2, round(0.05 * columns)), torch.arange(columns)[None]
    dark = 1 - 0.75 * (1 - (across - middle).abs() / (0.04 * columns)).clamp(0, 1)
    left, right = (torch.cat((picture[:3] * dark, picture[3:] * part)) for part in (across < middle, across >= middle))
    left, right = functional.pad(left, (0, gap, 0, gap // 2)), functional.pad(right, (gap, 0, gap // 2, 0))
    return torch.where(right[3:] > left[3:], right, left)


def _noise(picture: Tensor, cells: int) -> Tensor:
    """Returns smooth noise [h, w] in about [0, 1] for a picture."""
    noise = torch.rand(1, 1, cells, cells, generator=torch.Generator().manual_seed(cells))
    return functional.interpolate(noise, picture.shape[1:], mode="bicubic", align_corners=True)[0, 0]


def _blotch(picture: Tensor) -> Tensor:
    """Returns a picture with blotches of rust."""
    rust, light = torch.tensor([0.62, 0.29, 0.10])[:, None, None], 0.65 + 0.5 * picture[:3].mean(0)
    spots = ((_noise(picture, 9) + 0.4 * _noise(picture, 30) - 0.55) * 8).clamp(0.1, 0.95)
    return torch.cat((torch.lerp(picture[:3], (rust * light).clamp(0, 1), spots.expand_as(picture[:3])), picture[3:]))


def _lay_snow(picture: Tensor, depth: float = 0.06) -> Tensor:
    """Returns a picture with snow on its upper edges, of a depth that is a share of its height."""
    deep = max(1, round(depth * picture.shape[1]))
    over = functional.pad(picture[3], (0, 0, deep, 0))[: picture.shape[1]]
    under = functional.pad(picture[3], (0, 0, 0, 2 * deep))[2 * deep :]  # lines bear no snow
    cap = soften((picture[3] * (1 - over) * under)[None], max(1, deep // 4))[0].clamp(0, 1) * (
        0.6 + 0.8 * _noise(picture, 14)
    ).clamp(0, 1)
    white = torch.tensor([0.96, 0.97, 1.0])[:, None, None].expand_as(picture[:3])
    return torch.cat((torch.lerp(picture[:3], white, (2 * cap).clamp(0, 1)), picture[3:]))


def _bury(picture: Tensor) -> Tensor:
    """Returns a picture without its foot, which a drift hides."""
    across = torch.linspace(-1, 1, picture.shape[2])
    drift = 1 - 0.22 * (1 - 0.6 * across**2) * (0.75 + 0.5 * _noise(picture, 5)[0])
    down = torch.linspace(0, 1, picture.shape[1])[:, None]
    return torch.cat((picture[:3], picture[3:] * (down < drift)))


def _stripe(picture: Tensor) -> Tensor:
    """Returns a picture with stripes that are darker, or lighter if it is dark."""
    y, x = (torch.arange(side) / max(picture.shape[1:]) for side in picture.shape[1:])
    is_dark = float((picture[:3].mean(0) * picture[3]).sum() / picture[3].sum().clamp(min=1)) < 0.4
    other = 1 - 0.25 * (1 - picture[:3]) if is_dark else 0.4 * picture[:3]
    pattern = (12 * (x + 0.25 * y[:, None])) % 1 < 0.45
    return torch.cat((torch.where(pattern, other, picture[:3]), picture[3:]))


class Appearance(NamedTuple):
    """Appearance that words ask for: factors of a thing's height, width and size, and a change of its picture."""

    words: tuple[str, ...]
    tall: float = 1.0
    wide: float = 1.0
    size: float = 1.0
    change: Callable[[Tensor], Tensor] | None = None


_LOOKS = (
    Appearance(("fat", "plump", "chubby", "obese", "stout"), change=_bulge),
    Appearance(("wide", "broad", "thick"), wide=1.4),
    Appearance(("thin", "slim", "skinny", "narrow", "slender"), wide=0.6),
    Appearance(("tall", "high", "towering"), tall=1.5),
    Appearance(("long", "elongated"), wide=1.6),
    Appearance(("short", "low"), tall=0.65),
    Appearance(("tiny", "small", "little", "miniature", "minuscule"), size=0.7),
    Appearance(("huge", "giant", "enormous", "big", "large", "massive"), size=1.8),
    Appearance(("bent", "bending", "swaying", "crooked", "windswept"), change=_bend),
    Appearance(("cracked", "broken", "shattered", "damaged", "smashed"), change=_crack),
    Appearance(("rusty", "rusted", "corroded"), change=_blotch),
    Appearance(("buried", "buried in snow"), change=_bury),
    Appearance(("melting", "melted", "thawing"), change=_melt),
    Appearance(("striped", "stripy"), change=_stripe),
)
_MEANS = 0.72  # similarity above which a word asks for an appearance
_FIGURES = 8  # of the first ones, which people can have too
_SIDE = 320  # pixels of a picture that is changed


def looks_of(words: Sequence[str], sentences: SentenceEncoder, *, is_person: bool) -> dict[str, Appearance]:
    """Returns the words that ask for an appearance, each with it. People change in their figure only."""
    owners = [look for look in _LOOKS[: _FIGURES if is_person else None] for _ in look.words]
    anchors = sentences.embed([word for look in dict.fromkeys(owners) for word in look.words])
    nearest = {word: (anchors @ sentences.embed([word])[0]).max(0) for word in words}
    return {word: owners[int(at)] for word, (similarity, at) in nearest.items() if float(similarity) >= _MEANS}


def change_looks(picture: Tensor, looks: Sequence[Appearance]) -> tuple[Tensor, float]:
    """Returns a picture [4, h, w] with an appearance, without transparent edges, and the factor of its height."""
    size = 1.0
    for look in looks:
        picture, size = resize(picture, _SIDE / max(picture.shape[1:])), size * look.size * look.tall
        picture = resize(picture, look.tall, look.wide / look.tall)
        picture = picture if look.change is None else crop(look.change(picture))
    return picture, size


def in_weather(picture: Tensor, weather: Weather, where: str, looks: Sequence[Appearance] = ()) -> Tensor:
    """Returns a picture [4, h, w] with snow on it, or bent by the wind, if its usual place is one for that."""
    if weather.wind and where == "plant" and _bend not in [look.change for look in looks]:
        return _bend(picture, weather.wind)
    return _lay_snow(picture) if weather.flakes and where in ("ground", "plant") else picture
