"""Marks and values of a style picture in another picture, before anything is planned.

Optimal transport moves colours to those of the style: light for light and dark for dark, with the style's own share of
each colour (Rabin et al. 2011, "Wasserstein barycenter and its application to texture mixing"). Then the picture is put
together from pieces of the style picture: each piece is like the picture at its place and fits its neighbours (Efros
and Freeman 2001, "Image quilting for texture synthesis and transfer").
"""

from dataclasses import replace
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from frida_painter.objectives.image import ImageTerm, rise, spread
from frida_painter.objectives.objective import Goal, Term
from frida_painter.objectives.sketch import color_drawing, filled_areas
from frida_painter.objectives.style_flow import (
    FACE,
    change_by_place,
    clear_edges,
    magnification,
    mark_spacing,
    styles_of,
)
from frida_painter.strokes.palette import Palette, from_lab, to_lab
from frida_painter.system import images

# Photographs in the marks of a style. Places with edges of their own keep most of their picture.

_ROWS = 128  # of the small picture that is put together
_OWN = 0.8  # share of its own picture that a place with clear edges keeps
_LOST = 10.0  # difference in Lab of a place from its picture that counts as full
_AREA = 0.6  # blur of the values of areas, in distances of marks
_VALUES = 0.7  # share of the picture's own values of areas
_BOLD = 1.8  # factor of the differences of marks from their surroundings, because a stroke averages its place
_SHARES = 0.6  # share of the style's own shares of colours, in a picture without colours
_FACES = 1.6  # exponent of importances: marks around a face compete with it for strokes
_HELD = 4.0  # weight of a picture in the style's marks, relative to its own: it has the style, and shows the subject


def in_style_marks(goal: Goal) -> Goal:
    """Returns the goal with its photographs put together from pieces of its styles, each at its places.

    Styles with at least the weight of a photograph change it completely, lighter ones in proportion. Pictures
    that the goal begins with stay unchanged. So does a goal without a style. A changed photograph has more weight than
    before, in the same proportion, because it no longer works against the style.
    """
    styles = styles_of(goal)
    begun = {id(term.picture) for term in goal.initial}
    if not styles:
        return goal
    weight = sum(style.weight for style in styles)

    def marked(term: Term) -> Term:
        picture = term.picture
        if picture is None or not term.is_pixelwise or id(picture) in begun:
            return term
        share = min(1.0, weight / term.weight)
        laid = change_by_place(picture, styles, lambda style: lay_marks(picture, style, term.importance))
        held: Any = term.with_picture(torch.lerp(picture, laid, share))  # terms are dataclasses
        if term.importance is not None:
            held = held.weigh(spread(term.importance**_FACES, *term.importance.shape))
        return replace(held, weight=term.weight * _HELD**share)

    return Goal(tuple(map(marked, goal.terms)), goal.initial)


def fill_drawing_in_style(goal: Goal, rows: int, columns: int) -> Goal:
    """Returns the goal with a picture [3, rows, columns] of its drawing in its styles, if it has no picture.

    The drawing's areas take colours of the style; what is around them takes its marks too, in proportion if the styles
    are lighter than the drawing. Pictures are compared pixel by pixel in every iteration. So slow networks need not be
    asked in each, and no paper stays bare.
    """
    styles = styles_of(goal)
    drawn = next((term for term in goal.terms if term.drawing is not None), None)
    if not styles or drawn is None or any(term.picture is not None for term in (*goal.terms, *goal.initial)):
        return goal
    assert drawn.drawing is not None
    drawing = images.fit(drawn.drawing, rows, columns)
    share = min(1.0, sum(style.weight for style in styles) / drawn.weight)

    def paint(style: Tensor) -> Tensor:
        filled = color_drawing(drawing, style)
        return torch.lerp(filled, in_style(filled, filled_areas(filled), style), share)

    picture = change_by_place(drawing, styles, paint)
    return Goal((*goal.terms, ImageTerm(picture, drawn.weight * _HELD**share)), goal.initial)


