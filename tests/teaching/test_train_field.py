import pytest
import torch

from frida_painter.brush.field import StrokeField
from frida_painter.errors import LibraryError
from frida_painter_calibration.teaching.training import train_field
from marks import SMALL, small_frame, small_library


def small_field(seed: int = 0) -> StrokeField:
    torch.manual_seed(seed)
    return StrokeField("small", small_frame(), SMALL.limits)


def test_training_learns_the_library_and_strokes_that_it_has_not_seen():
    library, unseen, model = small_library(40), small_library(20, seed=9), small_field()
    progress = []
    report = train_field(model, library, epochs=30, notify=progress.append)
    assert tuple(progress) == report.curve
    assert len(report.held_out) == 8
    assert report.predicted.shape == (8, 24, 42)
    nothing = float(unseen.maps(model.frame).mean())
    with torch.no_grad():
        error = float((model(*unseen.shapes()) - unseen.maps(model.frame)).abs().mean())
    assert error < 0.15 * nothing
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


def test_a_library_of_too_few_strokes_is_refused():
    with pytest.raises(LibraryError, match="at least 5"):
        train_field(small_field(), small_library(4))
