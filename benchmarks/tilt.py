"""Gain of a tilted brush, and the error of its marks.

    python benchmarks/tilt.py marks [--brushes broad medium fine] [--count 40] [--fit 60] [--json figures.json]
    python benchmarks/tilt.py paintings [--strokes 100] [--effort 1] [--seeds 0 1] [--studios 3] [--replans 0]
        [--brush broad] [--out FOLDER]

marks: single strokes of random length, bend, press and tilt, painted in the virtual studio, beside the mark of the
stroke model. An error is the sum of the absolute differences of coverage, in cells of 2 mm, as a share of the
stroke's paint; squares are their squares, as a share of the squared coverage. With --fit
the constants of `TiltProfile` are fitted anew to every other stroke, in that many steps; errors are those of the rest.

paintings: pictures with edges that are sharp on one side and soft on the other, made here, planned and painted in the
virtual studio with as many strokes, upright and with a tilt of up to 40 degrees. Judged on the canvas as it really is,
in the mean over studios whose hand and brush err otherwise. Without replans the robot paints without an error of
placement, which nobody would see: it set paintings of one plan 3 dB apart (benchmarks/hand.py).
FOLDER gets a sheet: picture, upright painting, painting with tilt.
"""

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import degrees, radians
from pathlib import Path
from statistics import mean
from tempfile import TemporaryDirectory

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from frida_painter import images
from frida_painter.brush.kinds import brush_kind
from frida_painter.brush.tilt import USUAL_PROFILE, TiltProfile, tilt_marks
from frida_painter.brush.weights import load_stroke_model
from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.kinds import OpenEasel
from frida_painter.easel.order import EaselOrder
from frida_painter.frames import PixelGrid, pixel_to_map
from frida_painter.hardware.motion import Motion
from frida_painter.lab.benchmark.judges import PERCEPTUAL, PSNR, SSIM, Judges
from frida_painter.lab.paintings import EXACT, PLACEMENT, StudioWithout, connect_studio
from frida_painter.palette import Palette
from frida_painter.runs.run import PaintingRun
from frida_painter.runs.spec import RunSpec
from frida_painter.strokes import MAX_TILT, Strokes
from frida_painter.virtual.studio import StudioSettings, open_studio
from frida_painter.virtual.tabletop import HandNoise
from measure import Table, arguments, publish

CANVAS = CanvasSize(0.14, 0.10)
START = (0.03, 0.05)
INK = 0.02
GROUPS = ("upright", "to a side, below 20 degrees", "to a side, 20 to 40 degrees", "in any direction")


def main() -> None:
    parser = arguments(__doc__)
    ways = parser.add_subparsers(dest="way", required=True)
    marks = ways.add_parser("marks")
    marks.add_argument("--brushes", nargs="+", default=["broad", "medium", "fine"])
    marks.add_argument("--count", type=int, default=40)
    marks.add_argument("--fit", type=int, default=0)
    paintings = ways.add_parser("paintings")
    paintings.add_argument("--strokes", type=int, default=100)
    paintings.add_argument("--effort", type=float, default=1.0)
    paintings.add_argument("--seeds", type=int, nargs="+", default=[0])
    paintings.add_argument("--studios", type=int, default=3)
    paintings.add_argument("--replans", type=int, default=0)
    paintings.add_argument("--brush", default="broad")
    paintings.add_argument("--canvas", default="16x12cm")
    paintings.add_argument("--pictures", nargs="+", default=list(PICTURES), choices=list(PICTURES))
    paintings.add_argument("--out", type=Path)
    options = parser.parse_args()
    {"marks": judge_marks, "paintings": judge_paintings}[options.way](options)


# Marks


@dataclass(frozen=True)
class Painted:
    """Strokes of one brush and their coverage in the studio, [n, H, W]."""

    brush: str
    strokes: Strokes
    coverage: Tensor


