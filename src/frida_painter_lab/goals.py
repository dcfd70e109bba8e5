"""Experiments about goals that networks judge: text, style, semantic and sketch (paper, section "High-Level Goals").

Instead of people, networks that no optimiser uses judge the photographed paintings, beside edges and pixels.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, ClassVar

import numpy as np
import torch
from torch import Tensor

from frida_painter import images, weights
from frida_painter.objectives.encoders.convolutional import EfficientNetLite
from frida_painter.objectives.sketch import SketchTerm
from frida_painter.objectives.style import LAYERS as SEEN
from frida_painter.objectives.style import cosine_cost, euclidean_cost
from frida_painter.planning.initialize import uniform
from frida_painter.render import render
from frida_painter.report.sheets import Cell, FigureRow, page
from frida_painter.runs.run import PaintingRun
from frida_painter.runs.spec import RunSpec
from frida_painter_lab.comparison import Comparison, PaintingWay, Scene, image
from frida_painter_lab.experiment import Measurement, Notify, Results, ResultTable, Row
from frida_painter_lab.measures import (
    direction_agreement,
    edge_correlation,
    edge_score,
    exact_emd,
    feature_distance,
    perceptual_distance,
    psnr,
)
from frida_painter_lab.paintings import Painted, PaintingExperiment, StudioRun
from frida_painter_lab.runs import Value
from frida_painter_lab.targets import Target

SECONDS = "CPU s"


@dataclass(frozen=True, kw_only=True)
class JudgedExperiment(PaintingExperiment):
    """Experiment whose paintings are judged by a network that no optimiser uses.

    judge_network: that network; None for the one named JUDGE
    """

    JUDGE = "efficientnet-lite1"

    judge_network: EfficientNetLite | None = None

    @cached_property
    def seer(self) -> EfficientNetLite:
        """Network that judges. Raises WeightsError if it was not fetched."""
        return self.judge_network or EfficientNetLite(weights.tensors(self.JUDGE))

    def prepare(self, notify: Notify) -> "JudgedExperiment":
        """Returns the experiment, after a check for its network. Raises WeightsError."""
        assert self.seer is not None
        return self


# Words, judged by a classifier: the probability of each of its thousand classes in the middle square of a picture.

PAINTED, PIXELS, BEGUN, RANDOM = "words", "pixels of the beginning", "the beginning itself", "random strokes"
TEXT_WAYS = {PAINTED: "painted towards the words", PIXELS: PIXELS, BEGUN: BEGUN, RANDOM: RANDOM}
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


@torch.no_grad()
def log_probabilities(judge: EfficientNetLite, picture: Tensor) -> list[float]:
    """Returns the judge's log probability of each class, [1000], in the middle square of a picture [3, H, W]."""
    found: list[float] = judge.logits(images.fit(picture, _SEEN, _SEEN)[None]).log_softmax(1)[0].tolist()
    return found


def logs_of(finding: Measurement, way: str) -> Tensor:
    """Returns the judge's log probabilities of one way, [1000]."""
    return torch.tensor([value for name, value in finding.numbers.items() if name.rpartition(" ")[0] == way])


