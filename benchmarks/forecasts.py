"""Forecasts beside what was painted: how near the default painting comes to its photograph, and what was promised.

    python benchmarks/forecasts.py PICTURES [--seeds 31 5] [--kept FOLDER] [--processes 2] [--json figures.json]

PICTURES is a folder of photographs. Each is painted with the settings of `frida-painter paint` in the virtual studio,
by one thread. The first forecast is that of the first plan, the last one that of the last plan; both are PSNR in dB at
the planner's resolution. They are compared with the camera's picture of the finished painting and with the canvas as it
really is; camera's picture and photograph are averaged over the areas of the planner's pixels. FOLDER keeps the figures
of each painting; what lies there is not painted again.
"""

import argparse
import json
import os
import statistics
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from functools import partial
from itertools import product
from multiprocessing import get_context
from pathlib import Path

import torch
from torch import Tensor

from frida_painter import images, storage
from frida_painter.lab.paintings import StudioWithout
from frida_painter.palette import to_hex
from frida_painter.planning.forecast import SimilarityForecast
from frida_painter.runs.run import PaintingRun
from frida_painter.runs.spec import RunSpec
from frida_painter.session.events import Event, Planned
from measure import Table, arguments, psnr, publish

NEAR = 0.5  # dB
WANTED_SHARE, WANTED_BIAS, WANTED_IN_RANGE = 0.9, 0.2, 0.8
PICTURES = (".png", ".jpg", ".jpeg")
QUICK = {"strokes": 12, "colors": 3, "replans": 1, "render_height": 64, "effort": 0.05, "brushes": "broad"}


@dataclass(frozen=True)
class Figures:
    """One painting: its ground, first and last forecast (expected, least, most dB), dB by camera and of the canvas."""

    picture: str
    seed: int
    ground: str
    first: tuple[float, float, float]
    last: tuple[float, float, float]
    by_camera: float
    in_truth: float
    cpu_seconds: float


def paint(given: tuple[Path, int], settings: dict[str, object], kept: Path | None) -> Figures:
    """Paints a picture with a seed, unless its figures lie in the folder."""
    picture, seed = given
    file = None if kept is None else kept / f"{picture.stem}-{seed}.json"
    if file is not None and file.exists():
        return Figures(**json.loads(file.read_text()))
    torch.set_num_threads(1)
    told: list[SimilarityForecast] = []

    def hear(event: Event) -> None:
        if isinstance(event, Planned) and event.forecast is not None:
            told.append(event.forecast)

    studio, begun = StudioWithout(), time.process_time()
    spec = RunSpec.of(goal=[{"image": str(picture)}], seed=seed, film=False, **settings)
    with PaintingRun(spec, listeners=[hear]) as run:
        painting = run.simulate(opener=studio.open)
        grid, ground = run.planner.fine, to_hex(torch.tensor(run.planner.ground))
    wanted = images.resize_by_area(images.load(picture), grid.rows, grid.columns)
    found = Figures(
        picture.stem,
        seed,
        ground,
        (told[0].expected, told[0].least, told[0].most),
        (told[-1].expected, told[-1].least, told[-1].most),
        _decibels(images.resize_by_area(painting.photograph, grid.rows, grid.columns), wanted),
        _decibels(studio.truth(grid.rows), wanted),
        time.process_time() - begun,
    )
    if file is not None:
        storage.write_text(file, json.dumps(asdict(found)))
    return found


def _decibels(picture: Tensor, wanted: Tensor) -> float:
    return psnr(float((picture - wanted).square().mean()))


def every_painting(found: Sequence[Figures]) -> Table:
    """What was promised of each painting, and what came of it."""
    return Table(
        "Forecasts of default paintings, PSNR at the planner's resolution, dB",
        ("picture", "seed", "ground", "first forecast", "last forecast", "by camera", "in truth"),
        [
            (
                one.picture,
                str(one.seed),
                one.ground,
                f"{one.first[0]:.2f} ({one.first[1]:.1f} to {one.first[2]:.1f})",
                f"{one.last[0]:.2f} ({one.last[1]:.1f} to {one.last[2]:.1f})",
                f"{one.by_camera:.2f}",
                f"{one.in_truth:.2f}",
            )
            for one in found
        ],
    )


def how_true(found: Sequence[Figures]) -> Table:
    """How far forecasts were from paintings, and how often within what was promised."""
    rows = []
    for forecast, (name, painted) in product(("first", "last"), (("camera", "by_camera"), ("truth", "in_truth"))):
        told = [getattr(one, forecast) for one in found]
        came = [getattr(one, painted) for one in found]
        errors = [expected - value for (expected, _, _), value in zip(told, came, strict=True)]
        inside = [least <= value <= most for (_, least, most), value in zip(told, came, strict=True)]
        rows.append(
            (
                forecast,
                name,
                f"{statistics.fmean(errors):+.2f}",
                f"{statistics.pstdev(errors):.2f}",
                f"{max(errors, key=abs):+.2f}",
                f"{statistics.fmean(abs(error) <= NEAR for error in errors):.0%}",
                f"{statistics.fmean(inside):.0%}",
                f"{statistics.fmean(most - least for _, least, most in told) / 2:.2f}",
            )
        )
    wanted = ("wanted", "", f"{WANTED_BIAS:.2f} at most", "", "", f"{WANTED_SHARE:.0%}", f"{WANTED_IN_RANGE:.0%}", "")
    return Table(
        f"{len(found)} paintings: forecast less painting, dB",
        ("forecast", "painting by", "mean", "deviation", "worst", f"within {NEAR}", "in its range", "half a range"),
        [*rows, wanted],
    )


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("pictures", type=Path, help="a folder of photographs")
    parser.add_argument("--seeds", type=int, nargs="+", default=[31, 5])
    parser.add_argument("--kept", type=Path, help="where the figures of each painting are kept, and found again")
    parser.add_argument("--processes", type=int, default=1, help="paintings at a time")
    options: argparse.Namespace = parser.parse_args()
    pictures = sorted(file for file in options.pictures.iterdir() if file.suffix.lower() in PICTURES)
    if options.quick:
        pictures, options.seeds = pictures[:1], options.seeds[:1]
    if not pictures:
        parser.error(f"{options.pictures} holds no pictures ({', '.join(PICTURES)})")
    if options.kept is not None:
        options.kept.mkdir(parents=True, exist_ok=True)
    os.environ |= {"OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}  # of the processes to come
    work = partial(paint, settings=QUICK if options.quick else {}, kept=options.kept)
    todo = [(picture, seed) for seed, picture in product(options.seeds, pictures)]
    with ProcessPoolExecutor(options.processes, get_context("spawn")) as pool:
        found = list(pool.map(work, todo))
    publish([every_painting(found), how_true(found)], [asdict(one) for one in found], options)


if __name__ == "__main__":
    main()
