"""Palettes that a person can mix: each colour within reach of the person's paints, and no two of one recipe.

A planner chooses colours from the picture. A colour out of reach moves towards what its recipe gives. Two colours
with one recipe, or with mixtures that are hardly told apart, become one.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from frida_painter.mixing.recipe import REACHED, PaintSet, Recipe
from frida_painter.strokes.palette import ciede2000, to_hex, to_lab
from frida_painter.strokes.plan import Plan

MIN_APART = 1.0
"""CIEDE2000 below which two mixtures are not told apart; a person sees differences of about 1 and more."""
MIXED_PAINTS = "Paints changed so that they can be mixed"
"""Beginning of the name of a fact about a plan: colours before, with CIEDE2000, and after."""
# CIEDE2000 from its mixture at which a colour out of reach may stay: less and less, because recipes are rough, and the
# recipe of the new colour may give another mixture.
_AWAY = (REACHED - 0.1, REACHED / 2, 0.0, 0.0)
_STEPS = 64  # on the way from a mixture to a colour out of reach


@dataclass(frozen=True)
class PaintChange:
    """Change of colours of a palette, which cannot be mixed as they are.

    colors: sRGB before, one or more colours that became one.
    becomes [3]: sRGB after.
    differences: CIEDE2000 between each colour before and the colour after.
    """

    colors: tuple[Tensor, ...]
    becomes: Tensor
    differences: tuple[float, ...]

    def __str__(self) -> str:
        before = zip(self.colors, self.differences, strict=True)
        was = " and ".join(f"{to_hex(color)} ({off:.1f} off)" for color, off in before)
        return f"{was} became {to_hex(self.becomes)}"


@dataclass(frozen=True)
class MixablePalette:
    """Palette that can be mixed.

    color [m, 3]: sRGB.
    number [k]: index of the new colour for each old one.
    changes: colours that moved or merged.
    """

    color: Tensor
    number: Tensor
    changes: tuple[PaintChange, ...]


def make_mixable(color: Tensor, weight: Tensor, paints: PaintSet, apart: float) -> MixablePalette:
    """Returns colours within reach of the paints, each with a recipe of its own.

    color [k, 3]: sRGB. Colours that can be mixed and told apart stay exactly as they are.
    weight [k]: importance of each colour, such as its number of strokes. Merged colours become their weighted mean.
    apart: smallest CIEDE2000 between a changed colour and any other one.
    """
    groups = [[index] for index in range(len(color))]
    found = [_reach(one, recipe, paints) for one, recipe in zip(color, paints.mix(color), strict=True)]
    while (pair := _twins(found, _changed(color, groups, found), apart)) is not None:
        one, other = pair
        groups[one] += groups.pop(other)
        found.pop(other)
        share = weight[groups[one]].to(color) + 1e-9
        mean = (share[:, None] * color[groups[one]]).sum(0) / share.sum()
        found[one] = _reach(mean, paints.mix(mean[None])[0], paints)
    number = torch.zeros(len(color), dtype=torch.long, device=color.device)
    for at, group in enumerate(groups):
        number[group] = at
    changes = []
    for group, (after, _), changed in zip(groups, found, _changed(color, groups, found), strict=True):
        if changed:
            off = ciede2000(to_lab(color[group]), to_lab(after)[None])
            changes.append(PaintChange(tuple(color[group]), after, tuple(off.tolist())))
    return MixablePalette(torch.stack([one for one, _ in found]), number, tuple(changes))


def _changed(color: Tensor, groups: Sequence[list[int]], found: Sequence[tuple[Tensor, Recipe]]) -> list[bool]:
    """Returns True for each group of colours that moved or merged."""
    return [
        len(group) > 1 or not torch.equal(color[group[0]], one) for group, (one, _) in zip(groups, found, strict=True)
    ]


def _reach(color: Tensor, recipe: Recipe, paints: PaintSet) -> tuple[Tensor, Recipe]:
    """Returns the colour, or the nearest one within reach between it and its mixture, and the recipe.

    So two colours on both sides of the limit stay neighbours: one sky does not become two blues.
    """
    for away in _AWAY:
        if recipe.within_reach:
            break
        mixed = recipe.color.to(color).clamp(0, 1)
        way = torch.lerp(mixed, color, torch.linspace(0, 1, _STEPS).to(color)[:, None])  # [_STEPS, 3]
        off = ciede2000(to_lab(way), to_lab(mixed)[None])
        color = way[int((off <= away).nonzero().max())]
        (recipe,) = paints.mix(color[None])
    return color, recipe


def _twins(found: Sequence[tuple[Tensor, Recipe]], changed: Sequence[bool], apart: float) -> tuple[int, int] | None:
    """Returns the two nearest colours that need to become one, the lower number first; None if all may stay."""
    wells = to_lab(torch.stack([color for color, _ in found]))
    mixtures = to_lab(torch.stack([recipe.color for _, recipe in found]))
    gap, seen = (ciede2000(lab[:, None], lab[None]).cpu() for lab in (wells, mixtures))
    words, moved = np.array([recipe.words for _, recipe in found]), torch.tensor(changed)
    alike = torch.from_numpy(words[:, None] == words) | ~(seen >= MIN_APART)
    near = alike | ((moved[:, None] | moved) & ~(gap >= apart))
    pairs = [(float(seen[one, other]), one, other) for one, other in near.triu(1).nonzero().tolist()]
    return min(pairs)[1:] if pairs else None


def mixing_changes(plan: Plan) -> dict[str, str]:
    """Returns what changed of a plan's colours so that they can be mixed, for each filling of the wells in words."""
    return {name: words for name, words in plan.about if name.startswith(MIXED_PAINTS)}
