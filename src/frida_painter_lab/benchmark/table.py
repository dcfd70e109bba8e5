"""The table of the benchmark: an experiment whose runs are cells, each one painting by one entrant.

An entrant paints one goal within one budget in the virtual studio of one seed. Every painting is made by the same loop
on the same easel. Only `ours` looks while it paints; all others hand in a plan. The judges see the true canvas of the
studio, from the front and in even light, at the size of the photograph.
"""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from torch import Tensor

from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import ConfigError, HandInError
from frida_painter.objectives import weights
from frida_painter.objectives.encoders.base import Seer
from frida_painter.objectives.encoders.convolutional import EfficientNetLite
from frida_painter.objectives.encoders.loading import EncoderRegistry
from frida_painter.report.page import template
from frida_painter.report.sheets import Cell, FigureRow, page
from frida_painter.runs.run import PaintingRun
from frida_painter.runs.spec import RunSpec
from frida_painter.session.events import Dipped, Event, Planned, PlanningStep, StrokePainted
from frida_painter.strokes.plan import Plan
from frida_painter.system import images, storage
from frida_painter_lab import experiment
from frida_painter_lab.benchmark.fitting import fit_hand_in
from frida_painter_lab.benchmark.hand_in import MAX_BYTES, TOLERANCE, HandIn, read_csv
from frida_painter_lab.benchmark.rivals import GREEDY_BRUSHES, PLAIN_BRUSH, plan_greedy, plan_hertzmann, plan_plain
from frida_painter_lab.benchmark.suite import VERSION, BenchmarkGoal, Budget, find_budget, find_goal, suite_digest
from frida_painter_lab.benchmark.svg_strokes import read_svg
from frida_painter_lab.measures import feature_distance, psnr, ssim
from frida_painter_lab.paintings import WatchedStudio
from frida_painter_lab.runs import Labels, Run, Value
from frida_painter_lab.statistics import Mean, Result, paired_tests
from frida_painter_lab.sweeps.runner import fix_to_plan

INPUTS = "inputs"
"""Folder of the files of held-out pictures, in the folder of a table."""
REQUEST, PAGE = "benchmark.json", "index.html"
_FORMAT = "frida-painter benchmark"
_HAND_INS = (".svg", ".csv", ".json", "")
MAX_CELLS = 100_000

PSNR, PERCEPTUAL = "PSNR, dB", "perceptual distance"
MORE_IS_BETTER = {PSNR: True, "SSIM": True, PERCEPTUAL: False, "goal left": False, "forecast, dB": True}
"""Names of the figures by which entrants are compared."""
MEASURES = (*MORE_IS_BETTER, "robot minutes", "dips", "CPU s", "strokes", "paints")
"""Names of all figures, in the order of tables."""
JUDGE_NETWORK = "efficientnet-lite1"
"""Network of the perceptual distance (Apache-2.0); no planner of this project uses it."""
_SIDE = 240  # pixels of its views


@dataclass(frozen=True)
class Entrant:
    """Painter of the project that can be entered by name.

    words: what it is
    make: makes its plan for a photograph on a white canvas; None for the project's planner
    looks: number of looks with a replan; None for the project's default
    brushes: those of the planner that `make` gets, by name
    """

    name: str
    words: str
    make: Callable[[PaintingRun, Tensor, Budget], Plan] | None = None
    looks: int | None = 0
    brushes: str = PLAIN_BRUSH


ENTRANTS: Mapping[str, Entrant] = {
    each.name: each
    for each in (
        Entrant("ours", "the planner of this project, with its looks and replans", looks=None),
        Entrant("ours-blind", "its first plan, painted without a look"),
        Entrant("plain", "the paper's plain algorithm: random strokes, Adam, one layer", plan_plain),
        Entrant("greedy", "each stroke the best of 64 random ones", plan_greedy, brushes=",".join(GREEDY_BRUSHES)),
        Entrant("hertzmann", "Hertzmann 1998: curved strokes of three sizes", plan_hertzmann),
    )
}


