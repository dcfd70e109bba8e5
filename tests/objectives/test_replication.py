import torch

from frida_painter.frames import PixelGrid, Rows
from frida_painter.objectives.image import Replication
from support.planning import CANVAS

GRID = PixelGrid.of_height(CANVAS, 24)


def test_what_matters_more_counts_more_and_noise_costs_its_variance() -> None:
    chance = torch.Generator().manual_seed(0)
    target, picture = torch.rand(2, 3, GRID.rows, GRID.columns, generator=chance)
    matters = torch.ones(GRID.rows, GRID.columns)
    matters[:6] = 4.0
    plain, weighed = Replication.of(target, GRID), Replication.of(target, GRID, matters / matters.mean())
    assert torch.isclose(plain(picture), (picture - target).square().mean()) and float(plain(target)) == 0
    above, below = target.clone(), target.clone()
    above[:, :6], below[:, -6:] = 0.5, 0.5
    assert float(weighed(above) / plain(above)) > 3.5 * float(weighed(below) / plain(below))
    noise = 0.1 * torch.randn(200, 3, GRID.rows, GRID.columns, generator=chance)
    for judge in (plain, weighed):
        seen = torch.stack([judge(picture + one) for one in noise]).mean()
        told = judge(picture) + judge.of_variance(torch.full_like(picture[0], 0.01))
        assert torch.isclose(seen, told, rtol=0.02)


def test_the_mean_over_the_rows_turns_is_what_the_whole_picture_is_judged_as() -> None:
    chance = torch.Generator().manual_seed(1)
    target, picture, (variance, *_) = torch.rand(3, 3, GRID.rows, GRID.columns, generator=chance)
    matters = torch.rand(GRID.rows, GRID.columns, generator=chance)
    for judge in (Replication.of(target, GRID), Replication.of(target, GRID, matters / matters.mean())):
        turns = [Rows(4, first) for first in range(4)]
        seen = torch.stack([judge.on_rows(rows)(rows.of(picture)) for rows in turns])
        varies = torch.stack([judge.on_rows(rows).of_variance(rows.of(variance)) for rows in turns])
        assert float(seen.std()) > 0
        assert torch.isclose(seen.mean(), judge(picture)) and torch.isclose(varies.mean(), judge.of_variance(variance))
