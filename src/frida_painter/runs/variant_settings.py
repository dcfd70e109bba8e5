"""Variants of a plan: the same goal in other manners, planned side by side for a person to choose from."""

from collections.abc import Set
from typing import Any

from frida_painter.runs.spec import RunSpec

VARIANTS: dict[str, dict[str, Any]] = {
    "loose": {"strokes": 110, "brushes": "broad:80%,medium:20%", "seed": 1},
    "faithful": {},
    "graphic": {"colors": 5, "new_paints": False, "brushes": "broad:40%,fine:60%"},
}
"""Settings of the variants of a plan, by name, in the order of their numbers; strokes and colors are the most."""
VARIANT = "variant"
"""Fact about a plan (`Plan.about`): the name of its variant."""
_OF_PALETTE = {"colors", "new_paints"}


def variant_of(spec: RunSpec, name: str, held: Set[str] | None = None) -> RunSpec:
    """Returns the description with the settings of a variant, if there is one; what the person has set stays as it is.

    held: names of the settings that the person has set; those of the description by default.
    Brushes change only if several are usual, because not every robot changes them.
    """
    given = (spec.model_fields_set if held is None else held) | (_OF_PALETTE if spec.palette is not None else set())
    wanted = {key: value for key, value in VARIANTS.get(name, {}).items() if key not in given}
    brushes = wanted.pop("brushes", None)
    wanted |= {most: min(wanted[most], getattr(spec, most)) for most in wanted.keys() & {"strokes", "colors"}}
    varied = spec.with_values(**wanted)
    several = brushes is not None and spec.strokes_of is None and "," in varied.usual_brushes
    return varied.with_values(brushes=brushes) if several else varied
