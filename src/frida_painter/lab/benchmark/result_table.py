"""The table of the benchmark: its cells over processes and machines, its statistics, and its page.

The engine is that of sweeps. A cell that is done is never painted again: the same call continues.
"""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from importlib.metadata import version
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from frida_painter import storage
from frida_painter.errors import ConfigError, WorkerUnfit
from frida_painter.lab.benchmark.cell import ENTRANTS, INPUTS, BenchmarkCell, CellAssignment, perform_cell, read_cell
from frida_painter.lab.benchmark.judges import MEASURES, MORE_IS_BETTER, PSNR, lacks_network
from frida_painter.lab.benchmark.suite import VERSION, find_goal, suite_digest
from frida_painter.lab.sweeps.engine import TaskLimits
from frida_painter.lab.sweeps.report import Mean, Result, paired_tests
from frida_painter.lab.sweeps.runner import open_engine
from frida_painter.lab.sweeps.sweep_folder import SweepFolder
from frida_painter.lab.sweeps.sweep_spec import EngineName
from frida_painter.lab.trials import ResultTable, Row
from frida_painter.provenance import identify_here
from frida_painter.report.page import template

TABLE, PAGE, MARKDOWN = "benchmark.json", "index.html", "table.md"
_FORMAT = "frida-painter benchmark"
_LIMITS = TaskLimits(seconds=3 * 3600.0, threads=1, memory=1500, tries=2)
_HAND_INS = (".svg", ".csv", ".json", "")
_CPU = "cpu-seconds.toml"
"""File in a folder of hand-ins: seconds of the processor by the name of a hand-in, as its author measured them."""
_MAX_CPU = 2**20  # bytes
MAX_CELLS = 100_000


@dataclass(frozen=True)
class TableRequest:
    """Cells of a table: all combinations.

    entrants: names of ENTRANTS
    goals: names of pictures and combined goals
    budgets: numbers of strokes
    seeds: of the virtual studio
    hand_ins: folders of strokes by the name of their entrant; see `find_hand_in`
    """

    entrants: tuple[str, ...]
    goals: tuple[str, ...]
    budgets: tuple[int, ...]
    seeds: tuple[int, ...]
    hand_ins: Mapping[str, str]

    def cells(self) -> tuple[BenchmarkCell, ...]:
        """Returns all cells in order. Raises ConfigError for an unknown entrant or budget, and if there are none."""
        found = [BenchmarkCell(*each) for each in product(self.entrants, self.goals, self.budgets, self.seeds)]
        for name, folder in self.hand_ins.items():
            if name in ENTRANTS:
                raise ConfigError(f"{name} is an entrant of the project; give the hand-ins another name.")
            known = _cpu_seconds(Path(folder))
            for goal, strokes, seed in product(self.goals, self.budgets, self.seeds):
                file = find_hand_in(Path(folder), goal, strokes, seed)
                if file is not None:
                    found.append(BenchmarkCell(name, goal, strokes, seed, str(file), known.get(file.name)))
        for cell in found:
            cell.check()
        if not 1 <= len(found) <= MAX_CELLS:
            raise ConfigError(f"The table has {len(found)} cells; it has from 1 to {MAX_CELLS:,}.")
        return tuple(found)


@dataclass(frozen=True)
class TableOutcome:
    """Outcome of a table.

    records: of the cells that are done
    failures: sentences by the name of the cell
    before: number of cells that were done by earlier calls
    """

    folder: Path
    cells: tuple[BenchmarkCell, ...]
    records: tuple[Mapping[str, Any], ...]
    failures: Mapping[str, str]
    before: int = 0


def find_hand_in(folder: Path, goal: str, strokes: int, seed: int) -> Path | None:
    """Returns the hand-in of a cell in a folder: GOAL-STROKES-SEED.svg, or GOAL-STROKES.svg for all seeds, or None.

    .csv, .json and a folder with a plan.json do as well. "~" in a goal's name is "-" in that of the file.
    """
    name = f"{Path(goal).stem.replace('~', '-')}-{strokes}"
    names = [f"{one}{ending}" for one in (f"{name}-{seed}", name) for ending in _HAND_INS]
    return next((folder / one for one in names if (folder / one).exists()), None)


