"""The table of the benchmark: an experiment whose runs are cells, each one painting by one entrant.

An entrant paints one goal within one budget in the virtual studio of one seed. Every painting is made by the same loop
on the same easel. Only `ours` looks while it paints; all others hand in a plan.
"""

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from torch import Tensor

from frida_painter import images, storage
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import ConfigError, HandInError, StorageError
from frida_painter.objectives.encoders.loading import EncoderRegistry
from frida_painter.plan import Plan
from frida_painter.report.page import template
from frida_painter.report.sheets import Cell, FigureRow, page
from frida_painter.runs.run import PaintingRun
from frida_painter.runs.spec import RunSpec
from frida_painter.session.events import Dipped, Event, Planned, PlanningStep, StrokePainted
from frida_painter_lab.benchmark import judges
from frida_painter_lab.benchmark.fitting import fit_hand_in
from frida_painter_lab.benchmark.hand_in import MAX_BYTES, TOLERANCE, HandIn, read_csv
from frida_painter_lab.benchmark.judges import (
    CPU,
    DIPS,
    FORECAST,
    LEFT,
    MEASURES,
    MINUTES,
    MORE_IS_BETTER,
    PAINTS,
    PSNR,
    STROKES,
    Judges,
)
from frida_painter_lab.benchmark.rivals import GREEDY_BRUSHES, PLAIN_BRUSH, plan_greedy, plan_hertzmann, plan_plain
from frida_painter_lab.benchmark.suite import VERSION, BenchmarkGoal, Budget, find_budget, find_goal, suite_digest
from frida_painter_lab.experiment import (
    Experiment,
    Measurement,
    Notify,
    Outcome,
    Progress,
    Results,
    ResultTable,
    Row,
    format_value,
)
from frida_painter_lab.paintings import StudioWithout
from frida_painter_lab.runs import Labels, Run, Value
from frida_painter_lab.sweeps.report import Mean, Result, paired_tests
from frida_painter_lab.sweeps.runner import fix_to_plan

INPUTS = "inputs"
"""Folder of the files of held-out pictures, in the folder of a table."""
REQUEST, PAGE = "benchmark.json", "index.html"
_FORMAT = "frida-painter benchmark"
_HAND_INS = (".svg", ".csv", ".json", "")
_CPU = "cpu-seconds.toml"
"""File in a folder of hand-ins: seconds of the processor by the name of a hand-in, as its author measured them."""
_MAX_CPU = 2**20  # bytes
MAX_CELLS = 100_000


@dataclass(frozen=True)
class Entrant:
    """Painter of the project that can be entered by name.

    words: what it is
    brushes: brushes of its plan; None for those that the project chooses
    make: makes its plan on a white canvas; None for the project's planner
    looks: number of looks with a replan; None for the project's default
    """

    name: str
    words: str
    brushes: str | None = None
    make: Callable[[PaintingRun, Tensor, Budget], Plan] | None = None
    looks: int | None = 0


