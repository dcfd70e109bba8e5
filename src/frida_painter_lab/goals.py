"""Experiments about goals that networks judge: text, style, semantic and sketch (paper, section "High-Level Goals").

Instead of people, networks that no optimiser uses judge the photographed paintings, beside edges and pixels.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from frida_painter.objectives import weights
from frida_painter.objectives.encoders.convolutional import EfficientNetLite
from frida_painter.objectives.sketch import SketchTerm
from frida_painter.objectives.style import LAYERS as SEEN
from frida_painter.objectives.style import cosine_cost, euclidean_cost
from frida_painter.planning.initialize import uniform
from frida_painter.render import render
from frida_painter.runs.run import PaintingRun
from frida_painter.runs.spec import RunSpec
from frida_painter.system import images
from frida_painter_lab import measures
from frida_painter_lab.experiment import Notify, Results, ResultTable, Row
from frida_painter_lab.paintings import Comparison, Painted, PaintingWay, Scene
from frida_painter_lab.runs import Labels, Value
from frida_painter_lab.targets import Target

SECONDS = "CPU s"


@dataclass(frozen=True, kw_only=True)
class JudgedExperiment(Comparison):
    """Experiment whose paintings are judged by a network that no optimiser uses, the one named JUDGE."""

    JUDGE: ClassVar[str] = "efficientnet-lite1"

    @cached_property
    def seer(self) -> EfficientNetLite:
        """Network that judges. Raises WeightsError if it was not fetched."""
        return EfficientNetLite(weights.tensors(self.JUDGE))

    def prepare(self, notify: Notify) -> "JudgedExperiment":
        """Returns the experiment, after a check for its network. Raises WeightsError."""
        assert self.seer is not None
        return self


# Words, judged by a classifier: the probability of each of its thousand classes in the middle square of a picture.

PAINTED, PIXELS, BEGUN, RANDOM = "words", "pixels of the beginning", "the beginning itself", "random strokes"
TEXT_WAYS = (PAINTED, PIXELS, BEGUN, RANDOM)
_SEEN = 260  # pixels of the judge's input square


@dataclass(frozen=True)
class Prompt:
    """Prompt with the numbers of the classes that it may mean."""

    words: str
    classes: tuple[int, ...]


PROMPTS = (
    Prompt("a banana", (954,)),
    Prompt("a castle", (483,)),
    Prompt("a goldfish", (1,)),
    Prompt("a green apple", (948,)),
    Prompt("a hot air balloon", (417,)),
    Prompt("a ladybug", (301,)),
    Prompt("a lemon", (951,)),
    Prompt("a lighthouse", (437,)),
    Prompt("a monarch butterfly", (323,)),
    Prompt("a mushroom", (947, 992)),  # mushroom, agaric
    Prompt("a pineapple", (953,)),
    Prompt("a pizza", (963,)),
    Prompt("a red strawberry", (949,)),
    Prompt("a sailing ship", (780, 914, 724)),  # schooner, yawl, pirate ship
    Prompt("a steam train", (820,)),
    Prompt("a teapot", (849,)),
    Prompt("a traffic light", (920,)),
    Prompt("an umbrella", (879,)),
    Prompt("a volcano", (980,)),
    Prompt("a yellow school bus", (779,)),
)


@dataclass(frozen=True, kw_only=True)
class TextExperiment(JudgedExperiment):
    """Experiment `text`: every prompt painted once per seed, with looks in between, and judged by a classifier.

    Floors are a plan for the pixels of the prompt's initial picture, that picture itself, and random strokes. They
    are judged as simulated, which is an advantage for them.

    first: number of prompts
    """

    NAME = "text"
    TITLE = "Paintings towards words, and what an unseen network takes them for"
    FULL = RunSpec.of(strokes=100, colors=12, replans=2)
    QUICK = RunSpec.of(strokes=6, colors=3, render_height=64, effort=0.05, replans=1)
    JUDGE = "efficientnet-lite2"
    LABELS = ("prompt",)
    MEASURES: ClassVar[Mapping[str, bool | None]] = {f"rank, {way}": False for way in TEXT_WAYS}
    WAYS = (PaintingWay(PAINTED, goal=({"text": "{0.words}"},)),)  # the floors are measured beside it
    SHOWN = ("simulated", "painting")

    first: int = len(PROMPTS)

    @property
    def prompts(self) -> Sequence[Prompt]:
        """Prompts that are painted."""
        return PROMPTS[: min(self.first, 2) if self.quick else self.first]

    def scenes(self) -> Sequence[Scene]:
        """Returns the prompts, each as its words on a blank card."""
        return [(Target(prompt.words, Path(), torch.ones(3, 3, 4)),) for prompt in self.prompts]

    @torch.no_grad()
    def figures(self, painted: Painted, picture: Tensor, *scene: Target) -> Mapping[str, float]:
        """Measures for the painting and its floors the rank of the prompt among all classes; 1 is the best.

        And for each prompt the log probability of its classes.
        """
        numbers: dict[str, float] = {}
        for way, shown in {PAINTED: picture, **_paint_floors(painted)}.items():
            logs = self.seer.logits(images.fit(shown, _SEEN, _SEEN)[None]).log_softmax(1)[0]
            for prompt in self.prompts:
                its = logs[list(prompt.classes)]
                numbers[f"{way}: {prompt.words}"] = float(its.logsumexp(0))
                if prompt.words == scene[0].name:
                    numbers[f"rank, {way}"] = int((logs > its.max()).sum()) + 1
        return {name: numbers[name] for name in sorted(numbers, key=lambda name: name not in self.MEASURES)}

    def settings(self) -> Mapping[str, Value | Sequence[Value]]:
        """Returns the settings, and what reads the prompts."""
        by_clip = self.networks.reads_by_clip
        return {**super().settings(), "seen through": self.networks.reader().name if by_clip else "their captions"}

    def tables(self, results: Results) -> Sequence[ResultTable]:
        """Returns the shares over all paintings, and the ranks of each."""
        summary: list[Row] = []
        for way in TEXT_WAYS:
            ranks = np.array(results.values(f"rank, {way}"))
            summary.append({
                "judged": way,
                "within 5": float((ranks <= 5).mean()),
                "within 50": float((ranks <= 50).mean()),
                "median rank": float(np.median(ranks)),
                "first among all": float(np.mean([self._first(results, labels, way) for labels, _ in results.found])),
            })  # fmt: skip
        every: list[Row] = [
            {
                "prompt": labels["prompt"],
                "seed": labels["seed"],
                "probability": float(np.exp(one.numbers[f"{PAINTED}: {labels['prompt']}"])),
                "first among all": self._first(results, labels, PAINTED) == 1,
                **{name: int(one.numbers[name]) for name in self.MEASURES},
            }
            for labels, one in results.found
        ]
        return [ResultTable("Over all paintings", summary), ResultTable("Every painting", every)]

    def _first(self, results: Results, labels: Labels, way: str) -> float:
        """Returns 1 if no other prompt's picture shows this prompt's classes with a higher probability, otherwise 0.

        Among n equally probable pictures, each gets 1/n.
        """
        shows = f"{way}: {labels['prompt']}"
        all_ = results.values(shows, seed=labels["seed"])
        own = results.values(shows, seed=labels["seed"], prompt=labels["prompt"])[0]
        return 1 / all_.count(own) if own == max(all_) else 0.0


def _paint_floors(painted: Painted) -> dict[str, Tensor]:
    """Returns the floors: a plan for the initial picture's pixels, that picture itself, and random strokes."""
    planner, spec = painted.run.planner, painted.run.spec
    begun = next(term.picture for term in planner.goal.initial if term.picture is not None)
    with TemporaryDirectory() as folder:
        picture = Path(folder) / "begun.png"
        images.save(begun, picture)
        with PaintingRun(spec.with_values(goal=[{"image": str(picture)}])) as run:
            pixels = run.planner.expected(run.plan(), planner.bare)
    model = planner.models[planner.kinds[0]]
    generator = torch.Generator().manual_seed(spec.seed)
    scattered = uniform(spec.strokes, model.limits.within(spec.canvas), spec.canvas, generator)
    with torch.no_grad():
        random = render(scattered, model, planner.bare, spec.canvas)
    return {PIXELS: pixels, BEGUN: begun, RANDOM: random}


