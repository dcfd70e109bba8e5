"""Experiment: paintings for text prompts, judged by a network that their planning never uses.

Each prompt is planned, painted by the virtual robot with looks in between, and photographed. The judge is a
classifier. It gives the probability of each of its thousand classes in the middle square of the photograph.

Floors are a plan for the pixels of the prompt's initial picture, that picture itself, and random strokes. They are
judged as simulated, which is an advantage for them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import torch
from torch import Tensor

from frida_painter import images, weights
from frida_painter.lab import paintings
from frida_painter.lab.paintings import Painted, PaintingTrial
from frida_painter.lab.trials import Experiment, Measurement, Outcome, Results, ResultTable, Row
from frida_painter.objectives.encoders.classifiers import EfficientNetLite
from frida_painter.objectives.encoders.loading import EncoderRegistry
from frida_painter.planning.initialize import uniform
from frida_painter.render import render
from frida_painter.report.sheets import Cell, FigureRow, page
from frida_painter.runs.run import PaintingRun
from frida_painter.runs.spec import RunSpec
from frida_painter.session.opening import planning_device

NAME = "text"
JUDGE = "efficientnet-lite2"
PAINTED, PIXELS, BEGUN, RANDOM = "words", "pixels of the beginning", "the beginning itself", "random strokes"
WAYS = (PAINTED, PIXELS, BEGUN, RANDOM)
_CLASSES = 1000
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


FULL = RunSpec.of(strokes=100, colors=12, replans=2)
QUICK = RunSpec.of(strokes=6, colors=3, render_height=64, effort=0.05, replans=1)


def experiment(
    prompts: Sequence[Prompt] = PROMPTS,
    *,
    seeds: Sequence[int] = (0,),
    scale: RunSpec = FULL,
    encoders: EncoderRegistry | None = None,
    judge: EfficientNetLite | None = None,
) -> Experiment[PaintingTrial]:
    """Returns the experiment: every prompt painted once per seed.

    encoders: networks of the goals
    judge: network that they do not use; None for EfficientNet-Lite2

    Raises WeightsError if a network is missing.
    """
    judge = judge or EfficientNetLite(weights.tensors(JUDGE))
    encoders = encoders or EncoderRegistry(device=planning_device())
    by_clip = encoders.reads_by_clip
    readers = encoders.reader().name if by_clip else "pictures by their captions"

    def measure(trial: PaintingTrial, painted: Painted) -> Measurement:
        """Measures the judge's log probability of every class for the painting and its floors."""
        pictures = {PAINTED: painted.photograph, **_floors(painted)}
        numbers = {
            f"{way} {number}": value
            for way, picture in pictures.items()
            for number, value in enumerate(log_probabilities(judge, picture).tolist())
        }
        return Measurement(
            numbers,
            {
                "begun": pictures[BEGUN],
                "plan": painted.planned,
                "painting": painted.photograph,
                "pixels": pictures[PIXELS],
            },
        )

    def report(results: Results) -> Outcome:
        summary = tuple(_summary(way, prompts, seeds, results) for way in WAYS)
        rows = tuple(_row(prompt, seed, prompts, results) for seed in seeds for prompt in prompts)
        return Outcome(
            NAME,
            "Paintings towards words, and what an unseen network takes them for",
            {
                "prompts": tuple(prompt.words for prompt in prompts), "seeds": tuple(seeds),
                **paintings.settings(scale), "seen through": readers,
            },
            (ResultTable("Over all paintings", summary), ResultTable("Every painting", rows)),
            (_note(summary),),
            {"paintings": _sheet(prompts, seeds[0], results)},
        )  # fmt: skip

    trials = [
        PaintingTrial.of(
            {"prompt": prompt.words, "seed": seed},
            scale.with_values(goal=[{"text": prompt.words}], seed=seed, fit="crop", film=False),
        )
        for seed in seeds
        for prompt in prompts
    ]
    return paintings.experiment(trials, measure, report, encoders)


