"""Stroke models learned from libraries by name, and their errors on strokes that they have not seen."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from frida_painter.brush import DEFAULT_MODEL, MODELS
from frida_painter.brush.field import StrokeField
from frida_painter.brush.library import Flaw
from frida_painter.errors import ConfigError, LibraryError
from frida_painter.strokes.strokes import StrokeLimits
from frida_painter_calibration.teaching.bezier import BezierStroke, RibbonShape
from frida_painter_calibration.teaching.evaluation import (
    OTHER_BRUSH,
    evaluate,
    geometry,
    learn,
)
from frida_painter_calibration.teaching.param2stroke import Param2Stroke
from frida_painter_calibration.teaching.training import make_fresh, train_field
from marks import SMALL, ribbon, small_frame, small_library


def small_field(seed: int = 0) -> StrokeField:
    return make_fresh(StrokeField, "small", small_frame(), SMALL.limits, seed)


def test_training_learns_the_library_and_strokes_that_it_has_not_seen():
    library, unseen, model, progress = small_library(40), small_library(20, seed=9), small_field(), []
    report = train_field(model, library, epochs=30, notify=progress.append)
    assert tuple(progress) == report.curve and len(report.held_out) == 8
    wanted = unseen.maps(model.frame)
    with torch.no_grad():
        error = float((model(*unseen.shapes()) - wanted).abs().mean())
    assert error < 0.15 * float(wanted.mean())
    held_out = library[report.held_out].maps(model.frame)
    assert report.validation_error == min(step.validation_error for step in report.curve)
    assert report.validation_error == pytest.approx(float((report.predicted - held_out).abs().mean()), rel=1e-3)


def test_it_stops_when_it_learns_no_more():
    report = train_field(small_field(), small_library(8), epochs=40, patience=3)
    assert len(report.curve) == min(40, report.best_epoch + 3)


def test_the_same_seed_gives_the_same_weights():
    models = [small_field() for _ in range(3)]
    for model, seed in zip(models, (1, 1, 2), strict=True):
        train_field(model, small_library(6), seed=seed, epochs=2)
    one, same, other = (model.state_dict() for model in models)
    assert all(torch.equal(tensor, same[name]) for name, tensor in one.items())
    assert not torch.equal(one["layers.0.weight"], other["layers.0.weight"])


def test_the_reach_holds_the_marks_and_leaves_out_a_drop_far_away():
    library, model = small_library(40), small_field()
    library.magnitude[3, :6, -6:] = 255
    train_field(model, library, epochs=1)
    assert 0.003 < float(model.reach) < 0.006


def test_a_brush_of_the_project_is_learned_on_its_own_frame_by_the_model_that_is_named():
    before = torch.get_rng_state()
    learned = {name: learn(name, small_library(6), SMALL, hasty=True).model for name in MODELS}
    assert torch.equal(before, torch.get_rng_state()), "the world is left alone"
    assert {name: type(model) for name, model in learned.items()} == {
        "field": StrokeField,
        "param2stroke": Param2Stroke,
    }
    for model in learned.values():
        assert (model.brush, model.frame, model.limits) == ("small", SMALL.frame, SMALL.limits)


def test_of_another_brush_the_library_says_what_it_can_do():
    library = small_library(20)
    learned = learn(DEFAULT_MODEL, library, hasty=True)
    frame, limits, whole = learned.model.frame, learned.model.limits, library.frame
    assert learned.model.brush == OTHER_BRUSH
    assert (frame.left, frame.right, frame.bottom, frame.top) == (whole.left, whole.right, whole.bottom, whole.top)
    assert frame.pitch[0] == pytest.approx(frame.pitch[1], rel=0.05)
    assert limits.length[0] < library.length_m.min() < library.length_m.max() < limits.length[1]
    assert limits.bend[0] < library.bend_m.min() < library.bend_m.max() < limits.bend[1]
    alike = replace(library, length_m=np.full(20, 1e-5, np.float32), bend_m=np.zeros(20, np.float32))
    _, limits = geometry(alike)
    assert 0 < limits.length[0] < limits.length[1] and limits.bend[0] < 0 < limits.bend[1]


def test_dirty_strokes_are_left_out():
    library, flaws = small_library(12), np.zeros(12, np.uint8)
    flaws[[2, 5]] = Flaw.TORN
    learned = learn(DEFAULT_MODEL, replace(library, flaws=flaws), SMALL, hasty=True)
    assert learned.library.recorded_index.tolist() == [i for i in range(12) if i not in (2, 5)]


def test_what_cannot_be_learned_is_refused():
    with pytest.raises(ConfigError, match="field and param2stroke"):
        learn("vgg", small_library(6))
    with pytest.raises(LibraryError, match="at least 5"):
        learn(DEFAULT_MODEL, small_library(4))
    with pytest.raises(LibraryError, match="start of the stroke"):
        learn(DEFAULT_MODEL, replace(small_library(6), origin_px=(-3.0, 5.0)))


def test_the_model_that_painted_the_library_is_off_by_rounding_only():
    found = evaluate(ribbon(72, 126), small_library(40))
    assert found.error.shape == (40,) and found.error.max() < 0.0011 and not found.outside.any()


def test_the_error_is_the_mean_over_the_whole_crop_as_stored():
    library, model = small_library(5), ribbon(72, 126)
    library.magnitude[2, :36] = 255
    library.magnitude[2, 36:] = 0
    found = evaluate(model, library)
    with torch.no_grad():
        drawn = model(*(part[2:3] for part in library.shapes()))[0]
    assert found.error[2] == pytest.approx(float(((1 - drawn[:36]).sum() + drawn[36:].sum()) / drawn.numel()), rel=1e-5)
    assert found.paint[2] == pytest.approx(0.5)
    narrow = BezierStroke("small", small_frame(), SMALL.limits, RibbonShape(1.0, 4.0, 1.5))
    narrow.frame = replace(narrow.frame, right=0.005)
    missed = evaluate(narrow, small_library(5)).error.mean()
    assert missed > evaluate(ribbon(), small_library(5)).error.mean(), "marks beyond the model's frame"


def test_strokes_outside_the_models_limits_are_told_and_many_are_refused():
    library, model = small_library(12), ribbon()
    model.limits = StrokeLimits((float(np.sort(library.length_m)[2]), 0.03), SMALL.limits.bend)
    found = evaluate(model, library)
    assert found.outside.tolist() == [length < model.limits.length[0] for length in library.length_m]
    assert found.outside.sum() == 2 and np.isfinite(found.error).all()
    model.limits = StrokeLimits(SMALL.limits.length, (-0.001, 0.001))
    with pytest.raises(LibraryError, match="of the brush that the model was trained for"):
        evaluate(model, library)
