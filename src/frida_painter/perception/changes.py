"""Paint that was added between two looks at a canvas."""

import cv2
import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.palette import to_lab

_CHANGED = 7.0  # difference in CIELAB that paint makes between two looks; the camera's noise makes less
_SPECK = 2e-5  # share of the picture; a smaller change is noise


MARK = 1e-4
"""Share of the picture; smaller changes may be the rims of older marks, which no two photographs show the same."""


def find_painted(before: Tensor, after: Tensor, least: float = _SPECK) -> NDArray[np.bool_]:
    """Returns a mask [H, W]: True for a pixel with added paint.

    before, after: pictures of a canvas, [3, H, W].
    least: share of the picture; a smaller connected change is left out. If nothing else is known of the paint: MARK.
    """
    lab = [to_lab(picture.permute(1, 2, 0)).numpy() for picture in (before, after)]
    smooth = [cv2.GaussianBlur(each, (0, 0), max(0.8, each.shape[0] / 540)) for each in lab]
    mask = (np.linalg.norm(smooth[1] - smooth[0], axis=-1) > _CHANGED).astype(np.uint8)
    count, labels, facts, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    large = [number for number in range(1, count) if facts[number, cv2.CC_STAT_AREA] >= max(4, least * mask.size)]
    return np.isin(labels, large)
