"""Experiment: the steps at which a painting loses quality, and the gain without each cause.

The ladder leads from the plan to the painting. Every rung is the same first plan, in the same studio, with one
change. Its picture is compared with the photograph. Paintings are judged by their true colours, not by the camera.
Separate rungs show the gain of replanning and the gain of a known placement.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from frida_painter import images
from frida_painter.brush.kinds import Dip, StrokeModel, brush_kind
from frida_painter.easel.virtual_easel import studio_brush
from frida_painter.lab import paintings
from frida_painter.lab.paintings import (
    CAMERA,
    EXACT,
    IMPERFECTIONS,
    PLACEMENT,
    Imperfection,
    MakePlan,
    PaintingTrial,
    Tell,
    connect_studio,
)
from frida_painter.lab.targets import Target
from frida_painter.lab.trials import (
    Experiment,
    Measurement,
    Notify,
    Outcome,
    Progress,
    Results,
    ResultTable,
    Row,
    near_borders,
    psnr,
    within,
)
from frida_painter.palette import Palette
from frida_painter.plan import Plan
from frida_painter.render import render
from frida_painter.report.sheets import Cell, FigureRow, page
from frida_painter.runs.run import PaintingRun
from frida_painter.runs.spec import RunSpec
from frida_painter.session.events import StrokePainted
from frida_painter.session.hand import Hand
from frida_painter.virtual.paint import absorption_and_scattering, to_srgb
from frida_painter.virtual.studio import StudioSettings, open_studio
from frida_painter.virtual.tabletop import HandNoise

# Real marks: a plan as it would look if every stroke left a real mark and there were no other errors.
# The virtual studio paints each stroke alone, in black with a full brush, on a fresh canvas at the exact place. Its
# coverage is then composited in the colours of the plan, as in a renderer.

_BLACK = torch.zeros(1, 3)


def with_real_marks(plan: Plan, canvas: Tensor, seed: int, tell: Callable[[float], None]) -> Tensor:
    """Returns the picture [3, H, W] of a canvas after the plan, with real marks.

    tell: hears the share that is done
    """
    picture, rows, columns = canvas, *canvas.shape[1:]
    for number, coverage in enumerate(_marks(plan, rows, seed)):
        opacity = images.fit(coverage, rows, columns)
        picture = picture + opacity * (plan.strokes.color[number][:, None, None] - picture)
        tell((number + 1) / len(plan))
    return picture


def _marks(plan: Plan, rows: int, seed: int) -> Iterator[Tensor]:
    """Yields the coverage of every stroke, [1, rows, columns] in [0, 1]."""
    for part in plan.filled_layers():
        yield from _marks_of_layer(part, rows, seed)


def _marks_of_layer(plan: Plan, rows: int, seed: int) -> Iterator[Tensor]:
    layer = plan.layers[0]
    settings = StudioSettings(placement_error=EXACT, noise=HandNoise(0.0, 0.0))
    studio = connect_studio(open_studio(plan.canvas, studio_brush(layer.brush), seed=seed, settings=settings))
    full = replace(brush_kind(layer.brush), known_dip=Dip.of_strokes(1))
    hand = Hand(studio.easel, full)
    paint = torch.zeros_like(plan.paint)
    black = Plan.of(plan.strokes, Palette(_BLACK), paint, canvas=plan.canvas, brush=layer.brush, limits=layer.limits)
    studio.easel.operator.fill_wells(black.palette)
    darkest, bare = _measure_darkness(_BLACK), studio.truth(rows)
    for action in hand.prepare(black, 0, len(black)):
        if isinstance(hand.perform(action), StrokePainted):
            yield ((bare - studio.truth(rows)) / (bare - darkest)).clamp(0, 1).mean(0, keepdim=True)
            studio.easel.operator.lay_paper()
            bare = studio.truth(rows)


def _measure_darkness(color: Tensor) -> float:
    """Returns the sRGB of a thick film of a paint [1, 3]: no paint of the studio is perfectly black."""
    absorption, _, _, scattering, _, _ = absorption_and_scattering(color.numpy())[0]
    ratio = absorption / scattering
    return float(to_srgb(1 + ratio - np.sqrt(ratio**2 + 2 * ratio)))


NAME = "ladder"
FULL = RunSpec.of(strokes=200, colors=12, replans=0)
QUICK = RunSpec.of(strokes=14, colors=3, render_height=64, effort=0.05, replans=0)
PHOTOGRAPHS = ("rocket", "astronaut", "coffee", "cat")
MAX_LOOKS = 12
SIMILARITY, LOSS, NEAR, AREA = "PSNR, dB", "loss", "loss near borders of paints", "canvas near borders of paints"
"""Names of the measures. Losses are squared errors beyond those of the rendered plan, averaged over the canvas."""
_PLANNING = 0.5  # share of the time of a rung that does not paint normally
_COLUMNS = 5  # of a sheet
_OPAQUE = 0.5  # coverage from which a stroke is visible


@dataclass(frozen=True)
class Rung:
    """Rung of the ladder: one way to paint the plan.

    than: name of the rung for comparison, "" for none
    looks: number of looks with a replan
    without: imperfections that the studio lacks
    """

    name: str
    than: str = ""
    looks: int = 0
    without: tuple[Imperfection, ...] = ()


PLANNED, EXPECTED, MARKS = "the first plan, as rendered", "the first plan, as expected", "its strokes as real marks"
BLIND, KNOWN = "painted without a look", "placement known, no look"
_LOOKS, _KNOWN_LOOKS = "painted with {} looks", "placement known, {} looks"
USUAL, MAX, KNOWN_MAX = _LOOKS.format(4), _LOOKS.format(MAX_LOOKS), _KNOWN_LOOKS.format(MAX_LOOKS)
PERFECT = "no imperfection, no look"
RUNGS = (
    Rung(PLANNED),
    Rung(EXPECTED, PLANNED),
    Rung(MARKS, PLANNED),
    Rung(BLIND, PLANNED),
    Rung("painted with 1 look", BLIND, 1),
    Rung(USUAL, BLIND, 4),
    Rung(MAX, BLIND, MAX_LOOKS),
    Rung(KNOWN, BLIND, 0, (PLACEMENT,)),
    Rung(_KNOWN_LOOKS.format(4), KNOWN, 4, (PLACEMENT,)),
    Rung(KNOWN_MAX, KNOWN, MAX_LOOKS, (PLACEMENT,)),
    *(
        Rung(f"placement known, no {one.name}", KNOWN, 0, (PLACEMENT, one))
        for one in IMPERFECTIONS
        if one not in (PLACEMENT, CAMERA)
    ),
    Rung(f"{USUAL}, no {CAMERA.name}", USUAL, 4, (CAMERA,)),
    Rung(PERFECT, KNOWN, 0, IMPERFECTIONS),
)


_ALONE = tuple(rung.name for rung in RUNGS if rung.without and rung.name != PERFECT and rung.without != (PLACEMENT,))
_GAPS = (MARKS, PERFECT, KNOWN, BLIND, USUAL)
"""Rungs for the table of distances from the photograph beyond the plan's."""


