"""Scene of words in a style: it takes the colours, the value structure and the marks of a style picture.

First, optimal transport moves the scene's colours to those of the style: light for light and dark for dark, with the
style's own share of each colour (Rabin et al. 2011, "Wasserstein barycenter and its application to texture mixing").
Then the scene is put together from pieces of the style picture: each piece is like the scene at its place and fits its
neighbours (Efros and Freeman 2001, "Image quilting for texture synthesis and transfer"). Things keep their own shape.
"""

import torch
from torch import Tensor
from torch.nn import functional

from frida_painter import images
from frida_painter.palette import from_lab, to_lab
from frida_painter.words.style_scene import style_colors, tone

_ROWS = 128  # of the small scene that is put together
_TURNS = 12  # of the axes along which colours are moved
_LAYOUT = 0.15  # share of the style's own composition, in even areas of the scene
_LONGEST = 1.6  # longer side of the style that is used, in shorter ones
_PIECE, _STEP, _APART = 22, 16, 3  # pixels: side of a piece, distance of pieces, and of candidates
_COARSE = 3  # pixels: radius within which a piece is compared with the scene
_ALIKE = 0.7  # weight of the likeness to the scene; the rest is that of fitting the neighbours
_CLEAR = 1.6  # factor of the opacity of things, whose soft edges are theirs
_OWN = 0.8  # share of its own picture that a thing keeps


def in_style(scene: Tensor, where: Tensor, style: Tensor) -> Tensor:
    """Returns a scene [3, H, W] in sRGB in the colours, values and marks of a style picture [3, h, w].

    where [H, W]: opacity of the scene's things, in [0, 1]; they take the colours over all its values, so that they
    stand out, and hardly the marks
    """
    rows, columns = scene.shape[1:]
    shape = _ROWS, max(_PIECE, round(_ROWS * columns / rows))
    marks = _lab(images.fit(style, *_shape_of_marks(style)))
    small, thing = images.fit(scene, *shape), (_CLEAR * images.fit(where[None], *shape)).clamp(max=1)
    ground = _in_colors(_lab(small), _lab(images.fit(style, *shape)), thing)
    own = tone(torch.cat((small, thing)), style_colors(style), 0.0, 1.0)[:3] if bool((thing > 0.5).any()) else small
    colored = torch.lerp(ground, _lab(own), thing)
    painted = torch.lerp(_quilt(colored, marks), colored, _OWN * thing)
    return images.fit(from_lab(painted.permute(1, 2, 0)).permute(2, 0, 1), rows, columns)


def _shape_of_marks(style: Tensor) -> tuple[int, int]:
    """Returns rows and columns of the part of a style that pieces are taken from: of a panorama the middle."""
    shorter = min(style.shape[1:])
    rows, columns = (round(_ROWS * min(side / shorter, _LONGEST)) for side in style.shape[1:])
    return rows, columns


def _lab(picture: Tensor) -> Tensor:
    return to_lab(picture.permute(1, 2, 0)).permute(2, 0, 1)


def _in_colors(scene: Tensor, style: Tensor, thing: Tensor) -> Tensor:
    """Returns the scene [3, H, W] in the colours of a style [3, H, W], both in Lab.

    Even areas have no order of light and dark of their own; there the style's composition decides.
    """
    mixed = scene + _LAYOUT * (1 - thing) * (style - style.mean((1, 2), keepdim=True))
    return transport(mixed.flatten(1).T, style.flatten(1).T).T.reshape(scene.shape)


def transport(colors: Tensor, wanted: Tensor) -> Tensor:
    """Returns colours [n, 3] moved so that they are distributed as `wanted` [m, 3] is, with little movement.

    Along each of some axes, the i-th smallest value becomes the i-th smallest wanted one. The first axes are the given
    ones, so that lightness keeps its order.
    """
    chance = torch.Generator().manual_seed(0)
    rank = torch.linspace(0, len(wanted) - 1, len(colors)).round().long()
    for turn in range(_TURNS):
        axes = torch.linalg.qr(torch.randn(3, 3, generator=chance)).Q if turn else torch.eye(3)
        seen, aim = colors @ axes, (wanted @ axes).sort(0).values[rank]
        moved = torch.empty_like(seen).scatter_(0, seen.argsort(dim=0, stable=True), aim)
        colors = colors + (moved - seen) @ axes.T
    return colors


def _quilt(scene: Tensor, style: Tensor) -> Tensor:
    """Returns the scene [3, H, W] put together from pieces of the style [3, h, w], both in Lab."""
    pieces, coarse = (functional.unfold(picture[None], _PIECE, stride=_APART)[0] for picture in (style, _soften(style)))
    wanted, size = _soften(scene), 3 * _PIECE**2
    laid, weight = torch.zeros_like(scene), torch.zeros_like(scene)
    ramp = torch.arange(1.0, _PIECE + 1)
    ramp = torch.minimum(ramp, ramp.flip(0)).clamp(max=_PIECE - _STEP)
    window = (ramp[:, None] * ramp).expand(3, -1, -1)
    for top in _places(scene.shape[1]):
        for left in _places(scene.shape[2]):
            here = (slice(None), slice(top, top + _PIECE), slice(left, left + _PIECE))
            cost = _ALIKE * (coarse - wanted[here].reshape(size, 1)).square().mean(0)
            beside = weight[here].reshape(size) > 0
            if bool(beside.any()):
                there = (laid[here] / weight[here].clamp(min=1e-6)).reshape(size)[beside]
                cost = cost + (1 - _ALIKE) * (pieces[beside] - there[:, None]).square().mean(0)
            laid[here] += window * pieces[:, int(cost.argmin())].reshape(3, _PIECE, _PIECE)
            weight[here] += window
    return laid / weight


def _soften(picture: Tensor) -> Tensor:
    around = functional.pad(picture[None], (_COARSE,) * 4, mode="replicate")
    return functional.avg_pool2d(around, 2 * _COARSE + 1, 1)[0]


def _places(length: int) -> list[int]:
    """Returns the first pixels of pieces that cover `length` pixels."""
    return [*range(0, length - _PIECE, _STEP), length - _PIECE]
