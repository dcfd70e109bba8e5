import math

import pytest
import torch

from frida_painter.canvas_size import CanvasSize
from frida_painter.frames import PixelGrid
from frida_painter.lab import sim2real
from frida_painter.lab.sim2real import Freedom, SoftStrokes, render

SIZE = CanvasSize(0.2, 0.1)
BARE = torch.ones(3, 100, 200, dtype=torch.float64)


def stroke(points, radius=(0.01, 0.01), opacity=(1.0, 1.0), color=(0.0, 0.0, 0.0)) -> SoftStrokes:
    return SoftStrokes(*(torch.tensor([part], dtype=torch.float64) for part in (points, radius, opacity, color)))


STRAIGHT = ((0.05, 0.05), (0.1, 0.05), (0.15, 0.05))


def covered(strokes: SoftStrokes) -> torch.Tensor:
    return 1 - render(strokes, BARE, SIZE)[0]


@pytest.mark.slow
def test_a_straight_stroke_covers_its_capsule():
    area = float(covered(stroke(STRAIGHT)).sum()) * 0.001**2
    assert area == pytest.approx(0.1 * 0.02 + math.pi * 0.01**2, rel=0.03)


def test_it_lies_where_it_should_and_its_middle_hangs_half_of_its_bow_aside():
    alpha = covered(stroke(((0.05, 0.03), (0.1, 0.07), (0.15, 0.03)), radius=(0.004, 0.004)))
    row, _ = PixelGrid(SIZE, 100, 200).to_pixels(torch.tensor([[0.1, 0.05]], dtype=torch.float64))[0].flip(0)
    column = alpha[:, 100]
    center = float((column * torch.arange(100)).sum() / column.sum())
    assert center == pytest.approx(float(row), abs=0.5)


def test_opacity_and_radius_run_from_end_to_end():
    alpha = covered(stroke(STRAIGHT, radius=(0.004, 0.012), opacity=(0.2, 0.8)))
    middle = alpha[49:51, :].mean(0)
    assert float(middle[60]) == pytest.approx(0.2 + 0.6 * 0.1, abs=0.05)
    assert float(middle[140]) == pytest.approx(0.2 + 0.6 * 0.9, abs=0.05)
    assert int((alpha[:, 140] > 0.1).sum()) > 1.8 * int((alpha[:, 60] > 0.1).sum())


@pytest.mark.slow
def test_the_slopes_are_those_of_the_picture(monkeypatch):
    """On fine cells: the differences see that the cells move with the stroke, the slopes do not."""
    monkeypatch.setattr(sim2real, "_CELLS", 300)
    start = stroke(((0.08, 0.04), (0.11, 0.07), (0.12, 0.05)), radius=(0.015, 0.018), opacity=(0.6, 0.9))
    weight = torch.rand(BARE.shape, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    weight = torch.nn.functional.avg_pool2d(weight, 31, 1, 15)

    def judged(strokes: SoftStrokes) -> torch.Tensor:
        return (render(strokes, BARE, SIZE) * weight).sum()

    leaves = {name: part.clone().requires_grad_() for name, part in start.arrays().items()}
    slopes = torch.autograd.grad(judged(SoftStrokes(**leaves)), list(leaves.values()))
    for (name, part), slope in zip(start.arrays().items(), slopes, strict=True):
        step = 2e-4 if name in ("points", "radius") else 1e-3
        for index in range(part.numel()):
            bump = torch.zeros(part.numel(), dtype=torch.float64)
            bump[index] = step
            bump = bump.view_as(part)
            ahead, behind = (judged(SoftStrokes(**{**start.arrays(), name: part + sign * bump})) for sign in (1, -1))
            found, differences = float(slope.flatten()[index]), float(ahead - behind) / (2 * step)
            assert found == pytest.approx(differences, rel=0.02, abs=0.005 * float(slope.abs().max()))


def test_projection_holds_strokes_to_their_freedom_and_stays_there():
    chance = torch.Generator().manual_seed(3)
    wild = SoftStrokes(
        0.6 * torch.rand(40, 3, 2, generator=chance) - 0.2,
        0.1 * torch.rand(40, 2, generator=chance),
        3 * torch.rand(40, 2, generator=chance) - 1,
        3 * torch.rand(40, 3, generator=chance) - 1,
    )
    freedom = Freedom((0.01, 0.05), (0.002, 0.008), (-0.01, 0.01), (0.5, 1.0), tapered=False)
    held = freedom.project(wild, SIZE)
    assert ((held.length() > 0.01 - 1e-6) & (held.length() < 0.05 + 1e-6)).all()
    assert ((held.radius >= 0.002) & (held.radius <= 0.008)).all() and (held.radius[:, 0] == held.radius[:, 1]).all()
    assert ((held.opacity >= 0.5) & (held.opacity <= 1)).all() and ((held.color >= 0) & (held.color <= 1)).all()
    for name, part in freedom.project(held, SIZE).arrays().items():
        torch.testing.assert_close(part, held.arrays()[name], rtol=1e-4, atol=1e-6)
