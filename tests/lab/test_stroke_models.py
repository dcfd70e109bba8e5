"""stroke-model and strokes-needed: what is compared, on what, and what is said of it."""

import numpy as np
import pytest
import torch

from frida_painter.errors import LibraryError
from frida_painter_lab import stroke_models
from frida_painter_lab.stroke_models import (
    BEZIER,
    LEARNED,
    MEAN,
    RIVALS,
    ZEROS,
    StrokeModels,
    StrokesNeeded,
    errors,
    fingerprint,
    learn,
)
from marks import small_library

KINDS = (StrokeModels, StrokesNeeded)


@pytest.fixture(scope="module")
def strokes():
    return small_library(30)


@pytest.fixture
def learned(monkeypatch):
    """Learns nothing, and tells from which strokes and on which ones: the model, the sizes and the two sets."""
    told = []

    def learn(rival, part, **rest):
        def predict(other):
            told.append((rival, len(part), set(part.recorded_index.tolist()), set(other.recorded_index.tolist())))
            share = 0.1 + 0.02 * RIVALS.index(rival) + 0.01 * torch.arange(len(other))[:, None, None]
            return share.expand(other.magnitude.shape)

        return predict

    monkeypatch.setattr(stroke_models, "learn", learn)
    monkeypatch.setattr(stroke_models, "LEARNED", (*LEARNED,))
    monkeypatch.setattr(stroke_models, "learn_model", lambda rival, part, **rest: (rival, part))
    monkeypatch.setattr(stroke_models, "predict_with", lambda model: learn(*model))
    likely = type("Likelihood", (), {"predicted": 2.0, "constant": 1.0})
    monkeypatch.setattr(stroke_models.training, "likelihood", lambda model, test: likely)
    return told


def made(kind, strokes, **rest):
    return kind(quick=True, library=strokes, title="drawn", **rest).prepare(lambda progress: None)


@pytest.mark.parametrize("kind", KINDS)
def test_no_model_learns_from_the_strokes_that_test_it(kind, strokes, learned):
    outcome = made(kind, strokes).run()
    assert learned and all(not known & test for _, _, known, test in learned)
    assert {rival for rival, *_ in learned} >= {*LEARNED, BEZIER}
    assert outcome.title.endswith(": drawn") and outcome.settings["library"] == "drawn"
    assert set(outcome.pictures) == {kind.NAME}


def test_models_are_compared_stroke_by_stroke(strokes, learned):
    rows = made(StrokeModels, strokes, seed=1).run().tables[0].rows
    assert [row["model"] for row in rows] == [*LEARNED, BEZIER]
    for row in rows[:-1]:
        assert row["best stroke"] <= row["mean L1"] <= row["worst stroke"]
        assert 0 <= row["p, paired t-test"] <= 1 and 0 < row["p, Wilcoxon"] <= 1
    assert rows[-1]["p, Wilcoxon"] is None


def test_the_numbers_of_strokes_are_those_that_the_library_has(strokes):
    cases = StrokesNeeded(library=small_library(70), title="drawn").cases()
    assert cases == [*((rival, 28) for rival in RIVALS), *((one, n) for one in (*LEARNED, BEZIER) for n in (6, 10, 25))]


def test_every_rival_is_in_the_table_of_all_splits(strokes, learned, tmp_path):
    first = made(StrokesNeeded, strokes, seeds=(0, 1)).run(tmp_path)
    whole, varies, fewer = (table.rows for table in first.tables)
    assert [row["model"] for row in whole] == list(RIVALS) and [row["split"] for row in varies] == [0, 1]
    assert {row["strokes"] for row in whole} == {26} and {row["strokes"] for row in fewer} == {6}
    learned.clear()
    assert made(StrokesNeeded, strokes, seeds=(0, 1)).run(tmp_path).tables == first.tables and learned == []
    made(StrokesNeeded, strokes[:29], seeds=(0, 1)).run(tmp_path)
    assert learned, "of another library everything is learned"


@pytest.mark.parametrize("kind", KINDS)
def test_too_small_a_library_is_refused(strokes, kind):
    with pytest.raises(LibraryError, match="has 7 strokes"):
        made(kind, strokes[:7])


@pytest.mark.parametrize("rival", RIVALS)
def test_every_rival_predicts_the_crops_as_they_are_stored(strokes, rival):
    known, test = strokes[:16], strokes[16:]
    marks = learn(rival, known, seed=0, quick=True)(test)
    assert marks.shape == test.magnitude.shape and float(marks.min()) >= 0 and float(marks.max()) <= 1
    wanted = {
        ZEROS: test.magnitude.mean((1, 2)) / 255,
        MEAN: np.abs(test.magnitude - known.magnitude.mean(0)).mean((1, 2)) / 255,
    }
    if rival in wanted:
        np.testing.assert_allclose(errors(marks, test), wanted[rival], rtol=1e-5)
    if rival == BEZIER:
        assert errors(marks, test).mean() < 0.4 * wanted[ZEROS].mean()


def test_another_pixel_is_another_library(strokes):
    changed = small_library(30)
    assert fingerprint(changed) == fingerprint(strokes)
    changed.magnitude[3, 5, 7] ^= 1
    assert fingerprint(changed) != fingerprint(strokes)
