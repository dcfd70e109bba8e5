import json
from pathlib import Path

import pytest
import torch
from torch import nn

from frida_painter import tensor_file
from frida_painter.brush.kinds import KINDS
from frida_painter.brush.weights import load_stroke_model
from frida_painter.errors import WeightsError
from frida_painter_calibration.teaching.param2stroke import Param2Stroke
from marks import SMALL, shapes, small_frame


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    Param2Stroke.fresh(SMALL, seed=3).save(tmp_path / "small.safetensors")
    return tmp_path / "small.safetensors"


def test_it_is_the_papers_network():
    model = Param2Stroke.fresh(SMALL)
    kinds = [type(part) for part in model.children()]
    assert kinds == [nn.Linear, nn.Linear, nn.Conv2d, nn.Conv2d]


def test_maps_have_the_frames_cells_and_are_magnitudes():
    maps = Param2Stroke.fresh(SMALL)(*shapes(5))
    assert maps.shape == (5, SMALL.frame.rows, SMALL.frame.columns)
    assert 0 <= float(maps.detach().amin()) <= float(maps.detach().amax()) <= 1


def test_it_is_differentiable_in_the_shape_of_the_stroke():
    model = Param2Stroke("small", small_frame(6, 8), SMALL.limits).double()
    inputs = [part.requires_grad_() for part in shapes(2, dtype=torch.float64)]
    assert torch.autograd.gradcheck(
        lambda thickness, length, bend: model(thickness, length / 100, bend / 100),
        [inputs[0], *(100 * part.detach() for part in inputs[1:])],
    )


def test_the_seed_decides_the_first_weights_and_leaves_the_world_alone():
    before = torch.get_rng_state()
    one, same, other = (Param2Stroke.fresh(SMALL, seed=seed).draw.weight for seed in (1, 1, 2))
    assert torch.equal(one, same)
    assert not torch.equal(one, other)
    assert torch.equal(before, torch.get_rng_state())


def test_weights_come_back_as_they_were(saved):
    model, again = Param2Stroke.fresh(SMALL, seed=3), Param2Stroke.load(saved)
    assert (again.brush, again.frame, again.limits) == ("small", SMALL.frame, SMALL.limits)
    assert torch.equal(model(*shapes(3)), again(*shapes(3)))
    assert not any(parameter.requires_grad for parameter in again.parameters())


def spoil(path: Path, **changes: object) -> None:
    tensors, metadata = tensor_file.read_tensors(path, "weights")
    about = {**json.loads(metadata["stroke_model"]), **changes}
    tensor_file.write_tensors(path, tensors, {"stroke_model": json.dumps(about)})


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
    spoil(saved, **changes)
    with pytest.raises(WeightsError):
        Param2Stroke.load(saved)


@pytest.mark.parametrize(
    "metadata", [{}, {"stroke_model": "{"}, {"stroke_model": "[" * 100_000}, {"stroke_model": "7"}]
)
def test_tensors_that_do_not_say_what_they_are_are_refused(saved, metadata):
    tensors, _ = tensor_file.read_tensors(saved, "weights")
    tensor_file.write_tensors(saved, tensors, metadata)
    with pytest.raises(WeightsError, match="strokes train"):
        Param2Stroke.load(saved)


def test_the_same_model_gives_the_same_file_byte_for_byte(tmp_path):
    hashes = {Param2Stroke.fresh(SMALL).save(tmp_path / f"{number}.safetensors") for number in range(4)}
    assert len(hashes) == 1


def test_weights_of_another_shape_missing_or_nan_are_refused(saved):
    tensors, metadata = tensor_file.read_tensors(saved, "weights")
    broken = (
        {name: tensor for name, tensor in tensors.items() if name != "draw.bias"},
        {**tensors, "draw.bias": torch.zeros(3)},
        {**tensors, "draw.bias": torch.full_like(tensors["draw.bias"], torch.nan)},
    )
    for part in broken:
        tensor_file.write_tensors(saved, part, metadata)
        with pytest.raises(WeightsError):
            Param2Stroke.load(saved)


def test_files_that_are_cut_off_missing_or_pickles_are_refused(saved, tmp_path):
    saved.write_bytes(saved.read_bytes()[:-100])
    torch.save({"draw.bias": torch.zeros(3)}, tmp_path / "pickle.safetensors")
    for path in (saved, tmp_path / "pickle.safetensors", tmp_path / "nowhere.safetensors"):
        with pytest.raises(WeightsError):
            Param2Stroke.load(path)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_the_shipped_models_know_their_brushes(kind):
    model = load_stroke_model(kind.name)
    assert (model.brush, model.limits) == (kind.name, kind.limits)
    middle = torch.tensor([0.8]), torch.tensor([sum(kind.limits.length) / 2]), torch.zeros(1)
    mark = model(*middle)[0]
    center = model.frame.cell_centers()
    inside = (center[..., 1].abs() < 0.15 * kind.width) & ((center[..., 0] / middle[1] - 0.5).abs() < 0.25)
    far = (center[..., 1].abs() > 0.9 * kind.width) | (center[..., 0] > middle[1] + 0.6 * kind.width)
    assert float(mark[inside].mean()) > 0.85
    assert float(mark[far].mean()) < 0.002


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_the_shipped_models_are_small(kind, tmp_path):
    load_stroke_model(kind.name).save(tmp_path / "model.safetensors")
    assert (tmp_path / "model.safetensors").stat().st_size < 500_000


def test_a_file_of_ones_own_can_be_named_instead(saved):
    assert load_stroke_model(saved).brush == "small"
    with pytest.raises(WeightsError, match="broom is no brush; give fine, medium, broad"):
        load_stroke_model("broom")
    with pytest.raises(WeightsError, match=r"broom.safetensors does not exist"):
        load_stroke_model("broom.safetensors")