@dataclass(frozen=True, kw_only=True)
class CellRun(Run):
    """Run of a cell.

    goal: what is painted
    hand_in: file of the strokes; None for an entrant of this project
    """

    goal: BenchmarkGoal
    hand_in: Path | None = None

    @classmethod
    def of(cls, entrant: str, goal: BenchmarkGoal, strokes: int, seed: int, hand_in: Path | None = None) -> "CellRun":
        """Returns a cell, which depends on the suite, the judges, and the content of its goal and of its hand-in.

        Raises ConfigError if the hand-in cannot be read.
        """
        paths = [value for item in goal.items for value in item.values() if isinstance(value, str)]
        facts = {
            "suite": suite_digest(),
            "goal": [storage.sha256(Path(one), "a goal") if Path(one).is_file() else one for one in paths],
            "hand-in": None,
            "perceptual": weights.find(JUDGE_NETWORK) is not None,
        }
        if hand_in is not None and (hand_in.is_dir() or hand_in.suffix == ".json"):
            facts["hand-in"] = Plan.load(hand_in).digest
        elif hand_in is not None:
            facts["hand-in"] = storage.sha256(hand_in, "a hand-in", ConfigError)
        labels: Labels = {"entrant": entrant, "goal": goal.name, "strokes": strokes, "seed": seed}
        return cls(labels, facts, goal=goal, hand_in=hand_in)

    @property
    def entrant(self) -> Entrant | None:
        """Entrant of this project; None for a hand-in."""
        return ENTRANTS[self["entrant"]] if self.hand_in is None else None

    @property
    def spec(self) -> RunSpec:
        """Description of the painting."""
        entrant, budget = self.entrant, find_budget(int(self["strokes"]))
        fields: dict[str, Any] = {
            "goal": [dict(item) for item in self.goal.items], "canvas": self.goal.canvas, "fit": "crop",
            "strokes": budget.strokes, "colors": budget.paints, "new_paints": False, "seed": int(self["seed"]),
            "film": False,
        }  # fmt: skip
        if entrant is None or entrant.make is not None:
            brushes = PLAIN_BRUSH if entrant is None else entrant.brushes
            return RunSpec.of(**fields, ground="white", brushes=brushes, replans=0)
        fields |= {} if entrant.looks is None else {"replans": entrant.looks}
        return RunSpec.of(**fields, minutes=budget.minutes)


