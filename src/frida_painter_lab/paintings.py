"""Experiments that paint the same in several ways, and compare the paintings by several measures.

Such an experiment is a row: scenes, ways to paint them, and measures of a painting. Every run is planned on a bare
canvas and painted in the virtual studio by PaintingRun. The common settings of all paintings are a RunSpec too.
"""

import time
from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import product
from typing import Any, ClassVar, Self

import numpy as np
from torch import Tensor

from frida_painter.easel.kinds import OpenEasel
from frida_painter.easel.order import EaselOrder
from frida_painter.easel.virtual_easel import assemble_easel
from frida_painter.hardware.faults import PlacementError
from frida_painter.objectives.encoders.loading import EncoderRegistry
from frida_painter.report.sheets import Cell, FigureRow, page
from frida_painter.runs.run import PaintingRun
from frida_painter.runs.spec import RunSpec
from frida_painter.session.events import Event, Looked, Planned, StrokePainted, TimelapseFrame
from frida_painter.session.opening import planning_device
from frida_painter.strokes.plan import Plan
from frida_painter.system import images, storage
from frida_painter.virtual.studio import FREE, VirtualStudio
from frida_painter_lab.experiment import Experiment, Measurement, Notify, Progress, Results, ResultTable, Row
from frida_painter_lab.runs import Labels, Run, Value, goal_facts
from frida_painter_lab.targets import Target

KNOWN_PLACEMENT = {"placement_error": PlacementError((0.0, 0.0), 0.0)}
"""Furniture of a studio whose robot is perfectly calibrated."""
_PLANNING = 0.7  # share of the time of a painting
Tell = Callable[[float], None]
"""Hears the share, in [0, 1], of a part of the work that is done."""


class WatchedStudio:
    """Virtual studio with access to its true canvas. furniture: fields of StudioSettings that differ from the order"""

    def __init__(self, furniture: Mapping[str, Any] | None = None) -> None:
        self._furniture = furniture or {}
        self._studio: VirtualStudio | None = None

    def open(self, order: EaselOrder) -> OpenEasel:
        """Opens the ordered studio. Raises ConfigError if it has no such brush."""
        self._studio, easel = assemble_easel(order, FREE, **self._furniture)
        return OpenEasel(easel, self._studio.close)

    def truth(self, rows: int) -> Tensor:
        """Returns the true canvas, sRGB [3, rows, columns], from the front and in even light; not for the painter."""
        assert self._studio is not None, "open comes first"
        return self._studio.truth(rows)


@dataclass(frozen=True, kw_only=True)
class StudioRun(Run):
    """Run of one painting.

    spec: of the painting
    furniture: fields of StudioSettings that differ from the usual ones
    """

    spec: RunSpec
    furniture: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, labels: Labels, spec: RunSpec, furniture: Mapping[str, Any]) -> Self:
        """Returns the run of a painting, which depends on its spec and on the content of its goal's files.

        Raises StorageError if a file cannot be read.
        """
        files = goal_facts(spec, lambda path: storage.sha256(path, "a picture of the goal"))
        facts = {name: repr(value) for name, value in furniture.items()}
        return cls(labels, {"spec": spec.record(), **files, "studio": facts}, spec=spec, furniture=furniture)


@dataclass(frozen=True)
class Painted:
    """Painting of a run. Pictures are [3, rows, columns] of the planning image.

    run: that made it
    plan: the first plan
    planned: picture of that plan
    photograph: of the finished canvas
    truth: true canvas, which no camera sees
    seconds: of the CPU, for planning
    expected: expected picture (the canvas with the remaining plan) whenever the canvas was seen, by number of
        strokes
    """

    run: PaintingRun
    plan: Plan
    planned: Tensor
    photograph: Tensor
    truth: Tensor
    seconds: float
    expected: Mapping[int, Tensor] = field(default_factory=dict)


Goal = Sequence[Mapping[str, str | float]]
"""Goal as in a goal file, as a template: {0.path} is the file of the first picture, {0.words} its name in words."""


@dataclass(frozen=True)
class PaintingWay:
    """Way to paint a scene.

    name: in tables
    than: name of the way that it is compared with; "" for none
    goal, initial: of a scene's pictures; by default its first picture, and nothing to begin with
    canvas: number of the picture that decides the orientation of the canvas
    changes: other fields of the RunSpec
    furniture: fields of StudioSettings that differ from the usual ones, such as `KNOWN_PLACEMENT`
    """

    name: str
    than: str = ""
    goal: Goal = ({"image": "{0.path}"},)
    initial: Goal = ()
    canvas: int = 0
    changes: Mapping[str, Any] = field(default_factory=dict)
    furniture: Mapping[str, Any] = field(default_factory=dict)