ENTRANTS: Mapping[str, Entrant] = {
    each.name: each
    for each in (
        Entrant("ours", "the planner of this project, with its looks and replans", looks=None),
        Entrant("ours-blind", "its first plan, painted without a look"),
        Entrant(
            "plain", "the paper's plain algorithm: random strokes, Adam, one layer",
            PLAIN_BRUSH, plan_plain,
        ),
        Entrant(
            "greedy", "each stroke the best of 64 random ones",
            ",".join(GREEDY_BRUSHES), plan_greedy,
        ),
        Entrant(
            "hertzmann", "Hertzmann 1998: curved strokes of three sizes",
            ",".join(GREEDY_BRUSHES),
            lambda run, target, budget: plan_hertzmann(run.spec.canvas, target, budget, run.spec.seed),
        ),
    )
}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class CellRun(Run):
    """Run of a cell.

    goal: what is painted
    hand_in: file of the strokes; None for an entrant of this project
    cpu_seconds: time of the processor that the entrant says it took; None if unknown
    """

    goal: BenchmarkGoal
    hand_in: Path | None = None
    cpu_seconds: float | None = None

    @property
    def entrant(self) -> Entrant | None:
        """Entrant of this project; None for a hand-in."""
        return ENTRANTS[self["entrant"]] if self.hand_in is None else None

    @property
    def budget(self) -> Budget:
        """Budget. Raises ConfigError."""
        return find_budget(int(self["strokes"]))

    @property
    def spec(self) -> RunSpec:
        """Description of the painting."""
        entrant, budget = self.entrant, self.budget
        fields: dict[str, Any] = {
            "goal": [dict(item) for item in self.goal.items], "canvas": self.goal.canvas, "fit": "crop",
            "strokes": budget.strokes, "colors": budget.paints, "new_paints": False, "seed": int(self["seed"]),
            "film": False,
        }  # fmt: skip
        if entrant is None or entrant.make is not None:
            fields |= {"ground": "white", "brushes": "medium" if entrant is None else entrant.brushes}
        if entrant is None or entrant.looks is not None:
            fields["replans"] = 0
        if entrant is not None and entrant.make is None:
            fields["minutes"] = budget.minutes
        return RunSpec.of(**fields)


