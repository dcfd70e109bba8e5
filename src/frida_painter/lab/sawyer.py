"""Experiment: the effect of an arm's own errors on a painting.

One plan is painted by the simulated Sawyer, and by an arm with the same timing but without errors. This kinematic
arm stands at the Sawyer's table, and its tip is always exactly at the Sawyer's intended position. The two differ
only in the tracking error. A third arm, displaced at random for each stroke by the same amount, tests if that
explains the difference. The brush's own randomness, and the studio's default arm with a steady and with its usual
hand, give the scale.

The split of the brush's hairs is drawn again for every motion, equally for all arms. Otherwise a slightly longer
stroke would draw one more random number, and change all strokes after it.
"""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from frida_painter.canvas_size import CanvasSize
from frida_painter.lab import paintings
from frida_painter.lab.paintings import EXACT, connect_studio, execute
from frida_painter.lab.targets import Target
from frida_painter.lab.trials import Notify, Outcome, Progress, ResultTable, Row, mse, psnr, silent
from frida_painter.palette import to_lab
from frida_painter.plan import Plan
from frida_painter.report.sheets import Cell, FigureRow, page
from frida_painter.runs.run import PaintingRun
from frida_painter.runs.spec import RunSpec
from frida_painter.sawyer.arm import KINEMATIC_SAWYER, SAWYER
from frida_painter.virtual.robot import Course
from frida_painter.virtual.studio import FREE, StudioSettings, open_studio
from frida_painter.virtual.tabletop import HandNoise
from frida_painter.virtual.tabletop import Table as StudioTable

NAME = "sawyer"
KINEMATIC, DYNAMIC, DISPLACED, LUCKY = "kinematic", "Sawyer", "kinematic, displaced", "kinematic, other luck"
STEADY, USUAL = "studio, steady hand", "studio, usual hand"
_PLANNING = 0.25  # share of the time
_PIXEL = 0.0004  # metres of the canvas, the side of one of its cells
_CLEAR = 3.0  # change of lightness per pixel above which there is an edge of paint
_TELLING = 5.0  # distance in Lab that is visible side by side
_AMPLIFIED = 2
_MM = 1000.0


FULL = RunSpec.of(strokes=200, layers=1, colors=12, replans=0)
QUICK = RunSpec.of(strokes=2, colors=1, render_height=64, effort=0.05, replans=0, canvas="120x90mm")


@dataclass(frozen=True)
class Execution:
    """Executed plan.

    canvas: [3, H, W], true colours
    seconds: of the robot's clock
    spent: seconds of one core
    """

    canvas: Tensor
    seconds: float
    spent: float


@dataclass
class Tracking:
    """Watcher of an arm: records the distance between tip and intended position while it paints, metres.

    table, size: for the test if the brush touches the canvas
    press: from the lightest to the hardest touch, metres
    luck: seed of the brush's randomness for every motion
    """

    table: StudioTable
    size: CanvasSize
    press: float
    luck: int
    motions: int = 0
    off: list[NDArray[np.float64]] = field(default_factory=list)  # [k, 3] of every motion

    def open(self) -> None:
        """Does nothing."""

    def watch(self, course: Course) -> None:
        """Records the errors of a motion, and sets the brush's randomness for the next one."""
        self.motions += 1
        self.table.tuft.draw_luck_from(np.random.default_rng((self.luck, self.motions)))
        if course.meant is not None:
            place = self.table.on_canvas(course.places)
            inside = (place[:, :2] >= 0) & (place[:, :2] <= np.array([self.size.width, self.size.height]) * _MM)
            self.off.append((course.places - course.meant)[inside.all(1) & (place[:, 2] > 0)])

    def close(self) -> None:
        """Does nothing."""

    def row(self) -> Row:
        """Returns the errors in millimetres: in the canvas's plane, and in depth."""
        off = np.concatenate(self.off) * _MM
        plane, depth = np.hypot(off[:, 0], off[:, 1]), np.abs(off[:, 2])
        return {
            "moments": len(off),
            "in the plane, mean": float(plane.mean()),
            "95 %": float(np.quantile(plane, 0.95)),
            "worst": float(plane.max()),
            "in depth, mean": float(depth.mean()),
            "in depth, worst": float(depth.max()),
        }

    def noise(self) -> HandNoise:
        """Returns a hand with random errors of the same size for each stroke."""
        off = np.concatenate(self.off)
        return HandNoise(float(np.sqrt((off[:, :2] ** 2).mean())), float(off[:, 2].std()) / self.press)


