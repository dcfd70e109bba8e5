"""Twelve goals of several parts, planned and put on one sheet to be looked at.

    python benchmarks/combined.py [--quick] [--strokes N] [--effort X] [--names NAME ...] [--out FOLDER] [--json FILE]

Each is listed with a description of the painting that a person hopes for. The sheet and the plans' pictures are
written to FOLDER. A picture that is there already is shown, not planned again.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from time import process_time

from torch import Tensor

import frida_painter as fp
from frida_painter import images
from frida_painter.devices import prepare_process
from frida_painter.lab import targets
from frida_painter.lab.benchmark import suite
from frida_painter.objectives.objective import Goal, goal_kinds
from frida_painter.report.sheets import Cell, FigureRow, page
from measure import Table, arguments, publish

PHOTOGRAPHS = Path(suite.__file__).parent / "pictures"
DRAWINGS = Path(targets.__file__).parent
STYLES = Path(__file__).parent / "styles"
ROW = 4  # cells of a row of the sheet


def mirror(picture: Tensor) -> Tensor:
    """Returns how far a picture [3, H, W] is from its own mirror image."""
    return (picture - picture.flip(2)).square().mean()


def begun(goal: Goal, kind: str, path: Path) -> Goal:
    """Returns the goal for a painting that begins with a file."""
    return Goal(goal.terms, (goal_kinds()[kind].open_term(path, 1.0, beginning=True),))


def photograph(name: str) -> Path:
    return PHOTOGRAPHS / f"{name}.jpg"


def drawing(name: str) -> Path:
    return DRAWINGS / f"{name}.png"


def style(name: str) -> Path:
    return STYLES / f"{name}.jpg"


# Written down before anything was painted, each with a description of the painting that a person hopes for.
GOALS: dict[str, tuple[Callable[[], Goal], str]] = {
    "a face in the Great Wave": (
        lambda: fp.make_goal(photograph("smile"), style=style("great-wave")),
        "this woman smiles, in the wave's blue, cream and foam",
    ),
    "peaks and a cow": (
        lambda: fp.make_goal(photograph("peaks"), text="a cow"),
        "the mountains of the photograph, with a cow on the meadow",
    ),
    "house, drawn, in The Scream": (
        lambda: fp.make_goal(sketch=drawing("house"), style=style("scream")),
        "the drawn house and tree before a red, waving sky",
    ),
    "begun with the Shipwreck, a lighthouse": (
        lambda: begun(
            fp.make_goal(text="a lighthouse", style=style("shipwreck")), "style", style("shipwreck")
        ),
        "the storm of the style picture, and a lighthouse in it",
    ),
    "content of a raccoon in Woman with a Hat": (
        lambda: fp.make_goal(semantic=photograph("raccoon"), style=style("woman-with-a-hat")),
        "a raccoon's mask and nose in wild patches of colour",
    ),
    "content of a cat, a tiger": (
        lambda: fp.make_goal(semantic=photograph("cat"), text="a tiger"),
        "this cat's face with the orange and the stripes of a tiger",
    ),
    "a face, its own mirror image": (
        lambda: fp.make_goal(photograph("smile"), objective=mirror),
        "the woman, and left and right of her face are the same",
    ),
    "mug, drawn, a blue mug": (
        lambda: fp.make_goal(sketch=drawing("mug"), text="a blue mug"),
        "the drawn mug, blue, on some ground",
    ),
    "dusk, a boat drawn on it": (
        lambda: fp.make_goal(photograph("dusk"), sketch=drawing("sailing-boat"), text="a sailing boat"),
        "the evening sky of the photograph, with the lines of the boat on it",
    ),
    "a flower in two styles": (
        lambda: fp.make_goal(photograph("flower"), style=[style("starry-night"), style("udnie")]),
        "the dahlia, in blue curls and in sharp ochre planes",
    ),
    "begun with dusk, a castle": (
        lambda: begun(fp.make_goal(text="a castle"), "image", photograph("dusk")),
        "a castle in the evening light of the photograph",
    ),
    "a lemon and a strawberry": (
        lambda: fp.make_goal(text=["a lemon", "a strawberry"]),
        "both fruits, beside each other",
    ),
}  # fmt: skip


@dataclass(frozen=True)
class Figures:
    goal: str
    wanted: str
    cpu_seconds: float


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--strokes", type=int, default=300)
    parser.add_argument("--effort", type=float, default=1.0)
    parser.add_argument("--names", nargs="+", choices=GOALS, default=list(GOALS))
    parser.add_argument("--out", type=Path, default=Path("combined"))
    options = parser.parse_args()
    prepare_process()
    strokes, effort, names = (
        (6, 0.05, options.names[:1]) if options.quick else (options.strokes, options.effort, options.names)
    )
    options.out.mkdir(parents=True, exist_ok=True)
    figures, cells = [], []
    for name in names:
        make, wanted = GOALS[name]
        file, seconds = options.out / f"{name.replace(', ', '-').replace(' ', '-')}.png", float("nan")
        if not file.exists():
            start = process_time()
            planner = fp.make_planner(make(), strokes=strokes, effort=effort)
            plan = planner.plan()
            seconds = process_time() - start
            images.save(planner.expected(plan), file)
        figures.append(Figures(name, wanted, seconds))
        print(figures[-1], flush=True)
        cells.append(Cell(images.load(file), name))
    cells.sort(key=lambda cell: cell.picture.shape[1] / cell.picture.shape[2])  # rows of equal heights
    lines = [FigureRow("", cells[first : first + ROW]) for first in range(0, len(cells), ROW)]
    images.save(page("", [""] * min(ROW, len(cells)), lines, width=300), options.out / "sheet.png")
    rows = [(one.goal, one.wanted, f"{one.cpu_seconds:.0f} s") for one in figures]
    title = f"Goals of several parts, {strokes} strokes"
    publish([Table(title, ("goal", "wanted", "CPU"), rows)], [asdict(one) for one in figures], options)


if __name__ == "__main__":
    main()
