"""Composition of pictures: one large subject, or a group of a few, on a calm ground; a thing laid into a picture."""

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from frida_painter.frames import PixelGrid
from frida_painter.objectives.style_marks import style_colors, to_lab_picture, tone
from frida_painter.strokes.palette import from_lab, to_lab
from frida_painter.system import images
from frida_painter_words.reading import COLORS, SHADES

_TALL, _WIDE, _SLIM = 0.76, 0.84, 0.88  # of the canvas: greatest height and width, and height of a slim subject
_FOOT = 0.93  # of the height: position of the feet on a ground
_OVERLAP, _SMALLER, _BACK = 0.14, 0.82, 0.05  # of a group: shares of width and size, and of the height, as it recedes

_AROUND, _CALM = 0.06, 0.035  # of the height: reach of the calm ground around a subject, and details lost there
_APART, _PUSH = 16.0, 12.0  # L* by which subject and near ground differ, and its change if they do not
_LIT, _BRIGHT = 0.5, 0.55  # share of the ground's light in a subject's colours, and the mean of a day's ground
_SHADE, _FLAT = 0.45, 0.1  # opacity of a contact shadow, and its height by the subject's
_CHROMA, _LIGHT, _DARK = 16.0, 84.0, 56.0  # plain ground: chroma, and L* behind dark and light subjects
_PALE = 62.0  # mean L* from which subjects are light
_FLOOR, _DEEP = 0.78, 9.0  # of a plain ground: position of the floor's edge, and its loss of L*
_NEAR, _ALIKE = 0.016, 20.0  # of the height, and of 256 steps: neighbouring colours within both become one

_TRIED, _AREA = 96, 4  # rows of the small picture on which places are tried, and half the width of an edge there
_SIZE, _LOW = 0.65, 0.5  # of the shorter side, and of the free space: highest place, down; a thing stands
_TONES = ((0.0, 1.0), (0.0, 0.6), (0.4, 1.0))  # tones for a thing, 0 for the picture's darkest

_DARKEST = 22.0  # L* below which a colour is an outline or a shadow, unless most of the thing is so dark
_STEP = 10.0  # Lab distance within which colours count as one
_SHADED, _OTHER = 22.0, 44.0  # distances in hue and chroma up to which a colour is a shade, and from which it stays
_PATCH = 0.45  # share of a thing below which its main colour is only that of a patch
_PASSES, _SAME_HUE = 25.0, 0.9  # Lab distance, and cosine of vivid hues, at which a colour passes for its name
_ENOUGH, _CONTRAST = 0.35, 0.7  # shares: of a thing with a colour that makes it its own, and of shades that is kept


class ComposedScene(NamedTuple):
    """Composed scene: its picture [3, H, W], and the opacity of its subjects, [H, W] in [0, 1]."""

    picture: Tensor
    where: Tensor


def compose_scene(
    subjects: Sequence[Tensor], ground: Tensor | None, grid: PixelGrid, *, aloft: bool = False
) -> ComposedScene:
    """Composes subjects [4, h, w] on a ground [3, h, w], or on a plain tone if it is None.

    aloft: True for subjects that stand on nothing
    """
    rows, columns = grid.rows, grid.columns
    placed = _place(subjects, rows, columns, foot=None if ground is None or aloft else _FOOT)
    where = torch.zeros(rows, columns)
    for picture, top, left in placed:
        where = torch.maximum(where, paste(picture, torch.zeros(3, rows, columns), top, left)[1])
    colors = torch.cat([picture[:3, picture[3] > 0.5] for picture, _, _ in placed], 1) if placed else torch.zeros(3, 1)
    light = torch.ones(3)
    if ground is None:
        shown = _plain(to_lab(colors.T), rows, columns)
    else:
        shown = _calm(images.fit(ground, rows, columns), where, float(to_lab(colors.T)[:, 0].mean()))
        light = torch.lerp(light, (shown.mean((1, 2)) / _BRIGHT).clamp(0.4, 1.05), _LIT)
    for picture, top, left in placed:
        if not aloft:
            shown = _shade(shown, picture, top, left)
        lit = (picture[:3] * light[:, None, None]).clamp(0, 1)
        shown, _ = paste(torch.cat((lit, picture[3:])), shown, top, left)
    return ComposedScene(simplify(shown), where)


def simplify(picture: Tensor) -> Tensor:
    """Returns the picture [3, H, W] with flat areas and sharp edges.

    Mean shift in position and colour (Comaniciu and Meer 2002). Flat areas keep their colour within 1/256.
    """
    flat = cv2.pyrMeanShiftFiltering(images.to_uint8(picture), _NEAR * picture.shape[1], _ALIKE, maxLevel=0)
    return images.from_uint8(np.asarray(flat, np.uint8))