def run(target: Target, *, seed: int = 0, scale: RunSpec = FULL, notify: Notify = silent) -> Outcome:
    """Plans the target once, and paints it with every arm. Raises RobotError if MuJoCo is not installed."""
    with PaintingRun(paintings.like(scale, target.picture, [{"image": str(target.path)}], seed)) as planning:
        plan = planning.plan(lambda step: notify(Progress(_PLANNING * step.iteration / step.of, "planning")))
    notify(Progress(_PLANNING, f"painting: {DYNAMIC}"))
    sawyer, tracking = _paint_plan(plan, StudioSettings(arm=SAWYER), seed, seed)
    others = {
        KINEMATIC: (StudioSettings(arm=KINEMATIC_SAWYER), seed),
        DISPLACED: (StudioSettings(arm=KINEMATIC_SAWYER, noise=tracking.noise()), seed),
        LUCKY: (StudioSettings(arm=KINEMATIC_SAWYER), seed + 1),
        STEADY: (StudioSettings(arm=FREE, noise=HandNoise(0.0, 0.0)), seed),
        USUAL: (StudioSettings(arm=FREE), seed),
    }
    found = {DYNAMIC: sawyer}
    for number, (name, (settings, luck)) in enumerate(others.items(), 1):
        notify(Progress(_PLANNING + (1 - _PLANNING) * number / (len(others) + 1), f"painting: {name}"))
        found[name], _ = _paint_plan(plan, settings, seed, luck)
    errors = tracking.row()
    pairs = ((DYNAMIC, KINEMATIC), (DISPLACED, KINEMATIC), (LUCKY, KINEMATIC), (STEADY, KINEMATIC), (USUAL, STEADY))
    apart = [_apart(found[one], one, found[other], other) for one, other in pairs]
    return Outcome(
        NAME,
        "The simulated Sawyer beside the same plan executed kinematically",
        {"target": target.name, "seed": seed, **paintings.settings(scale), "robot": "calibrated perfectly"},
        (
            ResultTable("Tracking error of the Sawyer's tip while it paints, mm", (errors,)),
            ResultTable("How far two executions of the plan are apart", tuple(apart)),
            ResultTable("How long they took", tuple(_took(name, execution) for name, execution in found.items())),
        ),
        _notes(errors, apart, found[DYNAMIC]),
        {NAME: _sheet(found, apart)},
    )  # fmt: skip


def edges_apart(first: Tensor, second: Tensor) -> NDArray[np.float64]:
    """Returns the distance between edges of paint in two similar pictures sRGB [3, H, W], at each edge of the first.

    Pixels [k]: the change of lightness divided by its slope, the first term of Taylor's series (Lucas and Kanade
    1981, for motion perpendicular to an edge).
    """
    light, other = (cv2.GaussianBlur(_lightness(picture), (0, 0), 1.0) for picture in (first, second))
    slope = np.hypot(cv2.Sobel(light, -1, 1, 0, scale=1 / 8), cv2.Sobel(light, -1, 0, 1, scale=1 / 8))
    edge = slope > _CLEAR
    return np.asarray(np.abs(other - light)[edge] / slope[edge], np.float64)


def _lightness(picture: Tensor) -> NDArray[np.float32]:
    return np.ascontiguousarray(to_lab(picture.permute(1, 2, 0))[..., 0].numpy(), np.float32)


