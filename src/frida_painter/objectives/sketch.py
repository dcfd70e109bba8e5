"""Goal "sketch": edges at the lines of a drawing, and the same content."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from frida_painter.errors import ConfigError
from frida_painter.objectives.encoders.convolutional import Hed
from frida_painter.objectives.image import ImageTerm, PictureTerm
from frida_painter.objectives.objective import GRADIENT_LASTS, Goal, ObjectiveContext, ObjectiveTerm, Term
from frida_painter.objectives.semantic import Semantic
from frida_painter.strokes.palette import Palette, to_lab
from frida_painter.system import images

_FEWEST = 2e-4  # smallest share of line pixels; fewer are a speck
_BROAD = 1 / 40  # of a canvas's shorter side: about the finest lines of the brushes


@dataclass(frozen=True)
class SketchTerm(PictureTerm):
    """Term of a goal: paint along the lines of a drawing, which has at least one line.

    The drawing has dark lines on light paper, scanned or photographed, or chalk on a dark board.
    shown [3, h, w]: the drawing on a photograph that is painted with it; None for white paper
    Raises ConfigError if there is no line.
    """

    shown: Tensor | None = None
    called = "a sketch"
    is_tried = False
    initial_order = 1
    interpretation_order = 1

    def __post_init__(self) -> None:
        super().__post_init__()
        if not float(ink(clean_drawing(self.image)).float().mean()) >= _FEWEST:
            raise ConfigError(
                "A sketch without a single line was given; give a drawing of dark lines on light paper, or of chalk."
            )

    @property
    def drawing(self) -> Tensor:
        """Lines on white paper, at least as broad as a brush paints: [3, H, W] in [0, 1]."""
        return broaden_lines(clean_drawing(self.image), _BROAD)

    @property
    def guide(self) -> Tensor:
        """Drawing as it was given."""
        return self.image

    def as_start(self, goal: Goal) -> ImageTerm:
        """Returns the drawing as a picture."""
        return ImageTerm(self.drawing, self.weight)

    def on_picture(self, picture: Tensor) -> SketchTerm:
        """Returns the term for a drawing on a picture: its edges are those of lines and picture together."""
        return replace(self, shown=picture)

    def prepare(self, context: ObjectiveContext) -> ObjectiveTerm:
        """Returns the difference of edges by HED, with a small part for the content."""
        lines = self.drawing if self.shown is None else self.shown
        drawing = images.fit(lines, context.grid.rows, context.grid.columns)
        shown, hed = Semantic(drawing, context.encoders.meaning(), context.seed), context.encoders.edges()
        seen, validation = Sketch(drawing, hed, shown), Sketch(drawing, hed, shown.validation)
        return ObjectiveTerm(seen, validation, lasts=GRADIENT_LASTS if context.is_held else 1, smooth=context.is_held)

    @classmethod
    def interpret(cls, goal: Goal, context: ObjectiveContext) -> Goal:
        """Draws the sketches on the pictures of the goal."""
        return overlaid(goal)


# Preparation of drawings: even light, lines as broad as the brush, filled areas

_INK = 0.25  # darkness, 0 for white paper, 1 for black: darker pixels are lines
_DIRTY, _BLACK = 0.15, 0.45  # below: dirt of the paper; above: full ink
_WINDOW = 16  # parts of the shorter side. Lines are thinner than two parts; light changes more slowly.
_COLORS = 6  # colours of a style with which a drawing is filled
_SPECK = 1e-3  # share of the sheet
_COARSE = 160  # largest number of rows and columns for the estimate of the light


def clean_drawing(picture: Tensor) -> Tensor:
    """Returns the drawing of a photograph or scan [3, H, W] in [0, 1] on white paper, with its lines in full colour.

    Light on paper changes slowly and lines are thin, so a morphological closing leaves the paper. Chalk on a
    dark board becomes dark on white.
    """
    if float(picture.mean(0).median()) < 0.5:
        picture = 1 - picture
    _, rows, columns = picture.shape
    scale = min(1.0, _COARSE / max(rows, columns))
    size = [max(8, round(rows * scale)), max(8, round(columns * scale))]
    small = functional.interpolate(picture[None], size, mode="bilinear", antialias=True)
    paper = _close(small, min(size) // _WINDOW)
    # If a filled area is wider than the window, the median of the sheet sets the brightness of the paper.
    paper = torch.maximum(paper, 0.6 * paper.flatten(2).median(2).values[..., None, None])
    paper = functional.interpolate(paper, [rows, columns], mode="bilinear")[0].clamp(min=0.05)
    shade = (1 - picture / paper).clamp(0, 1)  # [3, H, W]
    dark = shade.amax(0)
    strength = ((dark - _DIRTY) / (_BLACK - _DIRTY)).clamp(0, 1)
    return 1 - shade * (strength / dark.clamp(min=_DIRTY))


def ink(drawing: Tensor) -> Tensor:
    """Returns the line mask of a cleaned drawing [3, H, W]: [H, W], boolean."""
    return 1 - drawing.amin(0) > _INK


def broaden_lines(drawing: Tensor, share: float) -> Tensor:
    """Returns a cleaned drawing [3, H, W] with lines about `share` of its shorter side wide; wider lines stay."""
    lines = ink(drawing).cpu().numpy().astype(np.uint8)
    depth = cv2.distanceTransform(lines, cv2.DIST_L2, 3)
    # Across a line of half width a, the mean distance to its nearest edge pixel is (a + 1) / 2.
    half = 2 * float(depth[lines > 0].mean()) - 1 if lines.any() else 0.0
    reach = round(share * min(drawing.shape[1:]) / 2 - half)
    if reach <= 0:
        return drawing
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    broad = cv2.erode(np.ascontiguousarray(drawing.permute(1, 2, 0).cpu().numpy()), disc)
    return torch.from_numpy(broad).permute(2, 0, 1).contiguous().to(drawing)


def color_drawing(drawing: Tensor, style: Tensor) -> Tensor:
    """Returns a cleaned drawing [3, H, W] in the colours of a style picture [3, h, w].

    Lines get the darkest colour. The largest enclosed area (the ground) gets the lightest. The other areas get
    the most vivid colours in turn. Specks between lines get the colour of the lines.
    """
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


def filled_areas(colored: Tensor) -> Tensor:
    """Returns 1 for the lines and the filled areas of a drawing in colours [3, H, W], 0 for its ground: [H, W]."""
    return (colored != colored[:, :1, :1]).any(0).to(colored)


def _close(picture: Tensor, reach: int) -> Tensor:
    """Returns the picture [1, 3, h, w], smoothed, without dark details narrower than 2 `reach` + 1 pixels."""
    around = 2 * reach + 1

    def pad(x: Tensor) -> Tensor:
        return functional.pad(x, [reach] * 4, mode="replicate")

    dilated = functional.max_pool2d(pad(picture), around, 1)
    return functional.avg_pool2d(pad(-functional.max_pool2d(pad(-dilated), around, 1)), around, 1)


_DARK = 0.4  # lightness of the photograph below the lines; darker ones get light lines


def overlaid(goal: Goal) -> Goal:
    """Returns the goal with all sketches drawn on its pictures that are compared pixel by pixel.

    The sketch term then compares with the edges of lines and picture together. With the edges of the lines
    alone, it would work against the picture. A goal without a picture or without a sketch stays unchanged.
    """
    drawings = [term.drawing for term in goal.terms if term.drawing is not None]
    picture = next((term.picture for term in goal.terms if term.is_pixelwise), None)
    if picture is None or not drawings:
        return goal

    def drawn(image: Tensor) -> Tensor:
        for drawing in drawings:
            image = draw_on_picture(image, images.fit(drawing, *image.shape[1:]))
        return image

    together = drawn(picture)

    def shown(term: Term) -> Term:
        if term.is_pixelwise and term.picture is not None:
            return term.with_picture(together if term.picture is picture else drawn(term.picture))
        return term.on_picture(together)

    return replace(goal, terms=tuple(map(shown, goal.terms)))


def draw_on_picture(picture: Tensor, drawing: Tensor) -> Tensor:
    """Draws a cleaned drawing on a picture, both [3, H, W], in its own colours, or in white on a dark picture.

    The mean lightness of the picture under all lines decides, so a drawing is never half white.
    """
    strength = 1 - drawing.amin(0)
    under = float((picture.mean(0) * strength).sum() / strength.sum().clamp(min=1e-6))
    own = (drawing - (1 - strength)) / strength.clamp(min=1e-3)
    line = torch.ones_like(own) if under < _DARK else own.clamp(0, 1)
    return (picture + strength * (line - picture)).clamp(0, 1)


_PIXELS = 16_000  # pixels of the compared picture, about 112 x 143
_BLURS = (0.008, 0.02, 0.05)  # shares of the shorter side: a slightly misplaced line still counts as nearly right
_MEANING = 0.1  # relative to the edges. Kept small: for a network, a drawing is far from any colour painting.
_BALANCE = 0.05  # relative to the squared difference to a picture, if both weights are 1


class Sketch:
    """Difference between the edges of a picture and those of a drawing, by the edge detector HED.

    drawing [3, H, W]: lines on white, in [0, 1]
    meaning: another loss against the drawing, which is added

    Both edge maps are blurred at three scales and compared. Each difference is divided by the strength of the
    drawing's edges: the drawing itself has 0, a picture without edges 1 (before the balance factor). The edges
    of the drawing are computed once.
    """

    def __init__(self, drawing: Tensor, hed: Hed, meaning: Callable[[Tensor], Tensor] | None = None) -> None:
        self._hed = hed
        self._meaning = meaning
        with torch.no_grad():
            self._wanted = self._see(drawing)

    def __call__(self, picture: Tensor) -> Tensor:
        """Returns the distance of a picture [3, H, W] in [0, 1] to the drawing. Differentiable."""
        total = picture.new_zeros(())
        for seen, wanted in zip(self._see(picture), self._wanted, strict=True):
            wanted = wanted.to(seen)
            total = total + (seen - wanted).square().mean() / wanted.square().mean().clamp(min=1e-6)
        distance = _BALANCE * total / len(_BLURS)
        return distance if self._meaning is None else distance + _MEANING * self._meaning(picture)

    def _see(self, picture: Tensor) -> list[Tensor]:
        """Returns the edges [h, w] at each blur."""
        edges = self._hed.edges(images.resize_to_pixels(picture, _PIXELS))
        return [images.gaussian_blur(edges[None], share * min(edges.shape))[0] for share in _BLURS]
