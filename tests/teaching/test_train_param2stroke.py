import pytest
import torch

from frida_painter.errors import LibraryError
from frida_painter_calibration.teaching.param2stroke import Param2Stroke, train_param2stroke
from marks import SMALL, small_frame, small_library


def test_training_learns_the_library_for_as_many_epochs_as_were_best():
    library = small_library(40)
    model = Param2Stroke("small", small_frame(12, 20), SMALL.limits)
    progress = []
    report = train_param2stroke(model, library, rehearsals=3, epochs=6, notify=progress.append)
    assert tuple(progress) == report.curve
    assert len(report.held_out) == 8
    nothing = float(library[report.held_out].maps(model.frame).abs().mean())
    assert report.validation_error < 0.2 * nothing
    assert report.validation_error == min(step.validation_error for step in report.curve)
    assert report.curve[report.best_epoch - 1].validation_error == report.validation_error
    held_out = library[report.held_out]
    with torch.no_grad():
        told = (report.predicted - held_out.maps(model.frame)).abs().mean()
        error = (model(*held_out.shapes()) - held_out.maps(model.frame)).abs().mean()
    assert float(told) == pytest.approx(report.validation_error, rel=1e-4), "before it saw them"
    assert float(error) < 1.1 * report.validation_error, "afterwards it has learned from them too"


def test_a_library_of_five_strokes_is_learned_from_without_a_rehearsal():
    report = train_param2stroke(Param2Stroke("small", small_frame(12, 20), SMALL.limits), small_library(5), epochs=2)
    assert len(report.curve) == 2


def test_the_same_seed_gives_the_same_weights():
    models = [Param2Stroke("small", small_frame(12, 20), SMALL.limits) for _ in range(2)]
    models[1].load_state_dict(models[0].state_dict())
    for model in models:
        train_param2stroke(model, small_library(6), seed=1, rehearsals=0, epochs=2)
    first, second = (model.state_dict() for model in models)
    assert all(torch.equal(tensor, second[name]) for name, tensor in first.items())
    assert len(models[0].state_dict()) == 8


def test_a_library_of_too_few_strokes_is_refused():
    with pytest.raises(LibraryError, match="at least 5"):
        train_param2stroke(Param2Stroke.fresh(SMALL), small_library(4))
