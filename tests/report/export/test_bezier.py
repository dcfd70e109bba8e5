import math

import torch

from frida_painter.brush.kinds import MEDIUM
from frida_painter.report.vector import control_points, mark_widths
from frida_painter.strokes.strokes import Strokes
from frida_painter_calibration.teaching.bezier import BezierStroke
from support.plans import made_up_strokes


def test_control_points_draw_the_path_of_the_strokes() -> None:
    strokes = made_up_strokes(30).to(torch.float64)
    points = control_points(strokes)
    assert points.shape == (30, 4, 2)
    t = torch.linspace(0, 1, 9, dtype=torch.float64)
    weights = torch.stack(((1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3), -1)  # [9, 4]
    assert torch.allclose(weights @ points, strokes.path(t), atol=1e-12)


class Capsule:
    """A brush whose every mark is a straight line of known width with round ends."""

    brush, limits, width = "capsule", MEDIUM.limits, 0.008
    frame = MEDIUM.frame.resize(600, 1200)

    def __call__(self, thickness: torch.Tensor, length: torch.Tensor, bend: torch.Tensor) -> torch.Tensor:
        cell = self.frame.cell_centers()
        beside = torch.minimum(cell[..., 0].clamp(min=0), length[:, None, None])
        distance = torch.hypot(cell[..., 0] - beside, cell[..., 1].expand_as(beside))
        return (distance < self.width / 2).float()


def test_the_width_of_a_mark_is_that_of_a_round_ended_line_of_its_area() -> None:
    strokes = made_up_strokes(3)
    straight = strokes.with_groups(bend=torch.zeros(3))
    assert torch.allclose(mark_widths(straight, Capsule()), torch.full((3,), 0.008), rtol=0.01)


def test_a_harder_press_is_wider() -> None:
    strokes = made_up_strokes(3)
    pressed = strokes.with_groups(
        thickness=torch.tensor([0.0, 0.5, 1.0]), length=torch.full((3,), 0.04), bend=torch.zeros(3)
    )
    widths = mark_widths(pressed, BezierStroke.typical(MEDIUM))
    assert widths[0] < widths[1] < widths[2] < 1.3 * MEDIUM.width


def test_a_mark_that_is_nothing_still_has_a_width_and_no_strokes_have_none() -> None:
    class Nothing(Capsule):
        width = -1.0

    assert math.isclose(float(mark_widths(made_up_strokes(1), Nothing())), 0.0001, rel_tol=1e-5)
    assert mark_widths(Strokes.empty(), Capsule()).shape == (0,)