# Styles: is a styled painting nearer to the style, on features that the optimiser did not use?

UNSEEN = ("conv2_1", "conv3_2", "conv4_2")
"""Layers of VGG16 between those that the optimiser uses."""
_STYLE_ROWS = 192  # of the pictures whose features are compared
_PLACES = 500  # number of places that are compared
_LIGHT = 0.25  # weight of the photograph if a painting begins with the style and keeps its composition
assert not set(SEEN) & set(UNSEEN)


@dataclass(frozen=True, kw_only=True)
class StyleExperiment(JudgedExperiment):
    """Experiment `style`: every photograph painted unstyled, in every style, and begun with that style's picture.

    The distance in style is the Earth Mover's Distance between clouds of features that the optimiser did not use:
    VGG16 layers between those that it uses, and another network.
    """

    NAME = "style"
    TITLE = "Photographs painted in the style of other pictures"
    PICTURES = ("photos", "styles")
    LABELS = ("photograph", "style")
    WAYS = (
        PaintingWay("unstyled"),
        PaintingWay("styled", "unstyled", goal=({"image": "{0.path}"}, {"style": "{1.path}"})),
        PaintingWay(
            "begun with the style", "styled",
            goal=({"image": "{0.path}", "weight": _LIGHT}, {"style": "{1.path}"}),
            initial=({"style": "{1.path}"},), canvas=1,
        ),
    )  # fmt: skip
    MEASURES: ClassVar[Mapping[str, bool | None]] = {
        "VGG16": False, "Lite1": False, "colours": False, "edges like the photograph's": True,
        "edges like the style's": True, "strokes like the style's": True, SECONDS: None,
    }  # fmt: skip

    photos: tuple[Target, ...]
    styles: tuple[Target, ...]
    seeds: tuple[int, ...] = (0, 1)

    def figures(self, painted: Painted, picture: Tensor, *scene: Target) -> Mapping[str, float]:
        """Measures the distances in style, edges, and the directions of the strokes."""
        photo, look = (target.picture for target in scene)
        rest = (
            measures.edge_correlation(picture, photo),
            measures.edge_correlation(picture, look),
            measures.direction_agreement(painted.plan.strokes, look, painted.plan.canvas),
            painted.seconds,
        )
        return dict(zip(self.MEASURES, (*self._distances(picture, look), *rest), strict=True))

    @torch.no_grad()
    def _distances(self, picture: Tensor, look: Tensor) -> list[float]:
        """Returns the distances in style by VGG16, by the network that judges, and by colours."""
        clouds = zip(self._clouds(picture), self._clouds(look), (cosine_cost, cosine_cost, euclidean_cost), strict=True)
        found = []
        for one, other, cost in clouds:
            chance = torch.Generator().manual_seed(0)
            apart = []
            for pair in zip(one, other, strict=True):
                count = min(*map(len, pair), _PLACES)
                a, b = (part[torch.randperm(len(part), generator=chance)[:count]] for part in pair)
                apart.append(measures.exact_emd(cost(a, b)))
            found.append(float(np.mean(apart)))
        return found

    def _clouds(self, picture: Tensor) -> list[list[Tensor]]:
        """Returns the features of each network at all places, [n, c] for each of its layers, and last the colours."""
        small = images.fit(picture, _STYLE_ROWS, round(_STYLE_ROWS * picture.shape[2] / picture.shape[1]))
        lite = [layer[0] for layer in self.seer.features(small[None])]
        layers_of = (self.networks.style().features(small, UNSEEN), lite, [small])
        return [[layer.flatten(1).T for layer in layers] for layers in layers_of]


