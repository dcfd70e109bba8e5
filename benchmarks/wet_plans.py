"""Soft pictures planned for paint that dries at once, and for the wet paint that another painting taught.

    python benchmarks/wet_plans.py [--pictures dawn cheek] [--looks 0] [--seeds 0] [--out FOLDER] [--json figures.json]

First `dusk` is painted in the virtual studio, and its photographs teach how paint mixes, as they do after a painting on
a calibration record. Then each picture is painted twice at equal strokes: with a record by which paint dries at once,
and with the taught one. Both plans get the same iterations. With `--looks 0` the robot always paints without an error
of placement; otherwise it stands as the studio places it, looks and replans.

The perceptual distance is that of the benchmark (lab/benchmark/judges.py). The forecast is of the first
plan with the placement known, less what was painted. FOLDER gets, for each picture: the picture, and both paintings.
"""

import argparse
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import mean
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter import images
from frida_painter.calibration import Calibration, WetPaint
from frida_painter.canvas_size import CanvasSize
from frida_painter.lab.benchmark.judges import PERCEPTUAL, PSNR, Judges
from frida_painter.lab.benchmark.suite import find_goal
from frida_painter.lab.paintings import HAND, PLACEMENT, StudioWithout
from frida_painter.planning.wet_paint import Wetness
from frida_painter.runs.run import PaintingRun
from frida_painter.runs.spec import RunSpec
from frida_painter.session.events import Event, Planned, Scheduled
from frida_painter.virtual.studio import open_studio
from measure import Table, arguments, psnr, publish

ROWS, COLUMNS = 330, 420
PAINTED_ROWS = 320
Stops = Sequence[tuple[float, str]]
SKIES: dict[str, Stops] = {
    "dawn": ((0, "394b7a"), (0.4, "8f7fa8"), (0.7, "e8a68a"), (1, "f8e3b0")),
    "lake": ((0, "2b5f8f"), (0.5, "9fd0d8"), (0.52, "6fb0b8"), (1, "123a4f")),
    "dusk": ((0, "1d2f5e"), (0.45, "5b6ea8"), (0.75, "d9a48f"), (1, "f2d9a8")),
}
GLOWS: dict[str, tuple[tuple[float, float], Stops]] = {
    "moon": ((0.35, 0.3), ((0, "f3efd8"), (0.06, "d8d8cf"), (0.14, "7d93ad"), (0.4, "2f4a74"), (1, "121c38"))),
    "sunset": ((0.62, 0.72), ((0, "fff3c4"), (0.12, "fbc96b"), (0.35, "e57f4a"), (0.7, "8a4668"), (1.1, "2c2a52"))),
    "peach": ((0.45, 0.42), ((0, "fbe0a8"), (0.2, "eb9a55"), (0.45, "b8502e"), (0.8, "5a1f1a"), (1.1, "2f2448"))),
}
PHOTOGRAPHS: dict[str, tuple[str, tuple[slice, slice]]] = {  # of the suite, and the rows and columns that are painted
    "mountains": ("dusk", (slice(None), slice(None))),
    "cheek": ("smile", (slice(225, 397), slice(70, 290))),
}
TEACHER = "dusk"
SIX = ("dawn", "peach", "lake", "sunset", "mountains", "cheek")
CANVAS = CanvasSize(0.16, 0.125)
AT_ONCE = WetPaint(rate=0.0, share=0.0, drying=300.0)
OFF, SECONDS = "forecast less painting, dB", "CPU s"
SHOWN = {PSNR: ".2f", PERCEPTUAL: ".3f", OFF: "+.2f", SECONDS: ".0f"}
Figures = Mapping[str, float]


