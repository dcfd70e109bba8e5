"""Experiment: strokes that a person taught, from marks to paintings.

The three families of the project are learned from marks that `make_marks` draws as a hand would: one idea of a
stroke, varied in its proportions, with a tremor and an uneven pressure. The experiment measures three steps. How
exact is the shape code on held-out marks, by principal components and by a small variational network? How exact is
the stroke model of a family, against that of the brush on its own strokes? How near does a drawing of long lines
come with and without a family, at the same number of strokes?
"""

import math
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from frida_painter import images
from frida_painter.brush.kinds import BrushKind, StrokeModel, brush_kind
from frida_painter.brush.library import StrokeLibrary, clean
from frida_painter.brush.weights import load_stroke_model
from frida_painter.easel.dialogue import lead
from frida_painter.easel.virtual_easel import open_virtual_easel, studio_brush
from frida_painter.lab import ExperimentScale
from frida_painter.lab.paintings import connect_studio, execute
from frida_painter.lab.trials import (
    Notify,
    Outcome,
    Progress,
    ResultTable,
    Row,
    mse,
    perceptual_distance,
    silent,
    within,
)
from frida_painter.objectives.encoders.loading import EncoderRegistry
from frida_painter.procedures.strokes import strokes
from frida_painter.report.sheets import Cell, FigureRow, page
from frida_painter.runs.run import PaintingRun
from frida_painter.runs.spec import RunSpec
from frida_painter.teaching.evaluation import errors
from frida_painter.teaching.families import load_family
from frida_painter.teaching.marks import TaughtMark, align_marks, find_modes, reconstruct
from frida_painter.virtual.studio import open_studio

NAME = "taught-strokes"
FAMILIES = ("comma", "zigzag", "flourish")
FULL = ExperimentScale(strokes=16, held_out=16, sizes=(16, 16))
QUICK = ExperimentScale(strokes=3, held_out=6, sizes=(10, 4), quick=True)
_LONG = "flourish"
_CANVAS, _ROWS = "28x21cm", 240
_POINTS = 160
_SIZES = {"comma": 0.032, "zigzag": 0.05, "flourish": 0.09}
Curve = NDArray[np.complex128]


def make_marks(family: str, count: int, seed: int = 0) -> list[TaughtMark]:
    """Returns marks of a family as a person would draw them: each a little different.

    family: one of FAMILIES
    """
    luck = np.random.default_rng([seed, FAMILIES.index(family)])
    return [_draw(family, luck, number) for number in range(count)]


def _draw(family: str, luck: np.random.Generator, number: int) -> TaughtMark:
    t = np.linspace(0, 1, _POINTS)
    curve, press = {"comma": _comma, "zigzag": _zigzag, "flourish": _flourish}[family](t, luck)
    size = float(np.abs(curve[:, None] - curve[None]).max())
    curve = curve / size * _SIZES[family] * math.exp(luck.normal(0, 0.15)) * np.exp(1j * luck.normal(0, 0.15))
    for frequency in (2, 3, 5):  # the tremor of a hand
        wave = luck.normal(0, 0.00025, 2) @ np.array([1, 1j])
        curve = curve + wave * np.sin(2 * np.pi * frequency * t + luck.uniform(0, 2 * np.pi))
    press = np.clip(press * luck.normal(1, 0.05) + 0.03 * np.sin(2 * np.pi * (2 * t + luck.uniform())), 0.03, 1)
    place = np.stack((curve.real, curve.imag), 1)
    return TaughtMark(place, press, seconds=1.5, name=f"{family} {number + 1}")


def _comma(t: NDArray[np.float64], luck: np.random.Generator) -> tuple[Curve, NDArray[np.float64]]:
    """A press that swells, turns and lifts off to a point."""
    turn = luck.normal(1.9, 0.35)
    heading = -turn * t ** luck.normal(1.4, 0.12)
    curve: Curve = np.cumsum(np.exp(1j * heading)).astype(np.complex128) / len(t)
    press = np.clip(1.05 * np.minimum(1, (t + 0.05) / 0.2) * (1 - t) ** 0.8, 0.04, 1)
    return curve, press


