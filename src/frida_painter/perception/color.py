"""Perceived colours to true ones, by the calibration's affine map of linear light; and how that map is fitted.

Filters that overlap mix the bands of light, and stray light adds to them: both are linear in light, and
not in sRGB.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from frida_painter.calibration import Calibration
from frida_painter.perception.difference import difference
from frida_painter.perception.light import to_linear, to_srgb

_FAINT = 0.03


def true_color(picture: Tensor, calibration: Calibration) -> Tensor:
    """The picture [3, H, W] in true sRGB, in [0, 1]; to be used after the light has been evened out."""
    affine = torch.tensor(calibration.color, dtype=picture.dtype, device=picture.device)  # [3, 4]
    light = torch.einsum("ij,jhw->ihw", affine[:, :3], to_linear(picture)) + affine[:, 3, None, None]
    return to_srgb(light)


@dataclass(frozen=True)
class ColorFit:
    """A map from perceived to true linear light, [3, 4] float64, and what it is worth.

    before, after, held_out [n]: CIEDE2000 of each colour that was fitted: as perceived, as mapped,
    and as mapped by a fit to all others.
    """

    affine: Tensor
    before: Tensor
    after: Tensor
    held_out: Tensor


def fit_color(perceived: Tensor, true: Tensor) -> ColorFit:
    """Fits the map to n colours seen and known, linear light [n, 3] each; n is 6 or more.

    Least squares, in which dark colours count more, as they do to the eye.
    """
    keep = ~torch.eye(len(true), dtype=torch.bool)
    without = torch.stack([_apply(_affine(perceived[rest], true[rest]), perceived) for rest in keep])
    affine = _affine(perceived, true)
    seen = to_srgb(true)
    return ColorFit(
        affine,
        before=difference(to_srgb(perceived), seen),
        after=difference(to_srgb(_apply(affine, perceived)), seen),
        held_out=difference(to_srgb(torch.stack([without[i, i] for i in range(len(true))])), seen),
    )


def _affine(perceived: Tensor, true: Tensor) -> Tensor:
    """The best affine map [3, 4]."""
    columns = torch.cat((perceived, torch.ones_like(perceived[:, :1])), 1).double()  # [n, 4]
    # How steeply lightness grows with light: as the power -2/3 of it, bounded where it is faint.
    weight = (true.double().mean(1, keepdim=True) + _FAINT) ** (-2 / 3)
    return torch.linalg.lstsq(weight * columns, weight * true.double()).solution.T


def _apply(affine: Tensor, light: Tensor) -> Tensor:
    return light.double() @ affine[:, :3].T + affine[:, 3]