@dataclass(frozen=True, kw_only=True)
class BenchmarkTable(experiment.Experiment):
    """Table of the benchmark: all combinations of entrants, goals, budgets and seeds.

    folder: of the table; it keeps all cells
    entrants: names of ENTRANTS
    goals: names of pictures and combined goals; see suite.find_goal
    budgets: by their numbers of strokes
    seeds: of the virtual studio, and of the entrants of this project
    hand_ins: folders of strokes, or one file, by the name of their entrant; see `find_hand_in`
    """

    NAME = "benchmark"
    TITLE = f"Benchmark of robot painting, suite {VERSION}"

    folder: Path
    entrants: tuple[str, ...]
    goals: tuple[str, ...]
    budgets: tuple[int, ...]
    seeds: tuple[int, ...]
    hand_ins: Mapping[str, str] = field(default_factory=dict)

    def runs(self) -> Sequence[CellRun]:
        """Returns all cells. Raises ConfigError for an unknown entrant, goal, budget or seed, or if there are none."""
        for name in self.entrants:
            if name not in ENTRANTS:
                raise ConfigError(
                    f"{name[:40]!r} is no entrant; there are {', '.join(ENTRANTS)}, and those that hand in strokes "
                    "(--hand-in NAME=FOLDER)."
                )
        for name in self.hand_ins:
            if name in ENTRANTS:
                raise ConfigError(f"{name} is an entrant of the project; give the hand-ins another name.")
        for seed in self.seeds:
            if not 0 <= seed < 2**31:
                raise ConfigError(f"The seed {seed} was given; it is from 0 to {2**31 - 1}.")
        goals = [find_goal(name, self.folder / INPUTS) for name in self.goals]
        cells = [(goal, find_budget(strokes).strokes, seed) for goal, strokes, seed in
                 product(goals, self.budgets, self.seeds)]  # fmt: skip
        found = [CellRun.of(entrant, *cell) for entrant in self.entrants for cell in cells]
        for name, place in self.hand_ins.items():
            for goal, strokes, seed in cells:
                file = find_hand_in(Path(place), goal.name, strokes, seed)
                if file is not None:
                    found.append(CellRun.of(name, goal, strokes, seed, file))
        if not 1 <= len(found) <= MAX_CELLS:
            raise ConfigError(f"The table has {len(found)} cells; it has from 1 to {MAX_CELLS:,}.")
        return found

    @cached_property
    def _seer(self) -> Seer | None:
        """Network of the perceptual distance; None if its weights were not fetched."""
        return None if weights.find(JUDGE_NETWORK) is None else EfficientNetLite(weights.tensors(JUDGE_NETWORK))

    def measure(self, run: Run, notify: experiment.Notify) -> experiment.Measurement:
        """Paints and judges a cell. Raises the errors of reading, planning and painting."""
        assert isinstance(run, CellRun)
        notify(experiment.Progress(0.0, run.words))
        goal, entrant, spec, encoders = run.goal, run.entrant, run.spec, EncoderRegistry()
        budget = find_budget(int(run["strokes"]))
        remarks: Sequence[str] = ()
        first = foretold = None
        if run.hand_in is not None:
            drawing = read_hand_in(run.hand_in, goal.canvas)
            first, remarks = fit_hand_in(drawing, budget, int(run["seed"]))
            if drawing.strokes and goal.picture is not None:
                foretold = drawing.picture(*goal.picture.shape[1:])
        began = time.process_time()
        if entrant is not None and entrant.make is not None:
            if goal.picture is None:
                raise ConfigError(
                    f"{entrant.name} paints photographs alone, and {goal.name} is a combined goal; leave it out."
                )
            with PaintingRun(spec, encoders=encoders) as opened:
                first = entrant.make(opened, goal.picture, budget)
        meter, studio = _Meter(budget), WatchedStudio()
        spec = spec if first is None else fix_to_plan(spec, first)
        with PaintingRun(spec, listeners=[meter.hear], encoders=encoders) as opened:
            opened.controls = replace(opened.controls, stop_asked=meter.is_spent)
            plan = opened.plan() if first is None else first
            planned = time.process_time() - began
            expected = opened.planner.expected(plan, opened.planner.bare)
            meter.run = opened
            painting = opened.simulate(plan, studio.open)
            truth = studio.truth(expected.shape[1] if goal.picture is None else goal.picture.shape[1])
            if goal.picture is None:
                bare = opened.planner.validation_loss(opened.planner.bare)
                left = opened.planner.validation_loss(images.fit(truth, *expected.shape[1:]))
                figures = {"goal left": left / max(bare, 1e-12)}
            else:
                seen = images.resize_by_area(truth, *goal.picture.shape[1:])
                figures = {PSNR: psnr(seen, goal.picture), "SSIM": ssim(seen, goal.picture)}
                if self._seer is not None:
                    figures[PERCEPTUAL] = feature_distance(self._seer, seen, goal.picture, _SIDE)
        foretold = expected if foretold is None else foretold
        figures |= {
            "forecast, dB": psnr(foretold, images.resize_by_area(truth, *foretold.shape[1:])),
            "robot minutes": painting.robot_seconds / 60,
            "dips": meter.dips,
            "strokes": painting.painted,
            "paints": len(plan.palette),
        }
        if run.hand_in is None:
            figures["CPU s"] = planned + meter.replanning
        numbers = {name: float(value) for name, value in figures.items() if math.isfinite(value)}
        return experiment.Measurement(numbers, {"painting": truth, "foretold": foretold}, remarks)

    def settings(self) -> Mapping[str, Value | Sequence[Value]]:
        """Returns the suite and all that is combined."""
        asked = {name: getattr(self, name) for name in ("goals", "budgets", "seeds")}
        return {"suite": suite_digest()[:12], "entrants": (*self.entrants, *self.hand_ins), **asked}

    def tables(self, results: experiment.Results) -> Sequence[experiment.ResultTable]:
        """Returns the means of each entrant and budget, and the differences from ours."""
        named = {
            "Means over pictures, with 95 % intervals over seeds": summary_rows(results),
            "Differences from ours, pair by pair": comparison_rows(results),
        }
        return [experiment.ResultTable(title, rows) for title, rows in named.items() if rows]

    def notes(self, results: experiment.Results) -> Sequence[str]:
        """Returns how many cells are done, and what was done to hand-ins."""
        told = [
            f"{', '.join(map(str, labels.values()))}: {' '.join(one.remarks)}"
            for labels, one in results.found
            if one.remarks
        ]
        return [f"{len(results.found)} of {len(self.all_runs)} cells.", *told]

    def pictures(self, results: experiment.Results) -> Mapping[str, Tensor]:
        """Returns a sheet for each goal and budget: the paintings of the first seed."""
        sheets: dict[str, list[Cell]] = {}
        for labels, one in results.found:
            if labels["seed"] == self.seeds[0]:
                known = [name for name in MORE_IS_BETTER if name in one.numbers]
                told = ", ".join(f"{name.split(',')[0]} {one.numbers[name]:.3g}" for name in known)
                name = f"{labels['goal']}-{labels['strokes']}".replace("~", "-")
                sheets.setdefault(name, []).append(Cell(one.pictures["painting"], f"{labels['entrant']}: {told}"))
        return {name: page("", (), [FigureRow("", cells)], width=300) for name, cells in sheets.items()}

    def write_request(self) -> None:
        """Writes what `read_table` needs. Raises StorageError."""
        asked = {name: getattr(self, name) for name in ("entrants", "goals", "budgets", "seeds", "hand_ins")}
        storage.write_json(self.folder / REQUEST, {"format": _FORMAT, "suite": suite_digest(), "request": asked})


