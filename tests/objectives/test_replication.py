import torch

from frida_painter.frames import PixelGrid
from frida_painter.objectives.replication import replication, replication_of_variance
from scenes import CANVAS

GRID = PixelGrid.of_height(CANVAS, 24)


def test_what_matters_more_counts_more_and_noise_costs_its_variance() -> None:
    chance = torch.Generator().manual_seed(0)
    target, picture = torch.rand(2, 3, GRID.rows, GRID.columns, generator=chance)
    matters = torch.ones(GRID.rows, GRID.columns)
    matters[:6] = 4.0
    plain, weighed = replication(target, GRID), replication(target, GRID, matters / matters.mean())
    assert torch.isclose(plain(picture), (picture - target).square().mean()) and float(plain(target)) == 0
    above, below = target.clone(), target.clone()
    above[:, :6], below[:, -6:] = 0.5, 0.5
    assert float(weighed(above) / plain(above)) > 3.5 * float(weighed(below) / plain(below))
    noise = 0.1 * torch.randn(200, 3, GRID.rows, GRID.columns, generator=chance)
    for judge, more in ((plain, None), (weighed, matters / matters.mean())):
        seen = torch.stack([judge(picture + one) for one in noise]).mean()
        told = judge(picture) + replication_of_variance(GRID, more)(torch.full_like(picture, 0.01))
        assert torch.isclose(seen, told, rtol=0.02)
