"""Drawings: the lines on a sheet of paper, whatever its light, made as broad as a brush paints, and filled in."""

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from frida_painter.palette import Palette, to_lab

_INK = 0.25  # from white paper at 0 to black at 1: what is darker is a line
_DIRTY, _BLACK = 0.15, 0.45  # darkness below which paper is only dirty, and above which ink is black
_WINDOW = 16  # of the shorter side: lines are thinner than two such parts, and light changes more slowly
_COLORS = 6  # of a style that a drawing is filled with
_SPECK = 1e-3  # of the sheet
_COARSE = 160  # rows and columns, at most, in which the light is looked at


def cleaned(picture: Tensor) -> Tensor:
    """The drawing on a photograph or scan [3, H, W] in [0, 1], on white paper, with its lines in full colour.

    Light on paper changes slowly and lines are thin: what is left when they are closed is the paper.
    A drawing in chalk on a dark board comes out dark on white.
    """
    if float(picture.mean(0).median()) < 0.5:
        picture = 1 - picture
    _, rows, columns = picture.shape
    scale = min(1.0, _COARSE / max(rows, columns))
    size = [max(8, round(rows * scale)), max(8, round(columns * scale))]
    small = functional.interpolate(picture[None], size, mode="bilinear", antialias=True)
    paper = _closed(small, min(size) // _WINDOW)
    # Where a filled area is wider than the window, the sheet as a whole says how bright paper is.
    paper = torch.maximum(paper, 0.6 * paper.flatten(2).median(2).values[..., None, None])
    paper = functional.interpolate(paper, [rows, columns], mode="bilinear")[0].clamp(min=0.05)
    shade = (1 - picture / paper).clamp(0, 1)  # [3, H, W]
    dark = shade.amax(0)
    strength = ((dark - _DIRTY) / (_BLACK - _DIRTY)).clamp(0, 1)
    return 1 - shade * (strength / dark.clamp(min=_DIRTY))


def ink(drawing: Tensor) -> Tensor:
    """Where a cleaned drawing [3, H, W] has lines: [H, W], true or false."""
    return 1 - drawing.amin(0) > _INK


def broadened(drawing: Tensor, share: float) -> Tensor:
    """A cleaned drawing [3, H, W] whose lines are about `share` of its shorter side wide; broader ones stay."""
    import cv2  # only drawings need it

    lines = ink(drawing).cpu().numpy().astype(np.uint8)
    depth = cv2.distanceTransform(lines, cv2.DIST_L2, 3)
    # Across a line of half width a, the distance to the next pixel beyond is (a + 1) / 2 in the mean.
    half = 2 * float(depth[lines > 0].mean()) - 1 if lines.any() else 0.0
    reach = round(share * min(drawing.shape[1:]) / 2 - half)
    if reach <= 0:
        return drawing
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    broad = cv2.erode(np.ascontiguousarray(drawing.permute(1, 2, 0).cpu().numpy()), disc)
    return torch.from_numpy(broad).permute(2, 0, 1).contiguous().to(drawing)


def colored(drawing: Tensor, style: Tensor) -> Tensor:
    """A cleaned drawing [3, H, W] in the colours of a picture [3, h, w]: its lines, and what they enclose.

    Lines get the darkest of the picture's colours, the widest area (the ground) the lightest, the
    others the most vivid ones in turn. Specks between lines stay with the lines.
    """
    import cv2

    seen = functional.interpolate(style[None], (48, 48), mode="bilinear", antialias=True)[0].flatten(1).T
    colors = Palette.cluster(seen, torch.ones(len(seen)), _COLORS, seed=0).color.to(drawing)
    vivid = torch.argsort(to_lab(colors[1:-1])[:, 1:].norm(dim=1), descending=True)
    paper = (~ink(drawing)).cpu().numpy().astype(np.uint8)
    _, areas, facts, _ = cv2.connectedComponentsWithStats(paper, connectivity=4)
    sizes = facts[1:, cv2.CC_STAT_AREA]  # the first area is the lines themselves
    widest = [1 + area for area in np.argsort(-sizes, kind="stable").tolist() if sizes[area] > _SPECK * paper.size]
    filled = colors[-1][:, None, None].expand_as(drawing).clone()
    for rank, area in enumerate(widest):
        color = colors[0] if rank == 0 else colors[1:-1][vivid[(rank - 1) % len(vivid)]]
        filled[:, torch.from_numpy(areas == area).to(drawing.device)] = color[:, None]
    return filled


def _closed(picture: Tensor, reach: int) -> Tensor:
    """The picture [1, 3, h, w] without what is dark and narrower than 2 `reach` + 1 pixels, and smoothed."""
    around = 2 * reach + 1

    def pad(x: Tensor) -> Tensor:
        return functional.pad(x, [reach] * 4, mode="replicate")

    dilated = functional.max_pool2d(pad(picture), around, 1)
    return functional.avg_pool2d(pad(-functional.max_pool2d(pad(-dilated), around, 1)), around, 1)
