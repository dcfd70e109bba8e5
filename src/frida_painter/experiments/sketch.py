"""A drawn outline and words: how far the sketch objective keeps a painting to the drawing.

Every drawing is painted in three ways with the same strokes: by its words alone; by its words, begun
with the drawing, which nothing holds afterwards; and by its words and the sketch. What is reported
is the F-score of the painting's edges against the drawing's. The edges are Canny's, for the
objective asks HED.
"""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from torch import Tensor

from frida_painter import images
from frida_painter.experiments.goal_paintings import FULL, Bench
from frida_painter.experiments.measures import edge_score
from frida_painter.experiments.outcome import Notify, Outcome, ResultTable, Row, each, silent
from frida_painter.experiments.result_cache import Measurement
from frida_painter.experiments.scale import CANVAS, ROBOT_ERROR, PlanningScale
from frida_painter.experiments.targets import Target
from frida_painter.frames import CanvasSize
from frida_painter.goal import Goal
from frida_painter.objectives.encoders.registry import EncoderRegistry
from frida_painter.objectives.kinds.image import ImageTerm
from frida_painter.objectives.kinds.sketch import SketchTerm
from frida_painter.objectives.kinds.text import TextTerm
from frida_painter.report.figure_sheet import Cell, FigureRow, page
from frida_painter.session.opening import planning_device

NAME = "sketch"
WORDS, BEGUN, SKETCHED = "words", "words, begun with the drawing", "words and sketch"
WAYS = (WORDS, BEGUN, SKETCHED)
EDGES = "edge F-score"
_Key = tuple[str, int, str]  # drawing, seed, way


def run(
    drawings: Sequence[Target],
    *,
    brush: str = "broad",
    canvas: CanvasSize = CANVAS,
    seeds: Sequence[int] = (0, 1),
    scale: PlanningScale = FULL,
    encoders: EncoderRegistry | None = None,
    keep: Path | None = None,
    notify: Notify = silent,
) -> Outcome:
    """Paints every drawing three ways, once per seed; the words are what the drawing is called.

    encoders: the networks that goals are seen through; keep: a folder in which finished paintings
    wait in case the rest is interrupted. Raises WeightsError where a network is missing, and
    ConfigError for a drawing without a line.
    """
    bench = Bench(brush, canvas, scale, encoders or EncoderRegistry(device=planning_device()), keep)
    tasks = [(drawing, seed, way) for seed in seeds for drawing in drawings for way in WAYS]
    found: dict[_Key, Measurement] = {}
    for (drawing, seed, way), telling in each(tasks, notify):
        found[drawing.name, seed, way] = bench.recall(
            f"{drawing.name}-{WAYS.index(way)}-{seed}",
            partial(_measure, bench, drawing, seed, way, telling),
            way=way,
            drawing=drawing.fingerprint,
            name=drawing.name,
            seed=seed,
        )
    summary: list[Row] = []
    for way in WAYS:
        findings = [finding for key, finding in found.items() if key[2] == way]
        means = {name: float(np.mean([one.numbers[name] for one in findings])) for name in findings[0].numbers}
        summary.append({"painted by": way, **means})
    every: list[Row] = [
        {"drawing": name, "seed": seed, "painted by": way, **finding.numbers}
        for (name, seed, way), finding in found.items()
    ]
    return Outcome(
        NAME,
        "Drawings painted with words",
        {
            "drawings": tuple(one.name for one in drawings), "seeds": tuple(seeds), "brush": brush,
            "canvas": str(canvas), **scale.settings(), "robot": ROBOT_ERROR,
        },
        (ResultTable("The photographed paintings, mean over drawings and seeds", tuple(summary)),
         ResultTable("All paintings", tuple(every))),
        (_note(summary, found),),
        {NAME: _sheet(drawings, found, seeds[0])},
    )  # fmt: skip


def _measure(bench: Bench, drawing: Target, seed: int, way: str, notify: Notify) -> Measurement:
    """How much of the drawing's edges a painting has, and its picture."""
    words, sketch = TextTerm(_words(drawing)), SketchTerm(drawing.picture)
    goals = {
        WORDS: Goal((words,)),
        BEGUN: Goal((words,), (ImageTerm(sketch.drawing),)),
        SKETCHED: Goal((words, sketch)),
    }
    painted = bench.paint(goals[way], drawing.picture, seed, notify, f"{drawing.name} by {way}")
    picture = painted.photograph
    lines = images.fit(sketch.drawing, *picture.shape[1:])
    return Measurement({EDGES: edge_score(picture, lines), "CPU s": painted.seconds}, {"painting": picture})


def _words(drawing: Target) -> str:
    """What a drawing is called, as words to paint."""
    return f"a {drawing.name.replace('-', ' ').replace('_', ' ')}"


def _note(summary: Sequence[Row], found: Mapping[_Key, Measurement]) -> str:
    figures = {row["painted by"]: float(row[EDGES] or 0) for row in summary}
    pairs = [(name, seed) for name, seed, way in found if way == SKETCHED]
    better = sum(
        found[name, seed, SKETCHED].numbers[EDGES] > found[name, seed, BEGUN].numbers[EDGES] for name, seed in pairs
    )
    return (
        f"With the sketch objective the paintings' edges agree with the drawings' by {figures[SKETCHED]:.2f}; by words "
        f"alone by {figures[WORDS]:.2f}, and begun with the drawing but not held to it by {figures[BEGUN]:.2f}, which "
        f"the objective exceeds in {better} of {len(pairs)} paintings."
    )


def _sheet(drawings: Sequence[Target], found: Mapping[_Key, Measurement], seed: int) -> Tensor:
    lines = []
    for drawing in drawings:
        findings = [found[drawing.name, seed, way] for way in WAYS]
        size = findings[0].pictures["painting"].shape[1:]
        cells = [Cell(images.fit(drawing.picture, *size), f'"{_words(drawing)}"')]
        cells += [Cell(one.pictures["painting"], f"edges {one.numbers[EDGES]:.2f}") for one in findings]
        lines.append(FigureRow("", cells))
    return page("", ("drawing", *WAYS), lines, width=260)
