"""Speed and memory of the fast renderers against the full-canvas reference, forward and backward.

    python benchmarks/render.py [--json figures.json] [--case 256x400 ...] [--repeats 5] [--dense]

Speed is CPU time of one thread, the median of runs that are interleaved with the reference's.
Memory is how far the resident set of a fresh process rises above what it was before the call,
gradients included, the median of three processes. Both are of the whole call: picture, and
gradients to maps, affine maps, colours and canvas. Where the full reference would not fit into
memory it is measured on fewer strokes and scaled: it does the same work for every stroke. --dense
paints every cell of the maps, so that nothing is gained from empty cells around a mark.
"""

import argparse
import re
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import torch
from torch import Tensor

from frida_painter.canvas_size import CanvasSize
from frida_painter.frames import MapFrame, PixelGrid, pixel_to_map
from frida_painter.render import reference, scanline
from measure import Table, arguments, publish

CANVAS = CanvasSize(0.356, 0.279)
FRAME = MapFrame(-0.020, 0.090, -0.034, 0.034, 48, 80)  # about 100 x 62 pixels at 256 rows
CASES = ((256, 100), (256, 400), (512, 400), (512, 1000), (1024, 1000))
PATHS = {"reference": reference.composite, "scanline": scanline.composite}
REFERENCE_PIXELS = 10_000_000  # canvas pixels x strokes that the reference is timed on at most


@dataclass(frozen=True)
class Figures:
    """What was measured of one path in one case."""

    rows: int
    columns: int
    strokes: int
    path: str
    measured_strokes: int
    cpu_seconds: float
    extra_megabytes: float
    speedup: float = 1.0
    memory_ratio: float = 1.0


