"""Drawings of colour and opacity laid on pictures, large in the middle or wherever they are wanted."""

import torch
from torch import Tensor
from torch.nn import functional

_FILLS = 0.85  # of the canvas's shorter side


def lay(drawing: Tensor, ground: Tensor) -> Tensor:
    """The ground [3, H, W] with a drawing [4, h, w], sRGB and opacity in [0, 1], large in its middle."""
    _, rows, columns = ground.shape
    small = resized(drawing, _FILLS * min(rows, columns) / max(drawing.shape[1:]))
    return laid(small, ground, (rows - small.shape[1]) // 2, (columns - small.shape[2]) // 2)[0]


def laid(drawing: Tensor, picture: Tensor, top: int, left: int) -> tuple[Tensor, Tensor]:
    """The picture [3, H, W] with a drawing [4, h, w] at a place where it fits, and how much of it is there, [H, W]."""
    _, rows, columns = picture.shape
    around = [left, columns - left - drawing.shape[2], top, rows - top - drawing.shape[1]]
    over = functional.pad(drawing, around)
    return torch.lerp(picture, over[:3], over[3:]).clamp(0, 1), over[3]


def resized(drawing: Tensor, scale: float) -> Tensor:
    """A drawing [4, h, w] at so many times its size."""
    size = [max(1, round(drawing.shape[1] * scale)), max(1, round(drawing.shape[2] * scale))]
    # Colours are resampled as far as they are seen: what is transparent has none.
    seen = torch.cat((drawing[:3] * drawing[3:], drawing[3:]))[None]
    small = functional.interpolate(seen, size, mode="bilinear", antialias=True)[0].clamp(0, 1)
    return torch.cat((small[:3] / small[3:].clamp(min=1e-4), small[3:])).clamp(0, 1)


def softened(picture: Tensor, near: int) -> Tensor:
    """A picture [c, h, w] without what is smaller than `near` pixels: twice a mean over squares, edges going on."""
    for _ in range(2):
        around = functional.pad(picture[None], (near,) * 4, mode="replicate")
        picture = functional.avg_pool2d(around, 2 * near + 1, 1)[0]
    return picture
