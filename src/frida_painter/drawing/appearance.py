"""Appearance of a thing that its words ask for: a fat pigeon, a rusty can, a melting snowman."""

import math
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

from frida_painter.drawing.compositing import crop, resize, sample, soften, warp_rows
from frida_painter.drawing.lights import Color, Weather, color_of
from frida_painter.drawing.tables import read_lines
from frida_painter.objectives.encoders.sentence import SentenceEncoder


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


def _noise(picture: Tensor, down: float, across: float = 0) -> Tensor:
    """Returns smooth noise [h, w] in about [0, 1] for a picture, with that number of cells down, and across."""
    noise = torch.rand(1, 1, int(down), int(across or down), generator=torch.Generator().manual_seed(int(down)))
    return functional.interpolate(noise, picture.shape[1:], mode="bicubic", align_corners=True)[0, 0]


def _blotch(picture: Tensor, color: Color, at_foot: float = 0.0) -> Tensor:
    """Returns a picture with blotches of rust, mud or dust, by so much more at its foot."""
    light, down = 0.65 + 0.5 * picture[:3].mean(0), torch.linspace(-0.5, 0.5, picture.shape[1])[:, None]
    spots = ((_noise(picture, 9) + 0.4 * _noise(picture, 30) - 0.55 + at_foot * (down - 0.1)) * 8).clamp(0.1, 0.95)
    stained = (color_of(color)[:, None, None] * light).clamp(0, 1)
    return torch.cat((torch.lerp(picture[:3], stained, spots.expand_as(picture[:3])), picture[3:]))


def _make_of(
    picture: Tensor, color: Color, down: float, across: float, grain: float, share: float = 1.0, opacity: float = 1.0
) -> Tensor:
    """Returns a picture as if made of a material: its colour with the picture's light, and a grain of cells.

    share: of the material's colour
    """
    gray, seen = picture[:3].mean(0), picture[3]
    light = (
        1 + 0.9 * (gray - (gray * seen).sum() / seen.sum().clamp(min=1)) + grain * (_noise(picture, down, across) - 0.5)
    )
    made = (color_of(color)[:, None, None] * light).clamp(0, 1)
    return torch.cat((torch.lerp(picture[:3], made, share), opacity * picture[3:]))


def _steam(picture: Tensor) -> Tensor:
    """Returns a picture with steam rising from it."""
    high = picture.shape[1] // 2
    tall, up = functional.pad(picture, (0, 0, high, 0)), torch.linspace(1, 0, high)[:, None]
    across = torch.linspace(-1, 1, picture.shape[2]) + 0.06 * (11 * up).sin()
    wisps = torch.stack([1 - ((across - middle) / 0.1) ** 2 for middle in (-0.35, 0.0, 0.35)]).amax(0).clamp(min=0)
    tall[:3, :high], tall[3, :high] = 0.94, torch.maximum(tall[3, :high], 0.8 * wisps * (1 - up**2))
    return tall


def _bite(picture: Tensor) -> Tensor:
    """Returns a picture without a bite at its upper right."""
    y, x = torch.meshgrid(*(torch.linspace(-1, 1, side) for side in picture.shape[1:]), indexing="ij")
    bites = [
        (x - at) ** 2 + (y - high) ** 2 < size**2
        for at, high, size in ((0.9, -0.5, 0.4), (0.75, -0.15, 0.3), (0.98, 0.1, 0.3))
    ]
    return torch.cat((picture[:3], picture[3:] * ~torch.stack(bites).any(0)))


def turn(picture: Tensor, degrees: float) -> Tensor:
    """Returns a picture turned to the right."""
    _, rows, columns = picture.shape
    around = math.ceil((math.hypot(rows, columns) - min(rows, columns)) / 2) + 1
    wide = functional.pad(picture, (around,) * 4)
    turn, (_, height, width) = math.radians(degrees), wide.shape
    y, x = torch.meshgrid(*(torch.linspace(-side / 2, side / 2, side) for side in wide.shape[1:]), indexing="ij")
    across, down = x * math.cos(turn) + y * math.sin(turn), y * math.cos(turn) - x * math.sin(turn)
    return sample(wide, torch.stack((2 * across / width, 2 * down / height), 2))


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


