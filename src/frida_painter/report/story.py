"""The story of one painting: all content of its page, as plain names and numbers.

Pictures, the film and the downloads are file names relative to the painting's folder.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from torch import Tensor

from frida_painter.mixing.recipe import Recipe
from frida_painter.strokes.palette import to_hex, to_lab
from frida_painter.strokes.plan import Plan


@dataclass(frozen=True)
class PaintFacts:
    """Facts about one paint.

    number: of its well, from 1
    hex: "#rrggbb"
    srgb: bytes
    lab: CIELAB
    strokes: number of its strokes
    length: total length of its strokes, metres
    share: of the length of all paints' strokes, in [0, 1]
    recipe: in words; "" if it was not requested
    layer: from 1, before which its well is filled
    """

    number: int
    hex: str
    srgb: tuple[int, int, int]
    lab: tuple[float, float, float]
    strokes: int
    length: float
    share: float
    recipe: str = ""
    layer: int = 1


@dataclass(frozen=True)
class Look:
    """Look at the canvas during the painting, with the result of the replan.

    strokes: number of strokes painted so far
    photograph, expected, difference: the seen canvas, the expected one, and their difference
    plan: finished painting according to the new plan
    loss_before, loss_after: of the plan before and after the replan
    text: one or two sentences
    """

    strokes: int
    photograph: str
    expected: str
    difference: str
    plan: str
    loss_before: float
    loss_after: float
    text: str = ""


@dataclass(frozen=True)
class Phase:
    """Planning phase with its loss.

    name: above the curve
    loss: (iteration, loss) in order
    """

    name: str
    loss: tuple[tuple[int, float], ...]


@dataclass(frozen=True)
class PictureComparison:
    """Similarity of two pictures.

    label: what is compared
    psnr: dB
    distance: mean distance in Lab; 2 is just visible
    """

    label: str
    psnr: float
    distance: float


@dataclass(frozen=True)
class Download:
    """File to download, with a short statement of its purpose."""

    file: str
    purpose: str


@dataclass(frozen=True)
class Story:
    """Content of a painting's page, in the order of the page.

    target: None if there is no goal picture
    painting: None if the work was stopped before the first photograph of the canvas
    film: None if there is none
    facts: (label, value), in order
    has_camera: False if no camera looked at the canvas, so that the film shows what is expected
    watched: False if nobody photographed the finished canvas either
    """

    title: str
    summary: str
    target: str | None
    plan: str
    painting: str | None
    film: str | None
    palette_sheet: str | None
    paints: tuple[PaintFacts, ...]
    looks: tuple[Look, ...] = ()
    phases: tuple[Phase, ...] = ()
    comparisons: tuple[PictureComparison, ...] = ()
    facts: tuple[tuple[str, str], ...] = ()
    downloads: tuple[Download, ...] = ()
    stopped: bool = False
    arm_film: str | None = None
    mixing_sheet: str | None = None
    has_camera: bool = True
    watched: bool = True


def paints(plan: Plan, recipes: Sequence[Recipe] = ()) -> tuple[PaintFacts, ...]:
    """Returns the paints of a plan in the order of its palette, numbered by their wells, with their use.

    recipes: one for each paint, or none
    """
    words = [recipe.words if recipe.within_reach else f"nearest: {recipe.words}" for recipe in recipes]
    counts = plan.paint.bincount(minlength=len(plan.palette)).tolist()
    lengths = plan.paint.bincount(plan.strokes.length.double(), minlength=len(plan.palette))  # [k] metres
    shares = lengths / lengths.sum().clamp(min=1e-12)
    colors, lab = plan.palette.color, plan.palette.lab()
    wells = [(layer, well) for layer, part in plan.by_wells() for well in range(len(part.palette))]
    return tuple(
        PaintFacts(
            number=wells[paint][1] + 1,
            hex=to_hex(colors[paint]),
            srgb=tuple((colors[paint] * 255).round().int().tolist()),
            lab=tuple(round(part, 1) + 0.0 for part in lab[paint].tolist()),
            strokes=count,
            length=float(lengths[paint]),
            share=float(shares[paint]),
            recipe=words[paint] if words else "",
            layer=wells[paint][0],
        )
        for paint, count in enumerate(counts)
    )


def compare(label: str, picture: Tensor, reference: Tensor) -> PictureComparison:
    """Returns the similarity of `picture` to `reference`, both sRGB [3, H, W] in [0, 1]."""
    error = (picture - reference).double().square().mean().clamp(min=1e-10)
    apart = (to_lab(picture.permute(1, 2, 0)) - to_lab(reference.permute(1, 2, 0))).norm(dim=-1).mean()
    return PictureComparison(label, float(-10 * error.log10()), float(apart))
