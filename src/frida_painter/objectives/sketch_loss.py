"""The sketch objective: have edges where a drawing has lines, and show what it shows."""

from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from frida_painter import images
from frida_painter.images import sized
from frida_painter.objectives.encoders.vgg import Hed
from frida_painter.objectives.objective import Goal, Term
from frida_painter.palette import Palette, to_lab

# Drawings: the lines on a sheet of paper, whatever its light, made as broad as a brush paints, and filled in.

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


# A drawing beside a photograph is drawn on it: the photograph stays, and the lines are seen on top.

_DARK = 0.4  # lightness of a photograph under a drawing below which its lines are light


def overlaid(goal: Goal) -> Goal:
    """The goal, in which the lines of every sketch are drawn on the pictures that are to be painted with it.

    The pictures show them then, and the sketch asks for the edges of lines and picture together: asking for
    the lines' alone, it would fight all that the picture has. A goal without both stays as it is.
    """
    drawings = [term.drawing for term in goal.terms if term.drawing is not None]
    picture = next((term.picture for term in goal.terms if term.is_pixelwise), None)
    if picture is None or not drawings:
        return goal

    def drawn(image: Tensor) -> Tensor:
        for drawing in drawings:
            image = drawn_on(image, images.fit(drawing, *image.shape[1:]))
        return image

    together = drawn(picture)

    def shown(term: Term) -> Term:
        if term.is_pixelwise and term.picture is not None:
            return term.with_picture(together if term.picture is picture else drawn(term.picture))
        return term.on_picture(together)

    return Goal(tuple(shown(term) for term in goal.terms), goal.initial)


def drawn_on(picture: Tensor, drawing: Tensor) -> Tensor:
    """A cleaned drawing, dark on white, on a picture, both [3, H, W]: in its own colours, or in chalk where it is dark.

    A drawing stays of one kind: by the lightness of the picture under all of its lines.
    """
    strength = 1 - drawing.amin(0)
    under = float((picture.mean(0) * strength).sum() / strength.sum().clamp(min=1e-6))
    own = (drawing - (1 - strength)) / strength.clamp(min=1e-3)
    line = torch.ones_like(own) if under < _DARK else own.clamp(0, 1)
    return (picture + strength * (line - picture)).clamp(0, 1)


_PIXELS = 16_000  # of the picture in which edges are compared, about 112 x 143
_BLURS = (0.008, 0.02, 0.05)  # of the shorter side: a line that is a little off is still nearly right
_MEANING = 0.1  # of the weight of edges: to a network a drawing is far from any painting in colours
_BALANCE = 0.05  # against the squared difference to a picture, when both have a weight of 1


class Sketch:
    """The difference between the edges of a picture and those of a drawing, as the edge detector HED sees them.

    drawing [3, H, W] in [0, 1]: lines on white. Both maps are blurred three ways and compared, each
    difference relative to the strength of the drawing's own edges: 0 is the drawing itself, and
    without any edge it is as far off as 1 before the balance. The drawing is looked at once.
    meaning: what else a picture is to have in common with the drawing.
    """

    def __init__(self, drawing: Tensor, hed: Hed, meaning: Callable[[Tensor], Tensor] | None = None) -> None:
        self._hed = hed
        self._meaning = meaning
        with torch.no_grad():
            self._wanted = self._see(drawing)

    def __call__(self, picture: Tensor) -> Tensor:
        """picture [3, H, W] in [0, 1] -> its distance to the drawing; differentiable."""
        total = picture.new_zeros(())
        for seen, wanted in zip(self._see(picture), self._wanted, strict=True):
            wanted = wanted.to(seen)
            total = total + (seen - wanted).square().mean() / wanted.square().mean().clamp(min=1e-6)
        distance = _BALANCE * total / len(_BLURS)
        return distance if self._meaning is None else distance + _MEANING * self._meaning(picture)

    def _see(self, picture: Tensor) -> list[Tensor]:
        """The edges [h, w] at each blur."""
        edges = self._hed.edges(sized(picture, _PIXELS))
        return [_blurred(edges, share * min(edges.shape)) for share in _BLURS]


def _blurred(edges: Tensor, spread: float) -> Tensor:
    """Edges [h, w] blurred by a Gaussian of `spread` pixels."""
    reach = max(1, round(2.5 * spread))
    along = torch.arange(-reach, reach + 1, dtype=edges.dtype, device=edges.device)
    kernel = torch.exp(-along.square() / (2 * spread**2))
    kernel = kernel / kernel.sum()
    rows = functional.conv2d(edges[None, None], kernel[None, None, :, None], padding=(reach, 0))
    return functional.conv2d(rows, kernel[None, None, None, :], padding=(0, reach))[0, 0]
