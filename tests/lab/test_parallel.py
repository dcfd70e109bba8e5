"""The trials of an experiment on an engine: each measured once, what fails is told, the rest is kept."""

from functools import partial
from pathlib import Path

import pytest

from frida_painter.errors import TryFailed
from frida_painter.lab import conduct
from frida_painter.lab.conduct import run_in_processes
from frida_painter.lab.trials import (
    Experiment,
    ExperimentTrial,
    Measurement,
    Notify,
    Outcome,
    Progress,
    Results,
    ResultTable,
    silent,
)
from sweep_engine import Here


def experiment(bad: int, asked: list[int]) -> Experiment[ExperimentTrial]:
    def measure(trial: ExperimentTrial, notify: Notify) -> Measurement:
        seed = int(trial["seed"])
        asked.append(seed)
        if seed == bad:
            raise TryFailed("It exploded.")
        return Measurement({"gap": seed / 2})

    def report(results: Results) -> Outcome:
        return Outcome("trial", "A trial", {}, (ResultTable("All", results.rows()),))

    return Experiment([ExperimentTrial({"seed": seed}) for seed in range(4)], measure, report)


def test_every_trial_is_measured_once_and_failures_stop_no_other(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(conduct, "open_engine", lambda *limits, **where: Here())
    monkeypatch.setattr(conduct, "slots_here", lambda limits, most=None: 2)
    asked: list[int] = []
    heard: list[Progress] = []
    with pytest.raises(TryFailed, match=r"^1 parts of the experiment failed, the first is 1: It exploded\."):
        run_in_processes(partial(experiment, 1, asked), tmp_path, heard.append)
    assert asked == [0, 1, 2, 3] and [one.share for one in heard] == [0, 0.25, 0.5, 0.75, 1]
    outcome = run_in_processes(partial(experiment, -1, asked), tmp_path, silent)
    assert asked == [0, 1, 2, 3, 1], "with one left it is measured here, and the others are read"
    assert [row["gap"] for row in outcome.tables[0].rows] == [0, 0.5, 1, 1.5]
