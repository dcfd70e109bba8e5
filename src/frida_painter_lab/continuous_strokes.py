"""Experiment: sweeps of thickness, length and bend from one extreme to the other (paper, Fig. "continuous strokes").

The upper row shows the learned stroke model. The lower row shows the same strokes as painted by the robot of the
virtual studio.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from frida_painter.brush.kinds import BrushKind, brush_kind
from frida_painter.brush.weights import load_stroke_model
from frida_painter.canvas_size import CanvasSize
from frida_painter.frames import PixelGrid
from frida_painter.render import render
from frida_painter.report.sheets import Cell, FigureRow, page
from frida_painter.strokes.palette import Palette
from frida_painter.strokes.plan import Plan
from frida_painter.strokes.strokes import StrokeLimits, Strokes
from frida_painter.virtual.studio import open_studio
from frida_painter_lab.experiment import Experiment, Measurement, Notify, Progress, Results, ResultTable, Row
from frida_painter_lab.paintings import EXACT, execute
from frida_painter_lab.runs import Run, Value

PARAMETERS = {"thickness": ("", 1.0), "length": (" mm", 1000.0), "bend": (" mm", 1000.0)}
"""Unit and factor of each parameter for people."""
_INK = 0.04
_ACROSS = 3  # strokes side by side on a paper


@dataclass(frozen=True, kw_only=True)
class ContinuousStrokes(Experiment):
    """Experiment `continuous-strokes`: a run for each parameter of a stroke."""

    NAME = "continuous-strokes"

    seed: int = 0

    @property
    def heading(self) -> str:
        """One line for people, with the brush."""
        return f"Strokes of the {self.brush} brush, from one extreme to the other"

    @property
    def steps(self) -> int:
        """Number of strokes in each sweep."""
        return 3 if self.quick else 9

    def runs(self) -> Sequence[Run]:
        """Returns a run for each parameter."""
        facts = {"brush": self.brush, "seed": self.seed, "quick": self.quick}
        return [Run({"swept": name}, facts) for name in PARAMETERS]

    def measure(self, run: Run, notify: Notify) -> Measurement:
        """Paints a sweep, and measures each stroke by the model and in reality; the pictures have them side by side."""
        notify(Progress(0.0, f"painting all values of {run['swept']}"))
        kind, model = brush_kind(self.brush), load_stroke_model(self.brush)
        asked = sweep(run["swept"], kind.limits, self.steps)
        paper = _Paper(kind, self.steps, 60 if self.quick else 240)
        plan = paper.plan(asked)
        seed = self.seed + list(PARAMETERS).index(run["swept"])
        studio = open_studio(plan.canvas, self.brush, seed=seed, placement_error=EXACT)
        studio.easel.robot.connect()
        studio.easel.camera.connect()
        photograph = execute(plan, studio.easel, paper.grid.rows)
        with torch.no_grad():
            drawn = render(plan.strokes, model, torch.ones(photograph.shape), plan.canvas)
        across, down = paper.grid.pitch
        numbers: dict[str, float] = {}
        shown: dict[str, list[Tensor]] = {"model": [], "robot": []}
        pairs = zip(paper.cut(drawn, self.steps), paper.cut(photograph, self.steps), strict=True)
        for number, pair in enumerate(pairs):
            marks = [((1 - picture.mean(0)) / (1 - _INK)).clamp(0, 1) for picture in pair]
            areas = [float(mark.sum()) * across * down * 1e6 for mark in marks]
            numbers |= {f"{name} {number}": float(getattr(asked, name)[number]) for name in PARAMETERS}
            numbers |= {f"area modelled {number}": areas[0], f"area painted {number}": areas[1]}
            numbers[f"difference {number}"] = float((marks[0] - marks[1]).abs().mean())
            for name, picture in zip(shown, pair, strict=True):
                shown[name].append(picture)
        return Measurement(numbers, {name: torch.cat(pictures, 2) for name, pictures in shown.items()})

    def settings(self) -> Mapping[str, Value | Sequence[Value]]:
        """Returns what was swept, and how finely."""
        return {"brush": self.brush, "seed": self.seed, "steps": self.steps}

    def tables(self, results: Results) -> Sequence[ResultTable]:
        """Returns a row for each pair of strokes."""
        rows: list[Row] = []
        for labels, one in results.found:
            for number in range(self.steps):
                shape = {
                    f"{name}{unit}": round(factor * one.numbers[f"{name} {number}"], 4)
                    for name, (unit, factor) in PARAMETERS.items()
                }
                rows.append({
                    **labels,
                    **shape,
                    "area modelled mm2": round(one.numbers[f"area modelled {number}"], 1),
                    "area painted mm2": round(one.numbers[f"area painted {number}"], 1),
                    "mean abs. difference": round(one.numbers[f"difference {number}"], 5),
                })  # fmt: skip
        return [ResultTable("Swept strokes: the model, and below it the robot", rows)]

    def pictures(self, results: Results) -> Mapping[str, Tensor]:
        """Returns all sweeps, the model's above the painted ones."""
        lines = []
        for labels, one in results.found:
            name = str(labels["swept"])
            unit, factor = PARAMETERS[name]
            values = [f"{factor * one.numbers[f'{name} {number}']:.3g}{unit}" for number in range(self.steps)]
            for label in one.pictures:
                parts = one.pictures[label].chunk(self.steps, 2)
                cells = [Cell(*each) for each in zip(parts, values, strict=True)]
                lines.append(FigureRow(f"{name}\n{label}", cells))
        return {self.NAME: page(self.heading, (), lines, width=150)}


