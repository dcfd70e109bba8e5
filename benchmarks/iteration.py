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
from dataclasses import replace
from functools import partial

import torch
from torch import Tensor

from frida_painter.brush.spread import CoverageSpread
from frida_painter.frames import CanvasSize, PixelGrid, pixel_to_map
from frida_painter.planning.initialize import uniform
from frida_painter.planning.interlace import interlaced
from frida_painter.planning.optimize import optimize
from frida_painter.planning.refine import discretize
from frida_painter.planning.scene import Scene
from frida_painter.planning.variables import Paints
from frida_painter.render import composite_moments
from frida_painter.session.opening import prepare_process
from frida_painter.strokes import Strokes
from measure import Table, arguments, blank_scene, broad_brush, cpu_seconds, photograph, publish, wall_seconds
from original import OriginalPlan, PaperNetwork

CANVAS = CanvasSize(0.3556, 0.2794)
COLORS = 12
CPU = "CPU, 1 thread"
OURS, ALL_ROWS, FROZEN, LEARNING = "ours", "ours, all rows", "network frozen", "network with gradients"


def compare(
    strokes: Strokes, paints: Paints, scene: Scene, target: Tensor, options: Namespace
) -> dict[str, dict[str, float]]:
    """Seconds per iteration, by clock and by what iterates."""
    iterations = 2 if options.quick else 40
    works = {
        name: partial(optimize, strokes, seen, iterations=iterations, paints=paints)
        for name, seen in ((OURS, scene), (ALL_ROWS, replace(scene, objective_on_rows=None)))
    }
    for name, gradients in ((FROZEN, False), (LEARNING, True)):
        plan = OriginalPlan(strokes, PaperNetwork(scene.model.frame, weight_gradients=gradients))
        works[name] = partial(plan.iterate, scene.canvas, scene.size, target)
    found = {}
    clocks = [(1, cpu_seconds, CPU), (2, wall_seconds, "wall, 2 threads")]
    for threads, clock, name in clocks[:1] if options.no_wall else clocks:
        torch.set_num_threads(threads)
        seconds = interleaved(clock, works, options.repeats if threads == 1 else max(1, options.repeats // 2))
        found[name] = {work: value / (iterations if work in (OURS, ALL_ROWS) else 1) for work, value in seconds.items()}
    prepare_process()
    return found


def interleaved(
    clock: Callable[[Callable[[], object]], float], works: dict[str, Callable[[], object]], turns: int
) -> dict[str, float]:
    """Median seconds of all works, which take turns; one turn before warms up."""
    rounds = [{name: clock(work) for name, work in works.items()} for _ in range(turns + 1)][1:]
    return {name: statistics.median(seconds[name] for seconds in rounds) for name in works}


def breakdown(strokes: Strokes, scene: Scene, whole: float, repeats: int) -> dict[str, float]:
    """CPU seconds of the parts of an iteration, each timed by itself; what is left of `whole` is the rest."""
    rounds = [parts(strokes, scene) for _ in range(repeats + 1)][1:]
    found = {name: statistics.median(seconds[name] for seconds in rounds) for name in rounds[0]}
    return {**found, "step, projection, ordering": whole - sum(found.values())}


def parts(strokes: Strokes, scene: Scene) -> dict[str, float]:
    """Of one turn of the scene."""
    ((scene, *_), *_) = interlaced([scene])
    canvas = scene.rows.of(scene.canvas)
    leaves = {name: part.clone().requires_grad_() for name, part in strokes.arrays().items()}
    grid = PixelGrid(scene.size, *scene.canvas.shape[1:])
    model_forward, magnitude = timed(lambda: scene.model(leaves["thickness"], leaves["length"], leaves["bend"]))
    marks = magnitude.detach().requires_grad_()
    placing, affine = timed(
        lambda: pixel_to_map(leaves["position"], leaves["angle"], grid, scene.model.frame, scene.rows)
    )
    places = affine.detach().requires_grad_()
    laying, painted = timed(lambda: laid(marks, places, leaves["color"], canvas, scene.spread))
    picture = painted.detach().requires_grad_()
    judging, loss = timed(lambda: scene.objective(picture[:3], picture[3]))
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
    scene, target = blank_scene(photograph("astronaut"), CANVAS, options.rows, broad_brush())
    strokes = uniform(options.strokes, scene.limits, CANVAS, torch.Generator().manual_seed(0))
    strokes, paints = discretize(strokes, scene, min(COLORS, options.strokes), 0)
    found = compare(strokes, paints, scene, target, options)
    whole = found[CPU][OURS]
    shares = breakdown(strokes, scene, whole, 3 if options.quick else 30)
    _, height, width = scene.canvas.shape
    case = f"{options.strokes} strokes, {height} x {width} pixels"
    tables = [
        Table(
            f"One planning iteration, {case}",
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
            f"Where an iteration of ours goes, {case}, CPU time of one thread",
            ("part", "ms", "share"),
            [(name, f"{seconds * 1000:.2f}", f"{seconds / whole:.0%}") for name, seconds in shares.items()],
        ),
    ]  # fmt: skip
    publish(tables, {"seconds": found, "parts": shares}, options)


if __name__ == "__main__":
    main()
