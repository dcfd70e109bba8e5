"""What the page and the record of a painting say before it begins."""

from dataclasses import asdict
from pathlib import Path

from torch import Tensor

from frida_painter.objectives.encoders.registry import EncoderRegistry
from frida_painter.report.recorder import PaintingAccount
from frida_painter.runs.goals import OpenedGoal
from frida_painter.runs.spec import RunSpec
from frida_painter.session.names import TITLES

_FIT = {
    "canvas": "the canvas has the picture's proportions",
    "crop": "the picture was cropped to the canvas",
    "pad": "the picture was padded to the canvas",
}


def painting_account(
    spec: RunSpec, goal: OpenedGoal, target: Tensor | None, encoders: EncoderRegistry
) -> PaintingAccount:
    """The account of a run: title, target picture [3, H, W] or None, facts for the page, settings for the record."""
    kind, first, _ = goal.items[0]
    facts = (
        *goal.facts,
        *((f"{choice.purpose.capitalize()} seen through", choice.used) for choice in encoders.choices),
        *((f"Better for {choice.purpose}", choice.better) for choice in encoders.choices if choice.better),
        *(("Remark", remark) for remark in encoders.remarks),
        ("Canvas", str(spec.canvas)),
        *([("Fit", _FIT[spec.fit])] if target is not None else []),
        ("Brush", spec.brush),
        ("Looks and replans", str(spec.replans)),
        ("Planned at", f"{spec.render_height} rows"),
        ("Seed", str(spec.seed)),
        ("Robot", TITLES.get(spec.robot, spec.robot)),
    )
    record = {
        **({"photo": first.name} if kind == "image" and isinstance(first, Path) else {}),
        "goal": [list(fact) for fact in goal.facts],
        "encoders": [asdict(choice) for choice in encoders.choices],
        "remarks": list(encoders.remarks),
        **spec.record(),
    }
    return PaintingAccount(spec.title or goal.title, target, facts, record)
