"""Compositing of drawings with opacity: their colours, their sizes, and their places on pictures."""

import math
from collections.abc import Sequence

import torch
from torch import Tensor
from torch.nn import functional

from frida_painter.palette import from_lab, to_lab

# Recoloring of a drawing: its main colour changes, and parts of another hue stay.

_DARKEST = 22.0  # L* below which a colour is an outline or a shadow, unless there is no other
_BODY = 0.3  # least share of a drawing that is no outline
_COLORLESS = 12.0  # chroma below which a colour has no hue
_HUE = 0.7  # cosine of the angle by which shades of one colour may differ in hue
_SHADE = 45.0  # L* by which shades of a colour without hue may differ
_STEP = 8.0  # Lab distance within which colours count as one
_PATCH = 0.45  # share of a drawing below which its main colour is only that of a patch
_PASSES = 25.0  # Lab distance at which a colour still passes for its name

_SHADES = 24  # frequent colours that are compared with all their shades
_CONTRAST = 0.7  # share of the differences between shades that is kept
_VIVID = 40.0  # chroma above which shades keep the full differences in hue of the drawing


def recolor(drawing: Tensor, color: Tensor) -> Tensor:
    """Returns a drawing, colour and opacity [4, h, w], with sRGB `color` [3] in [0, 1] as its main colour.

    Lighter and darker shades of the main colour change with it. Outlines and parts of another hue stay, and so does a
    main colour that passes for `color`: a fox is already red.
    """
    lab = to_lab(drawing[:3].flatten(1).T)  # [h w, 3]
    seen = drawing[3].flatten() > 0.5
    body = seen & (lab[:, 0] > _DARKEST)
    body = body if float(body.sum()) > _BODY * float(seen.sum()) else seen  # a black teapot
    if not bool(body.any()):
        return drawing
    main, wanted = _commonest(lab[body]), to_lab(color)
    alike = _alike(lab, main)
    is_shade = bool(_alike(wanted[None], main)) and abs(float(main[0] - wanted[0])) <= _PASSES
    passes = float((main - wanted).norm()) <= _PASSES or (is_shade and float(main[1:].norm()) > _COLORLESS)
    contrast = _CONTRAST
    if float(alike[seen].float().mean()) < _PATCH:  # a brown dog has no black and white patches
        patches = lab[:, 1:].norm(dim=1) <= _COLORLESS
        is_gray = float(patches[seen].float().mean()) > 1 - _PATCH
        patches = patches & (lab[:, 0] > _DARKEST) if is_gray else ~patches  # a toy in all colours
        alike, contrast = patches if passes else alike | patches, 0.5 * _CONTRAST
    elif passes:
        return drawing
    hue = min(1.0, float(wanted[1:].norm()) / _VIVID)  # shades of gray have no hue
    lab[alike] = wanted + contrast * (lab[alike] - main) * lab.new_tensor([1.0, hue, hue])
    return torch.cat((from_lab(lab).T.reshape(drawing[:3].shape), drawing[3:]))


def _commonest(lab: Tensor) -> Tensor:
    """Returns the colour [3] that is most likely the thing's own: frequent, and with a hue."""
    cells, owner, count = torch.unique((lab / _STEP).round(), dim=0, return_inverse=True, return_counts=True)
    colorful = (cells[:, 1:].norm(dim=1) * _STEP > _COLORLESS).float()
    often = count.topk(min(_SHADES, len(count))).indices.tolist()
    shades = torch.stack([(count * _alike(cells * _STEP, cells[at] * _STEP)).sum() for at in often])
    most = often[int((shades * (1 + colorful[often])).argmax())]
    return lab[owner == most].mean(0)


def _alike(lab: Tensor, main: Tensor) -> Tensor:
    """Returns True for each colour [n, 3] that is a shade of the main one: [n]."""
    chroma, lightness = lab[:, 1:].norm(dim=1), (lab[:, 0] - main[0]).abs()
    if float(main[1:].norm()) <= _COLORLESS:
        return (chroma <= _COLORLESS) & (lightness <= _SHADE) & (lab[:, 0] > min(_DARKEST, float(main[0]) - 1))
    along = (lab[:, 1:] @ main[1:]) / (chroma * main[1:].norm()).clamp(min=1e-6)
    return (chroma > _COLORLESS) & (along > _HUE)