@dataclass(frozen=True)
class _FirstPlan:
    """First plan with its derived values.

    picture: [3, H, W], rendered
    expected: expected similarity of its paintings, PSNR in dB
    borders: [H, W], True within one pixel of a border between two paints
    """

    plan: Plan
    picture: Tensor
    expected: float
    borders: Tensor


class _FirstPlans:
    """First plans of each photograph and seed, made when needed: all rungs paint them."""

    def __init__(self) -> None:
        self._made: dict[tuple[str, str], _FirstPlan] = {}

    def of(self, trial: PaintingTrial, notify: Notify) -> _FirstPlan:
        """Returns the first plan for a rung's photograph and seed."""
        whose = trial["target"], trial["seed"]
        if whose not in self._made:
            with PaintingRun(trial.spec) as run:
                doing = f"{whose[0]}, seed {whose[1]}: planning"
                plan, picture = paintings.make_first_plan(run, lambda share: notify(Progress(_PLANNING * share, doing)))
                forecast = run.planner.forecast(plan, run.planner.bare)
                assert forecast is not None  # the goal is a photograph
                borders = near_borders(_top_paint(plan, run.planner.models, *picture.shape[1:]))
            self._made[whose] = _FirstPlan(plan, picture, forecast.expected, borders)
        return self._made[whose]

    def hand_out(self, target: str, seed: int) -> MakePlan:
        """Returns a planner that returns the stored first plan instead of a new one."""

        def make_plan(run: PaintingRun, tell: Tell) -> tuple[Plan, Tensor]:
            first = self._made[target, str(seed)]
            return first.plan, first.picture

        return make_plan


