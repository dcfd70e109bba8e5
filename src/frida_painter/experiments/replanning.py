"""A painting with and without looking: how far it strays from its first plan, and from its target.

After every batch of strokes the canvas is photographed, and the picture that is to be expected is
computed: the photograph with what is left of the plan on top. Its difference to the first plan is
the deviation (paper, Fig. "deviation from the initial plan"), its difference to the target the
error. With looking, what is left is planned again on each photograph; without, it stays as it was.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from torch import Tensor

from frida_painter import images
from frida_painter.brush.kinds import brush_kind
from frida_painter.brush.table_cache import cached_table
from frida_painter.brush.weights import load_stroke_model
from frida_painter.experiments.execution import open_easel
from frida_painter.experiments.outcome import Notify, Outcome, Progress, ResultTable, Row, each, silent
from frida_painter.experiments.scale import CANVAS, ROBOT_ERROR, PlanningScale
from frida_painter.experiments.targets import Target
from frida_painter.frames import CanvasSize
from frida_painter.goal import Goal
from frida_painter.objectives.kinds.image import ImageTerm
from frida_painter.plan import Plan
from frida_painter.planning.optimize import Step
from frida_painter.planning.placement import Placement
from frida_painter.planning.planner import Effort, Planner
from frida_painter.report.chart import Series, chart
from frida_painter.report.figure_sheet import Cell, FigureRow, page
from frida_painter.session.brushwork import Brushwork
from frida_painter.session.canvas_observer import CanvasObserver
from frida_painter.session.events import Event, Looked, Planned, PlanningStep, StrokePainted
from frida_painter.session.loop import PaintingSession
from frida_painter.session.replan_policy import EvenlySpaced

NAME = "replanning"
LOOKING, BLIND = "with replanning", "without looking"
_PLANNING = 0.35  # share of the time that the first plan takes


FULL = PlanningScale(strokes=150, colors=12, rows=256, effort=1.0, looks=10)
QUICK = PlanningScale(strokes=9, colors=3, rows=64, effort=0.05, looks=3, quick=True)


def run(
    target: Target,
    *,
    brush: str = "broad",
    canvas: CanvasSize = CANVAS,
    seeds: Sequence[int] = (0, 1, 2),
    scale: PlanningScale = FULL,
    notify: Notify = silent,
) -> Outcome:
    """Paints the target twice per seed, from the same first plan on the same easel.

    canvas: turned as the target asks for. The robot stands as far off as the seed says.
    """
    size = canvas.turned_like(*target.picture.shape[1:])
    model = cached_table(load_stroke_model(brush))
    tasks = [(seed, way) for seed in seeds for way in (LOOKING, BLIND)]
    courses: dict[tuple[int, str], _Course] = {}
    for (seed, way), telling in each(tasks, notify):
        goal = Goal((ImageTerm(target.picture),))
        kind = Planner if way == LOOKING else _Blind
        planner = kind(goal, size, model, rows=scale.rows, effort=Effort().scaled(scale.effort), seed=seed)
        courses[seed, way] = _paint(planner, seed, scale, f"seed {seed}, {way}", telling)
    rows: list[Row] = [
        {"seed": seed, "painted": way, "strokes": point.done, "deviation": point.deviation, "error": point.error}
        for (seed, way), course in courses.items()
        for point in course.points
    ]
    ends = {way: [courses[seed, way].points[-1] for seed in seeds] for way in (LOOKING, BLIND)}
    summary: list[Row] = [
        {
            "painted": way,
            "deviation at the end": _mean(point.deviation for point in points),
            "error of the first plan": _mean(courses[seed, way].points[0].error for seed in seeds),
            "error at the end": _mean(point.error for point in points),
        }
        for way, points in ends.items()
    ]
    return Outcome(
        NAME,
        f"{target.name.capitalize()}, painted with and without looking",
        {
            "target": target.name, "seeds": tuple(seeds), "brush": brush, "canvas": str(size),
            **scale.settings(), "looks": scale.looks, "robot": ROBOT_ERROR,
        },
        (ResultTable("At the end, mean over the seeds", tuple(summary)), ResultTable("After every look", tuple(rows))),
        (_note(ends, seeds),),
        {
            "deviation": _curve("Deviation from the first plan", "deviation", courses, seeds),
            "error": _curve("Error of the picture to be expected", "error", courses, seeds),
            "paintings": _sheet(target, courses, seeds[0], planner),
        },
    )  # fmt: skip


@dataclass(frozen=True)
class _Point:
    """After `done` strokes: mean squared differences of the expected picture to the first plan and to the target."""

    done: int
    deviation: float
    error: float


@dataclass(frozen=True)
class _Course:
    """How one painting went: its points, the picture [3, H, W] first planned, and the last photograph."""

    points: tuple[_Point, ...]
    first_plan: Tensor
    painting: Tensor


class _Blind(Planner):
    """A planner that does not heed what it sees: the first plan stays, and strokes are sent where they were."""

    def replan(self, rest: Plan, canvas: Tensor, notify: Callable[[Step], None] | None = None, rounds: int = 1) -> Plan:
        """The plan as it was."""
        return rest

    def locate(self, painted: Plan, known: Placement, before: Tensor, seen: Tensor) -> Placement:
        """What was known before."""
        return known


def _paint(planner: Planner, seed: int, scale: PlanningScale, words: str, notify: Notify) -> _Course:
    easel = open_easel(planner.size, planner.model.brush, seed)
    expected: dict[int, Tensor] = {}
    fit = planner.fine

    def hear(event: Event) -> None:
        match event:
            case PlanningStep("plan", iteration, of):
                notify(Progress(_PLANNING * iteration / of, f"{words}: planning"))
            case Planned(done=done, expected=picture):
                expected[done] = picture
            case Looked(photograph=photograph, done=done) if done == scale.strokes:
                expected[done] = images.fit(photograph, fit.rows, fit.columns)
            case StrokePainted(done, of):
                notify(Progress(_PLANNING + (1 - _PLANNING) * done / of, f"{words}: painting"))
            case _:
                pass

    session = PaintingSession(
        planner,
        Brushwork(easel, brush_kind(planner.model.brush)),
        CanvasObserver(easel, ground=(1.0, 1.0, 1.0)),
        EvenlySpaced(scale.looks - 1),
        stop_asked=lambda: False,
        notify=hear,
    )
    painting = session.run(scale.strokes, scale.colors)
    first = expected[0]
    points = tuple(
        _Point(done, float((picture - first).square().mean()), planner.validation_loss(picture))
        for done, picture in sorted(expected.items())
    )
    return _Course(points, first, images.fit(painting.photograph, fit.rows, fit.columns))


def _note(ends: dict[str, list[_Point]], seeds: Sequence[int]) -> str:
    looking, blind = (np.array([point.error for point in ends[way]]) for way in (LOOKING, BLIND))
    better = int((looking < blind).sum())
    return (
        f"At the end the painting {LOOKING} is nearer to the target for {better} of {len(seeds)} seeds: mean squared "
        f"error {looking.mean():.4f} against {blind.mean():.4f} {BLIND}, {blind.mean() / looking.mean():.2f} times."
    )


def _curve(title: str, what: str, courses: dict[tuple[int, str], _Course], seeds: Sequence[int]) -> Tensor:
    """The mean over the seeds, and from the least to the most of them as a band."""
    lines = []
    for way in (BLIND, LOOKING):
        values = np.array([[getattr(point, what) for point in courses[seed, way].points] for seed in seeds])
        done = [float(point.done) for point in courses[seeds[0], way].points]
        lines.append(
            Series(way, done, values.mean(0).tolist(), values.min(0).tolist(), values.max(0).tolist(), band=True)
        )
    to = "the first plan" if what == "deviation" else "the target"
    return chart(title, "strokes painted", f"mean squared difference to {to}; band: all seeds", lines)


def _sheet(target: Target, courses: dict[tuple[int, str], _Course], seed: int, planner: Planner) -> Tensor:
    grid = planner.fine
    blind, looking = courses[seed, BLIND], courses[seed, LOOKING]
    cells = [
        Cell(images.fit(target.picture, grid.rows, grid.columns)),
        Cell(looking.first_plan, f"error {looking.points[0].error:.4f}"),
        Cell(blind.painting, f"error {blind.points[-1].error:.4f}"),
        Cell(looking.painting, f"error {looking.points[-1].error:.4f}"),
    ]
    headings = ("target", "first plan", f"painted {BLIND}", f"painted {LOOKING}")
    return page("", headings, [FigureRow("", cells)], width=340)


def _mean(values: Iterable[float]) -> float:
    return float(np.mean(list(values)))
