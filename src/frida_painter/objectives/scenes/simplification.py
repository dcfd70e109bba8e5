"""What few strokes can paint of a picture: areas of one colour, without texture."""

import cv2
import numpy as np
from torch import Tensor

from frida_painter import images

_NEAR = 0.027  # of the height: about as wide as a mark of the fine brush
_ALIKE = 28.0  # of 256 steps of sRGB, within which colours of neighbours become one


def simplified(picture: Tensor) -> Tensor:
    """The picture [3, H, W] with flat areas and sharp edges: mean shift in place and colour (Comaniciu and Meer 2002).

    Flat areas stay as they are, to a 256th.
    """
    near = _NEAR * picture.shape[1]
    flat = cv2.pyrMeanShiftFiltering(images.to_uint8(picture), near, _ALIKE, maxLevel=0)
    return images.from_uint8(np.asarray(flat, np.uint8))
