"""Figures of a painting for its page and its sheets: the use of each paint, and the similarity of two pictures."""

import math
from dataclasses import dataclass

from torch import Tensor

from frida_painter.strokes.palette import to_hex, to_lab
from frida_painter.strokes.plan import Plan
from frida_painter.system import images

_LIKENESS = (
    (26.0, "a close likeness"),
    (21.0, "a good likeness"),
    (17.0, "a free likeness"),
    (-math.inf, "a distant likeness"),
)  # from so many dB on


@dataclass(frozen=True)
class PaintFacts:
    """Facts about one paint.

    number: of its well, from 1
    hex: "#rrggbb"
    srgb: bytes
    lab: CIELAB
    strokes: number of its strokes
    share: of the length of all paints' strokes, in [0, 1]
    """

    number: int
    hex: str
    srgb: tuple[int, int, int]
    lab: tuple[float, float, float]
    strokes: int
    share: float


@dataclass(frozen=True)
class PictureComparison:
    """Similarity of two pictures.

    label: what is compared
    psnr: dB
    distance: mean distance in Lab; 2 is just visible
    size: columns and rows in pixels at which they are compared
    """

    label: str
    psnr: float
    distance: float
    size: tuple[int, int]

    @property
    def words(self) -> str:
        """Nearness of a painting to its photograph, as a person says it."""
        return next(words for least, words in _LIKENESS if self.psnr >= least)

    def __str__(self) -> str:
        return f"{self.label}: {self.psnr:.2f} dB (PSNR at {self.size[0]} x {self.size[1]} pixels)"


def paints(plan: Plan) -> tuple[PaintFacts, ...]:
    """Returns the paints of a plan in the order of its palette, numbered by their wells, with their use."""
    counts = plan.paint.bincount(minlength=len(plan.palette)).tolist()
    lengths = plan.paint.bincount(plan.strokes.length.double(), minlength=len(plan.palette))  # [k] metres
    shares = lengths / lengths.sum().clamp(min=1e-12)
    colors, lab = plan.palette.color, plan.palette.lab()
    wells = [well for _, part in plan.by_wells() for well in range(1, len(part.palette) + 1)]
    return tuple(
        PaintFacts(
            number=wells[paint],
            hex=to_hex(colors[paint]),
            srgb=tuple((colors[paint] * 255).round().int().tolist()),
            lab=tuple(round(part, 1) + 0.0 for part in lab[paint].tolist()),
            strokes=count,
            share=float(shares[paint]),
        )
        for paint, count in enumerate(counts)
    )


def compare(label: str, picture: Tensor, reference: Tensor, rows: int, columns: int) -> PictureComparison:
    """Returns the similarity of `picture` to `reference`, both sRGB [3, H, W] in [0, 1], at `rows` x `columns`."""
    picture, reference = (images.shrink_to_compare(each, rows, columns) for each in (picture, reference))
    error = (picture - reference).double().square().mean().clamp(min=1e-10)
    apart = (to_lab(picture.permute(1, 2, 0)) - to_lab(reference.permute(1, 2, 0))).norm(dim=-1).mean()
    return PictureComparison(label, round(-10 * float(error.log10()), 3), round(float(apart), 3), (columns, rows))
