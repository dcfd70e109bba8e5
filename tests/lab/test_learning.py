"""stroke-model, strokes-needed and real-strokes: what is compared, on what, and what is said of it."""

import numpy as np
import pytest
import torch

from frida_painter.errors import LibraryError
from frida_painter.lab import ExperimentScale, real_strokes, stroke_models, strokes_needed
from frida_painter.lab.stroke_models import BEZIER, LEARNED, RIVALS
from marks import small_library as library

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def strokes():
    return library(30)


def outcome_of(module, strokes, keep=None):
    if module is stroke_models:
        return module.run(strokes, "drawn", scale=module.QUICK)
    return module.experiment(strokes, "drawn", scale=module.QUICK).run(keep)


@pytest.mark.slow
def test_models_are_compared_on_strokes_held_out_stroke_by_stroke(strokes):
    outcome = stroke_models.run(strokes, "drawn", seed=1, scale=stroke_models.QUICK)
    means, tests = (table.rows for table in outcome.tables)
    assert [row["model"] for row in means] == [*LEARNED, BEZIER]
    assert outcome.settings["held out"] == stroke_models.QUICK.held_out
    by_model = {row["model"]: row["mean L1"] for row in means}
    for row in tests:
        assert row["mean difference"] == pytest.approx(by_model[row["model"]] - by_model[BEZIER])
        assert 0 <= row["p, paired t-test"] <= 1 and 0 < row["p, Wilcoxon"] <= 1
    assert len(outcome.notes) == len(LEARNED) and "p = " in outcome.notes[0]
    assert "stroke-model" in outcome.pictures


@pytest.mark.slow
def test_no_model_learns_from_the_strokes_that_test_it(strokes, monkeypatch):
    learned, tested = [], []

    def learn(rival, part, **rest):
        learned.append(set(part.recorded_index.tolist()))
        return lambda other: tested.append(set(other.recorded_index.tolist())) or _bare(other)

    for module in (stroke_models, strokes_needed, real_strokes):
        monkeypatch.setattr(module, "learn", learn)
        learned.clear()
        tested.clear()
        outcome_of(module, strokes)
        assert learned and len(tested) >= len(learned)
        if module is real_strokes:  # every split has its own strokes for the test
            assert all(not part & other for part, other in zip(learned, tested, strict=True))
        else:
            assert all(not part & set.union(*tested) for part in learned)


def _bare(other):
    return torch.zeros(other.magnitude.shape)


def test_the_numbers_of_strokes_needed_are_those_asked_for(strokes, monkeypatch):
    sizes = []

    def learn(rival, part, **rest):
        sizes.append((rival, len(part)))
        return _bare

    monkeypatch.setattr(strokes_needed, "learn", learn)
    scale = ExperimentScale(strokes=16, sizes=(6, 12, 500), folds=3, held_out=10, quick=True)
    outcome = strokes_needed.experiment(strokes, "drawn", scale=scale).run()
    assert sizes == [(model, size) for model in (*LEARNED, BEZIER) for size in (6, 12) for _ in range(3)]
    assert outcome.settings["sizes"] == (6, 12)
    for row in outcome.tables[0].rows:
        assert row["log error"] == pytest.approx(np.log(row["error"]))
        assert row["log error, standard deviation"] == 0  # the same test strokes, the same empty answer


@pytest.mark.slow
def test_trainings_that_are_done_are_not_done_again(strokes, tmp_path, monkeypatch):
    first = outcome_of(strokes_needed, strokes, tmp_path)
    monkeypatch.setattr(strokes_needed, "learn", None)
    assert outcome_of(strokes_needed, strokes, tmp_path).tables == first.tables
    with pytest.raises(TypeError):
        outcome_of(strokes_needed, strokes[:29], tmp_path)


@pytest.mark.slow
def test_every_rival_is_in_the_table_of_all_splits(strokes):
    outcome = real_strokes.experiment(strokes, "drawn", seeds=(0, 1), scale=real_strokes.QUICK).run()
    whole, varies, fewer = (table.rows for table in outcome.tables)
    assert [row["split"] for row in varies] == [0, 1]
    assert all(np.isfinite([row["mean and variance"], row["one variance"]]).all() for row in varies)
    assert [row["model"] for row in whole] == list(RIVALS)
    assert {row["strokes"] for row in whole} == {26} and {row["strokes"] for row in fewer} == {6}
    for row in (*whole, *fewer):
        assert 0 < row["least"] <= row["error"] <= row["most"] < 1
    assert min(whole, key=lambda row: row["error"])["model"] in outcome.notes[0]


@pytest.mark.parametrize("module", [stroke_models, strokes_needed, real_strokes])
def test_too_small_a_library_is_refused_in_a_sentence(strokes, module):
    with pytest.raises(LibraryError, match="has 7 strokes"):
        outcome_of(module, strokes[:7])
