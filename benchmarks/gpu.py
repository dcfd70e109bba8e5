"""The planner on a GPU: is it right, how fast is it, how often does the CPU wait for it, how much memory does it take?

Times are wall time, from an idle device to an idle device, after runs that compile and warm up. The planner is the one
that paintings are planned with. `BENCHMARK_DEVICE=cpu` shows with --quick that everything works.
"""

import os
import sys
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import torch
from torch import Tensor

import frida_painter as fp
from clocks import CANVAS, COLORS, Benchmark, blank_problem, broad_brush, in_paints, photograph
from frida_painter.errors import WeightsError
from frida_painter.frames import PixelGrid, pixel_to_map
from frida_painter.planning.initialize import uniform
from frida_painter.planning.optimize import optimize
from frida_painter.planning.problem import on_device
from frida_painter.render import composite_moments, reference
from frida_painter_lab.experiment import Measurement, Notify, Results, ResultTable, Row
from frida_painter_lab.runs import Run
from frida_painter_lab.targets import load_shipped_targets

NO_GPU = (
    "There is no CUDA device here: PyTorch {version} sees none. Run this on a machine with an NVIDIA GPU and the CUDA "
    "build of PyTorch (pip install torch), or try it on the CPU: BENCHMARK_DEVICE=cpu python benchmarks/report.py gpu "
    "--quick"
)
PARTS = ("mean", "variance", "to the maps", "to the places", "to the colours", "to the canvas")
MAX_DIFFERENCES = {"float32": (1e-5, 1e-5, 1e-3, 2.5e-2, 1e-3, 1e-3), "float64": (1e-9,) * 6}  # differences of each
AGREES, ITERATES, PLANS = "agreement", "iteration", "plan"
GOALS = ("photograph", "photograph, again", "style", "words")


