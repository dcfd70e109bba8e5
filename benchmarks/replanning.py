"""What planning the rest of a plan again costs, against planning all of it.

    python benchmarks/replanning.py [--json figures.json] [--strokes 300]

A whole plan is made, and its last k strokes are planned again on the picture that the others would
leave, for several k. CPU time of one thread, medians.
"""

import statistics
from functools import partial

import torch

from frida_painter.goal import Goal
from frida_painter.objectives.kinds.image import ImageTerm
from frida_painter.plan import Plan
from frida_painter.planning.effort import Effort
from frida_painter.planning.initialize import Growth
from frida_painter.planning.planner import Planner
from measure import Table, arguments, broad_brush, canvas_like, cpu_seconds, photograph, publish


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--picture", default="chelsea")
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
    planner = Planner(goal, size, broad_brush(), rows=rows, effort=effort, seed=0)
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
    publish([table], {"whole": whole, "replanning": dict(measured)}, options)


if __name__ == "__main__":
    main()
