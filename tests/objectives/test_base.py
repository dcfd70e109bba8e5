import pytest
import torch

from frida_painter.errors import ConfigError
from frida_painter.frames import PixelGrid
from frida_painter.goal import Goal
from frida_painter.objectives.base import prepare
from frida_painter.objectives.kinds.image import ImageTerm
from scenes import CANVAS

GRID = PixelGrid.of_height(CANVAS, 24)


def flat(value: float) -> torch.Tensor:
    return torch.full((3, 240, 320), value)


def test_replication_is_the_mean_squared_difference() -> None:
    objective = prepare(Goal((ImageTerm(flat(0.5)),)), GRID)
    assert float(objective(torch.full((3, GRID.rows, GRID.columns), 0.8))) == pytest.approx(0.09)
    assert float(objective(torch.full((3, GRID.rows, GRID.columns), 0.5))) < 1e-12


def test_a_goal_is_the_weighted_sum_of_its_terms() -> None:
    objective = prepare(Goal((ImageTerm(flat(0.0), 2.0), ImageTerm(flat(1.0), 0.5))), GRID)
    assert float(objective(torch.full((3, GRID.rows, GRID.columns), 0.2))) == pytest.approx(2 * 0.04 + 0.5 * 0.64)


def test_an_objective_has_the_slope_of_what_it_says() -> None:
    objective = prepare(Goal((ImageTerm(flat(0.25)),)), PixelGrid.of_height(CANVAS, 6))
    picture = torch.rand(3, 6, 8, dtype=torch.float64, generator=torch.Generator().manual_seed(0), requires_grad=True)
    assert torch.autograd.gradcheck(objective, (picture,))


@pytest.mark.parametrize("weight", [0.0, -1.0, float("nan"), float("inf")])
def test_weights_that_mean_nothing_are_refused(weight: float) -> None:
    with pytest.raises(ConfigError, match="above 0 and finite"):
        ImageTerm(flat(0.5), weight)


def test_a_goal_without_terms_is_refused() -> None:
    with pytest.raises(ConfigError, match="without any term"):
        Goal(())