def rank_of(logs: Tensor, prompt: Prompt) -> int:
    """Returns the rank of a prompt's likeliest class by log probabilities [1000]; 1 is the best."""
    return int((logs > logs[list(prompt.classes)].max()).sum()) + 1


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

    first: int = len(PROMPTS)

    @property
    def prompts(self) -> Sequence[Prompt]:
        """Prompts that are painted."""
        return PROMPTS[: min(self.first, 2) if self.quick else self.first]

    def runs(self) -> Sequence[StudioRun]:
        """Returns a painting for each seed and prompt."""
        return [
            StudioRun.of(
                {"prompt": prompt.words, "seed": seed},
                self.common.with_values(goal=[{"text": prompt.words}], seed=seed, fit="crop", film=False),
            )
            for seed in self.seeds
            for prompt in self.prompts
        ]

    def judge(self, run: StudioRun, painted: Painted) -> Measurement:
        """Measures the judge's log probability of every class for the painting and its floors."""
        pictures = {PAINTED: painted.photograph, **_paint_floors(painted)}
        numbers = {
            f"{way} {number}": value
            for way, picture in pictures.items()
            for number, value in enumerate(log_probabilities(self.seer, picture))
        }
        return Measurement(numbers, {"begun": pictures[BEGUN], "plan": painted.planned, "painting": painted.photograph})

    def settings(self) -> Mapping[str, Value | Sequence[Value]]:
        """Returns the settings, the prompts, and what reads them."""
        by_clip = self.networks.reads_by_clip
        reader = self.networks.reader().name if by_clip else "pictures by their captions"
        return {**super().settings(), "prompts": [prompt.words for prompt in self.prompts], "seen through": reader}

    def tables(self, results: Results) -> Sequence[ResultTable]:
        """Returns the shares over all paintings, and the ranks of each."""
        summary = [self._summary(results, way) for way in TEXT_WAYS]
        rows = [self._row(results, prompt, seed) for seed in self.seeds for prompt in self.prompts]
        return [ResultTable("Over all paintings", summary), ResultTable("Every painting", rows)]

    def _rank(self, results: Results, prompt: Prompt, seed: int, way: str) -> int:
        return rank_of(logs_of(results.one(prompt=prompt.words, seed=seed), way), prompt)

    def _first(self, results: Results, prompt: Prompt, seed: int, way: str) -> float:
        """Returns 1 if no other prompt's picture shows this prompt's classes with a higher probability, otherwise 0.

        Among n equally probable pictures, each gets 1/n.
        """
        classes = list(prompt.classes)
        logs = {
            other.words: float(logs_of(results.one(prompt=other.words, seed=seed), way)[classes].logsumexp(0))
            for other in self.prompts
        }
        best = [words for words, value in logs.items() if value == max(logs.values())]
        return 1 / len(best) if prompt.words in best else 0.0

    def _summary(self, results: Results, way: str) -> Row:
        pairs = list(product(self.prompts, self.seeds))
        ranks = np.array([self._rank(results, *pair, way) for pair in pairs])
        return {
            "judged": TEXT_WAYS[way],
            "within 5": float((ranks <= 5).mean()),
            "within 50": float((ranks <= 50).mean()),
            "median rank": float(torch.tensor(ranks).float().median()),
            "first among all": float(np.mean([self._first(results, *pair, way) for pair in pairs])),
        }

    def _row(self, results: Results, prompt: Prompt, seed: int) -> Row:
        logs = logs_of(results.one(prompt=prompt.words, seed=seed), PAINTED)
        return {
            "prompt": prompt.words,
            "seed": seed,
            "rank": rank_of(logs, prompt),
            "probability": float(logs[list(prompt.classes)].exp().sum()),
            "first among all": self._first(results, prompt, seed, PAINTED) == 1,
            **{f"rank, {way}": self._rank(results, prompt, seed, way) for way in list(TEXT_WAYS)[1:]},
        }

    def pictures(self, results: Results) -> Mapping[str, Tensor]:
        """Returns the sheet of the first seed."""
        lines = []
        for prompt in self.prompts:
            finding = results.one(prompt=prompt.words, seed=self.seeds[0])
            label = f"“{prompt.words}”\nrank {rank_of(logs_of(finding, PAINTED), prompt)}"
            lines.append(FigureRow(label, [Cell(picture) for picture in finding.pictures.values()]))
        headings = ("begun with", "planned", "painted, photographed")
        return {"paintings": page("Painted towards words", headings, lines, width=260)}


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


def style(target: Target) -> Mapping[str, Any]:
    """Returns the part of a goal that paints in the style of a picture."""
    return {"style": str(target.path)}


@dataclass(frozen=True, kw_only=True)
class StyleExperiment(JudgedExperiment, Comparison):
    """Experiment `style`: every photograph painted unstyled, in every style, and begun with that style's picture.

    The distance in style is the Earth Mover's Distance between clouds of features that the optimiser did not use:
    VGG16 layers between those that it uses, and another network.
    """

    NAME = "style"
    TITLE = "Photographs painted in the style of other pictures"
    LABELS = ("photograph", "style")
    MEASURES: ClassVar[Mapping[str, bool | None]] = {
        "VGG16": False,
        "Lite1": False,
        "colours": False,
        "edges like the photograph's": True,
        "edges like the style's": True,
        "strokes like the style's": True,
        SECONDS: None,
    }

    photos: tuple[Target, ...]
    styles: tuple[Target, ...]
    seeds: tuple[int, ...] = (0, 1)

    def scenes(self) -> Sequence[Scene]:
        """Returns each photograph with each style."""
        return list(product(self.photos, self.styles))

    def ways(self) -> Sequence[PaintingWay]:
        """Returns the three ways."""
        return [
            PaintingWay("unstyled"),
            PaintingWay("styled", "unstyled", goal=lambda photo, look: [image(photo), style(look)]),
            PaintingWay(
                "begun with the style",
                "styled",
                goal=lambda photo, look: [image(photo, _LIGHT), style(look)],
                initial=lambda photo, look: [style(look)],
                canvas=1,
            ),
        ]

    def figures(self, painted: Painted, picture: Tensor, *scene: Target) -> Mapping[str, float]:
        """Measures the distances in style, edges, and the directions of the strokes."""
        photo, look = (target.picture for target in scene)
        rest = (
            edge_correlation(picture, photo),
            edge_correlation(picture, look),
            direction_agreement(painted.plan.strokes, look, painted.plan.canvas),
            painted.seconds,
        )
        return dict(zip(self.MEASURES, (*self._distances(picture, look), *rest), strict=True))

    @torch.no_grad()
    def _distances(self, picture: Tensor, look: Tensor) -> list[float]:
        """Returns the distances in style by VGG16, by the network that judges, and by colours."""
        found = []
        for one, other, cost in zip(
            self._clouds(picture), self._clouds(look), (cosine_cost, cosine_cost, euclidean_cost), strict=True
        ):
            apart = [exact_emd(cost(*_sample(a, b))) for a, b in zip(one, other, strict=True)]
            found.append(float(np.mean(apart)))
        return found

    def _clouds(self, picture: Tensor) -> list[list[Tensor]]:
        """Returns the features of each network at all places, [n, c] for each of its layers, and last the colours."""
        small = images.fit(picture, _STYLE_ROWS, round(_STYLE_ROWS * picture.shape[2] / picture.shape[1]))
        lite = [layer[0] for layer in self.seer.features(small[None])]
        layers_of = (self.networks.style().features(small, UNSEEN), lite, [small])
        return [[layer.flatten(1).T for layer in layers] for layers in layers_of]


