"""The experiment of taught strokes: what a studio's own noise is, beside the error of a model."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from frida_painter.brush.kinds import FINE
from frida_painter.brush.library import StrokeLibrary
from frida_painter.lab.taught_strokes import measure_model, measure_noise

COUNT, ROWS, COLUMNS = 3, 12, 20


def library(marks: np.ndarray) -> StrokeLibrary:
    ones = np.ones(len(marks), np.float32)
    return StrokeLibrary(
        magnitude=marks,
        length_m=0.02 * ones,
        bend_m=0 * ones,
        thickness=0.5 * ones,
        metres_per_pixel=0.002,
        origin_px=(6.0, 4.0),
        recorded_index=np.arange(len(marks), dtype=np.int32),
    )


@pytest.fixture
def painted() -> np.ndarray:
    return np.random.default_rng(0).integers(60, 190, (COUNT, ROWS, COLUMNS)).astype(np.uint8)


def test_a_studio_that_repeats_itself_has_no_noise(painted: np.ndarray) -> None:
    assert measure_noise(library(painted), [library(painted)] * 3) == 0


def test_the_noise_is_the_distance_from_the_median_of_the_repeats(painted: np.ndarray) -> None:
    repeats = [library(painted + shift) for shift in (np.uint8(10), np.uint8(20), np.uint8(60))]
    assert measure_noise(library(painted), repeats) == pytest.approx(20 / 255)


def test_only_strokes_that_were_repeated_count(painted: np.ndarray) -> None:
    again = library(painted + np.uint8(10))
    spoiled = replace(again[1:3], recorded_index=np.array([1, 2], np.int32))
    other = library(painted)
    other.magnitude[0] = 255  # of a stroke that has one clean repeat alone
    assert measure_noise(other, [spoiled, again[1:3]]) == pytest.approx(10 / 255)
    assert math.isnan(measure_noise(other, [])) and math.isnan(measure_noise(other, [again]))


def test_a_model_is_measured_beside_the_noise(painted: np.ndarray) -> None:
    class Blank(torch.nn.Module):
        brush, frame, limits = "fine", FINE.frame, FINE.limits

        def forward(self, thickness, length, bend):
            return torch.zeros(len(length), FINE.frame.rows, FINE.frame.columns)

    row = measure_model("fine", Blank(), library(painted), [library(painted + np.uint8(10))] * 2)
    assert row["share of the paint"] == pytest.approx(1), "it predicts no paint at all"
    assert row["noise of the studio"] == pytest.approx(10 / 255)
    assert row["share"] == pytest.approx(row["noise of the studio"] / row["mean L1"])
    assert "share" not in measure_model("fine", Blank(), library(painted))
