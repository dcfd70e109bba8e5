"""The table of the benchmark: which cells there are, what each is judged by, and what is told of all."""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from scipy import stats

from frida_painter.errors import ConfigError
from frida_painter.objectives import weights
from frida_painter.system import images
from frida_painter_cli import commands
from frida_painter_lab.benchmark import table as tables
from frida_painter_lab.benchmark.suite import Budget
from frida_painter_lab.benchmark.table import (
    ENTRANTS,
    BenchmarkTable,
    comparison_rows,
    find_hand_in,
    read_table,
    summary_rows,
    write_page,
)
from frida_painter_lab.experiment import Measurement, Results, silent

STROKES = """# frida-painter strokes 1
stroke,color,width_mm,x_mm,y_mm
1,#204080,15,10,20
1,#204080,15,60,20
2,#a03020,10,20,40
2,#a03020,10,60,45
"""


@pytest.fixture
def small(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a picture of its own and strokes for it; its canvas is small."""
    monkeypatch.setattr("frida_painter_lab.benchmark.suite._LONG", 0.08)
    picture = torch.ones(3, 48, 64)
    picture[:, 24:] = torch.tensor([0.1, 0.25, 0.5])[:, None, None]
    images.save(picture, tmp_path / "own.png")
    (tmp_path / "strokes.csv").write_text(STROKES)
    return tmp_path


def peer(folder: Path, **changes: Any) -> BenchmarkTable:
    asked = BenchmarkTable(
        folder=folder, entrants=(), goals=(str(folder / "own.png"),), budgets=(100,), seeds=(11,),
        hand_ins={"peer": str(folder / "strokes.csv")},
    )  # fmt: skip
    return replace(asked, **changes)


def test_strokes_of_a_stranger_are_painted_and_judged_within_the_budget(small: Path, monkeypatch) -> None:
    more = "".join(f"{n},#{n:02x}8040,8,{x},{10 + n}\n" for n in range(10, 30) for x in (10, 40))
    (small / "strokes.csv").write_text(STROKES + more)
    monkeypatch.setattr(tables, "find_budget", lambda strokes: Budget(100, 12, 60.0, 4))
    asked = peer(small)
    (run,) = asked.all_runs
    made = asked.measure_or_load(run, small, silent)
    figures = made.numbers
    assert figures["dips"] == 4 and 0 < figures["strokes"] < 22 and "CPU s" not in figures
    assert 0 < figures["robot minutes"] < 60 and 3 < figures["PSNR, dB"] < 40 and figures["forecast, dB"] > 3
    painting = images.load(small / "runs" / run.key / "painting.png")
    row = round(painting.shape[1] * (1 - 20 / 60))
    blue = painting[:, row, painting.shape[2] // 2]
    assert blue[2] > blue[0] + 0.1, "the blue stroke lies 20 mm above the lower edge"
    known = weights.find
    monkeypatch.setattr(tables.weights, "find", lambda name: None if known(name) else small)
    (judged,) = peer(small).all_runs
    assert judged.key != run.key, "it is judged anew if a network comes later"


@pytest.fixture
def painted(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    """A painting is made up; the labels of what was painted."""
    found: list[dict[str, Any]] = []

    def measure(self: BenchmarkTable, run: Any, notify: Any) -> Measurement:
        found.append(dict(run.labels))
        remarks = ["Cut <b>."] if run["entrant"] == "peer" else []
        return Measurement({"PSNR, dB": 20.0 + int(run["seed"])}, {"painting": torch.ones(3, 18, 24)}, remarks)

    monkeypatch.setattr(BenchmarkTable, "measure", measure)
    return found


def request(folder: Path, **changes: Any) -> BenchmarkTable:
    asked = BenchmarkTable(
        folder=folder, entrants=("ours", "plain"), goals=("cat", "flower"), budgets=(100,), seeds=(11, 12)
    )
    return replace(asked, **changes)


def test_a_table_goes_on_where_it_stopped_and_has_a_page(tmp_path: Path, painted: list[Any]) -> None:
    request(tmp_path, seeds=(11,)).run(tmp_path)
    assert len(painted) == 4
    more = request(tmp_path)
    more.write_request()
    outcome = more.run(tmp_path)
    assert len(painted) == 8 and outcome.notes[0] == "8 of 8 cells."
    assert outcome.tables[0].rows[0]["entrant"] == "ours" and set(outcome.pictures) == {"cat-100", "flower-100"}
    known = read_table(tmp_path)
    again = known.report(known.collect_results(tmp_path))
    assert again.tables == outcome.tables and len(painted) == 8
    html = write_page(again, tmp_path).read_text()
    assert "8 of 8 cells" in html and "plain" in html and "<script" not in html


def test_hand_ins_are_found_by_name_and_painted_again_if_they_change(tmp_path: Path, painted: list[Any]) -> None:
    folder = tmp_path / "strokes"
    folder.mkdir()
    for name in ("cat-100.svg", "flower-100-12.csv", "other.svg"):
        (folder / name).write_text("a")
    assert find_hand_in(folder, "flower", 100, 11) is None
    assert find_hand_in(folder, "flower", 100, 12) == folder / "flower-100-12.csv"
    asked = request(tmp_path / "t", entrants=(), hand_ins={"peer": str(folder)})
    assert [(run["goal"], run["seed"]) for run in asked.runs()] == [("cat", "11"), ("cat", "12"), ("flower", "12")]
    outcome = asked.run(tmp_path / "t")
    assert len(painted) == 3 and "cat, 100, 11: Cut <b>." in outcome.notes[1]
    assert "&lt;b&gt;" in write_page(outcome, tmp_path).read_text()
    (folder / "cat-100.svg").write_text("b")
    replace(asked).run(tmp_path / "t")
    assert len(painted) == 3 + 2


@pytest.mark.parametrize(
    ("asked", "told"),
    [
        ({"entrants": ("theirs",)}, "'theirs' is no entrant"),
        ({"budgets": (200,)}, "budgets are 100"),
        ({"seeds": (-1,)}, "seed -1"),
        ({"entrants": ()}, "0 cells"),
        ({"hand_ins": {"ours": "/nowhere"}}, "another name"),
        ({"hand_ins": {"peer": "/nowhere.csv"}}, "does not exist; give the path of a hand-in"),
        ({"goals": ("cat", "unicorn")}, "'unicorn'"),
    ],
)
def test_wrong_tables_are_refused_before_anything_is_painted(tmp_path: Path, painted: Any, asked: Any, told: str):
    with pytest.raises(ConfigError, match=told):
        request(tmp_path, **asked).run(tmp_path)
    assert painted == []


@pytest.mark.parametrize("rival", ["plain", "greedy", "hertzmann"])
def test_rivals_paint_photographs_alone(tmp_path: Path, rival: str) -> None:
    brushes = {run.spec.brushes for run in request(tmp_path, entrants=(rival,)).runs()}
    assert brushes == {"broad,medium,fine" if rival == "greedy" else "medium"}
    with pytest.raises(ConfigError, match=f"{rival} paints photographs alone"):
        request(tmp_path, entrants=(rival,), goals=("rocket-and-dusk",)).run()


def test_edited_tables_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError):
        read_table(tmp_path)
    request(tmp_path).write_request()
    kept = json.loads((tmp_path / "benchmark.json").read_text())
    for edit in ({"format": "sweep"}, {"suite": "0" * 64}, {"request": {"goals": 3}}, {"request": None}):
        (tmp_path / "benchmark.json").write_text(json.dumps({**kept, **edit}))
        with pytest.raises(ConfigError):
            read_table(tmp_path)


def results(*cells: tuple[str, str, int, dict[str, float]]) -> Results:
    return Results(
        [({"entrant": who, "goal": goal, "strokes": 100, "seed": seed}, Measurement(n)) for who, goal, seed, n in cells]
    )


def test_intervals_are_over_the_seeds() -> None:
    values = np.random.default_rng(0).normal(20, 1, (3, 4))  # seeds, pictures
    cells = [("ours", str(p), s, {"PSNR, dB": values[s, p]}) for s in range(3) for p in range(4)]
    (row,) = summary_rows(results(*cells))
    low, high = stats.t.interval(0.95, 2, values.mean(), stats.sem(values.mean(1)))
    mean, half = map(float, str(row["PSNR, dB"]).split(" ± "))
    assert mean == pytest.approx(values.mean(), abs=0.01) and half == pytest.approx((high - low) / 2, rel=0.06)
    (alone,) = summary_rows(results(*cells[:4]))
    assert "±" not in str(alone["PSNR, dB"])


def test_the_best_entrant_comes_first_and_differences_have_their_sign() -> None:
    ours = np.random.default_rng(1).normal(24, 1, 8)
    cells = [("worse", str(p), 11, {"PSNR, dB": ours[p] - 2 + 0.01 * p, "SSIM": 0.5}) for p in range(8)]
    cells += [("ours", str(p), 11, {"PSNR, dB": ours[p], "SSIM": 0.5 + 0.01 * p}) for p in range(8)]
    assert [row["entrant"] for row in summary_rows(results(*cells))] == ["ours", "worse"]
    for shuffled in (cells, cells[::-1]):
        rows = comparison_rows(results(*shuffled))
        row = next(one for one in rows if one["measure"] == "PSNR, dB")
        assert row["entrant"] == "worse" and row["minus ours"] == pytest.approx(-1.965)
        assert row["95 % from"] < row["minus ours"] < row["to"] < 0 and row["better in"] == "0 of 8"
        assert all(math.isfinite(one["p, t-test"]) for one in rows)


def say(monkeypatch: pytest.MonkeyPatch, capsys: Any, *words: object) -> tuple[int, str, str]:
    monkeypatch.setattr("sys.argv", ["frida-painter", "benchmark", *map(str, words)])
    with pytest.raises(SystemExit) as end:
        commands.main()
    told = capsys.readouterr()
    return int(end.value.code or 0), told.out, told.err


def test_the_commands_list_paint_and_write_pictures(small: Path, painted: Any, monkeypatch, capsys) -> None:
    status, out, _ = say(monkeypatch, capsys, "list")
    assert status == 0 and all(name in out for name in (*ENTRANTS, "astronaut", "boat-in-dusk", "1000 strokes"))
    status, out, _ = say(monkeypatch, capsys, "pictures", small / "p", "--pictures", "cat", "--held-out", "7")
    assert status == 0 and [path.name for path in (small / "p").glob("*.png")] == ["cat-7.png"] and "mm" in out
    words = ("judge", small / "strokes.csv", "--picture", "cat", "--out", small / "b")
    status, out, _ = say(monkeypatch, capsys, *words)
    assert status == 0 and "PSNR, dB             31" in out and "Cut" not in out
    words = ("--pictures", "cat", "--entrants", "ours,plain", "--strokes", "100", "--seeds", "11", "--jobs", "1")
    status, out, _ = say(monkeypatch, capsys, "table", *words, "--out", small / "t")
    assert status == 0 and "| ours | 100 | 1 | 31 |" in out and (small / "t" / "table.md").exists()
    status, out, _ = say(monkeypatch, capsys, "page", small / "t")
    assert status == 0 and "Page" in out and (small / "t" / "cat-100.png").exists()


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("judge", "strokes.csv", "--picture", "unicorn"), "'unicorn' is neither"),
        (("judge", "no.svg", "--picture", "cat"), "no.svg"),
        (("judge", "strokes.csv", "--picture", "cat", "--strokes", "200"), "budgets are 100, 300, 1000"),
        (("cell", "--entrant", "theirs", "--picture", "cat"), "is no entrant"),
        (("cell", "--entrant", "ours", "--picture", "cat", "--seed", "-1"), "seed"),
        (("table", "--pictures", "cat,cat"), "twice"),
        (("table", "--hand-in", "primitive"), "NAME=FOLDER"),
        (("table", "--hand-in", "primitive=missing", "--pictures", "cat"), "no folder of hand-ins"),
        (("page", "missing"), "missing"),
    ],
)
def test_wrong_commands_are_told_in_a_sentence(small: Path, monkeypatch, capsys, words: Any, told: str) -> None:
    monkeypatch.chdir(small)
    status, _, err = say(monkeypatch, capsys, *words)
    assert status == 2 and told in " ".join(err.split()) and "Traceback" not in err