def run_table(
    request: TableRequest,
    folder: Path,
    *,
    engine: EngineName | None = None,
    address: str | None = None,
    jobs: int | None = None,
    notify: Callable[[int, int], None] = lambda done, of: None,
) -> TableOutcome:
    """Paints and judges all cells that are not done, writes the page, and returns the outcome.

    engine, address, jobs: as for a sweep
    notify: hears the number of cells that are done, and of all

    Raises ConfigError, SweepBusy if another process works on the folder, StorageError, WorkerUnfit.
    """
    cells = request.cells()
    place = SweepFolder(folder, TABLE, ("runs", INPUTS))  # of single cells
    failures: dict[str, str] = {}
    program = identify_here()
    with place.lock():
        _keep_request(request, program, place.path)
        for name in dict.fromkeys(cell.goal for cell in cells):
            find_goal(name, place.path / INPUTS)  # refused before anything is painted
        left = [cell for cell in cells if _is_left(read_cell(place.path, cell, program))]
        before = len(cells) - len(left)
        notify(before, len(cells))
        if left:
            tasks = [CellAssignment(cell, str(place.path), program) for cell in left]
            opened = open_engine(_LIMITS, len(left), engine=engine, address=address, jobs=jobs)
            with closing(opened.run(perform_cell, tasks)) as ended:
                for count, one in enumerate(ended, 1):
                    if isinstance(one.error, WorkerUnfit):
                        raise one.error
                    if one.error is not None:
                        failures[_name(one.task.cell)] = str(one.error)
                    notify(before + count, len(cells))
        records = tuple(record for cell in cells if (record := read_cell(place.path, cell, program)) is not None)
        outcome = TableOutcome(place.path, cells, records, failures, before)
        write_page(outcome)
    return outcome


def read_table(folder: Path) -> TableOutcome:
    """Returns the outcome of the table in a folder as far as it is done. Raises ConfigError if there is none."""
    kept = storage.read_json(folder / TABLE, "a table of the benchmark", ConfigError)
    if kept.get("format") != _FORMAT:
        raise ConfigError(f"{storage.abridge(folder)} holds no table of the benchmark; give the folder of one (--out).")
    if kept.get("suite") != suite_digest():
        raise ConfigError(
            f"{storage.abridge(folder)} is a table of another suite; this program has {VERSION}: paint it "
            "anew in another folder."
        )
    try:
        asked = kept["request"]
        request = TableRequest(
            tuple(asked["entrants"]),
            tuple(asked["goals"]),
            tuple(asked["budgets"]),
            tuple(asked["seeds"]),
            dict(asked["hand_ins"]),
        )
        cells, program = request.cells(), str(kept["program"])
    except (KeyError, TypeError, ValueError, AttributeError) as cause:
        raise ConfigError(f"{storage.abridge(folder / TABLE)} was edited; paint the table anew.") from cause
    place = folder.absolute()
    records = tuple(record for cell in cells if (record := read_cell(place, cell, program)) is not None)
    return TableOutcome(place, cells, records, {}, len(records))


def summary_rows(records: Sequence[Mapping[str, Any]]) -> tuple[Row, ...]:
    """Returns a row for each entrant and budget: means over the goals, with 95 % intervals over the seeds.

    The interval is that of the seeds' means (Student's t); with one seed there is none.
    """
    rows: list[Row] = []
    names = _measures(records)
    for strokes, entrant in _groups(records):
        mine = [one for one in records if _is_of(one, entrant, strokes)]
        row: dict[str, str | int | float | None] = {"entrant": entrant, "budget": strokes, "cells": len(mine)}
        row |= {name: _interval(_by_seed(mine, name)) for name in names}
        rows.append(row)
    return tuple(rows)


def comparison_rows(records: Sequence[Mapping[str, Any]], to: str = "ours") -> tuple[Row, ...]:
    """Returns a row for each entrant and measure: its difference from `to`, pair by pair, with Holm's correction.

    A pair has the same goal, budget and seed.
    """
    rows: list[Row] = []
    for name in [name for name in _measures(records) if name in MORE_IS_BETTER]:
        results = [Result(one["labels"], one["figures"][name]) for one in records if name in one["figures"]]
        for test in paired_tests(results, ["entrant"]):
            if to not in (test.first, test.second):
                continue
            sign = 1 if test.first == to else -1
            other = test.second if test.first == to else test.first
            low, high = sorted((sign * test.difference.low, sign * test.difference.high))
            more = test.more if sign == 1 else test.difference.count - test.more
            better = more if MORE_IS_BETTER[name] else test.difference.count - more
            rows.append({
                "measure": name, "entrant": str(other), f"minus {to}": sign * test.difference.value,
                "95 % from": low, "to": high, "better in": f"{better} of {test.difference.count}",
                "p, t-test": test.t, "p, Wilcoxon": test.wilcoxon,
            })  # fmt: skip
    return tuple(rows)


def markdown(outcome: TableOutcome) -> str:
    """Returns the tables as Markdown."""
    versions = sorted({str(one["versions"]["frida-painter"]) for one in outcome.records})
    head = (
        f"Suite {VERSION} ({suite_digest()[:12]}), frida-painter {', '.join(versions) or version('frida-painter')}, "
        f"{len(outcome.records)} of {len(outcome.cells)} cells.\n"
    )
    rows = summary_rows(outcome.records)
    tables = [ResultTable("Means over pictures, with 95 % intervals over seeds", rows)] if rows else []
    compared = comparison_rows(outcome.records)
    tables += [ResultTable("Differences from ours, pair by pair", compared)] if compared else []
    return "\n".join([head, *(table.markdown() for table in tables)])


