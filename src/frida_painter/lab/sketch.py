"""Experiment: an outline and words. How well does the sketch objective keep a painting to the drawing?

Every drawing is painted in four ways with the same strokes: by its words alone; by its words, begun with the
drawing but not held to it; by its words and the sketch; and by both in a style. The result is the F-score of the
painting's edges against the drawing's. The edges are Canny's, because the objective uses HED.
"""

from collections.abc import Sequence
from pathlib import Path

from torch import Tensor

from frida_painter import images
from frida_painter.lab import paintings
from frida_painter.lab.paintings import FULL, Painted, PaintingTrial
from frida_painter.lab.targets import Target
from frida_painter.lab.trials import Experiment, Measurement, Outcome, Results, ResultTable, edge_score
from frida_painter.objectives.beyond_pixels import SketchTerm
from frida_painter.objectives.encoders.loading import EncoderRegistry
from frida_painter.report.sheets import Cell, FigureRow, page
from frida_painter.runs.spec import RunSpec
from frida_painter.session.opening import planning_device

NAME = "sketch"
WORDS, BEGUN, SKETCHED = "words", "words, begun with the drawing", "words and sketch"
STYLED = "words and sketch in a style"
WAYS = (WORDS, BEGUN, SKETCHED, STYLED)
EDGES = "edge F-score"


def experiment(
    drawings: Sequence[Target],
    style: Target,
    folder: Path,
    *,
    seeds: Sequence[int] = (0, 1),
    scale: RunSpec = FULL,
    encoders: EncoderRegistry | None = None,
) -> Experiment[PaintingTrial]:
    """Returns the experiment: every drawing painted in four ways, once per seed. The words are the drawing's name.

    style: of the fourth way
    folder: for the lines of the drawings, with which some paintings begin
    encoders: networks of the goals

    Raises WeightsError if a network is missing, ConfigError for a drawing without a line.
    """
    lines = {drawing.name: SketchTerm(drawing.picture).drawing for drawing in drawings}
    for name, picture in lines.items():
        images.save(picture, folder / f"{name}-lines.png")

    def measure(trial: PaintingTrial, painted: Painted) -> Measurement:
        picture = painted.photograph
        edges = edge_score(picture, images.fit(lines[trial["drawing"]], *picture.shape[1:]))
        return Measurement({EDGES: edges, "CPU s": painted.seconds}, {"painting": picture})

    def report(results: Results) -> Outcome:
        return Outcome(
            NAME,
            "Drawings painted with words",
            {"drawings": tuple(lines), "style": style.name, "seeds": tuple(seeds), **paintings.settings(scale)},
            (
                ResultTable("The photographed paintings, mean over drawings and seeds", results.means("painted by")),
                ResultTable("All paintings", results.rows()),
            ),
            (_note(results),),
            {NAME: _sheet(drawings, results, seeds[0])},
        )

    trials = [
        PaintingTrial.of(
            {"drawing": drawing.name, "seed": seed, "painted by": way}, _spec(scale, drawing, style, folder, seed, way)
        )
        for seed in seeds
        for drawing in drawings
        for way in WAYS
    ]
    return paintings.experiment(trials, measure, report, encoders or EncoderRegistry(device=planning_device()))


def _spec(scale: RunSpec, drawing: Target, style: Target, folder: Path, seed: int, way: str) -> RunSpec:
    goal = [{"text": _words(drawing)}]
    if way in (SKETCHED, STYLED):
        goal.append({"sketch": str(drawing.path)})
    if way == STYLED:
        goal.append({"style": str(style.path)})
    initial = [{"image": str(folder / f"{drawing.name}-lines.png")}] if way == BEGUN else []
    return paintings.like(scale, drawing.picture, goal, seed, initial=initial)


def _words(drawing: Target) -> str:
    """Returns a drawing's name as words to paint."""
    return f"a {drawing.name.replace('-', ' ').replace('_', ' ')}"


def _note(results: Results) -> str:
    words, begun, sketched, styled = (results.mean(EDGES, **{"painted by": way}) for way in WAYS)
    pairs = list(zip(*(results.values(EDGES, **{"painted by": way}) for way in (SKETCHED, BEGUN)), strict=True))
    better = sum(first > second for first, second in pairs)
    return (
        f"With the sketch objective the paintings' edges agree with the drawings' by {sketched:.2f}; by words "
        f"alone by {words:.2f}, and begun with the drawing but not held to it by {begun:.2f}, which "
        f"the objective exceeds in {better} of {len(pairs)} paintings. In a style they agree by {styled:.2f}, "
        f"{styled / max(sketched, 1e-9):.2f} of that without it (wanted: 0.8)."
    )


def _sheet(drawings: Sequence[Target], results: Results, seed: int) -> Tensor:
    lines = []
    for drawing in drawings:
        findings = [results.one(drawing=drawing.name, seed=seed, **{"painted by": way}) for way in WAYS]
        size = findings[0].pictures["painting"].shape[1:]
        cells = [Cell(images.fit(drawing.picture, *size), f'"{_words(drawing)}"')]
        cells += [Cell(one.pictures["painting"], f"edges {one.numbers[EDGES]:.2f}") for one in findings]
        lines.append(FigureRow("", cells))
    return page("", ("drawing", *WAYS), lines, width=260)