@dataclass(frozen=True, kw_only=True)
class BenchmarkTable(Experiment):
    """Table of the benchmark: all combinations of entrants, goals, budgets and seeds.

    folder: of the table; it keeps all cells
    entrants: names of ENTRANTS
    goals: names of pictures and combined goals; see suite.find_goal
    budgets: by their numbers of strokes
    seeds: of the virtual studio, and of the entrants of this project
    hand_ins: folders of strokes, or one file, by the name of their entrant; see `find_hand_in`
    cpu_seconds: time of the processor for a hand-in that is one file; None if unknown
    """

    NAME = "benchmark"
    TITLE = f"Benchmark of robot painting, suite {VERSION}"

    folder: Path
    entrants: tuple[str, ...]
    goals: tuple[str, ...]
    budgets: tuple[int, ...]
    seeds: tuple[int, ...]
    hand_ins: Mapping[str, str] = field(default_factory=dict)
    cpu_seconds: float | None = None

    def runs(self) -> Sequence[CellRun]:
        """Returns all cells. Raises ConfigError for an unknown entrant, goal, budget or seed, or if there are none."""
        self._require_known()
        goals = {name: find_goal(name, self.folder / INPUTS) for name in self.goals}
        cells = product(goals.values(), self.budgets, self.seeds)
        found = [_cell(entrant, *cell) for entrant, cell in product(self.entrants, cells)]
        for name, place in self.hand_ins.items():
            known = _cpu_seconds(Path(place)) if Path(place).is_dir() else {}
            for goal, strokes, seed in product(goals.values(), self.budgets, self.seeds):
                file = find_hand_in(Path(place), goal.name, strokes, seed)
                if file is not None:
                    seconds = known.get(file.name, self.cpu_seconds)
                    found.append(_cell(name, goal, strokes, seed, file, seconds))
        if not 1 <= len(found) <= MAX_CELLS:
            raise ConfigError(f"The table has {len(found)} cells; it has from 1 to {MAX_CELLS:,}.")
        return found

    def _require_known(self) -> None:
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
        for strokes in self.budgets:
            find_budget(strokes)

    def measure_or_load(self, run: Run, keep: Path | None, notify: Notify) -> Measurement:
        """Returns the figures of a cell; a painting that is kept is judged by a network that was fetched later."""
        measured = super().measure_or_load(run, keep, notify)
        assert isinstance(run, CellRun)
        if run.goal.picture is not None and judges.lacks_network(measured.numbers):
            judged = self._judges.of_picture(measured.pictures["painting"], run.goal.picture)
            measured = replace(measured, numbers={**measured.numbers, **judged})
            if keep is not None:
                self.keep(run, keep, measured)
        return measured

    @cached_property
    def _judges(self) -> Judges:
        return Judges.open()

    def measure(self, run: Run, notify: Notify) -> Measurement:
        """Paints and judges a cell. Raises the errors of reading, planning and painting."""
        assert isinstance(run, CellRun)
        notify(Progress(0.0, run.words))
        goal, entrant, budget, encoders = run.goal, run.entrant, run.budget, EncoderRegistry()
        if goal.picture is None and entrant is not None and entrant.make is not None:
            raise ConfigError(
                f"{entrant.name} paints photographs alone, and {goal.name} is a combined goal; leave it out."
            )
        remarks: Sequence[str] = ()
        first = foretold = None
        if run.hand_in is not None:
            drawing = read_hand_in(run.hand_in, goal.canvas)
            first, remarks = fit_hand_in(drawing, budget, int(run["seed"]))
            if drawing.strokes and goal.picture is not None:
                foretold = drawing.picture(*goal.picture.shape[1:])
        began, spec = time.process_time(), run.spec
        if entrant is not None and entrant.make is not None:
            assert goal.picture is not None
            with PaintingRun(spec, encoders=encoders) as opened:
                first = entrant.make(opened, goal.picture, budget)
        meter, studio = _Meter(budget), StudioWithout()
        spec = spec if first is None else fix_to_plan(spec, first)
        with PaintingRun(spec, listeners=[meter.hear], encoders=encoders) as opened:
            opened.controls = replace(opened.controls, stop_asked=meter.is_spent)
            plan = opened.plan() if first is None else first
            planned = time.process_time() - began
            expected = opened.planner.expected(plan, opened.planner.bare)
            meter.run = opened
            painting = opened.simulate(plan, studio.open)
            truth = studio.truth(expected.shape[1] if goal.picture is None else goal.picture.shape[1])
            figures: dict[str, float] = {}
            if goal.picture is None:
                bare = opened.planner.validation_loss(opened.planner.bare)
                left = opened.planner.validation_loss(images.fit(truth, *expected.shape[1:]))
                figures[LEFT] = left / max(bare, 1e-12)
            else:
                figures |= self._judges.of_picture(truth, goal.picture)
        foretold = expected if foretold is None else foretold
        figures |= {
            FORECAST: judges.forecast_fidelity(foretold, truth),
            MINUTES: painting.robot_seconds / 60,
            DIPS: meter.dips,
            STROKES: painting.painted,
            PAINTS: len(plan.palette),
        }
        cpu = planned + meter.replanning if run.hand_in is None else run.cpu_seconds
        figures |= {} if cpu is None else {CPU: cpu}
        return Measurement(judges.finite(figures), {"painting": truth, "foretold": foretold}, remarks)

    def settings(self) -> Mapping[str, Value | Sequence[Value]]:
        """Returns the suite and all that is combined."""
        return {
            "suite": suite_digest()[:12],
            "entrants": [*self.entrants, *self.hand_ins],
            "goals": self.goals,
            "budgets": self.budgets,
            "seeds": self.seeds,
        }

    def tables(self, results: Results) -> Sequence[ResultTable]:
        """Returns the means of each entrant and budget, and the differences from ours."""
        named = {
            "Means over pictures, with 95 % intervals over seeds": summary_rows(results),
            "Differences from ours, pair by pair": comparison_rows(results),
        }
        return [ResultTable(title, rows) for title, rows in named.items() if rows]

    def notes(self, results: Results) -> Sequence[str]:
        """Returns how many cells are done, and what was done to hand-ins."""
        told = [
            f"{', '.join(map(str, labels.values()))}: {' '.join(one.remarks)}"
            for labels, one in results.found
            if one.remarks
        ]
        return [f"{len(results.found)} of {len(self.all_runs)} cells.", *told]

    def pictures(self, results: Results) -> Mapping[str, Tensor]:
        """Returns a sheet for each goal and budget: the paintings of the first seed."""
        sheets: dict[str, list[Cell]] = {}
        for labels, one in results.found:
            if labels["seed"] == self.seeds[0]:
                told = [
                    f"{name.split(',')[0]} {one.numbers[name]:.3g}" for name in MORE_IS_BETTER if name in one.numbers
                ]
                cell = Cell(one.pictures["painting"], f"{labels['entrant']}: {', '.join(told)}")
                name = f"{labels['goal']}-{labels['strokes']}".replace("~", "-")
                sheets.setdefault(name, []).append(cell)
        return {name: page("", (), [FigureRow("", cells)], width=300) for name, cells in sheets.items()}

    def write_request(self) -> None:
        """Writes what `read_table` needs. Raises StorageError."""
        asked = {name: getattr(self, name) for name in ("entrants", "goals", "budgets", "seeds", "hand_ins")}
        storage.write_json(self.folder / REQUEST, {"format": _FORMAT, "suite": suite_digest(), "request": asked})


