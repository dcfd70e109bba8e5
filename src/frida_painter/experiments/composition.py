"""Words painted in a style, begun with the style picture: is its composition kept, and do the words still show?

(Paper: "Style", as in StyleCLIPDraw.) Every prompt is painted in every style twice, with the same
number of strokes: begun with a picture of the words' own, and begun with the style picture, as
`--init-style` does it. The floor is the style painted without any words. What the paintings show is
judged by a classifier that no optimiser asked.
"""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from torch import Tensor

from frida_painter.experiments.goal_paintings import FULL, Bench
from frida_painter.experiments.measures import edge_correlation
from frida_painter.experiments.outcome import Notify, Outcome, ResultTable, Row, each, silent
from frida_painter.experiments.result_cache import Measurement
from frida_painter.experiments.scale import CANVAS, ROBOT_ERROR, PlanningScale
from frida_painter.experiments.targets import Target
from frida_painter.experiments.text import PROMPTS, Prompt, log_probabilities, rank_of
from frida_painter.frames import CanvasSize
from frida_painter.goal import Goal
from frida_painter.objectives.encoders.efficientnet import EfficientNetLite
from frida_painter.objectives.encoders.registry import EncoderRegistry
from frida_painter.objectives.kinds.style import StyleTerm
from frida_painter.objectives.kinds.text import TextTerm
from frida_painter.report.figure_sheet import Cell, FigureRow, page

NAME = "composition"
STYLE, WORDS, BEGUN = "style alone", "words and style", "words and style, begun with the style"
WAYS = (STYLE, WORDS, BEGUN)
SAID = tuple(prompt for prompt in PROMPTS if prompt.words in ("a castle", "a pineapple", "an umbrella", "a volcano"))
EDGES, RANK, PROBABILITY, SECONDS = "edges like the style's", "rank", "log10 probability", "CPU s"


def run(
    styles: Sequence[Target],
    *,
    encoders: EncoderRegistry,
    judge: EfficientNetLite,
    prompts: Sequence[Prompt] = SAID,
    brush: str = "broad",
    canvas: CanvasSize = CANVAS,
    seeds: Sequence[int] = (0,),
    scale: PlanningScale = FULL,
    keep: Path | None = None,
    notify: Notify = silent,
) -> Outcome:
    """Paints every prompt in every style, begun in both ways, and every style alone, once per seed.

    encoders: the networks that goals are seen through; judge: the one that they do not ask; keep: a
    folder in which finished paintings wait in case the rest is interrupted. Raises WeightsError
    where a network is missing.
    """
    bench = Bench(brush, canvas, scale, encoders, keep)
    tasks = [
        (style, prompt, seed, way)
        for seed in seeds
        for style in styles
        for prompt, way in [(None, STYLE), *((prompt, way) for prompt in prompts for way in (WORDS, BEGUN))]
    ]
    found: dict[tuple[str, str, int, str], Measurement] = {}
    for (style, prompt, seed, way), telling in each(tasks, notify):
        words = "" if prompt is None else prompt.words
        finding = bench.recall(
            f"{style.name}-{words.replace(' ', '-') or 'alone'}-{WAYS.index(way)}-{seed}",
            partial(_measure, bench, judge, style, words, seed, way, telling),
            way=way,
            style=style.fingerprint,
            prompt=words,
            seed=seed,
        )
        # The style alone is held against every one of the prompts.
        for said in prompts if prompt is None else [prompt]:
            found[style.name, said.words, seed, way] = finding
    by_words = {prompt.words: prompt for prompt in prompts}
    every: list[Row] = [
        {"style": style, "prompt": words, "seed": seed, "painted": way, **_figures(finding, by_words[words])}
        for (style, words, seed, way), finding in sorted(found.items(), key=lambda item: item[0][:3])
    ]
    summary = [_summary(way, [row for row in every if row["painted"] == way]) for way in WAYS]
    return Outcome(
        NAME,
        "Words in a style, with and without the style's composition",
        {
            "prompts": tuple(by_words), "styles": tuple(style.name for style in styles), "seeds": tuple(seeds),
            "brush": brush, "canvas": str(canvas), **scale.settings(),
            "robot": ROBOT_ERROR,
        },
        (ResultTable("The photographed paintings, over prompts, styles and seeds", tuple(summary)),
         ResultTable("All paintings", tuple(every))),
        (_note(summary, every),),
        {NAME: _sheet(styles, prompts, found, seeds[0])},
    )  # fmt: skip


def _measure(
    bench: Bench, judge: EfficientNetLite, style: Target, words: str, seed: int, way: str, notify: Notify
) -> Measurement:
    """How far the style's composition is kept, and the judge's log probability of every class."""
    wanted = StyleTerm(style.picture)
    goals = {
        STYLE: lambda: Goal((wanted,)),
        WORDS: lambda: Goal((TextTerm(words), wanted)),
        BEGUN: lambda: Goal((TextTerm(words), wanted), (wanted,)),
    }
    doing = f"{words or 'nothing'} in the style of {style.name}"
    painted = bench.paint(goals[way](), style.picture, seed, notify, doing)
    picture = painted.photograph
    logs = log_probabilities(judge, picture).tolist()
    numbers = {EDGES: edge_correlation(picture, style.picture), SECONDS: painted.seconds}
    return Measurement({**numbers, **{str(at): value for at, value in enumerate(logs)}}, {"painting": picture})


def _figures(finding: Measurement, prompt: Prompt) -> dict[str, float]:
    """What a painting shows of a prompt."""
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


def _sheet(
    styles: Sequence[Target],
    prompts: Sequence[Prompt],
    found: Mapping[tuple[str, str, int, str], Measurement],
    seed: int,
) -> Tensor:
    lines = []
    for style in styles:
        for prompt in prompts:
            cells = [Cell(style.picture, f"“{prompt.words}”")]
            for way in WAYS:
                finding = found[style.name, prompt.words, seed, way]
                figures = _figures(finding, prompt)
                cells.append(Cell(finding.pictures["painting"], f"edges {figures[EDGES]:.2f}, rank {figures[RANK]}"))
            lines.append(FigureRow("", cells))
    return page("", ("style", *WAYS), lines, width=230)
