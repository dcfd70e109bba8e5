"""How good a plan becomes: the default start against the uniform one, and a palette against free colours.

    python benchmarks/planning.py [--json figures.json] [--seeds 3] [--workers 1]

Starts: both get the same CPU seconds of one thread, colours free, in any order. The default start
grows a plan on a coarse picture and moves its weak strokes, as the planner does; the uniform one
gets plain steps on the coarse picture for as long. What is left of the budget goes into the same
`optimize` at full resolution for both. The best picture up to the last second counts.

Palette: what `Planner.plan` makes, in few paints from light to dark throughout, against a plan with
the same number of coarse and fine iterations whose colours and order are free; of the plans as they are rendered, and
of paintings of them, in which marks vary.
"""

import math
import statistics
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from itertools import product
from multiprocessing import get_context

import torch
from torch import Tensor

from frida_painter.canvas_size import CanvasSize
from frida_painter.devices import prepare_process
from frida_painter.objectives.image import ImageTerm
from frida_painter.objectives.objective import Goal
from frida_painter.planning.effort import Effort
from frida_painter.planning.initialize import Growth, progressive, uniform
from frida_painter.planning.optimize import Step, optimize
from frida_painter.planning.planner import Planner
from frida_painter.planning.problem import PlanningProblem
from frida_painter.planning.refine import relocate
from frida_painter.planning.settings import PlannerSettings
from frida_painter.strokes import Strokes
from measure import Table, arguments, blank_problem, broad_brush, canvas_like, cpu_seconds, photograph, psnr, publish

PICTURES = ("astronaut", "cat", "coffee")
MOVING, PROPOSALS = 0.15, 24
SAFETY = 0.97  # so that the last of the planned iterations lie inside the budget


@dataclass(frozen=True)
class Case:
    """What is planned, and with how much work."""

    strokes: int = 200
    rows: int = 256
    colors: int = 12
    budget: float = 10.0
    effort: Effort = field(default_factory=Effort)


@dataclass(frozen=True)
class Figures:
    """PSNR in dB against the picture at full resolution, and CPU seconds."""

    picture: str
    seed: int
    uniform: float
    default: float
    start_seconds: float
    free: float
    palette: float
    free_expected: float
    palette_expected: float
    free_seconds: float
    palette_seconds: float