def read_table(folder: Path) -> BenchmarkTable:
    """Returns the table in a folder. Raises ConfigError if there is none, or one of another suite."""
    kept = storage.read_json(folder / REQUEST, "a table of the benchmark", ConfigError)
    if kept.get("format") != _FORMAT:
        raise ConfigError(f"{storage.abridge(folder)} holds no table of the benchmark; give the folder of one (--out).")
    if kept.get("suite") != suite_digest():
        raise ConfigError(
            f"{storage.abridge(folder)} is a table of another suite; this program has {VERSION}: paint it "
            "anew in another folder."
        )
    try:
        asked = kept["request"]
        lists: dict[str, Any] = {name: tuple(asked[name]) for name in ("entrants", "goals", "budgets", "seeds")}
        table = BenchmarkTable(folder=folder.absolute(), hand_ins=dict(asked["hand_ins"]), **lists)
        assert table.all_runs
    except (KeyError, TypeError, ValueError, AttributeError) as cause:
        raise ConfigError(f"{storage.abridge(folder / REQUEST)} was edited; paint the table anew.") from cause
    return table


def write_page(outcome: Outcome, folder: Path) -> Path:
    """Writes the page with tables and pictures; returns it. Raises StorageError."""
    html = template("benchmark.html").render(
        title=outcome.title,
        notes=outcome.notes,
        tables=[
            (one.title, list(one.rows[0]), [[format_value(value) for value in row.values()] for row in one.rows])
            for one in outcome.tables
        ],
        pictures=list(outcome.pictures),
    )
    storage.write_text(folder / PAGE, html.encode("utf-8", "replace").decode("utf-8"))
    return folder / PAGE


def _cell(
    entrant: str,
    goal: BenchmarkGoal,
    strokes: int,
    seed: int,
    hand_in: Path | None = None,
    seconds: float | None = None,
) -> CellRun:
    """Returns a cell, which depends on the suite, the content of its goal and of its hand-in."""
    paths = [value for item in goal.items for value in item.values() if isinstance(value, str)]
    facts = {
        "suite": suite_digest(),
        "goal": [storage.sha256(Path(one), "a goal") if Path(one).is_file() else one for one in paths],
        "hand-in": None if hand_in is None else _content(hand_in),
        "CPU s": seconds,
    }
    labels: Labels = {"entrant": entrant, "goal": goal.name, "strokes": strokes, "seed": seed}
    return CellRun(labels, facts, goal=goal, hand_in=hand_in, cpu_seconds=seconds)


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
        return (
            self.strokes >= self._budget.strokes
            or self.dips >= self._budget.dips
            or now - self._began >= 60 * self._budget.minutes
        ) and self.strokes > 0


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


def _cpu_seconds(folder: Path) -> dict[str, float]:
    """Returns the seconds that the author of hand-ins measured, by file. Raises ConfigError."""
    if not (folder / _CPU).exists():
        return {}
    told = storage.read_toml(folder / _CPU, "seconds of hand-ins (TOML)", _MAX_CPU, 'write "cat-100.svg" = 12.5')
    if not all(type(value) in (int, float) and 0 <= value < 1e9 for value in told.values()):
        raise ConfigError(f'{_CPU} has a value that is no number of seconds; write "cat-100.svg" = 12.5.')
    return {str(name): float(value) for name, value in told.items()}


