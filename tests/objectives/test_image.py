import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.frames import PixelGrid, Rows
from frida_painter.objectives.image import ImageTerm, Replication, fit_and_sharpen
from frida_painter.objectives.interpretation import interpret_goal, prepare
from frida_painter.objectives.objective import Goal
from frida_painter.system import images
from support.networks import QuickEncoders
from support.planning import CANVAS, picture

GRID = PixelGrid.of_height(CANVAS, 96)


def step() -> torch.Tensor:
    """Dark on the left, light on the right."""
    made = torch.full((3, GRID.rows, GRID.columns), 0.3)
    made[:, :, GRID.columns // 2 :] = 0.6
    return made


@given(st.floats(0, 1))
def test_an_even_picture_stays_and_all_stay_in_range(gray: float) -> None:
    even = torch.full((3, GRID.rows, GRID.columns), gray)
    assert torch.allclose(fit_and_sharpen(even, GRID), even, atol=1e-5)
    sharp = fit_and_sharpen(picture(12, 17), GRID)
    assert float(sharp.min()) >= 0 and float(sharp.max()) <= 1


def test_an_edge_gets_contrast_by_so_much_and_what_is_far_from_it_stays() -> None:
    sharp = fit_and_sharpen(step(), GRID)
    row, middle = sharp[0, 5], GRID.columns // 2
    assert float(row[middle]) > 0.6 + 0.3 * 0.1 and float(row[middle - 1]) < 0.3 - 0.3 * 0.1
    assert float(row[middle] - 0.6) == pytest.approx(0.3 - float(row[middle - 1]), abs=1e-5)
    assert torch.allclose(row[: middle - 16], step()[0, 5, : middle - 16], atol=1e-5)


def test_photographs_are_planned_towards_sharper_and_forecast_as_they_are() -> None:
    goal = Goal((ImageTerm(step()),))
    (term,) = interpret_goal(goal, GRID, QuickEncoders(), 0).terms
    assert isinstance(term, ImageTerm) and torch.equal(term.picture, step())
    wanted = term.guide
    assert float((wanted - step()).abs().amax()) > 0.03
    objective = prepare(Goal((term,)), GRID)
    assert float(objective(wanted)) < 1e-12 < float(objective(step()))
    assert interpret_goal(Goal((term,)), GRID, QuickEncoders(), 0).terms[0].guide is wanted, "it is sharpened once"
    assert term.with_picture(1 - step()).guide is not wanted, "another picture is sharpened for itself"


def test_it_is_as_sharp_on_the_canvas_at_any_resolution() -> None:
    found = []
    for rows in (96, 192):
        grid = PixelGrid.of_height(CANVAS, rows)
        large = images.fit(step(), rows, grid.columns)
        (term,) = interpret_goal(Goal((ImageTerm(large),)), grid, QuickEncoders(), 0).terms
        found.append(images.fit(term.guide, 96, GRID.columns))
    assert float((found[0] - found[1]).abs().mean()) < 0.004


COARSE = PixelGrid.of_height(CANVAS, 24)


def test_what_matters_more_counts_more_and_noise_costs_its_variance() -> None:
    chance = torch.Generator().manual_seed(0)
    target, picture = torch.rand(2, 3, COARSE.rows, COARSE.columns, generator=chance)
    matters = torch.ones(COARSE.rows, COARSE.columns)
    matters[:6] = 4.0
    plain, weighed = (Replication.of(target, COARSE), Replication.of(target, COARSE, matters / matters.mean()))
    assert torch.isclose(plain(picture), (picture - target).square().mean()) and float(plain(target)) == 0
    above, below = target.clone(), target.clone()
    above[:, :6], below[:, -6:] = 0.5, 0.5
    assert float(weighed(above) / plain(above)) > 3.5 * float(weighed(below) / plain(below))
    noise = 0.1 * torch.randn(200, 3, COARSE.rows, COARSE.columns, generator=chance)
    for judge in (plain, weighed):
        seen = torch.stack([judge(picture + one) for one in noise]).mean()
        told = judge(picture) + judge.of_variance(torch.full_like(picture[0], 0.01))
        assert torch.isclose(seen, told, rtol=0.02)


def test_the_mean_over_the_rows_turns_is_what_the_whole_picture_is_judged_as() -> None:
    chance = torch.Generator().manual_seed(1)
    target, picture, (variance, *_) = torch.rand(3, 3, COARSE.rows, COARSE.columns, generator=chance)
    matters = torch.rand(COARSE.rows, COARSE.columns, generator=chance)
    for judge in (Replication.of(target, COARSE), Replication.of(target, COARSE, matters / matters.mean())):
        turns = [Rows(4, first) for first in range(4)]
        seen = torch.stack([judge.on_rows(rows)(rows.of(picture)) for rows in turns])
        varies = torch.stack([judge.on_rows(rows).of_variance(rows.of(variance)) for rows in turns])
        assert float(seen.std()) > 0
        assert torch.isclose(seen.mean(), judge(picture)) and torch.isclose(varies.mean(), judge.of_variance(variance))
