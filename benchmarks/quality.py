"""Decibels per CPU second: how good a plan is after how much computing, of this checkout and of another one.

    python benchmarks/quality.py [--against CHECKOUT] [--json figures.json] [--seeds 3] [--efforts 0.15 0.4 1 2.5]

Every plan is made in a process of its own by the code of its checkout, one thread, the two checkouts in turns.
All plans are judged here, by the same renderer at 256 rows: the picture of the plan against the photograph,
and what paintings of the plan are expected to come to, since no two marks are the same. CPU time is that of the
planner alone, without start-up. Between the efforts, decibels are interpolated along the logarithm of CPU time.
"""

import argparse
import math
import os
import statistics
import subprocess
import sys
import tempfile
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path

import numpy as np
import torch

from frida_painter.strokes import Strokes
from measure import Table, arguments, blank_problem, broad_brush, canvas_like, photograph, psnr, publish

ROOT = Path(__file__).parent.parent
PICTURES = ("astronaut", "chelsea", "coffee")
BUDGET = 10.0  # CPU seconds at which the two are compared
HERE, THERE = "this checkout", "the other one"


@dataclass(frozen=True)
class Point:
    """One plan: who made it, of what, with how much effort; CPU seconds, and PSNR in dB of picture and paintings."""

    code: str
    picture: str
    seed: int
    effort: float
    seconds: float
    drawn: float
    expected: float


def measure(code: str, checkout: Path, picture: str, seed: int, effort: float, options: argparse.Namespace) -> Point:
    """One plan made by a checkout, and what it is worth."""
    sizes = [str(number) for number in (options.strokes, options.colors, options.rows)]
    path = os.pathsep.join((str(checkout / "src"), str(checkout / "benchmarks")))
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "plan.npz"
        subprocess.run(
            [sys.executable, "-P", ROOT / "benchmarks" / "plan_once.py", file, picture, str(seed), str(effort), *sizes],
            check=True, env=os.environ | {"PYTHONPATH": path, "OMP_NUM_THREADS": "1"}, stdout=subprocess.DEVNULL,
        )  # fmt: skip
        with np.load(file) as found:
            seconds = float(found["seconds"])
            strokes = Strokes(**{name: torch.from_numpy(found[name]) for name in found.files if name != "seconds"})
    wanted = photograph(picture)
    problem, target = blank_problem(wanted, canvas_like(wanted), options.rows, broad_brush())
    with torch.no_grad():
        drawn = float((problem.render(strokes) - target).square().mean())
        expected = float(problem.expected_loss(strokes))
    return Point(code, picture, seed, effort, seconds, psnr(drawn), psnr(expected))


def at(seconds: float, points: list[Point]) -> float:
    """Expected decibels of one picture and seed after so many CPU seconds; nan outside of what was measured."""
    ordered = sorted(points, key=lambda point: point.seconds)
    times = [math.log(point.seconds) for point in ordered]
    best = np.maximum.accumulate([point.expected for point in ordered])
    return float(np.interp(math.log(seconds), times, best, left=math.nan, right=math.nan))


def needed(decibels: float, points: list[Point]) -> float:
    """CPU seconds after which a plan is expected to be that good; nan outside of what was measured."""
    ordered = sorted(points, key=lambda point: point.seconds)
    best = np.maximum.accumulate([point.expected for point in ordered])
    times = [math.log(point.seconds) for point in ordered]
    return float(np.exp(np.interp(decibels, best, times, left=math.nan, right=math.nan)))


def tables(points: list[Point], options: argparse.Namespace) -> list[Table]:
    what = f"{options.strokes} strokes, {options.rows} rows, {options.colors} paints, one layer, {options.seeds} seeds"
    codes = list(dict.fromkeys(point.code for point in points))
    rows = []
    for code, effort in product(codes, options.efforts):
        some = [point for point in points if (point.code, point.effort) == (code, effort)]
        mean = {name: statistics.fmean(getattr(one, name) for one in some) for name in ("seconds", "drawn", "expected")}
        rows.append((
            code, f"{effort:g}", f"{mean['seconds']:.1f} s", f"{mean['drawn']:.2f} dB", f"{mean['expected']:.2f} dB",
        ))  # fmt: skip
    found = [
        Table(f"Decibels and CPU seconds; {what}", ("code", "effort", "CPU", "picture", "paintings, expected"), rows)
    ]
    if len(codes) == 2:
        found.append(comparison(points, what, options))
    return found


def comparison(points: list[Point], what: str, options: argparse.Namespace) -> Table:
    """What the one gains over the other, picture by picture, the mean over seeds."""
    rows = []
    for picture in options.pictures:
        gains, shorter, before = [], [], []
        for seed in range(options.seeds):
            ours, theirs = (
                [one for one in points if (one.code, one.picture, one.seed) == (code, picture, seed)]
                for code in (HERE, THERE)
            )
            then = at(BUDGET, theirs)
            before.append(then)
            gains.append(at(BUDGET, ours) - then)
            shorter.append(needed(then, ours))
        rows.append((picture, _mean(before, "{:.2f} dB"), _mean(gains, "{:+.2f} dB"), _mean(shorter, "{:.1f} s")))
    return Table(
        f"Paintings expected after {BUDGET:g} CPU seconds; {what}",
        ("picture", "of the other one", "gain", "as good as that after"),
        rows,
    )


def _mean(numbers: list[float], shown: str) -> str:
    """The mean of those that lie inside what was measured."""
    inside = [number for number in numbers if math.isfinite(number)]
    return shown.format(statistics.fmean(inside)) if inside else "not reached"


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--against", type=Path, help="another checkout of this repository, planned with in turns")
    parser.add_argument("--pictures", nargs="+", default=PICTURES)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--efforts", nargs="+", type=float, default=(0.15, 0.4, 1.0, 2.5))
    parser.add_argument("--strokes", type=int, default=200)
    parser.add_argument("--rows", type=int, default=256)
    parser.add_argument("--colors", type=int, default=12)
    options = parser.parse_args()
    if options.quick:
        options.pictures, options.seeds, options.efforts = ("chelsea",), 1, (0.02, 0.04)
        options.strokes, options.rows, options.colors = 6, 48, 2
    torch.set_num_threads(1)
    checkouts = {HERE: ROOT} | ({THERE: options.against.resolve()} if options.against else {})
    cases = product(options.pictures, range(options.seeds), options.efforts, checkouts.items())
    points = [
        measure(code, checkout, picture, seed, effort, options) for picture, seed, effort, (code, checkout) in cases
    ]
    publish(tables(points, options), [asdict(point) for point in points], options)


if __name__ == "__main__":
    main()