@dataclass(frozen=True, kw_only=True)
class Gpu(Benchmark):
    """The renderer of the device beside the reference, iterations of the planner, and whole plans."""

    NAME = "gpu"
    TITLE = "On a GPU"
    ELSEWHERE = True
    TEXT = (
        "`make benchmarks-gpu` measures this on a machine with an NVIDIA GPU, and writes this section alone. First\n"
        "the renderer of the device is compared with the reference, picture and gradients. Then the planner is\n"
        "timed. A wait is a synchronisation, as PyTorch counts them (`set_sync_debug_mode`).\n"
        "[Renderer](lab/rendering.md#tiles) and [planner](lab/planning.md#on-a-gpu) explain how it works there."
    )

    @cached_property
    def device(self) -> torch.device:
        device = torch.device(os.environ.get("BENCHMARK_DEVICE", "cuda"))
        if device.type == "cuda" and not torch.cuda.is_available():
            sys.exit(NO_GPU.format(version=torch.__version__))
        return device

    def runs(self) -> Sequence[Run]:
        assert self.device
        sizes = [(64, 6)] if self.quick else [(rows, n) for rows in (256, 512, 1024) for n in (100, 400, 1000, 5000)]
        return [
            *(Run({"what": AGREES, "of": precision}) for precision in MAX_DIFFERENCES),
            *(Run({"what": ITERATES, "of": f"{rows} rows, {count} strokes"}) for rows, count in sizes),
            *(Run({"what": PLANS, "of": goal}) for goal in GOALS),
        ]

    def measure(self, run: Run, notify: Notify) -> Measurement:
        return {AGREES: self._agree, ITERATES: self._iterate, PLANS: self._plan}[run["what"]](run["of"])

    def _seconds(self, work: Callable[[], object]) -> float:
        """Wall time of the work, until the device has done it."""

        def settle() -> None:
            if self.device.type == "cuda":
                torch.cuda.synchronize(self.device)

        settle()
        start = time.perf_counter()
        work()
        settle()
        return time.perf_counter() - start

    def _agree(self, precision: str) -> Measurement:
        """Compares with the reference in float64 on the CPU: moments, and gradients of a random mixture of them."""
        model, grid = broad_brush(), PixelGrid.of_height(CANVAS, 48 if self.quick else 128)
        count = 4 if self.quick else 40
        some = uniform(count, model.limits.within(CANVAS), CANVAS, torch.Generator().manual_seed(1))
        with torch.no_grad():
            maps = model(some.thickness, some.length, some.bend)
        places = pixel_to_map(some.position.double(), some.angle.double(), grid, model.frame)
        chance = torch.Generator().manual_seed(2)
        canvas = torch.rand(3, grid.rows, grid.columns, generator=chance)
        weights = torch.randn(2, *canvas.shape, generator=chance, dtype=torch.float64)

        def seen(lay: Callable[..., Sequence[Tensor]], dtype: torch.dtype, where: torch.device) -> list[Tensor]:
            given = (maps, places, some.color, canvas)
            leaves = [part.detach().to(where, dtype).requires_grad_() for part in given]
            moments = lay(*leaves, model.spread)
            mixture = sum((weight.to(part) * part).sum() for weight, part in zip(weights, moments, strict=True))
            gradients = torch.autograd.grad(mixture, leaves)
            return [part.detach().double().cpu() for part in (*moments, *gradients)]

        expected = seen(reference.composite_moments, torch.float64, torch.device("cpu"))
        mine = seen(composite_moments, getattr(torch, precision), self.device)
        off = [float((one - other).abs().max() / other.abs().max()) for one, other in zip(mine, expected, strict=True)]
        return Measurement(dict(zip(PARTS, off, strict=True)))

    def _iterate(self, size: str) -> Measurement:
        rows, strokes = (int(word.split()[0]) for word in size.split(", "))
        count, on_cuda = 4 if self.quick else 80, self.device.type == "cuda"
        if on_cuda:
            torch.cuda.empty_cache()
            torch.cuda.reset_peak_memory_stats(self.device)
        problem, _ = blank_problem(photograph("astronaut").to(self.device), CANVAS, rows, broad_brush())
        moved = replace(problem, canvas=problem.canvas.to(self.device), model=on_device(problem.model, self.device))
        spread = uniform(strokes, moved.limits, CANVAS, torch.Generator().manual_seed(0)).to(self.device)
        found, paints = in_paints(spread, min(COLORS, strokes))

        def work(iterations: int) -> object:
            return optimize(found, moved, iterations=iterations, paints=paints)

        try:
            work(8)
            taken = self._seconds(lambda: work(count)) / count
        except torch.OutOfMemoryError:
            return Measurement({"ms": float("nan")})
        peak = torch.cuda.max_memory_allocated(self.device) / 2**20 if on_cuda else float("nan")
        waits = (_count_waits(work, 48) - _count_waits(work, 16)) / 32 if on_cuda else float("nan")
        return Measurement({"ms": 1000 * taken, "peak MB": peak, "waits for each": waits})

    def _plan(self, name: str) -> Measurement:
        coffee, style = (one.path for one in load_shipped_targets(["coffee", "tissue"]))
        goal = {
            "style": lambda: fp.make_goal(coffee, style=style),
            "words": lambda: fp.make_goal(text="a cup of coffee"),
        }.get(name, lambda: fp.make_goal(coffee))()
        small = {"strokes": 6, "effort": 0.05, "render_height": 64} if self.quick else {"strokes": 300}
        planners: list[fp.Planner] = []
        plans: list[fp.Plan] = []

        def work() -> None:
            planners.append(fp.make_planner(goal, **small))
            plans.append(planners[0].plan())

        try:
            taken = self._seconds(work)
        except WeightsError:
            return Measurement({"seconds": float("nan")})
        loss = planners[0].validation_loss(planners[0].expected(plans[0]))
        return Measurement({"seconds": taken, "loss": loss, "digest": float(int(plans[0].digest[:8], 16))})

    def tables(self, results: Results) -> Sequence[ResultTable]:
        kinds = {what: [(labels, one) for labels, one in results.found if labels["what"] == what]
                 for what in (AGREES, ITERATES, PLANS)}  # fmt: skip
        agreement: list[Row] = [
            {"precision": labels["of"], "what": part, "largest difference": off, "allowed": most, "agrees": off <= most}
            for labels, one in kinds[AGREES]
            for (part, off), most in zip(one.numbers.items(), MAX_DIFFERENCES[str(labels["of"])], strict=True)
        ]
        device = torch.cuda.get_device_name(self.device) if self.device.type == "cuda" else "the CPU"
        speed, plans = (
            [{"of": labels["of"], **one.numbers} for labels, one in kinds[what]] for what in (ITERATES, PLANS)
        )
        return [
            ResultTable(
                f"The renderer on {device} beside the reference, relative to its largest value", agreement,
                ["Gradients to places jump where a map has kinks: in float32 a few pixels take the other side."],
            ),
            ResultTable(f"Iterations of the planner on {device}", speed),
            ResultTable(f"Whole plans on {device}, with loading of networks", plans, ["Equal plans: equal digests."]),
        ]  # fmt: skip


def _count_waits(work: Callable[[int], object], iterations: int) -> int:
    """How often the CPU waits for the device."""
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        torch.cuda.set_sync_debug_mode("warn")
        try:
            work(iterations)
        finally:
            torch.cuda.set_sync_debug_mode("default")
    return sum("synchroniz" in str(one.message) for one in heard)
