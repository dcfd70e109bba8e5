"""The simple replication objective: be the same as the picture, pixel by pixel."""

from collections.abc import Callable

from torch import Tensor

from frida_painter import images
from frida_painter.frames import PixelGrid


def replication(image: Tensor, grid: PixelGrid) -> Callable[[Tensor], Tensor]:
    """l_print of the paper (Eq. "l2"): the mean squared difference to `image` [3, H, W], fitted to the grid."""
    target = images.fit(image, grid.rows, grid.columns)

    def judge(picture: Tensor) -> Tensor:
        return (picture - target.to(picture)).square().mean()

    return judge