def _pattern(picture: Tensor, kind: str) -> Tensor:
    """Returns a picture with a pattern that is darker, or lighter if it is dark."""
    y, x = (torch.arange(side) / max(picture.shape[1:]) for side in picture.shape[1:])
    y, light = y[:, None], float((picture[:3].mean(0) * picture[3]).sum() / picture[3].sum().clamp(min=1))
    pattern = {
        "stripes": (12 * (x + 0.25 * y)) % 1 < 0.45,
        "dots": ((9 * x + 0.5 * ((9 * y) // 1 % 2)) % 1 - 0.5) ** 2 + ((9 * y) % 1 - 0.5) ** 2 < 0.09,
        "spots": _noise(picture, 11) + 0.3 * _noise(picture, 23) > 0.82,
        "checks": ((8 * x) % 1 < 0.5) ^ ((8 * y) % 1 < 0.5),
        "stitches": (26 * (y + 0.04 * ((13 * x) % 1 - 0.5).abs() * 2)) % 1 < 0.3,
    }[kind]
    other = 1 - 0.25 * (1 - picture[:3]) if light < (0.75 if kind == "dots" else 0.4) else 0.4 * picture[:3]
    return torch.cat((torch.where(pattern, other, picture[:3]), picture[3:]))


class Appearance(NamedTuple):
    """Appearance that words ask for: factors of a thing's height, width and size, and a change of its picture."""

    words: tuple[str, ...]
    tall: float = 1.0
    wide: float = 1.0
    size: float = 1.0
    change: Callable[[Tensor], Tensor] | None = None


_CHANGES: dict[str, Callable[..., Tensor]] = {
    "bulge": _bulge, "bend": _bend, "crack": _crack, "blotch": _blotch, "bury": _bury, "melt": _melt,
    "pattern": _pattern, "make": _make_of, "steam": _steam, "bite": _bite, "turn": turn, 
    "lean": lambda picture, by: turn(picture, by if picture.shape[1] > 1.3 * picture.shape[2] else 0),
}  # fmt: skip


def _given(change: Callable[..., Tensor], given: Sequence[float | str]) -> Callable[[Tensor], Tensor]:
    return lambda picture: change(picture, *given)


@cache
def known_looks() -> tuple[Appearance, ...]:
    """Returns the table of `looks.txt`."""
    found = []
    for words, _, said in (line.partition(": ") for line in read_lines("drawing/looks.txt")):
        kind, *rest = said.split()
        given = [float(one) if one[0] in "-.0123456789" else one for one in rest]
        changed: dict[str, Any] = {kind: given[0] if given else 1.0}
        if kind in _CHANGES:
            changed = {"change": _given(_CHANGES[kind], given) if given else _CHANGES[kind]}
        found.append(Appearance(tuple(words.split(", ")), **changed))
    return tuple(found)


_MEANS = 0.72  # similarity above which a word asks for an appearance
_FIGURES = 10  # of the first ones, which people can have too
_SIDE = 320  # pixels of a picture that is changed


def looks_of(words: Sequence[str], sentences: SentenceEncoder, *, is_person: bool) -> dict[str, Appearance]:
    """Returns the words that ask for an appearance, each with it. People change in their figure only."""
    owners = [(look, word) for look in known_looks()[: _FIGURES if is_person else None] for word in look.words]
    anchors = sentences.embed([word for _, word in owners])
    nearest = {word: (anchors @ sentences.embed([word])[0]).max(0) for word in words}
    return {word: owners[int(at)][0] for word, (similarity, at) in nearest.items() if float(similarity) >= _MEANS}


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
