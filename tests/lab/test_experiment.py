"""The carrier: runs are done once, what fails is told, the rest is kept; and what is written is what was found."""

import json
import math
from dataclasses import dataclass, field
from pathlib import Path

import pytest
import torch
from PIL import Image

from frida_painter.errors import ConfigError, TryFailed, WorkerUnfit
from frida_painter_lab import experiment as carrier
from frida_painter_lab import runs as running
from frida_painter_lab.engine import Share
from frida_painter_lab.experiment import (
    Experiment,
    Measurement,
    Outcome,
    Progress,
    Results,
    ResultTable,
    measure_share,
    reopen,
    silent,
    within,
)
from frida_painter_lab.runs import Run, RunFolder
from frida_painter_lab.simulation_gap import Replanning, Sim2Real
from frida_painter_lab.stroke_models import StrokesNeeded
from frida_painter_lab.targets import load_shipped_targets
from marks import small_library
from sweep_engine import Here

PICTURE = torch.rand(3, 20, 20, generator=torch.Generator().manual_seed(0))
WAYS = ("by pixels", "by meaning")


@dataclass(frozen=True, kw_only=True)
class Counting(Experiment):
    """Counts how often it measures; a number of a run is its seed."""

    NAME = "counting"
    TITLE = "How often?"

    seeds: tuple[int, ...] = (0, 1)
    rows: int = 64
    bad: int = -1
    asked: list[int] = field(default_factory=list)

    def runs(self):
        return [
            Run({"target": "cat", "seed": seed, "way": way}, {"rows": self.rows}) for seed in self.seeds for way in WAYS
        ]

    def measure(self, run, notify):
        self.asked.append(int(run["seed"]))
        if len(self.asked) == self.bad:
            raise TryFailed("It exploded.")
        return Measurement({"gap": 0.1 + 0.2, "seed's": float(run["seed"])}, {"painted": PICTURE}, ["Well."])


def test_what_was_measured_is_not_measured_again(tmp_path: Path) -> None:
    first, again = Counting(), Counting()
    first.run(tmp_path)
    assert first.run(tmp_path).tables == again.run(tmp_path).tables and again.asked == []
    for labels, found in again.collect_results(tmp_path).found:
        assert found.numbers == {"gap": 0.1 + 0.2, "seed's": float(labels["seed"])} and found.remarks == ["Well."]
        assert float((found.pictures["painted"] - PICTURE).abs().max()) <= 0.5 / 255 + 1e-6
    without = Counting()
    without.run()
    without.run()
    assert len(without.asked) == 8, "without a folder nothing is kept"


def test_an_interrupted_experiment_goes_on_where_it_stopped(tmp_path: Path) -> None:
    with pytest.raises(TryFailed):
        Counting(bad=3).run(tmp_path)
    rest = Counting()
    assert rest.run(tmp_path) and rest.asked == [1, 1]


