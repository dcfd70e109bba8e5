"""Experiments that paint the same in several ways, and compare the paintings by several measures.

Such an experiment is a row: pictures, ways to paint them, and measures of a painting. Every run is planned on a bare
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

    planned: picture of the first plan
    photograph: of the finished canvas
    truth: true canvas, which no camera sees
    seconds: of the CPU, for planning
    expected: expected picture (the canvas with the remaining plan) whenever the canvas was seen, by number of
        strokes
    """

    planned: Tensor
    photograph: Tensor
    truth: Tensor
    seconds: float
    expected: Mapping[int, Tensor] = field(default_factory=dict)


@dataclass(frozen=True)
class PaintingWay:
    """Way to paint a picture.

    name: in tables
    than: name of the way that it is compared with; "" for none
    kind: of the goal
    changes: other fields of the RunSpec
    furniture: fields of StudioSettings that differ from the usual ones, such as `KNOWN_PLACEMENT`
    """

    name: str
    than: str = ""
    kind: str = "image"
    changes: Mapping[str, Any] = field(default_factory=dict)
    furniture: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Comparison(Experiment):
    """Experiment that paints every picture in every way, once per seed.

    FULL, QUICK: common settings of all paintings
    LABEL: of a picture
    WAYS: ways to paint a picture
    MEASURES: names of the measures; True if more is better, False if less is; None if it is only told
    SHOWN: pictures of each painting on the sheet

    photos: what is painted
    """

    FULL: ClassVar[RunSpec] = RunSpec.of(strokes=100, layers=1, colors=12, effort=0.3, replans=0)
    QUICK: ClassVar[RunSpec] = RunSpec.of(strokes=6, colors=3, render_height=64, effort=0.05, replans=0)
    LABEL: ClassVar[str] = "target"
    WAYS: ClassVar[Sequence[PaintingWay]]
    MEASURES: ClassVar[Mapping[str, bool | None]]
    SHOWN: ClassVar[Sequence[str]] = ("painting",)

    photos: tuple[Target, ...]
    seeds: tuple[int, ...] = (0,)

    @cached_property
    def common(self) -> RunSpec:
        """Common settings of all paintings."""
        return (self.QUICK if self.quick else self.FULL).with_values(brush=self.brush)

    @cached_property
    def networks(self) -> EncoderRegistry:
        """Networks of the goals."""
        return EncoderRegistry(device=planning_device())

    def ways(self) -> Sequence[PaintingWay]:
        """Returns the ways."""
        return self.WAYS

    @abstractmethod
    def figures(self, painted: Painted, picture: Tensor, target: Target) -> Mapping[str, float]:
        """Returns the measures of a painting by their names.

        picture: photograph of the painting [3, H, W]
        """

    def runs(self) -> Sequence[StudioRun]:
        """Returns a painting for each picture, seed and way."""
        found = []
        for target, seed, way in product(self.photos, self.seeds, self.ways()):
            labels: Labels = {self.LABEL: target.name, "seed": seed, "painted": way.name}
            canvas = self.common.canvas.orient_like(*target.picture.shape[1:])
            goal = [{way.kind: str(target.path)}]
            usual = {"goal": goal, "seed": seed, "canvas": canvas, "fit": "crop", "film": False}
            spec = self.common.with_values(**{**usual, **way.changes})
            found.append(StudioRun.of(labels, spec, way.furniture))
        return found

    def target_of(self, run: StudioRun) -> Target:
        """Returns what a run paints."""
        return next(one for one in self.photos if one.name == run[self.LABEL])

    def settings(self) -> Mapping[str, Value | Sequence[Value]]:
        """Returns the pictures, the common settings of all paintings, and the seeds."""
        spec = self.common
        return {
            self.LABEL: [*dict.fromkeys(one.name for one in self.photos)],
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
        shown = {"simulated": painted.planned, "painting": painted.photograph}
        figures = self.figures(painted, painted.photograph, self.target_of(run))
        notify(Progress(1.0, f"{run.words}: measured"))
        return Measurement(figures, {name: shown[name] for name in self.SHOWN})

    def make_plan(self, run: StudioRun, opened: PaintingRun, tell: Tell) -> tuple[Plan, Tensor]:
        """Returns the first plan of a run, and its simulated picture [3, rows, columns]."""
        plan = opened.plan(lambda step: tell(step.iteration / step.of))
        return plan, opened.planner.expected(plan, opened.planner.bare)

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
        return Painted(planned, photograph, truth, seconds, expected)

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
        """Returns a sheet of the first seed: a line for each picture."""
        lines = []
        main = next(iter(self.MEASURES))
        for target in self.photos:
            cells = [Cell(target.picture, target.name)]
            for way in self.ways():
                found = results.one(**{self.LABEL: target.name}, seed=self.seeds[0], painted=way.name)
                *before, last = self.SHOWN
                cells += [Cell(found.pictures[name], name) for name in before]
                cells.append(Cell(found.pictures[last], f"{way.name}: {main} {found.numbers[main]:.3g}"))
            size = cells[-1].picture.shape[1:]
            cells = [Cell(images.fit(cell.picture, *size), cell.caption) for cell in cells]
            lines.append(FigureRow("", cells))
        return {self.NAME: page("", (), lines, width=260)}
