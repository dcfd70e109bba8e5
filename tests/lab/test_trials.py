import pytest
import torch

from frida_painter.lab.trials import Experiment, ExperimentTrial, Measurement, Outcome, Results, ResultTable

PICTURE = torch.rand(3, 20, 20, generator=torch.Generator().manual_seed(0))


class Measuring:
    """Counts how often it is asked; the number of a trial is its seed."""

    def __init__(self) -> None:
        self.times = 0

    def __call__(self, trial, notify) -> Measurement:
        self.times += 1
        return Measurement({"gap": 0.1 + 0.2, "seed's": float(trial["seed"])}, {"painted": PICTURE})


def trials(rows: int = 64, seeds=(0, 1)) -> list[ExperimentTrial]:
    ways = ("by pixels", "by meaning")
    return [
        ExperimentTrial({"target": "cat", "seed": seed, "way": way}, {"rows": rows}) for seed in seeds for way in ways
    ]


def ran(measure, some: list[ExperimentTrial], keep=None) -> Results:
    found = []

    def report(results: Results) -> Outcome:
        found.append(results)
        return Outcome("trial", "A trial", {}, (ResultTable("All", results.rows()),))

    Experiment(some, measure, report).run(keep)
    return found[0]


def test_what_was_measured_is_not_measured_again(tmp_path):
    measure = Measuring()
    ran(measure, trials(), tmp_path)
    again = ran(measure, trials(), tmp_path)
    assert measure.times == 4
    for (_, found), trial in zip(again.found, trials(), strict=True):
        assert found.numbers == {"gap": 0.1 + 0.2, "seed's": float(trial["seed"])}
        assert float((found.pictures["painted"] - PICTURE).abs().max()) <= 0.5 / 255 + 1e-6


def test_an_interrupted_experiment_goes_on_where_it_stopped(tmp_path):
    measure = Measuring()

    def interrupted(trial, notify):
        if measure.times == 3:
            raise KeyboardInterrupt
        return measure(trial, notify)

    with pytest.raises(KeyboardInterrupt):
        ran(interrupted, trials(), tmp_path)
    ran(measure, trials(), tmp_path)
    assert measure.times == 4


def test_other_labels_and_other_values_are_measured(tmp_path):
    measure = Measuring()
    for some in (trials(seeds=(0,)), trials(seeds=(2,)), trials(rows=65, seeds=(0,))):
        ran(measure, some, tmp_path)
    assert measure.times == 6


@pytest.mark.parametrize("damage", ["numbers", "picture"])
def test_a_damaged_measurement_is_made_again(tmp_path, damage):
    measure = Measuring()
    (trial, *_) = trials()
    ran(measure, [trial], tmp_path)
    if damage == "numbers":
        path = tmp_path / f"{trial.name}.json"
        path.write_text(path.read_text()[:-20])
    else:
        (tmp_path / f"{trial.name}-painted.png").write_bytes(b"")
    ran(measure, [trial], tmp_path)
    assert measure.times == 2


def test_without_a_folder_nothing_is_kept():
    measure = Measuring()
    for _ in range(2):
        ran(measure, trials())
    assert measure.times == 8


def test_results_are_found_by_their_labels():
    results = ran(Measuring(), trials(seeds=(3, 5)))
    assert results.values("seed's", way="by meaning") == [3.0, 5.0]
    assert results.mean("seed's", way="by pixels") == 4.0
    assert results.one(seed=5, way="by pixels").numbers["seed's"] == 5.0
    with pytest.raises(ValueError, match="too many"):
        results.one(seed=5)
    assert [row["seed"] for row in results.rows()] == [3, 3, 5, 5]
    assert results.means("way") == (
        {"way": "by pixels", "gap": 0.1 + 0.2, "seed's": 4.0},
        {"way": "by meaning", "gap": 0.1 + 0.2, "seed's": 4.0},
    )


def test_labels_make_the_name_of_a_file():
    assert ExperimentTrial({"prompt": "../a lemon?", "seed": 0}).name == "a-lemon-0"


def test_trials_that_share_work_are_measured_together(tmp_path):
    experiment = Experiment(trials(), Measuring(), lambda results: None, sharing="way")
    assert experiment.shares(tmp_path) == [(0, 1), (2, 3)]
    experiment.measure_or_load(experiment.trials[0], tmp_path, lambda progress: None)
    assert experiment.shares(tmp_path) == [(1,), (2, 3)]
    assert Experiment(trials(), Measuring(), lambda results: None).shares(tmp_path) == [(1,), (2,), (3,)]
