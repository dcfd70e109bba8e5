import torch

from frida_painter.planning.effort import DRAWING, Effort
from frida_painter.planning.layers import StepCount
from frida_painter.planning.optimize import Step
from frida_painter.planning.refine import bind_to_palette
from support.planning import problem, some_strokes


def test_strokes_are_in_paints_light_to_dark_and_every_step_is_told() -> None:
    steps: list[Step] = []
    begin = StepCount(steps.append, len(DRAWING) * 3 + 4).begin
    found, paints = bind_to_palette(some_strokes(16), problem(32), 4, Effort(drawing=3, binding=4), 0, begin)
    assert torch.equal(found.color, paints.color[paints.paint]) and len(paints.color) <= 4
    assert len(found) == 16 and [step.iteration for step in steps] == list(range(1, 17)) and steps[-1].of == 16
