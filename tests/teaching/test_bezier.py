import pytest
import torch

from frida_painter_calibration.teaching.bezier import BezierStroke, RibbonShape, fit_bezier
from marks import SMALL, ribbon, shapes, small_frame, small_library


def test_marks_are_opaque_on_the_path_and_nothing_away_from_it():
    model = ribbon(48, 84)
    thickness, length, bend = shapes(6)
    mark = model(thickness, length, bend)
    cell = model.frame.cell_centers()
    fraction = torch.linspace(0.2, 0.8, 50)[:, None]
    for i in range(6):
        path = torch.cat([fraction * length[i], 3 * fraction * (1 - fraction) * bend[i]], 1)
        away = torch.cdist(cell.reshape(-1, 2), path).amin(1).reshape(cell.shape[:2])
        assert mark[i][away < 0.0004].amin() > 0.9
        assert mark[i][away > 0.012].amax() == 0


def test_a_bend_above_zero_goes_up_in_the_map_and_its_mirror_image_down():
    up, down = (ribbon()(*(torch.tensor([part]) for part in (0.5, 0.03, bend)))[0] for bend in (0.008, -0.008))
    torch.testing.assert_close(up, down.flip(0))
    row = torch.arange(24.0)[:, None]
    assert (up * row).sum() / up.sum() < 11


def test_a_harder_press_covers_more():
    areas = [float(ribbon()(torch.tensor([h]), torch.tensor([0.02]), torch.zeros(1)).sum()) for h in (0.0, 0.5, 1.0)]
    assert areas[0] < areas[1] < areas[2]


def test_the_gradient_is_the_true_one():
    model = ribbon(8, 12).double()
    inputs = [part.requires_grad_() for part in shapes(2, dtype=torch.float64)]
    scaled = torch.autograd.gradcheck(
        lambda thickness, length, bend: model(thickness, length / 1000, bend / 1000),
        (inputs[0], *(1000 * part.detach() for part in inputs[1:])),
    )
    assert scaled


def test_fitting_finds_the_ribbon_that_painted_a_library():
    model = BezierStroke("small", small_frame(), SMALL.limits, RibbonShape.typical(0.005))
    thickness, length, bend = shapes(12)
    with torch.no_grad():
        before = (model(thickness, length, bend) - small_library().maps(model.frame)).abs().mean()
    error = fit_bezier(model, small_library(), steps=120)
    assert error < 0.2 * before
    assert model.ribbon.hardest == pytest.approx(4.0, abs=0.3)
    assert model.ribbon.lightest == pytest.approx(1.0, abs=0.3)
    assert model.ribbon.opacity == pytest.approx(0.95, abs=0.03)
