"""A thing in a picture whose composition is to stay: where few of its edges change and it is seen, in its colours."""

from dataclasses import dataclass
from itertools import product

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from frida_painter import images
from frida_painter.objectives.compositing import laid, resized
from frida_painter.palette import Palette, from_lab, to_lab

_ROWS = 96  # of the picture in which places are compared
_AREA = 4  # pixels of it, half the width over which an edge is looked at
_AROUND = 6  # pixels of it around a thing, against which it is seen
_SIZES = (0.85, 0.75, 0.65)  # of the shorter side
_PLACES = (0.06, 0.21, 0.35, 0.5, 0.65, 0.79, 0.94)  # of what is free, down and across
_COLORS = 8  # of the picture, and its darkest and lightest
_LOOKED_AT = 4000  # pixels of it from which they are taken
_TONES = ((0.0, 1.0), (0.0, 0.6), (0.4, 1.0))  # from the darkest of them, 0, to the lightest, 1, that a thing may have
_FEWEST_TONES = 10.0  # L* from the darkest to the lightest of a drawing that has shades
_CLEAR = 40.0  # L* by which a thing stands out as well as can be
_KEEPING, _LARGE = 0.7, 0.55  # what unchanged edges and size count against standing out


@dataclass(frozen=True)
class Composited:
    """A picture [3, H, W] with a thing in it, and how much of that is where, [H, W] in [0, 1]."""

    picture: Tensor
    where: Tensor


def composited_into_style(drawing: Tensor, picture: Tensor, *, keeps_colors: bool = False) -> Composited:
    """A drawing, colour and opacity [4, h, w], in a picture [3, H, W].

    It is laid where the picture's coarse edges, by their correlation, change least for how large it is and how
    clearly it stands out. It gets the picture's colours, dark ones for dark and light for light, unless it
    `keeps_colors`.
    """
    _, rows, columns = picture.shape
    small = images.fit(picture, _ROWS, round(_ROWS * columns / rows))
    edges, light = _edges(small), _lightness(small)
    colors = _colors(picture)
    painted = [drawing] if keeps_colors else [_toned(drawing, colors, *tones) for tones in _TONES]
    best, chosen = -float("inf"), (0, _SIZES[-1], 0.5, 0.5)
    for number, size in product(range(len(painted)), _SIZES):
        thing = _sized(painted[number], size, small)
        own = float(_lightness(thing[:3])[thing[3] > 0.5].median())
        for down, across in product(_PLACES, _PLACES):
            shown, where = laid(thing, small, *_place(thing, small, down, across))
            wider = functional.max_pool2d(where[None, None], 2 * _AROUND + 1, 1, _AROUND)[0, 0] - where
            clear = min(1.0, abs(own - float((light * wider).sum() / wider.sum())) / _CLEAR)
            kept = float(torch.corrcoef(torch.stack((_edges(shown).flatten(), edges.flatten())))[0, 1])
            if (worth := _KEEPING * kept + clear + _LARGE * size) > best:
                best, chosen = worth, (number, size, down, across)
    number, size, down, across = chosen
    thing = _sized(painted[number], size, picture)
    return Composited(*laid(thing, picture, *_place(thing, picture, down, across)))


def _sized(drawing: Tensor, size: float, picture: Tensor) -> Tensor:
    """A drawing whose longer side is `size` of the picture's shorter one."""
    return resized(drawing, size * min(picture.shape[1:]) / max(drawing.shape[1:]))


def _place(thing: Tensor, picture: Tensor, down: float, across: float) -> tuple[int, int]:
    """The first row and column of a thing that lies so far down and across what it leaves free."""
    return round(down * (picture.shape[1] - thing.shape[1])), round(across * (picture.shape[2] - thing.shape[2]))


def _edges(picture: Tensor) -> Tensor:
    """How steeply lightness changes over the size of an area rather than of a mark."""
    smooth = functional.avg_pool2d(picture.mean(0)[None], 2 * _AREA + 1, 1)[0]
    across = smooth[:, 2 * _AREA :] - smooth[:, : -2 * _AREA]
    down = smooth[2 * _AREA :] - smooth[: -2 * _AREA]
    return (across[_AREA:-_AREA].square() + down[:, _AREA:-_AREA].square()).sqrt()


def _lightness(picture: Tensor) -> Tensor:
    """L* of a picture [3, h, w], [h, w]."""
    return to_lab(picture.permute(1, 2, 0))[..., 0]


def _colors(picture: Tensor) -> Tensor:
    """The picture's colours in Lab, [n, 3], from its darkest to its lightest."""
    seen = picture.flatten(1).T
    seen = seen[:: max(1, len(seen) // _LOOKED_AT)]
    lab, middle = to_lab(seen), Palette.cluster(seen, torch.ones(len(seen)), _COLORS, seed=0).lab()
    low, high = lab[:, 0].quantile(0.03), lab[:, 0].quantile(0.97)
    ends = [lab[lab[:, 0] <= low].mean(0, keepdim=True), lab[lab[:, 0] >= high].mean(0, keepdim=True)]
    between = middle[(middle[:, 0] > ends[0][0, 0]) & (middle[:, 0] < ends[1][0, 0])].flip(0)
    return torch.cat((ends[0], between, ends[1]))


def _toned(drawing: Tensor, colors: Tensor, low: float, high: float) -> Tensor:
    """The drawing in `colors` (Lab, dark to light), of which it has those between `low` and `high` of their range."""
    light = _lightness(drawing[:3])
    seen = light[drawing[3] > 0.5]
    first, last = seen.quantile(0.02), seen.quantile(0.98)
    share = ((light - first) / (last - first).clamp(min=_FEWEST_TONES)).clamp(0, 1)
    dark, bright = colors[0, 0], colors[-1, 0]
    wanted = (dark + (low + (high - low) * share) * (bright - dark)).numpy()
    scale = colors.numpy()
    lab = np.stack([np.interp(wanted, scale[:, 0], scale[:, part]) for part in range(3)])
    painted = from_lab(torch.from_numpy(lab).float().permute(1, 2, 0)).permute(2, 0, 1)
    return torch.cat((painted, drawing[3:]))
