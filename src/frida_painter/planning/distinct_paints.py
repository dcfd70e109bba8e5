"""Wells that differ: paints that are hardly told apart become one, and the well that is free gets an accent."""

import torch
from torch import Tensor

from frida_painter.palette import Palette, to_lab
from frida_painter.perception.difference import ciede2000
from frida_painter.planning.variables import Paints

HARDLY_APART = 2.5
"""CIEDE2000 below which two paints are hardly told apart, and become one. By 5, photographs lost 0.1 to 0.2 dB, and
things that words name got colours that they do not have, as a dolphin green and purple."""
_GROWN = 0.8  # of that, below which paints that grew alike while they were optimised are one in the end


def distinct(palette: Palette, color: Tensor, weight: Tensor, apart: float) -> Palette:
    """The palette, lightest first, with no two paints nearer than `apart`; a well that is free gets an accent.

    color [n, 3], weight [n]: the colours for which the palette was chosen, and how much each matters. An accent is the
    one that matters most for how far it is from all paints. There are fewer paints where none is far from them.
    """
    paint = palette.nearest(color)
    mass = weight.new_zeros(len(palette)).index_add(0, paint.to(weight.device), weight)
    paints, _ = _merged(palette.color, mass, apart)
    lab = to_lab(color)
    for _ in range(len(palette) - len(paints)):
        gap = ciede2000(lab[:, None], to_lab(paints)[None]).amin(1)
        worth = torch.where(gap >= apart, weight * gap.square(), 0)
        if not float(worth.max()) > 0:
            break
        paints = torch.cat((paints, color[worth.argmax()][None]))
    return Palette.ordered(paints)


def without_twins(paints: Paints, apart: float) -> Paints:
    """The paints; those that came clearly nearer to each other than `apart` are one. Strokes keep their order."""
    strokes = torch.bincount(paints.paint, minlength=len(paints.color)).to(paints.color)
    colors, number = _merged(paints.color, strokes, _GROWN * apart)
    return Paints(colors, number[paints.paint], paints.first)


def _merged(color: Tensor, mass: Tensor, apart: float) -> tuple[Tensor, Tensor]:
    """Colours [m, 3], each two of which are `apart` in CIEDE2000 at least, and which of them each of the old is, [k].

    The two that are nearest become their mean, each mattering by its mass [k], until none are too near.
    """
    number = torch.arange(len(color), device=color.device)
    while len(color) > 1:
        lab = to_lab(color)
        gap = ciede2000(lab[:, None], lab[None])
        gap.fill_diagonal_(torch.inf)
        nearest = int(gap.argmin())
        one, other = sorted((nearest // len(color), nearest % len(color)))
        if float(gap[one, other]) >= apart:
            break
        pair = torch.stack((mass[one], mass[other])) + 1e-9
        color, mass = color.clone(), mass.clone()
        color[one], mass[one] = (pair[:, None] * color[[one, other]]).sum(0) / pair.sum(), pair.sum()
        stays = torch.arange(len(color), device=color.device) != other
        color, mass = color[stays], mass[stays]
        number = torch.where(number == other, one, number - (number > other).long())
    return color, number
