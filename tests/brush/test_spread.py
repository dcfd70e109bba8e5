from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.brush.field import StrokeField
from frida_painter.brush.kinds import CERTAIN, CoverageSpread, median_of, spread_of
from frida_painter.brush.library import StrokeLibrary
from frida_painter.brush.table import StrokeTable, TableDetail
from frida_painter.brush.weights import load_stroke_model
from frida_painter.errors import WeightsError
from frida_painter.system import tensor_file
from frida_painter_calibration.teaching.evaluation import likelihood
from frida_painter_calibration.teaching.param2stroke import Param2Stroke
from frida_painter_calibration.teaching.training import train_field
from marks import SMALL, small_library


@given(share=st.floats(0.0, 1.0), full=st.floats(0.5, 1.0), seed=st.integers(0, 2**31))
def test_the_variance_is_that_of_a_number_which_never_leaves_its_range(share: float, full: float, seed: int) -> None:
    mean = torch.rand(50, generator=torch.Generator().manual_seed(seed))
    variance = CoverageSpread(share, full).variance(mean)
    assert bool(((variance >= 0) & (variance <= mean * (full - mean).clamp(min=0) + 1e-7)).all())


@pytest.mark.parametrize(("share", "full"), [(0.0, 1.0), (0.3, 0.9), (0.7, 0.98), (1.0, 0.8)])
def test_it_is_found_again_from_marks_that_vary_so(share: float, full: float) -> None:
    """Coverage that keeps its mean with a chance of 1 - share, and else is nothing or full."""
    generator = torch.Generator().manual_seed(0)
    mean = full * torch.rand(200_000, generator=generator)
    lands, varies = (torch.rand(len(mean), generator=generator) for _ in range(2))
    coverage = torch.where(varies < share, full * (lands < mean / full), mean)
    found = CoverageSpread.fit(mean, coverage)
    assert found.share == pytest.approx(share, abs=0.03)
    assert share == 0 or found.full == pytest.approx(full, abs=0.03)


def test_what_says_nothing_of_variance_is_certain_and_its_only_mark_the_median() -> None:
    model = Param2Stroke("small", SMALL.frame, SMALL.limits)
    assert spread_of(model) == CERTAIN
    assert median_of(model) is model


def test_a_table_varies_as_its_model_and_shows_the_mean(tmp_path: Path) -> None:
    model = StrokeField.fresh(SMALL)
    model.varies.copy_(torch.tensor((0.4, 0.9)))
    assert StrokeTable.of(model, detail=TableDetail((2, 2, 2), 8)).spread == pytest.approx((0.4, 0.9))
    model.save(tmp_path / "weights.safetensors")
    assert spread_of(load_stroke_model(tmp_path / "weights.safetensors")) == pytest.approx((0.4, 0.9))


@pytest.mark.parametrize("varies", [(-0.1, 1.0), (1.1, 1.0), (0.5, 0.0), (0.5, 1.5), (float("nan"), 1.0)])
def test_a_spread_that_cannot_be_is_refused(tmp_path: Path, varies: tuple[float, float]) -> None:
    path = tmp_path / "weights.safetensors"
    StrokeField.fresh(SMALL).save(path)
    tensors, about = tensor_file.read_tensors(path, "weights")
    tensor_file.write_tensors(path, {**tensors, "varies": torch.tensor(varies)}, about)
    with pytest.raises(WeightsError, match=r"out of range|not finite"):
        load_stroke_model(path)


def test_the_field_learns_how_marks_vary_better_than_by_one_number_for_all_places() -> None:
    model = StrokeField.fresh(SMALL)
    train_field(model, astray(30), epochs=20)
    found = likelihood(model, astray(10, seed=9))
    assert 0 < model.spread.share <= 1
    assert found.predicted > found.constant


def astray(count: int, seed: int = 0) -> StrokeLibrary:
    """Strokes that a robot has set down up to a millimetre beside where they were meant."""
    library = small_library(count, seed)
    shifts = np.random.default_rng(seed).integers(-3, 4, (count, 2))
    moved = [np.roll(mark, shift, (0, 1)) for mark, shift in zip(library.magnitude, shifts, strict=True)]
    return replace(library, magnitude=np.stack(moved))
