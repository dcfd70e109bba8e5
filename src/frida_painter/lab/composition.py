"""Experiment: prompts painted in a style, begun with the style picture or with the prompt's own picture.

It measures if the style picture's composition lasts, and if the prompt is still seen (paper: "Style", as in
StyleCLIPDraw). Every prompt is painted in every style twice, with the same number of strokes: begun with the
prompt's own picture, and begun with the style picture, as with `--init-style`. The floor is the style painted
without a prompt. A classifier that no optimiser uses judges what the paintings show.
"""

from collections.abc import Sequence

import numpy as np
from torch import Tensor

from frida_painter import weights
from frida_painter.lab import paintings
from frida_painter.lab.paintings import FULL, Painted, PaintingTrial
from frida_painter.lab.targets import Target
from frida_painter.lab.text import JUDGE, PROMPTS, Prompt, log_probabilities, rank_of
from frida_painter.lab.trials import Experiment, Measurement, Outcome, Results, ResultTable, Row, edge_correlation
from frida_painter.objectives.encoders.classifiers import EfficientNetLite
from frida_painter.objectives.encoders.loading import EncoderRegistry
from frida_painter.report.sheets import Cell, FigureRow, page
from frida_painter.runs.spec import RunSpec
from frida_painter.session.opening import planning_device

NAME = "composition"
STYLE, WORDS, BEGUN = "style alone", "words and style", "words and style, begun with the style"
WAYS = (STYLE, WORDS, BEGUN)
SAID = tuple(prompt for prompt in PROMPTS if prompt.words in ("a castle", "a pineapple", "an umbrella", "a volcano"))
EDGES, RANK, PROBABILITY, SECONDS = "edges like the style's", "rank", "log10 probability", "CPU s"


def experiment(
    styles: Sequence[Target],
    prompts: Sequence[Prompt] = SAID,
    *,
    seeds: Sequence[int] = (0,),
    scale: RunSpec = FULL,
    encoders: EncoderRegistry | None = None,
    judge: EfficientNetLite | None = None,
) -> Experiment[PaintingTrial]:
    """Returns the experiment: every prompt in every style, begun in both ways, and every style alone, once per seed.

    encoders: networks of the goals
    judge: network that they do not use; None for EfficientNet-Lite2

    Raises WeightsError if a network is missing.
    """
    judge = judge or EfficientNetLite(weights.tensors(JUDGE))
    pictures = {style.name: style.picture for style in styles}

    def measure(trial: PaintingTrial, painted: Painted) -> Measurement:
        """Measures how well the style's composition is kept, and the judge's log probability of every class."""
        picture = painted.photograph
        logs = log_probabilities(judge, picture).tolist()
        numbers = {EDGES: edge_correlation(picture, pictures[trial["style"]]), SECONDS: painted.seconds}
        return Measurement({**numbers, **{str(at): value for at, value in enumerate(logs)}}, {"painting": picture})

    def report(results: Results) -> Outcome:
        every: list[Row] = [
            {
                "style": style, "prompt": prompt.words, "seed": seed, "painted": way,
                **_figures(_measure(results, style, prompt, seed, way), prompt),
            }
            for style in sorted(pictures)
            for prompt in sorted(prompts, key=lambda prompt: prompt.words)
            for seed in seeds
            for way in WAYS
        ]  # fmt: skip
        summary = [_summary(way, [row for row in every if row["painted"] == way]) for way in WAYS]
        return Outcome(
            NAME,
            "Words in a style, with and without the style's composition",
            {
                "prompts": tuple(prompt.words for prompt in prompts), "styles": tuple(pictures), "seeds": tuple(seeds),
                **paintings.settings(scale),
            },
            (ResultTable("The photographed paintings, over prompts, styles and seeds", tuple(summary)),
             ResultTable("All paintings", tuple(every))),
            (_note(summary, every),),
            {NAME: _sheet(styles, prompts, results, seeds[0])},
        )  # fmt: skip

    trials = [
        PaintingTrial.of(
            {"style": style.name, "prompt": words, "seed": seed, "painted": way}, _spec(scale, style, words, seed, way)
        )
        for seed in seeds
        for style in styles
        for words, way in [("", STYLE), *((prompt.words, way) for prompt in prompts for way in (WORDS, BEGUN))]
    ]
    return paintings.experiment(trials, measure, report, encoders or EncoderRegistry(device=planning_device()))


def _spec(scale: RunSpec, style: Target, words: str, seed: int, way: str) -> RunSpec:
    wanted = {"style": str(style.path)}
    goal = [wanted] if way == STYLE else [{"text": words}, wanted]
    return paintings.like(scale, style.picture, goal, seed, initial=[wanted] if way == BEGUN else [])


def _measure(results: Results, style: str, prompt: Prompt, seed: int, way: str) -> Measurement:
    """Returns the measurement of a painting; that of the style alone serves for every prompt."""
    return results.one(style=style, prompt="" if way == STYLE else prompt.words, seed=seed, painted=way)


def _figures(finding: Measurement, prompt: Prompt) -> dict[str, float]:
    """Returns the figures of a painting for a prompt."""
    logs = Tensor([value for name, value in finding.numbers.items() if name.isdigit()])
    probability = float(logs[list(prompt.classes)].logsumexp(0)) / float(np.log(10))
    numbers = finding.numbers
    return {EDGES: numbers[EDGES], RANK: rank_of(logs, prompt), PROBABILITY: probability, SECONDS: numbers[SECONDS]}


def _summary(way: str, rows: Sequence[Row]) -> Row:
    def values(name: str) -> list[float]:
        return [float(row[name] or 0) for row in rows]

    return {
        "painted": way,
        EDGES: float(np.mean(values(EDGES))),
        "median rank": float(np.median(values(RANK))),
        PROBABILITY: float(np.mean(values(PROBABILITY))),
        SECONDS: float(np.mean(values(SECONDS))),
    }


def _note(summary: Sequence[Row], every: Sequence[Row]) -> str:
    by = {row["painted"]: row for row in summary}
    edges, ranks = ({way: float(by[way][name] or 0) for way in WAYS} for name in (EDGES, "median rank"))
    ranked = {way: [float(row[RANK] or 0) for row in every if row["painted"] == way] for way in (STYLE, BEGUN)}
    better = sum(begun < alone for begun, alone in zip(ranked[BEGUN], ranked[STYLE], strict=True))
    return (
        f"Begun with the style picture, a painting's edges correlate with that picture's by {edges[BEGUN]:.2f}, and by "
        f"{edges[WORDS]:.2f} where it began with the words. The words' class has median rank {ranks[BEGUN]:.0f} of "
        f"1000 then, {ranks[WORDS]:.0f} begun with the words, and {ranks[STYLE]:.0f} without them, which begun with "
        f"the style it exceeds in {better} of {len(ranked[BEGUN])} paintings."
    )


def _sheet(styles: Sequence[Target], prompts: Sequence[Prompt], results: Results, seed: int) -> Tensor:
    lines = []
    for style in styles:
        for prompt in prompts:
            cells = [Cell(style.picture, f"“{prompt.words}”")]
            for way in WAYS:
                finding = _measure(results, style.name, prompt, seed, way)
                figures = _figures(finding, prompt)
                cells.append(Cell(finding.pictures["painting"], f"edges {figures[EDGES]:.2f}, rank {figures[RANK]}"))
            lines.append(FigureRow("", cells))
    return page("", ("style", *WAYS), lines, width=230)