# Content (paper: "Semantic Replication"; people preferred painting by meaning).

_SIDE = 240  # pixels of the judge's views


@dataclass(frozen=True, kw_only=True)
class SemanticExperiment(JudgedExperiment):
    """Experiment `semantic`: every photograph painted by pixels and by meaning, with the same few strokes.

    Features of the network that judges, VGG16's features as in LPIPS, edges and pixels compare with the photograph.
    """

    NAME = "semantic"
    TITLE = "Photographs painted by meaning and by pixels"
    LABELS = ("photograph",)
    WAYS = (PaintingWay("by pixels"), PaintingWay("by meaning", "by pixels", goal=({"semantic": "{0.path}"},)))
    MEASURES: ClassVar[Mapping[str, bool | None]] = {
        "feature distance": False, "LPIPS-like": False, "edge F-score": True, "PSNR, dB": True, SECONDS: None,
    }  # fmt: skip

    photos: tuple[Target, ...]
    seeds: tuple[int, ...] = (0, 1)

    def figures(self, painted: Painted, picture: Tensor, *scene: Target) -> Mapping[str, float]:
        """Measures the distances between painting and photograph."""
        target = images.fit(scene[0].picture, *picture.shape[1:])
        found = (
            measures.feature_distance(self.seer, picture, target, _SIDE),
            measures.perceptual_distance(self.networks.style(), picture, target),
            measures.edge_score(picture, target),
            measures.psnr(picture, target),
            painted.seconds,
        )
        return dict(zip(self.MEASURES, found, strict=True))


# An outline and words: how well does the sketch objective keep a painting to the drawing?

_SAID, _TRACED = {"text": "a {0.words}"}, {"sketch": "{0.path}"}


@dataclass(frozen=True, kw_only=True)
class SketchExperiment(Comparison):
    """Experiment `sketch`: every drawing painted in four ways; the words are the drawing's name.

    The measure is the F-score of the painting's edges against the drawing's. The edges are Canny's, because the
    objective uses HED.

    style: of the fourth way
    """

    NAME = "sketch"
    TITLE = "Drawings painted with words"
    PICTURES = ("drawings", "style")
    LABELS = ("drawing", "style")
    WAYS = (
        PaintingWay("words", goal=(_SAID,)),
        PaintingWay("words, begun with the drawing", "words", goal=(_SAID,), initial=({"image": "{0.path}"},)),
        PaintingWay("words and sketch", "words, begun with the drawing", goal=(_SAID, _TRACED)),
        PaintingWay("words and sketch in a style", "words and sketch", goal=(_SAID, _TRACED, {"style": "{1.path}"})),
    )
    MEASURES: ClassVar[Mapping[str, bool | None]] = {"edge F-score": True, SECONDS: None}

    drawings: tuple[Target, ...]
    style: Target
    seeds: tuple[int, ...] = (0, 1)

    def figures(self, painted: Painted, picture: Tensor, *scene: Target) -> Mapping[str, float]:
        """Measures how the edges agree with the drawing's."""
        lines = SketchTerm(scene[0].picture).drawing
        edges = measures.edge_score(picture, images.fit(lines, *picture.shape[1:]))
        return dict(zip(self.MEASURES, (edges, painted.seconds), strict=True))