def _place(subjects: Sequence[Tensor], rows: int, columns: int, foot: float | None) -> list[tuple[Tensor, int, int]]:
    """Returns the subjects scaled to pixels with their first rows and columns, the last in front.

    Several stand side by side and overlap a little; every second one is smaller and further back.
    foot: position of their feet, as a share of the height; None to have them in the middle
    """
    if not subjects:
        return []
    shapes = [one.shape[2] / one.shape[1] for one in subjects]
    # Each subject has the height 1 before its size; wide ones of a group are no larger than high ones.
    heights = [(_SMALLER if at % 2 else 1.0) / max(1.0, shape) ** 0.5 for at, shape in enumerate(shapes)]
    widths = [height * shape for height, shape in zip(heights, shapes, strict=True)]
    step = 1 - _OVERLAP
    whole = step * sum(widths[:-1]) + widths[-1]
    tall = _SLIM if whole < 0.6 * max(heights) else _TALL
    scale = min(tall * rows / max(heights), _WIDE * columns / whole)
    low = foot * rows if foot is not None else rows / 2 + scale * max(heights) / 2
    left, placed = (columns - scale * whole) / 2, list[tuple[Tensor, int, int]]()
    for at, (one, height, width) in enumerate(zip(subjects, heights, widths, strict=True)):
        picture = resize(one, scale * height / one.shape[1])
        top = round(low - picture.shape[1] - _BACK * rows * (at % 2))
        across = min(round(left), columns - picture.shape[2])
        placed.append((picture, max(0, min(top, rows - picture.shape[1])), max(0, across)))
        left += step * scale * width
    return placed[1::2] + placed[::2]


def _plain(lab: Tensor, rows: int, columns: int) -> Tensor:
    """Returns a plain ground [3, rows, columns]: the muted contrary of colours [n, 3] in Lab, above a darker floor."""
    hue = (lab[:, 1:] * lab[:, 1:].norm(dim=1, keepdim=True)).mean(0)  # that of the most colourful parts
    light = _DARK if lab[:, 0].mean() > _PALE else _LIGHT
    down = torch.linspace(0, 1, rows)
    lightness = light + 5 * (0.5 - down) - _DEEP * torch.sigmoid((down - _FLOOR) / 0.01)
    tone = -_CHROMA * functional.normalize(hue, dim=0)
    ground = from_lab(torch.cat((lightness[:, None], tone.expand(rows, 2)), 1))
    return ground.T[:, :, None].expand(3, rows, columns).clamp(0, 1).contiguous()


def _calm(ground: Tensor, where: Tensor, lightness: float) -> Tensor:
    """Returns a ground [3, H, W] that is soft around subjects at `where` [H, W], lighter or darker than they are.

    lightness: mean L* of the subjects
    """
    rows = ground.shape[1]
    near = (2.5 * images.gaussian_blur(where[None], _AROUND * rows)[0]).clamp(0, 1)
    around = near * (1 - where)
    if not bool(around.any()):
        return ground
    lab = to_lab(torch.lerp(ground, images.gaussian_blur(ground, _CALM * rows), near).permute(1, 2, 0))
    behind = float((lab[..., 0] * around).sum() / around.sum())
    if abs(lightness - behind) < _APART:
        lab[..., 0] = (lab[..., 0] + (_PUSH if behind >= lightness else -_PUSH) * near).clamp(0, 100)
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


def paste(thing: Tensor, picture: Tensor, top: int, left: int) -> tuple[Tensor, Tensor]:
    """Returns the picture [3, H, W] with a thing [4, h, w] at a place inside it, and the thing's opacity [H, W]."""
    _, rows, columns = picture.shape
    over = functional.pad(thing, [left, columns - left - thing.shape[2], top, rows - top - thing.shape[1]])
    return torch.lerp(picture, over[:3], over[3:]).clamp(0, 1), over[3]


def resize(thing: Tensor, scale: float) -> Tensor:
    """Returns a thing, colour and opacity [4, h, w], scaled by `scale`."""
    size = [max(1, round(side * scale)) for side in thing.shape[1:]]
    # Colours are weighted by opacity in the resampling, because transparent pixels have none.
    seen = torch.cat((thing[:3] * thing[3:], thing[3:]))[None]
    small = functional.interpolate(seen, size, mode="bilinear", antialias=True)[0].clamp(0, 1)
    return torch.cat((small[:3] / small[3:].clamp(min=1e-4), small[3:])).clamp(0, 1)


