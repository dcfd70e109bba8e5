"""The canvas for the film: what `rectify`, `FlatField.correct` and `true_color` make of a photograph, in one pass.

Nothing is decided by these pictures, so they need not be equal to the last bit. A film takes many of them
through one camera: where each sample lies, and how bright the light is there, is computed once.
"""

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.calibration import Calibration
from frida_painter.frames import PixelGrid
from frida_painter.perception.flatfield import FlatField
from frida_painter.perception.light import light_of_bytes, to_srgb
from frida_painter.perception.rectify import require_photograph, require_some_light, sampling_places

_TONES = 1 << 16  # of linear light; the coarsest step, in the dark, is 0.05 of one of 255


class FilmView:
    """Pictures of the canvas on a grid, seen by a calibrated camera in a light that is known."""

    def __init__(self, calibration: Calibration, light: FlatField, grid: PixelGrid) -> None:
        self.calibration, self.light, self.grid = calibration, light, grid
        self._column, self._row = sampling_places(calibration, grid)
        white = light.light(grid.rows, grid.columns).permute(1, 2, 0)  # [rows, columns, 3]
        self._brighter = np.ascontiguousarray((1 / white).numpy(), np.float32)
        self._affine = np.array(calibration.color, np.float32)  # [3, 4]
        self._light_of_byte = light_of_bytes(np.arange(256, dtype=np.uint8))[None]
        self._tones = to_srgb(torch.linspace(0, 1, _TONES)).numpy()

    def fits(self, calibration: Calibration, light: FlatField, grid: PixelGrid) -> bool:
        """Whether it was made for these."""
        return self.calibration is calibration and self.light is light and self.grid == grid

    def picture(self, photograph: NDArray[np.uint8]) -> Tensor:
        """The canvas [3, rows, columns], true sRGB in [0, 1], float32, in a photograph [H, W, 3] in sRGB bytes.

        It differs from `true_color(light.correct(rectify(...)))` by less than 1/255. Raises FrameRejected as
        `rectify` does.
        """
        require_photograph(photograph, self.calibration)
        light = np.asarray(cv2.LUT(photograph, self._light_of_byte), np.float32)
        require_some_light(light)
        seen = cv2.remap(light, self._column, self._row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        if seen.shape[:2] != (self.grid.rows, self.grid.columns):
            seen = cv2.resize(seen, (self.grid.columns, self.grid.rows), interpolation=cv2.INTER_AREA)
        even = np.asarray(seen, np.float32)
        np.clip(np.multiply(even, self._brighter, out=even), 0, 1, out=even)
        true = np.asarray(cv2.transform(even, self._affine), np.float32)
        np.clip(true, 0, 1, out=true)
        tones = self._tones[(true * (_TONES - 1) + 0.5).astype(np.uint16)]
        return torch.from_numpy(np.ascontiguousarray(tones.transpose(2, 0, 1)))
