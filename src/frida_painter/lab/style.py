"""Experiment: is a styled painting nearer to the style than an unstyled one of the same photograph? (Paper: "Style".)

The distance in style is the Earth Mover's Distance between clouds of features that the optimiser did not use: VGG16
layers between those that it uses, and a different network. It is given in the optimiser's relaxed form and exactly.
"""

from collections.abc import Sequence
from itertools import product

import numpy as np
import torch
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
    direction_agreement,
    edge_correlation,
    exact_emd,
)
from frida_painter.objectives.encoders.base import Seer
from frida_painter.objectives.encoders.classifiers import EfficientNetLite
from frida_painter.objectives.encoders.loading import EncoderRegistry
from frida_painter.objectives.encoders.vgg import Vgg16
from frida_painter.objectives.style_loss import LAYERS as SEEN
from frida_painter.objectives.style_loss import cosine_cost, euclidean_cost, relaxed_emd
from frida_painter.report.sheets import Cell, FigureRow, page
from frida_painter.runs.spec import RunSpec
from frida_painter.session.opening import planning_device

NAME = "style"
UNSTYLED, STYLED, BEGUN = "unstyled", "styled", "begun with the style"
WAYS = (UNSTYLED, STYLED, BEGUN)
JUDGE = "efficientnet-lite1"
UNSEEN = ("conv2_1", "conv3_2", "conv4_2")
_ROWS = 192  # of the pictures whose features are compared
_PLACES = 500  # number of places that are compared
_LIGHT = 0.25  # weight of the photograph if a painting begins with the style and keeps its composition
_EDGES = "edges like the style's"
_DIRECTIONS = "strokes like the style's"
_NETWORKS = ("VGG16", "Lite1", "colours")
assert not set(SEEN) & set(UNSEEN)


def experiment(
    photographs: Sequence[Target],
    styles: Sequence[Target],
    *,
    seeds: Sequence[int] = (0, 1),
    scale: RunSpec = FULL,
    encoders: EncoderRegistry | None = None,
    judge: Seer | None = None,
) -> Experiment[PaintingTrial]:
    """Returns the experiment: every photograph painted unstyled, in every style, and begun with that style's picture.

    encoders: networks of the goals
    judge: network that they do not use; None for EfficientNet-Lite1

    Raises WeightsError if a network is missing.
    """
    encoders = encoders or EncoderRegistry(device=planning_device())
    judge = judge or EfficientNetLite(weights.tensors(JUDGE))
    photos, looks = ({one.name: one.picture for one in some} for some in (photographs, styles))

    def measure(trial: PaintingTrial, painted: Painted) -> Measurement:
        picture, style = painted.photograph, looks[trial["style"]]
        return Measurement(
            {
                **_distances(encoders.style(), judge, picture, style),
                "edges like the photograph's": edge_correlation(picture, photos[trial["photograph"]]),
                _EDGES: edge_correlation(picture, style),
                _DIRECTIONS: direction_agreement(painted.plan.strokes, style, painted.plan.canvas),
                "CPU s": painted.seconds,
            },
            {"painting": picture},
        )

    def report(results: Results) -> Outcome:
        return Outcome(
            NAME,
            "Photographs painted in the style of other pictures",
            {
                "photographs": tuple(photos), "styles": tuple(looks), "seeds": tuple(seeds),
                **paintings.settings(scale), "layers not seen": UNSEEN,
            },
            (ResultTable("Distance in style of the photographed paintings, mean", results.means("painted")),
             ResultTable("All paintings", results.rows())),
            (_note(results), _composition_note(results), _marks_note(results)),
            {NAME: _sheet(photographs, styles, results, seeds[0])},
        )  # fmt: skip

    trials = [
        PaintingTrial.of(
            {"photograph": photo.name, "style": style.name, "seed": seed, "painted": way},
            _spec(scale, photo, style, seed, way),
        )
        for seed in seeds
        for photo in photographs
        for style in styles
        for way in WAYS
    ]
    return paintings.experiment(trials, measure, report, encoders)


