"""Experiment: sweeps of thickness, length and bend from one extreme to the other (paper, Fig. "continuous strokes").

The upper row shows the learned stroke model. The lower row shows the same strokes as painted by the robot of the
virtual studio or, for a stroke library, the most similar real strokes.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from frida_painter.brush.kinds import BrushKind, brush_kind
from frida_painter.brush.library import StrokeLibrary, resample
from frida_painter.brush.weights import load_stroke_model
from frida_painter.canvas_size import CanvasSize
from frida_painter.frames import PixelGrid
from frida_painter.lab import ExperimentScale
from frida_painter.lab.paintings import EXACT, connect_studio, execute
from frida_painter.lab.stroke_models import DEFAULT, learn_model
from frida_painter.lab.trials import Notify, Outcome, Progress, ResultTable, Row, silent
from frida_painter.palette import Palette
from frida_painter.plan import Plan
from frida_painter.render import render
from frida_painter.report.sheets import Cell, FigureRow, page
from frida_painter.strokes import StrokeLimits, Strokes
from frida_painter.virtual.studio import open_studio

NAME = "continuous-strokes"
PARAMETERS = ("thickness", "length", "bend")
_INK = 0.04
_ACROSS = 3  # strokes side by side on a paper


# Number of strokes in each sweep.
FULL = ExperimentScale(strokes=9)
QUICK = ExperimentScale(strokes=3, quick=True)


@dataclass(frozen=True)
class _Sweep:
    """Sweep of one parameter: requested strokes and the real ones below, with magnitudes [n, rows, columns] each.

    pixel: area of a pixel, square metres
    """

    asked: Strokes
    modelled: Tensor
    found: Strokes
    real: Tensor
    pixel: float


def run(
    *,
    library: Path | None = None,
    brush: str = "broad",
    seed: int = 0,
    scale: ExperimentScale = FULL,
    notify: Notify = silent,
) -> Outcome:
    """Sweeps the strokes of a brush of the project, and lets the virtual robot paint them.

    library: file of a stroke library to use instead (`run_on_library`)
    Raises ConfigError if there is no such brush, LibraryError if the file is no library of enough strokes.
    """
    if library is not None:
        strokes = StrokeLibrary.load(library)
        return run_on_library(strokes, library.stem, seed=seed, scale=scale, notify=notify)
    kind, model = brush_kind(brush), load_stroke_model(brush)

    def painted(parameter: str) -> _Sweep:
        notify(Progress(PARAMETERS.index(parameter) / len(PARAMETERS), f"painting all values of {parameter}"))
        asked = sweep(parameter, kind.limits, scale.strokes)
        paper = _Paper(kind, scale)
        plan = paper.plan(asked)
        studio = open_studio(plan.canvas, brush, seed=seed + PARAMETERS.index(parameter), placement_error=EXACT)
        photograph = execute(plan, connect_studio(studio).easel, paper.grid.rows)
        with torch.no_grad():
            drawn = render(plan.strokes, model, torch.ones(photograph.shape), plan.canvas)
        modelled, real = (torch.stack([*paper.cut(picture, len(asked))]) for picture in (drawn, photograph))
        across, down = paper.grid.pitch
        return _Sweep(asked, _magnitude(modelled), asked, _magnitude(real), across * down)

    title = f"Strokes of the {brush} brush, from one extreme to the other"
    return _outcome(
        title, "robot", {"brush": brush, "seed": seed, "steps": scale.strokes, "rows": _rows(scale)}, painted
    )


def run_on_library(
    library: StrokeLibrary, name: str, *, seed: int = 0, scale: ExperimentScale = FULL, notify: Notify = silent
) -> Outcome:
    """Learns from a library, sweeps between its extremes, and shows its nearest strokes.

    name: of the library

    Raises LibraryError if the library is too small to learn from.
    """
    notify(Progress(0.0, "learning"))
    model = learn_model(DEFAULT, library, seed=seed, quick=scale.quick)
    notify(Progress(1.0, "drawing"))

    @torch.no_grad()
    def nearest(parameter: str) -> _Sweep:
        asked = sweep(parameter, model.limits, scale.strokes)
        found, maps = _nearest(asked, library)
        modelled = resample(model(asked.thickness, asked.length, asked.bend), model.frame, library.frame)
        return _Sweep(asked, modelled, found, maps, library.metres_per_pixel**2)

    title = f"Strokes of {name}, from one extreme to the other"
    return _outcome(title, "nearest\nreal", {"library": name, "seed": seed, "steps": scale.strokes}, nearest)


def _outcome(title: str, below: str, settings: dict[str, str | int], find: Callable[[str], _Sweep]) -> Outcome:
    lines: list[FigureRow] = []
    rows: list[Row] = []
    for parameter in PARAMETERS:
        found = find(parameter)
        lines.append(FigureRow(f"{parameter}\nmodel", _cells(found.modelled, parameter, found.asked)))
        lines.append(FigureRow(below, _cells(found.real, parameter, found.found)))
        rows += [_row(parameter, found, index) for index in range(len(found.asked))]
    apart = [float(row["mean abs. difference"] or 0) for row in rows]
    note = (
        f"Over {len(rows)} strokes the upper and the lower ones differ by {sum(apart) / len(apart):.4f} in the mean "
        f"over the whole map, and by {max(apart):.4f} in the worst pair."
    )
    table = ResultTable(f"Swept strokes: the model, and below it: {below.replace(chr(10), ' ')}", tuple(rows))
    return Outcome(NAME, title, settings, (table,), (note,), {NAME: page(title, (), lines, width=150)})


def _cells(magnitude: Tensor, parameter: str, strokes: Strokes) -> list[Cell]:
    values = [_value(parameter, strokes, index) for index in range(len(strokes))]
    return [
        Cell((1 - (1 - _INK) * mark).clamp(0, 1).expand(3, -1, -1), value)
        for mark, value in zip(magnitude, values, strict=True)
    ]


def _magnitude(pictures: Tensor) -> Tensor:
    """Converts pictures [n, 3, rows, columns] of ink on white paper to magnitudes [n, rows, columns]."""
    return ((1 - pictures.mean(1)) / (1 - _INK)).clamp(0, 1)


def _nearest(asked: Strokes, library: StrokeLibrary) -> tuple[Strokes, Tensor]:
    """Returns the library's strokes that are nearest in all three parameters, and their marks [n, rows, columns]."""
    there = torch.stack(library.shapes(), 1)
    span = (there.amax(0) - there.amin(0)).clamp(min=1e-9)
    wanted = torch.stack((asked.thickness, asked.length, asked.bend), 1)
    chosen = torch.cdist(wanted / span, there / span).argmin(1)
    thickness, length, bend = there[chosen].unbind(1)
    maps = torch.from_numpy(library.magnitude[np.asarray(chosen)]).float() / 255
    return asked.with_groups(thickness=thickness, length=length, bend=bend), maps


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


