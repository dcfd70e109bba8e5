"""An objective of your own: one class for the term, one function that prepares it.

Here a painting shall be a mirror image of itself, left to right, as well as it can while it comes
near to a photograph:

    python examples/own_objective.py examples/photographs/cat.jpg mirrored.png
"""

import sys
from dataclasses import dataclass
from pathlib import Path

import torch
from frida_painter.config import PaintingSettings

from frida_painter import images
from frida_painter.goal import Goal, ImageTerm
from frida_painter.objectives.base import ObjectiveContext, ObjectiveTerm, prepare_term
from frida_painter.session.opening import limit_threads, open_planner


@dataclass(frozen=True)
class MirrorTerm:
    weight: float = 1.0


@prepare_term.register
def mirror(term: MirrorTerm, setting: ObjectiveContext) -> ObjectiveTerm:
    # What can be computed once is computed here; the inner function is called at every step.
    def judge(picture: torch.Tensor) -> torch.Tensor:
        return (picture - picture.flip(2)).square().mean()

    return ObjectiveTerm(judge)


def main(photo: Path, out: Path, strokes: int = 100, effort: float = 0.3, mirroring: float = 0.5) -> float:
    limit_threads()
    settings = PaintingSettings.of(strokes=strokes, effort=effort)
    goal = Goal((ImageTerm(images.load(photo)), MirrorTerm(mirroring)))
    planner = open_planner(settings, goal)
    bare = torch.ones(3, planner.fine.rows, planner.fine.columns)
    picture = planner.expected(planner.plan(bare, strokes, settings.colors, lambda step: None), bare)
    images.save(picture, out)
    return float((picture - picture.flip(2)).square().mean())


if __name__ == "__main__":
    apart = main(Path(sys.argv[1]), Path(sys.argv[2]))
    print(f"The halves are {apart:.4f} apart (mean squared difference).")