def test_other_labels_other_values_and_another_program_are_measured(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    some = [Counting(seeds=(0,)), Counting(seeds=(2,)), Counting(seeds=(0,), rows=65)]
    for one in some:
        one.run(tmp_path)
    monkeypatch.setattr(running, "_identify_program", lambda: "plug-in calm 2")
    some.append(Counting(seeds=(0,)))
    some[-1].run(tmp_path)
    assert [len(one.asked) for one in some] == [2, 2, 2, 2]


@pytest.mark.parametrize("damage", ["result.json", "painted.png"])
def test_a_damaged_measurement_is_made_again(tmp_path: Path, damage: str) -> None:
    made = Counting(seeds=(0,))
    made.run(tmp_path)
    file = RunFolder(tmp_path, made.all_runs[0].key).path / damage
    file.write_text(file.read_text()[:-20]) if damage == "result.json" else file.unlink()
    made.run(tmp_path)
    assert len(made.asked) == 3


def test_only_runs_that_are_not_done_are_shared_out(tmp_path: Path) -> None:
    made = Counting()
    made.measure_or_load(made.all_runs[0], tmp_path, silent)
    assert [share.runs for share in made.shares(tmp_path)] == [(run,) for run in made.all_runs[1:]]


def test_in_processes_failures_stop_no_other_and_are_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(carrier, "Engine", lambda limits, slots: Here())
    monkeypatch.setattr(carrier, "slots_here", lambda limits, most=None: 2)
    heard: list[Progress] = []
    first = Counting(bad=2)
    with pytest.raises(TryFailed, match=r"^1 parts of the experiment failed, the first is cat, seed 0, by meaning: It"):
        first.run_in_processes(tmp_path, heard.append)
    assert first.asked == [0, 0, 1, 1] and [one.share for one in heard] == [0, 0.25, 0.5, 0.75, 1]
    rest = Counting()
    outcome = rest.run_in_processes(tmp_path, silent)
    assert rest.asked == [0], "with one left it is measured here, and the others are read"
    assert [row["seed's"] for row in outcome.tables[0].rows] == [0, 0, 1, 1]
    share = Share((Counting().all_runs[0],), str(tmp_path), Counting())
    measure_share(share)
    assert share.experiment.asked == [], "what is done is only read"


@pytest.mark.parametrize("module", ["__main__", "beside_the_script"])
def test_a_class_that_other_processes_cannot_import_is_refused_and_told_where_to_put(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, module: str
) -> None:
    monkeypatch.setattr(carrier, "Engine", lambda limits, slots: Here())
    monkeypatch.setattr(carrier, "slots_here", lambda limits, most=None: 2)
    own = type("Own", (Counting,), {"__module__": module})()
    with pytest.raises(ConfigError if module == "__main__" else WorkerUnfit, match=f"'Own' from '{module}'; put"):
        own.run_in_processes(tmp_path, silent)
        reopen(str(tmp_path), [])  # as another process does
    assert own.run(tmp_path).tables


@pytest.mark.parametrize(
    "asked",
    [
        StrokesNeeded(quick=True, library=small_library(20), title="drawn", seeds=(3,)),
        Sim2Real(photos=load_shipped_targets(("cat", "coffee")), seeds=(1, 2), brush="fine"),
        Replanning(photos=load_shipped_targets(("cat",)), seeds=(1,)),
    ],
)
def test_another_process_finds_the_same_runs(asked: Experiment, tmp_path: Path) -> None:
    asked.keep_request(tmp_path)
    keys = [run.key for run in asked.all_runs]
    share = reopen(str(tmp_path), keys[1:])
    assert type(share.experiment) is type(asked) and share.keys == keys[1:] and share.keep == str(tmp_path)
    with pytest.raises(WorkerUnfit, match="has changed"):
        reopen(str(tmp_path), ["0" * 20])


def test_results_are_found_by_their_labels() -> None:
    made = Counting(seeds=(3, 5))
    results = Results([(run.labels, made.measure(run, silent)) for run in made.runs()])
    assert results.values("seed's", way="by meaning") == [3.0, 5.0] and results.mean("seed's", way="by pixels") == 4.0
    assert results.one(seed=5, way="by pixels").numbers["seed's"] == 5.0
    with pytest.raises(ValueError, match="too many"):
        results.one(seed=5)
    assert results.means("way")[0] == {"way": "by pixels", "gap": 0.1 + 0.2, "seed's": 4.0}


ROWS = (
    {"model": "a | b", "error": 0.123456, "n": 3, "better": True},
    {"model": "c", "error": math.nan, "n": None, "better": False},
)


def test_what_is_written_is_what_was_found(tmp_path: Path) -> None:
    table = ResultTable("Errors", ROWS, ["Below."])
    pictures = {"a-picture": torch.rand(3, 20, 30)}
    outcome = Outcome("trial", "A trial", {"seeds": (0, 1), "brush": "fine"}, (table,), ("It works.",), pictures)
    outcome.save(tmp_path)
    record = json.loads((tmp_path / "table.json").read_text())
    assert record["experiment"] == "trial" and record["settings"] == {"seeds": [0, 1], "brush": "fine"}
    first, second = record["tables"][0]["rows"]
    assert first == ROWS[0] and second["error"] is None and second["better"] is False
    with Image.open(tmp_path / record["pictures"][0]) as picture:
        assert picture.size == (30, 20)
    lines = (tmp_path / "table.md").read_text().splitlines()
    assert {"| model | error | n | better |", "| --- | ---: | ---: | --- |", "| c | - | - | no |"} <= set(lines)
    assert {r"| a \| b | 0.1235 | 3 | yes |", "It works.", "![a picture](a-picture.png)", "Below."} <= set(lines)


def test_a_part_tells_its_progress_as_part_of_the_whole() -> None:
    heard: list[Progress] = []
    for share in (0.0, 0.5, 1.0):
        within(heard.append, 0.2, 0.6)(Progress(share, "counting"))
    assert [one.share for one in heard] == pytest.approx([0.2, 0.4, 0.6])
