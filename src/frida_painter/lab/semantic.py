"""Experiment: painting by meaning against painting by pixels (paper: "Semantic Replication"; people preferred meaning).

Each photograph is painted twice with the same few strokes. Instead of people, four figures compare the paintings
with the photograph: features of a network that no optimiser uses (EfficientNet-Lite1), VGG16's features as in
LPIPS, edges, and pixels.
"""

from collections.abc import Sequence

import numpy as np
from torch import Tensor

from frida_painter import images, weights
from frida_painter.lab import paintings
from frida_painter.lab.paintings import FULL, Painted, PaintingTrial
from frida_painter.lab.targets import Target
from frida_painter.lab.trials import (
    Experiment,
    Measurement,
    Outcome,
    Results,
    ResultTable,
    edge_score,
    feature_distance,
    perceptual_distance,
    psnr,
)
from frida_painter.objectives.encoders.base import Seer
from frida_painter.objectives.encoders.classifiers import EfficientNetLite
from frida_painter.objectives.encoders.loading import EncoderRegistry
from frida_painter.report.sheets import Cell, FigureRow, page
from frida_painter.runs.spec import RunSpec
from frida_painter.session.opening import planning_device

NAME = "semantic"
PIXELS, MEANING = "by pixels", "by meaning"
WAYS = {PIXELS: "image", MEANING: "semantic"}
JUDGE, _SIDE = "efficientnet-lite1", 240
FEATURES, PERCEPTUAL, EDGES, PSNR = "feature distance", "LPIPS-like", "edge F-score", "PSNR, dB"
_MORE_IS_BETTER = {FEATURES: False, PERCEPTUAL: False, EDGES: True, PSNR: True}


def experiment(
    photographs: Sequence[Target],
    *,
    seeds: Sequence[int] = (0, 1),
    scale: RunSpec = FULL,
    encoders: EncoderRegistry | None = None,
    judge: Seer | None = None,
) -> Experiment[PaintingTrial]:
    """Returns the experiment: every photograph painted by pixels and by meaning, once per seed.

    encoders: networks of the goal
    judge: network that they do not use; None for EfficientNet-Lite1

    Raises WeightsError if a network is missing.
    """
    encoders = encoders or EncoderRegistry(device=planning_device())
    judge = judge or EfficientNetLite(weights.tensors(JUDGE))
    by_name = {photo.name: photo for photo in photographs}

    def measure(trial: PaintingTrial, painted: Painted) -> Measurement:
        picture = painted.photograph
        target = images.fit(by_name[trial["photograph"]].picture, *picture.shape[1:])
        return Measurement(
            {
                FEATURES: feature_distance(judge, picture, target, _SIDE),
                PERCEPTUAL: perceptual_distance(encoders.style(), picture, target),
                EDGES: edge_score(picture, target),
                PSNR: psnr(picture, target),
                "feature distance of the plan": feature_distance(judge, painted.planned, target, _SIDE),
                "CPU s": painted.seconds,
            },
            {"planned": painted.planned, "painting": picture},
        )

    def report(results: Results) -> Outcome:
        return Outcome(
            NAME,
            "Photographs painted by meaning and by pixels",
            {"photographs": tuple(by_name), "seeds": tuple(seeds), **paintings.settings(scale), "judge": JUDGE},
            (
                ResultTable("The photographed paintings, mean over photographs and seeds", results.means("painted")),
                ResultTable("All paintings", results.rows()),
            ),
            tuple(_note(measure, results, list(by_name)) for measure in _MORE_IS_BETTER),
            {NAME: _sheet(photographs, results, seeds[0])},
        )

    trials = [
        PaintingTrial.of(
            {"photograph": photo.name, "seed": seed, "painted": way},
            paintings.like(scale, photo.picture, [{kind: str(photo.path)}], seed),
        )
        for seed in seeds
        for photo in photographs
        for way, kind in WAYS.items()
    ]
    return paintings.experiment(trials, measure, report, encoders)


def _note(measure: str, results: Results, names: Sequence[str]) -> str:
    """Returns a sentence on one measure: the number of paintings in which meaning is better, and the exceptions."""
    sign = 1 if _MORE_IS_BETTER[measure] else -1
    gain = {}
    for name in names:
        meaning, pixels = (np.array(results.values(measure, photograph=name, painted=way)) for way in (MEANING, PIXELS))
        gain[name] = sign * (meaning - pixels)
    better = sum(int((gains > 0).sum()) for gains in gain.values())
    worse = [name for name, gains in gain.items() if np.mean(gains) <= 0]
    lost = f"; not for {', '.join(worse)}" if 0 < len(worse) < len(names) else ""
    return (
        f"By {measure}, painting by meaning wins {better} of {sum(map(len, gain.values()))} times: "
        f"{results.mean(measure, painted=MEANING):.3g} against {results.mean(measure, painted=PIXELS):.3g} "
        f"in the mean{lost}."
    )


def _sheet(photographs: Sequence[Target], results: Results, seed: int) -> Tensor:
    lines = []
    for photo in photographs:
        findings = [results.one(photograph=photo.name, seed=seed, painted=way) for way in WAYS]
        size = findings[0].pictures["painting"].shape[1:]
        cells = [Cell(images.fit(photo.picture, *size))]
        for finding in findings:
            words = f"features {finding.numbers[FEATURES]:.3f}, edges {finding.numbers[EDGES]:.2f}"
            cells.append(Cell(finding.pictures["painting"], words))
        lines.append(FigureRow("", cells))
    return page("", ("photograph", *(f"painted {way}" for way in WAYS)), lines, width=300)
