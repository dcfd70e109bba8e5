"""Paintings towards words, judged by a network that their planning never asked.

Each prompt is planned, painted by the virtual robot with looks in between, and photographed. The
judge, a classifier, says how probable each of its thousand classes is in the middle square of the
photograph. Floors: the picture that the words began with, planned by its pixels alone; that
picture itself; and strokes at random. They are judged as simulated, which flatters them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import torch
from torch import Tensor

from frida_painter import images
from frida_painter.brush.kinds import brush_kind
from frida_painter.brush.stroke_model import StrokeModel
from frida_painter.brush.table_cache import cached_table
from frida_painter.brush.weights import load_stroke_model
from frida_painter.experiments.execution import open_easel
from frida_painter.experiments.outcome import Notify, Outcome, Progress, ResultTable, Row, each, silent
from frida_painter.experiments.result_cache import Measurement, ResultCache
from frida_painter.experiments.scale import CANVAS, PlanningScale
from frida_painter.frames import CanvasSize
from frida_painter.goal import Goal
from frida_painter.objectives.encoders.base import Reader
from frida_painter.objectives.encoders.conse import class_names
from frida_painter.objectives.encoders.efficientnet import EfficientNetLite
from frida_painter.objectives.encoders.registry import EncoderRegistry
from frida_painter.objectives.kinds.image import ImageTerm
from frida_painter.objectives.kinds.text import TextTerm
from frida_painter.planning.initialize import uniform
from frida_painter.planning.planner import Effort, Planner
from frida_painter.render import render
from frida_painter.report.figure_sheet import Cell, FigureRow, page
from frida_painter.session.brushwork import Brushwork
from frida_painter.session.canvas_observer import CanvasObserver
from frida_painter.session.events import Event, Planned, PlanningStep, StrokePainted
from frida_painter.session.loop import PaintingSession
from frida_painter.session.opening import planning_device
from frida_painter.session.replan_policy import EvenlySpaced

NAME = "text"
PAINTED, PIXELS, BEGUN, RANDOM = "words", "pixels of the beginning", "the beginning itself", "random strokes"
WAYS = (PAINTED, PIXELS, BEGUN, RANDOM)
_SEEN = 260  # pixels of the square that the judge was made for
_PLANNING = 0.5  # share of the time that a first plan takes


@dataclass(frozen=True)
class Prompt:
    """Words, and the numbers of the classes that they may mean."""

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


FULL = PlanningScale(strokes=100, colors=12, rows=256, effort=1.0, looks=2)
QUICK = PlanningScale(strokes=6, colors=3, rows=64, effort=0.05, looks=1, quick=True)


class Unjudged(EncoderRegistry):
    """The encoders without a reader that is kept aside: the judge's network is not asked while it is planned."""

    def reader_aside(self) -> Reader | None:
        """None."""
        return None


def run(
    *,
    encoders: EncoderRegistry,
    judge: EfficientNetLite,
    prompts: Sequence[Prompt] = PROMPTS,
    brush: str = "broad",
    canvas: CanvasSize = CANVAS,
    seeds: Sequence[int] = (0,),
    scale: PlanningScale = FULL,
    keep: Path | None = None,
    notify: Notify = silent,
) -> Outcome:
    """Paints every prompt once per seed. keep: a folder of what was finished, from which it goes on."""
    model = cached_table(load_stroke_model(brush))
    bench = _Bench(encoders, judge, model, canvas, scale)
    readers = " and ".join(reader.name for reader in encoders.readers())
    settings: dict[str, str | int | float] = {
        "brush": brush, "canvas": str(canvas), "strokes": scale.strokes, "colors": scale.colors, "rows": scale.rows,
        "looks": scale.looks, "effort": scale.effort, "seen through": readers,
    }  # fmt: skip
    cache = ResultCache(keep, settings)
    found: dict[tuple[int, int], Measurement] = {}
    tasks = [(number, seed) for seed in seeds for number in range(len(prompts))]
    for (number, seed), telling in each(tasks, notify):
        prompt = prompts[number]
        paint = partial(bench.paint, prompt, seed, telling)
        found[number, seed] = cache.recall(f"{prompt.words.replace(' ', '-')}-{seed}", paint)
    rows = [_row(prompts, number, seed, finding, found) for (number, seed), finding in found.items()]
    summary = tuple(_summary(way, prompts, found) for way in WAYS)
    return Outcome(
        NAME,
        "Paintings towards words, and what an unseen network takes them for",
        {"prompts": [prompt.words for prompt in prompts], "seeds": tuple(seeds), **settings},
        (ResultTable("Over all paintings", summary), ResultTable("Every painting", tuple(rows))),
        (_note(summary),),
        {"paintings": _sheet(prompts, seeds[0], found)},
    )


