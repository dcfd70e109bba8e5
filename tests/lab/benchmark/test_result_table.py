import json
import math

import numpy as np
import pytest
from scipy import stats

from frida_painter.errors import ConfigError, StorageError, TryFailed, WorkerUnfit
from frida_painter.lab.benchmark import result_table as table
from frida_painter.lab.benchmark.cell import BenchmarkCell, perform_cell, read_cell
from frida_painter.lab.benchmark.result_table import (
    TableRequest,
    comparison_rows,
    find_hand_in,
    read_table,
    run_table,
    summary_rows,
)
from frida_painter.lab.benchmark.suite import find_goal
from frida_painter.lab.sweeps.engine import Ended
from frida_painter.lab.sweeps.sweep_folder import RunFolder
from frida_painter.provenance import identify_here

VERSIONS = {"frida-painter": "1"}
PROGRAM = "frida-painter 1, code 0"


def record(entrant="ours", goal="cat", strokes=100, seed=11, **figures):
    labels = {"entrant": entrant, "goal": goal, "strokes": strokes, "seed": seed}
    return {"labels": labels, "figures": figures, "remarks": [], "versions": VERSIONS, "key": "k"}


class Engine:
    """Does the work in this process; a painting is a record with made-up figures."""

    slots = 1

    def __init__(self, fails=()):
        self.done, self._fails = [], fails

    def run(self, work, tasks):
        for task in tasks:
            cell = task.cell
            if cell.entrant in self._fails:
                yield Ended(task, error=self._fails[cell.entrant])
                continue
            self.done.append(cell)
            goal = find_goal(cell.goal, table.Path(task.folder) / "inputs")
            place = RunFolder(table.Path(task.folder), cell.key(goal, task.program))
            made = record(cell.entrant, cell.goal, cell.strokes, cell.seed, **{"PSNR, dB": 20.0 + cell.seed})
            with place.lock():
                place.keep({**made, "key": place.path.name})
            yield Ended(task, value={})


@pytest.fixture
def engine(monkeypatch):
    found = Engine()
    monkeypatch.setattr(table, "lacks_network", lambda figures: False)  # whether or not it was fetched here
    monkeypatch.setattr(table, "open_engine", lambda *given, **named: found)
    return found


def request(entrants=("ours", "plain"), goals=("cat", "flower"), seeds=(11, 12), hand_ins=None):
    return TableRequest(entrants, goals, (100,), seeds, hand_ins or {})


@pytest.mark.slow
def test_a_table_goes_on_where_it_stopped(tmp_path, engine):
    first = run_table(request(seeds=(11,)), tmp_path / "t")
    assert len(first.records) == len(engine.done) == 4 and first.before == 0
    more = run_table(request(), tmp_path / "t")
    assert len(more.records) == 8 and more.before == 4 and len(engine.done) == 8
    again = run_table(request(), tmp_path / "t")
    assert len(again.records) == 8 and len(engine.done) == 8
    assert len(read_table(tmp_path / "t").records) == 8
    page = (tmp_path / "t" / "index.html").read_text()
    assert "8 of 8 cells" in page and "plain" in page and "<script" not in page
    assert "| ours | 100 | 4 | 31.5" in (tmp_path / "t" / "table.md").read_text()


def test_what_another_program_painted_is_shown_and_not_mixed_with_what_this_one_paints(tmp_path, engine, monkeypatch):
    run_table(request(seeds=(11,)), tmp_path / "t")
    monkeypatch.setattr(table, "identify_here", lambda: PROGRAM)
    assert len(read_table(tmp_path / "t").records) == 4, "the page is made by the program that is here now"
    again = run_table(request(seeds=(11,)), tmp_path / "t")
    assert again.before == 0 and len(engine.done) == 8


def test_a_cell_that_was_painted_alone_is_part_of_the_table(tmp_path, engine):
    cell = BenchmarkCell("ours", "cat", 100, 11)
    place = RunFolder(tmp_path / "t", cell.key(find_goal("cat", tmp_path), identify_here()))
    with place.lock():
        place.keep({**record(**{"PSNR, dB": 20.0}), "key": place.path.name})
    outcome = run_table(request(), tmp_path / "t")
    assert outcome.before == 1 and len(outcome.records) == 8 and len(engine.done) == 7


def test_a_cell_that_fails_stops_no_other(tmp_path, engine, monkeypatch):
    failing = Engine({"plain": TryFailed("It hung <b>.")})
    monkeypatch.setattr(table, "open_engine", lambda *given, **named: failing)
    outcome = run_table(request(), tmp_path / "t")
    assert len(outcome.records) == 4 and len(outcome.failures) == 4
    assert "It hung &lt;b&gt;." in (tmp_path / "t" / "index.html").read_text()
    unfit = Engine({"plain": WorkerUnfit("Another version.")})
    monkeypatch.setattr(table, "open_engine", lambda *given, **named: unfit)
    with pytest.raises(WorkerUnfit):
        run_table(request(), tmp_path / "t")


