"""Makes one plan with whatever checkout is on the path, and writes its strokes and CPU seconds; for quality.py.

    PYTHONPATH=CHECKOUT/src:CHECKOUT/benchmarks python -P plan_once.py FILE PICTURE SEED EFFORT STROKES COLORS ROWS

Only names that checkouts since November 2026 have in common are used here.
"""

import sys
import time
from typing import Any

import numpy as np
import torch

from frida_painter.objectives import objective
from frida_painter.planning.layers import Effort
from frida_painter.planning.planner import Planner
from measure import ImageTerm, broad_brush, canvas_like, photograph  # type: ignore[attr-defined]


def main() -> None:
    file, picture, *numbers = sys.argv[1:]
    seed, strokes, colors, rows = (int(numbers[at]) for at in (0, 2, 3, 4))
    torch.set_num_threads(1)
    wanted, model = photograph(picture), broad_brush()

    def plan(count: int, effort: float) -> Any:
        size = canvas_like(wanted)
        chosen = getattr(Effort(), "scale" if hasattr(Effort, "scale") else "scaled")(effort)
        facts = {"rows": rows, "effort": chosen, "seed": seed}
        wished = objective.Goal((ImageTerm(wanted),))
        try:
            from frida_painter.planning.settings import PlannerSettings
        except ImportError:  # before 0.3
            planner = Planner(wished, size, model, **facts)
        else:
            plain = {"layers": 1, "new_paints": False, "focus": "none", "sharpness": 0.0}
            planner = Planner(wished, PlannerSettings(size, model, **facts, **plain))
        return planner.plan(torch.ones(3, rows, planner.fine.columns), count, colors, lambda step: None)

    plan(4, 0.02)  # loads kernels
    begun = time.process_time()
    found = plan(strokes, float(numbers[1])).strokes
    seconds = time.process_time() - begun
    np.savez(file, seconds=seconds, **{name: part.numpy() for name, part in found.arrays().items()})


if __name__ == "__main__":
    main()
