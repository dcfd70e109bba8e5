import numpy as np
import pytest
import torch

from frida_painter.lab import sawyer
from frida_painter.lab.targets import load_shipped_targets

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("small_world")]


def step(edge: float) -> torch.Tensor:
    """A picture [3, 40, 60] that is dark left of `edge` (columns) and light right of it, as a lens draws it."""
    grey = 0.1 + 0.8 * torch.sigmoid((torch.arange(60) + 0.5 - edge) / 0.8)
    return grey.expand(3, 40, 60)


@pytest.mark.parametrize("shift", [0.0, 0.05, 0.2])
def test_the_shift_of_an_edge_is_found_in_fractions_of_a_pixel(shift):
    apart = sawyer.edges_apart(step(30.0), step(30.0 + shift))
    assert len(apart) >= 40 and np.median(apart) == pytest.approx(shift, rel=0.2, abs=1e-4)


def test_where_there_is_no_paint_there_are_no_edges():
    assert len(sawyer.edges_apart(torch.ones(3, 20, 20), torch.zeros(3, 20, 20))) == 0


@pytest.mark.slow
def test_the_sawyer_paints_what_the_kinematic_arm_paints_but_for_its_small_errors():
    pytest.importorskip("mink")
    (target,) = load_shipped_targets(["coffee"])
    outcome = sawyer.run(target, scale=sawyer.QUICK)
    errors, apart, took = (table.rows for table in outcome.tables)
    assert 0 < errors[0]["in the plane, mean"] < 0.3 and errors[0]["worst"] < 1.5
    mse = {row["painted by"]: row["MSE"] for row in apart}
    assert 0 < mse[sawyer.DYNAMIC] < 0.5 * mse[sawyer.USUAL]
    seconds = {row["painted by"]: row["robot's seconds"] for row in took}
    assert seconds[sawyer.DYNAMIC] == pytest.approx(seconds[sawyer.KINEMATIC], abs=0.5)
    assert set(outcome.pictures) == {"sawyer"} and len(outcome.notes) == 3