def _spec(scale: RunSpec, photo: Target, style: Target, seed: int, way: str) -> RunSpec:
    image, styled = {"image": str(photo.path)}, {"style": str(style.path)}
    if way == BEGUN:
        light = {**image, "weight": _LIGHT}
        return paintings.like(scale, style.picture, [light, styled], seed, initial=[{"image": str(style.path)}])
    return paintings.like(scale, photo.picture, [image, styled] if way == STYLED else [image], seed)


@torch.no_grad()
def _distances(vgg: Vgg16, judge: Seer, picture: Tensor, style: Tensor) -> dict[str, float]:
    """Returns relaxed and exact distances in style, by network."""
    found = {}
    for network, clouds in zip(
        _NETWORKS, zip(_clouds(vgg, judge, picture), _clouds(vgg, judge, style), strict=True), strict=True
    ):
        costs = [
            (euclidean_cost if network == "colours" else cosine_cost)(*_sample(a, b))
            for a, b in zip(*clouds, strict=True)
        ]
        found[f"{network}, relaxed"] = float(np.mean([float(relaxed_emd(cost)) for cost in costs]))
        found[f"{network}, exact"] = float(np.mean([exact_emd(cost) for cost in costs]))
    return found


def _clouds(vgg: Vgg16, judge: Seer, picture: Tensor) -> list[list[Tensor]]:
    """Returns the features of each network at all places, [n, c] for each of its layers, and last the colours."""
    small = images.fit(picture, _ROWS, round(_ROWS * picture.shape[2] / picture.shape[1]))
    lite = [layer[0] for layer in judge.features(small[None])]
    return [[layer.flatten(1).T for layer in layers] for layers in (vgg.features(small, UNSEEN), lite, [small])]


def _sample(a: Tensor, b: Tensor) -> tuple[Tensor, Tensor]:
    """Returns equally many random rows of both clouds [n, c] and [m, c], at most _PLACES."""
    count = min(len(a), len(b), _PLACES)
    chance = torch.Generator().manual_seed(0)
    return a[torch.randperm(len(a), generator=chance)[:count]], b[torch.randperm(len(b), generator=chance)[:count]]


def _note(results: Results) -> str:
    parts = []
    for network in _NETWORKS:
        styled, unstyled = (np.array(results.values(f"{network}, exact", painted=way)) for way in (STYLED, UNSTYLED))
        parts.append(
            f"{network}: {styled.mean():.3f} against {unstyled.mean():.3f}, nearer in {(styled < unstyled).sum()} of "
            f"{len(styled)}"
        )
    return (
        "Styled paintings against unstyled ones, exact distance in style on features that were not optimised: "
        + "; ".join(parts)
        + "."
    )


def _composition_note(results: Results) -> str:
    begun, styled = (results.mean(_EDGES, painted=way) for way in (BEGUN, STYLED))
    return (
        "The edges of a painting begun with the style picture correlate with that picture's own composition by "
        f"{begun:.2f}; by {styled:.2f} where the painting began with the photograph."
    )


def _marks_note(results: Results) -> str:
    unstyled, styled, begun = (results.mean(_DIRECTIONS, painted=way) for way in WAYS)
    return (
        f"Strokes go the way of the style's own marks by {styled:.2f} (circular correlation of their directions) where "
        f"the photograph has no direction of its own to give, {begun:.2f} begun with the style, and {unstyled:.2f} "
        "without it."
    )


def _sheet(photographs: Sequence[Target], styles: Sequence[Target], results: Results, seed: int) -> Tensor:
    lines = []
    for photo, style in product(photographs, styles):
        cells = [Cell(photo.picture), Cell(style.picture)]
        for way in WAYS:
            finding = results.one(photograph=photo.name, style=style.name, seed=seed, painted=way)
            cells.append(Cell(finding.pictures["painting"], f"distance {finding.numbers['VGG16, exact']:.3f}"))
        lines.append(FigureRow("", cells))
    headings = ("photograph", "style", *(f"painted {way}" for way in WAYS))
    return page("", headings, lines, width=230)
