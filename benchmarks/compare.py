"""Compares this checkout with another one: quality of plans, looks of paintings, dips and minutes of the robot.

    python benchmarks/compare.py plans [--against CHECKOUT] [--seeds 0 1 2] [--efforts 0.15 0.4 1 2.5]
    python benchmarks/compare.py paintings [--against CHECKOUT] [--folder SHEETS] [--photos coffee me.jpg]
        [--seeds 0] [--strokes 200] [--replans 4]
    python benchmarks/compare.py dips [--against CHECKOUT] [--photos coffee rocket] [--seeds 0]

A photograph is one of scikit-image's by its name; for paintings, it may be a file. Each plan or painting is made in a
process of its own by the code of its checkout, one thread, the two checkouts in turns.

plans: decibels per CPU second. All plans are judged here, by the same renderer at 256 rows: the picture of the plan
against the photograph, and what paintings of the plan are expected to come to, since no two marks are the same. CPU
time is that of the planner alone, without start-up. Between the efforts, decibels are interpolated along the logarithm
of CPU time.

paintings: `frida-painter paint` with the settings of its checkout but for those that are named here, on a canvas of
14 x 11 inches. A sheet for each photograph and seed shows the photograph, the first plan and both paintings as the
camera sees them. PSNR is that of the camera's picture to the photograph, 384 pixels wide. A painting that
lies in the folder already is not made again.

dips: dips and minutes of the robot's clock without drying, with the settings of `frida-painter paint`. PSNR is that of
the virtual studio's canvas as it is, to the photograph.
"""

import argparse
import json
import math
import os
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import torch
from PIL import Image

from frida_painter import images
from frida_painter.canvas_size import CanvasSize
from frida_painter.sheet import Grid, Sheet
from frida_painter.strokes import Strokes
from measure import Table, arguments, blank_problem, broad_brush, canvas_like, photograph, psnr, publish

ROOT = Path(__file__).parent.parent
THIS, OTHER = "this", "the other"
Options = argparse.Namespace


def run_at(checkout: Path, words: Sequence[object], *folders: str) -> None:
    """Runs Python with the code of a checkout, in one thread.

    folders: of the checkout, whose modules are found besides its source
    """
    path = os.pathsep.join(str(checkout / name) for name in ("src", *folders))
    subprocess.run(
        [sys.executable, "-P", *map(str, words)],
        check=True, env=os.environ | {"PYTHONPATH": path, "OMP_NUM_THREADS": "1"}, stdout=subprocess.DEVNULL,
    )  # fmt: skip


