"""The paper's network: its maps, its files and its training."""

import json
from pathlib import Path

import pytest
import torch
from torch import nn

from frida_painter.brush.kinds import KINDS
from frida_painter.brush.weights import load_stroke_model
from frida_painter.errors import LibraryError, WeightsError
from frida_painter.system import tensor_file
from frida_painter_calibration.teaching.param2stroke import Param2Stroke, train_param2stroke
from frida_painter_calibration.teaching.training import make_fresh
from marks import SMALL, shapes, small_frame, small_library


def fresh(seed: int = 0, frame=SMALL.frame) -> Param2Stroke:
    return make_fresh(Param2Stroke, "small", frame, SMALL.limits, seed)


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    fresh(seed=3).save(tmp_path / "small.safetensors")
    return tmp_path / "small.safetensors"


def test_it_is_the_papers_network_and_its_maps_are_magnitudes_on_the_frames_cells():
    model = fresh()
    assert [type(part) for part in model.children()] == [nn.Linear, nn.Linear, nn.Conv2d, nn.Conv2d]
    maps = model(*shapes(5)).detach()
    assert maps.shape == (5, SMALL.frame.rows, SMALL.frame.columns)
    assert 0 <= float(maps.amin()) <= float(maps.amax()) <= 1


def test_it_is_differentiable_in_the_shape_of_the_stroke():
    model = fresh(frame=small_frame(6, 8)).double()
    inputs = [part.requires_grad_() for part in shapes(2, dtype=torch.float64)]
    assert torch.autograd.gradcheck(
        lambda thickness, length, bend: model(thickness, length / 100, bend / 100),
        [inputs[0], *(100 * part.detach() for part in inputs[1:])],
    )


def test_the_seed_decides_the_first_weights_and_leaves_the_world_alone():
    before = torch.get_rng_state()
    one, same, other = (fresh(seed).draw.weight for seed in (1, 1, 2))
    assert torch.equal(one, same) and not torch.equal(one, other)
    assert torch.equal(before, torch.get_rng_state())


def test_weights_come_back_as_they_were_and_byte_for_byte(saved):
    model, again = fresh(seed=3), load_stroke_model(saved)
    assert (again.brush, again.frame, again.limits) == ("small", SMALL.frame, SMALL.limits)
    assert torch.equal(model(*shapes(3)), again(*shapes(3)))
    assert not any(parameter.requires_grad for parameter in again.parameters())
    assert len({fresh().save(saved) for _ in range(3)}) == 1


@pytest.mark.parametrize(
    "changes",
    [
        {"format": "something else"},
        {"version": 99},
        {"cells": [20, 34]},
        {"cells": [10**6, 10**6]},
        {"cells": [20, 33]},
        {"cells": ["20", "32"]},
        {"cells": [-20, 32]},
        {"cells": 7},
        {"frame": [float("nan"), 1, -1, 1]},
        {"frame": [1, 2]},
        {"frame": None},
        {"limits": [0.03, 0.01, -1, 1]},
        {"limits": {}},
    ],
)
def test_weights_that_do_not_fit_are_refused(saved, changes):
    tensors, metadata = tensor_file.read_tensors(saved, "weights")
    about = {**json.loads(metadata["stroke_model"]), **changes}
    tensor_file.write_tensors(saved, tensors, {"stroke_model": json.dumps(about)})
    with pytest.raises(WeightsError):
        load_stroke_model(saved)


@pytest.mark.parametrize(
    "metadata", [{}, {"stroke_model": "{"}, {"stroke_model": "[" * 100_000}, {"stroke_model": "7"}]
)
def test_tensors_that_do_not_say_what_they_are_are_refused(saved, metadata):
    tensors, _ = tensor_file.read_tensors(saved, "weights")
    tensor_file.write_tensors(saved, tensors, metadata)
    with pytest.raises(WeightsError, match="strokes train"):
        load_stroke_model(saved)


def test_weights_that_are_cut_off_missing_or_pickles_are_refused(saved, tmp_path):
    tensors, metadata = tensor_file.read_tensors(saved, "weights")
    tensor_file.write_tensors(saved, {**tensors, "draw.bias": torch.zeros(3)}, metadata)
    cut, pickled = tmp_path / "cut.safetensors", tmp_path / "pickle.safetensors"
    cut.write_bytes(saved.read_bytes()[:-100])
    torch.save({"draw.bias": torch.zeros(3)}, pickled)
    for path in (saved, cut, pickled, tmp_path / "nowhere.safetensors"):
        with pytest.raises(WeightsError):
            load_stroke_model(path)
    with pytest.raises(WeightsError, match="broom is no brush; give fine, medium, broad"):
        load_stroke_model("broom")


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_the_shipped_models_know_their_brushes_and_are_small(kind, tmp_path):
    model = load_stroke_model(kind.name)
    assert (model.brush, model.limits) == (kind.name, kind.limits)
    middle = torch.tensor([0.8]), torch.tensor([sum(kind.limits.length) / 2]), torch.zeros(1)
    mark, center = model(*middle)[0], model.frame.cell_centers()
    inside = (center[..., 1].abs() < 0.15 * kind.width) & ((center[..., 0] / middle[1] - 0.5).abs() < 0.25)
    far = (center[..., 1].abs() > 0.9 * kind.width) | (center[..., 0] > middle[1] + 0.6 * kind.width)
    assert float(mark[inside].mean()) > 0.85 and float(mark[far].mean()) < 0.002
    model.save(tmp_path / "model.safetensors")
    assert (tmp_path / "model.safetensors").stat().st_size < 500_000


def test_training_learns_the_library_for_as_many_epochs_as_were_best():
    library, model, progress = small_library(40), fresh(frame=small_frame(12, 20)), []
    report = train_param2stroke(model, library, rehearsals=3, epochs=6, notify=progress.append)
    assert tuple(progress) == report.curve
    held_out = library[report.held_out]
    wanted = held_out.maps(model.frame)
    assert len(held_out) == 8 and report.validation_error < 0.2 * float(wanted.abs().mean())
    assert report.validation_error == min(step.validation_error for step in report.curve)
    assert report.curve[report.best_epoch - 1].validation_error == report.validation_error
    told = float((report.predicted - wanted).abs().mean())
    assert told == pytest.approx(report.validation_error, rel=1e-4), "before it saw them"
    with torch.no_grad():
        error = float((model(*held_out.shapes()) - wanted).abs().mean())
    assert error < 1.1 * report.validation_error, "afterwards it has learned from them too"


def test_five_strokes_are_learned_from_without_a_rehearsal_and_four_are_refused():
    model = fresh(frame=small_frame(12, 20))
    assert len(train_param2stroke(model, small_library(5), epochs=2).curve) == 2
    assert len(train_param2stroke(model, small_library(6), rehearsals=0, epochs=9, patience=0).curve) == 1
    with pytest.raises(LibraryError, match="at least 5"):
        train_param2stroke(model, small_library(4))


def test_the_same_seed_gives_the_same_weights():
    models = [fresh(frame=small_frame(12, 20)) for _ in range(2)]
    for model in models:
        train_param2stroke(model, small_library(6), seed=1, rehearsals=0, epochs=2)
    first, second = (model.state_dict() for model in models)
    assert len(first) == 8 and all(torch.equal(tensor, second[name]) for name, tensor in first.items())
