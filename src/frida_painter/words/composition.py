"""Composition of a scene: one large subject, or a group of a few, on a ground that is calm behind it."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from frida_painter import images
from frida_painter.frames import PixelGrid
from frida_painter.palette import from_lab, to_lab
from frida_painter.words.compositing import paste, resize

_TALL, _WIDE, _SLIM = 0.76, 0.84, 0.88  # of the canvas: greatest height and width, and height of a slim subject
_FOOT = 0.93  # of the height: position of the feet on a ground
_OVERLAP, _SMALLEST, _BACK = 0.14, 0.82, 0.05  # of a group: shares of width and size, and of the height, as it recedes

_AROUND = 0.06  # of the height: reach of the calm ground around a subject
_CALM = 0.035  # of the height: details that are lost there
_APART, _PUSH = 16.0, 12.0  # L* by which subject and near ground differ, and its change if they do not
_LIT, _BRIGHT = 0.5, 0.55  # share of the ground's light in a subject's colours, and the mean of a day's ground
_SHADE, _FLAT = 0.45, 0.1  # opacity of a contact shadow, and its height by the subject's
_CHROMA, _LIGHT, _DARK = 16.0, 84.0, 56.0  # plain ground: chroma, and L* behind dark and light subjects
_PALE = 62.0  # mean L* from which subjects are light
_FLOOR, _DEEP = 0.78, 9.0  # of a plain ground: position of the floor's edge, and its loss of L*
_NEAR, _ALIKE = 0.016, 20.0  # of the height, and of 256 steps: neighbouring colours within both become one


@dataclass(frozen=True)
class ComposedScene:
    """Composed scene: its picture [3, H, W], and the opacity of its subjects, [H, W] in [0, 1]."""

    picture: Tensor
    where: Tensor


def compose_scene(
    subjects: Sequence[Tensor], ground: Tensor | None, grid: PixelGrid, seed: int, *, aloft: bool = False
) -> ComposedScene:
    """Composes subjects [4, h, w] on a ground [3, h, w], or on a plain tone if it is None.

    aloft: True for subjects that stand on nothing
    """
    rows, columns = grid.rows, grid.columns
    placed = _place(subjects, rows, columns, seed, foot=None if ground is None or aloft else _FOOT)
    where = torch.zeros(rows, columns)
    for picture, top, left in placed:
        _, over = paste(picture, torch.zeros(3, rows, columns), top, left)
        where = where + over - where * over
    shown = _plain(placed, rows, columns) if ground is None else images.fit(ground, rows, columns)
    shown = _calm(shown, where, placed) if ground is not None and bool(where.any()) else shown
    light = (shown.mean((1, 2)) / _BRIGHT).clamp(0.4, 1.05) if ground is not None else torch.ones(3)
    for picture, top, left in placed:
        if not aloft:
            shown = _shade(shown, picture, top, left)
        colors = picture[:3] * torch.lerp(torch.ones(3), light, _LIT)[:, None, None]
        shown, _ = paste(torch.cat((colors.clamp(0, 1), picture[3:])), shown, top, left)
    return ComposedScene(simplify(shown), where)


def simplify(picture: Tensor) -> Tensor:
    """Returns the picture [3, H, W] with flat areas and sharp edges.

    Mean shift in position and colour (Comaniciu and Meer 2002). Flat areas keep their colour within 1/256.
    """
    flat = cv2.pyrMeanShiftFiltering(images.to_uint8(picture), _NEAR * picture.shape[1], _ALIKE, maxLevel=0)
    return images.from_uint8(np.asarray(flat, np.uint8))


def _place(
    subjects: Sequence[Tensor], rows: int, columns: int, seed: int, foot: float | None
) -> list[tuple[Tensor, int, int]]:
    """Returns the subjects scaled to pixels with their first rows and columns, the last in front.

    Several stand side by side and overlap a little; every second one is smaller and further back.
    foot: position of their feet, as a share of the height; None to have them in the middle
    """
    if not subjects:
        return []
    chance = np.random.default_rng(seed)
    several = len(subjects) > 1
    sizes = [
        1 - (1 - _SMALLEST) * (number % 2) * several - 0.06 * several * chance.random()
        for number in range(len(subjects))
    ]
    # Each subject has the height 1 before the sizes; wide ones of a group are no larger than high ones.
    heights = [size / max(1.0, (one.shape[2] / one.shape[1]) ** 0.5) for size, one in zip(sizes, subjects, strict=True)]
    widths = [height * one.shape[2] / one.shape[1] for height, one in zip(heights, subjects, strict=True)]
    step = 1 - _OVERLAP if several else 1.0
    whole = step * sum(widths[:-1]) + widths[-1]
    tall = _SLIM if whole < 0.6 * max(heights) else _TALL
    scale = min(tall * rows / max(heights), _WIDE * columns / whole)
    low = foot * rows if foot is not None else rows / 2 + scale * max(heights) / 2
    left, placed = (columns - scale * whole) / 2, list[tuple[Tensor, int, int, bool]]()
    for number, (one, height, width) in enumerate(zip(subjects, heights, widths, strict=True)):
        picture = resize(one, scale * height / one.shape[1])
        is_back = several and number % 2 == 1
        top = round(low - picture.shape[1] - _BACK * rows * is_back)
        placed.append((
            picture, max(0, min(top, rows - picture.shape[1])),
            max(0, min(round(left), columns - picture.shape[2])), is_back,
        ))  # fmt: skip
        left += step * scale * width
    return [one[:3] for one in sorted(placed, key=lambda one: not one[3])]


def _plain(placed: Sequence[tuple[Tensor, int, int]], rows: int, columns: int) -> Tensor:
    """Returns a plain ground [3, rows, columns]: the muted contrary of the subjects' colour, above a darker floor."""
    seen = torch.cat([picture[:3, picture[3] > 0.5] for picture, _, _ in placed], 1) if placed else torch.zeros(3, 0)
    lab = to_lab(seen.T) if seen.shape[1] else torch.tensor([[70.0, -4.0, -12.0]])
    hue = (lab[:, 1:] * lab[:, 1:].norm(dim=1, keepdim=True)).mean(0)  # that of the most colourful parts
    light = _DARK if lab[:, 0].mean() > _PALE else _LIGHT
    tone = torch.cat((torch.tensor([light]), -_CHROMA * functional.normalize(hue, dim=0)))
    down = torch.linspace(0, 1, rows)
    lightness = tone[0] + 5 * (0.5 - down) - _DEEP * torch.sigmoid((down - _FLOOR) / 0.01)
    lab = torch.cat((lightness[:, None], tone[1:].expand(rows, 2)), 1)
    return from_lab(lab).T[:, :, None].expand(3, rows, columns).clamp(0, 1).contiguous()


