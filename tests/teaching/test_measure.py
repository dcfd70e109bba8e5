from dataclasses import replace

import numpy as np
import pytest
import torch

from frida_painter.brush import DEFAULT_MODEL
from frida_painter.errors import LibraryError
from frida_painter.strokes import StrokeLimits
from frida_painter_calibration.teaching import evaluation
from frida_painter_calibration.teaching.bezier import BezierStroke, RibbonShape
from frida_painter_calibration.teaching.evaluation import cross_validate, errors, evaluate, learn
from marks import SMALL, ribbon, small_frame, small_library


def test_the_model_that_painted_the_library_is_off_by_rounding_only():
    found = evaluate(ribbon(72, 126), small_library(40))
    assert found.error.shape == (40,)
    assert found.error.max() < 0.0011
    assert not found.outside.any()


def test_the_error_is_the_mean_over_the_whole_crop_as_stored():
    library, model = small_library(5), ribbon(72, 126)
    library.magnitude[2, :36] = 255
    library.magnitude[2, 36:] = 0
    found = evaluate(model, library)
    with torch.no_grad():
        drawn = model(*(part[2:3] for part in library.shapes()))[0]
    assert found.error[2] == pytest.approx(float(((1 - drawn[:36]).sum() + drawn[36:].sum()) / drawn.numel()), rel=1e-5)
    assert found.paint[2] == pytest.approx(0.5)


def test_marks_beyond_the_models_frame_are_missed():
    narrow = BezierStroke("small", small_frame(24, 42).resize(24, 42), SMALL.limits, RibbonShape(1.0, 4.0, 1.5))
    narrow.frame = replace(narrow.frame, right=0.005)
    assert evaluate(narrow, small_library(5)).error.mean() > evaluate(ribbon(), small_library(5)).error.mean()


def test_strokes_outside_the_models_limits_are_told_and_many_are_refused():
    library, model = small_library(12), ribbon()
    model.limits = StrokeLimits((float(np.sort(library.length_m)[2]), 0.03), SMALL.limits.bend)
    found = evaluate(model, library)
    assert found.outside.tolist() == [length < model.limits.length[0] for length in library.length_m]
    assert found.outside.sum() == 2
    assert np.isfinite(found.error).all()
    model.limits = StrokeLimits(SMALL.limits.length, (-0.001, 0.001))
    with pytest.raises(LibraryError, match="of the brush that the model was trained for"):
        evaluate(model, library)


def test_every_fold_is_tested_by_a_model_that_has_not_seen_it(monkeypatch):
    library, seen, heard = small_library(13), [], []

    def learn_hastily(name, part, kind, *, seed, notify):
        seen.append(set(part.recorded_index.tolist()))
        return learn(name, part, kind, seed=seed, hasty=True, notify=notify)

    tested = []

    def errors_and_tell(model, part):
        tested.append(set(part.recorded_index.tolist()))
        return errors(model, part)

    monkeypatch.setattr(evaluation, "learn", learn_hastily)
    monkeypatch.setattr(evaluation, "errors", errors_and_tell)
    found = cross_validate(DEFAULT_MODEL, library, SMALL, folds=3, notify=lambda fold, _: heard.append(fold))
    assert found.shape == (3,)
    assert (found > 0).all()
    assert sorted(set(heard)) == [0, 1, 2]
    assert set.union(*tested) == set(range(13))
    assert [part & held for part, held in zip(seen, tested, strict=True)] == [set()] * 3


@pytest.mark.parametrize(("count", "folds"), [(9, 2), (4, 3), (6, 7)])
def test_too_many_folds_are_refused(count, folds):
    with pytest.raises(LibraryError, match=f"{folds} folds need at least"):
        cross_validate(DEFAULT_MODEL, small_library(count), folds=folds)
