from collections.abc import Callable
from dataclasses import replace

import torch
from torch import Tensor

from frida_painter.planning.binding import binding_iterations, bound
from frida_painter.planning.optimize import Step
from frida_painter.planning.scene import Scene
from frida_painter.planning.step_count import StepCount
from frida_painter.planning.variables import Paints
from frida_painter.strokes import Strokes
from scenes import scene, some_strokes

SCENE = scene(32)


def in_paints(ways: list[Scene], steps: list[Step] | None = None) -> tuple[Strokes, Paints]:
    hear = [] if steps is None else steps
    count = StepCount(hear.append, binding_iterations(3, 4, len(ways)))

    def begin(iterations: int) -> Callable[[Step], None]:
        return count.begin(iterations, "fine")

    return bound(some_strokes(16), ways, 4, drawing=3, binding=4, seed=0, begin=begin)


def loss(strokes: Strokes) -> float:
    with torch.no_grad():
        return float(SCENE.expected_loss(strokes))


def contrary(picture: Tensor, variance: Tensor | None = None) -> Tensor:
    """The objective that would have none of what is wanted."""
    return -SCENE.objective(picture)


def test_strokes_are_in_paints_light_to_dark_and_every_step_is_told() -> None:
    steps: list[Step] = []
    found, paints = in_paints([SCENE], steps)
    assert torch.equal(found.color, paints.color[paints.paint]) and len(paints.color) <= 4
    assert len(found) == 16 and [step.iteration for step in steps] == list(range(1, 17)) and steps[-1].of == 16


def test_of_several_ways_the_one_that_the_first_scene_validates_best_is_kept() -> None:
    alone, _ = in_paints([SCENE])
    worse = replace(SCENE, objective=contrary)
    wrong, _ = in_paints([worse])
    assert loss(alone) < loss(wrong)
    # Though the first way is the worse one, its validation says which is kept.
    kept, _ = in_paints([replace(worse, validation=SCENE.objective), SCENE])
    assert loss(kept) <= loss(alone) + 1e-6
    again, _ = in_paints([SCENE, worse])
    assert torch.equal(again.position, alone.position)
