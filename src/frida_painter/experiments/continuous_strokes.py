"""Thickness, length and bend, each swept from one extreme to the other (paper, Fig. "continuous strokes").

Above, what the learned stroke model says; below, what the robot of the virtual studio paints when it
is asked for the same strokes.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import torch
from torch import Tensor

from frida_painter.brush.kinds import BrushKind, brush_kind
from frida_painter.brush.weights import load_stroke_model
from frida_painter.experiments.execution import EXACT, execute, open_easel
from frida_painter.experiments.outcome import Notify, Outcome, Progress, Row, Table, silent
from frida_painter.experiments.page import Cell, Line, page
from frida_painter.frames import CanvasSize, PixelGrid
from frida_painter.palette import Palette
from frida_painter.plan import Plan
from frida_painter.render import render
from frida_painter.strokes import StrokeLimits, Strokes

NAME = "continuous-strokes"
PARAMETERS = ("thickness", "length", "bend")
_INK = 0.04
_ACROSS = 3  # strokes beside one another on a paper


@dataclass(frozen=True)
class Scale:
    """steps: strokes in each sweep; rows: pixels of a stroke's picture from top to bottom."""

    steps: int
    rows: int


FULL = Scale(steps=9, rows=240)
QUICK = Scale(steps=3, rows=60)


def run(*, brush: str = "broad", seed: int = 0, scale: Scale = FULL, notify: Notify = silent) -> Outcome:
    """Sweeps the strokes of a brush that ships with the project. Raises ConfigError where there is no such brush."""
    kind, model = brush_kind(brush), load_stroke_model(brush)
    lines: list[Line] = []
    rows: list[Row] = []
    for number, parameter in enumerate(PARAMETERS):
        notify(Progress(number / len(PARAMETERS), f"painting strokes of all values of {parameter}"))
        shapes = sweep(parameter, kind.limits, scale.steps)
        paper = _Paper(kind, scale)
        plan = paper.plan(shapes)
        photograph = execute(plan, open_easel(plan.canvas, brush, seed + number, error=EXACT), paper.grid.rows)
        with torch.no_grad():
            drawn = render(plan.strokes, model, torch.ones(photograph.shape), plan.canvas)
        modelled, painted = ([*paper.cut(picture, len(shapes))] for picture in (drawn, photograph))
        captions = [_value(parameter, shapes, index) for index in range(len(shapes))]
        lines.append(Line(f"{parameter}\nmodel", [Cell(picture) for picture in modelled]))
        lines.append(Line("robot", [Cell(*each) for each in zip(painted, captions, strict=True)]))
        rows += [
            _row(parameter, shapes, index, ours, theirs, paper.pixel_area)
            for index, (ours, theirs) in enumerate(zip(modelled, painted, strict=True))
        ]
    apart = [float(row["mean abs. difference"] or 0) for row in rows]
    return Outcome(
        NAME,
        f"Continuous strokes of the {brush} brush",
        {"brush": brush, "seed": seed, "steps": scale.steps, "rows": scale.rows},
        (Table("Swept strokes, as modelled and as painted", tuple(rows)),),
        (
            f"Over {len(rows)} strokes the model and the robot differ by {sum(apart) / len(apart):.4f} in the mean "
            f"over the whole map, and by {max(apart):.4f} for the worst stroke.",
        ),
        {NAME: page(f"Strokes of the {brush} brush, from one extreme to the other", (), lines, width=150)},
    )


def sweep(parameter: str, limits: StrokeLimits, steps: int) -> Strokes:
    """`steps` strokes at the origin, in dark ink, that differ in one parameter only, from its least to its most."""
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
    """A paper with a place for every stroke of a sweep, and where the places are in its photograph."""

    def __init__(self, kind: BrushKind, scale: Scale) -> None:
        self.kind = kind
        frame = kind.frame
        # Two rows at least: no stroke may be longer than nine tenths of the paper's shorter side.
        self.down = max(2, -(-scale.steps // _ACROSS))
        size = CanvasSize(_ACROSS * (frame.right - frame.left), self.down * (frame.top - frame.bottom))
        self.grid = PixelGrid.of_height(size, self.down * scale.rows)

    @property
    def pixel_area(self) -> float:
        """In square millimetres."""
        across, down = self.grid.pitch
        return across * down * 1e6

    def plan(self, shapes: Strokes) -> Plan:
        """The strokes, each in the middle of its own place."""
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
        """The first `count` places of a picture of the paper."""
        rows, columns = picture.shape[1] // self.down, picture.shape[2] // _ACROSS
        for place in range(count):
            top, left = place // _ACROSS * rows, place % _ACROSS * columns
            yield picture[:, top : top + rows, left : left + columns]


def _value(parameter: str, shapes: Strokes, index: int) -> str:
    value = float(getattr(shapes, parameter)[index])
    return f"{value:.2f}" if parameter == "thickness" else f"{value * 1000:.0f} mm"


def _row(parameter: str, shapes: Strokes, index: int, modelled: Tensor, painted: Tensor, pixel_area: float) -> Row:
    model, robot = (((1 - picture.mean(0)) / (1 - _INK)).clamp(0, 1) for picture in (modelled, painted))
    return {
        "swept": parameter,
        "thickness": round(float(shapes.thickness[index]), 4),
        "length mm": round(float(shapes.length[index]) * 1000, 2),
        "bend mm": round(float(shapes.bend[index]) * 1000, 2),
        "area modelled mm2": round(float(model.sum()) * pixel_area, 1),
        "area painted mm2": round(float(robot.sum()) * pixel_area, 1),
        "mean abs. difference": round(float((model - robot).abs().mean()), 5),
    }
