"""How different two colours look: CIEDE2000, where 1 is about the least that a person sees."""

import math

import torch
from torch import Tensor

from frida_painter.palette import to_lab

_25_TO_7 = 25.0**7


def difference(one: Tensor, other: Tensor) -> Tensor:
    """CIEDE2000 between sRGB colours in [0, 1], [..., 3] and [..., 3] -> [...]. Not differentiable."""
    return ciede2000(to_lab(one.clamp(0, 1)), to_lab(other.clamp(0, 1)))


def ciede2000(one: Tensor, other: Tensor) -> Tensor:
    """CIEDE2000 between CIE L*a*b* colours, [..., 3] and [..., 3] -> [...], with all weights 1.

    ISO/CIE 11664-6; as written down by G. Sharma, W. Wu and E. Dalal, "The CIEDE2000 color-difference
    formula: implementation notes, supplementary test data, and mathematical observations" (2005).
    """
    (l1, a1, b1), (l2, a2, b2) = one.unbind(-1), other.unbind(-1)
    chroma = (torch.hypot(a1, b1) + torch.hypot(a2, b2)) / 2
    stretch = 1 + 0.5 * (1 - _share_of_25(chroma))  # brings grey axes upright
    a1, a2 = stretch * a1, stretch * a2
    c1, c2 = torch.hypot(a1, b1), torch.hypot(a2, b2)
    h1, h2 = torch.atan2(b1, a1) % math.tau, torch.atan2(b2, a2) % math.tau
    colored = c1 * c2 != 0
    turn = torch.where(colored, (h2 - h1 + math.pi) % math.tau - math.pi, torch.zeros_like(h1))
    lightness_apart, chroma_apart = l2 - l1, c2 - c1
    hue_apart = 2 * (c1 * c2).sqrt() * torch.sin(turn / 2)

    lightness, chroma = (l1 + l2) / 2, (c1 + c2) / 2
    across_zero = ((h1 - h2).abs() > math.pi).to(h1)
    middle = (h1 + h2) / 2 + math.pi * across_zero
    hue = torch.where(colored, middle % math.tau, h1 + h2)  # a grey has no hue, so the other one's counts
    weight = (
        1
        - 0.17 * torch.cos(hue - math.radians(30))
        + 0.24 * torch.cos(2 * hue)
        + 0.32 * torch.cos(3 * hue + math.radians(6))
        - 0.20 * torch.cos(4 * hue - math.radians(63))
    )
    offset = (lightness - 50) ** 2
    by_lightness = lightness_apart / (1 + 0.015 * offset / (20 + offset).sqrt())
    by_chroma = chroma_apart / (1 + 0.045 * chroma)
    by_hue = hue_apart / (1 + 0.015 * chroma * weight)
    # Among blues, chroma and hue are not independent.
    blue = math.radians(30) * torch.exp(-(((torch.rad2deg(hue) - 275) / 25) ** 2))
    rotation = -torch.sin(2 * blue) * 2 * _share_of_25(chroma)
    return (by_lightness**2 + by_chroma**2 + by_hue**2 + rotation * by_chroma * by_hue).clamp(min=0).sqrt()


def _share_of_25(chroma: Tensor) -> Tensor:
    """From 0 for grey to 1 for vivid colours."""
    return (chroma**7 / (chroma**7 + _25_TO_7)).sqrt()
