"""Words in a style: a thing laid into the style picture, or a scene in the picture's colours and marks."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from frida_painter import images
from frida_painter.objectives.style_marks import (
    from_lab_picture,
    in_colors,
    mix_composition,
    pieces_of,
    quilt,
    shape_of_pieces,
    to_lab_picture,
)
from frida_painter.palette import Palette, from_lab, to_lab
from frida_painter.words.compositing import paste, resize

_ROWS = 96  # of the small picture on which places for the thing are tried
_AREA = 4  # its pixels, half the width over which an edge is measured
_STYLE_SCENE_AROUND = 6  # its pixels around a thing, which are its background
_SIZES = (0.85, 0.75, 0.65)  # of the shorter side
_PLACES = (0.06, 0.21, 0.35, 0.5, 0.65, 0.79, 0.94)  # positions in the free space, down and across
_COLORS = 8  # number of the picture's colours besides its darkest and lightest
_LOOKED_AT = 4000  # number of its pixels from which they are taken
_TONES = ((0.0, 1.0), (0.0, 0.6), (0.4, 1.0))  # tones for a thing, 0 for the picture's darkest
_FEWEST_TONES = 10.0  # least range of L* in a drawing with shades
_CLEAR = 40.0  # difference of L* that counts as full visibility
_KEEPING, _LARGE = 0.7, 0.55  # weights of unchanged edges and of size, against visibility


@dataclass(frozen=True)
class Composited:
    """Picture [3, H, W] with a thing in it, and the thing's opacity, [H, W] in [0, 1]."""

    picture: Tensor
    where: Tensor


def composite_into_style(
    drawing: Tensor,
    picture: Tensor,
    *,
    own: float = 0.0,
    sizes: Sequence[float] = _SIZES,
    rows: tuple[float, float] = (0.0, 1.0),
) -> Composited:
    """Lays a drawing, colour and opacity [4, h, w], into a picture [3, H, W].

    own: share of its own colours that the drawing keeps; the rest are the picture's colours, from dark to light
    sizes: possible lengths of its longer side, relative to the picture's shorter one
    rows: least and greatest position in the free space, from the picture's upper edge, 0, to its lower one

    The place is a compromise: the picture's coarse edges should change little, by their correlation, and the thing
    should be large and stand out clearly.
    """
    small = images.fit(picture, _ROWS, round(_ROWS * picture.shape[2] / picture.shape[1]))
    edges, light = _edges(small), _lightness(small)
    colors = style_colors(picture)
    painted = [drawing] if own == 1 else [torch.lerp(tone(drawing, colors, *tones), drawing, own) for tones in _TONES]
    best, chosen = -float("inf"), (0, sizes[-1], 0.5, 0.5)
    heights = [down for down in _PLACES if rows[0] <= down <= rows[1]]
    for number, size in product(range(len(painted)), sizes):
        thing = _resize_to(painted[number], size, small)
        bright = float(_lightness(thing[:3])[thing[3] > 0.5].median())
        for down, across in product(heights, _PLACES):
            shown, where = paste(thing, small, *_place(thing, small, down, across))
            wider = (
                functional.max_pool2d(where[None, None], 2 * _STYLE_SCENE_AROUND + 1, 1, _STYLE_SCENE_AROUND)[0, 0]
                - where
            )
            clear = min(1.0, abs(bright - float((light * wider).sum() / wider.sum())) / _CLEAR)
            kept = float(torch.corrcoef(torch.stack((_edges(shown).flatten(), edges.flatten())))[0, 1])
            if (worth := _KEEPING * kept + clear + _LARGE * size) > best:
                best, chosen = worth, (number, size, down, across)
    number, size, down, across = chosen
    thing = _resize_to(painted[number], size, picture)
    return Composited(*paste(thing, picture, *_place(thing, picture, down, across)))


def _resize_to(drawing: Tensor, size: float, picture: Tensor) -> Tensor:
    """Returns a drawing whose longer side is `size` of the picture's shorter one."""
    return resize(drawing, size * min(picture.shape[1:]) / max(drawing.shape[1:]))


def _place(thing: Tensor, picture: Tensor, down: float, across: float) -> tuple[int, int]:
    """Returns the first row and column of a thing, from its position in the free space: 0 to 1 down and across."""
    return round(down * (picture.shape[1] - thing.shape[1])), round(across * (picture.shape[2] - thing.shape[2]))


def _edges(picture: Tensor) -> Tensor:
    """Returns the gradient of lightness at the scale of areas, not of marks."""
    smooth = functional.avg_pool2d(picture.mean(0)[None], 2 * _AREA + 1, 1)[0]
    across = smooth[:, 2 * _AREA :] - smooth[:, : -2 * _AREA]
    down = smooth[2 * _AREA :] - smooth[: -2 * _AREA]
    return (across[_AREA:-_AREA].square() + down[:, _AREA:-_AREA].square()).sqrt()


def _lightness(picture: Tensor) -> Tensor:
    """Returns L* of a picture [3, h, w], [h, w]."""
    return to_lab(picture.permute(1, 2, 0))[..., 0]


def style_colors(picture: Tensor) -> Tensor:
    """Returns the picture's colours in Lab, [n, 3], from its darkest to its lightest."""
    seen = picture.flatten(1).T
    seen = seen[:: max(1, len(seen) // _LOOKED_AT)]
    lab, middle = to_lab(seen), Palette.cluster(seen, torch.ones(len(seen)), _COLORS, seed=0).lab()
    low, high = lab[:, 0].quantile(0.03), lab[:, 0].quantile(0.97)
    ends = [lab[lab[:, 0] <= low].mean(0, keepdim=True), lab[lab[:, 0] >= high].mean(0, keepdim=True)]
    between = middle[(middle[:, 0] > ends[0][0, 0]) & (middle[:, 0] < ends[1][0, 0])].flip(0)
    return torch.cat((ends[0], between, ends[1]))


def tone(drawing: Tensor, colors: Tensor, low: float, high: float) -> Tensor:
    """Returns the drawing in `colors` (Lab, dark to light), restricted to the range from `low` to `high`."""
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


# A scene in the colours, the value structure and the marks of a style picture. Things keep their shape.

_CLEAR_SHAPE = 1.6  # factor of the opacity of things, whose soft edges are theirs
_OWN = 0.8  # share of its own picture that a thing keeps


def in_style(scene: Tensor, where: Tensor, style: Tensor) -> Tensor:
    """Returns a scene [3, H, W] in sRGB in the colours, values and marks of a style picture [3, h, w].

    where [H, W]: opacity of the scene's things, in [0, 1]; they take the colours over all its values, so that they
    stand out, and hardly the marks
    """
    rows, columns = scene.shape[1:]
    shape = shape_of_pieces(rows, columns)
    whole = to_lab_picture(images.fit(style, *shape))
    small, thing = images.fit(scene, *shape), (_CLEAR_SHAPE * images.fit(where[None], *shape)).clamp(max=1)
    ground = in_colors(mix_composition(to_lab_picture(small), whole, thing), whole)
    own = tone(torch.cat((small, thing)), style_colors(style), 0.0, 1.0)[:3] if bool((thing > 0.5).any()) else small
    colored = torch.lerp(ground, to_lab_picture(own), thing)
    painted = torch.lerp(quilt(colored, pieces_of(style)), colored, _OWN * thing)
    return images.fit(from_lab_picture(painted), rows, columns)