# Drawings with opacity on pictures.


def paste(drawing: Tensor, picture: Tensor, top: int, left: int) -> tuple[Tensor, Tensor]:
    """Returns the picture [3, H, W] with a drawing [4, h, w] at a place inside it, and the drawing's opacity [H, W]."""
    _, rows, columns = picture.shape
    around = [left, columns - left - drawing.shape[2], top, rows - top - drawing.shape[1]]
    over = functional.pad(drawing, around)
    return torch.lerp(picture, over[:3], over[3:]).clamp(0, 1), over[3]


def stack(drawings: Sequence[tuple[Tensor, int, int]], rows: int, columns: int) -> Tensor:
    """Returns drawings [4, h, w], each at its first row and column, as one [4, rows, columns], the last in front."""
    colors, where = torch.zeros(3, rows, columns), torch.zeros(rows, columns)
    for drawing, top, left in drawings:
        colors, over = paste(drawing, colors, top, left)
        where = where + over - where * over
    return torch.cat((colors / where.clamp(min=1e-4), where[None])).clamp(0, 1)


def resize(drawing: Tensor, scale: float, wide: float = 1.0) -> Tensor:
    """Returns a drawing [4, h, w] scaled by `scale`, and its width by `wide` too."""
    size = [max(1, round(drawing.shape[1] * scale)), max(1, round(drawing.shape[2] * scale * wide))]
    # Colours are weighted by opacity in the resampling, because transparent pixels have none.
    seen = torch.cat((drawing[:3] * drawing[3:], drawing[3:]))[None]
    small = functional.interpolate(seen, size, mode="bilinear", antialias=True)[0].clamp(0, 1)
    return torch.cat((small[:3] / small[3:].clamp(min=1e-4), small[3:])).clamp(0, 1)


def warp_rows(drawing: Tensor, shift: Tensor, wide: Tensor) -> Tensor:
    """Returns a drawing [4, h, w] with each row moved by `shift` [h] columns and scaled by `wide` [h]; it grows."""
    _, rows, columns = drawing.shape
    around = math.ceil(float((shift.abs() + (wide - 1).clamp(min=0) * columns / 2).max()))
    larger = functional.pad(drawing, (around, around))
    half = larger.shape[2] / 2
    x = (torch.arange(larger.shape[2]) + 0.5 - half - shift[:, None]) / (wide[:, None] * half)
    y = ((torch.arange(rows) + 0.5) / rows * 2 - 1)[:, None].expand_as(x)
    return sample(larger, torch.stack((x, y), 2))


def sample(drawing: Tensor, where: Tensor) -> Tensor:
    """Returns a drawing [4, h, w] as seen at places [H, W, 2] of it: x and y, -1 to 1 from edge to edge."""
    seen = torch.cat((drawing[:3] * drawing[3:], drawing[3:]))[None]
    warped = functional.grid_sample(seen, where[None], align_corners=False)[0]
    return torch.cat((warped[:3] / warped[3:].clamp(min=1e-4), warped[3:])).clamp(0, 1)


def crop(drawing: Tensor) -> Tensor:
    """Returns a drawing [4, h, w] without transparent rows and columns at its edges."""
    down, across = (torch.nonzero((drawing[3] > 0.02).any(side)).flatten() for side in (1, 0))
    return drawing[:, int(down[0]) : int(down[-1]) + 1, int(across[0]) : int(across[-1]) + 1] if len(down) else drawing


def soften(picture: Tensor, near: int) -> Tensor:
    """Returns a picture [c, h, w] without details smaller than `near` pixels.

    The filter is two means over squares, with replicated edges.
    """
    for _ in range(2):
        around = functional.pad(picture[None], (near,) * 4, mode="replicate")
        picture = functional.avg_pool2d(around, 2 * near + 1, 1)[0]
    return picture
