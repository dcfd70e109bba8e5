"""A drawing in another colour: what makes up most of it changes, and what has another hue stays."""

import math

import torch
from torch import Tensor

from frida_painter.palette import from_lab, to_lab

_DARKEST = 22.0  # L* up to which a colour is an outline or a shadow, unless there is nothing else
_COLORLESS = 12.0  # chroma below which a colour has no hue
_HUE = 0.8  # radians by which a shade of the same colour may differ in hue
_SHADE = 45.0  # L* by which it may be lighter or darker, where there is no hue to tell
_STEP = 8.0  # of Lab, within which colours are counted as one
_PASSES = 25.0  # of Lab, by which a colour may differ from what it is called
_CONTRAST = 0.7  # of the differences between shades that is kept
_VIVID = 40.0  # chroma from which a colour's shades may differ in hue as much as those of the drawing
_MUTED, _MUTED_LIGHTNESS = 40.0, (25.0, 62.0)  # chroma, and L*, of a colour that suits many things
_AROUND = (81.0, -14.0, -23.0)  # Lab of what pictograms paint water, sky and glass with
_AROUND_WITHIN, _AROUND_COUNTS = 12.0, 0.1  # how near a colour is to that, and what it counts then


def recolored(drawing: Tensor, color: Tensor) -> Tensor:
    """A flat drawing, colour and opacity [4, h, w], whose main colour has become sRGB `color` [3] in [0, 1].

    Lighter and darker shades of the main colour follow it. Outlines, and what is of another hue, stay.
    """
    lab = to_lab(drawing[:3].flatten(1).T)  # [h w, 3]
    seen = drawing[3].flatten() > 0.5
    body = seen & (lab[:, 0] > _DARKEST)
    if not bool(body.any()):
        body = seen
    if not bool(body.any()):
        return drawing
    main = _commonest(lab[body])
    changed = lab.clone()
    alike = _alike(lab, main)
    wanted = to_lab(color)
    hue = min(1.0, float(wanted[1:].norm()) / _VIVID)  # gray has shades, but none of them is blue
    changed[alike] = wanted + _CONTRAST * (lab[alike] - main) * lab.new_tensor([1.0, hue, hue])
    return torch.cat((from_lab(changed).T.reshape(drawing[:3].shape), drawing[3:]))


def is_colored(drawing: Tensor, color: Tensor) -> bool:
    """Whether the main colour of a drawing [4, h, w] passes for sRGB `color` [3]: a fox is red as it is."""
    lab = to_lab(drawing[:3].flatten(1).T)
    body = (drawing[3].flatten() > 0.5) & (lab[:, 0] > _DARKEST)
    if not bool(body.any()):
        return False
    main, wanted = _commonest(lab[body]), to_lab(color)
    if float((main - wanted).norm()) <= _PASSES:
        return True
    turned = main[1:] @ wanted[1:] / (main[1:].norm() * wanted[1:].norm()).clamp(min=1e-6)
    hued = min(float(main[1:].norm()), float(wanted[1:].norm())) > _COLORLESS
    return hued and float(turned) > math.cos(_HUE) and abs(float(main[0] - wanted[0])) <= _PASSES


def muted_color(drawing: Tensor) -> Tensor:
    """The colour of most of a drawing [4, h, w], muted so that it suits what is only like it: sRGB [3] in [0, 1].

    Raises IndexError where nothing of the drawing is seen.
    """
    lab = _commonest(to_lab(drawing[:3, drawing[3] > 0.5].T))
    return from_lab(
        torch.cat((lab[:1].clamp(*_MUTED_LIGHTNESS), lab[1:] * min(1.0, _MUTED / max(float(lab[1:].norm()), 1e-6))))
    )


def _commonest(lab: Tensor) -> Tensor:
    """The colour [3] that is most likely the thing's own: there is much of it, and it has a hue, but not of water."""
    cells, owner, count = torch.unique((lab / _STEP).round(), dim=0, return_inverse=True, return_counts=True)
    colorful = (cells[:, 1:].norm(dim=1) * _STEP > _COLORLESS).float()
    around = ((cells * _STEP - cells.new_tensor(_AROUND)).norm(dim=1) <= _AROUND_WITHIN).float()
    most = int((count * (1 + colorful) * (1 - (1 - _AROUND_COUNTS) * around)).argmax())
    return lab[owner == most].mean(0)


def _alike(lab: Tensor, main: Tensor) -> Tensor:
    """Which colours [n, 3] are shades of the main one, [n]."""
    chroma, lightness = lab[:, 1:].norm(dim=1), (lab[:, 0] - main[0]).abs()
    if float(main[1:].norm()) <= _COLORLESS:
        return (chroma <= _COLORLESS) & (lightness <= _SHADE) & (lab[:, 0] > min(_DARKEST, float(main[0]) - 1))
    along = (lab[:, 1:] @ main[1:]) / (chroma * main[1:].norm()).clamp(min=1e-6)
    return (chroma > _COLORLESS) & (along > torch.cos(torch.tensor(_HUE)))