def read_table(folder: Path) -> BenchmarkTable:
    """Returns the table in a folder. Raises ConfigError if there is none, or one of another suite."""
    kept, place = storage.read_json(folder / REQUEST, "a table of the benchmark", ConfigError), storage.abridge(folder)
    if kept.get("format") != _FORMAT:
        raise ConfigError(f"{place} holds no table of the benchmark; give the folder of one (--out).")
    if kept.get("suite") != suite_digest():
        raise ConfigError(
            f"{place} is a table of another suite; this program has {VERSION}: paint it anew in another folder."
        )
    with storage.understanding(folder / REQUEST, "a table of the benchmark", ConfigError):
        asked = kept["request"]
        lists: dict[str, Any] = {name: tuple(asked[name]) for name in ("entrants", "goals", "budgets", "seeds")}
        table = BenchmarkTable(folder=folder.absolute(), hand_ins=dict(asked["hand_ins"]), **lists)
        assert table.all_runs
    return table


def write_page(outcome: experiment.Outcome, folder: Path) -> Path:
    """Writes the page with tables and pictures; returns it. Raises StorageError."""
    html = template("benchmark.html").render(
        title=outcome.title,
        notes=outcome.notes,
        tables=[(one.title, list(one.rows[0]), one.cells()) for one in outcome.tables],
        pictures=list(outcome.pictures),
    )
    storage.write_text(folder / PAGE, html.encode("utf-8", "replace").decode("utf-8"))
    return folder / PAGE


class _Meter:
    """Meter of a painting: strokes, dips, minutes, and the time for planning again."""

    def __init__(self, budget: Budget) -> None:
        self._budget = budget
        self.strokes = self.dips = 0
        self.replanning = 0.0
        self._since: float | None = None
        self._began: float | None = None
        self.run: PaintingRun | None = None

    def hear(self, event: Event) -> None:
        """Counts an event."""
        match event:
            case StrokePainted(done=done):
                self.strokes = done
            case Dipped():
                self.dips += 1
            case PlanningStep(phase="replan") if self._since is None:
                self._since = time.process_time()
            case Planned() if self._since is not None:
                self.replanning += time.process_time() - self._since
                self._since = None
            case _:
                pass

    def is_spent(self) -> bool:
        """Returns True if the painting has to end."""
        session = None if self.run is None else self.run.session
        if session is None:
            return False
        now = session.hand.last_motion
        self._began = now if self._began is None else self._began
        return self.strokes > 0 and (
            self.strokes >= self._budget.strokes
            or self.dips >= self._budget.dips
            or now - self._began >= 60 * self._budget.minutes
        )


def find_hand_in(place: Path, goal: str, strokes: int, seed: int) -> Path | None:
    """Returns the hand-in of a cell in a folder: GOAL-STROKES-SEED.svg, or GOAL-STROKES.svg for all seeds, or None.

    .csv, .json and a folder with a plan.json do as well. "~" in a goal's name is "-" in that of the file. A file, or
    a folder with a plan.json, is itself the hand-in.
    """
    if not place.is_dir() or (place / "plan.json").exists():
        return place
    name = f"{Path(goal).stem.replace('~', '-')}-{strokes}"
    names = [f"{one}{ending}" for one in (f"{name}-{seed}", name) for ending in _HAND_INS]
    return next((place / one for one in names if (place / one).exists()), None)


