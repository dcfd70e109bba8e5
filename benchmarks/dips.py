"""Dips and minutes of the robot for a painting, and how near it comes, of this checkout and of another one.

    python benchmarks/dips.py --against CHECKOUT [--json figures.json] [--pictures coffee rocket] [--seeds 1]

Every painting is made with the settings of `frida-painter paint` in a process of its own, by the code of its checkout,
one thread, the two checkouts in turns. Minutes are those of the robot's clock without drying; PSNR in dB is that of the
virtual studio's canvas as it is, to the photograph.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path

from frida_painter import images
from measure import Table, arguments, photograph, psnr, publish

ROOT = Path(__file__).parent.parent
PICTURES = ("coffee", "rocket", "astronaut", "chelsea")
HERE, THERE = "this checkout", "the other one"


@dataclass(frozen=True)
class Figures:
    """One painting: whose code, of what; dips, minutes without drying and of them for film and looks, dB, CPU s."""

    code: str
    picture: str
    seed: int
    strokes: int
    dips: int
    minutes: float
    looking: float
    decibels: float
    cpu_seconds: float


def measure(code: str, checkout: Path, picture: str, seed: int, quick: bool) -> Figures:
    """One painting by a checkout."""
    settings = {"seed": seed}
    if quick:
        settings |= {"strokes": 6, "colors": 2, "replans": 0, "render_height": 64, "timelapse_frames": 0}
    with tempfile.TemporaryDirectory() as folder:
        photo, file = Path(folder) / f"{picture}.png", Path(folder) / "figures.json"
        images.save(photograph(picture), photo)
        subprocess.run(
            [sys.executable, "-P", ROOT / "benchmarks" / "paint_once.py", file, photo, json.dumps(settings)],
            check=True,
            env=os.environ | {"PYTHONPATH": str(checkout / "src"), "OMP_NUM_THREADS": "1"},
            stdout=subprocess.DEVNULL,
        )
        found = json.loads(file.read_text())
    foreseen = found["foreseen"]
    minutes = (found["robot_seconds"] - foreseen["drying"]) / 60
    return Figures(
        code, picture, seed, found["strokes"], found["dips"], minutes, foreseen["looks"] / 60, psnr(found["error"]),
        found["cpu_seconds"],
    )  # fmt: skip


def table(found: list[Figures]) -> Table:
    """Every painting, and what those of this checkout need of what the others do."""
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
        if (here.code, there.code) == (HERE, THERE) and (here.picture, here.seed) == (there.picture, there.seed)
    ]
    if pairs:
        painting = [(one.minutes - one.looking) / (other.minutes - other.looking) for one, other in pairs]
        rows.append((
            "mean", "", "share, gain",
            f"{statistics.fmean(one.dips / other.dips for one, other in pairs):.0%}",
            f"{statistics.fmean(one.minutes / other.minutes for one, other in pairs):.0%}",
            f"{statistics.fmean(painting):.0%}",
            f"{statistics.fmean(one.decibels - other.decibels for one, other in pairs):+.2f} dB",
        ))  # fmt: skip
    strokes = found[0].strokes
    return Table(
        f"Paintings of {strokes} strokes, default settings; minutes of the robot's clock without drying",
        ("picture", "seed", "code", "dips", "minutes", "without film and looks", "PSNR of the canvas"),
        rows,
    )


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--against", type=Path, help="another checkout of this repository, painted with in turns")
    parser.add_argument("--pictures", nargs="+", default=PICTURES)
    parser.add_argument("--seeds", type=int, default=1)
    options: argparse.Namespace = parser.parse_args()
    if options.quick:
        options.pictures, options.seeds = ("chelsea",), 1
    checkouts = {HERE: ROOT} | ({THERE: options.against.resolve()} if options.against else {})
    found = [
        measure(code, checkout, picture, seed, options.quick)
        for picture, seed, (code, checkout) in product(options.pictures, range(options.seeds), checkouts.items())
    ]
    publish([table(found)], [asdict(one) for one in found], options)


if __name__ == "__main__":
    main()