def measure(task: tuple[str, int], case: Case) -> Figures:
    """All figures for one picture and seed; runs in a process of its own."""
    prepare_process()
    picture, seed = task
    wanted = photograph(picture)
    size, model = canvas_like(wanted), broad_brush()
    coarse, small = blank_problem(wanted, size, case.rows // 2, model)
    fine, target = blank_problem(wanted, size, case.rows, model)

    grow(replace(case, strokes=8), coarse, small, seed)  # warms up
    begun = time.process_time()
    grown = grow(case, coarse, small, seed)
    spent = time.process_time() - begun
    default = settle(grown, fine, case.budget - spent)

    scattered = uniform(case.strokes, model.limits, size, torch.Generator().manual_seed(seed))
    iterations = affordable(scattered, coarse, spent)
    begun = time.process_time()
    scattered, _ = optimize(scattered, coarse, iterations=iterations)
    plain = settle(scattered, fine, case.budget - (time.process_time() - begun))

    begun = time.process_time()
    free = free_plan(case, coarse, small, fine, seed, wanted, size)
    middle = time.process_time()
    planner = Planner(
        Goal((ImageTerm(wanted),)),
        PlannerSettings(
            size,
            model,
            rows=case.rows,
            effort=case.effort,
            seed=seed,
            layers=1,
            new_paints=False,
            focus="none",
            sharpness=0.0,
        ),
    )
    plan = planner.plan(fine.canvas, case.strokes, case.colors, lambda step: None)
    end = time.process_time()
    return Figures(
        picture, seed, plain, default, spent, quality(free, fine, target), quality(plan.strokes, fine, target),
        expected(free, fine), expected(plan.strokes, fine), middle - begun, end - middle,
    )  # fmt: skip


def grow(case: Case, coarse: PlanningProblem, small: Tensor, seed: int) -> Strokes:
    """The planner's start, colours free and in any order: growth, then weak strokes move, on the coarse picture."""
    generator = torch.Generator().manual_seed(seed)
    strokes = progressive(
        case.strokes, coarse, small,
        growth=case.effort.growth, generator=generator,
    )  # fmt: skip
    for _ in range(case.effort.relocations):
        strokes, _ = relocate(
            strokes, None, coarse, small,
            share=MOVING, proposals=PROPOSALS, generator=generator,
        )  # fmt: skip
        strokes, _ = optimize(strokes, coarse, iterations=case.effort.refining)
    return strokes


def affordable(strokes: Strokes, problem: PlanningProblem, seconds: float) -> int:
    """How many iterations fit into so many CPU seconds; finding out is not counted against them."""
    probe = 10
    steps = partial(optimize, strokes, problem, iterations=probe)
    steps()  # warms up
    return max(1, math.floor(SAFETY * seconds / (cpu_seconds(steps) / (probe + 1))))


def settle(strokes: Strokes, problem: PlanningProblem, seconds: float) -> float:
    """The best PSNR that `optimize` reaches within so many CPU seconds."""
    if seconds <= 0:
        raise SystemExit(f"The start took {-seconds:.1f} s longer than the whole budget; give a larger one.")
    iterations = affordable(strokes, problem, seconds)
    losses: list[float] = []
    begun = time.process_time()

    def tell(step: Step) -> None:
        if time.process_time() - begun <= seconds:
            losses.append(step.loss)

    optimize(strokes, problem, iterations=iterations, notify=tell)
    return psnr(min(losses))


def free_plan(
    case: Case,
    coarse: PlanningProblem,
    small: Tensor,
    fine: PlanningProblem,
    seed: int,
    wanted: Tensor,
    size: CanvasSize,
) -> Strokes:
    """A plan in colours and an order of its own, of as many coarse and fine iterations as the planner's."""
    planner = Planner(
        Goal((ImageTerm(wanted),)),
        PlannerSettings(
            size,
            coarse.model,
            rows=case.rows,
            effort=case.effort,
            seed=seed,
            layers=1,
            new_paints=False,
            focus="none",
            sharpness=0.0,
        ),
    )
    strokes = grow(case, coarse, small, seed)
    effort = case.effort
    growing = min(effort.growth.rounds, case.strokes) * effort.growth.settling
    made = growing + effort.relocations * effort.refining + effort.polishing
    strokes, _ = optimize(strokes, coarse, iterations=planner.iterations(case.strokes) - made)
    return optimize(strokes, fine, iterations=effort.polishing)[0]


@torch.no_grad()
def quality(strokes: Strokes, problem: PlanningProblem, target: Tensor) -> float:
    return psnr(float((problem.render(strokes) - target).square().mean()))


@torch.no_grad()
def expected(strokes: Strokes, problem: PlanningProblem) -> float:
    """Of paintings, whose marks vary: what the planner makes as good as it can."""
    return psnr(float(problem.expected_loss(strokes)))


def averaged(figures: list[Figures]) -> list[tuple[str, Figures]]:
    """The mean over seeds, per picture and over all pictures."""
    groups = [(name, [one for one in figures if one.picture == name]) for name in PICTURES]
    return [(name, _mean(group)) for name, group in [*groups, ("mean", figures)] if group]


def _mean(group: list[Figures]) -> Figures:
    numbers = [{name: value for name, value in asdict(one).items() if isinstance(value, float)} for one in group]
    return replace(group[0], **{name: statistics.fmean(row[name] for row in numbers) for name in numbers[0]})


def tables(figures: list[Figures], case: Case, seeds: int) -> list[Table]:
    what = f"{case.strokes} strokes, {case.rows} rows, broad brush, {seeds} seeds"
    groups = averaged(figures)
    gains = [one.default - one.uniform for one in figures]
    losses = [one.free - one.palette for one in figures]
    losses_expected = [one.free_expected - one.palette_expected for one in figures]
    return [
        Table(
            f"Start: PSNR expected of paintings after {case.budget:g} CPU seconds of one thread; {what}",
            ("picture", "uniform start", "default start", "gain", "at least", "aim", "seconds on the start"),
            [
                (
                    name, f"{one.uniform:.2f} dB", f"{one.default:.2f} dB", f"{one.default - one.uniform:+.2f} dB",
                    *(("+1.2 dB", "+2 dB") if name == "mean" else ("", "")), f"{one.start_seconds:.1f}",
                )
                for name, one in groups
            ],
            [f"Gain over all pictures and seeds: {min(gains):+.2f} to {max(gains):+.2f} dB."],
        ),
        Table(
            f"Palette: PSNR of {case.colors} paints from light to dark against free colours; {what}",
            ("picture", "free", "with palette", "lost", "at most", "aim", "CPU s, free", "CPU s, palette"),
            [
                (
                    name, f"{one.free:.2f} dB", f"{one.palette:.2f} dB", f"{one.free - one.palette:.2f} dB",
                    *(("1.0 dB", "0.5 dB") if name == "mean" else ("", "")),
                    f"{one.free_seconds:.1f}", f"{one.palette_seconds:.1f}",
                )
                for name, one in groups
            ],
            [f"Lost over all pictures and seeds: {min(losses):.2f} to {max(losses):.2f} dB."],
        ),
        Table(
            "The same, as PSNR that is expected of paintings of these plans",
            ("picture", "free", "with palette", "lost", "at most", "aim"),
            [
                (
                    name, f"{one.free_expected:.2f} dB", f"{one.palette_expected:.2f} dB",
                    f"{one.free_expected - one.palette_expected:.2f} dB",
                    *(("1.0 dB", "0.5 dB") if name == "mean" else ("", "")),
                )
                for name, one in groups
            ],
            [f"Lost over all pictures and seeds: {min(losses_expected):.2f} to {max(losses_expected):.2f} dB."],
        ),
    ]  # fmt: skip


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--pictures", nargs="+", choices=PICTURES, default=PICTURES)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--workers", type=int, default=1, help="processes at a time, each of one thread")
    options = parser.parse_args()
    case = Case()
    if options.quick:
        options.pictures, options.seeds = PICTURES[:1], 1
        little = Effort(Growth(rounds=2, settling=2), relocations=1, refining=2, binding=2, polishing=2, replanning=2)
        case = Case(strokes=12, rows=64, colors=3, budget=1.0, effort=little)
    tasks = list(product(options.pictures, range(options.seeds)))
    work = partial(measure, case=case)
    if options.workers == 1:
        figures = [work(task) for task in tasks]
    else:
        with ProcessPoolExecutor(options.workers, mp_context=get_context("spawn")) as pool:
            figures = list(pool.map(work, tasks))
    publish(tables(figures, case, options.seeds), [asdict(one) for one in figures], options)


if __name__ == "__main__":
    main()