def soft_picture(name: str, seed: int) -> Tensor:
    """A gradient with a little cloud, [3, 330, 420], or a part of a photograph."""
    if name in PHOTOGRAPHS:
        of, (rows, columns) = PHOTOGRAPHS[name]
        picture = find_goal(of, Path()).picture
        assert picture is not None
        return picture[:, rows, columns]
    number = [*SKIES, *GLOWS].index(name)
    random = np.random.default_rng((seed, number))
    down, across = np.mgrid[0:ROWS, 0:COLUMNS] / np.array([ROWS - 1, COLUMNS - 1])[:, None, None]
    if name in SKIES:
        return graded(SKIES[name], 0.8 * down + 0.2 * across + cloud(random))
    (x, y), stops = GLOWS[name]
    return graded(stops, np.hypot((across - x) * COLUMNS / ROWS, down - y) + cloud(random))


def graded(stops: Stops, place: NDArray[np.float64]) -> Tensor:
    colors = np.array([[int(code[at : at + 2], 16) / 255 for at in (0, 2, 4)] for _, code in stops])
    bands = [np.interp(place, [stop for stop, _ in stops], colors[:, band]) for band in range(3)]
    return torch.from_numpy(np.stack(bands)).float()


def cloud(random: np.random.Generator) -> NDArray[np.float64]:
    rows, columns = np.fft.fftfreq(ROWS)[:, None] * ROWS, np.fft.fftfreq(COLUMNS)[None] * COLUMNS
    frequency = np.hypot(rows, columns)
    frequency[0, 0] = 1
    field = np.fft.ifft2(np.fft.fft2(random.standard_normal((ROWS, COLUMNS))) / frequency**1.3).real
    return np.asarray(0.025 * (field - field.mean()) / field.std())


@dataclass(frozen=True)
class Painted:
    """A painting: its description with the chosen ground, figures, picture, and the true canvas [3, h, w]."""

    spec: RunSpec
    figures: Figures
    target: Tensor
    truth: Tensor


