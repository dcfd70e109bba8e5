"""A rehearsal: everything that painting a plan takes is asked for before anything moves, and all that fails is told."""

from collections.abc import Iterator
from dataclasses import dataclass

from frida_painter.calibration import Calibration
from frida_painter.frames import CanvasSize
from frida_painter.hardware import limits
from frida_painter.hardware.limits import Fault, Surface
from frida_painter.hardware.motion import Motion
from frida_painter.hardware.reach import Reach
from frida_painter.hardware.robot import Waypoints
from frida_painter.hardware.workspace import Workspace
from frida_painter.plan import Plan

_SAME = 0.001  # metres: canvases are cut by hand


@dataclass(frozen=True)
class Rehearsal:
    """What would be refused.

    mismatches: where the plan and the easel do not belong together, a sentence each; strokes: the
    faults of strokes by their index in the plan; others: of dips, rinses, wipes and changes of brushes.
    """

    mismatches: tuple[str, ...]
    strokes: dict[int, Fault]
    others: tuple[Fault, ...]

    @property
    def passed(self) -> bool:
        """Whether the plan can be painted there."""
        return not (self.mismatches or self.strokes or self.others)


def rehearse(
    plan: Plan, workspace: Workspace, canvas: CanvasSize, calibration: Calibration, reach: Reach | None = None
) -> Rehearsal:
    """Asks for every motion of a plan on an easel with a canvas of that size.

    reach: of the robot, where its arm does not get everywhere in its workspace. Raises CalibrationError where the plan
    has several brushes, and nothing is known of one of them.
    """
    strokes: dict[int, Fault] = {}
    before = 0
    for part in plan.filled_layers():
        known = calibration.of_brush(part.layers[0].brush) if len(plan.brushes) > 1 else calibration
        motion, surface = Motion(workspace, known), Surface(canvas, known.press_height)
        for index in range(len(part)):
            path = motion.stroke(part.strokes, index, f"stroke {before + index + 1}")
            for fault in limits.faults([path], workspace, surface, reach):
                strokes[before + index] = fault
        before += len(part)
    motion, surface = Motion(workspace, calibration), Surface(canvas, calibration.press_height)
    others = limits.faults(_around(plan, motion), workspace, surface, reach)
    return Rehearsal(tuple(_mismatches(plan, workspace, canvas)), strokes, tuple(others))


def _mismatches(plan: Plan, workspace: Workspace, canvas: CanvasSize) -> Iterator[str]:
    if max(abs(plan.canvas.width - canvas.width), abs(plan.canvas.height - canvas.height)) > _SAME:
        yield (
            f"the plan is for a canvas of {plan.canvas}, and the easel's is {canvas}; "
            "plan anew with --canvas, or put up the canvas of the plan and make the workspace true"
        )
    wells = max(end - first for first, end in (layer.paints for layer in plan.layers))
    if wells > len(workspace.wells):
        yield (
            f"the plan has {wells} paints, and the workspace {len(workspace.wells)} wells; "
            "plan anew with fewer --colors, or add wells"
        )
    if workspace.rack is not None:
        for name in plan.brushes:
            if name not in workspace.rack.places:
                yield (
                    f"the plan needs the {name} brush, and the rack holds {', '.join(workspace.rack.places)}; plan "
                    "anew with --brushes, or give it a place in the rack"
                )


def _around(plan: Plan, motion: Motion) -> Iterator[Waypoints]:
    """What is done beside the canvas; wells that are missing are told of on their own."""
    for paint in sorted(set(plan.well.tolist())):
        if paint < len(motion.workspace.wells):
            yield motion.dip(paint)
    yield motion.rinse()
    yield motion.wipe()
    rack = motion.workspace.rack
    for name in plan.brushes:
        if rack is not None and name in rack.places:
            yield from motion.change(name, name)