def lay_in(thing: Tensor, picture: Tensor, own: float) -> tuple[Tensor, Tensor]:
    """Returns a picture [3, H, W] with a thing, colour and opacity [4, h, w], in it, and the thing's opacity [H, W].

    It stands at the calmest place of the lower half. Its tones are far from those behind it.
    own: share of its own colours that the thing keeps; the rest are the picture's colours, from dark to light
    """
    _, rows, columns = picture.shape
    small = images.fit(picture, _TRIED, round(_TRIED * columns / rows))
    one = resize(thing, _SIZE * min(rows, columns) / max(thing.shape[1:]))
    sides = [max(1, round(side * _TRIED / rows)) for side in one.shape[1:]]
    rough = functional.avg_pool2d(_edges(small)[None], sides, 1)[0]
    first = round(_LOW * (len(rough) - 1))
    down, across = divmod(int(rough[first:].argmin()), rough.shape[1])
    free = rows - one.shape[1], columns - one.shape[2]
    top = round((0.05 + 0.9 * (first + down) / max(1, len(rough) - 1)) * free[0])
    left = round((0.05 + 0.9 * across / max(1, rough.shape[1] - 1)) * free[1])
    behind = to_lab_picture(picture[:, top : top + one.shape[1], left : left + one.shape[2]])[0].mean()
    colors, seen = style_colors(picture), one[3] > 0.5
    painted = [torch.lerp(tone(one, colors, *tones), one, own) for tones in (_TONES if own < 1 else _TONES[:1])]
    clear = [float((to_lab_picture(each[:3])[0][seen].median() - behind).abs()) for each in painted]
    return paste(painted[clear.index(max(clear))], picture, top, left)


def _edges(picture: Tensor) -> Tensor:
    """Returns the gradient of lightness at the scale of areas, not of marks: [H, W]."""
    light = functional.pad(picture.mean(0)[None], [2 * _AREA] * 4, mode="replicate")
    smooth = functional.avg_pool2d(light, 2 * _AREA + 1, 1)[0]
    across = smooth[_AREA:-_AREA, 2 * _AREA :] - smooth[_AREA:-_AREA, : -2 * _AREA]
    down = smooth[2 * _AREA :, _AREA:-_AREA] - smooth[: -2 * _AREA, _AREA:-_AREA]
    return (across.square() + down.square()).sqrt()


def recolor(thing: Tensor, color: Tensor) -> Tensor:
    """Returns a thing, colour and opacity [4, h, w], with sRGB `color` [3] in [0, 1] as its main colour.

    Its shades change with it, and parts of another hue stay; of a thing in many colours, everything but the outlines
    changes. A thing that passes for `color` stays: a fox is already red.
    """
    lab, wanted = to_lab(thing[:3].flatten(1).T), to_lab(color)  # [h w, 3], [3]
    seen = thing[3].flatten() > 0.5
    body = seen & (lab[:, 0] > _DARKEST)
    body = body if float(body.sum()) > 0.3 * float(seen.sum()) else seen  # a black teapot
    own = lab[body]
    vivid = (own[:, 1:].norm(dim=1) > _OTHER / 2) & (wanted[1:].norm() > _OTHER / 2)
    same_hue = vivid & (functional.cosine_similarity(own[:, 1:], wanted[None, 1:]) > _SAME_HUE)
    passes = same_hue | ((own - wanted).norm(dim=1) <= _PASSES)
    if not len(own) or float(passes.float().mean()) >= _ENOUGH:
        return thing
    _, owner, count = torch.unique((own / _STEP).round(), dim=0, return_inverse=True, return_counts=True)
    main = own[owner == count.argmax()].mean(0)
    share = ((_OTHER - (lab[:, 1:] - main[1:]).norm(dim=1)) / (_OTHER - _SHADED)).clamp(0, 1)
    share = share if float(share[body].mean()) >= _PATCH else body.float()
    share = share * ((lab[:, 0] - _DARKEST / 2) / (_DARKEST / 2)).clamp(0, 1) if bool((body != seen).any()) else share
    light = (wanted[0] + _CONTRAST * (lab[:, 0] - main[0]))[:, None]
    hue = wanted[1:] * (light / wanted[0].clamp(min=1)).clamp(0.4, 1.2)
    lab = torch.lerp(lab, torch.cat((light, hue), 1), share[:, None])
    return torch.cat((from_lab(lab).T.reshape(thing[:3].shape), thing[3:])).clamp(0, 1)


def paint_of(color: str) -> Tensor:
    """Returns the sRGB [3] in [0, 1] of a colour such as "dark blue". Of several, the first counts."""
    words = color.split()
    first = next(at for at, word in enumerate(words) if word in COLORS)
    lab = to_lab(torch.tensor(COLORS[words[first]]) / 255)
    lab[0] = (lab[0] + sum(SHADES.get(word, 0) for word in words[:first])).clamp(5, 97)
    return from_lab(lab).clamp(0, 1)
