"""A picture of a plan in which the strokes stand out that cannot be painted."""

from collections.abc import Collection

import torch
from torch import Tensor

from frida_painter import images
from frida_painter.plan import Plan
from frida_painter.sheet import PAPER, SOFT, Sheet, font

_RED = (200, 30, 40)
_FADED = 0.62  # of the way to white
_POINTS = 25


def offending_strokes(plan: Plan, picture: Tensor, offending: Collection[int]) -> Tensor:
    """The plan's picture [3, H, W], faded, with the paths of the offending strokes (by index) in red: [3, H + h, W].

    Each has a dot where it starts and its number, from 1, as messages name it; below stands how many there are.
    """
    rows, columns = picture.shape[1:]
    unit = max(rows, columns) / 1000
    foot = round(64 * unit)
    sheet = Sheet(columns, rows + foot)
    faded = picture.detach() + _FADED * (1 - picture.detach())
    sheet.paste(images.to_uint8(faded))
    chosen = sorted(offending)
    path = plan.strokes[chosen].path(torch.linspace(0, 1, _POINTS))  # [n, t, 2] metres
    scale = torch.tensor([columns / plan.canvas.width, rows / plan.canvas.height])
    pixels = plan.canvas.on_page(path) * scale
    for points in pixels.tolist():
        sheet.draw.line([tuple(point) for point in points], fill=_RED, width=max(2, round(4 * unit)), joint="curve")
        x, y = points[0]
        dot = 6 * unit
        sheet.draw.ellipse((x - dot, y - dot, x + dot, y + dot), fill=_RED)
    _tags(sheet, dict(zip(chosen, pixels.tolist(), strict=True)), round(22 * unit), (columns, rows))
    count = f"{len(chosen)} of {len(plan)} strokes cannot be painted here"
    sheet.text((16 * unit, rows + foot / 2), count, 26 * unit, SOFT, "lm")
    return sheet.tensor()


def _tags(
    sheet: Sheet, paths: dict[int, list[list[float]]], size: int, within: tuple[int, int]
) -> None:  # fmt: skip
    """Numbers in white on red beside their strokes and inside the picture, as many as find a free place."""
    pad = size * 0.3
    taken: list[tuple[float, float, float, float]] = []
    for index, points in paths.items():
        left, top, right, bottom = sheet.draw.textbbox((0, 0), str(index + 1), font=font(size))
        width, height = right - left, bottom - top
        for x, y in (points[0], points[-1], points[_POINTS // 2]):
            x = min(max(x + size * 0.5, pad), within[0] - width - pad)
            y = min(max(y - size * 1.4, pad), within[1] - height - pad)
            box = (x - pad, y - pad, x + width + pad, y + height + pad)
            if not any(_overlap(box, other) for other in taken):
                taken.append(box)
                sheet.draw.rounded_rectangle(box, radius=pad, fill=_RED)
                sheet.text((x - left, y - top), str(index + 1), size, PAPER)
                break


def _overlap(one: tuple[float, float, float, float], other: tuple[float, float, float, float]) -> bool:
    return one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]
