"""Painting by meaning against painting by pixels (paper: "Semantic Replication", where people preferred the former).

Each photograph is painted twice with the same few strokes. Nobody is asked; four figures say what
each painting is nearer in: what a network that no optimiser asked sees where (EfficientNet-Lite1),
VGG16's features in the manner of LPIPS, edges, and pixels.
"""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from torch import Tensor

from frida_painter import images, weights
from frida_painter.experiments.goal_paintings import FULL, Bench
from frida_painter.experiments.measures import edge_score, feature_distance, perceptual_distance, psnr
from frida_painter.experiments.outcome import Notify, Outcome, Progress, ResultTable, Row, each, silent
from frida_painter.experiments.result_cache import Measurement
from frida_painter.experiments.scale import CANVAS, ROBOT_ERROR, PlanningScale
from frida_painter.experiments.targets import Target
from frida_painter.frames import CanvasSize
from frida_painter.goal import Goal
from frida_painter.objectives.encoders.base import Seer
from frida_painter.objectives.encoders.efficientnet import EfficientNetLite
from frida_painter.objectives.encoders.registry import EncoderRegistry
from frida_painter.objectives.kinds.image import ImageTerm
from frida_painter.objectives.kinds.semantic import SemanticTerm
from frida_painter.report.figure_sheet import Cell, FigureRow, page
from frida_painter.session.opening import planning_device

NAME = "semantic"
PIXELS, MEANING = "by pixels", "by meaning"
WAYS = (PIXELS, MEANING)
JUDGE, _SIDE = "efficientnet-lite1", 240
FEATURES, PERCEPTUAL, EDGES, PSNR = "feature distance", "LPIPS-like", "edge F-score", "PSNR, dB"
_MORE_IS_BETTER = {FEATURES: False, PERCEPTUAL: False, EDGES: True, PSNR: True}
_Key = tuple[str, int, str]  # photograph, seed, way


def run(
    photographs: Sequence[Target],
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
    """Paints every photograph by pixels and by meaning, once per seed.

    encoders: the networks that the goal is seen through; judge: the one that they do not ask, by
    default EfficientNet-Lite1; keep: a folder in which finished paintings wait in case the rest is
    interrupted. Raises WeightsError where a network is missing.
    """
    bench = Bench(brush, canvas, scale, encoders or EncoderRegistry(device=planning_device()), keep)
    judge = judge or EfficientNetLite(weights.tensors(JUDGE))
    tasks = [(photo, seed, way) for seed in seeds for photo in photographs for way in WAYS]
    found: dict[_Key, Measurement] = {}
    for (photo, seed, way), telling in each(tasks, notify):
        found[photo.name, seed, way] = bench.recall(
            f"{photo.name}-{WAYS.index(way)}-{seed}",
            partial(_measure, bench, judge, photo, seed, way, telling),
            way=way,
            photo=photo.fingerprint,
            seed=seed,
        )
    names = [photo.name for photo in photographs]
    every: list[Row] = [
        {"photograph": name, "seed": seed, "painted": way, **finding.numbers}
        for (name, seed, way), finding in found.items()
    ]
    return Outcome(
        NAME,
        "Photographs painted by meaning and by pixels",
        {
            "photographs": tuple(names), "seeds": tuple(seeds), "brush": brush, "canvas": str(canvas),
            **scale.settings(),
            "judge": JUDGE, "robot": ROBOT_ERROR,
        },
        (ResultTable("The photographed paintings, mean over photographs and seeds", tuple(_summary(found))),
         ResultTable("All paintings", tuple(every))),
        tuple(_note(measure, found, names, seeds) for measure in _MORE_IS_BETTER),
        {NAME: _sheet(photographs, found, seeds[0])},
    )  # fmt: skip


def _measure(bench: Bench, judge: Seer, photo: Target, seed: int, way: str, notify: Notify) -> Measurement:
    """How near a painting of the photograph comes to it, and the pictures of its plan and of itself."""
    term = ImageTerm(photo.picture) if way == PIXELS else SemanticTerm(photo.picture)
    painted = bench.paint(Goal((term,)), photo.picture, seed, notify, f"{photo.name} {way}")
    notify(Progress(0.97, f"{photo.name} {way}: measuring"))
    picture = painted.photograph
    target = images.fit(photo.picture, *picture.shape[1:])
    return Measurement(
        {
            FEATURES: feature_distance(judge, picture, target, _SIDE),
            PERCEPTUAL: perceptual_distance(bench.encoders.style(), picture, target),
            EDGES: edge_score(picture, target),
            PSNR: psnr(picture, target),
            "feature distance of the plan": feature_distance(judge, painted.planned, target, _SIDE),
            "CPU s": painted.seconds,
        },
        {"planned": painted.planned, "painting": picture},
    )


def _summary(found: Mapping[_Key, Measurement]) -> list[Row]:
    rows: list[Row] = []
    for way in WAYS:
        findings = [finding for key, finding in found.items() if key[2] == way]
        means = {name: float(np.mean([one.numbers[name] for one in findings])) for name in findings[0].numbers}
        rows.append({"painted": way, **means})
    return rows


def _note(measure: str, found: Mapping[_Key, Measurement], names: Sequence[str], seeds: Sequence[int]) -> str:
    """In how many of the paintings meaning is better by a measure, and in which photographs it is not."""
    sign = 1 if _MORE_IS_BETTER[measure] else -1
    gain = {
        name: [
            sign * (found[name, seed, MEANING].numbers[measure] - found[name, seed, PIXELS].numbers[measure])
            for seed in seeds
        ]
        for name in names
    }
    better = sum(one > 0 for gains in gain.values() for one in gains)
    worse = [name for name, gains in gain.items() if np.mean(gains) <= 0]
    pixels, meaning = (
        float(np.mean([found[name, seed, way].numbers[measure] for name in names for seed in seeds])) for way in WAYS
    )
    lost = f"; not for {', '.join(worse)}" if 0 < len(worse) < len(names) else ""
    return (
        f"By {measure}, painting by meaning wins {better} of {len(names) * len(seeds)} times: "
        f"{meaning:.3g} against {pixels:.3g} in the mean{lost}."
    )


def _sheet(photographs: Sequence[Target], found: Mapping[_Key, Measurement], seed: int) -> Tensor:
    lines = []
    for photo in photographs:
        findings = [found[photo.name, seed, way] for way in WAYS]
        size = findings[0].pictures["painting"].shape[1:]
        cells = [Cell(images.fit(photo.picture, *size))]
        for finding in findings:
            words = f"features {finding.numbers[FEATURES]:.3f}, edges {finding.numbers[EDGES]:.2f}"
            cells.append(Cell(finding.pictures["painting"], words))
        lines.append(FigureRow("", cells))
    return page("", ("photograph", *(f"painted {way}" for way in WAYS)), lines, width=300)
