"""Loss of a painting by the errors of the hand: of placement, and of height in every stroke.

    python benchmarks/hand.py [--json figures.json] marks [--brushes broad medium fine] [--count 24]
    python benchmarks/hand.py [--json figures.json] paintings [--pictures dunes coffee] [--strokes 100] [--studios 3]
        [--height-errors 0.025 0] [--effort 1] [--brushes ""] [--canvas 14x11in]

marks: straight strokes of random length, painted alone by the hand of the virtual studio and by one that is exact in
height. Their painted area, as a share of the stroke model's, shows lost strokes.

paintings: one plan of each picture (of `tilt.py`, of the suite, or a file), painted in studios that differ in their
seed: as the robot stands there, and with its placement known, by hands with these errors of height (standard
deviation, as a share of a full press; that of the studio is 0.025). PSNR of the true canvas.
"""

import argparse
from functools import partial
from pathlib import Path
from statistics import mean
from tempfile import TemporaryDirectory

import numpy as np
import torch
from torch import Tensor

from frida_painter import images
from frida_painter.brush.kinds import brush_kind
from frida_painter.brush.weights import load_stroke_model
from frida_painter.frames import PixelGrid
from frida_painter.lab.benchmark.suite import find_goal
from frida_painter.lab.paintings import PLACEMENT, Imperfection, StudioWithout
from frida_painter.plan import Plan
from frida_painter.render import render
from frida_painter.runs.run import PaintingRun
from frida_painter.runs.spec import RunSpec
from frida_painter.strokes import Strokes
from frida_painter.virtual.tabletop import HandNoise
from measure import Table, arguments, psnr, publish
from tilt import CANVAS, PICTURES, START, lay, open_another

USUAL = HandNoise()
THICKNESSES = (0.0, 0.02, 0.05, 0.09, 0.15, 0.3, 0.6)
LIGHT = 0.09  # thickness below which a stroke counts as light
LOST = 0.5  # share of the expected paint below which a stroke counts as lost
PLACED = "as it stands"


def main() -> None:
    parser = arguments(__doc__)
    ways = parser.add_subparsers(dest="way", required=True)
    marks = ways.add_parser("marks")
    marks.add_argument("--brushes", nargs="+", default=["broad", "medium", "fine"])
    marks.add_argument("--count", type=int, default=24)
    paintings = ways.add_parser("paintings")
    paintings.add_argument("--pictures", nargs="+", default=["dunes", "coffee", "rocket"])
    paintings.add_argument("--strokes", type=int, default=100)
    paintings.add_argument("--studios", type=int, default=3)
    paintings.add_argument("--height-errors", type=float, nargs="+", default=[USUAL.depth, 0.0])
    paintings.add_argument("--effort", type=float, default=1.0)
    paintings.add_argument("--brushes", default="")
    paintings.add_argument("--canvas", default="14x11in")
    options = parser.parse_args()
    torch.set_num_threads(1)
    {"marks": judge_marks, "paintings": judge_paintings}[options.way](options)


def judge_marks(options: argparse.Namespace) -> None:
    rows, figures = [], {}
    for brush in options.brushes[:1] if options.quick else options.brushes:
        for thickness in THICKNESSES[:2] if options.quick else THICKNESSES:
            for name, depth in (("the studio's", USUAL.depth), ("exact", 0.0)):
                share = painted_shares(brush, thickness, depth, 2 if options.quick else options.count)
                figures[f"{brush}, {thickness}, {name}"] = share.tolist()
                numbers = (float(share.mean()), float(share.std()), float(share.min()))
                lost = int((share < LOST).sum())
                rows.append((brush, f"{thickness:.2f}", name, *(f"{number:.2f}" for number in numbers), str(lost)))
    columns = ("brush", "thickness", "height of the hand", "painted area", "deviation", "least", f"below {LOST}")
    publish(
        [Table(f"Painted area of {options.count} strokes, as a share of the expected", columns, rows)], figures, options
    )