def _sample(a: Tensor, b: Tensor) -> tuple[Tensor, Tensor]:
    """Returns equally many random rows of both clouds [n, c] and [m, c], at most _PLACES."""
    count = min(len(a), len(b), _PLACES)
    chance = torch.Generator().manual_seed(0)
    return a[torch.randperm(len(a), generator=chance)[:count]], b[torch.randperm(len(b), generator=chance)[:count]]


# Content (paper: "Semantic Replication"; people preferred painting by meaning).

_SIDE = 240  # pixels of the judge's views


@dataclass(frozen=True, kw_only=True)
class SemanticExperiment(JudgedExperiment, Comparison):
    """Experiment `semantic`: every photograph painted by pixels and by meaning, with the same few strokes.

    Features of the network that judges, VGG16's features as in LPIPS, edges and pixels compare with the photograph.
    """

    NAME = "semantic"
    TITLE = "Photographs painted by meaning and by pixels"
    LABELS = ("photograph",)
    MEASURES: ClassVar[Mapping[str, bool | None]] = {
        "feature distance": False,
        "LPIPS-like": False,
        "edge F-score": True,
        "PSNR, dB": True,
        SECONDS: None,
    }

    photos: tuple[Target, ...]
    seeds: tuple[int, ...] = (0, 1)

    def scenes(self) -> Sequence[Scene]:
        """Returns the photographs."""
        return [(photo,) for photo in self.photos]

    def ways(self) -> Sequence[PaintingWay]:
        """Returns the two ways."""
        meaning = PaintingWay("by meaning", "by pixels", goal=lambda photo: [{"semantic": str(photo.path)}])
        return [PaintingWay("by pixels"), meaning]

    def figures(self, painted: Painted, picture: Tensor, *scene: Target) -> Mapping[str, float]:
        """Measures the distances between painting and photograph."""
        target = images.fit(scene[0].picture, *picture.shape[1:])
        found = (
            feature_distance(self.seer, picture, target, _SIDE),
            perceptual_distance(self.networks.style(), picture, target),
            edge_score(picture, target),
            psnr(picture, target),
            painted.seconds,
        )
        return dict(zip(self.MEASURES, found, strict=True))


# An outline and words: how well does the sketch objective keep a painting to the drawing?


@dataclass(frozen=True, kw_only=True)
class SketchExperiment(Comparison):
    """Experiment `sketch`: every drawing painted in four ways; the words are the drawing's name.

    The measure is the F-score of the painting's edges against the drawing's. The edges are Canny's, because the
    objective uses HED.

    style: of the fourth way
    """

    NAME = "sketch"
    TITLE = "Drawings painted with words"
    LABELS = ("drawing", "style")
    MEASURES: ClassVar[Mapping[str, bool | None]] = {"edge F-score": True, SECONDS: None}

    drawings: tuple[Target, ...]
    style: Target
    seeds: tuple[int, ...] = (0, 1)

    def scenes(self) -> Sequence[Scene]:
        """Returns each drawing with the style."""
        return [(drawing, self.style) for drawing in self.drawings]

    def ways(self) -> Sequence[PaintingWay]:
        """Returns the four ways."""

        def say(drawing: Target, look: Target) -> Mapping[str, Any]:
            return {"text": f"a {drawing.name.replace('-', ' ').replace('_', ' ')}"}

        def trace(drawing: Target, look: Target) -> Mapping[str, Any]:
            return {"sketch": str(drawing.path)}

        begun, sketched = "words, begun with the drawing", "words and sketch"
        return [
            PaintingWay("words", goal=lambda *scene: [say(*scene)]),
            PaintingWay(
                begun, "words", goal=lambda *scene: [say(*scene)], initial=lambda drawing, look: [image(drawing)]
            ),
            PaintingWay(sketched, begun, goal=lambda *scene: [say(*scene), trace(*scene)]),
            PaintingWay(
                f"{sketched} in a style", sketched, goal=lambda *scene: [say(*scene), trace(*scene), style(scene[1])]
            ),
        ]

    def figures(self, painted: Painted, picture: Tensor, *scene: Target) -> Mapping[str, float]:
        """Measures how the edges agree with the drawing's."""
        lines = SketchTerm(scene[0].picture).drawing
        edges = edge_score(picture, images.fit(lines, *picture.shape[1:]))
        return dict(zip(self.MEASURES, (edges, painted.seconds), strict=True))
