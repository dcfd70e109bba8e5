"""Paintings of this checkout and of another one, side by side: a sheet of pictures for each, and figures.

    python benchmarks/side_by_side.py --against CHECKOUT --folder SHEETS [--photos coffee me.jpg] [--seeds 0 1]
        [--strokes 200] [--replans 4] [--json figures.json]

A photograph is one of the measured ones by its name, or a file. Each is painted by `frida-painter paint` in a process
of its own, with the settings of its checkout but for those that are named here, on a canvas of 14 x 11 inches. A sheet
shows the photograph, the first plan and both paintings as the camera sees them. PSNR is that of the camera's picture to
the photograph, 384 pixels wide. Paintings that lie in the folder already are not painted again.
"""

import argparse
import os
import resource
import shutil
import statistics
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path

from PIL import Image

from frida_painter import images
from frida_painter.canvas_size import CanvasSize
from frida_painter.sheet import Sheet
from measure import Table, arguments, photograph, psnr, publish

ROOT = Path(__file__).parent.parent
PICTURES = ("coffee", "rocket", "astronaut", "chelsea")
CANVAS = CanvasSize(14 * 0.0254, 11 * 0.0254)
WIDTH = 384  # pixels, of a picture in a sheet
THIS, OTHER = "this", "the other"
MARGIN, HEADING = 8, 26  # pixels


@dataclass(frozen=True)
class Figures:
    """One painting: whose code, of what; PSNR of its first plan and of the painting, CPU seconds of all processes."""

    code: str
    picture: str
    seed: int
    planned: float
    decibels: float
    cpu_seconds: float


def painted(checkout: Path, photo: Path, folder: Path, settings: Sequence[str]) -> float:
    """Paints it into the folder, unless it lies there; returns the CPU seconds, also those of an earlier time."""
    kept = folder.with_suffix(".seconds")
    if not kept.exists():
        shutil.rmtree(folder, ignore_errors=True)  # one that was not finished
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(
            [sys.executable, "-P", "-m", "frida_painter", "paint", photo, "--out", folder, *settings],
            check=True,
            env=os.environ | {"PYTHONPATH": str(checkout / "src"), "OMP_NUM_THREADS": "1"},
            stdout=subprocess.DEVNULL,
        )
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        kept.write_text(str(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime))
    return float(kept.read_text())


def sheet(pictures: Sequence[tuple[str, Path]], file: Path) -> None:
    """Pictures beside each other, each with its title."""
    shown = [(title, Image.open(path).convert("RGB")) for title, path in pictures]
    scaled = [(title, one.resize((WIDTH, round(WIDTH * one.height / one.width)))) for title, one in shown]
    height = max(one.height for _, one in scaled)
    page = Sheet((WIDTH + MARGIN) * len(scaled) + MARGIN, height + HEADING + MARGIN)
    for number, (title, one) in enumerate(scaled):
        left = MARGIN + number * (WIDTH + MARGIN)
        page.text((left, HEADING / 2), title, 15, anchor="lm")
        page.paste(one, (left, HEADING))
    page.image.save(file, quality=88)


def compare(name: str, seed: int, checkouts: dict[str, Path], folder: Path, settings: Sequence[str]) -> list[Figures]:
    """Both paintings of one photograph and seed, and their sheet."""
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
        seconds = painted(checkout, photo, made, [*settings, "--seed", str(seed)])
        planned, decibels = (
            psnr(float((images.fit(images.load(made / picture), rows, WIDTH) - target).square().mean()))
            for picture in ("plan.png", "painting.png")
        )
        found.append(Figures(code, Path(name).stem, seed, planned, decibels, seconds))
        if code == THIS:
            shown.insert(1, (f"the first plan, {planned:.2f} dB", made / "plan.png"))
        shown.append((f"painted by {code} checkout, {decibels:.2f} dB", made / "painting.png"))
    sheet(shown, folder / f"{label}.jpg")
    return found


def table(found: Sequence[Figures]) -> Table:
    """Each painting of this checkout beside that of the other one."""
    rows, gains = [], []
    others = {(one.picture, one.seed): one for one in found if one.code != THIS}
    for one in found:
        if one.code != THIS:
            continue
        other = others.get((one.picture, one.seed))
        if other is None:
            before, gain, seconds = "", "", ""
        else:
            gains.append(one.decibels - other.decibels)
            before, gain, seconds = f"{other.decibels:.2f}", f"{gains[-1]:+.2f}", f"{other.cpu_seconds:.0f}"
        rows.append(
            (one.picture, str(one.seed), before, f"{one.decibels:.2f}", gain, seconds, f"{one.cpu_seconds:.0f}")
        )
    if gains:
        rows.append(("mean", "", "", "", f"{statistics.fmean(gains):+.2f}", "", ""))
    return Table(
        "Paintings as the camera sees them; PSNR to the photograph, dB",
        ("picture", "seed", OTHER, THIS, "gain", f"CPU s, {OTHER}", f"CPU s, {THIS}"),
        rows,
    )


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--against", type=Path, help="another checkout of this repository")
    parser.add_argument("--photos", nargs="+", default=PICTURES, help="names of measured photographs, or files")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0])
    parser.add_argument("--folder", type=Path, default=Path("side-by-side"), help="where sheets and paintings go")
    parser.add_argument("--strokes", type=int)
    parser.add_argument("--replans", type=int)
    options: argparse.Namespace = parser.parse_args()
    settings = ["--canvas=14x11in", "--no-film"]
    settings += [
        f"--{name}={value}" for name in ("strokes", "replans") if (value := getattr(options, name)) is not None
    ]
    if options.quick:
        settings += ["--strokes=6", "--colors=2", "--replans=0", "--render-height=64"]
        options.photos = options.photos[:1]
    options.folder.mkdir(parents=True, exist_ok=True)
    checkouts = ({OTHER: options.against.resolve()} if options.against else {}) | {THIS: ROOT}
    found = [
        figures
        for photo, seed in product(options.photos, options.seeds)
        for figures in compare(photo, seed, checkouts, options.folder.resolve(), settings)
    ]
    publish([table(found)], [asdict(one) for one in found], options)


if __name__ == "__main__":
    main()
