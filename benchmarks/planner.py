"""How fast the planner is: the renderer and an iteration beside the paper's way, and whole plans."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import torch
from torch import Tensor

import frida_painter as fp
from clocks import (
    CANVAS,
    COLORS,
    Benchmark,
    blank_problem,
    broad_brush,
    cpu_seconds,
    in_paints,
    median_seconds,
    photograph,
)
from frida_painter.errors import WeightsError
from frida_painter.frames import PixelGrid, pixel_to_map
from frida_painter.objectives.objective import Goal
from frida_painter.planning.initialize import uniform
from frida_painter.planning.optimize import optimize
from frida_painter.planning.problem import PlanningProblem
from frida_painter.planning.variables import Paints
from frida_painter.render import reference, scanline
from frida_painter.strokes.strokes import Strokes
from frida_painter_lab.experiment import Measurement, Notify, Results, ResultTable, Row
from frida_painter_lab.runs import Run
from frida_painter_lab.targets import load_shipped_targets
from original import OriginalPlan, PaperNetwork

REFERENCE, FAST = "reference", "scanline"
REFERENCE_PIXELS = 10_000_000  # canvas pixels x strokes that the reference is timed on at most


@dataclass(frozen=True, kw_only=True)
class Render(Benchmark):
    """Forward and backward pass of the fast renderer beside the reference, one thread."""

    NAME = "render"
    TITLE = "Rendering"
    TEXT = (
        "The fast renderer is compared with the reference, which works on the full canvas: forward and backward pass,\n"
        "with gradients for all inputs. The reference is timed on some of the strokes if not all fit into memory.\n"
        "[Renderer](explanation/renderer.md) explains it."
    )

    def runs(self) -> Sequence[Run]:
        cases = [(64, 20)] if self.quick else [(256, 100), (256, 400), (512, 400), (512, 1000), (1024, 1000)]
        return [
            Run({"rows": rows, "strokes": strokes, "path": path})
            for rows, strokes in cases
            for path in (REFERENCE, FAST)
        ]

    def measure(self, run: Run, notify: Notify) -> Measurement:
        torch.set_num_threads(1)
        rows, strokes = int(run["rows"]), int(run["strokes"])
        grid, model = PixelGrid.of_height(CANVAS, rows), broad_brush()
        few = (
            min(strokes, max(2, REFERENCE_PIXELS // (grid.rows * grid.columns)))
            if run["path"] == REFERENCE
            else strokes
        )
        some = uniform(few, model.limits.within(CANVAS), CANVAS, torch.Generator().manual_seed(0))
        with torch.no_grad():
            maps = model(some.thickness, some.length, some.bend)
        places = pixel_to_map(some.position, some.angle, grid, model.frame)
        given = (maps, places, some.color, torch.ones(3, grid.rows, grid.columns))
        composite = {REFERENCE: reference.composite, FAST: scanline.composite}[run["path"]]

        def work() -> None:
            picture = composite(*(part.detach().requires_grad_() for part in given))
            picture.backward(2 * (picture.detach() - 0.5))

        return Measurement({"CPU s": median_seconds(work, 1 if self.quick else 5) * strokes / few, "timed": few})

    def tables(self, results: Results) -> Sequence[ResultTable]:
        rows: list[Row] = []
        for labels, one in results.found:
            slow = results.mean("CPU s", rows=labels["rows"], strokes=labels["strokes"], path=REFERENCE)
            rows.append({**labels, **one.numbers, "faster": round(slow / one.numbers["CPU s"], 1)})
        return [ResultTable("Rendering, forward and backward, one thread, float32", rows)]


OURS, ALL_ROWS, FROZEN, LEARNING = "ours", "ours, all rows", "paper's, network frozen", "paper's, with gradients"


@dataclass(frozen=True, kw_only=True)
class Iteration(Benchmark):
    """One planning iteration beside one that is built as the paper describes it (original.py).

    All start from the same strokes, spread uniformly over the parameters, on the same canvas.
    """

    NAME = "iteration"
    TITLE = "One iteration of the planner"
    TEXT = (
        "The time of `optimize()` divided by its number of iterations is compared with one iteration as the paper\n"
        "describes it (`benchmarks/original.py`). There, each stroke is a module. For each stroke in turn, the\n"
        "network makes one map; the map is padded to the full canvas, warped, turned into RGBA and composited. L2\n"
        "loss, backward pass and Adam follow. This is faster than the original program, which took 10.1 s for one\n"
        "iteration on a similar machine. Ours looks at every second row here, in turn\n"
        "([planner](explanation/planner.md#gradient-descent))."
    )

    @property
    def strokes(self) -> int:
        return 12 if self.quick else 400

    @property
    def rows(self) -> int:
        return 64 if self.quick else 256

    @cached_property
    def case(self) -> tuple[Strokes, Paints, PlanningProblem, Tensor]:
        """Strokes in the paints of a palette on a blank canvas, towards a photograph."""
        problem, target = blank_problem(photograph("astronaut"), CANVAS, self.rows, broad_brush())
        strokes = uniform(self.strokes, problem.limits, CANVAS, torch.Generator().manual_seed(0))
        return *in_paints(strokes, min(COLORS, self.strokes)), problem, target

    def runs(self) -> Sequence[Run]:
        return [Run({"iteration": name}) for name in (OURS, ALL_ROWS, FROZEN, LEARNING)]

    def measure(self, run: Run, notify: Notify) -> Measurement:
        torch.set_num_threads(1)
        strokes, paints, problem, target = self.case
        count, repeats = (2, 1) if self.quick else (40, 5)
        if run["iteration"] in (OURS, ALL_ROWS):
            seen = problem if run["iteration"] == OURS else replace(problem, forms=replace(problem.forms, on_rows=None))
            work: Callable[[], object] = partial(optimize, strokes, seen, iterations=count, paints=paints)
            return Measurement({"CPU s": median_seconds(work, repeats) / count})
        network = PaperNetwork(problem.model.frame, weight_gradients=run["iteration"] == LEARNING)
        plan = OriginalPlan(strokes, network)
        return Measurement(
            {"CPU s": median_seconds(partial(plan.iterate, problem.canvas, problem.size, target), repeats)}
        )

    def tables(self, results: Results) -> Sequence[ResultTable]:
        spent = {str(labels["iteration"]): one.numbers["CPU s"] for labels, one in results.found}
        rows = [
            {
                "as the paper describes it": name,
                "seconds": spent[name],
                "ours, all rows, ms": 1000 * spent[ALL_ROWS],
                "ours, ms": 1000 * spent[OURS],
                "faster": round(spent[name] / spent[OURS]),
                "at least": 250,
                "aim": 400,
            }
            for name in (FROZEN, LEARNING)
        ]
        title = f"One planning iteration, {self.strokes} strokes, {self.rows} rows, CPU time of one thread"
        return [ResultTable(title, rows)]


WHOLE, AGAIN, OTHER = "photograph", "its last quarter again", "its last two thirds, another photograph"
MAX_SECONDS = {"style": 240, "semantic": 180, "words": 360}


@dataclass(frozen=True, kw_only=True)
class Plans(Benchmark):
    """CPU seconds of whole plans and replans, towards each kind of goal."""

    NAME = "plan"
    TITLE = "Whole plans"
    TEXT = (
        "300 strokes towards a photograph, with the default settings, and then the rest of it planned again on the\n"
        "rendered picture of the strokes before. 100 strokes towards goals that networks judge; the time includes\n"
        "loading the networks. [Goals](lab/goals.md) explains the objectives."
    )

    def runs(self) -> Sequence[Run]:
        return [Run({"goal": name}) for name in (WHOLE, AGAIN, OTHER, "style", "semantic", "sketch", "words")]

    def _goal(self, name: str) -> Goal:
        coffee, style, drawing = (one.path for one in load_shipped_targets(["coffee", "tissue", "pear"]))
        return {
            "style": lambda: fp.make_goal(coffee, style=style),
            "semantic": lambda: fp.make_goal(semantic=coffee),
            "sketch": lambda: fp.make_goal(sketch=drawing),
            "words": lambda: fp.make_goal(text="a cup of coffee"),
        }.get(name, lambda: fp.make_goal(coffee))()

    def measure(self, run: Run, notify: Notify) -> Measurement:
        torch.set_num_threads(1)
        name = run["goal"]
        strokes = 300 if name in (WHOLE, AGAIN, OTHER) else 100
        small = {"strokes": 8, "effort": 0.05, "render_height": 64} if self.quick else {"strokes": strokes}
        found: list[fp.Plan] = []
        try:
            seconds = cpu_seconds(lambda: found.append(fp.make_planner(self._goal(name), **small).plan()))
        except WeightsError:
            return Measurement({"CPU s": float("nan"), "strokes": strokes})
        if name in (WHOLE, "style", "semantic", "sketch", "words"):
            return Measurement({"CPU s": seconds, "strokes": len(found[0])})
        planner = fp.make_planner(self._goal(name), **small)
        left = max(1, len(found[0]) // 4 if name == AGAIN else len(found[0]) * 2 // 3)
        canvas = planner.expected(found[0].part(slice(len(found[0]) - left)))
        rest = found[0].part(slice(-left, None))

        def work() -> None:
            other = planner
            if name == OTHER:
                other = planner.towards(fp.make_goal(load_shipped_targets(["cat"])[0].path))
            other.replan(rest, canvas, lambda step: None)

        return Measurement({"CPU s": cpu_seconds(work), "strokes": left})

    def tables(self, results: Results) -> Sequence[ResultTable]:
        rows = [
            {
                **labels,
                "strokes": one.numbers["strokes"],
                "CPU s": one.numbers["CPU s"],
                "at most": MAX_SECONDS.get(str(labels["goal"])),
            }
            for labels, one in results.found
        ]
        return [ResultTable("Plans, CPU time of one thread", rows, ["A dash: its networks are not fetched here."])]
