import numpy as np
import pytest
import torch

from frida_painter.strokes.strokes import StrokeLimits
from frida_painter_lab.continuous_strokes import PARAMETERS, ContinuousStrokes, sweep

LIMITS = StrokeLimits((0.01, 0.05), (-0.02, 0.02))


@pytest.mark.parametrize(
    ("parameter", "extremes"), [("thickness", (0, 1)), ("length", LIMITS.length), ("bend", LIMITS.bend)]
)
def test_a_sweep_goes_from_extreme_to_extreme_in_one_parameter_only(parameter, extremes):
    strokes = sweep(parameter, LIMITS, 5)
    np.testing.assert_allclose(getattr(strokes, parameter), np.linspace(*extremes, 5), rtol=1e-6)
    for other in set(PARAMETERS) - {parameter}:
        assert len(torch.unique(getattr(strokes, other))) == 1


def test_the_robot_paints_about_what_the_model_says():
    outcome = ContinuousStrokes(quick=True, brush="fine", seed=2).run()
    rows = outcome.tables[0].rows
    assert len(rows) == 3 * len(PARAMETERS)
    for row in rows:
        assert row["area modelled mm2"] == pytest.approx(row["area painted mm2"], rel=0.35)
        assert 0 < row["mean abs. difference"] < 0.05
    for parameter in ("thickness", "length"):
        for column in ("area modelled mm2", "area painted mm2"):
            areas = [row[column] for row in rows if row["swept"] == parameter]
            assert areas == sorted(areas) and areas[-1] > 1.2 * areas[0] > 0
    picture = outcome.pictures["continuous-strokes"]
    assert float(picture.min()) < 0.3 and picture.shape[2] > 3 * 150