def painted(brush: str, count: int, seed: int = 7) -> Painted:
    """Returns random strokes, each painted with a full brush on a canvas of its own."""
    limits, chance = brush_kind(brush).limits, np.random.default_rng(seed)
    rows, seen = [], []
    for number in range(count):
        length = chance.uniform(*limits.length)
        bend = chance.uniform(*limits.bend) * min(1, length / limits.length[1]) * 0.8
        thickness = chance.uniform(0, 1)
        left, forward = 0.0 if number % 6 == 0 else MAX_TILT * chance.uniform(-1, 1), 0.0
        if number % 6 == 5:
            toward, tilt = chance.uniform(0, 2 * np.pi), chance.uniform(0.3, 1) * MAX_TILT
            left, forward = tilt * np.cos(toward), tilt * np.sin(toward)
        rows.append([*START, 0, length, bend, thickness, 0, 0, 0, left, forward])
        seen.append(lay(brush, Strokes.from_array(rows[-1:]), number))
    pictures = torch.stack(seen)
    coverage = ((1 - pictures) / (1 - pictures.min())).clamp(0, 1)
    return Painted(brush, Strokes.from_array(rows), functional.avg_pool2d(coverage[:, None], 4)[:, 0])


STEADY = HandNoise(0.0, 0.0)


def lay(brush: str, stroke: Strokes, seed: int, hand: HandNoise = STEADY) -> Tensor:
    """Returns the grey picture [H, W] of one stroke, two pixels a millimetre."""
    settings = StudioSettings(placement_error=EXACT, noise=hand, cell=0.4)
    studio = connect_studio(open_studio(CANVAS, brush, seed=seed, settings=settings))
    easel = studio.easel
    easel.operator.fill_wells(Palette(torch.full((1, 3), INK)))
    motion = Motion(easel.workspace, easel.calibration)
    for way in (motion.dip(0), *motion.swift_stroke(stroke, 0, "stroke")):
        easel.robot.follow(way)
    return studio.truth(round(2000 * CANVAS.height)).mean(0)


class Drawing:
    """Marks of the upright stroke model, and what a profile makes of them."""

    def __init__(self, given: Painted) -> None:
        self.model = load_stroke_model(given.brush)
        self.grid = PixelGrid(CANVAS, *given.coverage.shape[1:])
        strokes = self.strokes = given.strokes
        with torch.no_grad():
            self.upright = self.model(strokes.thickness, strokes.length, strokes.bend)
        self.affine = pixel_to_map(strokes.position, strokes.angle, self.grid, self.model.frame)

    def of(self, profile: TiltProfile | None) -> Tensor:
        """Returns the coverage [n, H, W] of the strokes; None for upright marks."""
        maps, affine = self.upright, self.affine
        if profile is not None:
            corner = torch.zeros(len(self.strokes), 2)
            maps, affine = tilt_marks(maps, affine, corner, self.strokes, self.model, profile)
        column, row = torch.arange(self.grid.columns).float(), torch.arange(self.grid.rows).float()
        columns, rows = torch.meshgrid(column, row, indexing="xy")
        pixel = torch.stack((columns, rows, torch.ones_like(rows)), -1)
        cell = torch.einsum("hwk,nck->nhwc", pixel, affine)
        place = (2 * cell + 1) / cell.new_tensor([maps.shape[2], maps.shape[1]]) - 1
        return functional.grid_sample(maps[:, None], place, align_corners=False)[:, 0]


def groups(strokes: Strokes) -> list[Tensor]:
    """Returns the strokes of each of `GROUPS`, as masks."""
    assert strokes.tilt is not None
    left, forward = strokes.tilt.abs().unbind(1)
    aside = (forward == 0) & (left > 0)
    return [(left == 0) & (forward == 0), aside & (left < radians(20)), aside & (left >= radians(20)), forward > 0]


