"""Drawings of colour and opacity laid on pictures: one alone, several side by side, wherever they are wanted."""

from collections.abc import Sequence

import torch
from torch import Tensor
from torch.nn import functional

_FILLS = 0.85  # of the canvas's shorter side
_RAISED_FILLS, _RAISED_AT = 0.55, 0.35  # of a thing that is above what the ground shows
_SIDE = 256  # pixels of a drawing among others
_BEHIND = 0.8  # size of every other copy of a drawing
_OVERLAP = 0.04  # of a drawing's side


def lay(drawing: Tensor, ground: Tensor, *, wide: bool = False, raised: bool = False) -> Tensor:
    """The ground [3, H, W] with a drawing [4, h, w], sRGB and opacity in [0, 1], large in its middle.

    wide: it may fill the longer side too, as things that stand side by side do; raised: it is smaller, and higher up.
    """
    _, rows, columns = ground.shape
    room = (rows, columns) if wide else (min(rows, columns),) * 2
    scale = min(side / of for side, of in zip(room, drawing.shape[1:], strict=True))
    small = resized(drawing, (_RAISED_FILLS if raised else _FILLS) * scale)
    top = round((_RAISED_AT if raised else 0.5) * rows - small.shape[1] / 2)
    return laid(small, ground, max(0, top), (columns - small.shape[2]) // 2)[0]


def laid(drawing: Tensor, picture: Tensor, top: int, left: int) -> tuple[Tensor, Tensor]:
    """The picture [3, H, W] with a drawing [4, h, w] at a place where it fits, and how much of it is there, [H, W]."""
    _, rows, columns = picture.shape
    around = [left, columns - left - drawing.shape[2], top, rows - top - drawing.shape[1]]
    over = functional.pad(drawing, around)
    return torch.lerp(picture, over[:3], over[3:]).clamp(0, 1), over[3]


def resized(drawing: Tensor, scale: float, narrowed: float = 1.0) -> Tensor:
    """A drawing [4, h, w] at so many times its size, and that at so much of its width."""
    size = [max(1, round(drawing.shape[1] * scale)), max(1, round(drawing.shape[2] * scale * narrowed))]
    # Colours are resampled as far as they are seen: what is transparent has none.
    seen = torch.cat((drawing[:3] * drawing[3:], drawing[3:]))[None]
    small = functional.interpolate(seen, size, mode="bilinear", antialias=True)[0].clamp(0, 1)
    return torch.cat((small[:3] / small[3:].clamp(min=1e-4), small[3:])).clamp(0, 1)


def side_by_side(drawings: Sequence[Tensor]) -> Tensor:
    """Drawings [4, h, w] of several things as one, on one floor; copies look at each other, and differ in size."""
    shown = []
    for number, drawing in enumerate(drawings):
        copy = sum(other is drawing for other in drawings[:number])
        size = _SIDE * (_BEHIND if copy % 2 else 1.0)
        one = resized(drawing, size / max(drawing.shape[1:]))
        shown.append(one.flip(2) if copy % 2 else one)
    closer = round(_OVERLAP * _SIDE)
    rows = max(one.shape[1] for one in shown)
    columns = sum(one.shape[2] - closer for one in shown) + closer
    colors, opacity, left = torch.zeros(3, rows, columns), torch.zeros(1, rows, columns), 0  # colours as far as seen
    for one in shown:
        over = functional.pad(one, [left, columns - left - one.shape[2], rows - one.shape[1], 0])
        colors = over[:3] * over[3:] + (1 - over[3:]) * colors
        opacity = over[3:] + (1 - over[3:]) * opacity
        left += one.shape[2] - closer
    return torch.cat((colors / opacity.clamp(min=1e-4), opacity)).clamp(0, 1)
