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
_WORTH_IT = 0.85


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

    Least squares, in which dark colours count more, as they do to the eye. The map has an offset only
    where that makes colours that are held out a good deal better: there is stray light then. Elsewhere
    it would follow the few dark patches' own faults, and be wrong for everything that is darker.
    """
    plain, stray = (_fit(perceived.double(), true.double(), offset) for offset in (False, True))
    return stray if float(stray.held_out.mean()) < _WORTH_IT * float(plain.held_out.mean()) else plain


def _fit(perceived: Tensor, true: Tensor, offset: bool) -> ColorFit:
    others = ~torch.eye(len(true), dtype=torch.bool)
    alone = torch.stack(
        [_apply(_affine(perceived[rest], true[rest], offset), one) for rest, one in zip(others, perceived, strict=True)]
    )
    affine, known = _affine(perceived, true, offset), to_srgb(true)
    return ColorFit(
        affine,
        before=difference(to_srgb(perceived), known),
        after=difference(to_srgb(_apply(affine, perceived)), known),
        held_out=difference(to_srgb(alone), known),
    )


def _affine(perceived: Tensor, true: Tensor, offset: bool) -> Tensor:
    """The best map [3, 4], whose last column is 0 where there is to be no offset."""
    columns = torch.cat((perceived, torch.ones_like(perceived[:, :1])), 1)[:, : 4 if offset else 3]
    # How steeply lightness grows with light: as the power -2/3 of it, bounded where it is faint.
    weight = (true.mean(1, keepdim=True) + _FAINT) ** (-2 / 3)
    solution = torch.linalg.lstsq(weight * columns, weight * true).solution.T
    return torch.nn.functional.pad(solution, (0, 4 - solution.shape[1]))


def _apply(affine: Tensor, light: Tensor) -> Tensor:
    return light @ affine[:, :3].T + affine[:, 3]