def write_page(outcome: TableOutcome) -> Path:
    """Writes the page with tables and pictures, and table.md; returns the page. Raises StorageError."""
    storage.write_text(outcome.folder / MARKDOWN, markdown(outcome))
    rows = summary_rows(outcome.records)
    compared = comparison_rows(outcome.records)
    remarks = [(_title(one), " ".join(one["remarks"])) for one in outcome.records if one["remarks"]]
    html = template("benchmark.html").render(
        version=VERSION,
        done=len(outcome.records),
        of=len(outcome.cells),
        columns=list(rows[0]) if rows else [],
        rows=[[_cell_text(value) for value in row.values()] for row in rows],
        compared_columns=list(compared[0]) if compared else [],
        compared=[[_cell_text(value) for value in row.values()] for row in compared],
        sheets=_sheets(outcome),
        remarks=remarks,
        failures=list(outcome.failures.items()),
    )
    path = outcome.folder / PAGE
    storage.write_text(path, html.encode("utf-8", "replace").decode("utf-8"))
    return path


@dataclass(frozen=True)
class _Figure:
    """Picture on the page: its file, the cell that it shows, and what the judges say."""

    file: str
    title: str
    caption: str


def _sheets(outcome: TableOutcome) -> list[tuple[str, list[_Figure]]]:
    """Returns the paintings of the first seed, by goal and budget."""
    if not outcome.records:
        return []
    seed = outcome.cells[0].seed
    sheets: dict[str, list[_Figure]] = {}
    for one in outcome.records:
        labels = one["labels"]
        if labels["seed"] == seed:
            figures = ", ".join(
                f"{name.split(',')[0]} {one['figures'][name]:.3g}" for name in MORE_IS_BETTER if name in one["figures"]
            )
            sheets.setdefault(f"{labels['goal']}, {labels['strokes']} strokes", []).append(
                _Figure(f"runs/{one['key']}/painting.png", labels["entrant"], figures)
            )
    return list(sheets.items())


def _is_left(record: Mapping[str, Any] | None) -> bool:
    """Returns True if a cell is not painted, or not judged by all judges that are here."""
    return record is None or lacks_network(record["figures"])


def _measures(records: Iterable[Mapping[str, Any]]) -> list[str]:
    known = {name for one in records for name in one["figures"]}
    return [name for name in MEASURES if name in known]


def _groups(records: Iterable[Mapping[str, Any]]) -> list[tuple[int, str]]:
    """Returns budgets with their entrants, the best by PSNR first."""
    found = dict.fromkeys((one["labels"]["strokes"], one["labels"]["entrant"]) for one in records)
    kept = list(records)

    def rank(group: tuple[int, str]) -> tuple[int, float]:
        values = [one["figures"].get(PSNR, 0.0) for one in kept if _is_of(one, group[1], group[0])]
        return group[0], -float(np.mean(values))

    return sorted(found, key=rank)


def _is_of(record: Mapping[str, Any], entrant: str, strokes: int) -> bool:
    return bool(record["labels"]["entrant"] == entrant and record["labels"]["strokes"] == strokes)


def _by_seed(records: Sequence[Mapping[str, Any]], name: str) -> list[float]:
    """Returns the mean of a figure over the goals, for each seed."""
    values: dict[int, list[float]] = {}
    for one in records:
        if name in one["figures"]:
            values.setdefault(one["labels"]["seed"], []).append(one["figures"][name])
    return [float(np.mean(of_seed)) for of_seed in values.values()]


def _interval(values: Sequence[float]) -> str | None:
    if not values:
        return None
    mean = Mean.of(values)
    return f"{mean.value:.4g}" if mean.count == 1 else f"{mean.value:.4g} ± {mean.high - mean.value:.2g}"


def _cell_text(value: object) -> str:
    return "–" if value is None else f"{value:.4g}" if isinstance(value, float) else str(value)


def _title(record: Mapping[str, Any]) -> str:
    return ", ".join(str(value) for value in record["labels"].values())


def _name(cell: BenchmarkCell) -> str:
    return ", ".join(str(value) for value in cell.labels().values())


def _cpu_seconds(folder: Path) -> dict[str, float]:
    """Returns the seconds that the author of hand-ins measured, by file. Raises ConfigError."""
    if not folder.is_dir():
        raise ConfigError(f"{storage.abridge(folder)} is no folder of hand-ins; it holds files such as cat-100.svg.")
    if not (folder / _CPU).exists():
        return {}
    told = storage.read_toml(folder / _CPU, "seconds of hand-ins (TOML)", _MAX_CPU, 'write "cat-100.svg" = 12.5')
    if not all(type(value) in (int, float) and 0 <= value < 1e9 for value in told.values()):
        raise ConfigError(f'{_CPU} has a value that is no number of seconds; write "cat-100.svg" = 12.5.')
    return {str(name): float(value) for name, value in told.items()}


def _keep_request(request: TableRequest, program: str, folder: Path) -> None:
    asked = json.loads(json.dumps(asdict(request)))
    kept = {"format": _FORMAT, "suite": suite_digest(), "program": program, "request": asked}
    storage.write_json(folder / TABLE, kept)
