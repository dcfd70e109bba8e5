"""One whole planning iteration against one that is built as the paper describes it (original.py).

    python benchmarks/iteration.py [--json figures.json] [--strokes 400] [--repeats 5]

Ours is `optimize()` itself, timed over many iterations and divided by their number: stroke model,
render, L2, backward, step, projection, palette and light-to-dark order. All start from the same
strokes, spread uniformly over the parameters, on the same canvas, and take turns. Ours looks at some rows of the
canvas in turn, as the planner does; it is timed with all rows as well, and its parts are those of one turn.
"""

import statistics
from argparse import Namespace
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Self

import torch
from torch import Tensor

from frida_painter.brush.kinds import CoverageSpread
from frida_painter.canvas_size import CanvasSize
from frida_painter.devices import prepare_process
from frida_painter.frames import PixelGrid, pixel_to_map
from frida_painter.planning.initialize import uniform
from frida_painter.planning.optimize import interlace_rows, optimize
from frida_painter.planning.problem import PlanningProblem
from frida_painter.planning.refine import discretize
from frida_painter.planning.variables import Paints
from frida_painter.render import composite_moments
from frida_painter.strokes import Strokes
from measure import Table, arguments, blank_problem, broad_brush, cpu_seconds, photograph, publish, wall_seconds
from original import OriginalPlan, PaperNetwork

CANVAS = CanvasSize(0.3556, 0.2794)
COLORS = 12
CPU = "CPU, 1 thread"
OURS, ALL_ROWS, FROZEN, LEARNING = "ours", "ours, all rows", "network frozen", "network with gradients"


@dataclass(frozen=True)
class Case:
    """What is iterated: strokes in the paints of a palette on a blank canvas, towards a photograph."""

    strokes: Strokes
    paints: Paints
    problem: PlanningProblem
    target: Tensor

    @classmethod
    def of(cls, options: Namespace) -> Self:
        problem, target = blank_problem(photograph("astronaut"), CANVAS, options.rows, broad_brush())
        strokes = uniform(options.strokes, problem.limits, CANVAS, torch.Generator().manual_seed(0))
        return cls(*discretize(strokes, problem, min(COLORS, options.strokes), 0), problem, target)

    def ours(self, iterations: int) -> dict[str, Callable[[], object]]:
        return {
            name: partial(optimize, self.strokes, seen, iterations=iterations, paints=self.paints)
            for name, seen in ((OURS, self.problem), (ALL_ROWS, replace(self.problem, objective_on_rows=None)))
        }

    def papers(self) -> dict[str, Callable[[], object]]:
        network = partial(PaperNetwork, self.problem.model.frame)
        plans = {
            name: OriginalPlan(self.strokes, network(weight_gradients=gradients))
            for name, gradients in ((FROZEN, False), (LEARNING, True))
        }
        seen = self.problem.canvas, self.problem.size, self.target
        return {name: partial(plan.iterate, *seen) for name, plan in plans.items()}


def measured(pipe: Connection, options: Namespace, iterations: int | None) -> None:
    """Answers each (work, threads) that is asked for with CPU and wall seconds of an iteration, until None comes."""
    prepare_process()
    case = Case.of(options)
    works = case.papers() if iterations is None else case.ours(iterations)
    while (asked := pipe.recv()) is not None:
        name, threads = asked
        torch.set_num_threads(threads)
        clock = cpu_seconds if threads == 1 else wall_seconds
        pipe.send(clock(works[name]) / (iterations or 1))


