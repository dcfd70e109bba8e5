"""Is a styled painting nearer in style than the same photograph unstyled? (Paper: "Style".)

The distance in style is the Earth Mover's Distance between clouds of features that the optimiser did
not see: layers of VGG16 between those that it asks, and another network altogether. It is given as
the optimiser's relaxed one and exactly.
"""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from frida_painter import images, weights
from frida_painter.experiments.goal_paintings import FULL, Bench
from frida_painter.experiments.measures import edge_correlation, exact_emd
from frida_painter.experiments.outcome import Notify, Outcome, Progress, ResultTable, Row, each, silent
from frida_painter.experiments.result_cache import Measurement
from frida_painter.experiments.scale import CANVAS, ROBOT_ERROR, PlanningScale
from frida_painter.experiments.targets import Target
from frida_painter.frames import CanvasSize
from frida_painter.goal import Goal
from frida_painter.objectives.encoders.base import Seer
from frida_painter.objectives.encoders.efficientnet import EfficientNetLite
from frida_painter.objectives.encoders.registry import EncoderRegistry
from frida_painter.objectives.encoders.vgg import Vgg16
from frida_painter.objectives.kinds.image import ImageTerm
from frida_painter.objectives.kinds.style import StyleTerm
from frida_painter.objectives.style import LAYERS as SEEN
from frida_painter.objectives.transport import cosine_cost, euclidean_cost, relaxed_emd
from frida_painter.report.figure_sheet import Cell, FigureRow, page
from frida_painter.session.opening import planning_device

NAME = "style"
UNSTYLED, STYLED, BEGUN = "unstyled", "styled", "begun with the style"
WAYS = (UNSTYLED, STYLED, BEGUN)
JUDGE = "efficientnet-lite1"
UNSEEN = ("conv2_1", "conv3_2", "conv4_2")
_ROWS = 192  # of the pictures whose features are compared
_PLACES = 500  # at which they are
_LIGHT = 0.25  # of the photograph, where a painting begins with the style and is to keep its composition
_NETWORKS = ("VGG16", "Lite1", "colours")
assert not set(SEEN) & set(UNSEEN)


def run(
    photographs: Sequence[Target],
    styles: Sequence[Target],
    *,
    brush: str = "broad",
    canvas: CanvasSize = CANVAS,
    seeds: Sequence[int] = (0, 1),
    scale: PlanningScale = FULL,
    encoders: EncoderRegistry | None = None,
    judge: Seer | None = None,
    keep: Path | None = None,
    notify: Notify = silent,
) -> Outcome:
    """Paints every photograph unstyled, in every style, and begun with that style's own composition.

    encoders: the networks that goals are seen through; judge: the one that they do not ask, by
    default EfficientNet-Lite1; keep: a folder in which finished paintings wait in case the rest is
    interrupted. Raises WeightsError where a network is missing.
    """
    bench = Bench(brush, canvas, scale, encoders or EncoderRegistry(device=planning_device()), keep)
    judge = judge or EfficientNetLite(weights.tensors(JUDGE))
    pairs = [(photo, style) for photo in photographs for style in styles]
    tasks = [(photo, style, seed, way) for seed in seeds for photo, style in pairs for way in WAYS]
    found: dict[tuple[str, str, int, str], Measurement] = {}
    for (photo, style, seed, way), telling in each(tasks, notify):
        found[photo.name, style.name, seed, way] = bench.recall(
            f"{photo.name}-{style.name}-{WAYS.index(way)}-{seed}",
            partial(_measure, bench, judge, photo, style, seed, way, telling),
            way=way,
            photo=photo.fingerprint,
            style=style.fingerprint,
            seed=seed,
        )
    summary = [_summary(way, [finding for key, finding in found.items() if key[3] == way]) for way in WAYS]
    every: list[Row] = [
        {"photograph": photo, "style": style, "seed": seed, "painted": way, **finding.numbers}
        for (photo, style, seed, way), finding in found.items()
    ]
    return Outcome(
        NAME,
        "Photographs painted in the style of other pictures",
        {
            "photographs": tuple(one.name for one in photographs), "styles": tuple(one.name for one in styles),
            "seeds": tuple(seeds), "brush": brush, "canvas": str(canvas), **scale.settings(), "layers not seen": UNSEEN,
            "robot": ROBOT_ERROR,
        },
        (ResultTable("Distance in style of the photographed paintings, mean", tuple(summary)),
         ResultTable("All paintings", tuple(every))),
        (_note(found, pairs, seeds), _composition_note(summary)),
        {NAME: _sheet(pairs, found, seeds[0])},
    )  # fmt: skip