Scene = tuple[Target, ...]
"""Pictures of what is painted: a photograph or a drawing, and perhaps a style."""


@dataclass(frozen=True, kw_only=True)
class Comparison(Experiment):
    """Experiment that paints every scene in every way, once per seed.

    FULL, QUICK: common settings of all paintings
    PICTURES: fields with the pictures of a scene
    LABELS: of these pictures
    WAYS: ways to paint a scene
    MEASURES: names of the measures; True if more is better, False if less is; None if it is only told
    SHOWN: pictures of each painting on the sheet
    """

    FULL: ClassVar[RunSpec] = RunSpec.of(strokes=100, layers=1, colors=12, effort=0.3, replans=0)
    QUICK: ClassVar[RunSpec] = RunSpec.of(strokes=6, colors=3, render_height=64, effort=0.05, replans=0)
    PICTURES: ClassVar[Sequence[str]] = ("photos",)
    LABELS: ClassVar[Sequence[str]] = ("target",)
    WAYS: ClassVar[Sequence[PaintingWay]]
    MEASURES: ClassVar[Mapping[str, bool | None]]
    SHOWN: ClassVar[Sequence[str]] = ("painting",)

    seeds: tuple[int, ...] = (0,)

    @cached_property
    def common(self) -> RunSpec:
        """Common settings of all paintings."""
        return (self.QUICK if self.quick else self.FULL).with_values(brush=self.brush)

    @cached_property
    def networks(self) -> EncoderRegistry:
        """Networks of the goals."""
        return EncoderRegistry(device=planning_device())

    def scenes(self) -> Sequence[Scene]:
        """Returns the scenes: all combinations of their pictures."""
        found = (getattr(self, name) for name in self.PICTURES)
        return list(product(*(several if isinstance(several, tuple) else (several,) for several in found)))

    def ways(self) -> Sequence[PaintingWay]:
        """Returns the ways."""
        return self.WAYS

    @abstractmethod
    def figures(self, painted: Painted, picture: Tensor, *scene: Target) -> Mapping[str, float]:
        """Returns the measures of a painting by their names.

        picture: photograph of the painting [3, H, W]
        """

    def runs(self) -> Sequence[StudioRun]:
        """Returns a painting for each scene, seed and way."""
        found = []
        for scene, seed, way in product(self.scenes(), self.seeds, self.ways()):
            labels = {**self.name_scene(scene), "seed": seed, "painted": way.name}
            canvas = self.common.canvas.orient_like(*scene[way.canvas].picture.shape[1:])
            goals = {
                part: [
                    {kind: value.format(*scene) if isinstance(value, str) else value for kind, value in item.items()}
                    for item in items
                ]
                for part, items in (("goal", way.goal), ("initial", way.initial))
            }
            usual = {**goals, "seed": seed, "canvas": canvas, "fit": "crop", "film": False}
            spec = self.common.with_values(**{**usual, **way.changes})
            found.append(StudioRun.of(labels, spec, way.furniture))
        return found

    def name_scene(self, scene: Scene) -> dict[str, str | int]:
        """Returns the labels of a scene."""
        return {label: target.name for label, target in zip(self.LABELS, scene, strict=True)}

    def scene_of(self, run: StudioRun) -> Scene:
        """Returns what a run paints."""
        return next(one for one in self.scenes() if self.name_scene(one).items() <= run.labels.items())

    def settings(self) -> Mapping[str, Value | Sequence[Value]]:
        """Returns the scenes, the common settings of all paintings, and the seeds."""
        spec, named = self.common, [self.name_scene(scene) for scene in self.scenes()]
        return {
            **{label: [*dict.fromkeys(one[label] for one in named)] for label in self.LABELS},
            "seeds": self.seeds,
            "brush": ", ".join(spec.brush_names),
            "canvas": str(spec.canvas),
            "strokes": spec.strokes,
            "colors": spec.colors,
            "rows": spec.render_height,
            "effort": spec.effort,
            "looks": spec.replans,
            "robot": "off by about 2 mm and 0.4 degrees as drawn from the seed",
        }

    def measure(self, run: Run, notify: Notify) -> Measurement:
        """Paints and judges a run."""
        assert isinstance(run, StudioRun)
        painted = self.paint(run, notify)
        shown = {"simulated": painted.planned, "painting": painted.photograph, "canvas": painted.truth}
        figures = self.figures(painted, painted.photograph, *self.scene_of(run))
        notify(Progress(1.0, f"{run.words}: measured"))
        return Measurement(figures, {name: shown[name] for name in self.SHOWN})

    def make_plan(self, run: StudioRun, opened: PaintingRun, tell: Tell) -> tuple[Plan, Tensor]:
        """Returns the first plan of a run, and its simulated picture [3, rows, columns]."""
        return make_first_plan(opened, tell)

    def paint(self, run: StudioRun, notify: Notify) -> Painted:
        """Plans and paints a run. Raises WeightsError if a network is missing."""
        expected: dict[int, Tensor] = {}

        def hear(event: Event) -> None:
            match event:
                case StrokePainted(done, of):
                    notify(Progress(_PLANNING + (0.99 - _PLANNING) * done / of, f"{run.words}: painting"))
                case Planned(done=done, expected=picture):
                    expected[done] = picture
                case TimelapseFrame(photograph=shown, done=done, of=of) if done < of:
                    expected[done] = opened.planner.expected(plan.part(slice(done, None)), images.from_uint8(shown))
                case Looked(photograph=photograph, done=done) if done == len(plan):
                    expected[done] = images.fit(photograph, *planned.shape[1:])
                case _:
                    pass

        studio = WatchedStudio(run.furniture)
        with PaintingRun(run.spec, listeners=[hear], encoders=self.networks) as opened:
            began = time.process_time()
            plan, planned = self.make_plan(
                run, opened, lambda share: notify(Progress(_PLANNING * share, f"{run.words}: planning"))
            )
            seconds = time.process_time() - began
            photograph = opened.simulate(plan, studio.open).photograph
        rows, columns = planned.shape[1:]
        photograph, truth = (images.fit(one, rows, columns) for one in (photograph, studio.truth(rows)))
        return Painted(opened, plan, planned, photograph, truth, seconds, expected)

    def tables(self, results: Results) -> Sequence[ResultTable]:
        """Returns the means of each way, the differences between ways, and all paintings."""
        differences = [
            self.compare(results, way, name, more=more)
            for way in self.ways()
            if way.than
            for name, more in self.MEASURES.items()
            if more is not None
        ]
        return [
            ResultTable("Means over all paintings", results.means("painted")),
            ResultTable("Differences between ways, painting by painting", differences),
            ResultTable("All paintings", results.rows()),
        ]

    def compare(self, results: Results, way: PaintingWay, name: str, *, more: bool) -> Row:
        """Returns the comparison of a way with another one by a measure."""
        mine, its = (np.array(results.values(name, painted=one)) for one in (way.name, way.than))
        better = (mine > its if more else mine < its).sum()
        return {
            "painted": way.name,
            "than": way.than,
            "measure": name,
            "mean": float(mine.mean()),
            "mean of the other": float(its.mean()),
            "difference": float((mine - its).mean()),
            "better in": f"{better} of {len(mine)}",
        }

    def pictures(self, results: Results) -> Mapping[str, Tensor]:
        """Returns a sheet of the first seed: a line for each scene."""
        lines = []
        main = next(iter(self.MEASURES))
        for scene in self.scenes():
            cells = [Cell(one.picture, one.name) for one in scene]
            for way in self.ways():
                found = results.one(**self.name_scene(scene), seed=self.seeds[0], painted=way.name)
                *before, last = self.SHOWN
                cells += [Cell(found.pictures[name], name) for name in before]
                cells.append(Cell(found.pictures[last], f"{way.name}: {main} {found.numbers[main]:.3g}"))
            size = cells[-1].picture.shape[1:]
            cells = [Cell(images.fit(cell.picture, *size), cell.caption) for cell in cells]
            lines.append(FigureRow("", cells))
        return {self.NAME: page("", (), lines, width=260)}


def make_first_plan(run: PaintingRun, tell: Tell) -> tuple[Plan, Tensor]:
    """Returns the plan of the run's own planner, and its picture."""
    plan = run.plan(lambda step: tell(step.iteration / step.of))
    return plan, run.planner.expected(plan, run.planner.bare)
