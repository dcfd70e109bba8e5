"""How long planning takes towards each kind of goal: 100 strokes, one thread, CPU seconds.

    python benchmarks/goals.py [--quick] [--json FILE]

Networks are those that were fetched (frida-painter models fetch --all); a kind of goal whose networks
are missing is left out, and said to be.
"""

from dataclasses import asdict, dataclass

import torch

from frida_painter.devices import prepare_process
from frida_painter.errors import WeightsError
from frida_painter.lab.targets import load_shipped_targets
from frida_painter.objectives.beyond_pixels import SemanticTerm, SketchTerm, StyleTerm
from frida_painter.objectives.image import ImageTerm
from frida_painter.objectives.objective import Goal
from frida_painter.planning.effort import Effort
from frida_painter.planning.planner import Planner
from frida_painter.planning.settings import PlannerSettings
from frida_painter.words.text import TextTerm
from measure import Table, arguments, broad_brush, canvas_like, cpu_seconds, photograph, publish

STROKES, COLORS = 100, 12
WANTED = {"style": "4 min", "meaning": "3 min", "words": "6 min"}


@dataclass(frozen=True)
class Figures:
    goal: str
    cpu_seconds: float
    ms_per_iteration: float


def goals() -> dict[str, Goal]:
    photo, style = photograph("coffee"), load_shipped_targets(["tissue"])[0].picture
    drawing = load_shipped_targets(["pear"])[0].picture
    return {
        "photograph": Goal((ImageTerm(photo),)),
        "style": Goal((ImageTerm(photo), StyleTerm(style))),
        "meaning": Goal((SemanticTerm(photo),)),
        "sketch": Goal((SketchTerm(drawing),)),
        "sketch and style": Goal((SketchTerm(drawing), StyleTerm(style))),
        "words": Goal((TextTerm("a cup of coffee"),)),
    }


def measure(name: str, goal: Goal, *, rows: int, strokes: int, effort: Effort) -> Figures:
    size = canvas_like(photograph("coffee"))
    model = broad_brush()
    planner: Planner | None = None

    def work() -> None:
        nonlocal planner
        planner = Planner(
            goal,
            PlannerSettings(
                size, model, rows=rows, effort=effort, seed=0, layers=1, new_paints=False, focus="none", sharpness=0.0
            ),
        )
        bare = torch.ones(3, planner.fine.rows, planner.fine.columns)
        planner.plan(bare, strokes, min(COLORS, strokes), lambda step: None)

    seconds = cpu_seconds(work)
    assert planner is not None
    return Figures(name, seconds, 1000 * seconds / planner.iterations(strokes))


def table(figures: list[Figures], missing: list[str], strokes: int) -> Table:
    rows = [
        (one.goal, f"{one.cpu_seconds:.0f} s", f"{one.ms_per_iteration:.0f} ms", WANTED.get(one.goal, ""))
        for one in figures
    ]
    notes = [f"Not measured, for want of networks: {', '.join(missing)}."] if missing else []
    title = f"Planning {strokes} strokes towards each kind of goal, CPU time of one thread, with loading of networks"
    return Table(title, ("goal", "CPU", "for an iteration", "at most, on 2 cores"), rows, notes)


def main() -> None:
    parser = arguments(__doc__)
    kinds = goals()
    parser.add_argument("--goals", nargs="+", choices=kinds, default=list(kinds), help="kinds of goals to be planned")
    options = parser.parse_args()
    prepare_process()
    little = Effort().scale(0.03)
    how = {"rows": 64, "strokes": 6, "effort": little} if options.quick else {
        "rows": 256, "strokes": STROKES, "effort": Effort()
    }  # fmt: skip
    figures, missing = [], []
    for name in options.goals:
        try:
            figures.append(measure(name, kinds[name], **how))
        except WeightsError as error:
            print(f"{name}: {error}")
            missing.append(name)
    publish([table(figures, missing, how["strokes"])], [asdict(one) for one in figures], options)


if __name__ == "__main__":
    main()