@dataclass(frozen=True)
class _Bench:
    """What all paintings have in common."""

    encoders: EncoderRegistry
    judge: EfficientNetLite
    model: StrokeModel
    canvas: CanvasSize
    scale: PlanningScale

    def paint(self, prompt: Prompt, seed: int, notify: Notify) -> Measurement:
        """One prompt: its painting and its floors, with the judge's log probability of every class for each."""
        planner = self._planner(Goal((TextTerm(prompt.words),)), seed)
        begun = next(term.picture for term in planner.goal.initial if term.picture is not None)
        bare = torch.ones(3, planner.fine.rows, planner.fine.columns)
        plan, photograph = self._session(planner, seed, prompt.words, notify)
        by_pixels = self._planner(Goal((ImageTerm(begun),)), seed)
        pixels = by_pixels.expected(by_pixels.plan(bare, self.scale.strokes, self.scale.colors, _unheard), bare)
        generator = torch.Generator().manual_seed(seed)
        scattered = uniform(self.scale.strokes, self.model.limits.within(self.canvas), self.canvas, generator)
        random = render(scattered, self.model, bare, self.canvas)
        judged = dict(zip(WAYS, (photograph, pixels, begun, random), strict=True))
        numbers = {
            f"{way} {number}": value
            for way, picture in judged.items()
            for number, value in enumerate(log_probabilities(self.judge, picture).tolist())
        }
        return Measurement(numbers, {"begun": begun, "plan": plan, "painting": photograph, "pixels": pixels})

    def _planner(self, goal: Goal, seed: int) -> Planner:
        effort = Effort().scaled(self.scale.effort)
        return Planner(
            goal,
            self.canvas,
            self.model,
            rows=self.scale.rows,
            effort=effort,
            seed=seed,
            encoders=self.encoders,
            device=planning_device(),
        )

    def _session(self, planner: Planner, seed: int, words: str, notify: Notify) -> tuple[Tensor, Tensor]:
        """The first plan as simulated, and the photograph of the painting, both at the plan's resolution."""
        easel = open_easel(self.canvas, self.model.brush, seed)
        plans: list[Tensor] = []

        def hear(event: Event) -> None:
            match event:
                case PlanningStep("plan", iteration, of):
                    notify(Progress(_PLANNING * iteration / of, f"{words}: planning"))
                case StrokePainted(done, of):
                    notify(Progress(_PLANNING + (1 - _PLANNING) * done / of, f"{words}: painting"))
                case Planned(done=0, expected=picture):
                    plans.append(picture)
                case _:
                    pass

        session = PaintingSession(
            planner,
            Brushwork(easel, brush_kind(self.model.brush)),
            CanvasObserver(easel, ground=(1.0, 1.0, 1.0)),
            EvenlySpaced(self.scale.looks),
            stop_asked=lambda: False,
            notify=hear,
        )
        painting = session.run(self.scale.strokes, self.scale.colors)
        return plans[0], images.fit(painting.photograph, planner.fine.rows, planner.fine.columns)


@torch.no_grad()
def log_probabilities(judge: EfficientNetLite, picture: Tensor) -> Tensor:
    """What the judge says of each class, [1000], in the middle square of a picture [3, H, W]."""
    return judge.logits(images.fit(picture, _SEEN, _SEEN)[None]).log_softmax(1)[0]


def _unheard(step: object) -> None:
    """Where nobody listens."""


def _of(finding: Measurement, way: str) -> Tensor:
    """The judge's log probabilities of one way, [1000]."""
    return torch.tensor([finding.numbers[f"{way} {number}"] for number in range(len(class_names()))])


def rank_of(logs: Tensor, prompt: Prompt) -> int:
    """Of the likeliest of a prompt's classes by log probabilities [1000]: 1 where none is more probable."""
    return int((logs > logs[list(prompt.classes)].max()).sum()) + 1


_Found = Mapping[tuple[int, int], Measurement]


def _first(prompts: Sequence[Prompt], number: int, seed: int, way: str, found: _Found) -> float:
    """1 where every other prompt's picture shows this prompt's classes with a lower probability, else 0.

    Where several are equally probable, one of them is drawn, so to speak: the share of the chances.
    """
    classes = list(prompts[number].classes)
    logs = {other: float(_of(found[other, seed], way)[classes].logsumexp(0)) for other in range(len(prompts))}
    best = [other for other, value in logs.items() if value == max(logs.values())]
    return 1 / len(best) if number in best else 0.0


def _row(prompts: Sequence[Prompt], number: int, seed: int, finding: Measurement, found: _Found) -> Row:
    logs = _of(finding, PAINTED)
    return {
        "prompt": prompts[number].words,
        "seed": seed,
        "rank": rank_of(logs, prompts[number]),
        "probability": float(logs[list(prompts[number].classes)].exp().sum()),
        "first among all": _first(prompts, number, seed, PAINTED, found) == 1,
        "taken for": ", ".join(_top(logs)),
        **{f"rank, {way}": rank_of(_of(finding, way), prompts[number]) for way in WAYS[1:]},
    }


def _top(logs: Tensor) -> list[str]:
    best = logs.exp().topk(3)
    return [
        f"{class_names()[number][0]} {100 * share:.0f} %"
        for share, number in zip(best.values.tolist(), best.indices.tolist(), strict=True)
    ]


def _summary(way: str, prompts: Sequence[Prompt], found: _Found) -> Row:
    ranks = torch.tensor(
        [rank_of(_of(finding, way), prompts[number]) for (number, _), finding in found.items()]
    ).float()
    firsts = torch.tensor([_first(prompts, number, seed, way, found) for number, seed in found])
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


def _sheet(prompts: Sequence[Prompt], seed: int, found: _Found) -> Tensor:
    lines = []
    for number, prompt in enumerate(prompts):
        finding = found[number, seed]
        logs = _of(finding, PAINTED)
        label = "\n".join((f"“{prompt.words}”", f"rank {rank_of(logs, prompt)}", "", *_top(logs)))
        lines.append(FigureRow(label, [Cell(finding.pictures[name]) for name in ("begun", "plan", "painting")]))
    return page("Painted towards words", ("begun with", "planned", "painted, photographed"), lines, width=260)