def _measure(
    bench: Bench, judge: Seer, photo: Target, style: Target, seed: int, way: str, notify: Notify
) -> Measurement:
    """How far a painting of the photograph is from the style, whose edges it has, and its picture."""
    words = f"{photo.name}, {way}" if way == UNSTYLED else f"{photo.name} in the style of {style.name}, {way}"
    goals = {
        UNSTYLED: Goal((ImageTerm(photo.picture),)),
        STYLED: Goal((ImageTerm(photo.picture), StyleTerm(style.picture))),
        BEGUN: Goal((ImageTerm(photo.picture, _LIGHT), StyleTerm(style.picture)), (ImageTerm(style.picture),)),
    }
    like = style if way == BEGUN else photo
    painted = bench.paint(goals[way], like.picture, seed, notify, words)
    notify(Progress(0.97, f"{words}: measuring"))
    picture = painted.photograph
    return Measurement(
        {
            **_distances(bench.encoders.style(), judge, picture, style.picture),
            "edges like the photograph's": edge_correlation(picture, photo.picture),
            "edges like the style's": edge_correlation(picture, style.picture),
            "CPU s": painted.seconds,
        },
        {"painting": picture},
    )


@torch.no_grad()
def _distances(vgg: Vgg16, judge: Seer, picture: Tensor, style: Tensor) -> dict[str, float]:
    """Relaxed and exact distances in style by network."""
    found = {}
    for network, clouds in zip(
        _NETWORKS, zip(_clouds(vgg, judge, picture), _clouds(vgg, judge, style), strict=True), strict=True
    ):
        costs = [
            (euclidean_cost if network == "colours" else cosine_cost)(*_sampled(a, b))
            for a, b in zip(*clouds, strict=True)
        ]
        found[f"{network}, relaxed"] = float(np.mean([float(relaxed_emd(cost)) for cost in costs]))
        found[f"{network}, exact"] = float(np.mean([exact_emd(cost) for cost in costs]))
    return found


def _clouds(vgg: Vgg16, judge: Seer, picture: Tensor) -> list[list[Tensor]]:
    """What each network sees at places, [n, c] for each of its layers, and last the colours."""
    small = images.fit(picture, _ROWS, round(_ROWS * picture.shape[2] / picture.shape[1]))
    lite = [layer[0] for layer in judge.features(small[None])]
    return [[layer.flatten(1).T for layer in layers] for layers in (vgg.features(small, UNSEEN), lite, [small])]


def _sampled(a: Tensor, b: Tensor) -> tuple[Tensor, Tensor]:
    """As many rows of one cloud [n, c] as of the other [m, c], and not too many, drawn at random."""
    count = min(len(a), len(b), _PLACES)
    chance = torch.Generator().manual_seed(0)
    return a[torch.randperm(len(a), generator=chance)[:count]], b[torch.randperm(len(b), generator=chance)[:count]]


def _summary(way: str, findings: Sequence[Measurement]) -> Row:
    names = findings[0].numbers
    return {"painted": way, **{name: float(np.mean([one.numbers[name] for one in findings])) for name in names}}


def _note(
    found: Mapping[tuple[str, str, int, str], Measurement], pairs: Sequence[tuple[Target, Target]], seeds: Sequence[int]
) -> str:
    parts = []
    for network in _NETWORKS:
        pick = f"{network}, exact"
        values = [
            [found[photo.name, style.name, seed, way].numbers[pick] for way in (STYLED, UNSTYLED)]
            for photo, style in pairs
            for seed in seeds
        ]
        better = sum(styled < unstyled for styled, unstyled in values)
        styled, unstyled = np.mean(values, 0)
        parts.append(f"{network}: {styled:.3f} against {unstyled:.3f}, nearer in {better} of {len(values)}")
    return (
        "Styled paintings against unstyled ones, exact distance in style on features that were not optimised: "
        + "; ".join(parts)
        + "."
    )


def _composition_note(summary: Sequence[Row]) -> str:
    by = {row["painted"]: row for row in summary}
    figures = [float(by[way]["edges like the style's"] or 0) for way in (BEGUN, STYLED)]
    return (
        "The edges of a painting begun with the style picture correlate with that picture's own composition by "
        f"{figures[0]:.2f}; by {figures[1]:.2f} where the painting began with the photograph."
    )


def _sheet(
    pairs: Sequence[tuple[Target, Target]], found: Mapping[tuple[str, str, int, str], Measurement], seed: int
) -> Tensor:
    lines = []
    for photo, style in pairs:
        cells = [Cell(photo.picture), Cell(style.picture)]
        for way in WAYS:
            finding = found[photo.name, style.name, seed, way]
            cells.append(Cell(finding.pictures["painting"], f"distance {finding.numbers['VGG16, exact']:.3f}"))
        lines.append(FigureRow("", cells))
    headings = ("photograph", "style", *(f"painted {way}" for way in WAYS))
    return page("", headings, lines, width=230)
