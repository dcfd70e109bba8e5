"""Forecasts of soft pictures, with and without what another painting taught of wet paint.

    python benchmarks/wet_forecasts.py [--strokes 200] [--effort 0.5] [--seeds 0] [--out FOLDER] [--json figures.json]

Each picture is made here, planned once and painted in the virtual studio without a look. The robot stands exactly.
The wet paint of a forecast is learned from the canvas of the picture before it in the list, so each picture is held
out. A forecast is compared with the canvas as it really is. `seen differently` is the mean squared difference of the
canvas and the expected picture, times 100,000. FOLDER gets the pictures: photograph, expected without and with wet
paint, and painted, side by side.
"""

import argparse
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import mean
from tempfile import TemporaryDirectory

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter import images
from frida_painter.calibration import WetPaint
from frida_painter.lab.paintings import HAND, PLACEMENT, StudioWithout
from frida_painter.plan import Plan
from frida_painter.planning.optimize import stacked_moments
from frida_painter.planning.planner import Planner
from frida_painter.planning.wet_paint import PaintedPart, Wetness, change_by_wet_paint, learn_wet_paint
from frida_painter.runs.run import PaintingRun
from frida_painter.runs.spec import RunSpec
from frida_painter.session.events import Event, Scheduled
from frida_painter.strokes import Strokes
from measure import Table, arguments, psnr, publish

ROWS, COLUMNS = 330, 420
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


def soft_pictures(seed: int) -> dict[str, Tensor]:
    """Gradients with a little cloud, [3, 330, 420] each."""
    random = np.random.default_rng(seed)
    down, across = np.mgrid[0:ROWS, 0:COLUMNS] / np.array([ROWS - 1, COLUMNS - 1])[:, None, None]
    found = {name: graded(stops, 0.8 * down + 0.2 * across + cloud(random)) for name, stops in SKIES.items()}
    for name, ((x, y), stops) in GLOWS.items():
        far = np.hypot((across - x) * COLUMNS / ROWS, down - y)
        found[name] = graded(stops, far + cloud(random))
    return found


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
    """One painting: its planner and plan, when each stroke was to be painted, and the canvas at the end."""

    planner: Planner
    plan: Plan
    painted_at: tuple[float, ...]
    truth: Tensor
    target: Tensor

    @property
    def part(self) -> PaintedPart:
        stacked = self.planner.problems.stack(self.plan, self.planner.bare, self.planner.fine)
        return PaintedPart(*stacked, self.painted_at, self.truth, self.planner.expected(self.plan))

    def figures(self, wet: WetPaint | None) -> tuple[float, float]:
        """The forecast less what was painted, in dB, and the squared difference of canvas and expected picture."""
        wetness = None if wet is None else Wetness(wet, self.painted_at)
        forecast = self.planner.forecast(self.plan, self.planner.bare, wetness=wetness)
        assert forecast is not None
        off = float((self.planner.expected(self.plan, wetness=wetness) - self.truth).square().mean())
        return forecast.expected - psnr(float((self.truth - self.target).square().mean())), off


def paint(picture: Tensor, seed: int, settings: dict[str, object]) -> Painted:
    told: list[Scheduled] = []

    def hear(event: Event) -> None:
        if isinstance(event, Scheduled):
            told.append(event)

    with TemporaryDirectory() as folder:
        file = Path(folder, "goal.png")
        images.save(picture, file)
        spec = RunSpec.of(goal=[{"image": str(file)}], seed=seed, film=False, replans=0, **settings)
        studio = StudioWithout((PLACEMENT, HAND))
        with PaintingRun(spec, listeners=[hear]) as run:
            plan = run.plan()
            run.simulate(plan, studio.open)
            planner, grid = run.planner, run.planner.fine
        target = images.resize_by_area(images.load(file), grid.rows, grid.columns)
    return Painted(planner, plan, told[0].timetable.after, studio.truth(grid.rows), target)


def seconds(painted: Painted, wet: WetPaint | None) -> float:
    """CPU seconds of the picture of the plan and of its slopes in all strokes, on all rows."""
    part, spent = painted.part, []
    for _ in range(3):
        leaves = [{name: one.clone().requires_grad_() for name, one in each.arrays().items()} for each in part.strokes]
        strokes = [Strokes(**each) for each in leaves]
        begun = time.process_time()
        picture, variance = stacked_moments(strokes, part.problems)
        if wet is not None:
            picture = picture + change_by_wet_paint(strokes, part.problems, wet, part.painted_at)
        ((picture - painted.target).square().mean() + variance.mean()).backward()
        spent.append(time.process_time() - begun)
    return min(spent)


def keep(painted: Painted, wet: WetPaint | None, file: Path) -> None:
    wetness = None if wet is None else Wetness(wet, painted.painted_at)
    expected = painted.planner.expected(painted.plan), painted.planner.expected(painted.plan, wetness=wetness)
    images.save(torch.cat((painted.target, *expected, painted.truth), 2), file)


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--strokes", type=int, default=200)
    parser.add_argument("--effort", type=float, default=0.5)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0])
    parser.add_argument("--out", type=Path, help="where pictures of all paintings are kept")
    options: argparse.Namespace = parser.parse_args()
    settings: dict[str, object] = {"strokes": options.strokes, "effort": options.effort}
    if options.quick:
        settings = {"strokes": 12, "colors": 3, "render_height": 64, "effort": 0.05, "brushes": "broad"}
    torch.set_num_threads(1)
    rows, figures = [], {}
    for seed in options.seeds:
        pictures = list(soft_pictures(seed).items())[: 2 if options.quick else None]
        done = {name: paint(picture, seed, settings) for name, picture in pictures}
        taught = {name: learn_wet_paint([painted.part]) for name, painted in done.items()}
        names = list(done)
        for before, name in zip([names[-1], *names[:-1]], names, strict=True):
            painted, wet = done[name], taught[before]
            (dry, off), (wetter, less) = painted.figures(None), painted.figures(wet)
            if options.out is not None:
                options.out.mkdir(parents=True, exist_ok=True)
                keep(painted, wet, options.out / f"{name}-{seed}.png")
            own = taught[name]
            told = "nothing" if own is None else f"{own.rate:.0f}, {100 * own.share:.0f} %, {own.drying:.0f} s"
            figures[f"{name}, {seed}"] = {
                "dry": dry, "wet": wetter, "off dry": off, "off wet": less, "learned": own and asdict(own),
            }  # fmt: skip
            rows.append(
                (name, str(seed), f"{dry:+.2f}", f"{wetter:+.2f}", f"{1e5 * off:.1f}", f"{1e5 * less:.1f}", told)
            )
    each = figures.values()
    for way in ("dry", "wet"):
        errors = [abs(one[way]) for one in each]
        rows.append(
            (f"mean distance, {way}", "", f"{mean(errors):.2f}", "", "", "", f"{sum(e <= 0.5 for e in errors)} near")
        )
    one = done[names[0]]
    times = seconds(one, None), seconds(one, WetPaint(10.0, 0.1, 300.0))
    table = Table(
        f"Forecast less painting, dB, {len(each)} soft pictures, {len(one.plan)} strokes",
        (
            "picture", "seed", "paint dries at once", "wet paint of another painting", "seen differently",
            "with wet paint", "learned: rate per m, share, drying",
        ),
        rows,
        (f"Picture and slopes: {times[0]:.3f} s of a processor, with wet paint {times[1]:.3f} s.",),
    )  # fmt: skip
    publish([table], {"pictures": figures, "seconds": times}, options)


if __name__ == "__main__":
    main()
