import numpy as np
import pytest
import torch

from frida_painter.errors import ConfigError
from frida_painter.lab import continuous_strokes
from frida_painter.lab.continuous_strokes import PARAMETERS, QUICK, run_on_library, sweep
from frida_painter.strokes import StrokeLimits
from marks import small_library

LIMITS = StrokeLimits((0.01, 0.05), (-0.02, 0.02))


@pytest.fixture(scope="module")
def outcome():
    return continuous_strokes.run(brush="fine", seed=2, scale=QUICK)


@pytest.mark.parametrize(
    ("parameter", "extremes"), [("thickness", (0, 1)), ("length", LIMITS.length), ("bend", LIMITS.bend)]
)
def test_a_sweep_goes_from_extreme_to_extreme_in_one_parameter_only(parameter, extremes):
    strokes = sweep(parameter, LIMITS, 5)
    values = getattr(strokes, parameter)
    np.testing.assert_allclose(values, np.linspace(*extremes, 5), rtol=1e-6)
    for other in set(PARAMETERS) - {parameter}:
        assert len(torch.unique(getattr(strokes, other))) == 1


@pytest.mark.slow
def test_more_thickness_and_more_length_leave_more_paint(outcome):
    (table,) = outcome.tables
    assert len(table.rows) == len(PARAMETERS) * QUICK.strokes
    for parameter in ("thickness", "length"):
        for column in ("area modelled mm2", "area below mm2"):
            areas = [row[column] for row in table.rows if row["swept"] == parameter]
            assert areas == sorted(areas) and areas[-1] > 1.2 * areas[0] > 0


def test_the_robot_paints_about_what_the_model_says(outcome):
    for row in outcome.tables[0].rows:
        assert row["area modelled mm2"] == pytest.approx(row["area below mm2"], rel=0.35)
        assert 0 < row["mean abs. difference"] < 0.05


def test_the_picture_shows_every_stroke_twice(outcome):
    picture = outcome.pictures["continuous-strokes"]
    assert picture.shape[0] == 3 and float(picture.min()) < 0.3
    assert picture.shape[2] > QUICK.strokes * 150


@pytest.mark.slow
def test_the_same_seed_gives_the_same_figures(outcome):
    again = continuous_strokes.run(brush="fine", seed=2, scale=QUICK)
    assert again.tables == outcome.tables
    assert torch.equal(again.pictures["continuous-strokes"], outcome.pictures["continuous-strokes"])


def test_a_brush_that_is_not_there_is_refused():
    with pytest.raises(ConfigError, match="'mop'"):
        continuous_strokes.run(brush="mop", scale=QUICK)


def test_of_a_library_the_nearest_strokes_are_shown():
    library = small_library(30, seed=1)
    outcome = run_on_library(library, "small", scale=QUICK)
    rows = outcome.tables[0].rows
    assert [row["thickness"] for row in rows[:3]] == [pytest.approx(value, abs=1e-4) for value in (0, 0.5, 1)]
    areas = [row["area below mm2"] for row in rows if row["swept"] == "thickness"]
    real = library.magnitude.sum((1, 2)) / 255 * library.metres_per_pixel**2 * 1e6
    assert all(min(abs(real - area)) < 0.1 for area in areas) and areas[0] < areas[-1]
    assert outcome.settings["library"] == "small"