def judge_marks(options: argparse.Namespace) -> None:
    found = [painted(brush, 12 if options.quick else options.count) for brush in options.brushes]
    profile, held = USUAL_PROFILE, [torch.ones(len(one.strokes), dtype=torch.bool) for one in found]
    if options.fit:
        held = [torch.arange(len(one.strokes)) % 2 == 1 for one in found]
        both = zip(found, held, strict=True)
        given = [Painted(one.brush, one.strokes[~kept], one.coverage[~kept]) for one, kept in both]
        profile = fit_profile(given, options.fit)
    rows, figures = [], {"profile": profile._asdict(), "errors": {}}
    for one, kept in zip(found, held, strict=True):
        drawing = Drawing(one)
        with torch.no_grad():
            off = [drawing.of(way) - one.coverage for way in (None, profile)]
        share = [each.abs().sum((1, 2)) / one.coverage.sum((1, 2)) for each in off]
        squares = [each.square().sum((1, 2)) / one.coverage.square().sum((1, 2)) for each in off]
        for name, mine in zip(GROUPS, groups(one.strokes), strict=True):
            upright, tilted, *square = (float(each[mine & kept].mean()) for each in (*share, *squares))
            figures["errors"][f"{one.brush}, {name}"] = {"upright": upright, "tilted": tilted, "squares": square}
            found = (f"{each:.3f}" for each in (upright, tilted, *square))
            rows.append((one.brush, name, str(int((mine & kept).sum())), *found))
    columns = ("brush", "handle leans", "strokes", "upright mark", "tilted mark", "squares, upright", "squares, tilted")
    notes = [f"{name}: {value:.4f}" for name, value in profile._asdict().items()]
    publish([Table("Error of the mark, share of the paint", columns, rows, notes)], figures, options)


def fit_profile(given: Sequence[Painted], steps: int) -> TiltProfile:
    """Returns the profile with the least absolute error over the strokes."""
    drawings = [Drawing(one) for one in given]
    free = {name: torch.tensor(float(value), requires_grad=True) for name, value in USUAL_PROFILE._asdict().items()}
    adam = torch.optim.Adam(free.values(), lr=0.015)
    for _ in range(steps):
        adam.zero_grad()
        for drawing, one in zip(drawings, given, strict=True):
            (drawing.of(TiltProfile(**free)) - one.coverage).abs().mean().backward()
        adam.step()
        with torch.no_grad():
            for name in ("light", "blur"):
                free[name].clamp_(min=0.02)
    return TiltProfile(**{name: float(value) for name, value in free.items()})


# Paintings

ROWS, COLUMNS = 360, 480


def _mix(share: Tensor, *colors: str) -> Tensor:
    """Returns the picture [3, H, W] of evenly spaced colours along a share [H, W] in [0, 1]."""
    stops = torch.tensor([[int(color[at : at + 2], 16) / 255 for at in (0, 2, 4)] for color in colors])
    place = share.clamp(0, 1) * (len(colors) - 1)
    first = place.floor().clamp(max=len(colors) - 2).long()
    along = (place - first)[..., None]
    return (stops[first] * (1 - along) + stops[first + 1] * along).permute(2, 0, 1)


def _places() -> tuple[Tensor, Tensor]:
    down, across = torch.meshgrid(torch.linspace(0, 1, ROWS), torch.linspace(0, COLUMNS / ROWS, COLUMNS), indexing="ij")
    return down, across


def cloth() -> Tensor:
    """Folds of cloth: each has a sharp crease, and from there the light fades slowly."""
    down, across = _places()
    fold = 3.4 * across + 0.55 * torch.sin(2.2 * down + 0.6) - 0.5 * down
    return _mix((fold % 1.0) ** 0.8, "3a1f3d", "7c3050", "c8607a", "f2c9b8")


def spheres() -> Tensor:
    """Spheres in light from the upper left: sharp against the dark, and soft into their own shadow."""
    down, across = _places()
    picture = _mix(0.7 - 0.5 * down + 0.1 * across, "20242e", "39485c")
    for x, y, radius in ((0.42, 0.46, 0.33), (1.0, 0.62, 0.25)):
        right, below = (across - x) / radius, (down - y) / radius
        inside = right.square() + below.square() < 1
        height = (1 - right.square() - below.square()).clamp(min=0).sqrt()
        light = (0.15 + 0.85 * (-0.6 * right - 0.6 * below + 0.53 * height)).clamp(0, 1)
        picture = torch.where(inside, _mix(light, "20242e", "7a4a30", "e0a050", "fff0c8"), picture)
    return picture


