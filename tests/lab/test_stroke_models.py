"""strokes-needed: what is compared, on what, and what is said of it."""

import numpy as np
import pytest

from frida_painter.errors import LibraryError
from frida_painter_lab import stroke_models
from frida_painter_lab.stroke_models import (
    BEZIER,
    LEARNED,
    MEAN,
    RIVALS,
    ZEROS,
    StrokesNeeded,
    find_errors,
    fingerprint,
)
from marks import small_library


@pytest.fixture(scope="module")
def strokes():
    return small_library(30)


@pytest.fixture
def learned(monkeypatch):
    """Learns nothing, and tells from which strokes and on which ones: the model, the sizes and the two sets."""
    told = []

    def find_errors(rival, part, other, **rest):
        told.append((rival, len(part), set(part.recorded_index.tolist()), set(other.recorded_index.tolist())))
        return 0.1 + 0.02 * RIVALS.index(rival) + 0.01 * np.arange(len(other)), rival

    monkeypatch.setattr(stroke_models, "find_errors", find_errors)
    likely = type("Likelihood", (), {"predicted": 2.0, "constant": 1.0})
    monkeypatch.setattr(stroke_models.training, "likelihood", lambda model, test: likely)
    return told


def made(strokes, **rest):
    return StrokesNeeded(quick=True, library=strokes, title="drawn", **rest).prepare(lambda progress: None)


def test_no_model_learns_from_the_strokes_that_test_it(strokes, learned):
    outcome = made(strokes).run()
    assert learned and all(not known & test for _, _, known, test in learned)
    assert {rival for rival, *_ in learned} >= {*LEARNED, BEZIER}
    assert outcome.title.endswith(": drawn") and outcome.settings["library"] == "drawn"
    assert set(outcome.pictures) == {"strokes-needed"}


def test_the_numbers_of_strokes_are_those_that_the_library_has(strokes):
    cases = StrokesNeeded(library=small_library(70), title="drawn").cases()
    assert cases == [*((rival, 28) for rival in RIVALS), *((one, n) for one in (*LEARNED, BEZIER) for n in (6, 10, 25))]


def test_every_rival_is_in_the_table_of_all_splits(strokes, learned, tmp_path):
    first = made(strokes, seeds=(0, 1)).run(tmp_path)
    whole, varies, fewer = (table.rows for table in first.tables)
    assert [row["model"] for row in whole] == list(RIVALS) and [row["split"] for row in varies] == [0, 1]
    assert {row["strokes"] for row in whole} == {26} and {row["strokes"] for row in fewer} == {6}
    learned.clear()
    assert made(strokes, seeds=(0, 1)).run(tmp_path).tables == first.tables and learned == []
    made(strokes[:29], seeds=(0, 1)).run(tmp_path)
    assert learned, "of another library everything is learned"


def test_too_small_a_library_is_refused(strokes):
    with pytest.raises(LibraryError, match="has 7 strokes"):
        made(strokes[:7])


@pytest.mark.parametrize("rival", RIVALS)
def test_every_rival_is_held_against_the_crops_as_they_are_stored(strokes, rival):
    known, test = strokes[:16], strokes[16:]
    error, model = find_errors(rival, known, test, seed=0, quick=True)
    bare = test.magnitude.mean((1, 2)) / 255
    wanted = {ZEROS: bare, MEAN: np.abs(test.magnitude - known.magnitude.mean(0)).mean((1, 2)) / 255}
    assert error.shape == (len(test),) and ((error >= 0) & (error <= 1)).all() and (model is None) == (rival in wanted)
    if rival in wanted:
        np.testing.assert_allclose(error, wanted[rival], rtol=1e-5)
    if rival == BEZIER:
        assert error.mean() < 0.4 * bare.mean()


def test_another_pixel_is_another_library(strokes):
    changed = small_library(30)
    assert fingerprint(changed) == fingerprint(strokes)
    changed.magnitude[3, 5, 7] ^= 1
    assert fingerprint(changed) != fingerprint(strokes)