def _floors(painted: Painted) -> dict[str, Tensor]:
    """Returns the floors: a plan for the initial picture's pixels, that picture itself, and random strokes."""
    planner, spec = painted.run.planner, painted.run.spec
    begun = next(term.picture for term in planner.goal.initial if term.picture is not None)
    with TemporaryDirectory() as folder:
        picture = Path(folder) / "begun.png"
        images.save(begun, picture)
        with PaintingRun(spec.with_values(goal=[{"image": str(picture)}])) as run:
            pixels = run.planner.expected(run.plan(), planner.bare)
    generator = torch.Generator().manual_seed(spec.seed)
    scattered = uniform(
        spec.strokes, planner.models[planner.kinds[0]].limits.within(spec.canvas), spec.canvas, generator
    )
    with torch.no_grad():
        random = render(scattered, planner.models[planner.kinds[0]], planner.bare, spec.canvas)
    return {PIXELS: pixels, BEGUN: begun, RANDOM: random}


@torch.no_grad()
def log_probabilities(judge: EfficientNetLite, picture: Tensor) -> Tensor:
    """Returns the judge's log probability of each class, [1000], in the middle square of a picture [3, H, W]."""
    return judge.logits(images.fit(picture, _SEEN, _SEEN)[None]).log_softmax(1)[0]


def _of(finding: Measurement, way: str) -> Tensor:
    """Returns the judge's log probabilities of one way, [1000]."""
    return torch.tensor([finding.numbers[f"{way} {number}"] for number in range(_CLASSES)])


def rank_of(logs: Tensor, prompt: Prompt) -> int:
    """Returns the rank of a prompt's likeliest class by log probabilities [1000]; 1 is the best."""
    return int((logs > logs[list(prompt.classes)].max()).sum()) + 1


def _first(prompt: Prompt, seed: int, way: str, prompts: Sequence[Prompt], results: Results) -> float:
    """Returns 1 if no other prompt's picture shows this prompt's classes with a higher probability, otherwise 0.

    Among n equally probable pictures, each gets 1/n.
    """
    classes = list(prompt.classes)
    logs = {
        other.words: float(_of(results.one(prompt=other.words, seed=seed), way)[classes].logsumexp(0))
        for other in prompts
    }
    best = [words for words, value in logs.items() if value == max(logs.values())]
    return 1 / len(best) if prompt.words in best else 0.0


def _row(prompt: Prompt, seed: int, prompts: Sequence[Prompt], results: Results) -> Row:
    finding = results.one(prompt=prompt.words, seed=seed)
    logs = _of(finding, PAINTED)
    return {
        "prompt": prompt.words,
        "seed": seed,
        "rank": rank_of(logs, prompt),
        "probability": float(logs[list(prompt.classes)].exp().sum()),
        "first among all": _first(prompt, seed, PAINTED, prompts, results) == 1,
        **{f"rank, {way}": rank_of(_of(finding, way), prompt) for way in WAYS[1:]},
    }


def _summary(way: str, prompts: Sequence[Prompt], seeds: Sequence[int], results: Results) -> Row:
    pairs = [(prompt, seed) for seed in seeds for prompt in prompts]
    ranks = torch.tensor(
        [rank_of(_of(results.one(prompt=prompt.words, seed=seed), way), prompt) for prompt, seed in pairs]
    ).float()
    firsts = torch.tensor([_first(prompt, seed, way, prompts, results) for prompt, seed in pairs])
    return {
        "judged": way if way != PAINTED else "painted towards the words",
        "within 5": float((ranks <= 5).float().mean()),
        "within 50": float((ranks <= 50).float().mean()),
        "median rank": float(ranks.median()),
        "first among all": float(firsts.mean()),
    }


def _note(summary: Sequence[Row]) -> str:
    ours = summary[0]
    return (
        f"The right class is within the judge's best 5 of 1000 for {100 * float(ours['within 5'] or 0):.0f} % of the "
        f"paintings (wanted: 50 %), and a prompt's own painting comes first among all for "
        f"{100 * float(ours['first among all'] or 0):.0f} % (wanted: 60 %)."
    )


def _sheet(prompts: Sequence[Prompt], seed: int, results: Results) -> Tensor:
    lines = []
    for prompt in prompts:
        finding = results.one(prompt=prompt.words, seed=seed)
        logs = _of(finding, PAINTED)
        label = f"“{prompt.words}”\nrank {rank_of(logs, prompt)}"
        lines.append(FigureRow(label, [Cell(finding.pictures[name]) for name in ("begun", "plan", "painting")]))
    return page("Painted towards words", ("begun with", "planned", "painted, photographed"), lines, width=260)
