import torch

from frida_painter.perception.color import true_color
from photographs import calibration


def test_the_affine_map_is_applied_to_every_pixel_and_kept_in_range():
    swapped = calibration(color=((0, 1, 0, 0), (1, 0, 0, 0.1), (0, 0, 2, -0.5)))
    picture = torch.tensor([0.2, 0.4, 0.9])[:, None, None].expand(3, 4, 5)
    wanted = torch.tensor([0.4, 0.3, 1.0])[:, None, None].expand(3, 4, 5)
    torch.testing.assert_close(true_color(picture, swapped), wanted)


def test_the_default_changes_nothing():
    picture = torch.rand(3, 4, 5, generator=torch.Generator().manual_seed(0))
    torch.testing.assert_close(true_color(picture, calibration()), picture)
