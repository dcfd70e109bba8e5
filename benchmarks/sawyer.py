"""How exactly and how fast the simulated Sawyer follows a painting: python benchmarks/sawyer.py [--plan FILE]

Paints every stroke of a plan (without one, 200 drawn at random from the brush's limits) with dips
between them, and prints the tip's tracking error in the canvas's plane while the brush touches, how many
seconds of the arm's own time pass in one second of one core, inverse kinematics included, and how long planning a
stroke's motion takes, checked against the workspace.
"""

import threading
import time
from pathlib import Path

import numpy as np
import torch

from frida_painter.brush.kinds import brush_kind
from frida_painter.canvas_size import CanvasSize
from frida_painter.hardware import gateway
from frida_painter.hardware.motion import Motion
from frida_painter.plan import Plan
from frida_painter.sawyer.arm import SAWYER, SawyerArm
from frida_painter.strokes import Strokes
from frida_painter.virtual.bristles import find_brush
from frida_painter.virtual.robot import Way
from frida_painter.virtual.studio import StudioSettings, open_studio
from frida_painter.virtual.tabletop import sawyer_layout
from measure import Table, arguments, publish

_STROKES, _PER_DIP = 200, 4


def random_strokes(brush: str, canvas: CanvasSize, count: int) -> Strokes:
    """Strokes all over the canvas, drawn evenly from what the brush paints well."""
    limits = brush_kind(brush).limits
    draw = np.random.default_rng(0).uniform
    shortest, longest = limits.length
    return Strokes(
        position=torch.tensor(draw((0.03, 0.03), (canvas.width - 0.03, canvas.height - 0.03), (count, 2))).float(),
        angle=torch.tensor(draw(-np.pi, np.pi, count)).float(),
        length=torch.tensor(draw(shortest, longest, count)).float(),
        bend=torch.tensor(draw(*limits.bend, count)).float(),
        thickness=torch.tensor(draw(0, 1, count)).float(),
        color=torch.zeros(count, 3),
    )


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--plan", type=Path, help="a plan.json, or the folder of a painting")
    options = parser.parse_args()
    torch.set_num_threads(1)
    if options.plan:
        plan = Plan.load(options.plan)
        strokes, canvas, brush = plan.strokes, plan.canvas, plan.layers[0].brush
    else:
        canvas, brush = CanvasSize(14 * 0.0254, 11 * 0.0254), "broad"
        strokes = random_strokes(brush, canvas, 4 if options.quick else _STROKES)
    layout = sawyer_layout(canvas, find_brush(brush))
    calibration = open_studio(canvas, brush, settings=StudioSettings(arm=SAWYER)).easel.calibration
    motion, surface = Motion(layout.workspace, calibration), gateway.Surface(canvas, calibration.press_height)
    arm, tip, stopped = SawyerArm(layout.workspace, canvas, seed=0), np.array(layout.home), threading.Event()
    arm.connect(tip)
    plane, depth, planning, seconds, spent = [], [], [], 0.0, 0.0
    for index in range(len(strokes)):
        begun = time.process_time()
        ways = [motion.stroke(strokes, index)]
        gateway.check(ways, layout.workspace, surface)
        planning.append(1000 * (time.process_time() - begun))
        if index % _PER_DIP == 0:
            ways.insert(0, motion.dip(index // _PER_DIP % 12))
        for waypoints in ways:
            path = np.concatenate([tip[None], waypoints.position])
            begun = time.process_time()
            course = arm.move(Way(waypoints.label, path, waypoints.speed, layout.workspace.travel_speed), stopped, 0.0)
            spent += time.process_time() - begun
            seconds, tip = seconds + course.seconds, course.places[-1]
            assert course.meant is not None
            touching = course.places[:, 2] <= calibration.touch_height
            if waypoints.label.startswith("stroke"):
                off = (course.places - course.meant)[touching] * 1000
                plane.append(np.hypot(off[:, 0], off[:, 1]))
                depth.append(np.abs(off[:, 2]))
    across, down = np.concatenate(plane), np.concatenate(depth)
    table = Table(
        f"{len(strokes)} strokes of the {brush} brush on {canvas}, with dips, one thread",
        ("", "measured", "at most", "aim"),
        [
            ("tracking error in the canvas's plane, mean", f"{across.mean():.3f} mm", "0.3 mm", ""),
            ("the same, worst", f"{across.max():.3f} mm", "1.5 mm", ""),
            ("tracking error in depth, mean", f"{down.mean():.3f} mm", "", ""),
            ("the same, worst", f"{down.max():.3f} mm", "", ""),
            ("seconds of the arm in a second of CPU", f"{seconds / spent:.1f}", "at least 5", "8"),
            ("planning a stroke's motion, median", f"{np.median(planning):.2f} ms", "10 ms", ""),
            ("the same, worst", f"{max(planning):.2f} ms", "10 ms", ""),
        ],
        [f"{seconds:.0f} s of the arm took {spent:.1f} CPU seconds."],
    )
    figures = {"plane": float(across.mean()), "worst": float(across.max()), "times real time": seconds / spent}
    figures["planning in ms"] = max(planning)
    publish([table], figures, options)


if __name__ == "__main__":
    main()