def read_hand_in(path: Path, canvas: CanvasSize) -> HandIn:
    """Reads strokes for a canvas: a plan.json, or its folder, of this project; an SVG; or a CSV file.

    Raises HandInError that names the stroke or the line, PlanError for a damaged plan, ConfigError for an unknown
    kind of file.
    """
    kind = ".json" if path.is_dir() else path.suffix.lower()
    if kind == ".json":
        plan = Plan.load(path)
        if not max(abs(plan.canvas.width - canvas.width), abs(plan.canvas.height - canvas.height)) <= TOLERANCE:
            raise HandInError(
                f"{storage.abridge(path)} is a plan for a canvas of {plan.canvas}, and this picture is painted on "
                f"{canvas}; plan it for that canvas."
            )
        return HandIn(canvas, ground=plan.ground, plan=plan)
    if kind not in (".svg", ".csv"):
        raise ConfigError(
            f"{storage.abridge(path)} is no hand-in; give the plan.json of a painting, an .svg or a .csv file."
        )
    content = storage.read_bytes(path, "a hand-in", MAX_BYTES, HandInError)
    return (read_svg if kind == ".svg" else read_csv)(content, path.name, canvas)


# Statistics: means over the goals, intervals over the seeds, and differences pair by pair.


def summary_rows(results: experiment.Results) -> tuple[experiment.Row, ...]:
    """Returns a row for each entrant and budget: means over the goals, with 95 % intervals over the seeds.

    The interval is that of the seeds' means (Student's t); with one seed there is none. The best by PSNR come first.
    """
    groups: dict[tuple[Any, Any], list[tuple[Value, Mapping[str, float]]]] = {}
    for labels, one in results.found:
        groups.setdefault((labels["strokes"], labels["entrant"]), []).append((labels["seed"], one.numbers))
    rows: list[tuple[Any, float, experiment.Row]] = []
    for (strokes, entrant), mine in groups.items():
        row: dict[str, Value] = {"entrant": entrant, "budget": strokes, "cells": len(mine)}
        for name in _measured(results):
            seeds = dict.fromkeys(seed for seed, numbers in mine if name in numbers)
            by_seed = [
                float(np.mean([numbers[name] for own, numbers in mine if own == seed and name in numbers]))
                for seed in seeds
            ]
            mean = Mean.of(by_seed) if by_seed else None
            interval = f" ± {mean.high - mean.value:.2g}" if mean is not None and mean.count > 1 else ""
            row[name] = None if mean is None else f"{mean.value:.4g}{interval}"
        rows.append((strokes, -float(np.mean([numbers.get(PSNR, 0.0) for _, numbers in mine])), row))
    return tuple(row for *_, row in sorted(rows, key=lambda one: one[:2]))


def comparison_rows(results: experiment.Results, to: str = "ours") -> tuple[experiment.Row, ...]:
    """Returns a row for each entrant and measure: its difference from `to`, pair by pair, with Holm's correction.

    A pair has the same goal, budget and seed.
    """
    rows: list[experiment.Row] = []
    for name in (name for name in _measured(results) if name in MORE_IS_BETTER):
        found = [Result(labels, one.numbers[name]) for labels, one in results.found if name in one.numbers]
        ordered = sorted(found, key=lambda one: one.labels["entrant"] != to)  # a difference is the second minus `to`
        for test in paired_tests(ordered, ["entrant"]):
            if test.first == to:
                change, more = test.difference, test.more
                better = more if MORE_IS_BETTER[name] else change.count - more
                rows.append({
                    "measure": name, "entrant": test.second, f"minus {to}": change.value, "95 % from": change.low,
                    "to": change.high, "better in": f"{better} of {change.count}", "p, t-test": test.t,
                    "p, Wilcoxon": test.wilcoxon,
                })  # fmt: skip
    return tuple(rows)


def _measured(results: experiment.Results) -> list[str]:
    known = {name for _, one in results.found for name in one.numbers}
    return [name for name in MEASURES if name in known]
