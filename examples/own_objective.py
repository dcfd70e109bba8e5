"""A kind of goal of your own, in one file: a painting that is its own mirror image.

    python examples/own_objective.py mirrored.png                                     # nothing else is asked for
    python examples/own_objective.py mirrored.png examples/photographs/cat.jpg        # a cat as well

In a package of yours, these lines of its pyproject.toml are all that it takes for `frida-painter paint --mirror
left-right`, for goal files, and for the page to know it:

    [project.entry-points."frida_painter.objectives"]
    mirror = "your_package.mirror:KIND"
"""

import sys
from dataclasses import dataclass
from pathlib import Path

import torch

from frida_painter import images
from frida_painter.errors import ConfigError
from frida_painter.goal import Goal, Term, require_weight
from frida_painter.objectives.kind import Gives, GoalKind
from frida_painter.objectives.kinds.image import ImageTerm
from frida_painter.objectives.objective import ObjectiveContext, ObjectiveTerm
from frida_painter.planning.planner import Planner
from frida_painter.session.opening import limit_threads

AXES = {"left-right": 2, "top-bottom": 1}


@dataclass(frozen=True)
class MirrorTerm(Term):
    axis: str = "left-right"
    weight: float = 1.0

    def __post_init__(self) -> None:
        require_weight(self.weight, "a mirror")
        if self.axis not in AXES:
            raise ConfigError(f"A mirror {self.axis[:40]!r} was asked for; it is one of {', '.join(AXES)}.")

    def prepare(self, context: ObjectiveContext) -> ObjectiveTerm:
        # What can be computed once is computed here; the inner function is called at every step.
        axis = AXES[self.axis]

        def apart(picture: torch.Tensor) -> torch.Tensor:
            return (picture - picture.flip(axis)).square().mean()

        return ObjectiveTerm(apart)


KIND = GoalKind(
    name="mirror",
    gives=Gives.WORDS,
    help="Let the painting be its own mirror image: left-right or top-bottom.",
    label="Mirror image",
    open=MirrorTerm,
)


def main(
    out: Path, photo: Path | None = None, strokes: int = 100, effort: float = 0.3, mirroring: float = 0.5
) -> float:
    limit_threads()
    mirror = MirrorTerm(weight=mirroring)
    goal = Goal((mirror,) if photo is None else (ImageTerm(images.load(photo)), mirror))
    planner = Planner(goal, effort=effort)
    picture = planner.expected(planner.plan(strokes=strokes))
    images.save(picture, out)
    return float((picture - picture.flip(2)).square().mean())


if __name__ == "__main__":
    apart = main(*map(Path, sys.argv[1:3]))
    print(f"The halves are {apart:.4f} apart (mean squared difference).")
