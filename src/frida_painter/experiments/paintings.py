"""Experiments about paintings: a trial is a RunSpec, which is planned and painted, and a judge measures the painting.

Every painting is planned on a bare canvas and painted in the virtual studio through PaintingRun. A scale is a RunSpec
as well: everything that all paintings of an experiment share.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Self

from torch import Tensor

from frida_painter import images, storage
from frida_painter.experiments.imperfections import Imperfection, StudioWithout
from frida_painter.experiments.outcome import Notify, Outcome, Progress, Value
from frida_painter.experiments.trials import Experiment, ExperimentTrial, Labels, Measurement, Results
from frida_painter.objectives.encoders.registry import EncoderRegistry
from frida_painter.plan import Plan
from frida_painter.runs.goal_item import GoalItem
from frida_painter.runs.run import PaintingRun
from frida_painter.runs.spec import RunSpec
from frida_painter.session.events import Event, Looked, Planned, StrokePainted, TimelapseFrame

FULL = RunSpec.of(strokes=100, layers=1, colors=12, effort=0.3, replans=0)
QUICK = RunSpec.of(strokes=6, colors=3, render_height=64, effort=0.05, replans=0)
"""Of experiments with goals that networks judge."""
_PLANNING = 0.7  # share of the time that a painting takes

Tell = Callable[[float], None]
"""Hears the share, in [0, 1], of a part of the work that is done."""
MakePlan = Callable[[PaintingRun, Tell], tuple[Plan, Tensor]]
"""Makes the plan of a run, and the picture [3, rows, columns] that it is thought to make."""


@dataclass(frozen=True, kw_only=True)
class PaintingTrial(ExperimentTrial):
    """One painting. make_plan: what plans it, by default the planner of its run; without: what its studio lacks."""

    spec: RunSpec
    make_plan: MakePlan
    without: tuple[Imperfection, ...] = ()

    @classmethod
    def of(
        cls,
        labels: Labels,
        spec: RunSpec,
        make_plan: MakePlan | None = None,
        without: tuple[Imperfection, ...] = (),
    ) -> Self:
        """The trial of a painting, which depends on its spec and on the content of the files that are its goal."""
        files = {part: [_content(item) for item in getattr(spec, part)] for part in ("goal", "initial")}
        depends_on = {"spec": spec.record(), **files, "without": [one.name for one in without]}
        return cls(labels=labels, depends_on=depends_on, spec=spec, make_plan=make_plan or planned, without=without)


@dataclass(frozen=True)
class Painted:
    """A painting.

    run: that made it; plan: the first one; planned: that plan as a picture, photograph: of the canvas in the end, and
    truth: the canvas as it is, which no camera sees, all [3, rows, columns] of the planning image; seconds: of the CPU,
    for planning; expected: by strokes painted, whenever the canvas was seen: the picture of the canvas with the rest of
    the plan on it.
    """

    run: PaintingRun
    plan: Plan
    planned: Tensor
    photograph: Tensor
    truth: Tensor
    seconds: float
    expected: Mapping[int, Tensor] = field(default_factory=dict)


Judge = Callable[[PaintingTrial, Painted], Measurement]


def like(scale: RunSpec, picture: Tensor, goal: Sequence[Any], seed: int, **changes: Any) -> RunSpec:
    """The painting of a goal at that scale, on a canvas that lies as the picture [3, H, W] does.

    goal: as in a TOML file, such as {"image": "photo.jpg"}; changes: other fields of the spec.
    """
    canvas = scale.canvas.turned_like(*picture.shape[1:])
    return scale.changed(**{"goal": goal, "seed": seed, "canvas": canvas, "fit": "crop", "film": False, **changes})


def settings(scale: RunSpec) -> dict[str, Value]:
    """What all paintings of an experiment share, as its outcome names it."""
    return {
        "brush": ", ".join(scale.brush_names),
        "canvas": str(scale.canvas),
        "strokes": scale.strokes,
        "colors": scale.colors,
        "rows": scale.render_height,
        "effort": scale.effort,
        "looks": scale.replans,
        "robot": "off by about 2 mm and 0.4 degrees as drawn from the seed",
    }


def experiment(
    trials: Sequence[PaintingTrial],
    judge: Judge,
    report: Callable[[Results], Outcome],
    encoders: EncoderRegistry | None = None,
) -> Experiment[PaintingTrial]:
    """The experiment that paints all trials. encoders: the networks that goals are seen through."""

    def measure(trial: PaintingTrial, notify: Notify) -> Measurement:
        measured = judge(trial, paint(trial, notify, encoders))
        notify(Progress(1.0, f"{_words(trial)}: measured"))
        return measured

    return Experiment(trials, measure, report)


def paint(trial: PaintingTrial, notify: Notify, encoders: EncoderRegistry | None = None) -> Painted:
    """Plans and paints a trial. Raises WeightsError where a network is missing."""
    expected: dict[int, Tensor] = {}
    doing = _words(trial)

    def planning(share: float) -> None:
        notify(Progress(_PLANNING * share, f"{doing}: planning"))

    def hear(event: Event) -> None:
        match event:
            case StrokePainted(done, of):
                notify(Progress(_PLANNING + (0.99 - _PLANNING) * done / of, f"{doing}: painting"))
            case Planned(done=done, expected=picture):
                expected[done] = picture
            case TimelapseFrame(photograph=photograph, done=done, of=of) if done < of:
                expected[done] = run.planner.expected(plan.part(slice(done, None)), photograph)
            case Looked(photograph=photograph, done=done) if done == len(plan):
                expected[done] = images.fit(photograph, *picture_of_plan.shape[1:])
            case _:
                pass

    with PaintingRun(trial.spec, listeners=[hear], encoders=encoders) as run:
        began = time.process_time()
        plan, picture_of_plan = trial.make_plan(run, planning)
        seconds = time.process_time() - began
        studio = StudioWithout(trial.without)
        photograph = run.simulate(plan, studio.open).photograph
    rows, columns = picture_of_plan.shape[1:]
    truth = images.fit(studio.truth(rows), rows, columns)
    return Painted(run, plan, picture_of_plan, images.fit(photograph, rows, columns), truth, seconds, expected)


def planned(run: PaintingRun, tell: Tell) -> tuple[Plan, Tensor]:
    """The plan that the run's own planner makes, and its picture."""
    plan = run.plan(lambda step: tell(step.iteration / step.of))
    return plan, run.planner.expected(plan, run.planner.bare)


def _content(item: GoalItem) -> list[str | float]:
    """A goal as what it really is: words, or the content of a file."""
    content = item.value if item.path is None else storage.sha256(item.path, "a picture of the goal")
    return [item.kind, content, item.weight]


def _words(trial: PaintingTrial) -> str:
    """What is being painted."""
    return ", ".join(f"seed {value}" if label == "seed" else str(value) for label, value in trial.labels.items())