def _paint_plan(plan: Plan, settings: StudioSettings, seed: int, luck: int) -> tuple[Execution, Tracking]:
    """Paints the plan on an exactly placed canvas; returns the result and the watcher."""
    studio = connect_studio(
        open_studio(plan.canvas, plan.layers[0].brush, seed=seed, settings=settings, placement_error=EXACT)
    )
    watcher = studio.robot.watcher = Tracking(studio.table, plan.canvas, studio.brush.press_depth / _MM, luck)
    rows = round(plan.canvas.height / _PIXEL)
    began = time.process_time()
    execute(plan, studio.easel, rows)
    return Execution(studio.truth(rows), studio.clock.now, time.process_time() - began), watcher


def _apart(first: Execution, one: str, second: Execution, other: str) -> Row:
    colors = to_lab(first.canvas.permute(1, 2, 0)) - to_lab(second.canvas.permute(1, 2, 0))
    distance, edges = colors.norm(dim=-1), edges_apart(second.canvas, first.canvas) * _PIXEL * _MM
    return {
        "painted by": one,
        "beside": other,
        "MSE": mse(first.canvas, second.canvas),
        "PSNR, dB": psnr(first.canvas, second.canvas),
        "distance in Lab, mean": float(distance.mean()),
        f"share above {_TELLING:g}": float((distance > _TELLING).double().mean()),
        "edges of paint apart, median, mm": float(np.median(edges)) if len(edges) else 0.0,
        "90 %, mm": float(np.quantile(edges, 0.9)) if len(edges) else 0.0,
    }


def _took(name: str, execution: Execution) -> Row:
    return {
        "painted by": name,
        "robot's seconds": execution.seconds,
        "seconds of one core, paint included": execution.spent,
        "times real time": execution.seconds / execution.spent,
    }


def _notes(errors: Row, apart: Sequence[Row], sawyer: Execution) -> tuple[str, ...]:
    by = {row["painted by"]: row for row in apart}
    mse = {name: float(row["MSE"] or 0) for name, row in by.items()}
    arm = max(mse[DYNAMIC], 1e-12)
    return (
        f"While it paints, the Sawyer's tip is {errors['in the plane, mean']:.3f} mm off in the canvas's plane on the "
        f"mean, {errors['worst']:.3f} mm at worst; it paints {sawyer.seconds / sawyer.spent:.1f} times as fast as the "
        "clock, arm and paint on one core.",
        f"Its painting differs from the kinematic one by an MSE of {mse[DYNAMIC]:.2g}; edges of paint lie "
        f"{by[DYNAMIC]['edges of paint apart, median, mm']:.3f} mm apart (median). An arm without errors of its own "
        f"that is displaced by as much at random, from stroke to stroke, differs by {mse[DISPLACED]:.2g}; the Sawyer's "
        f"difference is {arm / max(mse[DISPLACED], 1e-12):.1f} times that.",
        f"Against that, the brush's own luck makes {mse[LUCKY] / arm:.1f} times the difference, the usual noise of the "
        f"virtual studio's hand {mse[USUAL] / arm:.1f} times, and an arm that always has its full speed at another "
        f"table {mse[STEADY] / arm:.1f} times.",
    )


def _sheet(found: Mapping[str, Execution], apart: Sequence[Row]) -> Tensor:
    """Returns a sheet with all paintings, and below each its difference from the one it is compared with."""
    painted = [Cell(found[KINEMATIC].canvas, KINEMATIC)]
    strange: list[Cell | None] = [None]
    for row in apart:
        one, other = str(row["painted by"]), str(row["beside"])
        painted.append(Cell(found[one].canvas, one))
        far = (found[one].canvas - found[other].canvas).abs().mean(0, keepdim=True).expand(3, -1, -1)
        strange.append(Cell((1 - _AMPLIFIED * far).clamp(min=0), f"MSE {row['MSE']:.2g} to {other}"))
    lines = [FigureRow("painted", painted), FigureRow(f"difference,\n{_AMPLIFIED} times", strange)]
    return page("One plan, painted by different arms", (), lines, width=280)