def experiment(
    targets: Sequence[Target], *, seeds: Sequence[int] = (0,), scale: RunSpec = FULL
) -> Experiment[PaintingTrial]:
    """Returns the experiment: every photograph planned once per seed, and that plan painted on every rung."""
    plans = _FirstPlans()
    pictures = {target.name: target.picture for target in targets}

    def measure(trial: PaintingTrial, notify: Notify) -> Measurement:
        first = plans.of(trial, notify)
        painting = within(notify, _PLANNING, 1.0)
        wanted = images.fit(pictures[trial["target"]], *first.picture.shape[1:])
        match trial["painting"]:
            case name if name == PLANNED:
                picture = first.picture
            case name if name == EXPECTED:
                return Measurement({**_numbers(first.picture, first, wanted), SIMILARITY: first.expected})
            case name if name == MARKS:
                doing = f"{trial['target']}, seed {trial['seed']}: real marks"
                bare, seed = torch.ones_like(first.picture), trial.spec.seed
                picture = with_real_marks(first.plan, bare, seed, lambda share: painting(Progress(share, doing)))
            case _:
                picture = paintings.paint(trial, painting).truth
        painting(Progress(1.0, f"{trial['target']}, seed {trial['seed']}: measured"))
        return Measurement(_numbers(picture, first, wanted), {"picture": picture})

    def report(results: Results) -> Outcome:
        ladder = _ladder(results, tuple(pictures))
        return Outcome(
            NAME,
            "Where the quality of a painting is lost",
            {"targets": tuple(pictures), "seeds": tuple(seeds), **paintings.settings(scale), "looks": "as told"},
            (
                ResultTable("Similarity to the photograph, PSNR in dB, mean over the seeds", ladder),
                ResultTable("Where pictures are farther from the photograph than the plan is", _gaps(results)),
                ResultTable("All pictures", results.rows()),
            ),
            _notes(results),
            {f"{NAME}-{target.name}": _sheet(target, results, seeds[0]) for target in targets},
        )

    trials = [
        PaintingTrial.of(
            {"target": target.name, "seed": seed, "painting": rung.name},
            paintings.like(scale, target.picture, [{"image": str(target.path)}], seed, replans=rung.looks),
            plans.hand_out(target.name, seed),
            rung.without,
        )
        for target in targets
        for seed in seeds
        for rung in RUNGS
    ]
    return Experiment(trials, measure, report, sharing="painting")


def _numbers(picture: Tensor, first: _FirstPlan, wanted: Tensor) -> dict[str, float]:
    loss = ((picture - wanted).square() - (first.picture - wanted).square()).mean(0)
    return {
        SIMILARITY: psnr(picture, wanted),
        LOSS: float(loss.mean()),
        NEAR: float((loss * first.borders).mean()),
        AREA: float(first.borders.double().mean()),
    }


@torch.no_grad()
def _top_paint(plan: Plan, models: Mapping[str, StrokeModel], rows: int, columns: int) -> Tensor:
    """Returns the index of the topmost paint at every pixel, [rows, columns]; -1 for bare canvas."""
    top, black = torch.full((rows, columns), -1), torch.zeros(3, rows, columns)
    white = plan.strokes.with_groups(color=torch.ones_like(plan.strokes.color))
    for number, (paint, layer) in enumerate(zip(plan.paint.tolist(), plan.layer.tolist(), strict=True)):
        coverage = render(white[number : number + 1], models[plan.layers[layer].kind], black, plan.canvas)[0]
        top[coverage >= _OPAQUE] = paint
    return top


