"""Gradient descent on the plan (paper, Algorithm 1, `optimize`), under the limits it will be painted with."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from frida_painter.errors import PlanningDiverged
from frida_painter.plan import Plan
from frida_painter.planning.adam import Adam
from frida_painter.planning.scene import Scene
from frida_painter.planning.variables import Paints, Variables
from frida_painter.strokes import Strokes

_MOST_FAILURES = 3
_WARMING = 6
_BETAS = (0.9, 0.98)
_BETWEEN_VALIDATIONS = 10  # iterations


@dataclass(frozen=True)
class Step:
    """One iteration that was made: its number, of how many, the loss before it, and the strokes as they stood then.

    The strokes are in painting order, for whoever wants to watch the plan grow. brush: which paints them; below: the
    plans that are on the canvas by then.
    """

    iteration: int
    of: int
    loss: float
    strokes: Strokes | None = None
    brush: str = ""
    below: tuple[Plan, ...] = ()

    @property
    def parts(self) -> tuple[tuple[str, Strokes], ...]:
        """All strokes as they stand, on the CPU and in painting order: the brush, and what it paints."""
        if self.strokes is None:
            return ()
        return (*((plan.layers[0].brush, plan.strokes) for plan in self.below), (self.brush, self.strokes.to("cpu")))


def optimize(
    strokes: Strokes,
    scene: Scene,
    *,
    iterations: int,
    paints: Paints | None = None,
    vary_colors: bool = True,
    light_to_dark: bool = True,
    pace: float = 1.0,
    notify: Callable[[Step], None] = lambda step: None,
) -> tuple[Strokes, Paints | None]:
    """The strokes (in painting order) and paints that do better on the scene's objective.

    With `paints` every colour is one of the palette's, throughout; `vary_colors` says whether the
    palette (or, without one, each stroke's colour) may change. `pace` scales the steps. The best
    strokes seen are returned, never worse than those given: by the objective or, where the scene has
    one, by its validation objective, asked every ten iterations. A step that is not finite is
    discarded, and steps are halved from then on; the third raises PlanningDiverged, and so does a
    loss that was never finite.
    """
    if len(strokes) == 0:
        return strokes, paints
    variables = Variables(strokes, paints, vary_colors=vary_colors, light_to_dark=light_to_dark)
    adam = Adam(variables.leaves, _BETAS)
    best = _Best()
    failures = 0
    for iteration in range(iterations + 1):
        current = variables.strokes(variables.order())
        loss = scene.cost(current)
        value = loss.item()
        if scene.validation is None:
            best.consider(value, variables)
        elif iteration % _BETWEEN_VALIDATIONS == 0 or iteration == iterations:
            with torch.no_grad():
                best.consider(scene.cost(current, scene.validation).item(), variables)
        if iteration == iterations:
            break
        adam.forget_gradients()
        torch.autograd.backward(loss)
        if not math.isfinite(value) or not _finite(variables.leaves):
            failures += 1
            if failures == _MOST_FAILURES or best.shape is None:
                raise PlanningDiverged(
                    f"The loss or its slope was not finite in iteration {iteration}, for the {failures}. time "
                    f"(the loss was {value:g}); try another seed (--seed), or another picture."
                )
            best.restore(variables)
            adam = Adam(variables.leaves, _BETAS)
            continue
        adam.step(pace * 0.5**failures * _rhythm(iteration, iterations))
        with torch.no_grad():
            variables.set_(variables.strokes().project(scene.limits, scene.size))
        notify(Step(iteration + 1, iterations, value, current.detach()))
    best.restore(variables)
    order = variables.order()
    found = variables.paints()
    if found is not None:
        found = replace(found, paint=found.paint[order])
    return variables.strokes().detach()[order], found


def _rhythm(iteration: int, iterations: int) -> float:
    """Steps grow over the first iterations and then shrink along a half cosine to a tenth.

    Adam's first steps have the same size however small the slope is: taken in full, they would
    throw a settled plan back.
    """
    warm = min(1.0, (iteration + 1) / _WARMING)
    return warm * (0.1 + 0.45 * (1 + math.cos(math.pi * iteration / iterations)))


def _finite(leaves: list[Tensor]) -> bool:
    return all(leaf.grad is not None and bool(torch.isfinite(leaf.grad).all()) for leaf in leaves)


class _Best:
    """The best variables seen, kept to be returned whatever happens later."""

    def __init__(self) -> None:
        self.loss = math.inf
        self.shape: Tensor | None = None
        self.color: Tensor | None = None

    def consider(self, loss: float, variables: Variables) -> None:
        if loss < self.loss:
            self.loss = loss
            self.shape = variables.shape.detach().clone()
            self.color = variables.color.detach().clone()

    def restore(self, variables: Variables) -> None:
        if self.shape is None or self.color is None:
            return
        with torch.no_grad():
            variables.shape.copy_(self.shape)
            variables.color.copy_(self.color)