@dataclass(frozen=True)
class Workshop:
    """A folder with the record of an easel, and how pictures are painted on it."""

    folder: Path
    settings: dict[str, Any]
    looks: int

    @property
    def record(self) -> Path:
        return self.folder / "calibration.json"

    def describe(self, name: str, seed: int) -> RunSpec:
        file = self.folder / f"{name}-{seed}.png"
        images.save(soft_picture(name, seed), file)
        return RunSpec.of(
            goal=[{"image": str(file)}], seed=seed, film=False, canvas=CANVAS, calibration=self.record,
            replans=self.looks, **self.settings,
        )  # fmt: skip

    def studio(self) -> StudioWithout:
        return StudioWithout(() if self.looks else (PLACEMENT, HAND))

    def teach(self, seed: int) -> tuple[Calibration, WetPaint | None]:
        """Paints the teacher; returns the record before it, and what a person's record would keep of it."""
        spec = self.describe(TEACHER, seed)
        before = open_studio(CANVAS, spec.brush_names[0], seed=seed).easel.calibration
        before.save(self.record)
        with PaintingRun(spec) as run:
            run.simulate(opener=self.studio().open)
            assert run.session is not None
            wet = run.session.learn_wet_paint()
        return before, wet

    def paint(self, spec: RunSpec, record: Calibration) -> Painted:
        record.save(self.record)
        plans: list[Planned] = []
        tables: list[Scheduled] = []

        def hear(event: Event) -> None:
            if isinstance(event, Planned):
                plans.append(event)
            elif isinstance(event, Scheduled):
                tables.append(event)

        studio = self.studio()
        begun = time.process_time()
        with PaintingRun(spec, listeners=[hear]) as run:
            run.simulate(opener=studio.open)
            assert run.target is not None
            planner, grid, settled = run.planner, run.planner.fine, run.spec
            target = images.fit(run.target, PAINTED_ROWS, round(PAINTED_ROWS * grid.columns / grid.rows))
        seconds = time.process_time() - begun
        truth = images.fit(studio.truth(PAINTED_ROWS), *target.shape[1:])
        seen, wanted = (images.resize_by_area(one, grid.rows, grid.columns) for one in (truth, target))
        wetness = None if record.wet is None else Wetness(record.wet, tables[0].timetable.after)
        foretold = planner.forecast(plans[0].plan, planner.bare, wetness=wetness)
        assert foretold is not None
        off = foretold.expected - psnr(float((seen - wanted).square().mean()))
        judged = Judges.open().of_picture(truth, target)
        return Painted(settled, {**judged, OFF: off, SECONDS: seconds}, target, truth)


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--pictures", nargs="+", choices=(*SKIES, *GLOWS, *PHOTOGRAPHS), default=list(SIX))
    parser.add_argument("--strokes", type=int, default=100)
    parser.add_argument("--effort", type=float, default=0.2)
    parser.add_argument("--looks", type=int, default=0)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0])
    parser.add_argument("--out", type=Path, help="takes a sheet of each picture")
    options: argparse.Namespace = parser.parse_args()
    settings: dict[str, Any] = {
        "strokes": options.strokes, "effort": options.effort, "render_height": 112, "brushes": "broad:50%,medium:50%",
    }  # fmt: skip
    if options.quick:
        settings |= {"strokes": 40, "colors": 4, "render_height": 64, "effort": 0.05, "brushes": "broad"}
        settings |= {"ground": "white"}
        options.pictures = options.pictures[-1:]
    torch.set_num_threads(1)
    rows: list[tuple[str, ...]] = []
    figures: dict[str, tuple[Figures, Figures]] = {}
    notes = []
    for seed in options.seeds:
        with TemporaryDirectory() as folder:
            workshop = Workshop(Path(folder), settings, options.looks)
            bare, wet = workshop.teach(seed)
            if wet is None and not options.quick:
                raise SystemExit(f"The painting of {TEACHER} taught nothing of wet paint; give it more --strokes.")
            wet = wet or AT_ONCE  # a quick painting may be too small to teach
            notes.append(f"Taught with seed {seed}: {wet.rate:.0f} per m, {100 * wet.share:.0f} %, {wet.drying:.0f} s.")
            for name in options.pictures:
                spec = workshop.describe(name, seed)
                dry = workshop.paint(spec, replace(bare, wet=AT_ONCE))
                wetter = workshop.paint(dry.spec, replace(bare, wet=wet))
                figures[f"{name}, {seed}"] = dry.figures, wetter.figures
                rows.append((name, str(seed), *beside(dry.figures, wetter.figures)))
                if options.out is not None:
                    options.out.mkdir(parents=True, exist_ok=True)
                    images.save(torch.cat((dry.target, dry.truth, wetter.truth), 2), options.out / f"{name}-{seed}.png")
    means = [{key: mean(pair[way][key] for pair in figures.values()) for key in dry.figures} for way in (0, 1)]
    rows.append(("mean", "", *beside(*means)))
    near = [sum(abs(pair[way][OFF]) <= 0.5 for pair in figures.values()) for way in (0, 1)]
    notes.append(f"Forecasts within 0.5 dB: {near[0]} and {near[1]} of {len(figures)}.")
    names = ("PSNR, dB", "perceptual", "forecast", "CPU s")
    table = Table(
        f"Soft pictures, {options.strokes} strokes, {options.looks} looks: paint dries at once, and wet paint is known",
        ("picture", "seed", *(f"{what}: {way}" for what in names for way in ("dry", "wet")), "perceptual"),
        rows,
        notes,
    )
    publish([table], figures, options)


def beside(dry: Figures, wet: Figures) -> tuple[str, ...]:
    """The cells of a row."""
    more = f"{100 * (wet[PERCEPTUAL] / dry[PERCEPTUAL] - 1):+.1f} %" if PERCEPTUAL in dry else ""
    return (*(f"{one[what]:{form}}" if what in one else "" for what, form in SHOWN.items() for one in (dry, wet)), more)


if __name__ == "__main__":
    main()