def painted_shares(brush: str, thickness: float, depth: float, count: int) -> Tensor:
    """Returns the painted area [count] of strokes of that thickness, as a share of the stroke model's."""
    limits, model, chance = brush_kind(brush).limits, load_stroke_model(brush), np.random.default_rng(5)
    hand, shares = HandNoise(USUAL.place, depth), []
    for number in range(count):
        length = chance.uniform(*limits.length)
        stroke = Strokes.from_array([[*START, 0, length, 0, thickness, 0, 0, 0]])
        seen = lay(brush, stroke, 100 + number, hand)
        with torch.no_grad():
            expected = 1 - render(stroke.to(torch.float32), model, torch.ones(3, *seen.shape), CANVAS)[0]
        shares.append(((1 - seen) / (1 - seen.min())).clamp(0, 1).sum() / expected.sum())
    return torch.stack(shares)


def judge_paintings(options: argparse.Namespace) -> None:
    ways = {PLACED: ()} | {f"{error:g}": (PLACEMENT, with_height_error(error)) for error in options.height_errors}
    rows, figures = [], {}
    for name in options.pictures[:1] if options.quick else options.pictures:
        with TemporaryDirectory() as folder:
            spec = describe(name, Path(folder) / "picture.png", options)
            with PaintingRun(spec) as run:
                plan = run.plan()
                foretold = run.planner.forecast(plan, run.planner.bare)
            assert foretold is not None
            light = int((plan.strokes.thickness < LIGHT).sum())
            for studio in range(1 if options.quick else options.studios):
                found = {way: paint(spec, plan, studio, without) for way, without in ways.items()}
                figures[f"{name}, {studio}"] = {"forecast": foretold.expected, "light": light, **found}
                shown = (f"{value:.2f}" for value in found.values())
                rows.append((name, f"{light} of {len(plan)}", f"{foretold.expected:.2f}", str(studio), *shown))
    means = (f"{mean(one[way] for one in figures.values()):.3f}" for way in ways)
    rows.append(("mean", "", f"{mean(one['forecast'] for one in figures.values()):.3f}", "", *means))
    columns = (
        "picture",
        f"strokes below {LIGHT}",
        "forecast",
        "studio",
        PLACED,
        *(f"placed, {way}" for way in list(ways)[1:]),
    )
    publish([Table(f"PSNR in dB of {options.strokes} strokes, no looks", columns, rows)], figures, options)


def with_height_error(depth: float) -> Imperfection:
    """Returns the studio's hand with another error of height."""
    return Imperfection("height error", {"noise": HandNoise(USUAL.place, depth)})


def describe(name: str, file: Path, options: argparse.Namespace) -> RunSpec:
    """Returns the painting of a picture, which is written to the file."""
    given = (
        PICTURES[name]()
        if name in PICTURES
        else images.load(name)
        if Path(name).exists()
        else find_goal(name, Path()).picture
    )
    assert given is not None
    images.save(given, file)
    brushes = {"brushes": options.brushes} if options.brushes else {}
    quick = {"effort": 0.05, "render_height": 64, "colors": 3} if options.quick else {"effort": options.effort}
    strokes = 14 if options.quick else options.strokes
    spec = RunSpec.of(
        goal=[{"image": str(file)}], strokes=strokes, canvas=options.canvas, film=False, replans=0, **brushes, **quick
    )
    return spec.with_values(canvas=spec.canvas.orient_like(*given.shape[1:]))


def paint(spec: RunSpec, plan: Plan, number: int, without: tuple[Imperfection, ...]) -> float:
    """Returns the PSNR of the true canvas after the plan in a studio of another seed."""
    studio = StudioWithout(without)
    with PaintingRun(spec) as run:
        run.simulate(plan, partial(open_another, studio, number))
        assert run.target is not None
        grid: PixelGrid = run.planner.fine
        wanted = images.fit(run.target, 2 * grid.rows, 2 * grid.columns)
    truth = images.fit(studio.truth(2 * grid.rows), *wanted.shape[1:])
    seen, wanted = (images.resize_by_area(one, grid.rows, grid.columns) for one in (truth, wanted))
    return psnr(float((seen - wanted).square().mean()))


if __name__ == "__main__":
    main()