def _rows(scale: ExperimentScale) -> int:
    """Returns the height of a painted stroke's picture, pixels."""
    return 60 if scale.quick else 240


class _Paper:
    """Paper with a place for every stroke of a sweep."""

    def __init__(self, kind: BrushKind, scale: ExperimentScale) -> None:
        self.kind = kind
        frame = kind.frame
        # At least two rows, because no stroke may be longer than nine tenths of the paper's shorter side.
        self.down = max(2, -(-scale.strokes // _ACROSS))
        size = CanvasSize(_ACROSS * (frame.right - frame.left), self.down * (frame.top - frame.bottom))
        self.grid = PixelGrid.of_height(size, self.down * _rows(scale))

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


def _value(parameter: str, strokes: Strokes, index: int) -> str:
    value = float(getattr(strokes, parameter)[index])
    return f"{value:.2f}" if parameter == "thickness" else f"{round(value * 1000, 1):g} mm"


def _row(parameter: str, found: _Sweep, index: int) -> Row:
    asked, model, real = found.asked, found.modelled[index], found.real[index]
    return {
        "swept": parameter,
        "thickness": round(float(asked.thickness[index]), 4),
        "length mm": round(float(asked.length[index]) * 1000, 2),
        "bend mm": round(float(asked.bend[index]) * 1000, 2),
        "area modelled mm2": round(float(model.sum()) * found.pixel * 1e6, 1),
        "area below mm2": round(float(real.sum()) * found.pixel * 1e6, 1),
        "mean abs. difference": round(float((model - real).abs().mean()), 5),
    }
