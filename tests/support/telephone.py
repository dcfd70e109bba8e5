"""A person's telephone: pictures of a canvas, made from what is on it."""

import cv2
import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.system.images import to_uint8


def taken(canvas: Tensor, seed: int = 0, quarter: int = 0) -> tuple[NDArray[np.uint8], NDArray[np.float64]]:
    """A telephone's picture of a canvas on a dark table: askew, under warm light from one side, noisy, as JPEG.

    quarter: quarter turns of the telephone. The corners of the canvas in it, for no turn.
    """
    chance = np.random.default_rng(seed)
    high, wide = 900, 1200
    corners = np.array([(150, 120), (1050, 120), (1050, 760), (150, 760)]) + chance.uniform(-60, 60, (4, 2))
    rows, columns = canvas.shape[1:]
    page = np.array([(0, 0), (columns, 0), (columns, rows), (0, rows)], np.float32) - 0.5
    view = cv2.getPerspectiveTransform(page, corners.astype(np.float32))
    light = ((to_uint8(canvas) / 255) ** 2.2).astype(np.float32)
    seen = cv2.warpPerspective(light, view, (wide, high), borderValue=(0.03, 0.025, 0.02))
    seen *= np.linspace(0.55, 0.8, wide)[None, :, None] * np.array([1.0, 0.9, 0.72])
    picture = 255 * seen.clip(0, 1) ** (1 / 2.2) + chance.normal(0, 2, seen.shape)
    _, file = cv2.imencode(".jpg", picture.clip(0, 255).astype(np.uint8), [cv2.IMWRITE_JPEG_QUALITY, 88])
    decoded = np.asarray(cv2.imdecode(file, cv2.IMREAD_COLOR), np.uint8)
    return np.ascontiguousarray(np.rot90(decoded, quarter)), corners