def make_at(checkout: Path, what: str, picture: object, settings: dict[str, Any], read: Callable[[Path], Any]) -> Any:
    """Makes a plan or a painting by a checkout, and returns what `read` finds in the file of its figures."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "figures.npz"
        words = [ROOT / "benchmarks" / "at_checkout.py", what, file, picture, json.dumps(settings)]
        run_at(checkout, words, *(["benchmarks"] if what == "plan" else []))
        return read(file)


def mean(numbers: Sequence[float], shown: str) -> str:
    """The mean of those that are finite, in words."""
    inside = [number for number in numbers if math.isfinite(number)]
    return shown.format(statistics.fmean(inside)) if inside else "not reached"


# Plans: decibels per CPU second.

BUDGET = 10.0  # CPU seconds at which the two are compared


@dataclass(frozen=True)
class PlanFigures:
    """One plan: its checkout, picture, seed and effort; CPU seconds, and PSNR in dB of picture and paintings."""

    code: str
    picture: str
    seed: int
    effort: float
    seconds: float
    drawn: float
    expected: float


def judge_plan(code: str, checkout: Path, picture: str, seed: int, effort: float, options: Options) -> PlanFigures:
    """One plan made by a checkout, and what it is worth."""
    sizes = {name: getattr(options, name) for name in ("strokes", "colors", "rows")}
    found = make_at(
        checkout, "plan", picture, {**sizes, "seed": seed, "effort": effort}, lambda file: dict(np.load(file))
    )
    seconds = float(found.pop("seconds"))
    strokes = Strokes(**{name: torch.from_numpy(part) for name, part in found.items()})
    wanted = photograph(picture)
    problem, target = blank_problem(wanted, canvas_like(wanted), options.rows, broad_brush())
    with torch.no_grad():
        drawn = float((problem.render(strokes) - target).square().mean())
        expected = float(problem.expected_loss(strokes))
    return PlanFigures(code, picture, seed, effort, seconds, psnr(drawn), psnr(expected))


def best_plans(plans: Sequence[PlanFigures]) -> tuple[list[float], list[float]]:
    """Logarithms of CPU seconds of one picture and seed, and the best expected decibels until then."""
    ordered = sorted(plans, key=lambda one: one.seconds)
    best = np.maximum.accumulate([one.expected for one in ordered]).tolist()
    return [math.log(one.seconds) for one in ordered], best


def decibels_after(seconds: float, plans: Sequence[PlanFigures]) -> float:
    """Expected decibels after so many CPU seconds; nan outside of the measurements."""
    return float(np.interp(math.log(seconds), *best_plans(plans), left=math.nan, right=math.nan))


def seconds_until(decibels: float, plans: Sequence[PlanFigures]) -> float:
    """CPU seconds after which a plan is expected to be that good; nan outside of the measurements."""
    times, best = best_plans(plans)
    return float(np.exp(np.interp(decibels, best, times, left=math.nan, right=math.nan)))


def compare_plans(checkouts: dict[str, Path], options: Options) -> tuple[list[Table], list[PlanFigures]]:
    """Decibels of plans with less and more effort, and what this checkout gains, picture by picture."""
    cases = product(options.photos, options.seeds, options.efforts, checkouts.items())
    found = [judge_plan(code, checkout, *case, options) for *case, (code, checkout) in cases]
    counts = f"{options.strokes} strokes, {options.rows} rows, {options.colors} paints"
    what = f"{counts}, one layer, {len(options.seeds)} seeds"
    rows = []
    for code, effort in product(checkouts, options.efforts):
        some = [one for one in found if (one.code, one.effort) == (code, effort)]
        means = {
            name: statistics.fmean(getattr(one, name) for one in some) for name in ("seconds", "drawn", "expected")
        }
        decibels = (f"{means[name]:.2f} dB" for name in ("drawn", "expected"))
        rows.append((code, f"{effort:g}", f"{means['seconds']:.1f} s", *decibels))
    columns = ("code", "effort", "CPU", "picture", "paintings, expected")
    tables = [Table(f"Decibels and CPU seconds; {what}", columns, rows)]
    if len(checkouts) > 1:
        tables.append(compare_at_budget(found, what, options))
    return tables, found


def compare_at_budget(found: Sequence[PlanFigures], what: str, options: Options) -> Table:
    """Gain of this checkout over the other one after the same CPU seconds, the mean over seeds."""
    rows = []
    for picture in options.photos:
        gains, shorter, before = [], [], []
        for seed in options.seeds:
            ours, theirs = (
                [one for one in found if (one.code, one.picture, one.seed) == (code, picture, seed)]
                for code in (THIS, OTHER)
            )
            then = decibels_after(BUDGET, theirs)
            before.append(then)
            gains.append(decibels_after(BUDGET, ours) - then)
            shorter.append(seconds_until(then, ours))
        rows.append((picture, mean(before, "{:.2f} dB"), mean(gains, "{:+.2f} dB"), mean(shorter, "{:.1f} s")))
    columns = ("picture", "of the other one", "gain", "as good as that after")
    return Table(f"Paintings expected after {BUDGET:g} CPU seconds; {what}", columns, rows)


# Paintings side by side on sheets.

CANVAS = CanvasSize(14 * 0.0254, 11 * 0.0254)
WIDTH = 384  # pixels, of a picture in a sheet
MARGIN, HEADING = 8, 26  # pixels


@dataclass(frozen=True)
class PaintingFigures:
    """One painting: its checkout, picture and seed; PSNR of first plan and painting, CPU seconds of all processes."""

    code: str
    picture: str
    seed: int
    planned: float
    decibels: float
    cpu_seconds: float


def paint_at(checkout: Path, photo: Path, folder: Path, settings: Sequence[str]) -> float:
    """Paints it into the folder, unless it lies there; returns the CPU seconds, also those of an earlier time."""
    kept = folder.with_suffix(".seconds")
    if not kept.exists():
        shutil.rmtree(folder, ignore_errors=True)  # one that was not finished
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        run_at(checkout, ["-m", "frida_painter", "paint", photo, "--out", folder, *settings])
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        kept.write_text(str(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime))
    return float(kept.read_text())


def draw_sheet(pictures: Sequence[tuple[str, Path]], file: Path) -> None:
    """Draws pictures beside each other, each with its title."""
    shown = [(title, Image.open(path).convert("RGB")) for title, path in pictures]
    scaled = [(title, one.resize((WIDTH, round(WIDTH * one.height / one.width)))) for title, one in shown]
    height = max(one.height for _, one in scaled)
    grid = Grid(MARGIN, HEADING, len(scaled), WIDTH, height, across=MARGIN)
    page = Sheet(grid.right + MARGIN, height + HEADING + MARGIN)
    for (title, one), (left, top) in zip(scaled, grid.corners(len(scaled)), strict=True):
        page.text((left, HEADING / 2), title, 15, anchor="lm")
        page.paste(one, (left, top))
    page.image.save(file, quality=88)


def paint_side_by_side(
    name: str, seed: int, checkouts: dict[str, Path], settings: Sequence[str], folder: Path
) -> list[PaintingFigures]:
    """The paintings of one photograph and seed, and their sheet."""
    label = f"{Path(name).stem}-{seed}"
    photo = folder / f"{label}.png"
    given = images.load(Path(name)) if Path(name).is_file() else photograph(name)
    tall = given.shape[1] > given.shape[2]
    wide, high = (CANVAS.height, CANVAS.width) if tall else (CANVAS.width, CANVAS.height)
    rows = round(WIDTH * high / wide)
    target = images.fit(given, rows, WIDTH)
    images.save(images.fit(given, 3 * rows, 3 * WIDTH), photo)
    found, shown = [], [(f"{Path(name).stem}, seed {seed}", photo)]
    for code, checkout in checkouts.items():
        made = folder / code / label
        made.parent.mkdir(exist_ok=True)
        seconds = paint_at(checkout, photo, made, [*settings, "--seed", str(seed)])
        planned, decibels = (
            psnr(float((images.fit(images.load(made / picture), rows, WIDTH) - target).square().mean()))
            for picture in ("plan.png", "painting.png")
        )
        found.append(PaintingFigures(code, Path(name).stem, seed, planned, decibels, seconds))
        if code == THIS:
            shown.insert(1, (f"the first plan, {planned:.2f} dB", made / "plan.png"))
        shown.append((f"painted by {code} checkout, {decibels:.2f} dB", made / "painting.png"))
    draw_sheet(shown, folder / f"{label}.jpg")
    return found


def compare_paintings(checkouts: dict[str, Path], options: Options) -> tuple[list[Table], list[PaintingFigures]]:
    """Each painting of this checkout beside that of the other one."""
    settings = ["--canvas=14x11in", "--no-film"]
    given = {name: getattr(options, name) for name in ("strokes", "replans")}
    settings += [f"--{name}={value}" for name, value in given.items() if value is not None]
    if options.quick:
        settings += ["--colors=2", "--replans=0", "--render-height=64"]
    folder = options.folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    other_first = dict(reversed(checkouts.items()))
    cases = product(options.photos, options.seeds)
    found = [one for case in cases for one in paint_side_by_side(*case, other_first, settings, folder)]
    others = {(one.picture, one.seed): one for one in found if one.code == OTHER}
    rows, gains = [], []
    for one in (one for one in found if one.code == THIS):
        before = gain = seconds = ""
        if (other := others.get((one.picture, one.seed))) is not None:
            gains.append(one.decibels - other.decibels)
            before, gain, seconds = f"{other.decibels:.2f}", f"{gains[-1]:+.2f}", f"{other.cpu_seconds:.0f}"
        rows.append(
            (one.picture, str(one.seed), before, f"{one.decibels:.2f}", gain, seconds, f"{one.cpu_seconds:.0f}")
        )
    if gains:
        rows.append(("mean", "", "", "", mean(gains, "{:+.2f}"), "", ""))
    columns = ("picture", "seed", OTHER, THIS, "gain", f"CPU s, {OTHER}", f"CPU s, {THIS}")
    return [Table("Paintings as the camera sees them; PSNR to the photograph, dB", columns, rows)], found


# Dips and minutes of the robot.


@dataclass(frozen=True)
class DipFigures:
    """One painting: its checkout, picture and seed; dips, minutes without drying, those of film and looks, dB, CPU."""

    code: str
    picture: str
    seed: int
    strokes: int
    dips: int
    minutes: float
    looking: float
    cpu_seconds: float
    decibels: float


def count_dips(code: str, checkout: Path, picture: str, seed: int, quick: bool) -> DipFigures:
    """One painting by a checkout."""
    settings: dict[str, Any] = {"seed": seed}
    if quick:
        settings |= {"strokes": 6, "colors": 2, "replans": 0, "render_height": 64, "film": False}
    with tempfile.TemporaryDirectory() as folder:
        photo = Path(folder) / f"{picture}.png"
        images.save(photograph(picture), photo)
        found = make_at(checkout, "paint", photo, settings, lambda file: json.loads(file.read_text()))
    return DipFigures(code, picture, seed, decibels=psnr(found.pop("error")), **found)


def compare_dips(checkouts: dict[str, Path], options: Options) -> tuple[list[Table], list[DipFigures]]:
    """Every painting, and the share of dips and minutes that this checkout needs."""
    cases = product(options.photos, options.seeds, checkouts.items())
    found = [count_dips(code, checkout, *case, options.quick) for *case, (code, checkout) in cases]
    rows = [
        (
            one.picture, str(one.seed), one.code, str(one.dips), f"{one.minutes:.1f}",
            f"{one.minutes - one.looking:.1f}", f"{one.decibels:.2f} dB",
        )
        for one in found
    ]  # fmt: skip
    pairs = [
        (here, there)
        for here, there in product(found, found)
        if (here.code, there.code) == (THIS, OTHER) and (here.picture, here.seed) == (there.picture, there.seed)
    ]
    if pairs:
        painting = [(one.minutes - one.looking) / (other.minutes - other.looking) for one, other in pairs]
        rows.append((
            "mean", "", "share, gain",
            mean([one.dips / other.dips for one, other in pairs], "{:.0%}"),
            mean([one.minutes / other.minutes for one, other in pairs], "{:.0%}"),
            mean(painting, "{:.0%}"),
            mean([one.decibels - other.decibels for one, other in pairs], "{:+.2f} dB"),
        ))  # fmt: skip
    title = f"Paintings of {found[0].strokes} strokes, default settings; minutes of the robot's clock without drying"
    columns = ("picture", "seed", "code", "dips", "minutes", "without film and looks", "PSNR of the canvas")
    return [Table(title, columns, rows)], found


# Comparisons: the function of each, and the defaults of its options. QUICK replaces them in a quick run.
FOUR = ("coffee", "rocket", "astronaut", "cat")
MODES: dict[str, tuple[Callable[[dict[str, Path], Options], tuple[list[Table], Any]], dict[str, Any]]] = {
    "plans": (
        compare_plans,
        {"photos": ("astronaut", "cat", "coffee"), "seeds": (0, 1, 2), "strokes": 200, "rows": 256, "colors": 12},
    ),
    "paintings": (compare_paintings, {"photos": FOUR, "seeds": (0,)}),
    "dips": (compare_dips, {"photos": FOUR, "seeds": (0,)}),
}
QUICK: dict[str, dict[str, Any]] = {
    "plans": {"photos": ("cat",), "seeds": (0,), "efforts": (0.02, 0.04), "strokes": 6, "rows": 48, "colors": 2},
    "paintings": {"photos": ("coffee",), "seeds": (0,), "strokes": 6},
    "dips": {"photos": ("cat",), "seeds": (0,)},
}


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("what", choices=MODES, help="what is compared")
    parser.add_argument("--against", type=Path, help="another checkout of this repository")
    parser.add_argument("--photos", nargs="+", help="names of measured photographs, or files")
    parser.add_argument("--seeds", type=int, nargs="+")
    parser.add_argument("--strokes", type=int)
    parser.add_argument("--efforts", nargs="+", type=float, default=(0.15, 0.4, 1.0, 2.5), help="of plans")
    parser.add_argument("--rows", type=int, help="of plans")
    parser.add_argument("--colors", type=int, help="of plans")
    parser.add_argument("--replans", type=int, help="of paintings")
    parser.add_argument("--folder", type=Path, default=Path("side-by-side"), help="where sheets and paintings go")
    options = parser.parse_args()
    compare, defaults = MODES[options.what]
    chosen = {name: value for name, value in vars(options).items() if value is not None}
    options = Options(**{**vars(options), **defaults, **chosen, **(QUICK[options.what] if options.quick else {})})
    torch.set_num_threads(1)
    checkouts = {THIS: ROOT} | ({OTHER: options.against.resolve()} if options.against else {})
    tables, found = compare(checkouts, options)
    publish(tables, [asdict(one) for one in found], options)


if __name__ == "__main__":
    main()
