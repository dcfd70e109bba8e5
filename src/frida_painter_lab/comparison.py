"""Experiments that paint the same in several ways, and compare the paintings by several measures.

All experiments of paintings but one are such rows: scenes, ways to paint them, and measures of a painting.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Any, ClassVar

import numpy as np
from torch import Tensor

from frida_painter import images
from frida_painter.report.sheets import Cell, FigureRow, page
from frida_painter_lab.experiment import Measurement, Results, ResultTable, Row
from frida_painter_lab.paintings import Imperfection, Painted, PaintingExperiment, StudioRun
from frida_painter_lab.runs import Value
from frida_painter_lab.targets import Target

Goal = Sequence[Mapping[str, Any]]
"""Goal in the form of a goal file, such as [{"image": "photo.jpg"}]."""


def image(target: Target, weight: float = 1.0) -> Mapping[str, Any]:
    """Returns the part of a goal that paints a picture by its pixels."""
    return {"image": str(target.path)} | ({} if weight == 1 else {"weight": weight})


@dataclass(frozen=True)
class PaintingWay:
    """Way to paint a scene.

    name: in tables
    than: name of the way that it is compared with; "" for none
    goal, initial: of a scene's pictures; by default its first picture, and nothing to begin with
    canvas: number of the picture that decides the orientation of the canvas
    changes: other fields of the RunSpec
    without: imperfections that the studio lacks
    """

    name: str
    than: str = ""
    goal: Callable[..., Goal] = lambda target, *others: [image(target)]
    initial: Callable[..., Goal] = lambda *targets: []
    canvas: int = 0
    changes: Mapping[str, Any] = field(default_factory=dict)
    without: tuple[Imperfection, ...] = ()


Scene = tuple[Target, ...]
"""Pictures of what is painted: a photograph or a drawing, and perhaps a style."""


@dataclass(frozen=True, kw_only=True)
class Comparison(PaintingExperiment):
    """Experiment that paints every scene in every way, once per seed.

    LABELS: of the pictures of a scene
    MEASURES: names of the measures; True if more is better, False if less is; None if it is only told
    SHOWN: pictures of each painting on the sheet
    COLUMNS: of the sheet, if a scene takes several lines
    """

    LABELS: ClassVar[Sequence[str]] = ("target",)
    MEASURES: ClassVar[Mapping[str, bool | None]]
    SHOWN: ClassVar[Sequence[str]] = ("painting",)
    COLUMNS: ClassVar[int] = 0

    def scenes(self) -> Sequence[Scene]:
        """Returns the scenes."""
        raise NotImplementedError

    def ways(self) -> Sequence[PaintingWay]:
        """Returns the ways."""
        raise NotImplementedError

    def figures(self, painted: Painted, picture: Tensor, *scene: Target) -> Mapping[str, float]:
        """Returns the measures of a painting by their names.

        picture: photograph of the painting [3, H, W]
        """
        raise NotImplementedError

    def runs(self) -> Sequence[StudioRun]:
        """Returns a painting for each scene, seed and way."""
        found = []
        for scene, seed, way in product(self.scenes(), self.seeds, self.ways()):
            labels = {**self.name_scene(scene), "seed": seed, "painted": way.name}
            changes = {"initial": way.initial(*scene), **way.changes}
            found.append(self.of(labels, scene[way.canvas].picture, way.goal(*scene), way.without, **changes))
        return found

    def name_scene(self, scene: Scene) -> dict[str, str | int]:
        """Returns the labels of a scene."""
        return {label: target.name for label, target in zip(self.LABELS, scene, strict=True)}

    def scene_of(self, run: StudioRun) -> Scene:
        """Returns what a run paints."""
        return next(one for one in self.scenes() if self.name_scene(one).items() <= run.labels.items())

    def judge(self, run: StudioRun, painted: Painted) -> Measurement:
        """Measures a painting."""
        figures = self.figures(painted, painted.photograph, *self.scene_of(run))
        shown = {"simulated": painted.planned, "painting": painted.photograph, "canvas": painted.truth}
        return Measurement(figures, {name: shown[name] for name in self.SHOWN})

    def settings(self) -> Mapping[str, Value | Sequence[Value]]:
        """Returns the scenes and the common settings."""
        named = [self.name_scene(scene) for scene in self.scenes()]
        return {**{label: [*dict.fromkeys(one[label] for one in named)] for label in self.LABELS}, **super().settings()}

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
        """Returns a sheet of the first seed: a line for each scene, or several."""
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
            columns = self.COLUMNS or len(cells)
            lines += [FigureRow("", cells[first : first + columns]) for first in range(0, len(cells), columns)]
        return {self.NAME: page("", (), lines, width=260)}