def _ladder(results: Results, targets: Sequence[str]) -> tuple[Row, ...]:
    """Returns a row for every rung: the similarity of its picture, and the gain over its comparison rung."""
    return tuple(
        {
            "picture": rung.name,
            **{name: results.mean(SIMILARITY, target=name, painting=rung.name) for name in targets},
            "mean": results.mean(SIMILARITY, painting=rung.name),
            "wins": _win(results, rung.name, rung.than) if rung.than else None,
            "over": rung.than or "-",
        }
        for rung in RUNGS
    )


def _win(results: Results, name: str, than: str) -> float:
    """Returns the mean gain of one rung over another in similarity to the photograph, dB."""
    return results.mean(SIMILARITY, painting=name) - results.mean(SIMILARITY, painting=than)


def _gaps(results: Results) -> tuple[Row, ...]:
    """Returns a row for every rung below the plan: its loss, and how much is near borders of paints."""
    return tuple(
        {
            "picture": name,
            "loss, dB": -_win(results, name, PLANNED),
            "loss, squared error": results.mean(LOSS, painting=name),
            "near borders of paints": results.mean(NEAR, painting=name),
            "share of it": _share(results, name),
            "share of the canvas": results.mean(AREA, painting=name),
        }
        for name in _GAPS
    )


def _share(results: Results, name: str) -> float | None:
    """Returns the share of the loss that is near borders of paints; None if there is no loss."""
    loss, near = (results.mean(number, painting=name) for number in (LOSS, NEAR))
    return near / loss if loss > 0 else None


def _notes(results: Results) -> tuple[str, ...]:
    alone = {rung.name: _win(results, rung.name, rung.than) for rung in RUNGS if rung.name in _ALONE}
    best = max(alone, key=lambda name: alone[name])
    share = _share(results, KNOWN)
    return (
        f"Between the plan as rendered and its painting without a look lie {-_win(results, BLIND, PLANNED):.2f} dB, "
        f"{-_win(results, BLIND, EXPECTED):.2f} dB between the plan as expected and that painting.",
        f"Knowing the placement from the start wins {_win(results, KNOWN, BLIND):+.2f} dB. Planning again after "
        f"{MAX_LOOKS} looks wins {_win(results, KNOWN_MAX, KNOWN):+.2f} dB where the placement is known; where it is "
        f"not, {MAX_LOOKS} looks win {_win(results, MAX, BLIND):+.2f} dB, with what they tell of the placement.",
        *([] if share is None else [_where(share, results.mean(AREA, painting=KNOWN))]),
        f"Of the other imperfections, taken away alone, the largest win is {alone[best]:+.2f} dB ({best}). "
        f"Taking all of them away wins {_win(results, PERFECT, KNOWN):+.2f} dB where the placement is known.",
    )


def _where(share: float, area: float) -> str:
    return (
        f"{share:.0%} of the loss with the placement known lies within one pixel of a border between two paints, on "
        f"{area:.0%} of the canvas."
    )


def _sheet(target: Target, results: Results, seed: int) -> Tensor:
    """Returns a sheet with the photograph, and the picture of every rung that has one."""
    cells = []
    for rung in RUNGS:
        found = results.one(target=target.name, seed=seed, painting=rung.name)
        if found.pictures:
            cells.append(Cell(found.pictures["picture"], f"{rung.name}: {found.numbers[SIMILARITY]:.2f} dB"))
    photograph = images.fit(target.picture, *cells[0].picture.shape[1:])
    cells.insert(0, Cell(photograph, "the photograph"))
    lines = [FigureRow("", cells[first : first + _COLUMNS]) for first in range(0, len(cells), _COLUMNS)]
    return page(f"{target.name.capitalize()}, seed {seed}", (), lines, width=330)