def _zigzag(t: NDArray[np.float64], luck: np.random.Generator) -> tuple[Curve, NDArray[np.float64]]:
    """A fill: seven strokes to and fro, each beside the one before."""
    legs = 7
    height = luck.normal(0.55, 0.1)
    leg = np.clip(t * legs, 0, legs - 1e-9)
    share = leg - np.floor(leg)
    share = np.where(np.floor(leg) % 2 == 0, share, 1 - share)
    lean = luck.normal(0.12, 0.05)
    growth = 1 + luck.normal(0, 0.15) * (t - 0.5)
    y = height * growth * (share - 0.5)
    curve: Curve = (t + lean * y + 1j * y).astype(np.complex128)
    smooth = np.ones(9) / 9
    padded = np.r_[[curve[0]] * 4, curve, [curve[-1]] * 4]
    press = np.interp(t, [0, 0.06, 0.94, 1], [0.25, 0.75, 0.7, 0.2])
    curve = np.convolve(padded, smooth, "valid").astype(np.complex128)
    return curve, press


def _flourish(t: NDArray[np.float64], luck: np.random.Generator) -> tuple[Curve, NDArray[np.float64]]:
    """A long calligraphic line: it swings up and down with swelling pressure, more like a bow or more like an S."""
    bow, swing = luck.normal(0.0, 0.5), luck.normal(0.5, 0.4)
    heading = bow * np.cos(np.pi * t) + swing * np.cos(2 * np.pi * t)
    curve: Curve = np.cumsum(np.exp(1j * heading)).astype(np.complex128) / len(t)
    press = 0.15 + 0.75 * np.sin(np.pi * np.clip(t, 0, 1)) ** 1.5
    return curve, press


# The shape code: principal components of splines, or a small variational network

_HIDDEN, _THINNED = 64, 4
_STEPS, _RATE, _PRESSURE = 1200, 3e-3, 0.2
_DIVERGENCE = 1e-4
_SEARCH = 150  # steps to the best code of a held-out mark


class ShapeNetwork(nn.Module):
    """Small variational autoencoder of aligned marks, as in Spline-FRIDA: two layers each way.

    codes: numbers of the code
    points: points of a mark
    """

    def __init__(self, codes: int, points: int) -> None:
        super().__init__()
        self.codes, self.points = codes, points
        self.encoder = nn.Sequential(nn.Linear(3 * points, _HIDDEN), nn.SiLU(), nn.Linear(_HIDDEN, 2 * codes))
        self.decoder = nn.Sequential(nn.Linear(codes, _HIDDEN), nn.SiLU(), nn.Linear(_HIDDEN, 3 * points))

    def decode(self, code: Tensor) -> Tensor:
        """Returns the shapes [n, points, 3] of codes [n, codes]."""
        shape: Tensor = self.decoder(code).view(-1, self.points, 3)
        return shape

    def fit(self, marks: Tensor, steps: int, chance: torch.Generator) -> None:
        """Learns from marks [n, points, 3], in place."""
        optimizer = torch.optim.Adam(self.parameters(), lr=_RATE)
        for _ in range(steps):
            mean, deviation = self.encoder(marks.flatten(1)).chunk(2, 1)
            noise = torch.randn(mean.shape, generator=chance)
            code = mean + noise * (0.5 * deviation).exp()
            missed = (self.decode(code) - marks).square().sum((1, 2)).mean()
            divergence = 0.5 * (mean.square() + deviation.exp() - 1 - deviation).sum(1).mean()
            optimizer.zero_grad()
            (missed + self.points * _DIVERGENCE * divergence).backward()
            optimizer.step()

    def nearest(self, marks: Tensor, steps: int) -> Tensor:
        """Returns the shapes [n, points, 3] nearest to marks, found by descent on the code, within its reach."""
        with torch.no_grad():
            code = self.encoder(marks.flatten(1))[:, : self.codes]
        code = code.clone().requires_grad_()
        optimizer = torch.optim.Adam([code], lr=0.05)
        for _ in range(steps):
            optimizer.zero_grad()
            (self.decode(code) - marks).square().sum().backward()  # type: ignore[no-untyped-call]
            optimizer.step()
            with torch.no_grad():
                code.clamp_(-2, 2)
        return self.decode(code).detach()