def _content(path: Path) -> str:
    """Returns the hash of a hand-in: of its file, or of the plan in its folder."""
    if path.is_dir() or path.suffix == ".json":
        return Plan.load(path).digest
    try:
        return storage.sha256(path, "a hand-in")
    except StorageError as error:
        raise ConfigError(f"{storage.abridge(path)} cannot be read as a hand-in: {error}") from error


def read_hand_in(path: Path, canvas: CanvasSize) -> HandIn:
    """Reads strokes for a canvas: a plan.json, or its folder, of this project; an SVG; or a CSV file.

    Raises HandInError that names the stroke or the line, PlanError for a damaged plan, ConfigError for an unknown
    kind of file.
    """
    kind = "plan" if path.is_dir() else path.suffix.lower()
    if kind in ("plan", ".json"):
        plan = Plan.load(path)
        if not max(abs(plan.canvas.width - canvas.width), abs(plan.canvas.height - canvas.height)) <= TOLERANCE:
            raise HandInError(
                f"{storage.abridge(path)} is a plan for a canvas of {plan.canvas}, and this picture is painted on "
                f"{canvas}; plan it for that canvas."
            )
        return HandIn(canvas, plan.digest, ground=plan.ground, plan=plan)
    if kind not in (".svg", ".csv"):
        raise ConfigError(
            f"{storage.abridge(path)} is no hand-in; give the plan.json of a painting, an .svg or a .csv file."
        )
    with storage.open_checked(path, "a hand-in", MAX_BYTES, HandInError) as file:
        content = file.read()
    if kind == ".svg":
        from frida_painter_lab.benchmark.svg_strokes import read_svg  # needs the extra

        return read_svg(content, path.name, canvas)
    return read_csv(content, path.name, canvas)


# Statistics: means over the goals, intervals over the seeds, and differences pair by pair.


def summary_rows(results: Results) -> tuple[Row, ...]:
    """Returns a row for each entrant and budget: means over the goals, with 95 % intervals over the seeds.

    The interval is that of the seeds' means (Student's t); with one seed there is none. The best by PSNR come first.
    """
    groups = dict.fromkeys((labels["strokes"], labels["entrant"]) for labels, _ in results.found)
    rows: list[tuple[tuple[Any, float], Row]] = []
    for strokes, entrant in groups:
        mine = [(labels, one.numbers) for labels, one in results.found
                if (labels["strokes"], labels["entrant"]) == (strokes, entrant)]  # fmt: skip
        row: dict[str, Value] = {"entrant": entrant, "budget": strokes, "cells": len(mine)}
        row |= {name: _interval(_by_seed(mine, name)) for name in _measured(results)}
        best = -float(np.mean([numbers.get(PSNR, 0.0) for _, numbers in mine]))
        rows.append(((strokes, best), row))
    return tuple(row for _, row in sorted(rows, key=lambda pair: pair[0]))


def comparison_rows(results: Results, to: str = "ours") -> tuple[Row, ...]:
    """Returns a row for each entrant and measure: its difference from `to`, pair by pair, with Holm's correction.

    A pair has the same goal, budget and seed.
    """
    rows: list[Row] = []
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


def _measured(results: Results) -> list[str]:
    known = {name for _, one in results.found for name in one.numbers}
    return [name for name in MEASURES if name in known]


def _by_seed(cells: Iterable[tuple[Mapping[str, Any], Mapping[str, float]]], name: str) -> list[float]:
    """Returns the mean of a figure over the goals, for each seed."""
    values: dict[int, list[float]] = {}
    for labels, numbers in cells:
        if name in numbers:
            values.setdefault(labels["seed"], []).append(numbers[name])
    return [float(np.mean(of_seed)) for of_seed in values.values()]


def _interval(values: Sequence[float]) -> str | None:
    if not values:
        return None
    mean = Mean.of(values)
    return f"{mean.value:.4g}" if mean.count == 1 else f"{mean.value:.4g} ± {mean.high - mean.value:.2g}"
