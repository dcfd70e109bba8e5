"""Mark of a tilted brush, made from the mark of the upright one: a sharp side at the tip, a soft one under the handle.

A brush that leans to one side presses less and less from its tip to the hairs under the handle. Hairs that press
lightly leave little paint. So the mark of the upright brush is multiplied by a profile across its path, and
moved towards the handle. A lean along the path changes neither side. Without a tilt the mark stays as it is.
"""

from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

from frida_painter.brush.kinds import END_THICKNESS, StrokeModel, growth_of, mark_width
from frida_painter.strokes import Strokes

_TINY = 1e-12
_SAMPLES = 33  # of the path of a taught stroke
_STROKES_AT_ONCE = 32


class TiltProfile(NamedTuple):
    """Profile of a tilted mark; fitted to strokes of the virtual studio (docs/lab/virtual-studio.md).

    A place keeps the share sigmoid(full - |s| thin - s fade v) / sigmoid(full) of its paint. s is the sine of the
    tilt, times the share of it that is to the left. v is the distance from the path, in half widths of the mark.
    light, hard: half of the mark's width at the lightest and the hardest press, in widths of the brush's widest mark
    shift: distance that the mark moves towards the handle, in half widths, times s
    """

    full: float | Tensor = 13.0
    thin: float | Tensor = 17.0
    fade: float | Tensor = 3.6
    shift: float | Tensor = 0.94
    light: float | Tensor = 0.16
    hard: float | Tensor = 0.386


USUAL_PROFILE = TiltProfile()


def tilt_marks(
    magnitude: Tensor,
    affine: Tensor,
    corner: Tensor,
    strokes: Strokes,
    model: StrokeModel,
    profile: TiltProfile = USUAL_PROFILE,
) -> tuple[Tensor, Tensor]:
    """Returns the maps [n, h, w] and the affine maps [n, 2, 3] of tilted strokes, from those of upright ones.

    corner [n, 2]: column and row of each map in the frame of the model
    Differentiable in the maps and in the strokes. A stroke without a tilt keeps its maps.
    """
    assert strokes.tilt is not None
    angle = (strokes.tilt.square().sum(1)).clamp(min=_TINY).sqrt()
    leaning = strokes.tilt[:, 0] * torch.sin(angle) / angle  # [n]
    light, hard = (mark_width(model) * share for share in (profile.light, profile.hard))
    across, thickness = _view(magnitude, corner, strokes, model)
    place = across / (light + (hard - light) * thickness)  # -1 at the right edge, 1 at the left one
    toward = leaning[:, None, None]
    missing = (toward.abs() * profile.thin + toward * profile.fade * place).clamp(min=0)
    full = torch.as_tensor(profile.full).to(magnitude)
    share = torch.sigmoid(full - missing) / torch.sigmoid(full)
    moved = profile.shift * leaning * (light + (hard - light) * strokes.thickness) / model.frame.pitch[1]
    growth = growth_of(model, strokes.length)
    moved = moved if growth is None else moved / growth
    down = affine.new_tensor([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    return magnitude * share, affine + moved[:, None, None] * down


def _view(magnitude: Tensor, corner: Tensor, strokes: Strokes, model: StrokeModel) -> tuple[Tensor, Tensor]:
    """Returns each cell's distance to the left of the path in metres, [n, h, w], and the thickness there."""
    frame, (rows, columns) = model.frame, magnitude.shape[1:]
    across, down = frame.pitch
    x = frame.left + (corner[:, 0:1] + torch.arange(columns).to(magnitude) + 0.5) * across  # [n, w]
    y = frame.top - (corner[:, 1:2] + torch.arange(rows).to(magnitude) + 0.5) * down  # [n, h]
    if strokes.taught is not None:
        growth = growth_of(model, strokes.length)
        x, y = (side if growth is None else growth[:, None] * side for side in (x, y))
        return _taught_view(x, y, strokes)
    length, bend = strokes.length[:, None], strokes.bend[:, None]
    fraction = (x / length).clamp(0, 1)
    path, slope = 3 * fraction * (1 - fraction) * bend, 3 * (1 - 2 * fraction) * bend / length
    aside = (y[:, :, None] - path[:, None]) / (1 + slope.square()).sqrt()[:, None]
    ends = fraction**3 + (1 - fraction) ** 3
    return aside, (END_THICKNESS * ends + strokes.thickness[:, None] * (1 - ends))[:, None]


def _taught_view(x: Tensor, y: Tensor, strokes: Strokes) -> tuple[Tensor, Tensor]:
    """Returns the view of cells at x [n, w] and y [n, h] metres in the frames of strokes of one family."""
    assert strokes.taught is not None
    (family,) = strokes.taught.families
    fraction = torch.linspace(0, 1, _SAMPLES).to(x)
    path, share = family.trace(fraction.expand(len(x), -1), strokes.length, strokes.taught.code)
    path = path.to(x)  # [n, k, 2]
    way = functional.normalize(torch.gradient(path, dim=1)[0], dim=-1)
    found = []
    for part in torch.split(torch.arange(len(x), device=x.device), _STROKES_AT_ONCE):
        sides = x[part, None, :].expand(-1, y.shape[1], -1), y[part, :, None].expand(-1, -1, x.shape[1])
        at = torch.stack(sides, -1).flatten(1, 2)  # [m, h w, 2]
        nearest = torch.cdist(at.detach(), path[part].detach()).argmin(-1)  # [m, h w]
        off = at - torch.take_along_dim(path[part], nearest[..., None], 1)
        ahead = torch.take_along_dim(way[part], nearest[..., None], 1)
        aside = ahead[..., 0] * off[..., 1] - ahead[..., 1] * off[..., 0]
        pressed = strokes.thickness[part, None] * share[part].to(x).gather(1, nearest)
        found.append(torch.stack((aside, pressed)).view(2, len(part), y.shape[1], x.shape[1]))
    aside, thickness = torch.cat(found, 1)
    return aside, thickness
