"""Is the content of a photograph better seen in a painting by content than in one by pixels?

    python benchmarks/content.py [--quick] [--strokes N] [--effort X] [--freedom X ...] [--names NAME ...]
                                 [--out FOLDER] [--json FILE]

Eight photographs are planned as `paint PHOTO` and as `paint --semantic PHOTO` plan them, once for each freedom of
colours. EfficientNet-Lite1, which neither optimises nor chooses these plans, tells how far the features of each are
from those of its photograph, and how probable the class is that it sees in the photograph. The share of bare ground
that is lighter than the photograph, which shows as white gaps, is told too.
The sheet and the plans' pictures are written to FOLDER. A picture that is there already is judged, not planned again.
"""

from dataclasses import asdict, dataclass
from pathlib import Path
from time import process_time

from torch import Tensor

import frida_painter as fp
from frida_painter import images, weights
from frida_painter.devices import prepare_process
from frida_painter.lab.benchmark import suite
from frida_painter.lab.semantic import JUDGE
from frida_painter.lab.text import log_probabilities
from frida_painter.lab.trials import feature_distance, psnr
from frida_painter.objectives.encoders.classifiers import EfficientNetLite
from frida_painter.report.sheets import Cell, FigureRow, page
from measure import Table, arguments, publish

PICTURES = Path(suite.__file__).parent / "pictures"
# Chosen before anything was painted: two faces, two animals, two still lifes, two places.
NAMES = ("astronaut", "smile", "cat", "raccoon", "coffee", "fig", "temple", "peaks")
PIXELS, SIDE = "pixels", 240


@dataclass(frozen=True)
class Figures:
    photograph: str
    painted: str
    cpu_seconds: float
    features: float
    probability: float
    psnr: float
    gaps: float


def paint(name: str, freedom: float | None, strokes: int, effort: float) -> tuple[Tensor, float]:
    """Returns the picture of a plan, and the CPU seconds from its goal to the plan; by pixels without a freedom."""
    path = PICTURES / f"{name}.jpg"
    start = process_time()
    if freedom is None:
        planner = fp.make_planner(path, strokes=strokes, effort=effort)
    else:
        planner = fp.make_planner(fp.make_goal(semantic=path), strokes=strokes, effort=effort, freedom=freedom)
    plan = planner.plan()
    return planner.expected(plan), process_time() - start


def gaps(picture: Tensor, photograph: Tensor) -> float:
    """Returns the share of a picture that is almost white although the photograph is clearly darker there."""
    return float(((picture.amin(0) > 0.85) & (photograph.mean(0) < 0.7)).float().mean())


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--strokes", type=int, default=300)
    parser.add_argument("--effort", type=float, default=1.0)
    parser.add_argument("--freedom", type=float, nargs="+", default=[0.5])
    parser.add_argument("--names", nargs="+", default=NAMES)
    parser.add_argument("--out", type=Path, default=Path("content"))
    options = parser.parse_args()
    prepare_process()
    strokes, effort, names = (
        (6, 0.05, options.names[:1]) if options.quick else (options.strokes, options.effort, options.names)
    )
    judge = EfficientNetLite(weights.tensors(JUDGE))
    options.out.mkdir(parents=True, exist_ok=True)
    figures, lines = [], []
    for name in names:
        photo = images.load(PICTURES / f"{name}.jpg")
        known = log_probabilities(judge, photo).argmax()
        cells = [Cell(photo, name)]
        for freedom in (None, *options.freedom):
            way = PIXELS if freedom is None else f"content {freedom:g}"
            file, seconds = options.out / f"{name}-{way.replace(' ', '-')}.png", float("nan")
            if not file.exists():
                picture, seconds = paint(name, freedom, strokes, effort)
                images.save(picture, file)
            picture = images.load(file)
            wanted = images.fit(photo, *picture.shape[1:])
            figures.append(
                Figures(
                    name, way, seconds, feature_distance(judge, picture, wanted, SIDE),
                    float(log_probabilities(judge, picture)[known].exp()), psnr(picture, wanted), gaps(picture, wanted),
                )
            )  # fmt: skip
            print(figures[-1], flush=True)
            cells.append(Cell(picture, f"{way}: {figures[-1].features:.3f}"))
        lines.append(FigureRow("", cells))
    ways = [one.painted for one in figures[: 1 + len(options.freedom)]]
    images.save(page("", ("photograph", *ways), lines, width=300), options.out / "sheet.png")
    rows = [
        (one.photograph, one.painted, f"{one.cpu_seconds:.0f} s", f"{one.features:.3f}", f"{one.probability:.2f}",
         f"{one.psnr:.1f}", f"{100 * one.gaps:.1f} %")
        for one in figures
    ]  # fmt: skip
    distance = {(one.photograph, one.painted): one.features for one in figures}
    notes = [
        f"{way}: nearer than by pixels, or as near, in {sum(distance[n, way] <= distance[n, PIXELS] for n in names)} "
        f"of {len(names)}."
        for way in ways[1:]
    ]
    columns = ("photograph", "painted by", "CPU", "feature distance", "class of the photograph", "PSNR, dB", "gaps")
    publish([Table(f"Content, {strokes} strokes", columns, rows, notes)], [asdict(f) for f in figures], options)


if __name__ == "__main__":
    main()