def compare(options: Namespace) -> dict[str, dict[str, float]]:
    """Median seconds per iteration, by clock and by what iterates; all take turns, and the first turn warms up.

    Ours and the paper's are in processes of their own, so that the memory of one is not in the other's way.
    """
    context, iterations, pipes = get_context("spawn"), 2 if options.quick else 40, []
    for count in (iterations, None):
        pipe, other = context.Pipe()
        context.Process(target=measured, args=(other, options, count), daemon=True).start()
        pipes.append(pipe)
    asked = {OURS: pipes[0], ALL_ROWS: pipes[0], FROZEN: pipes[1], LEARNING: pipes[1]}
    found = {}
    for clock, threads in ((CPU, 1),) if options.no_wall else ((CPU, 1), ("wall, 2 threads", 2)):
        turns = 1 + (options.repeats if threads == 1 else max(1, options.repeats // 2))
        rounds = [{name: answer(pipe, name, threads) for name, pipe in asked.items()} for _ in range(turns)]
        found[clock] = {name: statistics.median(seconds[name] for seconds in rounds[1:]) for name in asked}
    for pipe in pipes:
        pipe.send(None)
    return found


def answer(pipe: Connection, name: str, threads: int) -> float:
    pipe.send((name, threads))
    return float(pipe.recv())


def breakdown(strokes: Strokes, problem: PlanningProblem, whole: float, repeats: int) -> dict[str, float]:
    """CPU seconds of the parts of an iteration, each timed by itself; what is left of `whole` is the rest."""
    rounds = [parts(strokes, problem) for _ in range(repeats + 1)][1:]
    found = {name: statistics.median(seconds[name] for seconds in rounds) for name in rounds[0]}
    return {**found, "step, projection, ordering": whole - sum(found.values())}


def parts(strokes: Strokes, problem: PlanningProblem) -> dict[str, float]:
    """Of one turn of the scene."""
    ((problem, *_), *_) = interlace_rows([problem])
    canvas = problem.rows.of(problem.canvas)
    leaves = {name: part.clone().requires_grad_() for name, part in strokes.arrays().items()}
    grid = PixelGrid(problem.size, *problem.canvas.shape[1:])
    shapes = leaves["thickness"], leaves["length"], leaves["bend"]
    model_forward, magnitude = timed(lambda: problem.model.windows(*shapes)[0])
    marks = magnitude.detach().requires_grad_()
    shift = problem.model.windows(*shapes)[1]
    placing, affine = timed(
        lambda: pixel_to_map(leaves["position"], leaves["angle"], grid, problem.model.frame, problem.rows) - shift
    )
    places = affine.detach().requires_grad_()
    laying, painted = timed(lambda: laid(marks, places, leaves["color"], canvas, problem.spread))
    picture = painted.detach().requires_grad_()
    judging, loss = timed(lambda: problem.objective(picture[:3], picture[3]))
    return {
        "stroke model, forward": model_forward,
        "placing, forward": placing,
        "compositing, forward": laying,
        "objective, both ways": judging + cpu_seconds(loss.backward),
        "compositing, backward": cpu_seconds(partial(painted.backward, picture.grad)),
        "placing, backward": cpu_seconds(partial(affine.backward, places.grad)),
        "stroke model, backward": cpu_seconds(partial(magnitude.backward, marks.grad)),
    }


def laid(marks: Tensor, places: Tensor, color: Tensor, canvas: Tensor, spread: CoverageSpread) -> Tensor:
    """Mean and variance in one tensor [4, H, W], as `render_moments` computes them."""
    mean, variance = composite_moments(marks, places, color, canvas, spread, bare_cells_answer=False)
    return torch.cat((mean, variance[None]))


def timed(work: Callable[[], Tensor]) -> tuple[float, Tensor]:
    """CPU seconds of the work, and its outcome."""
    found: list[Tensor] = []
    return cpu_seconds(lambda: found.append(work())), found[0]


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--strokes", type=int, default=400)
    parser.add_argument("--rows", type=int, default=256)
    parser.add_argument("--repeats", type=int, default=5, help="turns of which the median is taken")
    parser.add_argument("--no-wall", action="store_true", help="leave out wall time, which a busy machine spoils")
    options = parser.parse_args()
    if options.quick:
        options.no_wall = True
        options.strokes, options.rows, options.repeats = 12, 64, 1
    prepare_process()
    found = compare(options)
    case = Case.of(options)
    whole = found[CPU][OURS]
    shares = breakdown(case.strokes, case.problem, whole, 3 if options.quick else 30)
    _, height, width = case.problem.canvas.shape
    told = f"{options.strokes} strokes, {height} x {width} pixels"
    tables = [
        Table(
            f"One planning iteration, {told}",
            ("clock", "as the paper describes it", "seconds", "ours, all rows", "ours", "faster", "at least", "aim"),
            [
                (
                    clock, name, f"{seconds[name]:.2f} s", f"{seconds[ALL_ROWS] * 1000:.1f} ms",
                    f"{seconds[OURS] * 1000:.1f} ms",
                    f"{seconds[name] / seconds[OURS]:.0f}x", "250x", "400x",
                )
                for clock, seconds in found.items()
                for name in (FROZEN, LEARNING)
            ],
        ),
        Table(
            f"Where an iteration of ours goes, {told}, CPU time of one thread",
            ("part", "ms", "share"),
            [(name, f"{seconds * 1000:.2f}", f"{seconds / whole:.0%}") for name, seconds in shares.items()],
        ),
    ]  # fmt: skip
    publish(tables, {"seconds": found, "parts": shares}, options)


if __name__ == "__main__":
    main()