def compare_codes(family: str, taught: int, held_out: int, codes: int, seed: int, *, quick: bool = False) -> Row:
    """Returns the errors of held-out marks of a family, by components and by the network, as a row of a table.

    The error is the mean distance between a mark and its nearest shape, in percent of its size.
    """
    aligned = align_marks([*make_marks(family, taught, seed), *make_marks(family, held_out, seed + 1)])[0]
    known, test = aligned[:taught], aligned[taught:]
    components = reconstruct(*find_modes(known, codes), test)
    weights = torch.tensor([1.0, 1.0, _PRESSURE])
    thin = [torch.from_numpy(part[:, ::_THINNED]).float() * weights for part in (known, test)]
    mean = thin[0].mean(0)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        network = ShapeNetwork(codes, thin[0].shape[1])
    network.fit(thin[0] - mean, 20 if quick else _STEPS, torch.Generator().manual_seed(seed))
    drawn = network.nearest(thin[1] - mean, 5 if quick else _SEARCH) + mean
    return {
        "family": family,
        "codes": codes,
        "mean mark, %": _distance(np.broadcast_to(known.mean(0), test.shape), test),
        "components, %": _distance(components, test),
        "network, %": 100 * float((drawn - thin[1])[..., :2].norm(dim=-1).mean()),
    }


def _distance(drawn: NDArray[np.float64], marks: NDArray[np.float64]) -> float:
    return 100 * float(np.linalg.norm((drawn - marks)[..., :2], axis=-1).mean())


# The stroke model on held-out painted strokes


_REPEATS = 4  # of each held-out stroke, in other studios


def paint_library(kind: BrushKind, count: int, seed: int, notify: Notify, studio: int | None = None) -> StrokeLibrary:
    """Paints a library of strokes of a brush, or of a family with it, in the virtual studio.

    seed: of the strokes
    studio: seed of the studio, so that the same strokes can be repeated; None for `seed`
    """
    painting = strokes(
        open_virtual_easel(kind.name, seed if studio is None else studio),
        kind,
        count=count,
        seed=seed,
        notify=lambda step: notify(Progress(step.done / step.of, "painting strokes to test with")),
    )
    return clean(lead(painting, lambda question: question.proposal or False).library)


def measure_model(name: str, model: StrokeModel, library: StrokeLibrary, repeats: Sequence[StrokeLibrary] = ()) -> Row:
    """Returns the error of a stroke model on strokes that it did not learn from, as a row of a table.

    repeats: the same strokes, painted again. They give the noise of the studio, which no model knows: the error of a
        stroke against the median of its repeats.
    """
    missed = float(errors(model, library).mean())
    paint = float(library.magnitude.mean()) / 255
    noise = measure_noise(library, repeats)
    row: Row = {"strokes": name, "painted": len(library), "mean L1": missed, "share of the paint": missed / paint}
    return row if math.isnan(noise) else {**row, "noise of the studio": noise, "share": noise / paint}


def measure_noise(library: StrokeLibrary, repeats: Sequence[StrokeLibrary]) -> float:
    """Returns the mean L1 between strokes and the medians of their repeats; NaN without two repeats of any stroke."""
    found = []
    for index, mark in zip(library.recorded_index, library.magnitude, strict=True):
        again = [other.magnitude[other.recorded_index == index] for other in repeats]
        others = np.concatenate([np.zeros((0, *mark.shape), np.uint8), *again]).astype(np.float64)
        if len(others) > 1:
            found.append(float(np.abs(np.median(others, 0) - mark).mean()) / 255)
    return float(np.mean(found)) if found else math.nan


# A drawing of long lines with and without the family


