"""The story of one painting: everything its page tells, as plain names and numbers.

Pictures, the film and the downloads are file names relative to the painting's folder.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from torch import Tensor

from frida_painter.mixing.recipe import Recipe
from frida_painter.palette import to_hex, to_lab
from frida_painter.plan import Plan


@dataclass(frozen=True)
class PaintFacts:
    """One paint to mix: number from 1, hex "#rrggbb", sRGB bytes, Lab, its strokes and what they amount to.

    length: of its strokes' marks together, metres; share: of the length that all paints paint, in [0, 1];
    recipe: how to mix it, in words, "" where nobody has asked; layer: the one, from 1, before which its well is filled.
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
    """One look at the canvas in the middle of the painting, and what planning again made of it.

    strokes: how many were painted by then; photograph, expected, difference: what was seen, what the
    plan had promised, and where the two differ; plan: the finished painting as planned from then on;
    loss_before, loss_after: of that plan before and after planning again; text: a sentence or two.
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
    """The loss while one plan was made: (iteration, loss) in order; name as it stands over the curve."""

    name: str
    loss: tuple[tuple[int, float], ...]


@dataclass(frozen=True)
class Comparison:
    """How near one picture comes to another: PSNR in dB, and the mean distance in Lab (2 is just visible)."""

    label: str
    psnr: float
    distance: float


@dataclass(frozen=True)
class Download:
    """A file that a person may want to take along, and in a few words what it is for."""

    file: str
    purpose: str


@dataclass(frozen=True)
class Story:
    """What the page of a painting tells, in its order.

    target is None where no picture was wanted, painting where the work was stopped before the first
    photograph of the canvas, film where there is none; facts are (label, value) in the order in which they stand.
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
    comparisons: tuple[Comparison, ...] = ()
    facts: tuple[tuple[str, str], ...] = ()
    downloads: tuple[Download, ...] = ()
    stopped: bool = False
    arm_film: str | None = None
    mixing_sheet: str | None = None


def paints(plan: Plan, recipes: Sequence[Recipe] = ()) -> tuple[PaintFacts, ...]:
    """The paints of a plan in the order of its palette, numbered by their wells, with what each of them is needed for.

    recipes: how to mix them, one each, or none at all.
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


def compare(label: str, picture: Tensor, reference: Tensor) -> Comparison:
    """Measures `picture` against `reference`, both sRGB [3, H, W] in [0, 1]."""
    error = (picture - reference).double().square().mean().clamp(min=1e-10)
    apart = (to_lab(picture.permute(1, 2, 0)) - to_lab(reference.permute(1, 2, 0))).norm(dim=-1).mean()
    return Comparison(label, float(-10 * error.log10()), float(apart))
