"""A picture for deciding on one stroke: is it on the canvas, or was the painting broken off before?"""

import torch
from PIL import Image
from torch import Tensor

from frida_painter import images
from frida_painter.plan import Plan
from frida_painter.sheet import SOFT, Sheet

_RED = (200, 30, 40)
_ROWS = 720  # of the whole canvas as it is shown
_POINTS = 25
_AROUND = 0.35  # of its extent is shown around the stroke, on every side
_GAP, _HEAD = 24, 44


def doubt(plan: Plan, stroke: int, photograph: Tensor, painted: Tensor) -> Tensor:
    """The canvas with a frame around the stroke, and beside it the frame enlarged: as seen, and as if painted.

    stroke: its index in the plan; photograph [3, H, W]: the canvas as it is now; painted [3, h, w]: as
    it would look with that stroke, in the simulation. Returns sRGB [3, rows, columns].
    """
    columns = round(_ROWS * plan.canvas.width / plan.canvas.height)
    canvas, with_stroke = (_enlarged(picture, _ROWS, columns) for picture in (photograph, painted))
    path = plan.strokes[[stroke]].path(torch.linspace(0, 1, _POINTS))[0]  # [t, 2] metres
    pixels = plan.canvas.on_page(path) * torch.tensor([columns / plan.canvas.width, _ROWS / plan.canvas.height])
    box = _around(pixels, columns)
    side = (_ROWS - _HEAD) // 2
    sheet = Sheet(columns + side + 3 * _GAP, _ROWS + 2 * _GAP + _HEAD)
    sheet.paste(canvas, (_GAP, _GAP + _HEAD))
    sheet.draw.rectangle(
        [edge + _GAP + (_HEAD if place % 2 else 0) for place, edge in enumerate(box)], outline=_RED, width=3
    )
    _heading(sheet, f"The canvas now; in the frame the place of stroke {stroke + 1}", _GAP, _GAP)
    left, top = columns + 2 * _GAP, _GAP
    for words, picture in (("As it is seen", canvas), (f"With stroke {stroke + 1}", with_stroke)):
        _heading(sheet, words, left, top)
        near = picture.crop(box).resize((side, side), Image.Resampling.LANCZOS)
        sheet.paste(near, (left, top + _HEAD))
        sheet.draw.rectangle((left, top + _HEAD, left + side, top + _HEAD + side), outline=_RED, width=3)
        top += side + _HEAD
    return sheet.tensor()


def _around(path: Tensor, columns: int) -> tuple[int, int, int, int]:
    """A square around the path (pixels [t, 2]), within the picture."""
    low, high = path.amin(0), path.amax(0)
    side = min(_ROWS, columns, max(60, round(float((high - low).max()) * (1 + 2 * _AROUND)) + 40))
    middle = (low + high) / 2
    left = min(max(0, round(float(middle[0]) - side / 2)), columns - side)
    top = min(max(0, round(float(middle[1]) - side / 2)), _ROWS - side)
    return left, top, left + side, top + side


def _enlarged(picture: Tensor, rows: int, columns: int) -> Image.Image:
    return Image.fromarray(images.to_uint8(picture)).resize((columns, rows), Image.Resampling.LANCZOS)


def _heading(sheet: Sheet, words: str, left: int, top: int) -> None:
    sheet.text((left, top + _HEAD / 2), words, 20, SOFT, "lm")
