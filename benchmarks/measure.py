"""What the benchmarks share: clocks, what was measured on, and tables for the terminal and for the docs."""

import argparse
import json
import os
import platform
import re
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np
import torch
from rich.console import Console
from rich.table import Table as TerminalTable
from torch import Tensor

import frida_painter
from frida_painter import images
from frida_painter.brush.table import StrokeTable, cached_table
from frida_painter.brush.weights import load_stroke_model
from frida_painter.canvas_size import CanvasSize
from frida_painter.frames import PixelGrid
from frida_painter.lab import targets
from frida_painter.objectives.image import ImageTerm
from frida_painter.objectives.interpretation import prepare
from frida_painter.objectives.objective import Goal
from frida_painter.planning.problem import PlanningProblem

CANVAS_HEIGHT = 0.2794
LIBRARIES = ("torch", "numpy", "numba", "opencv-python-headless")


@dataclass(frozen=True)
class Table:
    """Figures as they are shown: a title, columns, rows of text, and what has to be said about them."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    notes: Sequence[str] = ()

    def markdown(self) -> str:
        lines = [" | ".join(row) for row in (self.columns, ["---"] * len(self.columns), *self.rows)]
        return "\n".join(["**" + self.title + "**", "", *(f"| {line} |" for line in lines), "", *self.notes])


def cpu_seconds(work: Callable[[], object]) -> float:
    """CPU seconds that this process spends on the work, in all its threads."""
    start = time.process_time()
    work()
    return time.process_time() - start


def wall_seconds(work: Callable[[], object]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def hardware() -> str:
    """Processor, cores and memory of this machine, in one line."""
    names = re.findall(r"model name\s*:\s*(.+)", _read("/proc/cpuinfo"))
    memory = re.search(r"MemTotal:\s+(\d+) kB", _read("/proc/meminfo"))
    parts = [names[0] if names else platform.machine(), f"{os.cpu_count()} cores"]
    if memory:
        parts.append(f"{int(memory[1]) / 2**20:.0f} GB")
    return ", ".join(parts)


def versions() -> dict[str, str]:
    return {"python": platform.python_version(), **{name: version(name) for name in LIBRARIES}}


def loaded_sources() -> list[str]:
    """Files of the project's source that this process has loaded, from the package on."""
    package = Path(frida_painter.__file__).parent
    files = {Path(module.__file__) for module in list(sys.modules.values()) if getattr(module, "__file__", None)}
    return sorted(str(file.relative_to(package)) for file in files if file.is_relative_to(package))


def _read(path: str) -> str:
    return Path(path).read_text() if Path(path).exists() else ""


def arguments(description: str | None) -> argparse.ArgumentParser:
    """What every benchmark understands."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", type=Path, help="also write the tables and figures there")
    parser.add_argument("--quick", action="store_true", help="a tiny run that only shows that everything works")
    return parser


def publish(tables: Sequence[Table], figures: object, options: argparse.Namespace) -> None:
    """Shows the tables and what they were measured on, and writes them if that was asked for."""
    console = Console(width=130, highlight=False)
    for table in tables:
        shown = TerminalTable(*table.columns, title=table.title)
        for row in table.rows:
            shown.add_row(*row)
        console.print(shown, *table.notes, sep="\n")
    record = {"hardware": hardware(), "versions": versions(), "sources": loaded_sources()}
    console.print(record["hardware"], ", ".join(f"{name} {number}" for name, number in versions().items()), sep="; ")
    if options.json:
        content = {**record, "tables": [asdict(table) for table in tables], "figures": figures}
        options.json.write_text(json.dumps(content, indent=2))


def photograph(name: str) -> Tensor:
    """One of the laboratory's photographs as sRGB [3, H, W] in [0, 1]."""
    return images.load(Path(targets.__file__).with_name(f"{name}.jpg"))


def canvas_like(picture: Tensor) -> CanvasSize:
    """A canvas 11 inches high with the proportions of a picture."""
    return CanvasSize(CANVAS_HEIGHT * picture.shape[2] / picture.shape[1], CANVAS_HEIGHT)


def blank_problem(picture: Tensor, size: CanvasSize, rows: int, model: StrokeTable) -> tuple[PlanningProblem, Tensor]:
    """A bare white canvas of that many rows on which the picture is wanted, and the picture fitted to it."""
    grid = PixelGrid.of_height(size, rows)
    objective = prepare(Goal((ImageTerm(picture),)), grid)
    canvas = torch.ones(3, grid.rows, grid.columns)
    problem = PlanningProblem(canvas, size, model, objective, objective_on_rows=objective.on_rows)
    return problem, images.fit(picture, grid.rows, grid.columns)


def broad_brush() -> StrokeTable:
    """The stroke model of the shipped broad brush, as the planner uses it."""
    return cached_table(load_stroke_model("broad"))


def psnr(loss: float) -> float:
    """Peak signal to noise of a mean squared error, in dB."""
    return -10 * float(np.log10(loss))