def lay_marks(picture: Tensor, style: Tensor, importance: Tensor | None = None) -> Tensor:
    """Returns a picture [3, H, W], which is in the colours of a style [3, h, w], in its marks and values, in sRGB.

    A place keeps most of its picture if it has edges that the marks cannot show.
    importance [h, w]: places of three times the least importance, such as faces, keep their picture
    """
    rows, columns = picture.shape[1:]
    shape = _shape_of_pieces(rows, columns)
    small, whole = to_lab_picture(images.fit(picture, *shape)), to_lab_picture(images.fit(style, *shape))
    own_colors, its_colors = (lab[1:].flatten(1).var(1).sum().sqrt() for lab in (small, whole))
    colorless = 1 - float((own_colors / its_colors.clamp(min=1e-6)).clamp(max=1))
    moved = torch.cat((small[:1], in_colors(small, whole)[1:]))  # values stay: those of even areas have no order
    mixed = torch.lerp(small, moved, _SHARES * colorless)
    colored = torch.lerp(picture, images.fit(from_lab_picture(mixed), rows, columns), colorless)
    laid = marks_over(mixed, style)
    lost = ((_soften(laid) - _soften(mixed)).norm(dim=0) / _LOST).clamp(max=1)
    own = _OWN * clear_edges(picture, *shape) * lost
    if importance is not None:
        own = torch.maximum(own, rise(spread(importance, *shape), FACE))
    marked = images.fit(from_lab_picture(laid), rows, columns)
    return torch.lerp(marked, colored, images.fit(own[None], rows, columns)).clamp(0, 1)


def marks_over(picture: Tensor, style: Tensor) -> Tensor:
    """Returns a picture [3, H, W] in Lab in the marks of a style [3, h, w] of sRGB, with mostly its own values."""
    # Pieces are those of the style at the size of marks; of a panorama they are those of its middle.
    sides = (_ROWS * magnification(style) * min(side / min(style.shape[1:]), _LONGEST) for side in style.shape[1:])
    laid = quilt(picture, to_lab_picture(images.fit(style, *map(round, sides))))
    blur = _AREA * mark_spacing(style) * magnification(style) * min(picture.shape[1:])
    values, around = (images.gaussian_blur(one, blur) for one in (picture, laid))
    return torch.lerp(around, values, _VALUES) + _BOLD * (laid - around)


def to_lab_picture(picture: Tensor) -> Tensor:
    """Returns a picture [3, H, W] of sRGB in Lab."""
    return to_lab(picture.permute(1, 2, 0)).permute(2, 0, 1)


def from_lab_picture(lab: Tensor) -> Tensor:
    """Returns a picture [3, H, W] of Lab in sRGB."""
    return from_lab(lab.permute(1, 2, 0)).permute(2, 0, 1)


# A scene in the colours, the value structure and the marks of a style. Things keep their shape.

_COLORS = 8  # number of the style's colours besides its darkest and lightest
_LOOKED_AT = 4000  # number of its pixels from which they are taken
_FEWEST_TONES = 10.0  # least range of L* in a drawing with shades
_CLEAR_SHAPE = 1.6  # factor of the opacity of things, whose soft edges are theirs


def in_style(scene: Tensor, where: Tensor, style: Tensor) -> Tensor:
    """Returns a scene [3, H, W] in sRGB in the colours, values and marks of a style picture [3, h, w].

    where [H, W]: opacity of the scene's things, in [0, 1]; they take the colours over all its values, so that they
    stand out, and hardly the marks
    """
    rows, columns = scene.shape[1:]
    shape = _shape_of_pieces(rows, columns)
    whole = to_lab_picture(images.fit(style, *shape))
    small, thing = images.fit(scene, *shape), (_CLEAR_SHAPE * images.fit(where[None], *shape)).clamp(max=1)
    ground = in_colors(to_lab_picture(small), whole)
    own = tone(torch.cat((small, thing)), style_colors(style), 0.0, 1.0)[:3] if bool((thing > 0.5).any()) else small
    colored = torch.lerp(ground, to_lab_picture(own), thing)
    painted = torch.lerp(marks_over(colored, style), colored, _OWN * thing)
    return images.fit(from_lab_picture(painted), rows, columns)