def draw_lines(rows: int = 480, columns: int = 640) -> Tensor:
    """Returns a drawing of seven long swinging lines in two colours, sRGB [3, rows, columns]."""
    paper = np.full((rows, columns, 3), 255, np.uint8)
    t = np.linspace(0, 1, 300)
    lines = [
        ((0.06 + 0.88 * t, 0.2 + 0.19 * k + 0.07 * np.sin(2 * np.pi * (1.05 * t + 0.17 * k))), (35, 60, 45))
        for k in range(4)
    ]
    lines += [((0.2 + 0.28 * k + 0.09 * np.sin(np.pi * t + 0.6 * k), 0.06 + 0.88 * t), (35, 55, 125)) for k in range(3)]
    for (x, y), color in lines:
        points = np.stack((x * columns, y * rows), 1).round().astype(np.int32)
        cv2.polylines(paper, [points], False, color, max(2, rows // 45), cv2.LINE_AA)
    return torch.from_numpy(paper).permute(2, 0, 1).float() / 255


@dataclass(frozen=True)
class PaintedLines:
    """A drawing painted in one way: its photograph [3, rows, columns], and the measures by name."""

    way: str
    photograph: Tensor
    measures: Row


def paint_lines(kind: str, count: int, seed: int, *, quick: bool) -> PaintedLines:
    """Plans the drawing with strokes of one kind ("fine", "fine+flourish"), paints it and compares the photograph."""
    drawing = draw_lines(96, 128) if quick else draw_lines()
    settings: dict[str, Any] = {
        "canvas": _CANVAS,
        "strokes": count,
        "colors": 2,
        "focus": "none",
        "seed": seed,
        "layers": 1,
    }
    effort: dict[str, Any] = {"effort": 0.05, "render_height": 64} if quick else {"render_height": 192}
    with tempfile.TemporaryDirectory() as folder:
        picture = Path(folder) / "lines.png"
        images.save(drawing, picture)
        spec = RunSpec.of(goal=[{"image": str(picture)}], brushes=kind, ground="white", **settings, **effort)
        with PaintingRun(spec) as planning:
            plan = planning.plan()
    brush = plan.layers[0].brush
    studio = connect_studio(open_studio(plan.canvas, studio_brush(brush), seed=seed))
    photograph = execute(plan, studio.easel, 96 if quick else _ROWS)
    wanted = images.fit(drawing, *photograph.shape[1:])
    distance = perceptual_distance(EncoderRegistry().style(), photograph, wanted)
    measures: Row = {
        "painted with": kind,
        "seed": seed,
        "strokes": count,
        "perceptual distance": distance,
        "mean squared error": mse(photograph, wanted),
    }
    return PaintedLines(kind, photograph, measures)


def run(*, brush: str = "fine", seed: int = 0, scale: ExperimentScale = FULL, notify: Notify = silent) -> Outcome:
    """Measures shape codes, stroke models and a drawing of long lines; see the module."""
    taught, held_out = scale.sizes
    codes = [
        compare_codes(family, taught, held_out, count, seed, quick=scale.quick)
        for family in FAMILIES
        for count in (1, 2)
    ]
    tested = FAMILIES[:1] if scale.quick else FAMILIES
    names = ("", *tested)
    models = []
    for number, name in enumerate(names):
        part = within(notify, 0.05 + 0.5 * number / len(names), 0.05 + 0.5 * (number + 1) / len(names))
        kind = brush_kind(brush) if not name else brush_kind(brush).of_family(load_family(name))
        library, *repeats = (
            paint_library(kind, scale.held_out, seed + 1000, within(part, *share), seed + 1000 + studio)
            for studio, share in enumerate(_parts(1 + (2 if scale.quick else _REPEATS)))
        )
        model = load_stroke_model(f"{brush}+{name}" if name else brush)
        models.append(measure_model(name or f"{brush} brush", model, library, repeats))
    seeds = range(seed, seed + (1 if scale.quick else 2))
    ways = (brush, f"{brush}+{_LONG}")
    painted = []
    for number, (one, way) in enumerate((one, way) for one in seeds for way in ways):
        notify(Progress(0.55 + 0.45 * number / (len(seeds) * len(ways)), f"painting lines with {way}"))
        painted.append(paint_lines(way, scale.strokes, one, quick=scale.quick))
    return Outcome(
        NAME,
        "Strokes that a person taught",
        {"brush": brush, "seed": seed, "taught marks": taught, "held-out marks": held_out, "strokes": scale.strokes},
        (
            ResultTable("Distance of held-out marks from their nearest shape, in percent of their size", tuple(codes)),
            ResultTable("Stroke models on strokes that they did not learn from", tuple(models)),
            ResultTable("A drawing of long lines, painted", tuple(one.measures for one in painted)),
        ),
        (_note(painted, ways),),
        {NAME: _sheet(painted, ways)},
    )


def _parts(count: int) -> list[tuple[float, float]]:
    return [(number / count, (number + 1) / count) for number in range(count)]


def _note(painted: Sequence[PaintedLines], ways: tuple[str, str]) -> str:
    plain, taught = (
        float(np.mean([one.measures["perceptual distance"] for one in painted if one.way == way])) for way in ways
    )
    return (
        f"With strokes of the family the painted lines are at a perceptual distance of {taught:.4f}, with the brush's "
        f"own strokes at {plain:.4f}, at the same number of strokes: {100 * (1 - taught / plain):.0f} % less."
    )


def _sheet(painted: Sequence[PaintedLines], ways: tuple[str, str]) -> Tensor:
    size = painted[0].photograph.shape[1:]
    rows = [
        FigureRow(
            "",
            [
                Cell(images.fit(draw_lines(), *size), "drawing"),
                *(Cell(one.photograph, f"distance {one.measures['perceptual distance']:.4f}") for one in pair),
            ],
        )
        for pair in zip(*([one for one in painted if one.way == way] for way in ways), strict=True)
    ]
    return page("", ("drawing", *ways), rows, width=360)
