"""What a painting of a photograph is planned towards: the photograph, sharpened by as much as painting softens it.

Marks have soft edges and land beside where they are meant, and where the planner is not sure of them it evens colours
out. So a painting has less contrast than its photograph, from one mark to the next. Printers sharpen pictures for the
same reason.
"""

from torch import Tensor

from frida_painter import images
from frida_painter.frames import PixelGrid

_SPREAD = 0.0037
"""Standard deviation, metres on the canvas, over which a place is compared with what is around it."""


def sharpened(picture: Tensor, sharpness: float, grid: PixelGrid) -> Tensor:
    """A picture [3, h, w] as it fills the grid [3, H, W], and as sharp as it is to be planned for that canvas.

    sharpness: by how much of its difference from its surroundings each place differs more.
    """
    return with_contrast(images.fit(picture, grid.rows, grid.columns), _SPREAD / grid.pitch[1], sharpness)


def with_contrast(picture: Tensor, spread: float, amount: float) -> Tensor:
    """A picture [3, H, W] in [0, 1] with `amount` more of each pixel's difference from those within `spread` pixels.

    That is unsharp masking.
    """
    return (picture + amount * (picture - images.blurred(picture, spread))).clamp(0, 1)
