"""Paint that a plan needs: the mixtures for the wells of each brush, in the order of work, and the tubes to buy."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from frida_painter.brush.kinds import brush_kind
from frida_painter.mixing.paint import Paint
from frida_painter.mixing.recipe import Recipe
from frida_painter.strokes.plan import Plan
from frida_painter.system.storage import count_of

DROP = 0.05
"""Millilitres of a drop, the least that a person measures."""
RESERVE, MIN_MIXED = 2.0, 3.0
"""Amount to mix: so many times what the brush takes, and at least so many millilitres, because a brush dips in it."""
TUBES = (20, 60, 120, 250)
"""Millilitres of tubes of artists' acrylics. Some makers sell 59 or 75 instead of 60, and 138 or 200 above 120."""
_FULL = 3.5  # millilitres that a clean brush takes, for each metre of the width of its widest mark (virtual studio)


def use_of_paint(plan: Plan) -> Tensor:
    """Returns the millilitres of each paint of the palette that the brush takes out of the wells: [k].

    Each dip fills the brush. The rest of a dip stays in it for the next one into the same paint, and is washed out
    before another paint and after the layer.
    Raises ConfigError if a brush of the plan is unknown.
    """
    taken = torch.zeros(len(plan.palette), dtype=torch.float64)
    for layer, part in zip(plan.layers, plan.by_layer(), strict=True):
        brush = brush_kind(layer.brush)
        uses = brush.dip.used_by(brush.area(part.strokes).double()).tolist()
        held, spent = None, 0.0
        for paint, use in zip(part.paint.tolist(), uses, strict=True):
            if paint != held or spent + use > brush.dip.holds:
                missing = 1.0 if paint != held else spent / brush.dip.holds
                taken[layer.paints[0] + paint] += _FULL * brush.width * missing
                held, spent = paint, 0.0
            spent += use
    return taken


@dataclass(frozen=True, eq=False)
class Mixture:
    """Paint to mix.

    wells: (layer, well) that it fills, in the order of work, both from 1
    drawn: millilitres that the brush takes out of these wells; None if there is no plan
    """

    recipe: Recipe
    wells: tuple[tuple[int, int], ...]
    drawn: float | None = None

    @property
    def volume(self) -> float | None:
        """Millilitres to mix: whole drops of each part, `RESERVE` times what is drawn, at least `MIN_MIXED`."""
        if self.drawn is None:
            return None
        part = self.recipe.whole * DROP
        return part * -(-max(RESERVE * self.drawn, MIN_MIXED) // part)

    @property
    def amounts(self) -> dict[str, float]:
        """Millilitres of each tube paint, by name."""
        names = [paint.name for paint, _ in self.recipe.parts]
        return dict(zip(names, self.recipe.volumes(self.volume or 0.0), strict=True))

    @property
    def also(self) -> str:
        """Later wells of the same paint, in words."""
        return ", ".join(f"also layer {layer}, well {well}" for layer, well in self.wells[1:])


@dataclass(frozen=True, eq=False)
class BrushPaints:
    """Paints of one brush: those of a layer of the plan, or of all layers that are painted from the same wells.

    title: "Layer 2: medium brush, 105 strokes"; "" for a palette without a plan
    mixtures: paints to mix before the layer begins, in the order of the wells
    kept: wells with paint that was mixed for an earlier layer, in words; "" if there are none
    """

    title: str
    mixtures: tuple[Mixture, ...]
    kept: str = ""


def paints_by_brush(plan: Plan, recipes: Sequence[Recipe]) -> tuple[BrushPaints, ...]:
    """Returns the paints of a plan in the order of work; equal recipes are one mixture.

    recipes: one for each paint of the palette
    """
    mixed: dict[str, Mixture] = {}
    left = iter(recipes)
    for layer, part in (fillings := plan.by_wells()):
        for well, takes in enumerate(use_of_paint(part).tolist(), 1):
            recipe = next(left)
            same = mixed.get(recipe.words, Mixture(recipe, (), 0.0))
            wells, takes = (*same.wells, (layer, well)), (same.drawn or 0.0) + takes
            mixed[recipe.words] = replace(same, wells=wells, drawn=takes)
    found = []
    for layer, part in fillings:
        last = layer + len(part.layers) - 1
        number = f"Layer {layer}" if last == layer else f"Layers {layer} to {last}"
        old = [(well, *one.wells[0]) for one in mixed.values() for at, well in one.wells[1:] if at == layer]
        kept = ", ".join(f"{well} (layer {at}, well {of})" for well, at, of in sorted(old) if at != layer)
        ours = tuple(one for one in mixed.values() if one.wells[0][0] == layer)
        strokes = f", {count_of(len(part), 'stroke')}" if len(part) else ""
        title = f"{number}: {', then '.join(part.brushes)} brush{strokes}"
        found.append(BrushPaints(title, ours, f"Mixed before: well {kept}" if kept else ""))
    return tuple(found)


@dataclass(frozen=True)
class Supply:
    """One paint to buy.

    drawn, mixed: millilitres that the strokes take, and that are mixed
    """

    paint: Paint
    drawn: float
    mixed: float

    @property
    def tubes(self) -> tuple[int, ...]:
        """Sizes of the tubes to buy in millilitres: the smallest that is enough, above the largest size several."""
        whole, rest = divmod(self.mixed, TUBES[-1])
        return (*[TUBES[-1]] * int(whole), *[size for size in TUBES if size >= rest][: rest > 0])

    @property
    def in_tubes(self) -> str:
        """Tubes to buy in words: "2 x 250 ml + 1 x 60 ml"."""
        counts = {size: self.tubes.count(size) for size in self.tubes}
        return " + ".join(f"{count} x {size} ml" for size, count in counts.items())


def supplies(paints: Sequence[BrushPaints]) -> list[Supply]:
    """Returns all paints to buy for these brushes, most first."""
    found: dict[str, Supply] = {}
    for mixture in (each for brush in paints for each in brush.mixtures):
        takes = mixture.recipe.volumes(mixture.drawn or 0.0)
        for (paint, _), takes_of, mixed in zip(mixture.recipe.parts, takes, mixture.amounts.values(), strict=True):
            before = found.get(paint.name, Supply(paint, 0.0, 0.0))
            found[paint.name] = Supply(paint, before.drawn + takes_of, before.mixed + mixed)
    return sorted(found.values(), key=lambda supply: (-supply.mixed, supply.paint.name))
