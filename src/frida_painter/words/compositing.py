"""Compositing of drawings with opacity: their colours, their sizes, and their places on pictures."""

import torch
from torch import Tensor
from torch.nn import functional

from frida_painter.palette import from_lab, to_lab

# Recoloring of a drawing: its main colour changes with its shades, and parts of another hue stay.

_DARKEST = 22.0  # L* below which a colour is an outline or a shadow, unless most of the drawing is so dark
_STEP = 10.0  # Lab distance within which colours count as one
_HUED = 8.0  # chroma of a colour that is more likely the thing's own
_SHADE, _OTHER = 22.0, 44.0  # distances in hue and chroma up to which a colour is a shade, and from which it stays
_PATCH = 0.45  # share of a drawing below which its main colour is only that of a patch
_PASSES = 25.0  # Lab distance at which a colour still passes for its name
_SAME_HUE = 0.9  # cosine of the angle between two vivid colours of the same name
_ENOUGH = 0.35  # share of a drawing with a colour from which it has that colour
_CONTRAST = 0.7  # share of the differences between shades that is kept


def recolor(drawing: Tensor, color: Tensor) -> Tensor:
    """Returns a drawing, colour and opacity [4, h, w], with sRGB `color` [3] in [0, 1] as its main colour.

    Shades of the main colour change with it; of a drawing in many colours, everything but the outlines changes. A main
    colour that passes for `color` stays: a fox is already red.
    """
    lab = to_lab(drawing[:3].flatten(1).T)  # [h w, 3]
    seen = drawing[3].flatten() > 0.5
    body = seen & (lab[:, 0] > _DARKEST)
    body = body if float(body.sum()) > 0.3 * float(seen.sum()) else seen  # a black teapot
    if not bool(body.any()):
        return drawing
    cells, owner, count = torch.unique((lab[body] / _STEP).round(), dim=0, return_inverse=True, return_counts=True)
    own = count * (1 + (cells[:, 1:].norm(dim=1) * _STEP > _HUED))
    main, wanted = lab[body][owner == own.argmax()].mean(0), to_lab(color)
    share = ((_OTHER - (lab[:, 1:] - main[1:]).norm(dim=1)) / (_OTHER - _SHADE)).clamp(0, 1)
    is_plain = float(share[body].mean()) >= _PATCH
    hue = functional.cosine_similarity(lab[body][:, 1:], wanted[None, 1:])
    vivid = (lab[body][:, 1:].norm(dim=1) > _OTHER / 2) & (wanted[1:].norm() > _OTHER / 2)
    near = (lab[body] - wanted).norm(dim=1) <= _PASSES
    if float((near | (vivid & (hue > _SAME_HUE))).float().mean()) >= _ENOUGH:
        return drawing
    share = share if is_plain else body.float()
    dark = ((lab[:, 0] - _DARKEST / 2) / (_DARKEST / 2)).clamp(0, 1) if bool((body != seen).any()) else 1.0
    share = (share * dark)[:, None]
    light = (wanted[0] + _CONTRAST * (lab[:, 0] - main[0]))[:, None]
    hue = wanted[1:].expand(len(lab), 2) * (light / wanted[0].clamp(min=1)).clamp(0.4, 1.2)
    lab = torch.lerp(lab, torch.cat((light, hue), 1), share)
    return torch.cat((from_lab(lab).T.reshape(drawing[:3].shape), drawing[3:])).clamp(0, 1)


# Drawings with opacity on pictures.


def paste(drawing: Tensor, picture: Tensor, top: int, left: int) -> tuple[Tensor, Tensor]:
    """Returns the picture [3, H, W] with a drawing [4, h, w] at a place inside it, and the drawing's opacity [H, W]."""
    _, rows, columns = picture.shape
    around = [left, columns - left - drawing.shape[2], top, rows - top - drawing.shape[1]]
    over = functional.pad(drawing, around)
    return torch.lerp(picture, over[:3], over[3:]).clamp(0, 1), over[3]


def resize(drawing: Tensor, scale: float) -> Tensor:
    """Returns a drawing [4, h, w] scaled by `scale`."""
    size = [max(1, round(drawing.shape[1] * scale)), max(1, round(drawing.shape[2] * scale))]
    # Colours are weighted by opacity in the resampling, because transparent pixels have none.
    seen = torch.cat((drawing[:3] * drawing[3:], drawing[3:]))[None]
    small = functional.interpolate(seen, size, mode="bilinear", antialias=True)[0].clamp(0, 1)
    return torch.cat((small[:3] / small[3:].clamp(min=1e-4), small[3:])).clamp(0, 1)