def test_hand_ins_are_found_by_name_and_repainted_if_they_change(tmp_path, engine):
    folder = tmp_path / "strokes"
    folder.mkdir()
    for name in ("cat-100.svg", "flower-100-12.csv", "other.svg"):
        (folder / name).write_text("<svg/>")
    (folder / "cpu-seconds.toml").write_text('"cat-100.svg" = 12.5')
    assert find_hand_in(folder, "flower", 100, 11) is None
    assert find_hand_in(folder, "flower", 100, 12).name == "flower-100-12.csv"
    asked = request(("ours",), hand_ins={"peer": str(folder)})
    cells = [cell for cell in asked.cells() if cell.entrant == "peer"]
    assert [(cell.goal, cell.seed, cell.cpu_seconds) for cell in cells] == [
        ("cat", 11, 12.5),
        ("cat", 12, 12.5),
        ("flower", 12, None),
    ]
    run_table(asked, tmp_path / "t")
    assert len(engine.done) == 4 + 3
    (folder / "cat-100.svg").write_text("<svg></svg>")
    run_table(asked, tmp_path / "t")
    assert len(engine.done) == 4 + 3 + 2


@pytest.mark.parametrize(
    ("asked", "told"),
    [
        (request(("theirs",)), "'theirs' is no entrant"),
        (TableRequest(("ours",), ("cat",), (200,), (11,), {}), "budgets are 100"),
        (TableRequest(("ours",), ("cat",), (100,), (-1,), {}), "seed -1"),
        (TableRequest((), ("cat",), (100,), (11,), {}), "0 cells"),
        (request(hand_ins={"ours": "/nowhere"}), "another name"),
        (request(hand_ins={"peer": "/nowhere"}), "no folder"),
        (request(goals=("cat", "unicorn")), "'unicorn'"),
    ],
)
def test_wrong_tables_are_refused_before_anything_is_painted(tmp_path, engine, asked, told):
    with pytest.raises(ConfigError, match=told):
        run_table(asked, tmp_path / "t")
    assert not engine.done


def test_edited_and_foreign_folders_are_refused(tmp_path, engine):
    with pytest.raises(ConfigError):
        read_table(tmp_path)
    (tmp_path / "x").mkdir()
    (tmp_path / "x" / "letter.txt").write_text("hello")
    with pytest.raises(StorageError, match="something that is no sweep"):
        run_table(request(), tmp_path / "x")
    run_table(request(), tmp_path / "t")
    kept = json.loads((tmp_path / "t" / "benchmark.json").read_text())
    for edit in ({"format": "sweep"}, {"suite": "0" * 64}, {"request": {"goals": 3}}, {"request": None}):
        (tmp_path / "t" / "benchmark.json").write_text(json.dumps({**kept, **edit}))
        with pytest.raises(ConfigError):
            read_table(tmp_path / "t")


def test_seconds_of_hand_ins_are_numbers(tmp_path, engine):
    (tmp_path / "cpu-seconds.toml").write_text('"cat-100.svg" = "long"')
    with pytest.raises(ConfigError, match="no number of seconds"):
        run_table(request(hand_ins={"peer": str(tmp_path)}), tmp_path / "t")


def test_intervals_are_over_the_seeds():
    random = np.random.default_rng(0)
    values = random.normal(20, 1, (3, 4))  # seeds, pictures
    records = [record(goal=str(p), seed=s, **{"PSNR, dB": values[s, p]}) for s in range(3) for p in range(4)]
    (row,) = summary_rows(records)
    low, high = stats.t.interval(0.95, 2, values.mean(), stats.sem(values.mean(1)))
    mean, half = map(float, row["PSNR, dB"].split(" ± "))
    assert mean == pytest.approx(values.mean(), abs=0.01) and half == pytest.approx((high - low) / 2, rel=0.06)
    (alone,) = summary_rows(records[:4])
    assert "±" not in alone["PSNR, dB"]


def test_the_best_entrant_comes_first_and_differences_have_their_sign():
    random = np.random.default_rng(1)
    ours = random.normal(24, 1, 8)
    records = [record("worse", str(p), **{"PSNR, dB": ours[p] - 2 + 0.01 * p, "SSIM": 0.5}) for p in range(8)]
    records += [record("ours", str(p), **{"PSNR, dB": ours[p], "SSIM": 0.5 + 0.01 * p}) for p in range(8)]
    assert [row["entrant"] for row in summary_rows(records)] == ["ours", "worse"]
    for shuffled in (records, records[::-1]):
        row = next(one for one in comparison_rows(shuffled) if one["measure"] == "PSNR, dB")
        assert row["entrant"] == "worse" and row["minus ours"] == pytest.approx(-1.965)
        assert row["95 % from"] < row["minus ours"] < row["to"] < 0 and row["better in"] == "0 of 8"
    assert all(math.isfinite(row["p, t-test"]) for row in comparison_rows(records))


def test_a_record_of_another_version_of_a_cell_is_not_taken(tmp_path):
    cell = BenchmarkCell("ours", "cat", 100, 11)
    assert read_cell(tmp_path, cell, PROGRAM) is None
    others = (
        ("plain", "cat", 100, 11),
        ("ours", "cat", 300, 11),
        ("ours", "cat", 100, 12),
        ("ours", "flower", 100, 11),
    )
    keys = {
        one.key(find_goal(one.goal, tmp_path), PROGRAM) for one in (cell, *(BenchmarkCell(*other) for other in others))
    }
    assert len(keys) == 5 and callable(perform_cell)
