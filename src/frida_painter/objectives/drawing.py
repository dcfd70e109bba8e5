"""Drawings among pictures: lines on an even ground, such as pen, pencil or chalk drawings, charts and scores."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.objectives.image import ImageTerm
from frida_painter.objectives.objective import Goal, Term
from frida_painter.system import images

_SIDE = 320  # pixels of the shorter side of the examined picture
_THIN = 25  # parts of the shorter side: lines are thinner than one part
_EVEN = 0.06  # largest difference in sRGB between the ground and even light on it
_LINE, _FAINT = 0.2, 0.06  # darkness, relative to the ground, of the pixels of lines, and of dirt and shadows

_GROUND, _EDGE = 0.75, 0.7  # least share of ground in a drawing, and along its edges
_LINES = 0.004, 0.4  # share of line pixels in a drawing
_MAX_INK = 0.2  # share of line pixels up to which lines are widened, so that they do not flow together
_UNEVEN, _COLORED = 0.35, 0.25  # largest differences of the light, and of the bands of the ground
_BOARD = 0.3  # largest brightness of a board for chalk
_WHITE = 0.85  # brightness of all bands from which paper counts as white
_LONG = 8.0  # times its width: length from which a dark area is a line


def is_drawing(picture: Tensor) -> bool:
    """Returns True if a picture [3, H, W] shows lines on an even ground, under light that changes slowly.

    Photographs, silhouettes and filled areas are none: without details that are thinner than a line may be, they are
    not even.
    """
    import cv2  # loaded here because few pictures get so far

    scale = min(1.0, _SIDE / min(picture.shape[1:]))
    small = images.fit(picture, *(max(16, round(scale * side)) for side in picture.shape[1:]))
    pixels = np.ascontiguousarray(small.permute(1, 2, 0).cpu().numpy())
    is_board = float(np.median(pixels.mean(2))) < 0.5
    if is_board:
        pixels = 1 - pixels
    reach = max(2, min(pixels.shape[:2]) // (2 * _THIN))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    bare = cv2.morphologyEx(pixels, cv2.MORPH_CLOSE, disc, borderType=cv2.BORDER_REPLICATE)
    bare = cv2.blur(bare, (2 * reach + 1, 2 * reach + 1), borderType=cv2.BORDER_REPLICATE)
    light = _even_light(np.asarray(bare, np.float32))
    ground = np.abs(light - bare).max(2) < _EVEN
    edges = np.concatenate((ground[:reach], ground[-reach:], ground[:, :reach].T, ground[:, -reach:].T), axis=None)
    shade = (1 - pixels / np.maximum(bare, 0.05)).max(2)
    lines = ground & (shade > _LINE)
    share, faint = lines.mean(), (ground & (shade > _FAINT)).mean()
    paper = light.mean(2)
    return bool(
        ground.mean() > _GROUND
        and edges.mean() > _EDGE
        and _LINES[0] < share < _LINES[1]
        and share > (1 - ground.mean()) / 4
        and faint < 2 * share
        and paper.max() - paper.min() < _UNEVEN
        and np.ptp(light.mean((0, 1))) < _COLORED
        and (not is_board or 1 - paper.mean() < _BOARD)
        and _share_of_long(lines) > (0.5 if is_board else 0.3)
    )


def _even_light(bare: NDArray[np.float32]) -> NDArray[np.float32]:
    """Returns the quadratic light [h, w, 3] on most of a picture of the bare ground."""
    rows, columns, _ = bare.shape
    down, across = (way.ravel() for way in np.mgrid[-1 : 1 : rows * 1j, -1 : 1 : columns * 1j])
    ways = np.stack((np.ones_like(down), down, across, down**2, across**2, down * across), 1)
    colors = bare.reshape(-1, 3)
    some = slice(None, None, max(1, len(colors) // 6000))
    used = colors[some].mean(1) >= np.quantile(colors[some].mean(1), 0.3)
    for _ in range(6):
        found = np.linalg.lstsq(ways[some][used], colors[some][used], rcond=None)[0]
        off = np.abs(ways[some] @ found - colors[some]).max(1)
        used = off <= max(_EVEN / 2, np.quantile(off, 0.5))
    return np.asarray((ways @ found).reshape(bare.shape), np.float32)


def _share_of_long(lines: NDArray[np.bool_]) -> float:
    """Returns the share of the line pixels [h, w] in areas that are much longer than lines are wide."""
    import cv2

    mask = lines.astype(np.uint8)
    wide = 2 * float(cv2.distanceTransform(mask, cv2.DIST_L2, 3)[lines].mean()) if lines.any() else 0.0
    _, _, facts, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    area = facts[1:, cv2.CC_STAT_AREA]
    far = np.hypot(facts[1:, cv2.CC_STAT_WIDTH], facts[1:, cv2.CC_STAT_HEIGHT])
    return float(area[far > _LONG * wide].sum() / max(area.sum(), 1))


def draws(goal: Goal) -> bool:
    """Returns True if a goal is one picture, that is a drawing, and nobody has prepared it for planning."""
    (first, *others) = goal.terms
    if others or goal.initial or not isinstance(first, ImageTerm) or first.wanted is not None:
        return False
    return is_drawing(first.image)


def with_bold_lines(goal: Goal, width: float) -> Goal:
    """Returns the goal of a drawing with lines that a brush can paint, in full colour on an even ground.

    width: width of a mark, as a share of the picture's shorter side. Thinner lines become as wide, or less if they
    would flow together.
    The ground has the median colour of the picture; one that is nearly white or black becomes so.
    """
    from frida_painter.objectives.sketch import broaden_lines, clean_drawing, ink  # loads cv2

    def bold(term: Term) -> Term:
        assert isinstance(term, ImageTerm)
        is_board = float(term.image.mean(0).median()) < 0.5
        paper = (1 - term.image if is_board else term.image).flatten(1).median(1).values[:, None, None]
        clean, reach = clean_drawing(term.image), width
        while float(ink(wide := broaden_lines(clean, reach)).float().mean()) > _MAX_INK and reach > width / 4:
            reach *= 0.7
        on_paper = wide if float(paper.min()) > _WHITE else wide * paper
        return replace(term, wanted=1 - on_paper if is_board else on_paper)

    return goal.change(bold)