def pixel_grid(rows: int) -> PixelGrid:
    return PixelGrid(CANVAS, rows, rows * 325 // 256)


def workload(rows: int, strokes: int, *, dense: bool = False, seed: int = 0) -> list[Tensor]:
    """Random smooth marks of about 64 x 24 pixels at 256 rows, anywhere on the canvas, and a canvas."""
    generator = torch.Generator().manual_seed(seed)

    def random(*shape: int) -> Tensor:
        return torch.rand(shape, generator=generator)

    grid = pixel_grid(rows)
    cell = FRAME.cell_centers() * 1000  # mm, [48, 80, 2]
    along, aside = (cell[..., 0] - 35) / 35, cell[..., 1] / 13
    bump = (1.2 * (1 - along**4 - aside**4)).clamp(0, 1)  # about 70 x 26 mm, zero beyond
    coarse = random(strokes, 1, 6, 10)
    grain = torch.nn.functional.interpolate(coarse, bump.shape, mode="bicubic")[:, 0].clamp(0, 1)
    magnitude = (bump.clamp(min=0.05) if dense else bump) * (0.5 + 0.5 * grain)
    position = random(strokes, 2) * torch.tensor([CANVAS.width, CANVAS.height])
    angle = 2 * torch.pi * random(strokes)
    # The stroke's middle, not its start, is spread evenly over the canvas.
    position = position - 0.035 * torch.stack((angle.cos(), angle.sin()), -1)
    affine = pixel_to_map(position, angle, grid, FRAME)
    return [magnitude, affine, random(strokes, 3), random(3, grid.rows, grid.columns)]


def forward_backward(composite: Callable[..., Tensor], tensors: list[Tensor]) -> list[Tensor]:
    leaves = [tensor.detach().requires_grad_() for tensor in tensors]
    picture = composite(*leaves)
    picture.backward(2 * (picture.detach() - 0.5))
    return [picture.detach(), *(leaf.grad for leaf in leaves if leaf.grad is not None)]


def cpu_seconds(composite: Callable[..., Tensor], tensors: list[Tensor]) -> float:
    start = time.process_time()
    forward_backward(composite, tensors)
    return time.process_time() - start


def reference_strokes(rows: int, strokes: int) -> int:
    grid = pixel_grid(rows)
    return min(strokes, max(2, REFERENCE_PIXELS // (grid.rows * grid.columns)))


def resident(field: str) -> int:
    """VmRSS (now) or VmHWM (most so far) of this process, bytes."""
    found = re.search(rf"{field}:\s+(\d+) kB", Path("/proc/self/status").read_text())
    if found is None:
        raise SystemExit("Memory is measured through /proc, which this system does not have.")
    return int(found[1]) * 1024


def print_peak(path: str, rows: int, strokes: int, dense: bool) -> None:
    """Run in a fresh process: prints by how many bytes the call raises the resident set."""
    torch.set_num_threads(1)
    forward_backward(PATHS[path], workload(32, 2))  # loads kernels and libraries
    tensors = workload(rows, strokes, dense=dense)
    Path("/proc/self/clear_refs").write_text("5")  # sets VmHWM back to VmRSS
    before = resident("VmRSS")
    forward_backward(PATHS[path], tensors)
    print(resident("VmHWM") - before)


def peak_bytes(path: str, rows: int, strokes: int, dense: bool) -> float:
    command = [sys.executable, __file__, "--peak", path, str(rows), str(strokes), *(["--dense"] if dense else [])]
    runs = (subprocess.run(command, check=True, capture_output=True, text=True) for _ in range(3))
    return statistics.median(int(run.stdout) for run in runs)


def measure(rows: int, strokes: int, repeats: int, dense: bool) -> list[Figures]:
    fewer = reference_strokes(rows, strokes)
    tensors = workload(rows, strokes, dense=dense)
    few = [tensor[:fewer] for tensor in tensors[:3]] + tensors[3:]
    counts = {"reference": fewer, "scanline": strokes}
    times: dict[str, list[float]] = {path: [] for path in PATHS}
    for turn in range(repeats + 1):
        for path, composite in PATHS.items():
            seconds = cpu_seconds(composite, few if path == "reference" else tensors)
            if turn > 0:  # the first turn warms up
                times[path].append(seconds)
    figures = []
    for path, count in counts.items():
        scale = strokes / count
        seconds = statistics.median(times[path]) * scale
        megabytes = peak_bytes(path, rows, count, dense) * scale / 1e6
        _, height, width = tensors[3].shape
        first = figures[0] if figures else None
        figures.append(
            Figures(
                height,
                width,
                strokes,
                path,
                count,
                seconds,
                megabytes,
                first.cpu_seconds / seconds if first else 1.0,
                first.extra_megabytes / megabytes if first else 1.0,
            )
        )
    return figures


def table(all_figures: list[Figures], dense: bool) -> Table:
    rows = [
        (
            f"{one.rows} x {one.columns}", str(one.strokes), one.path,
            f"{one.cpu_seconds:.3f} s", f"{one.speedup:.0f}x",
            f"{one.extra_megabytes:.0f} MB", f"1/{one.memory_ratio:.0f}", str(one.measured_strokes),
        )
        for one in all_figures
    ]  # fmt: skip
    return Table(
        f"Rendering, forward and backward, one thread, float32{', dense maps' if dense else ''}",
        ("canvas", "strokes", "path", "CPU", "faster", "extra memory", "of the reference's", "strokes timed"),
        rows,
        ["The reference is timed on some of the strokes and scaled if all would not fit into memory."],
    )


def case(text: str) -> tuple[int, int]:
    found = re.fullmatch(r"(\d+)x(\d+)", text)
    if found is None:
        raise argparse.ArgumentTypeError(f"{text!r} is not understood; give rows x strokes, for example 256x400.")
    return int(found[1]), int(found[2])


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--case", type=case, nargs="+", default=CASES, help="rows x strokes, for example 256x400")
    parser.add_argument("--repeats", type=int, default=5, help="runs of which the median is taken")
    parser.add_argument("--dense", action="store_true", help="maps without empty cells")
    parser.add_argument("--peak", nargs=3, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.peak:
        path, rows, strokes = options.peak
        print_peak(path, int(rows), int(strokes), options.dense)
        return
    torch.set_num_threads(1)
    start = time.perf_counter()
    forward_backward(scanline.composite, workload(32, 2))
    first_call = time.perf_counter() - start
    cases = ((64, 20),) if options.quick else options.case
    figures = [one for rows, strokes in cases for one in measure(rows, strokes, options.repeats, options.dense)]
    shown = table(figures, options.dense)
    shown = replace(
        shown, notes=[*shown.notes, f"First scanline call {first_call:.1f} s (compiles if nothing is cached)."]
    )
    publish([shown], [asdict(one) for one in figures], options)


if __name__ == "__main__":
    main()