def _calm(ground: Tensor, where: Tensor, placed: Sequence[tuple[Tensor, int, int]]) -> Tensor:
    """Returns a ground [3, H, W] that is soft around subjects at `where` [H, W] and lighter or darker than they are."""
    rows = ground.shape[1]
    near = images.gaussian_blur(where[None], _AROUND * rows)[0]
    near = (2.5 * near).clamp(0, 1)
    soft = torch.lerp(ground, images.gaussian_blur(ground, _CALM * rows), near)
    lab = to_lab(soft.permute(1, 2, 0))
    around = near * (1 - where)
    behind = float((lab[..., 0] * around).sum() / around.sum().clamp(min=1))
    front = float(torch.cat([to_lab(picture[:3, picture[3] > 0.5].T)[:, 0] for picture, _, _ in placed]).mean())
    if abs(front - behind) < _APART:
        lab[..., 0] = (lab[..., 0] + (_PUSH if behind >= front else -_PUSH) * near).clamp(0, 100)
    return from_lab(lab).permute(2, 0, 1).clamp(0, 1)


def _shade(ground: Tensor, picture: Tensor, top: int, left: int) -> Tensor:
    """Returns the ground [3, H, W] with the soft contact shadow of a subject [4, h, w] that stands on it."""
    _, rows, columns = ground.shape
    height, width = picture.shape[1:]
    feet = picture[3, -max(1, round(0.12 * height)) :].amax(0)  # [w]
    flat = max(2, round(_FLAT * min(height, width)))
    shadow = torch.zeros(rows, columns)
    first = max(0, min(top + height - flat // 2, rows - 1))
    shadow[first : first + flat, left : left + width] = feet
    return ground * (1 - _SHADE * images.gaussian_blur(shadow[None], max(1.0, flat / 3)))