def dunes() -> Tensor:
    """Dunes behind each other: each has a sharp crest, below which its sand fades into haze."""
    down, across = _places()
    picture = _mix(down / 0.4, "5f86b4", "e9d9c0")
    for number, crest in enumerate((0.30, 0.48, 0.68)):
        edge = crest + 0.09 * torch.sin(3.1 * across + 1.9 * number) + 0.03 * torch.sin(7 * across + number)
        fall = ((down - edge) / 0.26).clamp(0, 1)
        sand = _mix(fall, ("b0683c", "9a5230", "7d3a24")[number], "e8c9a0")
        picture = torch.where(down > edge, sand, picture)
    return picture


PICTURES = {"cloth": cloth, "spheres": spheres, "dunes": dunes}


def judge_paintings(options: argparse.Namespace) -> None:
    rows, figures, shown = [], [], []
    judges = Judges.open()
    for name in options.pictures[:1] if options.quick else options.pictures:
        picture, found = PICTURES[name](), {}
        row = [picture]
        for tilt in (0.0, degrees(MAX_TILT)):
            each = [paint(picture, tilt, seed, options, judges) for seed in options.seeds]
            found[tilt] = {key: mean(one[1][key] for one in each) for key in each[0][1]}
            row.append(each[0][0])
        figures.append({"picture": name, **{f"tilt {tilt:g}": values for tilt, values in found.items()}})
        shown.append(torch.cat(row, 2))
        upright, tilted = found.values()
        pairs = [(key, upright[key], tilted[key]) for key in upright]
        rows += [(name, key, f"{one:.3f}", f"{other:.3f}", f"{other - one:+.3f}") for key, one, other in pairs]
    if options.out:
        options.out.mkdir(parents=True, exist_ok=True)
        images.save(torch.cat(shown, 1), options.out / "tilt.png")
    title = f"{options.strokes} strokes, {options.brush} brush, seeds {options.seeds}"
    publish([Table(title, ("picture", "measure", "upright", "tilt up to 40", "difference"), rows)], figures, options)


def paint(
    picture: Tensor, tilt: float, seed: int, options: argparse.Namespace, judges: Judges
) -> tuple[Tensor, dict[str, float]]:
    """Returns the true canvas [3, H, W] of the first painting of a plan, and the mean figures of all."""
    with TemporaryDirectory() as folder:
        file = Path(folder) / "picture.png"
        images.save(picture, file)
        spec = RunSpec.of(
            goal=[{"image": str(file)}], strokes=20 if options.quick else options.strokes, brushes=options.brush,
            tilt=tilt, seed=seed, effort=0.1 if options.quick else options.effort, canvas=options.canvas, focus="none",
            ground="auto", colors=12, replans=options.replans, film=False,
        )  # fmt: skip
        with PaintingRun(spec) as run:
            began = time.process_time()
            plan = run.plan()
            seconds = time.process_time() - began
            expected = run.planner.expected(plan)
        truths = []
        for number in range(1 if options.quick else options.studios):
            studio = StudioWithout(() if options.replans else (PLACEMENT,))
            with PaintingRun(spec) as run:
                run.simulate(plan, partial(open_another, studio, number))
            truths.append(studio.truth(2 * ROWS))
    judged = [judges.of_picture(truth, picture) for truth in truths]
    target = images.fit(picture, *expected.shape[1:])
    decibels = [each[PSNR] for each in judged]
    figures = {
        **{key: mean(each[key] for each in judged) for key in (PSNR, SSIM, PERCEPTUAL)},
        "PSNR of the worst and the best, apart": max(decibels) - min(decibels),
        "plan, dB": float(-10 * (expected - target).square().mean().log10()),
        "strokes that lean by 10 degrees or more": float(
            0 if plan.strokes.tilt is None else (plan.strokes.tilt.norm(dim=1) >= radians(10)).sum()
        ),
        "CPU s of the plan": seconds,
    }
    return images.resize_by_area(truths[0], ROWS, COLUMNS), figures


def open_another(studio: StudioWithout, number: int, order: EaselOrder) -> OpenEasel:
    """Opens the ordered studio with another seed, for another hand, brush and camera."""
    return studio.open(replace(order, seed=order.seed + number))


if __name__ == "__main__":
    main()
