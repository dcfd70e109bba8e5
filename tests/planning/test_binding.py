from collections.abc import Callable

import torch

from frida_painter.planning.layers import StepCount
from frida_painter.planning.optimize import Step
from frida_painter.planning.refine import bind_to_palette, binding_iterations
from frida_painter.planning.variables import Paints
from frida_painter.strokes import Strokes
from support.planning import problem, some_strokes

PROBLEM = problem(32)


def in_paints(steps: list[Step]) -> tuple[Strokes, Paints]:
    count = StepCount(steps.append, binding_iterations(3, 4))

    def begin(iterations: int) -> Callable[[Step], None]:
        return count.begin(iterations, "fine")

    return bind_to_palette(some_strokes(16), PROBLEM, 4, drawing=3, binding=4, seed=0, begin=begin)


def test_strokes_are_in_paints_light_to_dark_and_every_step_is_told() -> None:
    steps: list[Step] = []
    found, paints = in_paints(steps)
    assert torch.equal(found.color, paints.color[paints.paint]) and len(paints.color) <= 4
    assert len(found) == 16 and [step.iteration for step in steps] == list(range(1, 17)) and steps[-1].of == 16
