"""What planning the rest of a plan again costs, against planning all of it.

    python benchmarks/replanning.py [--json figures.json] [--strokes 300]

A whole plan is made, and its last k strokes are planned again on the picture that the others would
leave, for several k. CPU time of one thread, medians.
"""

import statistics
import time
from argparse import Namespace
from functools import partial

import torch
from torch import Tensor

from frida_painter.objectives.image import ImageTerm
from frida_painter.objectives.objective import Goal
from frida_painter.plan import Plan
from frida_painter.planning.effort import Effort
from frida_painter.planning.initialize import Growth
from frida_painter.planning.optimize import Step
from frida_painter.planning.planner import Planner
from frida_painter.planning.settings import PlannerSettings
from measure import Table, arguments, broad_brush, canvas_like, cpu_seconds, photograph, publish


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--picture", default="cat")
    parser.add_argument("--strokes", type=int, default=300)
    parser.add_argument("--colors", type=int, default=12)
    parser.add_argument("--repeats", type=int, default=3)
    options = parser.parse_args()
    effort, rows = Effort(), 256
    if options.quick:
        options.strokes, options.colors, options.repeats, rows = 12, 3, 1, 64
        effort = Effort(Growth(rounds=2, settling=2), relocations=1, refining=2, binding=2, polishing=2, replanning=2)
    torch.set_num_threads(1)
    wanted = photograph(options.picture)
    goal, size = Goal((ImageTerm(wanted),)), canvas_like(wanted)
    planner = Planner(
        goal,
        PlannerSettings(
            size,
            broad_brush(),
            rows=rows,
            effort=effort,
            seed=0,
            layers=1,
            new_paints=False,
            focus="none",
            sharpness=0.0,
        ),
    )
    bare = torch.ones(3, planner.fine.rows, planner.fine.columns)
    planner.plan(bare, min(options.strokes, 20), options.colors, lambda step: None)  # warms up

    made: list[Plan] = []
    whole = cpu_seconds(lambda: made.append(planner.plan(bare, options.strokes, options.colors, lambda step: None)))
    plan = made[0]
    measured, quarter = [], options.strokes // 4
    for left in sorted({max(1, options.strokes * twelfths // 12) for twelfths in (1, 2, 4, 8)} | {quarter}):
        canvas = planner.expected(plan.part(slice(options.strokes - left)), bare)
        again = partial(planner.replan, plan.part(slice(options.strokes - left, None)), canvas, lambda step: None)
        times = [cpu_seconds(again) for _ in range(options.repeats)]
        measured.append((left, statistics.median(times)))
    changed = after_another_goal(planner, photograph("coffee"), plan, bare, options)
    table = Table(
        f"Planning the last k of {options.strokes} strokes again; {options.picture}, {rows} rows, one thread",
        ("k", "CPU s", "ms per stroke", "share of the whole plan's", "at most", "aim"),
        [
            (
                str(left), f"{seconds:.2f}", f"{seconds / left * 1000:.1f}", f"{seconds / whole:.3f}",
                *(("0.333", "0.200") if left == quarter else ("", "")),
            )
            for left, seconds in measured
        ],
        [f"The whole plan takes {whole:.1f} CPU seconds."],
    )  # fmt: skip
    publish([table, told(changed, options)], {"whole": whole, "replanning": dict(measured), **changed}, options)


def after_another_goal(
    planner: Planner, wanted: Tensor, plan: Plan, bare: Tensor, options: Namespace
) -> dict[str, float]:
    """CPU seconds from another goal, the last two thirds of the strokes being left, to a new picture and a new plan.

    As the studio does it: everything is prepared anew, and the rest is planned in three rounds. The first new
    picture is the rendered plan after the first iteration.
    """
    left = max(1, options.strokes * 2 // 3)
    canvas, rest = planner.expected(plan.part(slice(options.strokes - left)), bare), plan.part(slice(-left, None))
    turns = []
    for _ in range(options.repeats):
        begun = time.process_time()
        seen: list[float] = []
        other = planner.towards(Goal((ImageTerm(wanted),)))

        def hear(step: Step, other: Planner = other, begun: float = begun, seen: list[float] = seen) -> None:
            if not seen:
                picture = canvas
                for brush, strokes in step.parts:
                    picture = other.problems.of(picture, other.fine, brush).render(strokes)
                seen.append(time.process_time() - begun)

        other.replan(rest, canvas, hear, rounds=3)
        turns.append((seen[0], time.process_time() - begun))
    pictures, plans = zip(*turns, strict=True)
    return {"new picture": statistics.median(pictures), "new plan": statistics.median(plans)}


def told(changed: dict[str, float], options: Namespace) -> Table:
    return Table(
        f"After a change of goal, {max(1, options.strokes * 2 // 3)} strokes left, CPU seconds of one thread",
        ("until", "CPU s", "at most", "aim"),
        [
            ("the first new picture", f"{changed['new picture']:.2f}", "1", "0.3"),
            ("the new plan", f"{changed['new plan']:.2f}", "", ""),
        ],
    )


if __name__ == "__main__":
    main()