def sweep(parameter: str, limits: StrokeLimits, steps: int) -> Strokes:
    """Returns `steps` strokes at the origin, in dark ink, that differ only in one parameter, over its whole range."""
    (shortest, longest), (least, most) = limits.length, limits.bend
    middling = {"thickness": 0.5, "length": shortest + 0.75 * (longest - shortest), "bend": 0.0}
    extremes = {"thickness": (0.0, 1.0), "length": (shortest, longest), "bend": (least, most)}
    if parameter == "thickness":
        middling["bend"] = most / 2
    values = {name: torch.full((steps,), value) for name, value in middling.items()}
    values[parameter] = torch.linspace(*extremes[parameter], steps)
    return Strokes(
        torch.zeros(steps, 2), torch.zeros(steps), values["length"], values["bend"], values["thickness"],
        torch.full((steps, 3), _INK),
    )  # fmt: skip


class _Paper:
    """Paper with a place for every stroke of a sweep."""

    def __init__(self, kind: BrushKind, strokes: int, rows: int) -> None:
        self.kind = kind
        frame = kind.frame
        # At least two rows, because no stroke may be longer than nine tenths of the paper's shorter side.
        self.down = max(2, -(-strokes // _ACROSS))
        size = CanvasSize(_ACROSS * (frame.right - frame.left), self.down * (frame.top - frame.bottom))
        self.grid = PixelGrid.of_height(size, self.down * rows)

    def plan(self, shapes: Strokes) -> Plan:
        """Returns the plan of the strokes, each in the middle of its place."""
        frame, size = self.kind.frame, self.grid.size
        place = torch.arange(len(shapes))
        x = (place % _ACROSS) * (frame.right - frame.left) - frame.left
        y = size.height - (place // _ACROSS) * (frame.top - frame.bottom) - frame.top
        return Plan.of(
            shapes.with_groups(position=torch.stack((x, y), 1).float()),
            Palette(torch.full((1, 3), _INK)),
            torch.zeros(len(shapes), dtype=torch.long),
            canvas=size,
            brush=self.kind.name,
            limits=self.kind.limits.within(size),
        )

    def cut(self, picture: Tensor, count: int) -> Iterator[Tensor]:
        """Yields the first `count` places of a picture of the paper."""
        rows, columns = picture.shape[1] // self.down, picture.shape[2] // _ACROSS
        for place in range(count):
            top, left = place // _ACROSS * rows, place % _ACROSS * columns
            yield picture[:, top : top + rows, left : left + columns]