def style_colors(picture: Tensor) -> Tensor:
    """Returns the picture's colours in Lab, [n, 3], from its darkest to its lightest."""
    seen = picture.flatten(1).T
    seen = seen[:: max(1, len(seen) // _LOOKED_AT)]
    lab, middle = to_lab(seen), Palette.cluster(seen, torch.ones(len(seen)), _COLORS, seed=0).lab()
    low, high = lab[:, 0].quantile(0.03), lab[:, 0].quantile(0.97)
    ends = [lab[lab[:, 0] <= low].mean(0, keepdim=True), lab[lab[:, 0] >= high].mean(0, keepdim=True)]
    between = middle[(middle[:, 0] > ends[0][0, 0]) & (middle[:, 0] < ends[1][0, 0])].flip(0)
    return torch.cat((ends[0], between, ends[1]))


def tone(drawing: Tensor, colors: Tensor, low: float, high: float) -> Tensor:
    """Returns a drawing, colour and opacity [4, h, w], in `colors` (Lab, dark to light), from `low` to `high`."""
    light = to_lab_picture(drawing[:3])[0]
    seen = light[drawing[3] > 0.5]
    first, last = seen.quantile(0.02), seen.quantile(0.98)
    share = ((light - first) / (last - first).clamp(min=_FEWEST_TONES)).clamp(0, 1)
    dark, bright = colors[0, 0], colors[-1, 0]
    wanted = (dark + (low + (high - low) * share) * (bright - dark)).numpy()
    scale = colors.numpy()
    lab = np.stack([np.interp(wanted, scale[:, 0], scale[:, part]) for part in range(3)])
    return torch.cat((from_lab_picture(torch.from_numpy(lab).float()), drawing[3:]))


# Optimal transport of colours

_TURNS = 12  # of the axes along which colours are moved


def transport(colors: Tensor, wanted: Tensor) -> Tensor:
    """Returns colours [n, 3] moved so that they are distributed as `wanted` [m, 3] is, with little movement.

    Along each of some axes, the i-th smallest value becomes the i-th smallest wanted one. The first axes are the given
    ones, so that lightness keeps its order.
    """
    chance = torch.Generator().manual_seed(0)
    rank = torch.linspace(0, len(wanted) - 1, len(colors)).round().long()
    for turn in range(_TURNS):
        axes = torch.linalg.qr(torch.randn(3, 3, generator=chance)).Q if turn else torch.eye(3)
        seen, aim = colors @ axes, (wanted @ axes).sort(0).values[rank]
        moved = torch.empty_like(seen).scatter_(0, seen.argsort(dim=0, stable=True), aim)
        colors = colors + (moved - seen) @ axes.T
    return colors


def in_colors(picture: Tensor, style: Tensor) -> Tensor:
    """Returns a picture [3, H, W] with the colours of a style [3, h, w] in the style's own shares, both in Lab."""
    return transport(picture.flatten(1).T, style.flatten(1).T).T.reshape(picture.shape)


# Pieces of a style

_LONGEST = 1.6  # longer side of the style that is used, in shorter ones
_PIECE, _STEP, _APART = 14, 10, 3  # pixels: side of a piece, distance of pieces, and of candidates
_COARSE = 3  # pixels: radius within which a piece is compared with the picture
_AGAIN, _NEAR = 1.0, 2  # cost of each further use of a piece, relative to its own; candidates that count as the same
_ALIKE = 0.7  # weight of the likeness to the picture; the rest is that of fitting the neighbours


def _shape_of_pieces(rows: int, columns: int) -> tuple[int, int]:
    return _ROWS, max(_PIECE, round(_ROWS * columns / rows))


def quilt(scene: Tensor, style: Tensor) -> Tensor:
    """Returns a picture [3, H, W] put together from pieces of the style [3, h, w], both in Lab."""
    apart = max(1, round(_APART * min(style.shape[1:]) / _ROWS))
    pieces, coarse = (functional.unfold(picture[None], _PIECE, stride=apart)[0] for picture in (style, _soften(style)))
    wanted, size = _soften(scene), 3 * _PIECE**2
    laid, weight = torch.zeros_like(scene), torch.zeros_like(scene)
    down, across = ((side - _PIECE) // apart + 1 for side in style.shape[1:])
    used = torch.zeros(down, across)  # for each candidate, how often it or one near it was taken
    ramp = torch.arange(1.0, _PIECE + 1)
    ramp = torch.minimum(ramp, ramp.flip(0)).clamp(max=_PIECE - _STEP)
    window = (ramp[:, None] * ramp).expand(3, -1, -1)
    tops, lefts = ([*range(0, side - _PIECE, _STEP), side - _PIECE] for side in scene.shape[1:])
    for top in tops:
        for left in lefts:
            here = (slice(None), slice(top, top + _PIECE), slice(left, left + _PIECE))
            cost = _ALIKE * (coarse - wanted[here].reshape(size, 1)).square().mean(0)
            beside = weight[here].reshape(size) > 0
            if bool(beside.any()):
                there = (laid[here] / weight[here].clamp(min=1e-6)).reshape(size)[beside]
                cost = cost + (1 - _ALIKE) * (pieces[beside] - there[:, None]).square().mean(0)
            chosen = int((cost * (1 + _AGAIN * used.flatten())).argmin())
            row, column = divmod(chosen, across)
            used[max(0, row - _NEAR) : row + _NEAR + 1, max(0, column - _NEAR) : column + _NEAR + 1] += 1
            laid[here] += window * pieces[:, chosen].reshape(3, _PIECE, _PIECE)
            weight[here] += window
    return laid / weight


def _soften(picture: Tensor) -> Tensor:
    around = functional.pad(picture[None], (_COARSE,) * 4, mode="replicate")
    return functional.avg_pool2d(around, 2 * _COARSE + 1, 1)[0]
