"""Perceived colours to true ones, by the calibration's affine map."""

import torch
from torch import Tensor

from frida_painter.calibration import Calibration


def true_color(picture: Tensor, calibration: Calibration) -> Tensor:
    """The picture [3, H, W] in true sRGB, in [0, 1]; to be used after the light has been evened out."""
    affine = torch.tensor(calibration.color, dtype=picture.dtype, device=picture.device)  # [3, 4]
    corrected = torch.einsum("ij,jhw->ihw", affine[:, :3], picture) + affine[:, 3, None, None]
    return corrected.clamp(0, 1)
