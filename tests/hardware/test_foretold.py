"""Strokes on simulated controllers: the time that was foretold, and strokes that are where they belong."""

from collections.abc import Callable

import numpy as np
import pytest
import torch

from frida_painter.brush.kinds import FINE
from frida_painter.canvas_size import CanvasSize
from frida_painter.hardware.gcode import Servo
from frida_painter.hardware.robot import Waypoints
from frida_painter.session.choreography import BrushLoad, Choreography, reckon
from frida_painter.session.rehearsal import FlatbedWorkspace
from frida_painter.strokes.palette import Palette
from frida_painter.strokes.plan import Plan
from machines import grbl, marlin
from machines.bench import SerialBench, grbl_bench, marlin_bench
from machines.simulated_time import SimulatedTime
from support.plans import made_up_strokes

CANVAS = CanvasSize(0.12, 0.09)
HIGH = Servo((-0.01, 10), (0.11, 150))
MACHINES: dict[str, Callable[[SimulatedTime], SerialBench]] = {
    "GRBL as it comes": lambda clock: grbl_bench(clock, grbl.GRBL),
    "GRBL set up": lambda clock: grbl_bench(clock, grbl.GRBL, grbl.QUICK),
    "GRBL, servo": lambda clock: grbl_bench(clock, grbl.GRBL, {**grbl.QUICK, "32": 0}, HIGH),
    "Marlin": lambda clock: marlin_bench(clock, marlin.PLAIN),
    "Marlin, servo": lambda clock: marlin_bench(clock, marlin.SERVO, HIGH),
}


def a_plan(count: int, seed: int = 0) -> Plan:
    strokes = made_up_strokes(count, seed, CANVAS).project(FINE.limits, CANVAS)
    palette = Palette.sort_light_to_dark(torch.rand(3, 3, generator=torch.Generator().manual_seed(seed)))
    return Plan.of(strokes, palette, torch.arange(count) * 3 // count, canvas=CANVAS, brush="fine", limits=FINE.limits)


def paint_as_foretold(clock: SimulatedTime, bench: SerialBench, name: str, count: int) -> None:
    """Paints a plan and holds its time against what was foretold, and every stroke against its waypoints."""
    robot = bench.ready()
    plan, motion = a_plan(count), FlatbedWorkspace().motion(CANVAS)
    choreography = Choreography.of(motion, plan.brushes)
    table = reckon(plan, choreography, BrushLoad(), timing=robot.timing())
    blind = reckon(plan, choreography, BrushLoad())
    x, y, _ = motion.workspace.rag
    robot.follow(Waypoints("home", np.array([[x, y, max(0.1, motion.travel_height)]]), 0.1))
    began, missed = clock.now, 0.0
    for action in choreography.actions(plan, BrushLoad(), 0, count):
        for each in action.motions:
            bench.controller.forget_way()  # each motion is judged alone: all of them are half a million places
            reached = robot.follow(each).reached
            missed = max(missed, float(np.abs(reached - each.position[-1]).max()))
            if each.label.startswith("stroke"):
                way, axes = bench.moved(), slice(0, 3 if bench.servo is None else 2)
                off = (np.linalg.norm((way - place)[:, axes], axis=1).min() for place in each.position)
                missed = max(missed, *map(float, off))
    took = clock.now - began
    off = 100 * (table.total / took - 1)
    print(
        f"{name}, {count} strokes: took {took:.0f} s, foretold {table.total:.0f} s ({off:+.1f} %), at full speed "
        f"{blind.total:.0f} s; missed {1e6 * missed:.0f} um"
    )
    assert table.total == pytest.approx(took, rel=0.05)
    assert missed <= bench.exact + 1e-5


@pytest.mark.parametrize("name", MACHINES)
def test_the_time_of_a_plan_was_foretold_within_5_percent(simulated_time: SimulatedTime, name: str) -> None:
    paint_as_foretold(simulated_time, MACHINES[name](simulated_time), name, 8)
